//! What the pages of a study show, and what they may ask for. All that there is to show comes with each message, so that a page
//! that reloads loses nothing; what was answered or asked counts once it comes back.

use proact_study::{Deviation, Form, FormAnswer, ReadinessCheck, StepOutcome};
use proact_types::Gesture;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What a study shows to either side.
#[derive(Clone, Debug, PartialEq)]
pub struct StudyScreen {
    /// To whoever conducts it.
    pub experimenter: ExperimenterScreen,
    /// To whoever takes part.
    pub participant: ParticipantScreen,
}

/// What a participant sees of a study: what is to be done now, and nothing else.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(tag = "show", rename_all = "snake_case")]
pub enum ParticipantScreen {
    /// Nothing is to be done yet.
    Wait,
    /// The experimenter speaks.
    Listen,
    /// A questionnaire.
    Form(FormScreen),
    /// A break.
    Rest {
        /// Until its planned end, seconds; zero from then on.
        #[serde(rename = "left_secs")]
        remaining_secs: f64,
    },
    /// Gestures are made as prompted.
    Train(PromptScreen),
    /// The arm is driven, or shown: the scene.
    Scene {
        /// The time that is left is shown.
        countdown: bool,
        /// Above the scene; empty in a trial.
        title: String,
    },
    /// The session is over.
    Thanks,
}

/// A questionnaire that is being answered.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct FormScreen {
    /// Which step of the session it is: answers name it.
    pub step: usize,
    /// What it asks.
    pub form: Form,
    /// Pairs of items between which is chosen, with the key of the choice.
    pub pairs: Vec<FormPair>,
    /// The conditions that it may ask about, as people know them.
    pub conditions: Vec<String>,
    /// What it is about; none if about the whole session.
    pub about: Option<String>,
    /// Answers that are kept, by key.
    pub answers: BTreeMap<String, FormAnswer>,
    /// Keys that have no answer yet and should have one.
    pub missing: Vec<String>,
    /// The last answer that was refused, and why.
    pub refused: Option<RefusedAnswer>,
}

/// A choice between two items of a questionnaire.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct FormPair {
    /// Of the choice.
    pub key: String,
    /// Key of an item.
    pub first: String,
    /// Key of the other one.
    pub second: String,
}

/// An answer that cannot be.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct RefusedAnswer {
    /// Of what.
    pub key: String,
    /// Why.
    pub reason: String,
}

/// A prompt to make a gesture.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct PromptScreen {
    /// What to make now.
    pub gesture: Gesture,
    /// What to do, in a few words.
    pub text: String,
    /// Share of the gesture or of the test that is over, 0 to 1.
    #[serde(rename = "share")]
    pub progress: f64,
    /// Muscles are being recorded.
    pub recording: bool,
    /// What is recognised now; none while nothing is.
    #[serde(rename = "recognised")]
    pub recognized: Option<Gesture>,
    /// Sequences in a row without a mistake.
    #[serde(rename = "in_a_row")]
    pub consecutive_sequences: usize,
    /// How many of them pass; none if the experimenter judges.
    #[serde(rename = "wanted")]
    pub required_sequences: Option<usize>,
    /// It is passed.
    pub passed: bool,
    /// The page's own keys make the gestures, and no armband does.
    #[serde(rename = "keys")]
    pub uses_keyboard: bool,
}

/// What whoever conducts a study sees.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct ExperimenterScreen {
    /// Its name.
    pub study: String,
    /// For people.
    pub title: String,
    /// Trials that are over, and all of the plan.
    pub trials: [usize; 2],
    /// Who takes part.
    pub participants: Vec<ParticipantRow>,
    /// Whose turn it is; none while a session is under way, and when all are over.
    pub next: Option<NextSession>,
    /// The session under way.
    pub session: Option<SessionScreen>,
    /// What may be asked for now.
    #[serde(rename = "can")]
    pub available_buttons: Vec<StudyButton>,
    /// What came of the last request, or what was found; empty if there is nothing to say.
    pub notice: String,
    /// Notes of the session, oldest first.
    pub notes: Vec<String>,
}

/// A place in the plan.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct ParticipantRow {
    /// From 1.
    pub participant: usize,
    /// Pseudonym; none for a place that nobody has.
    pub id: Option<String>,
    /// Steps that are over, and all, over all sessions.
    pub steps: [usize; 2],
    /// Trials that are over, and all.
    pub trials: [usize; 2],
}

/// Whose turn it is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct NextSession {
    /// Place in the plan.
    pub participant: usize,
    /// Pseudonym, if somebody has the place.
    pub id: Option<String>,
    /// Name of the session.
    pub session: String,
    /// It was begun before.
    pub begun: bool,
    /// What departs from the plan if it goes on today; empty if nothing does.
    #[serde(rename = "departs")]
    pub plan_deviation: String,
}

/// A session under way.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct SessionScreen {
    /// Place in the plan.
    pub participant: usize,
    /// Pseudonym.
    pub id: String,
    /// Its name.
    pub session: String,
    /// What happens in it.
    pub steps: Vec<StepRow>,
    /// What happens now; none if all of it is over.
    #[serde(rename = "now")]
    pub current_step: Option<CurrentStepScreen>,
    /// What is left of it takes at most so long by the plan, minutes.
    #[serde(rename = "minutes_left")]
    pub remaining_minutes: f64,
}

/// A step of a session.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct StepRow {
    /// From 1.
    pub step: usize,
    /// In a few words.
    pub label: String,
    /// The condition that it belongs to.
    pub condition: Option<String>,
    /// How it ended; none while it is to be done.
    pub outcome: Option<StepOutcome>,
    /// How often it was begun.
    pub attempts: usize,
    /// What departs from the plan.
    pub deviations: Vec<Deviation>,
}

/// The step that is to be done, or is being done.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct CurrentStepScreen {
    /// Which.
    pub step: usize,
    /// In a few words.
    pub label: String,
    /// It was begun, and goes on.
    pub running: bool,
    /// Since it was begun, seconds.
    #[serde(rename = "since_secs")]
    pub elapsed_secs: f64,
    /// What it is.
    #[serde(rename = "what")]
    pub activity: StepActivity,
}

/// What happens in a session now.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(tag = "is", rename_all = "snake_case")]
pub enum StepActivity {
    /// Words to say.
    Say {
        /// The words.
        text: String,
    },
    /// A questionnaire; it can be filled in here as well.
    Form(FormScreen),
    /// Gestures are trained.
    Train(PromptScreen),
    /// The gaze is calibrated on the participant's page.
    CalibrateGaze {
        /// Mean error of the newest check, degrees; none before the first.
        error_deg: Option<f64>,
    },
    /// A simulated participant shows the method.
    Demonstrate {},
    /// The participant tries the method.
    #[serde(rename = "practise")]
    Practice {
        /// Objects that were carried.
        #[serde(rename = "carried")]
        transferred: usize,
        /// How many were planned.
        #[serde(rename = "transfers")]
        planned_transfers: usize,
    },
    /// A break.
    Rest {
        /// Until its planned end, seconds; zero from then on.
        #[serde(rename = "left_secs")]
        remaining_secs: f64,
    },
    /// A trial.
    Trial {
        /// What is ready, and what is not.
        checks: Vec<ReadinessCheck>,
        /// Number among the session's trials, and how many there are.
        number: [usize; 2],
        /// How the trial before went; empty before the first.
        #[serde(rename = "before")]
        previous_result: String,
    },
}

/// What can be asked for, as buttons of the experimenter's page are told.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(rename_all = "snake_case")]
pub enum StudyButton {
    /// A session begins.
    Begin,
    /// The step is done, or begins.
    Next,
    /// The trial begins although something is not ready.
    StartAnyway,
    /// The step is left out.
    Skip,
    /// The last trial is done again.
    Redo,
    /// The trial stands still, or goes on.
    Pause,
    /// The trial ends here.
    Abort,
    /// The gestures are trained again.
    Retrain,
    /// The gaze is calibrated again.
    Recalibrate,
    /// The session goes on another time.
    Leave,
}

/// What whoever conducts a study asks for.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(tag = "ask", rename_all = "snake_case", deny_unknown_fields)]
pub enum StudyRequest {
    /// A session begins, or goes on.
    Begin {
        /// The participant; whose turn it is if left out.
        #[serde(default)]
        #[cfg_attr(feature = "ts", ts(optional))]
        id: Option<String>,
        /// Somebody new.
        #[serde(default)]
        #[cfg_attr(feature = "ts", ts(as = "Option<bool>", optional))]
        new: bool,
    },
    /// The step is done, or the trial begins.
    Next {},
    /// The trial begins although something is not ready.
    StartAnyway {
        /// Why.
        reason: String,
    },
    /// The step is left out.
    Skip {
        /// Why.
        reason: String,
    },
    /// The last trial is done again.
    Redo {
        /// Why.
        reason: String,
    },
    /// The gestures are trained again, now.
    Retrain {
        /// Why.
        reason: String,
    },
    /// The gaze is calibrated again, now.
    Recalibrate {
        /// Why.
        reason: String,
    },
    /// Something to remember.
    Note {
        /// The words.
        text: String,
    },
    /// The session goes on another time.
    Leave {},
}

/// An answer to a question of the questionnaire at `step`; none takes it back.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(deny_unknown_fields)]
pub struct AnswerInput {
    /// The step of the session.
    pub step: usize,
    /// Key of the item, or of the choice between two.
    pub key: String,
    /// What was answered.
    pub answer: Option<FormAnswer>,
}
