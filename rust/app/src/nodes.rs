//! The stages of a trial as nodes on a ROS 1 graph. Each function runs one node until the graph ends it, or an error does:
//! no graph, a part that cannot be made, a message that cannot go out.

use crate::{arm::Arm, method_process, trial};
use proact_devices::{EmgOrigin, GazeSource};
use proact_kinematics::Kinematics;
pub use proact_ros::node::run_meter as meter;
use proact_ros::node::{self, IntentParts, MethodParts, ParticipantParts, SimParts, TaskParts};
use proact_tasks::BoxAndBlocks;
use proact_testbed::{
    PersonParts, TrialConfig, TrialResult,
    stages::{EmgStage, IntentStage, MethodStage, PersonStage},
};
use proact_types::SimTime;
use std::error::Error;

type Outcome<T = ()> = Result<T, Box<dyn Error>>;

fn box_and_blocks(config: &TrialConfig) -> BoxAndBlocks {
    BoxAndBlocks::new(config.arrangement).with_limit(SimTime::from_secs(config.limit_secs))
}

/// Arm, box and blocks.
pub fn sim(arm: &Arm, config: TrialConfig) -> Outcome {
    let (model, task) = (arm.model().clone(), box_and_blocks(&config));
    let base = config.setup.body.shoulder_pose(&Default::default());
    let (placed, scene, physics) = (model.clone(), task.scene().clone(), config.physics);
    let factory = Box::new(move || trial::plant(&placed, &scene, &base, &physics));
    let kinematics = Box::new(Kinematics::new(&model)?);
    Ok(node::run_sim(SimParts { config, model, task, factory, kinematics })?)
}

/// The whole testbed: with a simulated participant, or `live` with what other nodes send.
pub fn testbed(arm: &Arm, mut config: TrialConfig, live: bool) -> Outcome<TrialResult> {
    if live {
        // Who acts is another node's matter.
        (config.participant, config.emg) = (None, None);
    }
    let config = config.live();
    let assembly = match live {
        true => trial::live_with(arm, config, None)?,
        false => trial::simulated_with(arm, config, &EmgOrigin::Synthetic, None)?,
    };
    Ok(node::run_testbed(assembly.session, !live)?)
}

/// Samples to gestures, by a model of the synthetic armband.
pub fn emg(mut config: TrialConfig) -> Outcome {
    let setup = proact_devices::prepare_with(&EmgOrigin::Synthetic, config.emg.as_ref(), config.seed)?;
    config.emg = Some(setup.config);
    config.emg_centring = setup.centring;
    Ok(node::run_emg(EmgStage::new(&config, Some(setup.classifier))?)?)
}

/// Gaze and blocks to what is meant.
pub fn intent(arm: &Arm, config: &TrialConfig) -> Outcome {
    let model = arm.model().clone();
    let (moving, kinematics) = (model.moving_count(), Box::new(Kinematics::new(&model)?));
    let stage = IntentStage::new(config, model)?;
    Ok(node::run_intent(IntentParts { stage, kinematics, moving })?)
}

/// Gestures and what is meant to commands.
pub fn method(arm: &Arm, config: &TrialConfig) -> Outcome {
    let model = arm.model().clone();
    let kinematics = Box::new(Kinematics::new(&model)?);
    let plans = Box::new(trial::planner(&model, config)?);
    let scene = box_and_blocks(config).scene().clone();
    let stage = MethodStage::new(config, model.clone(), scene, plans, method_process::start(config)?)?;
    Ok(node::run_method(MethodParts { stage, method: config.method, model, kinematics })?)
}

/// The task and the display over a Gazebo of one's own.
pub fn task(arm: &Arm, config: TrialConfig) -> Outcome {
    let (model, task) = (arm.model().clone(), box_and_blocks(&config));
    let kinematics = Box::new(Kinematics::new(&model)?);
    Ok(node::run_task(TaskParts { config, model, task, kinematics })?)
}

/// A simulated person with armband and eye tracker.
pub fn participant(arm: &Arm, config: &TrialConfig) -> Outcome {
    let model = arm.model().clone();
    let options = config.participant.unwrap_or_default();
    let person = PersonParts {
        participant: Some(trial::participant(config, options, &model)?),
        emg: Some(Box::new(proact_devices::prepare(&EmgOrigin::Synthetic, config.seed)?.feed)),
        gaze: Some(Box::new(GazeSource::new(options.gaze_error_deg, config.seed)?)),
    };
    let stage = PersonStage::new(person, config.setup.body, config.motion, model.arm_count());
    let joints = (model.arm_count(), model.moving_count());
    Ok(node::run_participant(ParticipantParts { stage, joints })?)
}
