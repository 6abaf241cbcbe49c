//! What a participant does or watches with the arm: trials, practice, demonstrations, and the calibration of the gaze.

use super::{
    LiveStudy, StepEnd,
    state::{StudyState, StudyTrialInputs, sanitize_text},
};
use crate::{
    Arm, LiveTrial, LiveTrialEnd, Recorder, Registry, RunOutputs, driven_page_content, page_content,
    run_to_end,
    study::{conductor::Conductor, worker::TrialJob},
    trial::{self, Assembly, TrainedArmband},
};
use proact_bridge::{PageContent, ParticipantScreen, StepActivity, StudyButton, StudyRequest};
use proact_devices::{EmgOrigin, FeedbackSinks};
use proact_study::{PlannedTrial, StepId, TrialOptions};
use proact_testbed::{RunningTrial, TrialConfig, TrialEnd, TrialResult};
use std::{error::Error, time::Instant};

/// Longest time of what has no limit of its own, seconds: the longest that a trial may have.
const MAX_ACTIVITY_SECS: f64 = 3600.0;

/// What is done with the arm beside trials.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ArmActivity {
    /// The gaze is calibrated.
    GazeCalibration,
    /// A simulated participant shows the method.
    Demonstration,
    /// The participant tries the method.
    Practice {
        /// Objects to carry.
        transfers: usize,
    },
}

impl ArmActivity {
    pub(super) fn screen_content(self) -> StepActivity {
        match self {
            ArmActivity::GazeCalibration => StepActivity::CalibrateGaze { error_deg: None },
            ArmActivity::Demonstration => StepActivity::Demonstrate {},
            ArmActivity::Practice { transfers } => {
                StepActivity::Practice { transferred: 0, planned_transfers: transfers }
            }
        }
    }

    fn title(self) -> &'static str {
        match self {
            ArmActivity::GazeCalibration => "Look at each point until it goes",
            ArmActivity::Demonstration => "Demonstration: watch",
            ArmActivity::Practice { .. } => "Practice: this does not count",
        }
    }
}

impl LiveStudy<'_> {
    /// With the settings of the armband that is worn, and the person where the calibration has the shoulder.
    fn config(&self, order: &TrialJob) -> Result<(Arm, TrialConfig), Box<dyn Error>> {
        let emg = self.equipment.armband.as_ref().map(|armband| armband.model().config.clone());
        let (arm, mut config) = order.config(self.registry, emg)?;
        self.equipment.calibrations.place_person(&mut config.setup);
        Ok((arm, config))
    }

    /// Shows the scene of a trial before it begins, so that the experimenter sees where the blocks stand.
    ///
    /// # Errors
    /// As [`LiveStudy::run`].
    pub(super) fn preview_trial(&mut self, trial: &PlannedTrial) -> Result<(), Box<dyn Error>> {
        let (arm, config) = self.config(&self.state.conductor.study.trial_job(trial))?;
        let assembly =
            trial::live_trial_with_armband(&self.registry.methods, &arm, without_emg(config), None)?;
        let mut running_trial = assembly.trial;
        self.state.page.set_content(driven_page_content(running_trial.testbed(), &arm))?;
        self.open_person(&running_trial)?;
        if let Some(frame) = running_trial.step(false)?.frame {
            self.state.page.publish(&frame);
        }
        Ok(())
    }

    /// What the person has connected is opened with the first scene, and goes with each further one.
    fn open_person(&mut self, trial: &RunningTrial) -> Result<(), Box<dyn Error>> {
        match &mut self.equipment.user_devices {
            Some(person) => person.restart(trial),
            None => {
                self.equipment.user_devices = Some((self.equipment.open_user_devices)(trial)?);
                Ok(())
            }
        }
    }

    /// Runs a trial that counts.
    ///
    /// # Errors
    /// As [`LiveStudy::run`].
    pub(super) fn run_trial(
        &mut self,
        step_id: &StepId,
        trial: &PlannedTrial,
    ) -> Result<StepEnd, Box<dyn Error>> {
        let Some(record) = self.state.conductor.begin(step_id)? else { return Ok(StepEnd::Interrupted) };
        let attempt = self.state.conductor.progress().step(step_id).attempts;
        let order = self.state.conductor.study.recorded_trial_job(trial, attempt, &record);
        let countdown = self.countdown(&step_id.session);
        self.mark_running(
            ParticipantScreen::Scene { countdown, title: String::new() },
            &[StudyButton::Pause, StudyButton::Abort],
        );
        let (ended, result, _) = self.drive(&order, false, false)?;
        self.last_trial_summary = outcome(&result);
        Ok(match ended {
            LiveTrialEnd::Finished => StepEnd::Done,
            LiveTrialEnd::Aborted => StepEnd::Aborted,
            LiveTrialEnd::Restart { .. } | LiveTrialEnd::Interrupted => StepEnd::Interrupted,
        })
    }

    fn countdown(&self, session: &str) -> bool {
        let sessions = &self.state.conductor.study.plan.sessions;
        sessions.iter().find(|own| own.name == session).is_some_and(|session| session.countdown)
    }

    /// The step goes on: what the participant sees, and what can be asked for.
    fn mark_running(&mut self, participant: ParticipantScreen, can: &[StudyButton]) {
        if let Some(now) = &mut self.state.current_step {
            (now.running, now.since, now.participant, now.buttons) =
                (true, Instant::now(), participant, can.to_vec());
        }
        self.state.transferred_count = 0;
        self.state.show();
    }

    /// Something with the arm that is no trial, again and again until it is ended.
    ///
    /// # Errors
    /// As [`LiveStudy::run`].
    pub(super) fn run_activity(
        &mut self,
        step_id: &StepId,
        scene: ArmActivity,
        condition: Option<&str>,
    ) -> Result<StepEnd, Box<dyn Error>> {
        let plan = &self.state.conductor.study.plan;
        let condition =
            plan.conditions.iter().position(|own| Some(own.name.as_str()) == condition).unwrap_or(0);
        let mut order = TrialJob {
            // Who conducts it says when it is over.
            options: TrialOptions { limit_secs: Some(MAX_ACTIVITY_SECS), ..plan.trial_options(condition) },
            // Other blocks than those of any trial.
            seed: plan.seed ^ ((step_id.participant as u64) << 40) ^ ((step_id.step as u64) << 20),
            arrangement: None,
            dir: None,
            bag: String::new(),
            study_place: None,
            with_scores: false,
        };
        let participant = ParticipantScreen::Scene { countdown: false, title: scene.title().to_owned() };
        self.mark_running(participant, &[StudyButton::Next, StudyButton::Skip, StudyButton::Leave]);
        // Asked for once: whoever wants another calibration asks for it.
        let mut calibrates = scene == ArmActivity::GazeCalibration;
        loop {
            let (ended, left) = match scene {
                ArmActivity::Demonstration => self.demonstrate(&order)?,
                ArmActivity::GazeCalibration | ArmActivity::Practice { .. } => {
                    let (ended, _, left) = self.drive(&order, true, std::mem::take(&mut calibrates))?;
                    (ended, left)
                }
            };
            match (ended, left) {
                (LiveTrialEnd::Finished | LiveTrialEnd::Restart { .. }, _) => {
                    order.seed = order.seed.wrapping_add(1)
                }
                (LiveTrialEnd::Interrupted, _) => return Ok(StepEnd::Interrupted),
                (LiveTrialEnd::Aborted, Some(StudyRequest::Leave {})) => return Ok(StepEnd::Postponed),
                (LiveTrialEnd::Aborted, Some(StudyRequest::Skip { reason })) => {
                    return Ok(StepEnd::Skipped(sanitize_text(&reason)));
                }
                (LiveTrialEnd::Aborted, _) => return Ok(StepEnd::Done),
            }
        }
    }

    /// The participant drives, until the task or somebody ends it.
    fn drive(
        &mut self,
        order: &TrialJob,
        next_ends: bool,
        calibrates: bool,
    ) -> Result<(LiveTrialEnd, TrialResult, Option<StudyRequest>), Box<dyn Error>> {
        let (arm, config) = self.config(order)?;
        let worn = match &self.equipment.armband {
            Some(armband) => {
                let trained = armband.model();
                let commands = config.command_map(trained.config.rest, &trained.classifier)?;
                Some(TrainedArmband { trained, samples: armband.new_port(commands) })
            }
            None => None,
        };
        let Assembly { trial: running_trial, classifier, plans, .. } =
            trial::live_trial_with_armband(&self.registry.methods, &arm, config, worn)?;
        let config = running_trial.testbed().config().clone();
        let recorder = match &order.dir {
            Some(dir) => {
                let recorder = Recorder::create_in_study(
                    dir,
                    (order.bag.as_str(), order.study_place.clone()),
                    &config,
                    &arm,
                    classifier.as_ref(),
                )?;
                Some(recorder.with_plans(plans)?)
            }
            None => None,
        };
        self.state.page.set_content(driven_page_content(running_trial.testbed(), &arm))?;
        self.open_person(&running_trial)?;
        let (page, interrupted) = (self.state.page, self.state.interrupted);
        let Some(person) = &mut self.equipment.user_devices else {
            return Err("nobody is there to drive".into());
        };
        let rest = self.equipment.armband.as_ref().map(|armband| armband.model().config.rest);
        let rest = Some(rest.unwrap_or_default());
        let mut inputs = StudyTrialInputs {
            state: &mut self.state,
            ends_on_next: next_ends,
            requests_gaze_calibration: calibrates,
            pending_request: None,
            rest_gesture: rest,
        };
        let mut trial = LiveTrial {
            trial: running_trial,
            recorder,
            dir: order.dir.clone(),
            page,
            inputs: &mut inputs,
            devices: person,
            gaze_offset: &mut self.gaze_offset,
            results: None,
            interrupted,
        };
        let (ended, result) = trial.run()?;
        let left = inputs.pending_request.take();
        check_journal(&mut self.state)?;
        Ok((ended, result, left))
    }

    /// A simulated participant drives by the same method, in real time.
    fn demonstrate(
        &mut self,
        order: &TrialJob,
    ) -> Result<(LiveTrialEnd, Option<StudyRequest>), Box<dyn Error>> {
        let (arm, config) = self.config(order)?;
        let Assembly { trial, .. } = trial::simulated_trial_with_model(
            &self.registry.methods,
            &arm,
            without_emg(config),
            &EmgOrigin::Synthetic,
            None,
        )?;
        self.state.page.set_content(page_content(trial.testbed(), &arm))?;
        let (page, interrupted) = (self.state.page, self.state.interrupted);
        let mut inputs = StudyTrialInputs {
            state: &mut self.state,
            ends_on_next: true,
            requests_gaze_calibration: false,
            pending_request: None,
            rest_gesture: None,
        };
        let mut outputs = RunOutputs {
            page: Some(page),
            inputs: Some(&mut inputs),
            rosbridge: None,
            shoulder: None,
            feedback: FeedbackSinks::default(),
            interrupted,
        };
        let result = run_to_end(trial, None, &mut outputs, None, |_, _| {})?;
        let left = inputs.pending_request.take();
        check_journal(&mut self.state)?;
        let ended = match result.ended {
            TrialEnd::Task | TrialEnd::Failed | TrialEnd::Restart => LiveTrialEnd::Finished,
            TrialEnd::Abort => LiveTrialEnd::Aborted,
            TrialEnd::Interrupt => LiveTrialEnd::Interrupted,
        };
        Ok((ended, left))
    }
}

/// What the pages of a study show before its first trial: the scene of the first one that is planned.
///
/// # Errors
/// A plan without trials; a native library that refuses.
pub fn initial_page_content(
    conductor: &Conductor,
    registry: &Registry,
) -> Result<PageContent, Box<dyn Error>> {
    let study = &conductor.study;
    let trial = study.schedule.trials().next().ok_or("the plan has no trial")?;
    let (arm, config) = study.trial_job(trial).config(registry, None)?;
    let assembly = trial::live_trial_with_armband(&registry.methods, &arm, without_emg(config), None)?;
    Ok(driven_page_content(assembly.trial.testbed(), &arm))
}

/// # Errors
/// The journal could not be written to meanwhile.
fn check_journal(state: &mut StudyState<'_>) -> Result<(), Box<dyn Error>> {
    state.journal_error.take().map_or(Ok(()), |error| Err(error.into()))
}

/// A trial whose gestures are not those of the armband.
fn without_emg(mut config: TrialConfig) -> TrialConfig {
    config.emg = None;
    config
}

/// How a trial went, for whoever conducts the study.
fn outcome(result: &TrialResult) -> String {
    let ended = match result.ended {
        TrialEnd::Task => "",
        TrialEnd::Abort => ", ended by the experimenter",
        TrialEnd::Restart | TrialEnd::Interrupt => ", interrupted",
        TrialEnd::Failed => {
            let reason = result.failure().map(|reason| format!(": {reason}"));
            return format!("failed after {:.0} s{}", result.sim_seconds, reason.as_deref().unwrap_or(""));
        }
    };
    format!("{} {} in {:.0} s{ended}", result.score, result.score_name, result.sim_seconds)
}
