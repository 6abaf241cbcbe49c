//! Studies on disk: a folder with a plan, what the plan's names mean, the journal of what happened, and the trials' records.

mod conductor;
mod export;
mod live;
mod power;
mod rehearsal;
mod simulated_participant;
pub(crate) mod tables;
mod worker;

use conductor::study_place;
pub use conductor::{
    Conductor, STUDY_FILE, StudyError, StudyView, TRIALS_FOLDER, check_pseudonym, open_view, record_name,
};
pub use export::{
    ArchiveSummary, ExportOptions, ExportSummary, FaultyRecordPolicy, archive, current_export, export,
};
pub(crate) use export::{codebook_csv, table_csv};
pub use live::{LiveStudy, OpenUserDevices, ScreenObserver, StudyEquipment, initial_page_content};
pub use power::{
    PowerAtSampleSize, PowerOptions, pilot_scores, power_by_size, power_figure, read_expected_effect,
};
pub use proact_analysis::table::ColumnNames;
pub use rehearsal::{RehearsalEvent, RehearsalOptions, rehearse};
pub(crate) use simulated_participant::participant_histories;
pub use simulated_participant::{
    ParticipantHistory, ParticipantKind, participant_overrides, population_overrides,
};
pub use tables::tables;
pub use worker::{
    FinishedTrial, TrialJob, TrialScores, TrialWorker, WorkerError, run_simulated_trial, run_worker,
};

use crate::{
    trial_choice::{TrialContext, trial_config},
    warn_of_renamed_keys,
};
use proact_control::MethodRegistry;
use proact_files::{make_folder, write_atomically};
use proact_study::{
    ArmSymCondition, Form, PlannedStep, ProtocolStep, SHIPPED_FORMS, SHIPPED_PLANS, Schedule, SessionItem,
    StudyPlan, StudyPlanError, TrialOptions, plan_from_armsym,
};
use proact_types::{MAX_TEXT_BYTES, read_text};
use std::{
    collections::BTreeMap,
    error::Error,
    fs, io,
    path::{Path, PathBuf},
};
use worker::DEFAULT_SETUP;

/// The plan's file in a study's folder.
pub const PLAN_FILE: &str = "plan.toml";
/// Where a study's own questionnaires are, in its folder.
const FORMS_FOLDER: &str = "forms";

/// A study in a folder.
#[derive(Clone, Debug)]
pub struct Study {
    /// Its folder.
    pub folder: PathBuf,
    /// The plan, word for word.
    pub plan_text: String,
    /// What is planned.
    pub plan: StudyPlan,
    /// Who does what.
    pub schedule: Schedule,
    /// Names of the arrangements that the task has.
    pub arrangements: Vec<String>,
    /// Questionnaires that the plan asks for, by name.
    pub forms: BTreeMap<String, Form>,
}

impl Study {
    /// Reads a study and resolves every name of its plan: each condition's method, task, arm, profile and values must make a
    /// trial. `path` is the folder or the plan itself.
    ///
    /// # Errors
    /// What cannot be read, what is wrong with the plan, a condition that makes no trial; with the file's name.
    pub fn open(path: &Path, methods: &MethodRegistry) -> Result<Self, Box<dyn Error>> {
        let (folder, file) = if path.is_dir() {
            (path.to_owned(), path.join(PLAN_FILE))
        } else {
            (path.parent().unwrap_or(Path::new(".")).to_owned(), path.to_owned())
        };
        let failed = |error: &dyn std::fmt::Display| format!("{}: {error}", file.display());
        let text =
            fs::File::open(&file).and_then(|open| read_text(open, MAX_TEXT_BYTES)).map_err(|error| {
                match error.kind() {
                    io::ErrorKind::NotFound => {
                        failed(&"there is no such plan; proact study new NAME makes a study")
                    }
                    _ => failed(&error),
                }
            })?;
        Self::of_text(&folder, &file, text, methods, Ok)
    }

    /// The plan at `path`, or the one that ships under this name, for so many people drawn from `seed` instead of its own.
    ///
    /// # Errors
    /// As [`Study::lock`].
    pub fn open_with_participants(
        path: &Path,
        methods: &MethodRegistry,
        people: Option<usize>,
        seed: Option<u64>,
    ) -> Result<Self, Box<dyn Error>> {
        let for_people = |plan: StudyPlan| {
            let (people, seed) = (people.unwrap_or(plan.participants), seed.unwrap_or(plan.seed));
            plan.with_participants(people, seed)
        };
        let shipped = SHIPPED_PLANS.iter().find(|(name, _)| Path::new(name) == path && !path.exists());
        match shipped {
            Some((_, text)) => Self::of_text(Path::new("."), path, (*text).to_owned(), methods, for_people),
            None => {
                let study = Self::open(path, methods)?;
                let file = if path.is_dir() { path.join(PLAN_FILE) } else { path.to_owned() };
                Self::of_text(&study.folder, &file, study.plan_text, methods, for_people)
            }
        }
    }

    fn of_text(
        folder: &Path,
        file: &Path,
        text: String,
        methods: &MethodRegistry,
        change: impl FnOnce(StudyPlan) -> Result<StudyPlan, StudyPlanError>,
    ) -> Result<Self, Box<dyn Error>> {
        let failed = |error: &dyn std::fmt::Display| format!("{}: {error}", file.display());
        if text.trim().is_empty() {
            let what = "the plan is empty, so it was not written to its end, as on a full disk: put a copy of it there, or \
                        remove the folder and make the study again with proact study new";
            return Err(failed(&what).into());
        }
        let mut renamed = Vec::new();
        let plan = StudyPlan::from_text_noting(&text, &mut renamed);
        warn_of_renamed_keys(&renamed);
        let plan = plan.and_then(change).map_err(|error| failed(&error))?;
        let mut arrangements: Option<Vec<String>> = None;
        for (k, condition) in plan.conditions.iter().enumerate() {
            let context = TrialContext {
                methods,
                default_setup: DEFAULT_SETUP,
                seed: plan.seed,
                arrangement: None,
                process: None,
                intent: None,
                emg: None,
            };
            let config = trial_config(&plan.trial_options(k), context)
                .map_err(|error| failed(&format!("condition {}: {error}", condition.name)))?
                .1;
            // Those that each condition's task has.
            let own = config.task.arrangements();
            arrangements = Some(match arrangements {
                Some(others) => others.into_iter().filter(|name| own.contains(name)).collect(),
                None => own,
            });
        }
        let arrangements = arrangements.unwrap_or_default();
        let schedule = plan.schedule(&arrangements).map_err(|error| failed(&error))?;
        let forms = forms(folder, &schedule)?;
        Ok(Self { folder: folder.to_owned(), plan_text: text, plan, schedule, arrangements, forms })
    }
}

impl Study {
    /// Names of what is compared.
    pub fn conditions(&self) -> Vec<String> {
        self.plan.conditions.iter().map(|condition| condition.name.clone()).collect()
    }
}

/// The questionnaires of a schedule: the study's own in its folder, or those that ship with the program.
fn forms(folder: &Path, schedule: &Schedule) -> Result<BTreeMap<String, Form>, Box<dyn Error>> {
    let mut forms = BTreeMap::new();
    let named = schedule.sessions.iter().flat_map(|session| &session.items).filter_map(|item| match item {
        SessionItem::Step(PlannedStep { step: ProtocolStep::Form { form, .. }, .. }) => Some(form),
        _ => None,
    });
    for name in named {
        if forms.contains_key(name) {
            continue;
        }
        let file = folder.join(FORMS_FOLDER).join(format!("{name}.toml"));
        let form = if file.is_file() {
            let failed = |error: &dyn std::fmt::Display| format!("{}: {error}", file.display());
            let text = fs::File::open(&file)
                .and_then(|open| read_text(open, MAX_TEXT_BYTES))
                .map_err(|error| failed(&error))?;
            Form::from_text(&text).map_err(|error| failed(&error))?
        } else {
            Form::shipped(name).ok_or_else(|| {
                let known: Vec<&str> = SHIPPED_FORMS.iter().map(|(name, _)| *name).collect();
                format!(
                    "the plan asks for form {name:?}, but there is no {}; with the program come {}",
                    file.display(),
                    known.join(", ")
                )
            })?
        };
        if form.name != *name {
            return Err(
                format!("{}: the form is called {:?}, expected {name:?}", file.display(), form.name).into()
            );
        }
        forms.insert(name.clone(), form);
    }
    Ok(forms)
}

/// What a trial is that is like `name`: the first condition of the plan that ships under this name, or another one after a
/// colon, as `vie:joints`.
///
/// # Errors
/// A name that no plan has, or no condition of that plan.
pub fn shipped_trial_options(name: &str) -> Result<TrialOptions, Box<dyn Error>> {
    let (name, wanted) = match name.split_once(':') {
        Some((name, condition)) => (name, Some(condition)),
        None => (name, None),
    };
    let plan =
        StudyPlan::from_text(shipped_plan_text(name)?).map_err(|error| format!("plan {name}: {error}"))?;
    let names: Vec<&str> = plan.conditions.iter().map(|condition| condition.name.as_str()).collect();
    let found = wanted.map_or(Some(0), |wanted| names.iter().position(|name| *name == wanted));
    let number = found.ok_or_else(|| {
        let (wanted, known) = (wanted.unwrap_or_default(), names.join(", "));
        format!("plan {name} has no condition {wanted:?}, expected one of {known}")
    })?;
    Ok(plan.trial_options(number))
}

/// The text of the plan that ships as `like`.
fn shipped_plan_text(like: &str) -> Result<&'static str, Box<dyn Error>> {
    let found = SHIPPED_PLANS.iter().find(|(name, _)| *name == like);
    Ok(found.map(|(_, text)| *text).ok_or_else(|| {
        let known: Vec<&str> = SHIPPED_PLANS.iter().map(|(name, _)| *name).collect();
        format!("no plan {like:?} ships with the program, expected one of {}", known.join(", "))
    })?)
}

/// Writes a new study into a folder of its own, like the one that ships as `like`. The study is called as its folder is.
///
/// # Errors
/// A folder that exists, a name that is none for a study, what cannot be written.
pub fn new_study(folder: &Path, like: &str) -> Result<PathBuf, Box<dyn Error>> {
    let text = shipped_plan_text(like)?;
    let text = text.replacen(&format!("name = \"{like}\""), &format!("name = {:?}", study_name(folder)), 1);
    write_new(folder, &text)
}

/// Writes a new study into a folder of its own, with conditions of ArmSym from JSON files. The second is what a plan does not take over.
///
/// # Errors
/// A file that cannot be read or is none of ArmSym's, files that no one plan can have, and as [`new_study`].
pub fn new_study_from_armsym(
    folder: &Path,
    files: &[PathBuf],
) -> Result<(PathBuf, Vec<String>), Box<dyn Error>> {
    let (mut conditions, mut left_out) = (Vec::new(), Vec::new());
    for file in files {
        let failed = |error: &dyn std::fmt::Display| format!("{}: {error}", file.display());
        let text = fs::File::open(file)
            .and_then(|from| read_text(from, MAX_TEXT_BYTES))
            .map_err(|error| failed(&error))?;
        let condition = ArmSymCondition::from_json(&text).map_err(|error| failed(&error))?;
        left_out.extend(condition.ignored_fields().iter().map(|sentence| failed(sentence)));
        conditions.push(condition);
    }
    let text = plan_from_armsym(study_name(folder), &conditions)
        .map_err(|error| format!("{}: {error}", folder.display()))?;
    Ok((write_new(folder, &text)?, left_out))
}

/// What a study in `folder` is called.
fn study_name(folder: &Path) -> &str {
    folder.file_name().and_then(|name| name.to_str()).unwrap_or_default()
}

/// Makes `folder` and writes a plan into it.
fn write_new(folder: &Path, text: &str) -> Result<PathBuf, Box<dyn Error>> {
    StudyPlan::from_text(text).map_err(|error| format!("{}: {error}", folder.display()))?;
    let existed = fs::symlink_metadata(folder).is_ok();
    // An empty folder may be what a killed program left.
    if existed && !fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_none()) {
        return Err(format!("{} exists already; a study has a folder of its own", folder.display()).into());
    }
    make_folder(folder)?;
    let file = folder.join(PLAN_FILE);
    write_atomically(&file, text).inspect_err(|_| {
        // The error of the file is the one to report.
        if !existed {
            let _ = fs::remove_dir(folder);
        }
    })?;
    Ok(file)
}
