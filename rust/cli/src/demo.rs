use crate::{
    announce::{announce, print_result},
    consent,
    interrupt::interrupt_flag,
    person_args::{FeedbackArgs, MocapArgs, VmplArgs},
    progress::bar,
    rosbridge_args::RosbridgeArgs,
    serve::{after_demo, free_dir},
    trial_args::TrialArgs,
};
use clap::Args;
use proact_app::{
    Arm, Audience, CardTally, Recorder, Registry, ResultCards, Rosbridge, TrackedShoulder, answer,
    default_dir, page_content, run_to_end, tell, tell_faults,
    trial::{self, Assembly},
};
use proact_bridge::{AfterTrial, ClientInput, PageContent, PageOptions, PageServer};
use proact_devices::{EmgOrigin, FeedbackSinks};
use proact_emg::{EmgConfig, EmgModel};
use proact_testbed::{ResultFault, ResultFaultKind, Session, TrialConfig, TrialEnd, TrialResult};
use proact_types::{MOST_TEXT_BYTES, read_text};
use std::{
    error::Error,
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

/// Arguments of `proact demo`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  proact demo\n  proact demo --headless --seed 7 --json\n  \
    proact demo --like minivie\n  \
    proact demo --emg recordings/ --emg-train 0,1 --emg-feed 2\n\n\
    EMG comes from a generator unless --emg names a folder of recordings. `--setup still` keeps the shoulder still. \
    With --mocap a tracked shoulder takes the place of the participant's, in real time. \
    The trial begins when a page has drawn it, or after 10 s. Ctrl-C ends the trial and closes its record; the exit code is \
    then not 0.")]
pub(crate) struct DemoArgs {
    #[command(flatten)]
    trial: TrialArgs,
    /// Folder of EMG recordings; a generator without it
    #[arg(long, value_name = "DIR")]
    emg: Option<PathBuf>,
    /// Samples per second of --emg, where the folder does not say
    #[arg(long, value_name = "HZ", requires = "emg")]
    emg_rate: Option<f64>,
    /// Repetitions to train on
    #[arg(long, value_name = "REPS", value_delimiter = ',', default_value = "0,1")]
    emg_train: Vec<u32>,
    /// Repetitions to feed during the trial
    #[arg(long, value_name = "REPS", value_delimiter = ',', default_value = "2")]
    emg_feed: Vec<u32>,
    /// Complete gestures that the recordings lack
    #[arg(long, value_name = "WITH", value_parser = ["synthetic"])]
    emg_fill: Option<String>,
    #[command(flatten)]
    how: RunHow,
}

/// Arguments of `proact run`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  proact run trial.toml --headless --json\n\n\
    A configuration is what a trial directory holds as config.toml. One that names a program for its method \
    or its intent model (method_process.command, intent_process.command) starts it only with --allow-command, or after a yes at the terminal.")]
pub(crate) struct RunArgs {
    /// Trial configuration
    config: PathBuf,
    /// Folder of EMG recordings; a generator without it
    #[arg(long, value_name = "DIR")]
    emg: Option<PathBuf>,
    /// Samples per second of --emg, where the folder does not say
    #[arg(long, value_name = "HZ", requires = "emg")]
    emg_rate: Option<f64>,
    /// Another arm than the configuration's, or its folder where it neither ships with the program nor lies beside the
    /// configuration
    #[arg(long, value_name = "NAME|FOLDER")]
    arm: Option<String>,
    /// Start the program that the configuration names for its method; without this it is asked for at a terminal
    #[arg(long)]
    allow_command: bool,
    #[command(flatten)]
    how: RunHow,
}

/// How a trial is run.
#[derive(Debug, Args)]
struct RunHow {
    /// Model of the EMG, as `proact emg train` writes it; without it one is trained on the spot
    #[arg(long, value_name = "FILE")]
    emg_model: Option<PathBuf>,
    /// No page, as fast as the machine allows
    #[arg(long)]
    headless: bool,
    /// Trial directory; by default a new one under trials/
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Do not record
    #[arg(long, conflicts_with = "out")]
    no_record: bool,
    /// One JSON object on standard output
    #[arg(long)]
    json: bool,
    /// Port of the page, or the next free one
    #[arg(long, default_value_t = 8090)]
    port: u16,
    /// Print the address of the page, open nothing
    #[arg(long)]
    no_browser: bool,
    /// Leave when the trial is over instead of keeping the page up
    #[arg(long)]
    exit: bool,
    #[command(flatten)]
    feedback: FeedbackArgs,
    #[command(flatten)]
    mocap: MocapArgs,
    #[command(flatten)]
    vmpl: VmplArgs,
    #[command(flatten)]
    rosbridge: RosbridgeArgs,
}

impl RunHow {
    /// The shoulder that motion capture sees, if a source was named, for the first trial.
    fn shoulder(
        &self,
        registry: &Registry,
        session: &Session,
    ) -> Result<Option<TrackedShoulder>, Box<dyn Error>> {
        if self.mocap.controller().is_some() {
            return Err(
                "a headset's controller is heard of by the page of a person who drives: use proact serve"
                    .into(),
            );
        }
        let mut shoulder = self.mocap.open(registry)?;
        if let Some(shoulder) = &mut shoulder {
            shoulder.measure_reach(session);
        }
        Ok(shoulder)
    }

    /// The model of the EMG, if one was named.
    fn trained(&self) -> Result<Option<EmgModel>, Box<dyn Error>> {
        self.emg_model.as_deref().map(proact_app::source::read_model_file).transpose()
    }
}

pub(crate) fn demo(registry: &Registry, args: &DemoArgs) -> Result<bool, Box<dyn Error>> {
    let source = match &args.emg {
        None => EmgOrigin::Synthetic,
        Some(dir) => EmgOrigin::Recording {
            dir: dir.clone(),
            rate_hz: args.emg_rate,
            train_reps: args.emg_train.clone(),
            feed_reps: args.emg_feed.clone(),
            fill: args.emg_fill.is_some(),
        },
    };
    let trained = args.how.trained()?;
    let emg = match &trained {
        _ if !args.trial.sets_emg()? => None,
        Some(model) => Some(EmgConfig { liveness: model.liveness(None), ..model.config.clone() }),
        None => Some(proact_devices::default_config(&source)?),
    };
    let (arm, config) = args.trial.config(&registry.methods, "seated", emg)?;
    let shown = Shown { arm, config, source, trained };
    shown.run(registry, Some(&args.trial), &args.how)
}

pub(crate) fn run(registry: &Registry, args: &RunArgs) -> Result<bool, Box<dyn Error>> {
    let text =
        std::fs::File::open(&args.config).and_then(|file| read_text(file, MOST_TEXT_BYTES)).map_err(|e| {
            format!("cannot read {}: {e}; give a trial configuration (TOML)", args.config.display())
        })?;
    let config = TrialConfig::from_toml(&text).map_err(|e| format!("{}: {e}", args.config.display()))?;
    consent::to_the_commands_of(&config, &args.config.display().to_string(), args.allow_command)?;
    let source = args
        .emg
        .as_ref()
        .map_or(EmgOrigin::Synthetic, |dir| EmgOrigin::recording(dir).at_rate(args.emg_rate));
    let (arm, config) = match &args.arm {
        Some(name) => {
            let arm = Arm::named(name)?;
            let other = arm.pinned().name != config.arm.name;
            // An arm of that name must be the one that is meant; another one brings its own set-up.
            let config = if other { config.with_arm(arm.pinned(), arm.model()) } else { config };
            (arm, config)
        }
        None => (Arm::recorded(args.config.parent().unwrap_or(Path::new(".")), &config)?, config),
    };
    let shown = Shown { arm, config, source, trained: args.how.trained()? };
    shown.run(registry, None, &args.how)
}

/// A trial with a simulated participant.
struct Shown {
    arm: Arm,
    config: TrialConfig,
    source: EmgOrigin,
    trained: Option<EmgModel>,
}

/// What outlives one showing.
struct Room {
    page: Option<PageServer>,
    around: Option<(Option<Rosbridge>, FeedbackSinks, Option<TrackedShoulder>)>,
    cards: ResultCards,
    offers: Vec<AfterTrial>,
    interrupted: Arc<AtomicBool>,
}

impl Shown {
    /// Runs it, as often as the page asks for. The page may then ask to drive by what `asked` says, if that is known.
    fn run(
        &self,
        registry: &Registry,
        asked: Option<&TrialArgs>,
        how: &RunHow,
    ) -> Result<bool, Box<dyn Error>> {
        let mut offers = vec![AfterTrial::WatchAgain];
        offers.extend(asked.map(|_| AfterTrial::Drive));
        let cards = ResultCards::default();
        let mut room = Room { page: None, around: None, cards, offers, interrupted: interrupt_flag()? };
        loop {
            let result = self.once(registry, how, &mut room)?;
            let Room { page, interrupted, .. } = &mut room;
            let ended = Ok(result.ended != TrialEnd::Interrupt && !failed_or_idle(&result));
            let Some(shown) = page.as_ref().filter(|_| !how.exit && !interrupted.load(Ordering::Relaxed))
            else {
                return ended;
            };
            tell(format_args!("the page stays at {} until Ctrl-C", shown.url()));
            match (wait_for_wish(shown, interrupted), asked) {
                (None, _) => return ended,
                (Some(AfterTrial::Drive), Some(asked)) => {
                    let Some(page) = page.take() else { return ended };
                    return after_demo(
                        registry,
                        asked.clone(),
                        !how.no_record,
                        page,
                        room.cards,
                        &room.interrupted,
                    );
                }
                (Some(_), _) => {}
            }
        }
    }

    /// Shows it once.
    fn once(
        &self,
        registry: &Registry,
        how: &RunHow,
        room: &mut Room,
    ) -> Result<TrialResult, Box<dyn Error>> {
        let Shown { arm, config, source, trained } = self;
        let mut config = config.clone();
        how.mocap.used(registry)?.seat(&mut config.setup);
        let Assembly { session, classifier, plans, .. } =
            trial::simulated_with(&registry.methods, arm, config, source, trained.as_ref())?;
        let config = session.testbed().config().clone();
        let dir = (!how.no_record).then(|| how.out.clone().unwrap_or_else(|| default_dir(&config)));
        // The first time a place that is taken is refused.
        let dir = if room.page.is_some() { dir.map(free_dir) } else { dir };
        let recorder = match &dir {
            Some(dir) => Some(Recorder::create(dir, &config, arm, classifier.as_ref())?.with_plans(plans)?),
            None => None,
        };
        match &room.page {
            Some(page) => page.set_content(content(registry, &session, arm))?,
            None if how.headless => {}
            None => room.page = Some(open_page(registry, &session, arm, how)?),
        }
        let (rosbridge, feedback, shoulder) = match room.around.take() {
            None => (
                how.rosbridge.open(&session)?,
                how.feedback.open(&registry.sinks)?,
                how.shoulder(registry, &session)?,
            ),
            Some((rosbridge, feedback, mut shoulder)) => {
                rosbridge.as_ref().map_or(Ok(()), |rosbridge| rosbridge.restart(&session))?;
                shoulder.iter_mut().for_each(TrackedShoulder::restart);
                (rosbridge, feedback, shoulder)
            }
        };
        let vmpl = how.vmpl.open(&session)?;
        let limit_ms = (session.testbed().config().limit_secs * 1e3) as u64;
        let bar = bar(!how.json, limit_ms, "{elapsed} {bar:40} {pos} of at most {len} ms  {msg}");
        let briefing = session.testbed().task().briefing().clone();
        let mut tally = CardTally::default();
        let page = room.page.as_ref();
        let mut audience =
            Audience { page, inputs: None, rosbridge, shoulder, feedback, interrupted: &room.interrupted };
        let result = run_to_end(session, recorder, &mut audience, dir.as_deref(), |step| {
            let Some(frame) = &step.frame else { return };
            tally.add(frame);
            if let Some(vmpl) = &vmpl {
                vmpl.send(&frame.joints);
            }
            bar.set_position(frame.time.0);
            bar.set_message(format!("{} {}", frame.score, briefing.score_name));
        })?;
        bar.finish_and_clear();
        room.around = Some((audience.rosbridge, audience.feedback, audience.shoulder));
        if let Some(page) = page {
            room.cards.show(page, briefing.most, &result, "Simulated participant", tally, &room.offers);
        }
        tell_faults(&result);
        if how.json {
            answer(serde_json::to_string(&result)?)?;
        } else {
            print_result(&result)?;
        }
        Ok(result)
    }
}

/// Whether a part in another process failed, or was a method that never acted.
fn failed_or_idle(result: &TrialResult) -> bool {
    let idle = |fault: &ResultFault| fault.kind == ResultFaultKind::NeverActed;
    result.ended == TrialEnd::Failed || result.trial_faults.iter().any(idle)
}

/// What the page asks for after a trial; none when the command is ended.
fn wait_for_wish(page: &PageServer, interrupted: &AtomicBool) -> Option<AfterTrial> {
    while !interrupted.load(Ordering::Relaxed) {
        let wish = page.drain_inputs().into_iter().find_map(|input| match input {
            ClientInput::After(wish) => Some(wish),
            _ => None,
        });
        if wish.is_some() {
            return wish;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    None
}

/// What the page shows of a trial.
fn content(registry: &Registry, session: &Session, arm: &Arm) -> PageContent {
    let config = session.testbed().config();
    PageContent {
        title: format!("Method {}, simulated participant", config.method_label()),
        methods: registry.methods.fitting(&config.profile, arm.model()),
        ..page_content(session.testbed(), arm)
    }
}

fn open_page(
    registry: &Registry,
    session: &Session,
    arm: &Arm,
    how: &RunHow,
) -> Result<PageServer, Box<dyn Error>> {
    let options = PageOptions { port: how.port, ..PageOptions::default() };
    let (access, secret) = how.rosbridge.access.page_access(options.bind, vec![])?;
    let server = PageServer::start(PageOptions { access, ..options }, content(registry, session, arm))?;
    announce(&server, "", !how.no_browser, secret);
    Ok(server)
}
