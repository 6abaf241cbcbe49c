//! Putting a trial together: which library does what.

mod own_parts;

pub use own_parts::{EmgOf, OwnParts, simulated_by};

use crate::{
    arm::{Arm, ArmError},
    intent_process, method_process, tell,
};
use proact_arm::{ArmModel, Side};
use proact_control::{JogProfile, JogSteps, JointJog, JointSubset, MethodRegistry, ports::MethodProcess};
use proact_devices::{EmgFeed, EmgOrigin, EmgSetup, GazeSource, ProcessDecoder};
use proact_dynamics::{DynamicsOptions, OdePlant};
use proact_emg::{Classifier, DecoderProcess, EmgError, EmgModel};
use proact_kinematics::Kinematics;
use proact_participants::{
    ImitatingParticipant, JoggingParticipant, Participant, ParticipantOptions, SelectingParticipant,
    SteeringParticipant,
};
use proact_planning::{ArmPlanner, Person, PlanLog, PlanWorker};
use proact_testbed::{
    ConfigError, LoggedPlans, Parts, PersonParts, PhysicsConfig, Session, Testbed, TestbedError, TrialConfig,
    doubles::{InstantPlans, KinematicPlant},
    ports::{EmgSource as EmgPort, PlanService, Plant, PlantError},
};
use proact_types::{
    GestureCommands, GestureTableError, MethodStyle, PlanReply, PlanRequest, Pose, Scene, WindowAnswer,
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
    Gestures(#[from] GestureTableError),
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
    pub session: Session,
    /// What was trained for it; belongs to the record.
    pub classifier: Option<Classifier>,
    /// The arm.
    pub arm: Arm,
    /// What its plans took.
    pub plans: PlanLog,
}

/// A trial with a simulated participant whose gestures come through `emg`, with arm and methods that ship with the program.
///
/// # Errors
/// [`AssemblyError`].
pub fn simulated(config: TrialConfig, emg: &EmgOrigin) -> Result<Assembly, AssemblyError> {
    simulated_with(&MethodRegistry::standard(), &Arm::of(&config)?, config, emg, None)
}

/// [`simulated`] with `methods` and `arm`, and with a model that was trained before, if one is given.
///
/// # Errors
/// [`AssemblyError`]; a model that does not fit the EMG says why.
pub fn simulated_with(
    methods: &MethodRegistry,
    arm: &Arm,
    mut config: TrialConfig,
    emg: &EmgOrigin,
    trained: Option<&EmgModel>,
) -> Result<Assembly, AssemblyError> {
    let person = simulated_person(methods, arm, &mut config, emg, trained)?;
    let classifier = person.classifier;
    let (testbed, plans) = testbed(methods, arm, config, Some(classifier.clone()))?;
    let session = Session::new(testbed, person.parts);
    Ok(Assembly { session, classifier: Some(classifier), arm: arm.clone(), plans })
}

/// [`simulated_with`] without physics and planner: the arm follows its commands at once, nothing collides, plans are straight
/// lines that are there at once. Kinematics, EMG, gaze and methods are those of a trial. Several times as fast, and blind to what
/// goes wrong by contact.
///
/// # Errors
/// [`AssemblyError`].
pub fn kinematic(
    methods: &MethodRegistry,
    arm: &Arm,
    mut config: TrialConfig,
    emg: &EmgOrigin,
) -> Result<Session, AssemblyError> {
    let person = simulated_person(methods, arm, &mut config, emg, None)?;
    let model = arm.model();
    let base = config.setup.body.shoulder_pose(&Default::default());
    let scene = config.build_task(model)?.scene().clone();
    let plant: Box<dyn Plant> = Box::new(KinematicPlant::new(model.clone(), scene, base));
    let plans = Box::new(InstantPlans::new(model.clone()));
    let process = process(methods, &config, arm.model())?;
    let intent = intent_process::start(&config)?;
    let testbed =
        testbed_around(methods, arm, config, plans, Some(person.classifier), process, |_, _| Ok(plant))?;
    Ok(Session::new(testbed.with_intent(intent), person.parts))
}

/// A simulated participant with armband and eye tracker.
struct SimulatedPerson {
    parts: PersonParts,
    classifier: Classifier,
}

/// Who drives a simulated trial; `config` then says what was prepared.
fn simulated_person(
    methods: &MethodRegistry,
    arm: &Arm,
    config: &mut TrialConfig,
    emg: &EmgOrigin,
    trained: Option<&EmgModel>,
) -> Result<SimulatedPerson, AssemblyError> {
    let EmgSetup { classifier, feed, config: emg_config, centring, label } = match trained {
        Some(model) => proact_devices::prepare_model(emg, model, config.emg.as_ref(), config.seed)?,
        None => proact_devices::prepare_with(emg, config.emg.as_ref(), config.seed)?,
    };
    config.emg = Some(emg_config);
    config.centred_by(centring)?;
    config.gestures_from(&label)?;
    let options = *config.participant.get_or_insert_with(ParticipantOptions::default);
    let feed = feed.with_commands(commands(config, &classifier)?);
    let participant = participant(methods, config, options, arm.model())?;
    let gaze = GazeSource::new(options.gaze_error_deg, config.seed)?;
    let parts =
        PersonParts { participant: Some(participant), emg: Some(Box::new(feed)), gaze: Some(Box::new(gaze)) };
    Ok(SimulatedPerson { parts, classifier })
}

/// What the gestures of `classifier` are to the method of a trial. What has no use is told once.
fn commands(config: &TrialConfig, classifier: &Classifier) -> Result<GestureCommands, AssemblyError> {
    let rest = config.emg.as_ref().map_or_else(Default::default, |emg| emg.rest);
    let commands = config.gesture_commands(rest, classifier)?;
    if let Some(remark) = commands.remark() {
        tell(remark);
    }
    Ok(commands)
}

/// The simulated participant of a trial, who drives by the style of its method.
///
/// # Errors
/// A method that does not exist, a profile whose joints do not fit the arm.
pub fn participant(
    methods: &MethodRegistry,
    config: &TrialConfig,
    options: ParticipantOptions,
    model: &Arc<ArmModel>,
) -> Result<Box<dyn Participant>, AssemblyError> {
    let task = config.build_task(model)?;
    let (body, scene, briefing, seed) = (config.setup.body, task.scene(), task.briefing(), config.seed);
    let style = config.method_entry(methods)?.info().style;
    let driven = JointSubset::of(style, &config.profile, model).map_err(ConfigError::from)?;
    let own: Vec<usize> = (0..model.arm_count()).filter(|&joint| !driven.contains(joint)).collect();
    Ok(match style {
        // Nothing to take: the hand, or the joints, to where the display shows.
        MethodStyle::Jogging if scene.objects.is_empty() => {
            Box::new(SteeringParticipant::new(options, body, scene.table_height, model.clone(), &own, seed))
        }
        MethodStyle::Jogging => {
            let person = JoggingParticipant::new(options, body, scene, briefing, model.clone(), seed);
            let person = person.with_limb(own);
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
            Box::new(person.with_limb(scene, model.clone(), own))
        }
        MethodStyle::Imitating => {
            Box::new(ImitatingParticipant::new(options, body, scene, briefing, model.clone(), seed))
        }
    })
}

/// A person's armband, and the model that was trained for it.
pub struct Armband<'a> {
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
pub fn live(config: TrialConfig) -> Result<Assembly, AssemblyError> {
    live_with(&MethodRegistry::standard(), &Arm::of(&config)?, config, None)
}

/// [`live`] with `methods` and `arm`, and with gestures from muscles if there is an armband.
///
/// # Errors
/// [`AssemblyError`]; settings of who or what has no part in the trial.
pub fn live_with(
    methods: &MethodRegistry,
    arm: &Arm,
    config: TrialConfig,
    armband: Option<Armband<'_>>,
) -> Result<Assembly, AssemblyError> {
    let mut config = config.live();
    if config.participant.is_some() {
        return Err(ConfigError::NoPart { key: "participant", why: "a person drives" }.into());
    }
    let (samples, classifier) = match armband {
        Some(Armband { trained, samples }) => {
            trained.check_settings(config.emg.get_or_insert_with(|| trained.config.clone()))?;
            config.centred_by(trained.centring.clone())?;
            config.gestures_from("armband")?;
            commands(&config, &trained.classifier)?;
            (Some(samples), Some(trained.classifier.clone()))
        }
        None => {
            if config.emg.is_some() {
                return Err(ConfigError::NoPart { key: "emg", why: "gestures come from keys" }.into());
            }
            config.gestures_from("keys")?;
            // Keys have no effort by which a person could be careful.
            if let JogProfile::Time { steps, .. } = &mut config.profile.jog {
                steps.get_or_insert(JogSteps::KEYS);
            }
            (None, None)
        }
    };
    let (testbed, plans) = testbed(methods, arm, config, classifier.clone())?;
    let session = Session::new(testbed, PersonParts { emg: samples, ..PersonParts::default() });
    Ok(Assembly { session, classifier, arm: arm.clone(), plans })
}

/// A live testbed and the synthetic armband that goes with it, without a person; `around` wraps the physics.
///
/// # Errors
/// [`AssemblyError`].
pub fn bare(
    config: TrialConfig,
    emg: &EmgOrigin,
    around: impl FnOnce(Box<dyn Plant>) -> Box<dyn Plant>,
) -> Result<(Testbed, EmgFeed), AssemblyError> {
    let mut config = config.live();
    let EmgSetup { classifier, feed, config: emg_config, label, .. } =
        proact_devices::prepare_with(emg, config.emg.as_ref(), config.seed)?;
    config.emg = Some(emg_config);
    config.gestures_from(&label)?;
    let feed = feed.with_commands(commands(&config, &classifier)?);
    let arm = Arm::of(&config)?;
    let plans = Box::new(planner(arm.model(), &config)?);
    let methods = MethodRegistry::standard();
    let process = process(&methods, &config, arm.model())?;
    let intent = intent_process::start(&config)?;
    let made = |model: &ArmModel, config: &TrialConfig| Ok(around(physics(model, config)?));
    let testbed = testbed_around(&methods, &arm, config, plans, Some(classifier), process, made)?;
    Ok((testbed.with_intent(intent), feed))
}

/// A testbed that takes its plans from the log.
///
/// # Errors
/// [`AssemblyError`].
pub fn replayed(
    methods: &MethodRegistry,
    arm: &Arm,
    config: TrialConfig,
    classifier: Option<Classifier>,
) -> Result<Testbed, AssemblyError> {
    testbed_around(methods, arm, config, Box::new(LoggedPlans), classifier, None, physics)
}

/// A testbed that takes its plans from the log, and plans that are computed again beside it.
///
/// # Errors
/// [`AssemblyError`].
pub fn replanned(
    methods: &MethodRegistry,
    arm: &Arm,
    config: TrialConfig,
    classifier: Option<Classifier>,
) -> Result<(Testbed, ComparedPlans), AssemblyError> {
    let worker = planner(arm.model(), &config)?;
    let plans = ComparedPlans { log: worker.log(), replies: Arc::default(), serve: Arc::default() };
    let asked = AskedAgain { worker, replies: plans.replies.clone(), serve: plans.serve.clone() };
    let testbed = testbed_around(methods, arm, config, Box::new(asked), classifier, None, physics)?;
    Ok((testbed, plans))
}

/// What the requests of a replay give now.
pub struct ComparedPlans {
    log: PlanLog,
    replies: Arc<Mutex<BTreeMap<u64, PlanReply>>>,
    /// Whether the testbed gets them.
    serve: Arc<AtomicBool>,
}

impl ComparedPlans {
    /// From now on the testbed gets these plans where the log has none: its requests are no longer those of the record.
    pub fn serve(&self) {
        self.serve.store(true, Ordering::Relaxed);
    }

    /// The reply to request `id` now, and whether a deadline ended it; none if it was not asked.
    pub fn reply(&self, id: u64) -> Option<(PlanReply, bool)> {
        let replies = self.replies.lock().unwrap_or_else(PoisonError::into_inner);
        let timed_out = self.log.entries().iter().any(|entry| entry.request == id && entry.timed_out);
        Some((replies.get(&id)?.clone(), timed_out))
    }
}

/// Plans every request at once and keeps the reply for later; the testbed takes the recorded one, until it is told to take these.
struct AskedAgain {
    worker: PlanWorker,
    replies: Arc<Mutex<BTreeMap<u64, PlanReply>>>,
    serve: Arc<AtomicBool>,
}

impl PlanService for AskedAgain {
    fn submit(&mut self, request: PlanRequest) {
        let id = request.id;
        self.worker.submit(request);
        let reply = self.worker.wait(id);
        self.replies.lock().unwrap_or_else(PoisonError::into_inner).insert(id, reply);
    }

    fn poll(&mut self, id: u64) -> Option<PlanReply> {
        let replies = self.replies.lock().unwrap_or_else(PoisonError::into_inner);
        self.serve.load(Ordering::Relaxed).then(|| replies.get(&id).cloned())?
    }

    /// A plan that the log should hold and does not, unless these are served: it was another trial.
    fn wait(&mut self, id: u64) -> PlanReply {
        self.poll(id).unwrap_or_else(|| LoggedPlans.wait(id))
    }

    fn cancel(&mut self) {}
}

/// OMPL over FCL with KDL's inverse kinematics, in a thread of its own, around the person of the set-up.
pub fn planner(model: &Arc<ArmModel>, config: &TrialConfig) -> Result<PlanWorker, AssemblyError> {
    let kinematics = Kinematics::new(model)?;
    let planner = ArmPlanner::new(model.clone(), Box::new(kinematics), config.planner.clone())?;
    // Who can lean sits; the still shoulder is that of somebody who stands.
    let seated = config.setup.body.forward_max_deg > 0.0;
    let person = if seated { Person::SEATED } else { Person::STANDING };
    let person = if model.side == Side::Left { person.mirrored() } else { person };
    let worker = PlanWorker::new(planner);
    // An arm that stands by itself has nobody behind its base; who sits beside it is out of its reach by the set-up.
    Ok(if model.settings.stand.is_some() { worker } else { worker.around(person) })
}

/// Physics with the arm at its start pose, an open hand, and the blocks of `scene`.
pub fn plant(
    model: &ArmModel,
    scene: &Scene,
    base: &Pose,
    physics: &PhysicsConfig,
) -> Result<Box<dyn Plant>, PlantError> {
    let pose = |group, name| model.pose(group, name).map_err(|error| PlantError::Model(error.to_string()));
    let initial: Vec<f64> = pose("arm", "start")?.iter().chain(pose("hand", "open")?).copied().collect();
    Ok(Box::new(OdePlant::new(model, scene, &initial, base, DynamicsOptions::of(physics))?))
}

/// The testbed of a trial that plans, and what its plans take.
fn testbed(
    methods: &MethodRegistry,
    arm: &Arm,
    config: TrialConfig,
    classifier: Option<Classifier>,
) -> Result<(Testbed, PlanLog), AssemblyError> {
    let worker = planner(arm.model(), &config)?;
    let plans = worker.log();
    let process = process(methods, &config, arm.model())?;
    let decoder = decoder(&config, classifier.as_ref())?;
    let intent = intent_process::start(&config)?;
    let testbed = testbed_around(methods, arm, config, Box::new(worker), classifier, process, physics)?;
    Ok((testbed.with_decoder(decoder).with_intent(intent), plans))
}

/// The process of the trial's method, started, if it has one.
fn process(
    methods: &MethodRegistry,
    config: &TrialConfig,
    model: &ArmModel,
) -> Result<Option<Box<dyn MethodProcess>>, AssemblyError> {
    Ok(method_process::start(&config.method_entry(methods)?, config.wait_for_plans, model)?)
}

/// The process that decodes the trial's EMG, started, if one does.
pub(crate) fn decoder(
    config: &TrialConfig,
    classifier: Option<&Classifier>,
) -> Result<Option<Box<dyn DecoderProcess>>, AssemblyError> {
    let (Some(emg), Some(classifier)) = (&config.emg, classifier) else { return Ok(None) };
    match ProcessDecoder::start(emg, classifier, config.wait_for_plans) {
        // As with a method: a simulated trial has it in its record, so that a batch lists it and goes on.
        Err(error) if config.wait_for_plans => Ok(Some(Box::new(NoDecoder(error.to_string())))),
        started => Ok(started?.map(|process| -> Box<dyn DecoderProcess> { Box::new(process) })),
    }
}

/// Stands for a process that does not start, with the reason.
struct NoDecoder(String);

impl DecoderProcess for NoDecoder {
    fn ask(&mut self, _window: u64, _line: &str) -> WindowAnswer {
        WindowAnswer::Failed(self.0.clone())
    }
}

/// The physics of a trial.
fn physics(model: &ArmModel, config: &TrialConfig) -> Result<Box<dyn Plant>, AssemblyError> {
    let base = config.setup.body.shoulder_pose(&Default::default());
    Ok(plant(model, config.build_task(model)?.scene(), &base, &config.physics)?)
}

fn testbed_around(
    methods: &MethodRegistry,
    arm: &Arm,
    config: TrialConfig,
    plans: Box<dyn PlanService>,
    classifier: Option<Classifier>,
    process: Option<Box<dyn MethodProcess>>,
    world: impl FnOnce(&ArmModel, &TrialConfig) -> Result<Box<dyn Plant>, AssemblyError>,
) -> Result<Testbed, AssemblyError> {
    let mut config = config;
    arm.rename(&mut config);
    let model = arm.model();
    let parts = Parts {
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
