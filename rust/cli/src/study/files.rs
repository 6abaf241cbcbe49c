//! What leaves a study: tables, and archives.

use crate::progress::bar;
use clap::Args;
use proact_app::{
    answer, answer_json,
    study::{self, ExportOptions, Study},
};
use proact_control::MethodRegistry;
use serde_json::json;
use std::{error::Error, path::PathBuf};

/// Arguments of `proact study export`.
#[derive(Debug, Args)]
pub struct ExportArgs {
    /// Folder of the study
    #[arg(value_name = "FOLDER")]
    study: PathBuf,
    /// Folder for the tables; by default the study's own folder tables
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Gaze and shoulder sample by sample too, which may tell who somebody is
    #[arg(long)]
    raw: bool,
    /// Keep the pseudonyms under which people were enrolled
    #[arg(long)]
    keep_ids: bool,
    /// Write the events and joints of each trial as another system does too, into a folder of its name
    #[arg(long, value_name = "SYSTEM", value_parser = ["armsym"])]
    like: Option<String>,
}

/// Arguments of `proact study archive`.
#[derive(Debug, Args)]
pub struct ArchiveArgs {
    /// Folder of the study
    #[arg(value_name = "FOLDER")]
    study: PathBuf,
    /// The new file; by default the study's name with .zip, beside its folder
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

pub(super) fn export(methods: &MethodRegistry, args: &ExportArgs, json: bool) -> Result<(), Box<dyn Error>> {
    let study = Study::open(&args.study, methods)?;
    let options = ExportOptions {
        out: args.out.clone(),
        raw: args.raw,
        keep_ids: args.keep_ids,
        armsym: args.like.is_some(),
        methods: methods.clone(),
    };
    let bar = bar(!json, 1, "reading the records {elapsed}");
    bar.enable_steady_tick(std::time::Duration::from_millis(500));
    let exported = study::export(&study, &options)?;
    bar.finish_and_clear();
    if json {
        let object = json!({ "folder": exported.folder, "rows": exported.rows, "in_study_file": exported.in_study_file });
        return Ok(answer_json(&object)?);
    }
    for (name, rows) in &exported.rows {
        answer(format_args!("{rows:>8} rows  {name}.csv"))?;
    }
    answer(format_args!("in {}; codebook.csv says what each column is", exported.folder.display()))?;
    if !exported.in_study_file {
        answer("the study's own file has none of them yet: another program runs the study, or nobody did")?;
    }
    Ok(())
}

pub(super) fn archive(
    methods: &MethodRegistry,
    args: &ArchiveArgs,
    json: bool,
) -> Result<(), Box<dyn Error>> {
    let study = Study::open(&args.study, methods)?;
    let out = args.out.clone().unwrap_or_else(|| {
        // A folder given as `.` has no name of its own.
        let folder = std::fs::canonicalize(&study.folder).unwrap_or_else(|_| study.folder.clone());
        folder.with_file_name(format!("{}.zip", study.plan.name))
    });
    let bar = bar(!json, 1, "{elapsed} {bar:40} {pos} of {len} files");
    let files = study::archive(&study, &out, |done, all| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();
    if json {
        return Ok(answer_json(&json!({ "archive": out, "files": files }))?);
    }
    Ok(answer(format_args!("{}: {files} files, read again and compared", out.display()))?)
}
