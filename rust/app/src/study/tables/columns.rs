//! What the columns of the tables are: the codebook.

use proact_analysis::table::TableColumn;

const fn column(
    name: &'static str,
    unit: &'static str,
    meaning: &'static str,
    source: &'static str,
) -> TableColumn {
    TableColumn { name, unit, meaning, source, formerly: "" }
}

const PARTICIPANT: TableColumn = column("participant", "", "place in the plan, from 1", "plan");
const ID: TableColumn = column("id", "", "pseudonym", "journal");
const SESSION: TableColumn = column("session", "", "name of the session", "plan");
const CONDITION: TableColumn = column("condition", "", "what is compared", "plan");
const TRIAL: TableColumn =
    column("trial", "", "number among the participant's trials of the condition, from 1", "plan");
const SIMULATED: TableColumn =
    column("simulated", "", "1 if participant and answers are simulated, 0 for a person", "journal");
const DEVIATION_MARKS: TableColumn = column(
    "deviations",
    "",
    "kinds of departure from the plan, with commas between; see deviations",
    "journal",
);

/// Last in each table of what records hold.
pub(crate) const FLAW: TableColumn = column(
    "flaw",
    "",
    "what is wrong with the record, with commas between; empty if nothing is. cut: a bag that breaks off, so that outcomes and score \
     are missing; gap: a bag that lacks messages in between; bag_only: a bag without the record of a trial; foreign: this program cannot compute the record again, its bag is \
     scored; diverged: the trial computed again is not the recorded one, or has another result; interrupted: the trial was broken off, so that \
     outcomes and score are missing",
    "computed from the record",
);

/// The columns that name a trial.
pub(crate) const TRIAL_KEY: [TableColumn; 5] = [PARTICIPANT, ID, SESSION, CONDITION, TRIAL];

/// The columns that name a trial, then the table's own.
macro_rules! of_a_trial {
    ($($own:expr),* $(,)?) => { &[PARTICIPANT, ID, SESSION, CONDITION, TRIAL, $($own),*] };
}

pub(crate) const PARTICIPANTS: &[TableColumn] = &[
    PARTICIPANT,
    ID,
    SIMULATED,
    column("consent_version", "", "text that was agreed to", "questionnaire"),
    column("consent_time", "", "when, RFC 3339, UTC", "questionnaire"),
    column("sessions_over", "", "sessions that are over", "journal"),
    column("sessions_planned", "", "sessions of the plan", "plan"),
    column("trials_over", "", "trials that count or were left out", "journal"),
    column("trials_planned", "", "trials of the plan", "plan"),
    DEVIATION_MARKS,
];

pub(crate) const SESSIONS: &[TableColumn] = &[
    PARTICIPANT,
    ID,
    SESSION,
    column("began", "", "when its first step began, RFC 3339, UTC", "journal"),
    column("ended", "", "when its last step ended; empty until it is over", "journal"),
    column("days", "", "days on which there was something of it, with commas between", "journal"),
    column("steps_over", "", "steps that are over, trials included", "journal"),
    column("steps_planned", "", "steps of the plan", "plan"),
    DEVIATION_MARKS,
];

pub(crate) const TRIALS: &[TableColumn] = of_a_trial![
    column("condition_order", "", "place of the condition in the participant's order, from 1", "plan")
        .formerly("position"),
    column("arrangement", "", "where the objects stood, by the task's name", "plan"),
    column("seed", "", "of every random stream of the trial", "plan"),
    column("method", "", "control method", "record"),
    column("task", "", "the task", "record"),
    column("arm", "", "the arm", "record"),
    column("setup", "", "where person and box were", "record"),
    column("end_reason", "", "what ended it: task, failed, abort, restart or interrupt", "record")
        .formerly("ended"),
    column("attempt", "", "which attempt counts, from 1; all are in attempts", "journal"),
    column(
        "mark",
        "",
        "* where something departed from the plan, or where the record of a trial outside a study has a flaw",
        "journal"
    ),
    DEVIATION_MARKS,
    column("score", "", "what counts in the task; empty if the trial failed or was broken off", "record"),
    column("score_name", "", "what the score is", "record"),
    column("seconds", "s", "length of the trial", "record"),
    column("gesture_source", "", "where the gestures came from", "record"),
    column(
        "unsolved_ticks",
        "",
        "milliseconds in which the physics met the laws of contact inexactly",
        "record"
    ),
    column("record", "", "folder of the record, in the study's folder", "journal"),
    column("digest", "", "digest of the trial: the same for the same inputs", "record"),
    SIMULATED,
    FLAW,
];

pub(crate) const ATTEMPTS: &[TableColumn] = of_a_trial![
    column("attempt", "", "how often the trial was begun, this time included", "journal"),
    column("began", "", "RFC 3339, UTC", "journal"),
    column("ended", "", "RFC 3339, UTC; of an interrupted one, when the next run found it", "journal"),
    column("outcome", "", "done, aborted, interrupted or skipped", "journal"),
    column("counts", "", "1 if it is the one in trials", "journal"),
    column("record", "", "folder of the record, in the study's folder", "journal"),
    // Of an attempt that does not count, whose record is not computed again, the journal says whether it was broken off.
    FLAW,
];

pub(crate) const BLOCKS: &[TableColumn] = of_a_trial![
    column("block", "", "the object", "record"),
    column("outcome", "", "what became of it; empty if the trial was broken off", "record"),
    column("pick_s", "s", "from the release of the one before, or the start, to the first contact", "record"),
    column("place_s", "s", "from the last contact to the release", "record"),
    column("error_mm", "mm", "horizontal distance from its target at the end", "record"),
    FLAW,
];

pub(crate) const ACTIONS: &[TableColumn] = of_a_trial![
    column("time_s", "s", "since the trial's start", "record"),
    column("action", "", "what was done", "record"),
    column("object", "", "with which object", "record"),
    column("detail", "", "the gesture, the reason, how it ended", "record"),
    FLAW,
];

pub(crate) const GAZE: &[TableColumn] = of_a_trial![
    column("phase", "", "empty_hand, or holding an object", "record"),
    column("seconds", "s", "length of the phase in this trial, all its parts together", "record"),
    column("samples", "", "samples of the gaze", "record"),
    column("valid_share", "1", "share of samples in which the tracker saw the eye, 0 to 1", "record"),
    column("path_deg", "degree", "angle that the gaze went", "computed from the record"),
    column("fixations", "", "I-VT: slower than 100 degrees/s for at least 80 ms", "computed from the record"),
    column("fixation_ms", "ms", "mean length of a fixation", "computed from the record"),
    FLAW,
];

pub(crate) const COMPENSATION: &[TableColumn] = of_a_trial![
    column(
        "shoulder_path_m",
        "m",
        "length of the shoulder's way; empty if it was not tracked",
        "computed from the record"
    ),
    column("shoulder_displacement_mm", "mm", "furthest from where it was first", "computed from the record")
        .formerly("shoulder_range_mm"),
    column("shoulder_turn_deg", "degree", "furthest turn from how it was first", "computed from the record"),
    column(
        "trunk_displacement_mm",
        "mm",
        "furthest of the trunk's body from where it was first; empty if it was not tracked",
        "computed from trunk.csv beside the record"
    )
    .formerly("trunk_range_mm"),
    column(
        "trunk_turn_deg",
        "degree",
        "furthest turn of the trunk from how it was first; empty if it was not tracked",
        "computed from trunk.csv beside the record"
    ),
    FLAW,
];

pub(crate) const EMG_QUALITY: &[TableColumn] = of_a_trial![
    column("channel", "", "electrode, from 1", "record"),
    column("samples", "", "samples of the armband", "record"),
    column("gaps", "", "gaps in its stream", "computed from the record"),
    column("lost_share", "1", "mean share of samples lost in a second, 0 to 1", "computed from the record"),
    column("sd", "unit of the stream", "mean standard deviation over a second", "computed from the record"),
    column(
        "mains_share",
        "1",
        "mean share of the power at the mains frequency, 0 to 1",
        "computed from the record"
    ),
    column("amber_share", "1", "share of the time with an amber light, 0 to 1", "computed from the record"),
    column("red_share", "1", "share of the time with a red light, 0 to 1", "computed from the record"),
    FLAW,
];

pub(crate) const DEVIATIONS: &[TableColumn] = &[
    PARTICIPANT,
    ID,
    SESSION,
    CONDITION,
    TRIAL,
    column("step", "", "at which step of the session", "journal"),
    column("deviation", "", "which kind", "journal"),
    column("reason", "", "as the experimenter or the program gave it", "journal"),
    column("at", "", "when it was noted, RFC 3339, UTC", "journal"),
];

pub(crate) const READINESS: &[TableColumn] = of_a_trial![
    column("check", "", "what was looked at", "journal"),
    column("ready", "", "1 if it was", "journal"),
    column("found", "", "what was found", "journal"),
    column("age_s", "s", "how old that was", "journal"),
    column("at", "", "RFC 3339, UTC", "journal"),
];

pub(crate) const EVENTS: &[TableColumn] = &[
    column("event", "", "number of the event, from 1 in the order in which they were written", "journal"),
    column("at", "", "when it was written, RFC 3339, UTC; by a clock that can be set", "journal"),
    PARTICIPANT,
    SESSION,
    column("step", "", "what of the session, from 1", "journal"),
    column("kind", "", "what happened", "journal"),
    column("detail", "", "the rest, as JSON", "journal"),
];

const ITEM_KEY: [TableColumn; 5] = [
    PARTICIPANT,
    ID,
    SESSION,
    column("condition", "", "what the questions are about; empty for the whole session", "plan"),
    column("form", "", "name of the questionnaire", "plan"),
];

pub(crate) const ANSWERS: &[TableColumn] = &[
    ITEM_KEY[0],
    ITEM_KEY[1],
    ITEM_KEY[2],
    ITEM_KEY[3],
    ITEM_KEY[4],
    column("item", "", "key of the question", "questionnaire"),
    column(
        "answer",
        "",
        "the answer; several with commas between, shared places with =; empty if there is none",
        "journal",
    ),
    column("at", "", "when it was given, RFC 3339, UTC", "journal"),
    SIMULATED,
];

pub(crate) const SCORES: &[TableColumn] = &[
    ITEM_KEY[0],
    ITEM_KEY[1],
    ITEM_KEY[2],
    ITEM_KEY[3],
    ITEM_KEY[4],
    column("score_name", "", "name of the score", "questionnaire").formerly("score"),
    column("value", "", "the score; empty where too much is missing", "computed from answers"),
    column("missing", "", "questions without an answer, with commas between", "computed from answers"),
    SIMULATED,
];

pub(crate) const RAW_GAZE: &[TableColumn] = of_a_trial![
    column("time_s", "s", "since the trial's start", "record"),
    column("origin_x", "m", "the eye, in world", "record"),
    column("origin_y", "m", "the eye, in world", "record"),
    column("origin_z", "m", "the eye, in world", "record"),
    column("direction_x", "", "where it looks, in world, of any length", "record"),
    column("direction_y", "", "where it looks, in world, of any length", "record"),
    column("direction_z", "", "where it looks, in world, of any length", "record"),
    column("valid", "", "1 if the tracker saw the eye", "record"),
    FLAW,
];

pub(crate) const RAW_SHOULDER: &[TableColumn] = of_a_trial![
    column("time_s", "s", "since the trial's start", "record"),
    column("x", "m", "the shoulder, in world", "record"),
    column("y", "m", "the shoulder, in world", "record"),
    column("z", "m", "the shoulder, in world", "record"),
    column("qx", "", "its attitude, a unit quaternion", "record"),
    column("qy", "", "its attitude, a unit quaternion", "record"),
    column("qz", "", "its attitude, a unit quaternion", "record"),
    column("qw", "", "its attitude, a unit quaternion", "record"),
    FLAW,
];
