//! Putting a trial together: which library does what.

mod custom_parts;

pub use custom_parts::{CustomParts, EmgInput, simulate_with};

use crate::{
    arm::{Arm, ArmError},
    intent_process, method_process, print_status,
};
use proact_arm::{ArmModel, Side};
use proact_control::{JogProfile, JogSteps, JointJog, JointSubset, MethodRegistry, ports::MethodProcess};
use proact_devices::{EmgFeed, EmgOrigin, EmgSetup, ExternalDecoderProcess, SimulatedEyeTracker};
use proact_dynamics::{DynamicsOptions, RigidBodyPlant};
use proact_emg::{Classifier, DecoderProcess, EmgError, EmgModel, RecordingFault};
use proact_kinematics::Kinematics;
use proact_participants::{
    ImitatingParticipant, JoggingParticipant, Participant, ParticipantOptions, SelectingParticipant,
    SteeringParticipant,
};
use proact_planning::{ArmPlanner, PersonGeometry, PlanLog, PlanWorker};
use proact_testbed::{
    ConfigError, LoggedPlans, PersonParts, PhysicsConfig, RunningTrial, Testbed, TestbedError, TestbedParts,
    TrialConfig,
    doubles::{InstantPlans, KinematicPlant},
    ports::{EmgSource as EmgPort, PlanService, Plant, PlantError},
};
use proact_types::{
    CommandMap, CommandMapError, MethodStyle, PlanReply, PlanRequest, Pose, Scene, WindowAnswer,
};
use std::collections::BTreeMap;
use std::sync::{
    Arc, Mutex, PoisonError,
    atomic::{AtomicBool, Ordering},
};

/// Why a trial cannot be put together.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AssemblyError {
    /// The configuration.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// EMG or gaze.
    #[error(transparent)]
    Device(#[from] proact_devices::DeviceError),
    /// Kinematics.
    #[error("kinematics: {0}")]
    Kinematics(#[from] proact_control::ports::KinematicsError),
    /// The arm.
    #[error(transparent)]
    Arm(#[from] ArmError),
    /// Gestures and commands that do not go together.
    #[error("profile: {0}")]
    Gestures(#[from] CommandMapError),
    /// Settings that the EMG model does not take.
    #[error(transparent)]
    Emg(#[from] EmgError),
    /// Planner.
    #[error("planner: {0}")]
    Planning(#[from] proact_planning::PlanningError),
    /// Physics.
    #[error("physics: {0}")]
    Plant(#[from] PlantError),
    /// The process of the control method, or of the intent model.
    #[error(transparent)]
    Method(#[from] crate::method_process::MethodProcessError),
    /// The testbed.
    #[error(transparent)]
    Testbed(#[from] TestbedError),
}

/// A trial ready to run.
pub struct Assembly {
    /// The trial.
    pub trial: RunningTrial,
    /// What was trained for it; belongs to the record.
    pub classifier: Option<Classifier>,
    /// The arm.
    pub arm: Arm,
    /// What its plans took.
    pub plans: PlanLog,
    /// What was found in its EMG recordings, and accepted.
    pub recording_faults: Vec<RecordingFault>,
}

/// A trial with a simulated participant whose gestures come through `emg`, with arm and methods that ship with the program.
///
/// # Errors
/// [`AssemblyError`].
pub fn simulated_trial(config: TrialConfig, emg: &EmgOrigin) -> Result<Assembly, AssemblyError> {
    simulated_trial_with_model(&MethodRegistry::standard(), &Arm::from_config(&config)?, config, emg, None)
}

/// [`simulated_trial`] with `methods` and `arm`, and with a model that was trained before, if one is given.
///
/// # Errors
/// [`AssemblyError`]; a model that does not fit the EMG says why.
pub fn simulated_trial_with_model(
    methods: &MethodRegistry,
    arm: &Arm,
    mut config: TrialConfig,
    emg: &EmgOrigin,
    trained: Option<&EmgModel>,
) -> Result<Assembly, AssemblyError> {
    let SimulatedPerson { parts, classifier, findings } =
        prepare_simulated_person(methods, arm, &mut config, emg, trained)?;
    let (testbed, plans) = planning_testbed(methods, arm, config, Some(classifier.clone()))?;
    let trial = RunningTrial::new(testbed, parts);
    Ok(Assembly { trial, classifier: Some(classifier), arm: arm.clone(), plans, recording_faults: findings })
}

/// [`simulated_trial_with_model`] without physics and planner: the arm follows its commands at once, nothing collides, plans are straight
/// lines that are there at once. Kinematics, EMG, gaze and methods are those of a trial. Several times as fast, and blind to what
/// goes wrong by contact.
///
/// # Errors
/// [`AssemblyError`].
pub fn kinematic_trial(
    methods: &MethodRegistry,
    arm: &Arm,
    mut config: TrialConfig,
    emg: &EmgOrigin,
) -> Result<RunningTrial, AssemblyError> {
    let person = prepare_simulated_person(methods, arm, &mut config, emg, None)?;
    let model = arm.model();
    let base = config.setup.body.shoulder_pose(&Default::default());
    let scene = config.build_task(model)?.scene().clone();
    let plant: Box<dyn Plant> = Box::new(KinematicPlant::new(model.clone(), scene, base));
    let plans = Box::new(InstantPlans::new(model.clone()));
    let process = start_method(methods, &config, arm.model())?;
    let intent = intent_process::start(&config)?;
    let testbed =
        build_testbed(methods, arm, config, plans, Some(person.classifier), process, |_, _| Ok(plant))?;
    Ok(RunningTrial::new(testbed.with_intent(intent), person.parts))
}

/// A simulated participant with armband and eye tracker.
struct SimulatedPerson {
    parts: PersonParts,
    classifier: Classifier,
    findings: Vec<RecordingFault>,
}

/// Who drives a simulated trial; `config` then says what was prepared.
fn prepare_simulated_person(
    methods: &MethodRegistry,
    arm: &Arm,
    config: &mut TrialConfig,
    emg: &EmgOrigin,
    trained: Option<&EmgModel>,
) -> Result<SimulatedPerson, AssemblyError> {
    let EmgSetup { classifier, feed, config: emg_config, dc_offset, label, findings } = match trained {
        Some(model) => proact_devices::prepare_model(emg, model, config.emg.as_ref(), config.seed)?,
        None => proact_devices::prepare_emg_with(emg, config.emg.as_ref(), config.seed)?,
    };
    config.emg = Some(emg_config);
    config.set_emg_dc_offset(dc_offset)?;
    findings.iter().for_each(print_status);
    let of_model = trained.map_or_else(Vec::new, |model| model.accepted_faults.clone());
    config.accept_faults([proact_devices::accepted_fault_texts(&findings), of_model].concat())?;
    config.set_gesture_source(&label)?;
    let options = *config.participant.get_or_insert_with(ParticipantOptions::default);
    let feed = feed.with_commands(commands_for(config, &classifier)?);
    let participant = build_participant(methods, config, options, arm.model())?;
    let gaze = SimulatedEyeTracker::new(options.gaze_error_deg, config.seed)?;
    let parts =
        PersonParts { participant: Some(participant), emg: Some(Box::new(feed)), gaze: Some(Box::new(gaze)) };
    Ok(SimulatedPerson { parts, classifier, findings })
}

/// What the gestures of `classifier` are to the method of a trial. What has no use is told once.
fn commands_for(config: &TrialConfig, classifier: &Classifier) -> Result<CommandMap, AssemblyError> {
    let rest = config.emg.as_ref().map_or_else(Default::default, |emg| emg.rest);
    let commands = config.command_map(rest, classifier)?;
    if let Some(remark) = commands.describe_unmapped() {
        print_status(remark);
    }
    Ok(commands)
}

/// The simulated participant of a trial, who drives by the style of its method.
///
/// # Errors
/// A method that does not exist, a profile whose joints do not fit the arm.
pub fn build_participant(
    methods: &MethodRegistry,
    config: &TrialConfig,
    options: ParticipantOptions,
    model: &Arc<ArmModel>,
) -> Result<Box<dyn Participant>, AssemblyError> {
    let task = config.build_task(model)?;
    let (body, scene, briefing, seed) = (config.setup.body, task.scene(), task.briefing(), config.seed);
    let style = config.method_entry(methods)?.info().style;
    let driven = JointSubset::for_style(style, &config.profile, model).map_err(ConfigError::from)?;
    let own: Vec<usize> = (0..model.arm_count()).filter(|&joint| !driven.contains(joint)).collect();
    Ok(match style {
        // Nothing to take: the hand, or the joints, to where the display shows.
        MethodStyle::Jogging if scene.objects.is_empty() => {
            Box::new(SteeringParticipant::new(options, body, scene.table_height, model.clone(), &own, seed))
        }
        MethodStyle::Jogging => {
            let person = JoggingParticipant::new(options, body, scene, briefing, model.clone(), seed);
            let person = person.with_residual_limb(own);
            match config.profile.joint_jog.cycle.as_slice() {
                [] => Box::new(person),
                // A cycle of the profile's own, which may have the hand.
                _ => {
                    let cycle =
                        JointJog::cycle(&config.profile, model, &driven).map_err(ConfigError::from)?;
                    Box::new(person.with_cycle(&cycle))
                }
            }
        }
        MethodStyle::Selecting => {
            let person = SelectingParticipant::new(options, body, scene, briefing, seed);
            Box::new(person.with_residual_limb(scene, model.clone(), own))
        }
        MethodStyle::Imitating => {
            Box::new(ImitatingParticipant::new(options, body, scene, briefing, model.clone(), seed))
        }
    })
}

/// A person's armband, and the model that was trained for it.
pub struct TrainedArmband<'a> {
    /// The model.
    pub trained: &'a EmgModel,
    /// Its samples.
    pub samples: Box<dyn EmgPort>,
}

/// A trial that a person at the page drives: gestures from keys, gaze from the mouse. With arm and methods that
/// ship with the program.
///
/// # Errors
/// [`AssemblyError`].
pub fn live_trial(config: TrialConfig) -> Result<Assembly, AssemblyError> {
    live_trial_with_armband(&MethodRegistry::standard(), &Arm::from_config(&config)?, config, None)
}

/// [`live_trial`] with `methods` and `arm`, and with gestures from muscles if there is an armband.
///
/// # Errors
/// [`AssemblyError`]; settings of who or what has no part in the trial.
pub fn live_trial_with_armband(
    methods: &MethodRegistry,
    arm: &Arm,
    config: TrialConfig,
    armband: Option<TrainedArmband<'_>>,
) -> Result<Assembly, AssemblyError> {
    let mut config = config.for_live_trial();
    if config.participant.is_some() {
        return Err(ConfigError::UnusedSettings { key: "participant", why: "a person drives" }.into());
    }
    let (samples, classifier) = match armband {
        Some(TrainedArmband { trained, samples }) => {
            trained.check_settings(config.emg.get_or_insert_with(|| trained.config.clone()))?;
            config.set_emg_dc_offset(trained.dc_offset.clone())?;
            config.accept_faults(trained.accepted_faults.clone())?;
            config.set_gesture_source("armband")?;
            commands_for(&config, &trained.classifier)?;
            (Some(samples), Some(trained.classifier.clone()))
        }
        None => {
            if config.emg.is_some() {
                return Err(ConfigError::UnusedSettings { key: "emg", why: "gestures come from keys" }.into());
            }
            config.set_gesture_source("keys")?;
            // Keys have no effort by which a person could be careful.
            if let JogProfile::Time { speed_steps: steps, .. } = &mut config.profile.jog {
                steps.get_or_insert(JogSteps::KEYS);
            }
            (None, None)
        }
    };
    let (testbed, plans) = planning_testbed(methods, arm, config, classifier.clone())?;
    let trial = RunningTrial::new(testbed, PersonParts { emg: samples, ..PersonParts::default() });
    Ok(Assembly { trial, classifier, arm: arm.clone(), plans, recording_faults: Vec::new() })
}

/// A live testbed and the synthetic armband that goes with it, without a person; `around` wraps the physics.
///
/// # Errors
/// [`AssemblyError`].
pub fn live_testbed(
    config: TrialConfig,
    emg: &EmgOrigin,
    around: impl FnOnce(Box<dyn Plant>) -> Box<dyn Plant>,
) -> Result<(Testbed, EmgFeed), AssemblyError> {
    let mut config = config.for_live_trial();
    let EmgSetup { classifier, feed, config: emg_config, label, .. } =
        proact_devices::prepare_emg_with(emg, config.emg.as_ref(), config.seed)?;
    config.emg = Some(emg_config);
    config.set_gesture_source(&label)?;
    let feed = feed.with_commands(commands_for(&config, &classifier)?);
    let arm = Arm::from_config(&config)?;
    let plans = Box::new(build_planner(arm.model(), &config)?);
    let methods = MethodRegistry::standard();
    let process = start_method(&methods, &config, arm.model())?;
    let intent = intent_process::start(&config)?;
    let made = |model: &ArmModel, config: &TrialConfig| Ok(around(build_physics(model, config)?));
    let testbed = build_testbed(&methods, &arm, config, plans, Some(classifier), process, made)?;
    Ok((testbed.with_intent(intent), feed))
}

/// A testbed that takes its plans from the log.
///
/// # Errors
/// [`AssemblyError`].
pub fn replay_testbed(
    methods: &MethodRegistry,
    arm: &Arm,
    config: TrialConfig,
    classifier: Option<Classifier>,
) -> Result<Testbed, AssemblyError> {
    build_testbed(methods, arm, config, Box::new(LoggedPlans), classifier, None, build_physics)
}

/// A testbed that takes its plans from the log, and plans that are computed again beside it.
///
/// # Errors
/// [`AssemblyError`].
pub fn replanning_testbed(
    methods: &MethodRegistry,
    arm: &Arm,
    config: TrialConfig,
    classifier: Option<Classifier>,
) -> Result<(Testbed, ReplannedReplies), AssemblyError> {
    let worker = build_planner(arm.model(), &config)?;
    let plans = ReplannedReplies { log: worker.log(), replies: Arc::default(), is_served: Arc::default() };
    let plan_service =
        ReplanningService { worker, replies: plans.replies.clone(), is_served: plans.is_served.clone() };
    let testbed =
        build_testbed(methods, arm, config, Box::new(plan_service), classifier, None, build_physics)?;
    Ok((testbed, plans))
}

/// What the requests of a replay give now.
pub struct ReplannedReplies {
    log: PlanLog,
    replies: Arc<Mutex<BTreeMap<u64, PlanReply>>>,
    /// Whether the testbed gets them.
    is_served: Arc<AtomicBool>,
}

impl ReplannedReplies {
    /// From now on the testbed gets these plans where the log has none: its requests are no longer those of the record.
    pub fn start_serving(&self) {
        self.is_served.store(true, Ordering::Relaxed);
    }

    /// The reply to request `id` now, and whether a deadline ended it; none if it was not asked.
    pub fn reply(&self, id: u64) -> Option<(PlanReply, bool)> {
        let replies = self.replies.lock().unwrap_or_else(PoisonError::into_inner);
        let timed_out = self.log.entries().iter().any(|entry| entry.request == id && entry.timed_out);
        Some((replies.get(&id)?.clone(), timed_out))
    }
}

/// Plans every request at once and keeps the reply for later; the testbed takes the recorded one, until it is told to take these.
struct ReplanningService {
    worker: PlanWorker,
    replies: Arc<Mutex<BTreeMap<u64, PlanReply>>>,
    is_served: Arc<AtomicBool>,
}

impl PlanService for ReplanningService {
    fn submit(&mut self, request: PlanRequest) {
        let id = request.id;
        self.worker.submit(request);
        let reply = self.worker.wait(id);
        self.replies.lock().unwrap_or_else(PoisonError::into_inner).insert(id, reply);
    }

    fn poll(&mut self, id: u64) -> Option<PlanReply> {
        let replies = self.replies.lock().unwrap_or_else(PoisonError::into_inner);
        self.is_served.load(Ordering::Relaxed).then(|| replies.get(&id).cloned())?
    }

    /// A plan that the log should hold and does not, unless these are served: it was another trial.
    fn wait(&mut self, id: u64) -> PlanReply {
        self.poll(id).unwrap_or_else(|| LoggedPlans.wait(id))
    }

    fn cancel(&mut self) {}
}

/// OMPL over FCL with KDL's inverse kinematics, in a thread of its own, around the person of the set-up.
pub fn build_planner(model: &Arc<ArmModel>, config: &TrialConfig) -> Result<PlanWorker, AssemblyError> {
    let kinematics = Kinematics::new(model)?;
    let planner = ArmPlanner::new(model.clone(), Box::new(kinematics), config.planner.clone())?;
    // Who can lean sits; the still shoulder is that of somebody who stands.
    let seated = config.setup.body.forward_max_deg > 0.0;
    let person = if seated { PersonGeometry::SEATED } else { PersonGeometry::STANDING };
    let person = if model.side == Side::Left { person.mirrored() } else { person };
    let worker = PlanWorker::new(planner);
    // An arm that stands by itself has nobody behind its base; who sits beside it is out of its reach by the set-up.
    Ok(if model.settings.fixed_base.is_some() { worker } else { worker.with_person(person) })
}

/// Physics with the arm at its start pose, an open hand, and the blocks of `scene`.
pub fn build_plant(
    model: &ArmModel,
    scene: &Scene,
    base: &Pose,
    physics: &PhysicsConfig,
) -> Result<Box<dyn Plant>, PlantError> {
    let pose = |group, name| model.pose(group, name).map_err(|error| PlantError::Model(error.to_string()));
    let initial: Vec<f64> = pose("arm", "start")?.iter().chain(pose("hand", "open")?).copied().collect();
    Ok(Box::new(RigidBodyPlant::new(model, scene, &initial, base, DynamicsOptions::from_config(physics))?))
}

/// The testbed of a trial that plans, and what its plans take.
fn planning_testbed(
    methods: &MethodRegistry,
    arm: &Arm,
    config: TrialConfig,
    classifier: Option<Classifier>,
) -> Result<(Testbed, PlanLog), AssemblyError> {
    let worker = build_planner(arm.model(), &config)?;
    let plans = worker.log();
    let process = start_method(methods, &config, arm.model())?;
    let decoder = start_decoder(&config, classifier.as_ref())?;
    let intent = intent_process::start(&config)?;
    let testbed = build_testbed(methods, arm, config, Box::new(worker), classifier, process, build_physics)?;
    Ok((testbed.with_decoder(decoder).with_intent(intent), plans))
}

/// The process of the trial's method, started, if it has one.
fn start_method(
    methods: &MethodRegistry,
    config: &TrialConfig,
    model: &ArmModel,
) -> Result<Option<Box<dyn MethodProcess>>, AssemblyError> {
    Ok(method_process::start(&config.method_entry(methods)?, config.wait_for_plans, model)?)
}

/// The process that decodes the trial's EMG, started, if one does.
pub(crate) fn start_decoder(
    config: &TrialConfig,
    classifier: Option<&Classifier>,
) -> Result<Option<Box<dyn DecoderProcess>>, AssemblyError> {
    let (Some(emg), Some(classifier)) = (&config.emg, classifier) else { return Ok(None) };
    match ExternalDecoderProcess::start(emg, classifier, config.wait_for_plans) {
        // As with a method: a simulated trial has it in its record, so that a batch lists it and goes on.
        Err(error) if config.wait_for_plans => Ok(Some(Box::new(FailedDecoder(error.to_string())))),
        started => Ok(started?.map(|process| -> Box<dyn DecoderProcess> { Box::new(process) })),
    }
}

/// Stands for a process that does not start, with the reason.
struct FailedDecoder(String);

impl DecoderProcess for FailedDecoder {
    fn decode(&mut self, _window: u64, _line: &str) -> WindowAnswer {
        WindowAnswer::Failed(self.0.clone())
    }
}

/// The physics of a trial.
fn build_physics(model: &ArmModel, config: &TrialConfig) -> Result<Box<dyn Plant>, AssemblyError> {
    let base = config.setup.body.shoulder_pose(&Default::default());
    Ok(build_plant(model, config.build_task(model)?.scene(), &base, &config.physics)?)
}

fn build_testbed(
    methods: &MethodRegistry,
    arm: &Arm,
    config: TrialConfig,
    plans: Box<dyn PlanService>,
    classifier: Option<Classifier>,
    process: Option<Box<dyn MethodProcess>>,
    world: impl FnOnce(&ArmModel, &TrialConfig) -> Result<Box<dyn Plant>, AssemblyError>,
) -> Result<Testbed, AssemblyError> {
    let mut config = config;
    arm.write_current_name(&mut config);
    let model = arm.model();
    let parts = TestbedParts {
        arm: arm.pinned(),
        model: model.clone(),
        kinematics: Box::new(Kinematics::new(model)?),
        plant: world(model, &config)?,
        methods: methods.clone(),
        plans,
        classifier,
        process,
    };
    Ok(Testbed::new(config, parts)?)
}
