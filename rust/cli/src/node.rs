//! `proact node`: stages as nodes on a ROS 1 graph.

use crate::{rosbridge::RosbridgeArgs, trial_args::TrialArgs};
use clap::{Args, ValueEnum};

/// Arguments of `proact node`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  proact node testbed --method D --seed 3\n  \
    proact node sim _paused:=true\n  proact node sim __ns:=left emg:=/other/emg\n\n\
    Words with := are roslaunch's: remaps, __name, __ns and private parameters. docs/ros1.md lists topics, \
    services and parameters. Needs a build with the feature ros.")]
pub(crate) struct NodeArgs {
    /// Which node
    name: NodeName,
    #[command(flatten)]
    trial: TrialArgs,
    /// testbed: no simulated participant; /emg, /gaze_position and /gaze_direction come from other nodes
    #[arg(long)]
    live: bool,
    #[command(flatten)]
    rosbridge: RosbridgeArgs,
    /// roslaunch's words, such as __name:=arm or _rate:=50
    #[arg(value_name = "NAME:=VALUE", value_parser = ros_word)]
    words: Vec<String>,
}

/// The nodes there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum NodeName {
    /// The whole testbed
    Testbed,
    /// Arm, box and blocks with the controllers of ros_control and the services of Gazebo
    Sim,
    /// Samples of an armband to gestures
    Emg,
    /// Gaze and blocks to the block and the place that are meant
    Intent,
    /// Gestures and what is meant to commands for arm and hand
    Method,
    /// The task and the display over a Gazebo of one's own, in the place of sim
    Task,
    /// A simulated person with armband and eye tracker
    Participant,
    /// rosbridge for browsers, roslibpy and the original headset app; --rosbridge PORT or _port:=PORT, else 9090
    Rosbridge,
    /// What `proact bench ros` measures with
    #[value(hide = true)]
    Meter,
}

/// Only roslaunch's words pass; rosrust reads them from the command line itself.
fn ros_word(text: &str) -> Result<String, String> {
    if text.contains(":=") {
        Ok(text.to_owned())
    } else {
        Err("expected NAME:=VALUE as roslaunch gives it".to_owned())
    }
}

#[cfg(not(feature = "ros"))]
pub(crate) fn command(args: &NodeArgs) -> Result<bool, Box<dyn std::error::Error>> {
    // The launcher builds what the node needs; only the bare program of another build gets here.
    Err(format!("node {:?} cannot run: {NO_ROS}", args.name).into())
}

/// What a build without the feature says.
#[cfg(not(feature = "ros"))]
pub(crate) const NO_ROS: &str = "this build knows no ROS; build it with: cargo build --release -p proact-cli --features ros \
                                 (docs/ros1.md names the packages that this needs)";

#[cfg(feature = "ros")]
pub(crate) use on_graph::command;

#[cfg(feature = "ros")]
mod on_graph {
    use super::{NodeArgs, NodeName};
    use crate::{method_process, trial};
    use proact_devices::{EmgSource, GazeSource};
    use proact_kinematics::Kinematics;
    use proact_ros::node::{self, IntentParts, MethodParts, ParticipantParts, SimParts, TaskParts};
    use proact_tasks::BoxAndBlocks;
    use proact_testbed::{
        PersonParts, TrialConfig,
        stages::{EmgStage, IntentStage, MethodStage, PersonStage},
    };
    use proact_types::SimTime;
    use std::{error::Error, sync::Arc};

    pub(crate) fn command(args: &NodeArgs) -> Result<bool, Box<dyn Error>> {
        let config = args.trial.config("seated")?;
        // In real time a plan that is late takes effect when it comes; in lock-step it is waited for.
        let wait_for_plans = args.words.iter().any(|word| word == "_lockstep:=true");
        let config = TrialConfig { wait_for_plans, ..config };
        let model = Arc::new(proact_description::mpl_right_arm());
        match args.name {
            NodeName::Sim => {
                let base = config.setup.body.shoulder_pose(&Default::default());
                let task = task(&config);
                let (arm, scene, physics) = (model.clone(), task.scene().clone(), config.physics);
                let factory = Box::new(move || trial::plant(&arm, &scene, &base, &physics));
                let kinematics = Box::new(Kinematics::new(&model)?);
                node::run_sim(SimParts { config, model, task, factory, kinematics })?;
            }
            NodeName::Testbed => {
                let live = args.live;
                let config = TrialConfig { wait_for_plans: false, ..config };
                let assembly = if live {
                    trial::live(config)?
                } else {
                    trial::simulated(config, &EmgSource::Synthetic)?
                };
                let result = node::run_testbed(assembly.session, !live)?;
                println!("{}", serde_json::to_string(&result)?);
            }
            NodeName::Emg => {
                let setup = proact_devices::prepare(&EmgSource::Synthetic, config.seed)?;
                let config = TrialConfig { emg: Some(setup.config), emg_centring: setup.centring, ..config };
                node::run_emg(EmgStage::new(&config, Some(setup.classifier))?)?;
            }
            NodeName::Intent => {
                let stage = IntentStage::new(&config, model.clone())?;
                let kinematics = Box::new(Kinematics::new(&model)?);
                node::run_intent(IntentParts { stage, kinematics, moving: model.moving_count() })?;
            }
            NodeName::Method => {
                let kinematics = Box::new(Kinematics::new(&model)?);
                let plans = Box::new(trial::planner(&model, &config)?);
                let (scene, process) = (task(&config).scene().clone(), method_process::start(&config)?);
                let stage = MethodStage::new(&config, model.clone(), scene, plans, process)?;
                node::run_method(MethodParts { stage, method: config.method, model, kinematics })?;
            }
            NodeName::Task => {
                let (task, kinematics) = (task(&config), Box::new(Kinematics::new(&model)?));
                node::run_task(TaskParts { config, model, task, kinematics })?;
            }
            NodeName::Participant => {
                let options = config.participant.unwrap_or_default();
                let person = PersonParts {
                    participant: Some(trial::participant(&config, options, &model)?),
                    emg: Some(Box::new(proact_devices::prepare(&EmgSource::Synthetic, config.seed)?.feed)),
                    gaze: Some(Box::new(GazeSource::new(trial::GAZE_ERROR_DEG, config.seed)?)),
                };
                let stage = PersonStage::new(person, config.setup.body, model.arm_count());
                let joints = (model.arm_count(), model.moving_count());
                node::run_participant(ParticipantParts { stage, joints })?;
            }
            NodeName::Rosbridge => args.rosbridge.relay()?,
            NodeName::Meter => println!("{}", serde_json::to_string(&node::run_meter()?)?),
        }
        Ok(true)
    }

    fn task(config: &TrialConfig) -> BoxAndBlocks {
        BoxAndBlocks::new(config.arrangement).with_limit(SimTime::from_secs(config.limit_secs))
    }
}
