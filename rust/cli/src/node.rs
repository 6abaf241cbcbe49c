//! `proact node`: stages as nodes on a ROS 1 graph.

use crate::{rosbridge_args::RosbridgeArgs, trial_args::TrialArgs};
use clap::{Args, ValueEnum};
use proact_app::Registry;
use proact_devices::SourceName;
use std::{error::Error, path::PathBuf};

/// Arguments of `proact node`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  proact node testbed --method D --seed 3\n  \
    proact node sim _paused:=true\n  proact node sim __ns:=left emg:=/other/emg\n  \
    proact node emg --model arm.json --emg-source ble\n  proact node sim _exclude_frames:=Shoulderpad,hololens_world_test\n\n\
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
    /// emg: an armband of one's own, whose samples the node publishes: gforce-sim://HOST:PORT, ble, ble:NAME, lsl, lsl:NAME,
    /// file:PATH, synthetic or person:FOLDER; by default the samples that other nodes publish
    #[arg(long, value_name = "SOURCE", requires = "emg_model")]
    emg_source: Option<SourceName>,
    /// emg: the model of the armband, as `proact emg train` writes it; by default one of the synthetic armband
    #[arg(long, visible_alias = "model", value_name = "FILE")]
    emg_model: Option<PathBuf>,
    #[command(flatten)]
    rosbridge: RosbridgeArgs,
    /// roslaunch's words, such as __name:=arm or _rate_hz:=50
    #[arg(value_name = "NAME:=VALUE", value_parser = parse_ros_argument)]
    ros_arguments: Vec<String>,
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
fn parse_ros_argument(text: &str) -> Result<String, String> {
    if text.contains(":=") {
        Ok(text.to_owned())
    } else {
        Err("expected NAME:=VALUE as roslaunch gives it".to_owned())
    }
}

/// Runs the node until the graph ends it.
#[cfg(not(feature = "ros"))]
pub(crate) fn command(_registry: &Registry, args: &NodeArgs) -> Result<bool, Box<dyn Error>> {
    // The launcher builds what the node needs; only the bare program of another build gets here.
    Err(format!("node {:?} cannot run: {}", args.name, proact_app::NO_ROS).into())
}

/// Runs the node until the graph ends it.
#[cfg(feature = "ros")]
pub(crate) fn command(registry: &Registry, args: &NodeArgs) -> Result<bool, Box<dyn Error>> {
    use proact_app::{LiveArmband, emg_model_file, nodes};
    // In real time a plan that is late takes effect when it comes; in lock-step it is waited for.
    let lockstep = args.ros_arguments.iter().any(|word| word == "_lockstep:=true");
    if args.emg_model.is_some() && args.name != NodeName::Emg {
        return Err("--emg-model is for the node emg, which alone reads muscles; leave it out here".into());
    }
    if args.emg_source.is_some() && lockstep {
        return Err("an armband keeps real time: --emg-source and _lockstep:=true do not go together".into());
    }
    let (armband, trained) = match (&args.emg_source, &args.emg_model) {
        (Some(source), Some(model)) => {
            let armband = LiveArmband::open(&registry.sources, source, model)?;
            let trained = armband.model().clone();
            (Some(armband), Some(trained))
        }
        (_, Some(model)) => {
            let mut trained = emg_model_file::read_model_file(model)?;
            // Where another node's samples end is not known.
            trained.config.liveness = trained.liveness(None);
            (None, Some(trained))
        }
        _ => (None, None),
    };
    let settings = trained.as_ref().map(|model| model.config.clone());
    let (arm, config) = args.trial.config(&registry.methods, "seated", settings)?;
    let config = if lockstep { config } else { config.for_live_trial() };
    match args.name {
        NodeName::Sim => nodes::sim(&arm, config)?,
        NodeName::Testbed => {
            let result = nodes::testbed(&registry.methods, &arm, config, args.live)?;
            proact_app::print_result_json(&result)?;
        }
        NodeName::Emg => nodes::emg(config, trained.as_ref(), armband)?,
        NodeName::Intent => nodes::intent(&registry.methods, &arm, &config)?,
        NodeName::Method => nodes::method(&registry.methods, &arm, &config)?,
        NodeName::Task => nodes::task(&arm, config)?,
        NodeName::Participant => nodes::participant(&registry.methods, &arm, &config)?,
        NodeName::Rosbridge => args.rosbridge.relay()?,
        NodeName::Meter => proact_app::print_result_json(&nodes::meter()?)?,
    }
    Ok(true)
}
