//! The stages of a trial as nodes on a ROS 1 graph. Each function runs one node until the graph ends it, or an error does:
//! no graph, a part that cannot be made, a message that cannot go out.

use crate::{arm::Arm, armband::LiveArmband, intent_process, method_process, trial};
use proact_control::MethodRegistry;
use proact_devices::{EmgOrigin, SimulatedEyeTracker};
use proact_emg::EmgModel;
use proact_kinematics::Kinematics;
pub use proact_ros::node::run_meter as meter;
use proact_ros::node::{
    self, ExpectedCounts, IntentParts, MethodParts, ParticipantParts, SimParts, TaskParts, WaitForSamples,
};
use proact_testbed::{
    PersonParts, TrialConfig, TrialResult,
    stages::{EmgStage, IntentStage, MethodStage, PersonStage},
};
use std::error::Error;

type NodeResult<T = ()> = Result<T, Box<dyn Error>>;

/// Arm and scene.
pub fn sim(arm: &Arm, config: TrialConfig) -> NodeResult {
    let model = arm.model().clone();
    let task = config.build_task(&model)?;
    let base = config.setup.body.shoulder_pose(&Default::default());
    let (placed, scene, physics) = (model.clone(), task.scene().clone(), config.physics);
    let factory = Box::new(move || trial::build_plant(&placed, &scene, &base, &physics));
    let kinematics = Box::new(Kinematics::new(&model)?);
    Ok(node::run_sim(SimParts { config, model, urdf: arm.folder().urdf.clone(), factory, kinematics })?)
}

/// The whole testbed: with a simulated participant, or `live` with what other nodes send.
pub fn testbed(
    methods: &MethodRegistry,
    arm: &Arm,
    mut config: TrialConfig,
    live: bool,
) -> NodeResult<TrialResult> {
    if live {
        // Who acts is another node's matter.
        (config.participant, config.emg) = (None, None);
    }
    let config = config.for_live_trial();
    let assembly = match live {
        true => trial::live_trial_with_armband(methods, arm, config, None)?,
        false => trial::simulated_trial_with_model(methods, arm, config, &EmgOrigin::Synthetic, None)?,
    };
    Ok(node::run_testbed(assembly.trial, !live, &arm.folder().urdf)?)
}

/// Samples to gestures: by a `trained` model, or one of the synthetic armband; of an `armband`, or those that other nodes
/// publish.
pub fn emg(mut config: TrialConfig, trained: Option<&EmgModel>, armband: Option<LiveArmband>) -> NodeResult {
    let classifier = match trained {
        Some(model) => {
            model.check_settings(config.emg.get_or_insert_with(|| model.config.clone()))?;
            config.set_emg_dc_offset(model.dc_offset.clone())?;
            model.classifier.clone()
        }
        None => {
            let setup =
                proact_devices::prepare_emg_with(&EmgOrigin::Synthetic, config.emg.as_ref(), config.seed)?;
            config.emg = Some(setup.config);
            config.emg_dc_offset = setup.dc_offset;
            setup.classifier
        }
    };
    let decoder = trial::start_decoder(&config, Some(&classifier))?;
    let stage = EmgStage::new(&config, Some(classifier))?.with_decoder(decoder);
    let wait = armband
        .map(|armband| -> WaitForSamples { Box::new(move |timeout| armband.wait_for_samples(timeout)) });
    Ok(node::run_emg(stage, wait)?)
}

/// Gaze and objects to what is meant.
pub fn intent(methods: &MethodRegistry, arm: &Arm, config: &TrialConfig) -> NodeResult {
    let model = arm.model().clone();
    let kinematics = Box::new(Kinematics::new(&model)?);
    let scene = config.build_task(&model)?.scene().clone();
    let counts = ExpectedCounts::of(&model, &scene);
    let stage = IntentStage::new(config, config.method_entry(methods)?.needs(), model, &scene)?;
    let stage = stage.with_process(intent_process::start(config)?);
    Ok(node::run_intent(IntentParts { stage, kinematics, counts, scene })?)
}

/// Gestures and what is meant to commands.
pub fn method(methods: &MethodRegistry, arm: &Arm, config: &TrialConfig) -> NodeResult {
    let model = arm.model().clone();
    let kinematics = Box::new(Kinematics::new(&model)?);
    let plans = Box::new(trial::build_planner(&model, config)?);
    let scene = config.build_task(&model)?.scene().clone();
    let method = config.method_entry(methods)?;
    let process = method_process::start(&method, config.wait_for_plans, &model)?;
    let stage = MethodStage::new(config, &method, model.clone(), scene.clone(), plans, process)?;
    Ok(node::run_method(MethodParts { stage, method, model, scene, kinematics })?)
}

/// The task and the display over a Gazebo of one's own.
pub fn task(arm: &Arm, config: TrialConfig) -> NodeResult {
    let model = arm.model().clone();
    let kinematics = Box::new(Kinematics::new(&model)?);
    Ok(node::run_task(TaskParts { config, model, urdf: arm.folder().urdf.clone(), kinematics })?)
}

/// A simulated person with armband and eye tracker.
pub fn participant(methods: &MethodRegistry, arm: &Arm, config: &TrialConfig) -> NodeResult {
    let model = arm.model().clone();
    let options = config.participant.unwrap_or_default();
    let worn = proact_devices::prepare_emg(&EmgOrigin::Synthetic, config.seed)?;
    let commands = config.command_map(worn.config.rest, &worn.classifier)?;
    let person = PersonParts {
        participant: Some(trial::build_participant(methods, config, options, &model)?),
        emg: Some(Box::new(worn.feed.with_commands(commands))),
        gaze: Some(Box::new(SimulatedEyeTracker::new(options.gaze_error_deg, config.seed)?)),
    };
    let stage = PersonStage::new(person, config.setup.body, config.motion, model.arm_count());
    let counts = ExpectedCounts::of(&model, config.build_task(&model)?.scene());
    Ok(node::run_participant(ParticipantParts { stage, counts })?)
}
