use crate::{
    announce::print_trial_result, interrupt::interrupt_flag, served_page::ServedPageArgs,
    trial_args::TrialArgs, user_device_args::UserDeviceArgs,
};
use clap::{Args, Parser};
use proact_app::{
    LiveArmband, LiveTrial, LiveTrialEnd, Recorder, Registry, ResultCards, UserDevices, default_dir,
    driven_page_content, print_status,
    trial::{self, Assembly, TrainedArmband},
    usage_log::{LoggedInputs, UsageLog},
};
use proact_bridge::{PageContent, PageServer};
use proact_devices::SourceName;
use proact_intent::GazeOffset;
use proact_types::{Gesture, MethodStyle};
use std::{error::Error, path::PathBuf, sync::atomic::AtomicBool};

/// Arguments of `proact serve`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  proact serve\n  proact serve --setup seated --port 8100\n  \
    proact serve --rosbridge --rosbridge-allow 192.168.1.20\n  \
    proact serve --headset\n  \
    proact serve --mocap vrpn:192.168.1.5/Shoulderpad\n  \
    proact serve --bind 0.0.0.0 --token-file ~/.proact_token --host-name testbed.example.org\n\n\
    Mouse is gaze; keys are gestures and are shown on the page. Time begins with the first action at the page. \
    R starts a new trial. Ctrl-C ends.")]
pub(crate) struct ServeArgs {
    #[command(flatten)]
    trial: TrialArgs,
    #[command(flatten)]
    page: ServedPageArgs,
    /// Folder for the records of the trials
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Do not record
    #[arg(long, conflicts_with = "out")]
    no_record: bool,
    /// Gestures from an armband instead of keys: gforce-sim://HOST:PORT, ble, ble:NAME, myo, myo:NAME, lsl, lsl:NAME, file:PATH,
    /// synthetic, person:FOLDER or keys
    #[arg(long, value_name = "SOURCE", requires = "emg_model")]
    emg_source: Option<SourceName>,
    /// Model of the armband, as `proact emg train` writes it
    #[arg(long, value_name = "FILE", requires = "emg_source")]
    emg_model: Option<PathBuf>,
    /// Log of use: a line of JSON is added for each minute of use and at the end; `proact emg usage FILE` adds them up
    #[arg(long, value_name = "FILE")]
    usage_log: Option<PathBuf>,
    #[command(flatten)]
    user_devices: UserDeviceArgs,
}

pub(crate) fn command(registry: &Registry, args: &ServeArgs) -> Result<bool, Box<dyn Error>> {
    let interrupted = interrupt_flag()?;
    run_trials(registry, args, None, ResultCards::default(), &interrupted)
}

/// As after `proact serve` without other words than those of `trial`.
pub(crate) fn serve_after_demo(
    registry: &Registry,
    trial: TrialArgs,
    record: bool,
    server: PageServer,
    results: ResultCards,
    interrupted: &AtomicBool,
) -> Result<bool, Box<dyn Error>> {
    #[derive(Parser)]
    struct ServeCli {
        #[command(flatten)]
        args: ServeArgs,
    }
    let mut args = ServeCli::try_parse_from(["serve"])?.args;
    (args.trial, args.no_record) = (trial, !record);
    run_trials(registry, &args, Some(server), results, interrupted)
}

/// Trial after trial by the person at the page, on `server` if it is up already.
fn run_trials(
    registry: &Registry,
    args: &ServeArgs,
    mut server: Option<PageServer>,
    mut results: ResultCards,
    interrupted: &AtomicBool,
) -> Result<bool, Box<dyn Error>> {
    let mut trial_args = args.trial.clone();
    let armband = match (&args.emg_source, &args.emg_model) {
        (Some(source), Some(model)) => Some(LiveArmband::open(&registry.sources, source, model)?),
        _ => None,
    };
    let mut log = UsageLog::open_if_given(args.usage_log.as_deref())?;
    let rest = armband.as_ref().map_or(Gesture::default(), |armband| armband.model().config.rest);
    let mut gaze_offset = GazeOffset::default();
    let mut person: Option<UserDevices> = None;
    let mut before: Option<TrialArgs> = None;
    let mut refused = None;
    loop {
        let assembled = match assemble(registry, args, &trial_args, armband.as_ref()) {
            Ok(assembled) => assembled,
            // What the page chose is no reason to end: the choice before it has begun once.
            Err(error) => {
                let Some(good) = before.take() else { return Err(error) };
                let reason = format!("This trial cannot begin: {error}. The method before goes on.");
                print_status(&reason);
                refused = Some(reason);
                trial_args = good;
                continue;
            }
        };
        let Assembly { trial: running_trial, classifier, plans, arm, .. } = assembled;
        let config = running_trial.testbed().config().clone();
        let seed = config.seed;
        let dir = match (&args.out, args.no_record) {
            (_, true) => None,
            (Some(out), _) => Some(unused_dir(out.join(format!("seed{seed}")))),
            (None, _) => Some(default_dir(&config)),
        };
        let recorder = match &dir {
            Some(dir) => Some(Recorder::create(dir, &config, &arm, classifier.as_ref())?.with_plans(plans)?),
            None => None,
        };
        // What the page offers must be able to begin.
        let mut methods = registry.methods.compatible_methods(&config.profile, arm.model());
        let led = args.user_devices.tracks_limb();
        methods
            .retain(|method| led || method.style != MethodStyle::Imitating || method.name == config.method);
        let content = PageContent { methods, ..driven_page_content(running_trial.testbed(), &arm) };
        let page = match &mut server {
            Some(server) => {
                server.set_content(content)?;
                server
            }
            none => none.insert(args.page.start(
                &args.user_devices.rosbridge.access,
                args.user_devices.mocap.shoulder_controller(),
                content,
            )?),
        };
        let person = match &mut person {
            Some(person) => {
                person.restart(&running_trial)?;
                person
            }
            none => none.insert(args.user_devices.open(registry, &running_trial)?),
        };
        let page: &PageServer = page;
        page.set_start_error(refused.take());
        let mut inputs = LoggedInputs { page, log: log.as_mut(), rest };
        let mut trial = LiveTrial {
            trial: running_trial,
            recorder,
            dir,
            page,
            inputs: &mut inputs,
            devices: person,
            gaze_offset: &mut gaze_offset,
            results: Some(&mut results),
            interrupted,
        };
        let (mut ended, result) = trial.run()?;
        print_trial_result(&result)?;
        if matches!(ended, LiveTrialEnd::Finished | LiveTrialEnd::Aborted) {
            ended = trial.wait_for_restart()?;
        }
        let LiveTrialEnd::Restart { method: wanted, same_arrangement: again } = ended else { break };
        before = Some(trial_args.clone());
        trial_args = trial_args.next_trial(wanted, again);
    }
    Ok(true)
}

/// The trial that is asked for, with the armband if one is worn.
fn assemble(
    registry: &Registry,
    args: &ServeArgs,
    trial_args: &TrialArgs,
    armband: Option<&LiveArmband>,
) -> Result<Assembly, Box<dyn Error>> {
    let emg = armband.map(|armband| armband.model().config.clone());
    let (arm, mut config) = trial_args.config(&registry.methods, "still", emg)?;
    args.user_devices.mocap.load_calibrations(registry)?.place_person(&mut config.setup);
    let worn = match armband {
        Some(armband) => {
            let trained = armband.model();
            let commands = config.command_map(trained.config.rest, &trained.classifier)?;
            Some(TrainedArmband { trained, samples: armband.new_port(commands) })
        }
        None => None,
    };
    Ok(trial::live_trial_with_armband(&registry.methods, &arm, config, worn)?)
}

/// `dir`, or the same with a number added if it is taken: the same blocks again are another trial.
pub(crate) fn unused_dir(dir: PathBuf) -> PathBuf {
    let numbered = |k: u32| PathBuf::from(format!("{}-{k}", dir.display()));
    let names = std::iter::once(dir.clone()).chain((2..).map(numbered));
    names.into_iter().find(|name| !name.exists()).unwrap_or(dir)
}
