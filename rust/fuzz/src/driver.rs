//! Hands inputs to a child, and finds out why it ended.

use crate::{Args, child::DONE_LINE, mutate::Mutator, targets::FuzzTarget};
use std::{
    collections::BTreeSet,
    error::Error,
    fs::{self, File},
    io::{BufRead, BufReader, Read, Write},
    path::{Path, PathBuf},
    process::{Child, ChildStdin, Command, Stdio},
    sync::mpsc::{Receiver, RecvTimeoutError, channel},
    thread,
    time::{Duration, Instant},
};

/// A child that cannot begin within this time has a fault of its own.
const START_TIMEOUT: Duration = Duration::from_secs(120);
/// A machine under load may take so many times as long as the processor.
const MAX_LOAD_FACTOR: u32 = 10;
/// After so many different findings a target has enough of them.
const MAX_FINDINGS: usize = 10;
/// So much of what a child said is looked at, bytes.
const MAX_STDERR_BYTES: u64 = 1 << 20;
/// Clock ticks of `/proc/PID/stat` in a second, on every Linux.
const TICKS_PER_SECOND: f64 = 100.0;

/// Runs all targets; how many findings there were.
pub(crate) fn run(targets: &[&'static FuzzTarget], args: &Args) -> Result<usize, Box<dyn Error>> {
    let mut found = 0;
    for target in targets {
        found += run_target(target, args)?;
    }
    let findings = if found == 1 { "1 finding".to_owned() } else { format!("{found} findings") };
    println!("{} targets, {findings}", targets.len());
    Ok(found)
}

fn run_target(target: &'static FuzzTarget, args: &Args) -> Result<usize, Box<dyn Error>> {
    let began = Instant::now();
    let mut fuzz_run =
        FuzzRun { target, out: &args.out, child: None, inputs: 0, finding_kinds: BTreeSet::new() };
    if !args.input.is_empty() {
        for path in &args.input {
            let bytes = fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
            fuzz_run.run_input(&bytes, Some(path))?;
        }
        return Ok(fuzz_run.print_report(began, &[]));
    }
    let corpus = read_corpus(&args.corpus.join(target.name))?;
    let temp_dir = tempfile::tempdir()?;
    let seeds = (target.seed_inputs)(temp_dir.path());
    if corpus.is_empty() && seeds.is_empty() && !target.is_planted {
        return Err(format!(
            "{} holds no input for {}; name another folder with --corpus",
            args.corpus.display(),
            target.name
        )
        .into());
    }
    for (path, bytes) in &corpus {
        fuzz_run.run_input(bytes, Some(path))?;
    }
    for bytes in &seeds {
        fuzz_run.run_input(bytes, None)?;
    }
    let end = Instant::now() + Duration::from_secs_f64(args.seconds);
    let mut mutator =
        Mutator::new(corpus.iter().map(|(_, bytes)| bytes.clone()).chain(seeds).collect(), args.seed);
    let before = fuzz_run.inputs;
    let goes_on = |inputs: u64| match args.inputs {
        Some(count) => inputs - before < count,
        None => Instant::now() < end,
    };
    while goes_on(fuzz_run.inputs) && fuzz_run.finding_kinds.len() < MAX_FINDINGS {
        let mut input = mutator.next_input();
        (target.repair_checksums)(&mut input);
        fuzz_run.run_input(&input, None)?;
    }
    Ok(fuzz_run.print_report(began, &corpus))
}

/// A file and what is in it.
type CorpusFile = (PathBuf, Vec<u8>);

/// The inputs in a folder, by name; none if it is not there.
fn read_corpus(folder: &Path) -> Result<Vec<CorpusFile>, Box<dyn Error>> {
    let Ok(entries) = fs::read_dir(folder) else { return Ok(Vec::new()) };
    let mut paths: Vec<PathBuf> =
        entries.map(|entry| Ok(entry?.path())).collect::<Result<_, std::io::Error>>()?;
    paths.sort();
    paths.into_iter().map(|path| Ok((path.clone(), fs::read(path)?))).collect()
}

/// A target on its way through its inputs.
struct FuzzRun<'a> {
    target: &'static FuzzTarget,
    out: &'a Path,
    child: Option<FuzzChild>,
    inputs: u64,
    /// What was found already; the same again is not told again.
    finding_kinds: BTreeSet<String>,
}

impl FuzzRun<'_> {
    /// Hands one input over; `path` if it is a file already.
    fn run_input(&mut self, bytes: &[u8], path: Option<&Path>) -> Result<(), Box<dyn Error>> {
        self.inputs += 1;
        let mut child = match self.child.take() {
            Some(child) => child,
            None => FuzzChild::start(self.target)?,
        };
        let Some(end) = child.run(bytes, Duration::from_secs_f64(self.target.limit_secs)) else {
            self.child = Some(child);
            return Ok(());
        };
        if !self.finding_kinds.insert(end.kind.clone()) {
            return Ok(());
        }
        let path = match path {
            Some(path) => path.to_owned(),
            None => {
                fs::create_dir_all(self.out)?;
                let hash = blake3::hash(bytes).to_hex();
                let path = self.out.join(format!("{}-{}", self.target.name, &hash[..12]));
                fs::write(&path, bytes)?;
                path
            }
        };
        println!(
            "FOUND {}: {}\n  input: {} ({} bytes)\n  again: proact-fuzz {} --input {}",
            self.target.name,
            end.kind,
            path.display(),
            bytes.len(),
            self.target.name,
            path.display()
        );
        for line in end.text.lines().take(12) {
            println!("  | {}", line.chars().take(200).collect::<String>());
        }
        Ok(())
    }

    fn print_report(&self, began: Instant, corpus: &[CorpusFile]) -> usize {
        println!(
            "{:<18} {:>4} files, {:>8} inputs, {:>6.1} s, {} found",
            self.target.name,
            corpus.len(),
            self.inputs,
            began.elapsed().as_secs_f64(),
            self.finding_kinds.len()
        );
        self.finding_kinds.len()
    }
}

/// Why a child ended: one line that tells kinds of findings apart, and what it said last.
struct ChildFailure {
    kind: String,
    text: String,
}

/// A child that waits for an input.
struct FuzzChild {
    child: Child,
    input: ChildStdin,
    done: Receiver<()>,
    stderr_dir: tempfile::TempDir,
}

impl FuzzChild {
    fn start(target: &FuzzTarget) -> Result<FuzzChild, Box<dyn Error>> {
        let stderr_dir = tempfile::tempdir()?;
        let scratch = stderr_dir.path().join("scratch");
        fs::create_dir(&scratch)?;
        let mut child = Command::new(std::env::current_exe()?)
            .args([target.name, "--child"])
            .arg(&scratch)
            .current_dir(&scratch)
            .env("RUST_BACKTRACE", "0")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(File::create(stderr_dir.path().join("said"))?)
            .spawn()?;
        let (tell, done) = channel();
        let (Some(input), Some(output)) = (child.stdin.take(), child.stdout.take()) else {
            return Err("the child has no pipes".into());
        };
        thread::spawn(move || {
            for line in BufReader::new(output).split(b'\n').map_while(Result::ok) {
                // A library may have left half a line before it.
                if line.ends_with(DONE_LINE.as_bytes()) && tell.send(()).is_err() {
                    return;
                }
            }
        });
        let mut running = FuzzChild { child, input, done, stderr_dir };
        match running.wait(START_TIMEOUT) {
            None => Ok(running),
            Some(end) => Err(format!("{} does not begin: {}\n{}", target.name, end.kind, end.text).into()),
        }
    }

    /// Why the child ended on this input; nothing if it goes on.
    fn run(&mut self, bytes: &[u8], limit: Duration) -> Option<ChildFailure> {
        let length = u32::try_from(bytes.len()).unwrap_or(u32::MAX).to_le_bytes();
        // A child that has ended does not listen; why is asked below.
        let _ = self
            .input
            .write_all(&length)
            .and_then(|()| self.input.write_all(bytes))
            .and_then(|()| self.input.flush());
        self.wait(limit)
    }

    fn wait(&mut self, limit: Duration) -> Option<ChildFailure> {
        let (began, cpu_before) = (Instant::now(), self.cpu_secs());
        loop {
            match self.done.recv_timeout(limit) {
                Ok(()) => return None,
                Err(RecvTimeoutError::Disconnected) => return Some(self.failure_of_child()),
                Err(RecvTimeoutError::Timeout) => {
                    // Where others have the processor the clock tells little.
                    let busy = self.cpu_secs() - cpu_before >= 0.8 * limit.as_secs_f64();
                    if busy || began.elapsed() > limit * MAX_LOAD_FACTOR {
                        let _ = self.child.kill();
                        let _ = self.child.wait();
                        let kind = format!("no end within {} s", limit.as_secs_f64());
                        return Some(ChildFailure { kind, text: self.stderr_text() });
                    }
                }
            }
        }
    }

    /// Seconds of the processor that the child has had.
    fn cpu_secs(&self) -> f64 {
        let stat = fs::read_to_string(format!("/proc/{}/stat", self.child.id())).unwrap_or_default();
        // Behind the name, which may hold anything, the twelfth and thirteenth word.
        let words = stat.rsplit(')').next().unwrap_or_default().split_whitespace();
        words.skip(11).take(2).filter_map(|word| word.parse::<f64>().ok()).sum::<f64>() / TICKS_PER_SECOND
    }

    fn failure_of_child(&mut self) -> ChildFailure {
        let status = self.child.wait().map_or_else(|error| error.to_string(), |status| status.to_string());
        let text = self.stderr_text();
        let telling = [
            "panicked at",
            "stack overflow",
            "memory allocation",
            "terminate called",
            "what():",
            "bad_alloc",
        ];
        let line = text
            .lines()
            .find(|line| telling.iter().any(|word| line.contains(word)))
            .unwrap_or("without a word");
        // Which thread, and how many bytes, differs from input to input.
        let line = line.split("panicked at").last().unwrap_or(line);
        let plain: String = if line.contains("memory allocation") {
            "allocation of more than there is".to_owned()
        } else {
            line.chars().take(160).collect()
        };
        ChildFailure { kind: format!("{status}: {}", plain.trim()), text }
    }

    fn stderr_text(&self) -> String {
        // The line that tells stands in front of a value that may be long.
        let mut bytes = Vec::new();
        let stderr_file = File::open(self.stderr_dir.path().join("said"));
        let _ = stderr_file.and_then(|file| file.take(MAX_STDERR_BYTES).read_to_end(&mut bytes));
        String::from_utf8_lossy(&bytes).into_owned()
    }
}

impl Drop for FuzzChild {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
