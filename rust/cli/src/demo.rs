use crate::{
    announce::{announce, print_result},
    consent,
    interrupt::{interrupt_flag, wait_for},
    person_args::FeedbackArgs,
    rosbridge_args::RosbridgeArgs,
    trial_args::TrialArgs,
};
use clap::Args;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use proact_app::{
    Arm, Audience, Recorder, Registry, answer, default_dir, run_to_end, tell,
    trial::{self, Assembly},
};
use proact_bridge::{PageContent, PageOptions, PageServer};
use proact_devices::EmgOrigin;
use proact_emg::{EmgConfig, EmgModel};
use proact_testbed::{Session, TrialConfig, TrialEnd};
use proact_types::{MOST_TEXT_BYTES, read_text};
use std::{
    error::Error,
    io::IsTerminal,
    path::{Path, PathBuf},
    sync::atomic::Ordering,
};

/// Arguments of `proact demo`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  proact demo\n  proact demo --headless --seed 7 --json\n  \
    proact demo --emg recordings/ --emg-train 0,1 --emg-feed 2\n\n\
    EMG comes from a generator unless --emg names a folder of recordings. `--setup still` keeps the shoulder still. \
    Ctrl-C ends the trial and closes its record; the exit code is then not 0.")]
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
    (method_process.command) starts it only with --allow-command, or after a yes at the terminal.")]
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
    rosbridge: RosbridgeArgs,
}

impl RunHow {
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
        _ if !args.trial.sets_emg() => None,
        Some(model) => Some(EmgConfig { liveness: model.liveness(None), ..model.config.clone() }),
        None => Some(proact_devices::default_config(&source)?),
    };
    let (arm, config) = args.trial.config(&registry.methods, "seated", emg)?;
    trial_with(registry, &arm, config, &source, trained.as_ref(), &args.how)
}

pub(crate) fn run(registry: &Registry, args: &RunArgs) -> Result<bool, Box<dyn Error>> {
    let text =
        std::fs::File::open(&args.config).and_then(|file| read_text(file, MOST_TEXT_BYTES)).map_err(|e| {
            format!("cannot read {}: {e}; give a trial configuration (TOML)", args.config.display())
        })?;
    let config = TrialConfig::from_toml(&text).map_err(|e| format!("{}: {e}", args.config.display()))?;
    consent::to_the_command_of(&config, &args.config.display().to_string(), args.allow_command)?;
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
    trial_with(registry, &arm, config, &source, args.how.trained()?.as_ref(), &args.how)
}

fn trial_with(
    registry: &Registry,
    arm: &Arm,
    config: TrialConfig,
    source: &EmgOrigin,
    trained: Option<&EmgModel>,
    how: &RunHow,
) -> Result<bool, Box<dyn Error>> {
    let Assembly { session, classifier, plans, .. } =
        trial::simulated_with(&registry.methods, arm, config, source, trained)?;
    let config = session.testbed().config().clone();
    let dir = (!how.no_record).then(|| how.out.clone().unwrap_or_else(|| default_dir(&config)));
    let recorder = match &dir {
        Some(dir) => Some(Recorder::create(dir, &config, arm, classifier.as_ref())?.with_plans(plans)?),
        None => None,
    };
    let page = if how.headless { None } else { Some(open_page(registry, &session, arm, how)?) };
    let (rosbridge, feedback) = (how.rosbridge.open(&session)?, how.feedback.open(&registry.sinks)?);
    let bar = bar(&session, !how.json);
    let score_name = session.testbed().task().briefing().score_name.clone();
    let interrupted = interrupt_flag()?;
    let mut audience = Audience { page: page.as_ref(), rosbridge, feedback, interrupted: &interrupted };
    let result = run_to_end(session, recorder, &mut audience, dir.as_deref(), |frame| {
        bar.set_position(frame.time.0);
        bar.set_message(format!("{} {score_name}", frame.score));
    })?;
    bar.finish_and_clear();
    if how.json {
        answer(serde_json::to_string(&result)?)?;
    } else {
        print_result(&result)?;
    }
    if let Some(page) = page.filter(|_| !how.exit && !interrupted.load(Ordering::Relaxed)) {
        tell(format_args!("the page stays at {} until Ctrl-C", page.url()));
        wait_for(&interrupted);
    }
    Ok(result.ended != TrialEnd::Interrupt)
}

fn open_page(
    registry: &Registry,
    session: &Session,
    arm: &Arm,
    how: &RunHow,
) -> Result<PageServer, Box<dyn Error>> {
    let testbed = session.testbed();
    let config = testbed.config();
    let content = PageContent {
        title: format!("Method {}, simulated participant", config.method_label()),
        setup: config.setup.name.clone(),
        arm: testbed.model().as_ref().clone(),
        meshes: arm.meshes(),
        scene: testbed.task().scene().clone(),
        briefing: testbed.task().briefing().clone(),
        interactive: false,
        lean: false,
        method: testbed.method().clone(),
        methods: registry.methods.infos(),
    };
    let options = PageOptions { port: how.port, ..PageOptions::default() };
    let (access, secret) = how.rosbridge.access.page_access(options.bind, vec![])?;
    let server = PageServer::start(PageOptions { access, ..options }, content)?;
    announce(&server, "", !how.no_browser, secret);
    Ok(server)
}

fn bar(session: &Session, visible: bool) -> ProgressBar {
    let limit = (session.testbed().config().limit_secs * 1e3) as u64;
    let target = if visible && std::io::stderr().is_terminal() {
        ProgressDrawTarget::stderr()
    } else {
        ProgressDrawTarget::hidden()
    };
    let bar = ProgressBar::with_draw_target(Some(limit), target);
    if let Ok(style) = ProgressStyle::with_template("{elapsed} {bar:40} {pos} of at most {len} ms  {msg}") {
        bar.set_style(style);
    }
    bar
}
