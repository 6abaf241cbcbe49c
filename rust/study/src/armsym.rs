//! Plans from the conditions of ArmSym, whose experiments are JSON files.
//!
//! A file is what its folder `Experimental_conditions` holds, or the `identifier.json` of a subject, which has the same and the
//! person besides. Fields and their meaning are those of MPI-IS/ArmSym, tutorial 4 and `armsym_configurationscene.cs`.

use crate::{SHIPPED_PLANS, StudyPlan, StudyPlanError, TrialOptions};
use serde::Deserialize;
use std::fmt::Write;

/// Pauses of ArmSym last so long, minutes (its pause scene: 120 s).
const PAUSE_MINUTES: u32 = 2;
/// People in a plan that begins so; to be changed in it.
const PARTICIPANTS: usize = 6;
/// A condition of ArmSym.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArmSymCondition {
    /// As its experimenter sees it; a subject's file has none.
    #[serde(rename = "Display_name", default)]
    pub display_name: Option<String>,
    /// How the arm is commanded: 0 by the trackpad, joint by joint; 1 by the hand, which it imitates; 2 by an order where to go.
    #[serde(rename = "controlmode")]
    pub control_mode: i64,
    /// The trials, from 1, after which the survey is shown.
    #[serde(rename = "trialswithquestionnaire")]
    pub questionnaires: Vec<usize>,
    /// The trials, from 1, after which there is a pause.
    #[serde(rename = "trialswithpause")]
    pub pauses: Vec<usize>,
    /// How many trials count. One for practice comes before them.
    #[serde(rename = "numberoftrials")]
    pub trials: usize,
    /// Length of a trial, s.
    #[serde(rename = "triallength")]
    pub length_secs: u32,
    /// A subject's file: the pseudonym. Plans name nobody.
    #[serde(default)]
    identifier: Option<String>,
    /// A subject's file: length of the arm, m.
    #[serde(default)]
    #[serde(rename = "armlength")]
    pub arm_length_m: Option<f64>,
    /// A subject's file. Plans name nobody.
    #[serde(default)]
    gender: Option<String>,
    /// A subject's file, in years. Plans name nobody.
    #[serde(default)]
    age: Option<i64>,
    /// A subject's file: 0 for a human arm's look, 1 for the robot's.
    #[serde(default)]
    skin_idx: Option<i64>,
}

impl ArmSymCondition {
    /// Reads a file of ArmSym.
    ///
    /// # Errors
    /// [`StudyPlanError::Json`] for what is no JSON, lacks a field or has one of another kind; [`StudyPlanError::Value`] for a control mode or
    /// a trial that there is not.
    pub fn from_json(text: &str) -> Result<ArmSymCondition, StudyPlanError> {
        let unreadable = |error: serde_json::Error| StudyPlanError::Json(error.to_string());
        // A list of values in the fields' order is none of ArmSym's files.
        let object: serde_json::Map<String, serde_json::Value> =
            serde_json::from_str(text).map_err(unreadable)?;
        let condition: ArmSymCondition =
            serde_json::from_value(serde_json::Value::Object(object)).map_err(unreadable)?;
        condition.method()?;
        condition.check_trials()?;
        Ok(condition)
    }

    /// Our method and what it is called in the plan.
    fn method(&self) -> Result<(&'static str, &'static str), StudyPlanError> {
        match self.control_mode {
            0 => Ok(("joints", "A")),
            1 => Ok(("imitate", "imitate")),
            2 => Ok(("go_to", "C")),
            _ => Err(StudyPlanError::value(
                "controlmode",
                self.control_mode,
                "0, 1 or 2: others are a lab's own there; put one of these and change the method in the plan \
                 (one float of the lab streaming layer is docs/methods/lsl_float.toml)",
            )),
        }
    }

    fn check_trials(&self) -> Result<(), StudyPlanError> {
        if self.trials == 0 {
            return Err(StudyPlanError::value("numberoftrials", 0, "at least 1"));
        }
        if self.length_secs == 0 {
            return Err(StudyPlanError::value("triallength", 0, "seconds, at least 1"));
        }
        for (key, trials) in
            [("trialswithquestionnaire", &self.questionnaires), ("trialswithpause", &self.pauses)]
        {
            if let Some(trial) = trials.iter().find(|trial| !(1..=self.trials).contains(*trial)) {
                let expected = format!("1 to {}, the trials that numberoftrials says", self.trials);
                return Err(StudyPlanError::value(key, trial, expected));
            }
        }
        Ok(())
    }

    /// What a plan does not take over, in sentences.
    pub fn ignored_fields(&self) -> Vec<String> {
        let mut left = Vec::new();
        if self.identifier.is_some() || self.gender.is_some() || self.age.is_some() {
            left.push(
                "identifier, gender and age are left out: people are enrolled when they come (study run)"
                    .to_owned(),
            );
        }
        if let Some(length) = self.arm_length_m {
            left.push(format!(
                "armlength {length} m is left out: proact model size makes an arm for a person, [trial] arm names it"
            ));
        }
        if self.skin_idx.is_some() {
            left.push("skin_idx is left out: the arm looks as its own meshes do".to_owned());
        }
        if self.pauses.contains(&self.trials) {
            left.push(format!("the pause after trial {} is left out: no trial follows", self.trials));
        }
        left
    }

    /// Whether both have the same trials with the same questions and pauses.
    fn has_same_protocol(&self, other: &ArmSymCondition) -> bool {
        (self.trials, &self.questionnaires, &self.pauses)
            == (other.trials, &other.questionnaires, &other.pauses)
    }
}

/// The text of a plan called `name` with these conditions, a session for each.
///
/// # Errors
/// No condition, conditions that differ in their trials, questions or pauses, two of the same control mode and length, and what
/// [`StudyPlan::from_text`] refuses.
pub fn plan_from_armsym(name: &str, conditions: &[ArmSymCondition]) -> Result<String, StudyPlanError> {
    let Some(first) = conditions.first() else {
        return Err(StudyPlanError::value("the number of conditions", 0, "at least 1"));
    };
    if let Some(other) = conditions.iter().position(|condition| !condition.has_same_protocol(first)) {
        return Err(StudyPlanError::value(
            format!("condition {} of the files", other + 1),
            "with other trials, questionnaires or pauses than the first",
            "the same: make a study of each file",
        ));
    }
    let mut text = String::from(
        "# From conditions of ArmSym. The task is that of the plan armsym, in whose file the choice is explained; people,\n\
         # seed and order are not in those conditions: change them here.\n",
    );
    let _ = writeln!(text, "name = {}", toml_string(name));
    let _ = writeln!(text, "title = {}", toml_string(&title(conditions)));
    let _ = writeln!(text, "participants = {PARTICIPANTS}\nseed = 1\n\n[trial]\n{}", trial_text()?);
    for condition in conditions {
        text.push_str(&condition_text(condition, conditions)?);
    }
    text.push_str("[order]\nby = \"williams\"\n\n");
    for position in 1..=conditions.len() {
        text.push_str(&session_text(first, position));
    }
    text.push_str(
        "[texts]\nwelcome = \"\"\"\nThank you for coming. You move cubes over a wall with a robot arm at your shoulder. You may \
         stop at any time, without a\nreason.\n\"\"\"\n",
    );
    StudyPlan::from_text(&text)?;
    Ok(text)
}

/// What all trials have in common: as in the plan `armsym`, whose file explains the choice of the task.
fn trial_text() -> Result<String, StudyPlanError> {
    let like = SHIPPED_PLANS.iter().find(|(name, _)| *name == "armsym").map_or("", |(_, text)| text);
    let trial = TrialOptions { limit_secs: None, ..StudyPlan::from_text(like)?.trial };
    toml::to_string(&trial).map_err(|error| StudyPlanError::Text(error.to_string()))
}

/// A string of TOML.
fn toml_string(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

fn title(conditions: &[ArmSymCondition]) -> String {
    let names = conditions.iter().filter_map(|condition| condition.display_name.as_deref());
    let names: Vec<&str> = names.map(str::trim).filter(|name| !name.is_empty()).collect();
    names.join(", ")
}

fn condition_text(condition: &ArmSymCondition, all: &[ArmSymCondition]) -> Result<String, StudyPlanError> {
    let (mut name, method) = (condition.method()?.0.to_owned(), condition.method()?.1);
    // The same command with trials of other lengths is two conditions.
    if all.iter().filter(|other| other.control_mode == condition.control_mode).count() > 1 {
        let _ = write!(name, "_{}s", condition.length_secs);
    }
    Ok(format!(
        "[[conditions]]\nname = {}\ntrial = {{ method = \"{method}\", limit_secs = {} }}\n\n",
        toml_string(&name),
        condition.length_secs
    ))
}

/// One visit, with the condition at `position` of a participant's order.
fn session_text(condition: &ArmSymCondition, position: usize) -> String {
    let mut text = format!("[[sessions]]\nname = \"{position}\"\n");
    if position > 1 {
        text.push_str("days_after = [1, 7]\n");
    }
    let _ = writeln!(text, "condition_positions = [{position}]\ntrials = {}", condition.trials);
    text.push_str(
        "begin = [\n  { do = \"say\", text = \"welcome\", minutes = 3 },\n  \
         { do = \"train\", repetitions = 3, hold_secs = 3, minutes = 10 },\n]\n\
         before_condition = [{ do = \"demonstrate\", minutes = 2 }, { do = \"practise\", transfers = 1, minutes = 2 }]\n",
    );
    if !condition.questionnaires.is_empty() {
        let _ = writeln!(
            text,
            "inter_trial_steps = [{{ after_trials = {:?}, steps = [{{ do = \"form\", form = \"embodiment\", minutes = 1 }}] }}]",
            condition.questionnaires
        );
    }
    let pauses = condition.pauses.iter().filter(|trial| **trial < condition.trials);
    let rests: Vec<String> =
        pauses.map(|trial| format!("{{ after_trial = {trial}, minutes = {PAUSE_MINUTES} }}")).collect();
    if !rests.is_empty() {
        let _ = writeln!(text, "breaks = [{}]", rests.join(", "));
    }
    text.push('\n');
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ProtocolStep;

    /// A file as the documentation of ArmSym describes it.
    const IMITATE: &str = r#"{"Display_name":"Imitate \"the hand\"","controlmode":1,"trialswithquestionnaire":[2,6],
        "trialswithpause":[4,7],"numberoftrials":7,"triallength":45}"#;

    fn with(changes: &[(&str, serde_json::Value)]) -> String {
        let mut value: serde_json::Value = serde_json::from_str(IMITATE).unwrap();
        for (key, to) in changes {
            value[*key] = to.clone();
        }
        value.to_string()
    }

    #[test]
    fn a_condition_becomes_trials_questions_and_pauses_of_a_plan() {
        let condition = ArmSymCondition::from_json(IMITATE).unwrap();
        let left = condition.ignored_fields();
        assert!(left.len() == 1 && left[0].contains("pause after trial 7"), "{left:?}");
        let plan = StudyPlan::from_text(&plan_from_armsym("mine", &[condition]).unwrap()).unwrap();
        assert_eq!((plan.name.as_str(), plan.title.as_str()), ("mine", "Imitate \"the hand\""));
        let choice = plan.trial_options(0);
        assert_eq!((choice.method.as_deref(), choice.limit_secs), (Some("imitate"), Some(45.0)));
        let session = &plan.sessions[0];
        assert_eq!(
            (session.trials, session.inter_trial_steps[0].after_trials.as_slice()),
            (7, [2, 6].as_slice())
        );
        let rests: Vec<_> = session.breaks.iter().map(|rest| (rest.after_trial, rest.minutes)).collect();
        assert_eq!(rests, [(4, 2.0)]);
        // ArmSym's trial 0 is for practice.
        assert!(session.before_condition.iter().any(|step| matches!(step, ProtocolStep::Practice { .. })));
    }

    #[test]
    fn several_conditions_are_compared_each_on_a_day_of_its_own() {
        let of = |mode: i64, secs: u32| {
            let text = with(&[("controlmode", mode.into()), ("triallength", secs.into())]);
            ArmSymCondition::from_json(&text).unwrap()
        };
        let text = plan_from_armsym("mine", &[of(0, 60), of(2, 60), of(2, 30)]).unwrap();
        let plan = StudyPlan::from_text(&text).unwrap();
        let names: Vec<_> = plan.conditions.iter().map(|condition| condition.name.as_str()).collect();
        assert_eq!(names, ["joints", "go_to_60s", "go_to_30s"]);
        let methods: Vec<_> = (0..3).filter_map(|k| plan.trial_options(k).method).collect();
        assert_eq!(methods, ["A", "C", "C"]);
        assert_eq!(plan.sessions.len(), 3);
        assert_eq!(plan.schedule(&[]).unwrap().trials().count(), PARTICIPANTS * 3 * 7);
        let twice = plan_from_armsym("mine", &[of(2, 60), of(2, 60)]).unwrap_err();
        assert!(matches!(twice, StudyPlanError::Duplicate { .. }), "{twice}");
    }

    #[test]
    fn a_subjects_file_is_read_and_what_is_the_persons_is_left_out() {
        let text = with(&[
            ("identifier", "S1".into()),
            ("armlength", 0.7.into()),
            ("gender", "F".into()),
            ("age", 30.into()),
            ("skin_idx", 1.into()),
        ]);
        let condition = ArmSymCondition::from_json(&text).unwrap();
        let left = condition.ignored_fields().join("; ");
        assert!(left.contains("identifier") && left.contains("0.7 m") && left.contains("skin_idx"), "{left}");
        assert!(!plan_from_armsym("mine", &[condition]).unwrap().contains("S1"));
    }

    #[test]
    fn what_is_no_condition_is_refused_with_what_was_expected() {
        for (text, parts) in [
            ("{".to_owned(), ["condition is unreadable", "EOF"]),
            ("[]".to_owned(), ["condition is unreadable", "expected a map"]),
            (IMITATE.replace("\"triallength\":45", "\"length\":45"), ["unknown field", "`length`"]),
            (IMITATE.replace(",\"triallength\":45", ""), ["missing field", "`triallength`"]),
            (with(&[("triallength", "45".into())]), ["invalid type", "u32"]),
            (with(&[("triallength", 0.into())]), ["triallength is 0", "at least 1"]),
            (with(&[("numberoftrials", 0.into())]), ["numberoftrials is 0", "at least 1"]),
            (with(&[("controlmode", 3.into())]), ["controlmode is 3", "lsl_float.toml"]),
            (with(&[("trialswithpause", vec![0].into())]), ["trialswithpause is 0", "1 to 7"]),
            (
                with(&[("trialswithquestionnaire", vec![8].into())]),
                ["trialswithquestionnaire is 8", "1 to 7"],
            ),
        ] {
            let error = ArmSymCondition::from_json(&text).unwrap_err().to_string();
            assert!(parts.iter().all(|part| error.contains(part)), "{text}: {error}");
        }
        let one = ArmSymCondition::from_json(IMITATE).unwrap();
        let other = ArmSymCondition::from_json(&with(&[("numberoftrials", 9.into())])).unwrap();
        let error = plan_from_armsym("mine", &[one.clone(), other]).unwrap_err().to_string();
        assert!(error.contains("condition 2") && error.contains("a study of each"), "{error}");
        let error = plan_from_armsym("my plan", &[one]).unwrap_err().to_string();
        assert!(error.contains("name is \"my plan\""), "{error}");
        assert!(plan_from_armsym("mine", &[]).is_err());
    }
}
