//! What a participant does or watches with the arm: trials, practice, demonstrations, and the calibration of the gaze.

use super::{
    LiveStudy, StepEnd,
    state::{SceneInputs, StudyState, clean},
};
use crate::{
    Arm, Audience, Ended, LiveTrial, Recorder, Registry, driven_content, page_content, run_to_end,
    study::{conductor::Conductor, worker::TrialOrder},
    trial::{self, Armband, Assembly},
};
use proact_bridge::{NowWhat, PageContent, ParticipantScreen, StudyButton, StudyRequest};
use proact_devices::{EmgOrigin, FeedbackSinks};
use proact_study::{PlannedTrial, Spot, TrialChoice};
use proact_testbed::{Session, TrialConfig, TrialEnd, TrialResult};
use std::{error::Error, time::Instant};

/// Longest time of what has no limit of its own, seconds: the longest that a trial may have.
const LONGEST_SECS: f64 = 3600.0;

/// What is done with the arm beside trials.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scene {
    /// The gaze is calibrated.
    Gaze,
    /// A simulated participant shows the method.
    Demonstration,
    /// The participant tries the method.
    Practice {
        /// Objects to carry.
        transfers: usize,
    },
}

impl Scene {
    pub(super) fn what(self) -> NowWhat {
        match self {
            Scene::Gaze => NowWhat::CalibrateGaze { error_deg: None },
            Scene::Demonstration => NowWhat::Demonstrate {},
            Scene::Practice { transfers } => NowWhat::Practise { carried: 0, transfers },
        }
    }

    fn title(self) -> &'static str {
        match self {
            Scene::Gaze => "Look at each point until it goes",
            Scene::Demonstration => "Demonstration: watch",
            Scene::Practice { .. } => "Practice: this does not count",
        }
    }
}

impl LiveStudy<'_> {
    /// With the settings of the armband that is worn, and the person where the calibration has the shoulder.
    fn config(&self, order: &TrialOrder) -> Result<(Arm, TrialConfig), Box<dyn Error>> {
        let emg = self.equipment.armband.as_ref().map(|armband| armband.model().config.clone());
        let (arm, mut config) = order.config(self.registry, emg)?;
        self.equipment.calibrations.seat(&mut config.setup);
        Ok((arm, config))
    }

    /// Shows the scene of a trial before it begins, so that the experimenter sees where the blocks stand.
    ///
    /// # Errors
    /// As [`LiveStudy::run`].
    pub(super) fn prepare(&mut self, trial: &PlannedTrial) -> Result<(), Box<dyn Error>> {
        let (arm, config) = self.config(&self.state.conductor.study.order(trial))?;
        let assembly = trial::live_with(&self.registry.methods, &arm, without_emg(config), None)?;
        let mut session = assembly.session;
        self.state.page.set_content(driven_content(session.testbed(), &arm))?;
        self.open_person(&session)?;
        if let Some(frame) = session.step(false)?.frame {
            self.state.page.publish(&frame);
        }
        Ok(())
    }

    /// What the person has connected is opened with the first scene, and goes with each further one.
    fn open_person(&mut self, session: &Session) -> Result<(), Box<dyn Error>> {
        match &mut self.equipment.person {
            Some(person) => person.restart(session),
            None => {
                self.equipment.person = Some((self.equipment.open_person)(session)?);
                Ok(())
            }
        }
    }

    /// Runs a trial that counts.
    ///
    /// # Errors
    /// As [`LiveStudy::run`].
    pub(super) fn run_trial(&mut self, spot: &Spot, trial: &PlannedTrial) -> Result<StepEnd, Box<dyn Error>> {
        let Some(record) = self.state.conductor.begin(spot)? else { return Ok(StepEnd::Interrupted) };
        let attempt = self.state.conductor.progress().step(spot).attempts;
        let order = self.state.conductor.study.recorded_order(trial, attempt, &record);
        let countdown = self.countdown(&spot.session);
        self.running(
            ParticipantScreen::Scene { countdown, title: String::new() },
            &[StudyButton::Pause, StudyButton::Abort],
        );
        let (ended, result, _) = self.drive(&order, false, false)?;
        self.before = outcome(&result);
        Ok(match ended {
            Ended::Finished => StepEnd::Done,
            Ended::Aborted => StepEnd::Aborted,
            Ended::Restart { .. } | Ended::Interrupted => StepEnd::Interrupted,
        })
    }

    fn countdown(&self, session: &str) -> bool {
        let sessions = &self.state.conductor.study.plan.sessions;
        sessions.iter().find(|own| own.name == session).is_some_and(|session| session.countdown)
    }

    /// The step goes on: what the participant sees, and what can be asked for.
    fn running(&mut self, participant: ParticipantScreen, can: &[StudyButton]) {
        if let Some(now) = &mut self.state.now {
            (now.running, now.since, now.participant, now.can) =
                (true, Instant::now(), participant, can.to_vec());
        }
        self.state.carried = 0;
        self.state.show();
    }

    /// Something with the arm that is no trial, again and again until it is ended.
    ///
    /// # Errors
    /// As [`LiveStudy::run`].
    pub(super) fn run_scene(
        &mut self,
        spot: &Spot,
        scene: Scene,
        condition: Option<&str>,
    ) -> Result<StepEnd, Box<dyn Error>> {
        let plan = &self.state.conductor.study.plan;
        let condition =
            plan.conditions.iter().position(|own| Some(own.name.as_str()) == condition).unwrap_or(0);
        let mut order = TrialOrder {
            // Who conducts it says when it is over.
            choice: TrialChoice { limit_secs: Some(LONGEST_SECS), ..plan.choice(condition) },
            // Other blocks than those of any trial.
            seed: plan.seed ^ ((spot.participant as u64) << 40) ^ ((spot.step as u64) << 20),
            arrangement: None,
            dir: None,
            bag: String::new(),
            place: None,
            scored: false,
        };
        let participant = ParticipantScreen::Scene { countdown: false, title: scene.title().to_owned() };
        self.running(participant, &[StudyButton::Next, StudyButton::Skip, StudyButton::Leave]);
        // Asked for once: whoever wants another calibration asks for it.
        let mut calibrates = scene == Scene::Gaze;
        loop {
            let (ended, left) = match scene {
                Scene::Demonstration => self.demonstrate(&order)?,
                Scene::Gaze | Scene::Practice { .. } => {
                    let (ended, _, left) = self.drive(&order, true, std::mem::take(&mut calibrates))?;
                    (ended, left)
                }
            };
            match (ended, left) {
                (Ended::Finished | Ended::Restart { .. }, _) => order.seed = order.seed.wrapping_add(1),
                (Ended::Interrupted, _) => return Ok(StepEnd::Interrupted),
                (Ended::Aborted, Some(StudyRequest::Leave {})) => return Ok(StepEnd::Left),
                (Ended::Aborted, Some(StudyRequest::Skip { reason })) => {
                    return Ok(StepEnd::Skipped(clean(&reason)));
                }
                (Ended::Aborted, _) => return Ok(StepEnd::Done),
            }
        }
    }

    /// The participant drives, until the task or somebody ends it.
    fn drive(
        &mut self,
        order: &TrialOrder,
        next_ends: bool,
        calibrates: bool,
    ) -> Result<(Ended, TrialResult, Option<StudyRequest>), Box<dyn Error>> {
        let (arm, config) = self.config(order)?;
        let worn = match &self.equipment.armband {
            Some(armband) => {
                let trained = armband.model();
                let commands = config.gesture_commands(trained.config.rest, &trained.classifier)?;
                Some(Armband { trained, samples: armband.port(commands) })
            }
            None => None,
        };
        let Assembly { session, classifier, plans, .. } =
            trial::live_with(&self.registry.methods, &arm, config, worn)?;
        let config = session.testbed().config().clone();
        let recorder = match &order.dir {
            Some(dir) => {
                let recorder = Recorder::create_in_study(
                    dir,
                    (order.bag.as_str(), order.place.clone()),
                    &config,
                    &arm,
                    classifier.as_ref(),
                )?;
                Some(recorder.with_plans(plans)?)
            }
            None => None,
        };
        self.state.page.set_content(driven_content(session.testbed(), &arm))?;
        self.open_person(&session)?;
        let (page, interrupted) = (self.state.page, self.state.interrupted);
        let Some(person) = &mut self.equipment.person else { return Err("nobody is there to drive".into()) };
        let rest = self.equipment.armband.as_ref().map(|armband| armband.model().config.rest);
        let rest = Some(rest.unwrap_or_default());
        let mut inputs = SceneInputs { state: &mut self.state, next_ends, calibrates, left: None, rest };
        let mut trial = LiveTrial {
            session,
            recorder,
            dir: order.dir.clone(),
            page,
            inputs: &mut inputs,
            person,
            gaze_offset: &mut self.gaze_offset,
            results: None,
            interrupted,
        };
        let (ended, result) = trial.run()?;
        let left = inputs.left.take();
        journal_holds(&mut self.state)?;
        Ok((ended, result, left))
    }

    /// A simulated participant drives by the same method, in real time.
    fn demonstrate(&mut self, order: &TrialOrder) -> Result<(Ended, Option<StudyRequest>), Box<dyn Error>> {
        let (arm, config) = self.config(order)?;
        let Assembly { session, .. } = trial::simulated_with(
            &self.registry.methods,
            &arm,
            without_emg(config),
            &EmgOrigin::Synthetic,
            None,
        )?;
        self.state.page.set_content(page_content(session.testbed(), &arm))?;
        let (page, interrupted) = (self.state.page, self.state.interrupted);
        let mut inputs = SceneInputs {
            state: &mut self.state,
            next_ends: true,
            calibrates: false,
            left: None,
            rest: None,
        };
        let mut audience = Audience {
            page: Some(page),
            inputs: Some(&mut inputs),
            rosbridge: None,
            shoulder: None,
            feedback: FeedbackSinks::default(),
            interrupted,
        };
        let result = run_to_end(session, None, &mut audience, None, |_, _| {})?;
        let left = inputs.left.take();
        journal_holds(&mut self.state)?;
        let ended = match result.ended {
            TrialEnd::Task | TrialEnd::Failed | TrialEnd::Restart => Ended::Finished,
            TrialEnd::Abort => Ended::Aborted,
            TrialEnd::Interrupt => Ended::Interrupted,
        };
        Ok((ended, left))
    }
}

/// What the pages of a study show before its first trial: the scene of the first one that is planned.
///
/// # Errors
/// A plan without trials; a native library that refuses.
pub fn opening(conductor: &Conductor, registry: &Registry) -> Result<PageContent, Box<dyn Error>> {
    let study = &conductor.study;
    let trial = study.schedule.trials().next().ok_or("the plan has no trial")?;
    let (arm, config) = study.order(trial).config(registry, None)?;
    let assembly = trial::live_with(&registry.methods, &arm, without_emg(config), None)?;
    Ok(driven_content(assembly.session.testbed(), &arm))
}

/// # Errors
/// The journal could not be written to meanwhile.
fn journal_holds(state: &mut StudyState<'_>) -> Result<(), Box<dyn Error>> {
    state.failed.take().map_or(Ok(()), |error| Err(error.into()))
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
