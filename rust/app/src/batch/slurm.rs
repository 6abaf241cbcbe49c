//! Batches on a cluster that Slurm schedules: a job array, of which each task runs a shard.

use super::{BatchError, Shard};
use proact_files::{make_folder, write_atomically};
use std::{
    fmt::Write,
    io,
    path::{Path, PathBuf},
    process::Command,
};

/// Where script and logs are, in the batch's folder.
const FOLDER: &str = "slurm";
const SCRIPT: &str = "array.sbatch";

/// A job array.
#[derive(Clone, Debug)]
pub struct SlurmJob {
    /// The batch's folder.
    pub dir: PathBuf,
    /// The program.
    pub program: PathBuf,
    /// Its words, without those that say which shard.
    pub arguments: Vec<String>,
    /// Tasks of the array.
    pub shards: usize,
    /// Trials at once in each.
    pub jobs: usize,
    /// Further options of `sbatch`, such as `--partition=long`.
    pub options: Vec<String>,
}

impl SlurmJob {
    /// The script: one that can be read, changed and submitted by hand.
    pub fn script(&self) -> String {
        let logs = self.dir.join(FOLDER).join("shard-%a.log");
        let (shards, jobs) = (self.shards, self.jobs);
        let mut script = format!(
            "#!/bin/sh\n# A batch of proact: each task of the array runs a shard, and the one that ends last puts all of them in order.\n\
             # What was cut off goes on where it was when this is submitted again.\n\
             # {}\n#SBATCH --job-name=proact\n#SBATCH --array=1-{shards}\n#SBATCH --cpus-per-task={jobs}\n#SBATCH --output={}\n",
            super::SIMULATED_DISCLAIMER,
            // Within its options Slurm takes a blank for an end, unless it is quoted.
            shell_quote(&logs.display().to_string())
        );
        self.options.iter().for_each(|option| _ = writeln!(script, "#SBATCH {option}"));
        let words = self.arguments.iter().map(|word| shell_quote(word)).collect::<Vec<_>>().join(" ");
        let program = shell_quote(&self.program.display().to_string());
        _ = writeln!(
            script,
            "exec {program} {words} --jobs {jobs} --shard \"$SLURM_ARRAY_TASK_ID/{shards}\""
        );
        script
    }
}

/// Writes the script into the batch's folder and submits it. The script, and the number of the job.
///
/// # Errors
/// A disk or a Slurm that refuses, in its own words; no Slurm on this machine.
pub fn submit(job: &SlurmJob) -> Result<(PathBuf, String), BatchError> {
    let folder = job.dir.join(FOLDER);
    let path = folder.join(SCRIPT);
    let failed = |reason: String| BatchError::File { path: path.clone(), reason };
    if !(1..=Shard::MAX_COUNT).contains(&job.shards) {
        return Err(failed(format!("{} tasks, expected 1 to {}", job.shards, Shard::MAX_COUNT)));
    }
    if let Some(option) = job.options.iter().find(|option| !option.starts_with('-') || option.contains('\n'))
    {
        return Err(failed(format!(
            "{option:?} is no option of sbatch, expected one such as --partition=long"
        )));
    }
    make_folder(&folder)
        .and_then(|()| write_atomically(&path, job.script()))
        .map_err(|error| failed(error.to_string()))?;
    let number = sbatch(&path).map_err(&failed)?;
    Ok((path, number))
}

fn sbatch(script: &Path) -> Result<String, String> {
    let output =
        Command::new("sbatch").arg("--parsable").arg(script).output().map_err(|error| {
            match error.kind() {
            io::ErrorKind::NotFound => {
                "the script is written, but there is no sbatch on this machine; copy it to where Slurm is \
                                    and submit it there"
                    .to_owned()
            }
            _ => format!("sbatch: {error}"),
        }
        })?;
    if !output.status.success() {
        return Err(format!("sbatch refused it: {}", String::from_utf8_lossy(&output.stderr).trim()));
    }
    // NUMBER, or NUMBER;CLUSTER.
    let text = String::from_utf8_lossy(&output.stdout);
    Ok(text.trim().split(';').next().unwrap_or_default().to_owned())
}

/// For a shell, one word.
fn shell_quote(word: &str) -> String {
    let plain = |letter: char| letter.is_ascii_alphanumeric() || "-_./=,:%+".contains(letter);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_script_says_what_each_task_runs_and_no_word_of_it_is_taken_apart() {
        let job = SlurmJob {
            dir: "/data/my batch".into(),
            program: "/opt/proact".into(),
            arguments: [
                "simulate",
                "study1",
                "--set",
                "profile.jog={ pace = \"it's\" }",
                "--out",
                "/data/my batch",
            ]
            .map(str::to_owned)
            .to_vec(),
            shards: 12,
            jobs: 4,
            options: vec!["--partition=long".into()],
        };
        let script = job.script();
        for line in [
            "#SBATCH --array=1-12",
            "#SBATCH --cpus-per-task=4",
            "#SBATCH --partition=long",
            "#SBATCH --output='/data/my batch/slurm/shard-%a.log'",
            "exec /opt/proact simulate study1 --set 'profile.jog={ pace = \"it'\\''s\" }' --out '/data/my batch' --jobs 4 --shard \
             \"$SLURM_ARRAY_TASK_ID/12\"",
        ] {
            assert!(script.lines().any(|other| other == line), "{line}\n{script}");
        }
        assert!(script.contains("no evidence about people"));
    }
}
