//! What leaves a study: tables, and archives.

use crate::progress::progress_bar;
use clap::Args;
use proact_app::{
    print_result, print_result_json, print_status,
    study::{self, ArchiveSummary, ColumnNames, ExportOptions, ExportSummary, FaultyRecordPolicy, Study},
};
use proact_control::MethodRegistry;
use serde_json::json;
use std::{error::Error, path::PathBuf};

/// Arguments of `proact study export`.
#[derive(Debug, Args)]
pub struct StudyExportArgs {
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
    keep_pseudonyms: bool,
    /// Name columns as older exports did; codebook.csv of an export without it has both names
    #[arg(long)]
    legacy_names: bool,
    /// Write the events and joints of each trial as another system does too, into a folder of its name
    #[arg(long, value_name = "SYSTEM", value_parser = ["armsym"])]
    extra_format: Option<String>,
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
    /// Archive also if records are damaged, missing or in the folder of another trial; each is named
    #[arg(long)]
    accept_damaged: bool,
}

pub(super) fn export(
    methods: &MethodRegistry,
    args: &StudyExportArgs,
    json: bool,
) -> Result<(), Box<dyn Error>> {
    let study = Study::open(&args.study, methods)?;
    let options = ExportOptions {
        out: args.out.clone(),
        raw: args.raw,
        keep_pseudonyms: args.keep_pseudonyms,
        column_names: if args.legacy_names { ColumnNames::Legacy } else { ColumnNames::Present },
        armsym: args.extra_format.is_some(),
        methods: methods.clone(),
    };
    let exported = export_with_bar(&study, &options, json)?;
    if json {
        let object = json!({ "folder": exported.folder, "rows": exported.rows, "in_study_file": exported.in_study_file });
        return Ok(print_result_json(&object)?);
    }
    for (name, rows) in &exported.rows {
        print_result(format_args!("{rows:>8} rows  {name}.csv"))?;
    }
    print_result(format_args!("in {}; codebook.csv says what each column is", exported.folder.display()))?;
    if !exported.in_study_file {
        print_result(
            "the study's own file has none of them yet: another program runs the study, or it has not begun",
        )?;
    }
    Ok(())
}

/// Exports a study behind a progress bar, since each trial is computed again.
pub(super) fn export_with_bar(
    study: &Study,
    options: &ExportOptions,
    json: bool,
) -> Result<ExportSummary, Box<dyn Error>> {
    let bar = progress_bar(
        !json,
        study.schedule.trials().count() as u64,
        "{elapsed} {bar:40} {pos} of {len} trials computed again for the tables",
    );
    bar.enable_steady_tick(std::time::Duration::from_millis(500));
    let exported = study::export(study, options, &|done, all| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();
    Ok(exported)
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
    let bar = progress_bar(!json, 1, "{elapsed} {bar:40} {pos} of {len} files");
    let faulty = if args.accept_damaged { FaultyRecordPolicy::Accept } else { FaultyRecordPolicy::Refuse };
    let ArchiveSummary { files, faulty_records } = study::archive(&study, &out, faulty, |done, all| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();
    if json {
        let object = json!({ "archive": out, "files": files, "faulty_records": faulty_records });
        return Ok(print_result_json(&object)?);
    }
    faulty_records.iter().for_each(|fault| print_status(format_args!("damaged record: {fault}")));
    Ok(print_result(format_args!("{}: {files} files, read again and compared", out.display()))?)
}
