use crate::{
    announce::print_result, interrupt::interrupt_flag, person_args::PersonArgs, served_page::ServedPageArgs,
    trial_args::TrialArgs,
};
use clap::{Args, Parser};
use proact_app::{
    Ended, LiveArmband, LivePerson, LiveTrial, Recorder, Registry, ResultCards, default_dir, driven_content,
    tell,
    trial::{self, Armband, Assembly},
    use_log::{LoggedInputs, UseLog},
};
use proact_bridge::{PageContent, PageServer};
use proact_devices::SourceName;
use proact_intent::GazeOffset;
use proact_types::{GestureName, MethodStyle};
use std::{error::Error, path::PathBuf, sync::atomic::AtomicBool};

/// Arguments of `proact serve`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  proact serve\n  proact serve --setup seated --port 8100\n  \
    proact serve --rosbridge --allow 192.168.1.20\n  \
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
    /// Log of use: a line of JSON is added for each minute of use and at the end; `proact emg use FILE` adds them up
    #[arg(long, value_name = "FILE")]
    use_log: Option<PathBuf>,
    #[command(flatten)]
    person: PersonArgs,
}

pub(crate) fn command(registry: &Registry, args: &ServeArgs) -> Result<bool, Box<dyn Error>> {
    let interrupted = interrupt_flag()?;
    drive(registry, args, None, ResultCards::default(), &interrupted)
}

/// As after `proact serve` without other words than those of `trial`.
pub(crate) fn after_demo(
    registry: &Registry,
    trial: TrialArgs,
    record: bool,
    server: PageServer,
    results: ResultCards,
    interrupted: &AtomicBool,
) -> Result<bool, Box<dyn Error>> {
    #[derive(Parser)]
    struct Alone {
        #[command(flatten)]
        args: ServeArgs,
    }
    let mut args = Alone::try_parse_from(["serve"])?.args;
    (args.trial, args.no_record) = (trial, !record);
    drive(registry, &args, Some(server), results, interrupted)
}

/// Trial after trial by the person at the page, on `server` if it is up already.
fn drive(
    registry: &Registry,
    args: &ServeArgs,
    mut server: Option<PageServer>,
    mut results: ResultCards,
    interrupted: &AtomicBool,
) -> Result<bool, Box<dyn Error>> {
    let mut asked = args.trial.clone();
    let armband = match (&args.emg_source, &args.emg_model) {
        (Some(source), Some(model)) => Some(LiveArmband::open(&registry.sources, source, model)?),
        _ => None,
    };
    let mut log = UseLog::asked(args.use_log.as_deref())?;
    let rest = armband.as_ref().map_or(GestureName::default(), |armband| armband.model().config.rest);
    let mut gaze_offset = GazeOffset::default();
    let mut person: Option<LivePerson> = None;
    let mut before: Option<TrialArgs> = None;
    let mut refused = None;
    loop {
        let assembled = match assemble(registry, args, &asked, armband.as_ref()) {
            Ok(assembled) => assembled,
            // What the page chose is no reason to end: the choice before it has begun once.
            Err(error) => {
                let Some(good) = before.take() else { return Err(error) };
                let reason = format!("This trial cannot begin: {error}. The method before goes on.");
                tell(&reason);
                refused = Some(reason);
                asked = good;
                continue;
            }
        };
        let Assembly { session, classifier, plans, arm, .. } = assembled;
        let config = session.testbed().config().clone();
        let seed = config.seed;
        let dir = match (&args.out, args.no_record) {
            (_, true) => None,
            (Some(out), _) => Some(free_dir(out.join(format!("seed{seed}")))),
            (None, _) => Some(default_dir(&config)),
        };
        let recorder = match &dir {
            Some(dir) => Some(Recorder::create(dir, &config, &arm, classifier.as_ref())?.with_plans(plans)?),
            None => None,
        };
        // What the page offers must be able to begin.
        let mut methods = registry.methods.fitting(&config.profile, arm.model());
        let led = args.person.follows_limb();
        methods
            .retain(|method| led || method.style != MethodStyle::Imitating || method.name == config.method);
        let content = PageContent { methods, ..driven_content(session.testbed(), &arm) };
        let page = match &mut server {
            Some(server) => {
                server.set_content(content)?;
                server
            }
            none => none.insert(args.page.start(
                &args.person.rosbridge.access,
                args.person.mocap.controller(),
                content,
            )?),
        };
        let person = match &mut person {
            Some(person) => {
                person.restart(&session)?;
                person
            }
            none => none.insert(args.person.open(registry, &session)?),
        };
        let page: &PageServer = page;
        page.set_refused(refused.take());
        let mut inputs = LoggedInputs { page, log: log.as_mut(), rest };
        let mut trial = LiveTrial {
            session,
            recorder,
            dir,
            page,
            inputs: &mut inputs,
            person,
            gaze_offset: &mut gaze_offset,
            results: Some(&mut results),
            interrupted,
        };
        let (mut ended, result) = trial.run()?;
        print_result(&result)?;
        if matches!(ended, Ended::Finished | Ended::Aborted) {
            ended = trial.wait_for_restart()?;
        }
        let Ended::Restart { method: wanted, again } = ended else { break };
        before = Some(asked.clone());
        asked = asked.next(wanted, again);
    }
    Ok(true)
}

/// The trial that is asked for, with the armband if one is worn.
fn assemble(
    registry: &Registry,
    args: &ServeArgs,
    asked: &TrialArgs,
    armband: Option<&LiveArmband>,
) -> Result<Assembly, Box<dyn Error>> {
    let emg = armband.map(|armband| armband.model().config.clone());
    let (arm, mut config) = asked.config(&registry.methods, "still", emg)?;
    args.person.mocap.used(registry)?.seat(&mut config.setup);
    let worn = match armband {
        Some(armband) => {
            let trained = armband.model();
            let commands = config.gesture_commands(trained.config.rest, &trained.classifier)?;
            Some(Armband { trained, samples: armband.port(commands) })
        }
        None => None,
    };
    Ok(trial::live_with(&registry.methods, &arm, config, worn)?)
}

/// `dir`, or the same with a number added if it is taken: the same blocks again are another trial.
pub(crate) fn free_dir(dir: PathBuf) -> PathBuf {
    let numbered = |k: u32| PathBuf::from(format!("{}-{k}", dir.display()));
    let names = std::iter::once(dir.clone()).chain((2..).map(numbered));
    names.into_iter().find(|name| !name.exists()).unwrap_or(dir)
}
