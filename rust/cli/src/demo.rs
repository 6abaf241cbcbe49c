use crate::{
    experimenter::Experimenter,
    pace::Pace,
    person::{Feedback, FeedbackArgs},
    record::{Recorder, default_dir},
    rosbridge::{Rosbridge, RosbridgeArgs},
    trial::{self, Assembly},
    trial_args::TrialArgs,
};
use clap::Args;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use proact_bridge::{ClientInput, PageContent, PageOptions, PageServer};
use proact_devices::EmgSource;
use proact_testbed::{Session, TrialConfig, TrialResult};
use std::{
    error::Error,
    io::IsTerminal,
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

/// A trial that is shown waits so long for its first page.
const PAGE_WAIT: Duration = Duration::from_secs(3);

/// Arguments of `proact demo`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  proact demo\n  proact demo --headless --seed 7 --json\n  \
    proact demo --emg recordings/ --emg-train 0,1 --emg-feed 2\n\n\
    EMG comes from a generator unless --emg names a folder of recordings. `--setup still` keeps the shoulder still.")]
pub(crate) struct DemoArgs {
    #[command(flatten)]
    trial: TrialArgs,
    /// Folder of EMG recordings; a generator without it
    #[arg(long, value_name = "DIR")]
    emg: Option<PathBuf>,
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
    A configuration is what a trial directory holds as config.toml.")]
pub(crate) struct RunArgs {
    /// Trial configuration
    config: PathBuf,
    /// Folder of EMG recordings; a generator without it
    #[arg(long, value_name = "DIR")]
    emg: Option<PathBuf>,
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

pub(crate) fn demo(args: &DemoArgs) -> Result<bool, Box<dyn Error>> {
    let source = match &args.emg {
        None => EmgSource::Synthetic,
        Some(dir) => {
            let EmgSource::Recording { dir, rate_hz, .. } = EmgSource::recording(dir) else {
                return Err("a folder of recordings is a recording".into());
            };
            let (train_reps, feed_reps) = (args.emg_train.clone(), args.emg_feed.clone());
            EmgSource::Recording { dir, rate_hz, train_reps, feed_reps, fill: args.emg_fill.is_some() }
        }
    };
    trial_with(args.trial.config("seated")?, &source, &args.how)
}

pub(crate) fn run(args: &RunArgs) -> Result<bool, Box<dyn Error>> {
    let text = std::fs::read_to_string(&args.config).map_err(|e| {
        format!("cannot read {}: {e}; give a trial configuration (TOML)", args.config.display())
    })?;
    let config = TrialConfig::from_toml(&text).map_err(|e| format!("{}: {e}", args.config.display()))?;
    let source = args.emg.as_ref().map_or(EmgSource::Synthetic, EmgSource::recording);
    trial_with(config, &source, &args.how)
}

fn trial_with(config: TrialConfig, source: &EmgSource, how: &RunHow) -> Result<bool, Box<dyn Error>> {
    let trained = how.emg_model.as_deref().map(crate::emg::read_model_file).transpose()?;
    let Assembly { session, classifier, model, plans } =
        trial::simulated_with(config, source, trained.as_ref())?;
    let config = session.testbed().config().clone();
    let dir = (!how.no_record).then(|| how.out.clone().unwrap_or_else(|| default_dir(&config)));
    let recorder = match &dir {
        Some(dir) => Some(Recorder::create(dir, &config, &model, classifier.as_ref())?.with_plans(plans)?),
        None => None,
    };
    let page = if how.headless { None } else { Some(open_page(&session, how)?) };
    let (rosbridge, feedback) = (how.rosbridge.open(&session)?, how.feedback.open()?);
    let mut shown = Shown { page: page.as_ref(), rosbridge, feedback };
    let result = run_to_end(session, recorder, &mut shown, dir.as_deref(), !how.json)?;
    if how.json {
        println!("{}", serde_json::to_string(&result)?);
    } else {
        print_result(&result);
    }
    if let Some(page) = page.filter(|_| !how.exit) {
        eprintln!("the page stays at {} until Ctrl-C", page.url());
        wait_for_interrupt()?;
    }
    Ok(true)
}

fn open_page(session: &Session, how: &RunHow) -> Result<PageServer, Box<dyn Error>> {
    let testbed = session.testbed();
    let config = testbed.config();
    let content = PageContent {
        title: format!("Method {}, simulated participant", config.method_label()),
        setup: config.setup.name.clone(),
        arm: testbed.model().as_ref().clone(),
        scene: testbed.task().scene().clone(),
        interactive: false,
        lean: false,
    };
    let server = PageServer::start(PageOptions { port: how.port, ..PageOptions::default() }, content)?;
    announce(&server, "", !how.no_browser);
    Ok(server)
}

/// Prints the address of a page of this server, and opens it in a browser if there is a screen to open it on. The
/// empty path is the participant's page.
pub(crate) fn announce(server: &PageServer, path: &str, open_browser: bool) {
    let url = format!("{}{path}", server.url());
    eprintln!("page: {url}");
    if path.is_empty() {
        eprintln!("experimenter: {url}experimenter, read-only: {url}spectator");
    }
    let screen = ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| std::env::var_os(name).is_some());
    if open_browser && screen {
        // The address is printed; a browser that does not start is no reason to stop.
        let _ = open::that_detached(url);
    }
}

/// Who watches a trial.
struct Shown<'a> {
    page: Option<&'a PageServer>,
    rosbridge: Option<Rosbridge>,
    feedback: Feedback,
}

/// Runs a simulated trial: flat out if nobody watches, in real time for the page and for clients of rosbridge.
fn run_to_end(
    mut session: Session,
    mut recorder: Option<Recorder>,
    shown: &mut Shown<'_>,
    dir: Option<&Path>,
    progress: bool,
) -> Result<TrialResult, Box<dyn Error>> {
    let bar = bar(&session, progress);
    let page = shown.page;
    if let Some(page) = page {
        wait_for_page(page);
    }
    let mut live = page.map(|page| {
        (Pace::new(), Experimenter::new(page, session.testbed().config(), dir, None), AtomicBool::new(false))
    });
    let mut alone = (page.is_none() && shown.rosbridge.is_some()).then(Pace::new);
    let start = Instant::now();
    loop {
        let mut last = false;
        if let (Some((pace, experimenter, interrupted)), Some(page)) = (&mut live, page) {
            let mut inputs = page.drain_inputs();
            inputs.extend(experimenter.wait_while_paused(pace, interrupted));
            for input in inputs {
                if let ClientInput::Study(action) = input {
                    last |= experimenter.act(action);
                }
            }
        }
        let began = Instant::now();
        let step = session.step(last)?;
        if let Some(recorder) = &mut recorder {
            recorder.write(&step, session.testbed().plant().state())?;
        }
        shown.feedback.begin(&step.output.cues);
        if let Some(frame) = &step.frame {
            bar.set_position(step.time.0);
            bar.set_message(format!("{} of 4 on target", frame.on_target));
            if let Some(page) = page {
                page.publish(frame);
            }
            if let Some(rosbridge) = &shown.rosbridge {
                rosbridge.publish(frame);
            }
        }
        if let Some((pace, experimenter, _)) = &mut live {
            experimenter.take(&step, began.elapsed());
            pace.tick();
        }
        if let Some(pace) = &mut alone {
            pace.tick();
        }
        if step.output.finished || last {
            break;
        }
    }
    bar.finish_and_clear();
    let wall = start.elapsed().as_secs_f64();
    let mut result = session.result();
    result.wall_seconds = wall;
    result.real_time_factor = result.sim_seconds / wall.max(1e-9);
    result.trial_dir = dir.map(|d| d.display().to_string());
    if let Some(recorder) = recorder {
        recorder.finish(&result)?;
    }
    Ok(result)
}

/// Gives a browser a moment to come, so that it misses nothing of the trial.
fn wait_for_page(page: &PageServer) {
    let start = Instant::now();
    while page.client_count() == 0 && start.elapsed() < PAGE_WAIT {
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn bar(session: &Session, visible: bool) -> ProgressBar {
    let limit = session.testbed().task().limit().0;
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

pub(crate) fn print_result(result: &TrialResult) {
    println!(
        "method {}, set-up {}, seed {}, arrangement {}, gestures: {}",
        result.method, result.setup, result.seed, result.arrangement, result.gesture_source
    );
    for block in &result.outcomes {
        let seconds = |s: Option<f64>| s.map_or("   -  ".to_owned(), |s| format!("{s:5.1} s"));
        println!(
            "  {:6} {:20} pick {}  place {}  {:4.0} mm from target",
            block.block.name(),
            format!("{:?}", block.outcome),
            seconds(block.pick_s),
            seconds(block.place_s),
            block.distance_m * 1e3
        );
    }
    println!(
        "{} of 4 on target in {:.1} s, computed in {:.1} s ({:.1} times real time)",
        result.on_target, result.sim_seconds, result.wall_seconds, result.real_time_factor
    );
    println!("digest {}", result.digest);
    if let Some(dir) = &result.trial_dir {
        println!("recorded in {dir}; check it with: proact replay {dir}");
    }
}

/// Blocks until Ctrl-C or a request to end.
pub(crate) fn wait_for_interrupt() -> Result<(), Box<dyn Error>> {
    let ended = interrupt_flag()?;
    while !ended.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(50));
    }
    Ok(())
}

/// A flag that Ctrl-C or a request to end raises.
pub(crate) fn interrupt_flag() -> Result<Arc<AtomicBool>, Box<dyn Error>> {
    let ended = Arc::new(AtomicBool::new(false));
    let flag = ended.clone();
    ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed))?;
    Ok(ended)
}
