//! Putting a trial together: which library does what.

use crate::method_process;
use proact_arm::ArmModel;
use proact_control::{JointSubset, ports::MethodProcess};
use proact_devices::{EmgFeed, EmgSetup, EmgSource, GazeSource};
use proact_dynamics::{DynamicsOptions, OdePlant};
use proact_emg::{Classifier, EmgModel};
use proact_kinematics::Kinematics;
use proact_participants::{JoggingParticipant, Participant, ParticipantOptions, SelectingParticipant};
use proact_planning::{ArmPlanner, Person, PlanLog, PlanWorker, PlannerOptions};
use proact_tasks::BoxAndBlocks;
use proact_testbed::{
    ConfigError, LoggedPlans, MethodName, Parts, PersonParts, PhysicsConfig, Session, Testbed, TestbedError,
    TrialConfig,
    ports::{EmgSource as EmgPort, PlanService, Plant, PlantError},
};
use proact_types::{PlanReply, PlanRequest, Pose, Scene};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Error of the eye tracker, degrees (paper: "within a 1.5 degree error").
pub const GAZE_ERROR_DEG: f64 = 1.5;

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
    /// Planner.
    #[error("planner: {0}")]
    Planning(#[from] proact_planning::PlanningError),
    /// Physics.
    #[error("physics: {0}")]
    Plant(#[from] PlantError),
    /// The process of the control method.
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
    pub model: Arc<ArmModel>,
    /// What its plans took.
    pub plans: PlanLog,
}

/// A trial with a simulated participant whose gestures come through `emg`.
///
/// # Errors
/// [`AssemblyError`].
pub fn simulated(config: TrialConfig, emg: &EmgSource) -> Result<Assembly, AssemblyError> {
    simulated_with(config, emg, None)
}

/// [`simulated`] with a model that was trained before, if one is given.
///
/// # Errors
/// [`AssemblyError`]; a model that does not fit the EMG says why.
pub fn simulated_with(
    mut config: TrialConfig,
    emg: &EmgSource,
    trained: Option<&EmgModel>,
) -> Result<Assembly, AssemblyError> {
    let EmgSetup { classifier, feed, config: emg_config, centring, label } = match trained {
        Some(model) => proact_devices::prepare_model(emg, model, config.seed)?,
        None => proact_devices::prepare(emg, config.seed)?,
    };
    config.emg = Some(emg_config);
    config.emg_centring = centring;
    config.gesture_source = label;
    let options = *config.participant.get_or_insert_with(ParticipantOptions::default);
    let model = Arc::new(proact_description::mpl_right_arm());
    let participant = participant(&config, options, &model)?;
    let gaze = GazeSource::new(GAZE_ERROR_DEG, config.seed)?;
    let worker = planner(&model, &config)?;
    let plans = worker.log();
    let testbed = testbed(config, &model, Box::new(worker), Some(classifier.clone()))?;
    let session = Session::new(
        testbed,
        PersonParts { participant: Some(participant), emg: Some(Box::new(feed)), gaze: Some(Box::new(gaze)) },
    );
    Ok(Assembly { session, classifier: Some(classifier), model, plans })
}

/// The simulated participant of a trial.
///
/// # Errors
/// A profile whose joints do not fit the arm.
pub fn participant(
    config: &TrialConfig,
    options: ParticipantOptions,
    model: &Arc<ArmModel>,
) -> Result<Box<dyn Participant>, AssemblyError> {
    let task = BoxAndBlocks::new(config.arrangement);
    let (body, scene, seed) = (config.setup.body, task.scene(), config.seed);
    Ok(match config.method {
        MethodName::A | MethodName::B => {
            let driven = JointSubset::new(&config.profile, model).map_err(ConfigError::from)?;
            let own = (0..model.arm_count()).filter(|&joint| !driven.contains(joint)).collect();
            Box::new(JoggingParticipant::new(options, body, scene, model.clone(), seed).with_limb(own))
        }
        MethodName::C | MethodName::D => Box::new(SelectingParticipant::new(options, body, scene, seed)),
    })
}

/// A trial that a person at the page drives: gestures from keys, gaze from the mouse.
///
/// # Errors
/// [`AssemblyError`].
pub fn live(mut config: TrialConfig) -> Result<Assembly, AssemblyError> {
    config.emg = None;
    config.gesture_source = "keys".to_owned();
    config.wait_for_plans = false;
    let model = Arc::new(proact_description::mpl_right_arm());
    let worker = planner(&model, &config)?;
    let plans = worker.log();
    let testbed = testbed(config, &model, Box::new(worker), None)?;
    let session = Session::new(testbed, PersonParts::default());
    Ok(Assembly { session, classifier: None, model, plans })
}

/// A live testbed and the synthetic armband that goes with it, without a person; `around` wraps the physics.
///
/// # Errors
/// [`AssemblyError`].
pub fn bare(
    mut config: TrialConfig,
    emg: &EmgSource,
    around: impl FnOnce(Box<dyn Plant>) -> Box<dyn Plant>,
) -> Result<(Testbed, EmgFeed), AssemblyError> {
    let EmgSetup { classifier, feed, config: emg_config, label, .. } =
        proact_devices::prepare(emg, config.seed)?;
    config.emg = Some(emg_config);
    config.gesture_source = label;
    config.wait_for_plans = false;
    let model = Arc::new(proact_description::mpl_right_arm());
    let plans = Box::new(planner(&model, &config)?);
    let process = method_process::start(&config)?;
    Ok((testbed_around(config, &model, plans, Some(classifier), process, around)?, feed))
}

/// A trial that a person with an armband drives: gestures from muscles, gaze from the mouse.
///
/// # Errors
/// [`AssemblyError`].
pub fn live_with_armband(
    mut config: TrialConfig,
    trained: &EmgModel,
    armband: Box<dyn EmgPort>,
) -> Result<Assembly, AssemblyError> {
    config.emg = Some(trained.config.clone());
    config.emg_centring = trained.centring.clone();
    config.gesture_source = "armband".to_owned();
    config.wait_for_plans = false;
    let model = Arc::new(proact_description::mpl_right_arm());
    let worker = planner(&model, &config)?;
    let plans = worker.log();
    let classifier = Some(trained.classifier.clone());
    let testbed = testbed(config, &model, Box::new(worker), classifier.clone())?;
    let session = Session::new(testbed, PersonParts { emg: Some(armband), ..PersonParts::default() });
    Ok(Assembly { session, classifier, model, plans })
}

/// A testbed that takes its plans from the log.
///
/// # Errors
/// [`AssemblyError`].
pub fn replayed(config: TrialConfig, classifier: Option<Classifier>) -> Result<Testbed, AssemblyError> {
    let model = Arc::new(proact_description::mpl_right_arm());
    testbed_around(config, &model, Box::new(LoggedPlans), classifier, None, |plant| plant)
}

/// A testbed that takes its plans from the log, and plans that are computed again beside it.
///
/// # Errors
/// [`AssemblyError`].
pub fn replanned(
    config: TrialConfig,
    classifier: Option<Classifier>,
) -> Result<(Testbed, ComparedPlans), AssemblyError> {
    let model = Arc::new(proact_description::mpl_right_arm());
    let worker = planner(&model, &config)?;
    let plans = ComparedPlans { log: worker.log(), replies: Arc::default() };
    let asked = AskedAgain { worker, replies: plans.replies.clone() };
    let testbed = testbed_around(config, &model, Box::new(asked), classifier, None, |plant| plant)?;
    Ok((testbed, plans))
}

/// What the requests of a replay give now.
pub struct ComparedPlans {
    log: PlanLog,
    replies: Arc<Mutex<BTreeMap<u64, PlanReply>>>,
}

impl ComparedPlans {
    /// The reply to request `id` now, and whether a deadline ended it; none if it was not asked.
    pub fn reply(&self, id: u64) -> Option<(PlanReply, bool)> {
        let replies = self.replies.lock().unwrap_or_else(PoisonError::into_inner);
        let timed_out = self.log.entries().iter().any(|entry| entry.request == id && entry.timed_out);
        Some((replies.get(&id)?.clone(), timed_out))
    }
}

/// Plans every request at once and keeps the reply for later; the testbed takes the recorded one.
struct AskedAgain {
    worker: PlanWorker,
    replies: Arc<Mutex<BTreeMap<u64, PlanReply>>>,
}

impl PlanService for AskedAgain {
    fn submit(&mut self, request: PlanRequest) {
        let id = request.id;
        self.worker.submit(request);
        let reply = self.worker.wait(id);
        self.replies.lock().unwrap_or_else(PoisonError::into_inner).insert(id, reply);
    }

    fn poll(&mut self, _id: u64) -> Option<PlanReply> {
        None
    }

    /// A plan that the log should hold and does not: it was another trial.
    fn wait(&mut self, id: u64) -> PlanReply {
        LoggedPlans.wait(id)
    }

    fn cancel(&mut self) {}
}

/// Time within which a plan is there while a person waits, seconds: twice what the original gave one attempt.
const LIVE_DEADLINE_SECS: f64 = 1.0;

/// OMPL over FCL with KDL's inverse kinematics, in a thread of its own, around the person of the set-up. Bounded by
/// iterations where the trial waits for its plans, and by the clock as well where a person does.
pub fn planner(model: &Arc<ArmModel>, config: &TrialConfig) -> Result<PlanWorker, AssemblyError> {
    let kinematics = Kinematics::new(model)?;
    let deadline_secs = (!config.wait_for_plans).then_some(LIVE_DEADLINE_SECS);
    let options = PlannerOptions { deadline_secs, ..PlannerOptions::default() };
    let planner = ArmPlanner::new(model.clone(), Box::new(kinematics), options)?;
    // Who can lean sits; the still shoulder is that of somebody who stands.
    let seated = config.setup.body.forward_max_deg > 0.0;
    Ok(PlanWorker::new(planner).around(if seated { Person::SEATED } else { Person::STANDING }))
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

fn testbed(
    config: TrialConfig,
    model: &Arc<ArmModel>,
    plans: Box<dyn PlanService>,
    classifier: Option<Classifier>,
) -> Result<Testbed, AssemblyError> {
    let process = method_process::start(&config)?;
    testbed_around(config, model, plans, classifier, process, |plant| plant)
}

fn testbed_around(
    config: TrialConfig,
    model: &Arc<ArmModel>,
    plans: Box<dyn PlanService>,
    classifier: Option<Classifier>,
    process: Option<Box<dyn MethodProcess>>,
    around: impl FnOnce(Box<dyn Plant>) -> Box<dyn Plant>,
) -> Result<Testbed, AssemblyError> {
    let task = BoxAndBlocks::new(config.arrangement);
    let base = config.setup.body.shoulder_pose(&Default::default());
    let parts = Parts {
        model: model.clone(),
        kinematics: Box::new(Kinematics::new(model)?),
        plant: around(plant(model, task.scene(), &base, &config.physics)?),
        plans,
        classifier,
        process,
    };
    Ok(Testbed::new(config, parts)?)
}
