use crate::{
    announce::{announce, print_trial_result},
    consent,
    emg::{FaultArgs, recording_checks::print_refused_findings},
    interrupt::interrupt_flag,
    progress::progress_bar,
    rosbridge_args::RosbridgeArgs,
    serve::{serve_after_demo, unused_dir},
    trial_args::TrialArgs,
    user_device_args::{FeedbackArgs, MocapArgs, VmplArgs},
};
use clap::Args;
use proact_app::{
    Arm, Recorder, Registry, ResultCardCounter, ResultCards, Rosbridge, RunOutputs, TrackedShoulder,
    default_dir, page_content, print_faults, print_result_json, print_status, run_to_end,
    trial::{self, Assembly},
};
use proact_bridge::{ClientInput, PageContent, PageOptions, PageServer, PostTrialAction};
use proact_devices::{EmgOrigin, FeedbackSinks, findings_json};
use proact_emg::{EmgConfig, EmgModel};
use proact_testbed::{RunningTrial, TrialConfig, TrialEnd, TrialResult};
use proact_types::{MAX_TEXT_BYTES, read_text};
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
    proact demo --emg recordings/ --emg-train-repetitions 0,1 --emg-test-repetitions 2\n\n\
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
    emg_train_repetitions: Vec<u32>,
    /// Repetitions to feed during the trial
    #[arg(long, value_name = "REPS", value_delimiter = ',', default_value = "2")]
    emg_test_repetitions: Vec<u32>,
    /// Complete gestures that the recordings lack
    #[arg(long, value_name = "WITH", value_parser = ["synthetic"])]
    fill_missing: Option<String>,
    #[command(flatten)]
    faults: FaultArgs,
    #[command(flatten)]
    run_options: RunOptions,
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
    #[command(flatten)]
    faults: FaultArgs,
    /// Another arm than the configuration's, or its folder where it neither ships with the program nor lies beside the
    /// configuration
    #[arg(long, value_name = "NAME|FOLDER")]
    arm: Option<String>,
    /// Start the program that the configuration names for its method; without this it is asked for at a terminal
    #[arg(long)]
    allow_command: bool,
    #[command(flatten)]
    run_options: RunOptions,
}

/// How a trial is run.
#[derive(Debug, Args)]
struct RunOptions {
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
    no_wait: bool,
    #[command(flatten)]
    feedback: FeedbackArgs,
    #[command(flatten)]
    mocap: MocapArgs,
    #[command(flatten)]
    vmpl: VmplArgs,
    #[command(flatten)]
    rosbridge: RosbridgeArgs,
}

impl RunOptions {
    /// The shoulder that motion capture sees, if a source was named, for the first trial.
    fn open_tracked_shoulder(
        &self,
        registry: &Registry,
        trial: &RunningTrial,
    ) -> Result<Option<TrackedShoulder>, Box<dyn Error>> {
        if self.mocap.shoulder_controller().is_some() {
            return Err(
                "a headset's controller is heard of by the page of a person who drives: use proact serve"
                    .into(),
            );
        }
        let mut shoulder = self.mocap.open_shoulder(registry)?;
        if let Some(shoulder) = &mut shoulder {
            shoulder.measure_reach(trial);
        }
        Ok(shoulder)
    }

    /// The model of the EMG, if one was named.
    fn read_emg_model(&self) -> Result<Option<EmgModel>, Box<dyn Error>> {
        self.emg_model.as_deref().map(proact_app::emg_model_file::read_model_file).transpose()
    }
}

pub(crate) fn demo(registry: &Registry, args: &DemoArgs) -> Result<bool, Box<dyn Error>> {
    if args.emg.is_some()
        && let Some(both) = args
            .emg_train_repetitions
            .iter()
            .find(|repetition| args.emg_test_repetitions.contains(repetition))
    {
        print_status(format_args!(
            "repetition {both} is both trained on and fed: the trial tells nothing of how well new ones are recognized; name \
             different ones with --emg-train-repetitions and --emg-test-repetitions"
        ));
    }
    let source = match &args.emg {
        None => EmgOrigin::Synthetic,
        Some(dir) => EmgOrigin::Recording {
            dir: dir.clone(),
            rate_hz: args.emg_rate,
            train_reps: args.emg_train_repetitions.clone(),
            feed_reps: args.emg_test_repetitions.clone(),
            fill: args.fill_missing.is_some(),
            faults: args.faults.policy(),
        },
    };
    let trained = args.run_options.read_emg_model()?;
    let emg = match &trained {
        _ if !args.trial.sets_emg()? => None,
        Some(model) => Some(EmgConfig { liveness: model.liveness(None), ..model.config.clone() }),
        None => Some(proact_devices::default_config(&source)?),
    };
    let (arm, config) = args.trial.config(&registry.methods, "seated", emg)?;
    let demo_trial = DemoTrial { arm, config, source, emg_model: trained };
    demo_trial.run(registry, Some(&args.trial), &args.run_options)
}

pub(crate) fn run(registry: &Registry, args: &RunArgs) -> Result<bool, Box<dyn Error>> {
    let text =
        std::fs::File::open(&args.config).and_then(|file| read_text(file, MAX_TEXT_BYTES)).map_err(|e| {
            format!("cannot read {}: {e}; give a trial configuration (TOML)", args.config.display())
        })?;
    let mut renamed = Vec::new();
    let config = TrialConfig::from_toml_noting(&text, &mut renamed);
    proact_app::warn_of_renamed_keys(&renamed);
    let config = config.map_err(|e| format!("{}: {e}", args.config.display()))?;
    consent::require_consent(&config, &args.config.display().to_string(), args.allow_command)?;
    let source = args
        .emg
        .as_ref()
        .map_or(EmgOrigin::Synthetic, |dir| EmgOrigin::recording(dir).at_rate(args.emg_rate))
        .with_faults(args.faults.policy());
    let (arm, config) = match &args.arm {
        Some(name) => {
            let arm = Arm::load(name)?;
            let other = arm.pinned().name != config.arm.name;
            // An arm of that name must be the one that is meant; another one brings its own set-up.
            let config = if other { config.with_arm(arm.pinned(), arm.model()) } else { config };
            (arm, config)
        }
        None => (Arm::from_record(args.config.parent().unwrap_or(Path::new(".")), &config)?, config),
    };
    let demo_trial = DemoTrial { arm, config, source, emg_model: args.run_options.read_emg_model()? };
    demo_trial.run(registry, None, &args.run_options)
}

/// A trial with a simulated participant.
struct DemoTrial {
    arm: Arm,
    config: TrialConfig,
    source: EmgOrigin,
    emg_model: Option<EmgModel>,
}

/// The result of a trial with what was found in its recordings.
#[derive(serde::Serialize)]
struct DemoResult<'a> {
    #[serde(flatten)]
    result: &'a TrialResult,
    findings: serde_json::Value,
    accepted_faults: &'a [String],
}

/// What outlives one showing.
struct DemoContext {
    page: Option<PageServer>,
    peripherals: Option<(Option<Rosbridge>, FeedbackSinks, Option<TrackedShoulder>)>,
    cards: ResultCards,
    offers: Vec<PostTrialAction>,
    interrupted: Arc<AtomicBool>,
}

impl DemoTrial {
    /// Runs it, as often as the page asks for. The page may then ask to drive by what `trial_args` says, if that is known.
    fn run(
        &self,
        registry: &Registry,
        trial_args: Option<&TrialArgs>,
        how: &RunOptions,
    ) -> Result<bool, Box<dyn Error>> {
        let mut offers = vec![PostTrialAction::WatchAgain];
        offers.extend(trial_args.map(|_| PostTrialAction::Drive));
        let cards = ResultCards::default();
        let mut context =
            DemoContext { page: None, peripherals: None, cards, offers, interrupted: interrupt_flag()? };
        loop {
            let result = self.run_once(registry, how, &mut context)?;
            let DemoContext { page, interrupted, .. } = &mut context;
            let ended = Ok(result.ended != TrialEnd::Interrupt && !failed_or_idle(&result));
            let Some(shown) = page.as_ref().filter(|_| !how.no_wait && !interrupted.load(Ordering::Relaxed))
            else {
                return ended;
            };
            print_status(format_args!("the page stays at {} until Ctrl-C", shown.url()));
            match (wait_for_page_request(shown, interrupted), trial_args) {
                (None, _) => return ended,
                (Some(PostTrialAction::Drive), Some(trial_args)) => {
                    let Some(page) = page.take() else { return ended };
                    return serve_after_demo(
                        registry,
                        trial_args.clone(),
                        !how.no_record,
                        page,
                        context.cards,
                        &context.interrupted,
                    );
                }
                (Some(_), _) => {}
            }
        }
    }

    /// Shows it once.
    fn run_once(
        &self,
        registry: &Registry,
        how: &RunOptions,
        context: &mut DemoContext,
    ) -> Result<TrialResult, Box<dyn Error>> {
        let DemoTrial { arm, config, source, emg_model: trained } = self;
        let mut config = config.clone();
        how.mocap.load_calibrations(registry)?.place_person(&mut config.setup);
        let Assembly { trial, classifier, plans, recording_faults: findings, .. } =
            trial::simulated_trial_with_model(&registry.methods, arm, config, source, trained.as_ref())
                .inspect_err(|error| print_refused_findings(error, how.json))?;
        let config = trial.testbed().config().clone();
        let dir = (!how.no_record).then(|| how.out.clone().unwrap_or_else(|| default_dir(&config)));
        // The first time a place that is taken is refused.
        let dir = if context.page.is_some() { dir.map(unused_dir) } else { dir };
        let recorder = match &dir {
            Some(dir) => Some(Recorder::create(dir, &config, arm, classifier.as_ref())?.with_plans(plans)?),
            None => None,
        };
        match &context.page {
            Some(page) => page.set_content(demo_content(registry, &trial, arm))?,
            None if how.headless => {}
            None => context.page = Some(open_page(registry, &trial, arm, how)?),
        }
        let (rosbridge, feedback, shoulder) = match context.peripherals.take() {
            None => (
                how.rosbridge.open(&trial)?,
                how.feedback.open(&registry.sinks)?,
                how.open_tracked_shoulder(registry, &trial)?,
            ),
            Some((rosbridge, feedback, mut shoulder)) => {
                rosbridge.as_ref().map_or(Ok(()), |rosbridge| rosbridge.restart(&trial))?;
                shoulder.iter_mut().for_each(TrackedShoulder::restart);
                (rosbridge, feedback, shoulder)
            }
        };
        let vmpl = how.vmpl.open(&trial)?;
        let limit_ms = (trial.testbed().config().limit_secs * 1e3) as u64;
        let bar = progress_bar(!how.json, limit_ms, "{elapsed} {bar:40} {pos} of at most {len} ms  {msg}");
        let briefing = trial.testbed().task().briefing().clone();
        let mut card_counter = ResultCardCounter::default();
        let page = context.page.as_ref();
        let mut outputs = RunOutputs {
            page,
            inputs: None,
            rosbridge,
            shoulder,
            feedback,
            interrupted: &context.interrupted,
        };
        let result = run_to_end(trial, recorder, &mut outputs, dir.as_deref(), |step, _| {
            let Some(frame) = &step.frame else { return };
            card_counter.add(frame);
            if let Some(vmpl) = &vmpl {
                vmpl.send(&frame.joints);
            }
            bar.set_position(frame.time.0);
            bar.set_message(format!("{} {}", frame.score, briefing.score_name));
        })?;
        bar.finish_and_clear();
        context.peripherals = Some((outputs.rosbridge, outputs.feedback, outputs.shoulder));
        if let Some(page) = page {
            context.cards.show(
                page,
                briefing.max_score,
                &result,
                "Simulated participant",
                card_counter,
                &context.offers,
            );
        }
        print_faults(&result);
        if how.json {
            let findings = findings_json(&findings);
            let answered =
                DemoResult { result: &result, findings, accepted_faults: &config.emg_accepted_faults };
            print_result_json(&answered)?;
        } else {
            print_trial_result(&result)?;
        }
        Ok(result)
    }
}

/// Whether a part in another process failed, or never acted.
fn failed_or_idle(result: &TrialResult) -> bool {
    result.ended == TrialEnd::Failed || result.never_acted().is_some()
}

/// What the page asks for after a trial; none when the command is ended.
fn wait_for_page_request(page: &PageServer, interrupted: &AtomicBool) -> Option<PostTrialAction> {
    while !interrupted.load(Ordering::Relaxed) {
        let next_action = page.drain_inputs().into_iter().find_map(|input| match input {
            ClientInput::After(action) => Some(action),
            _ => None,
        });
        if next_action.is_some() {
            return next_action;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    None
}

/// What the page shows of a trial.
fn demo_content(registry: &Registry, trial: &RunningTrial, arm: &Arm) -> PageContent {
    let config = trial.testbed().config();
    PageContent {
        title: format!("Method {}, simulated participant", config.method_label()),
        methods: registry.methods.compatible_methods(&config.profile, arm.model()),
        ..page_content(trial.testbed(), arm)
    }
}

fn open_page(
    registry: &Registry,
    trial: &RunningTrial,
    arm: &Arm,
    how: &RunOptions,
) -> Result<PageServer, Box<dyn Error>> {
    let options = PageOptions { port: how.port, ..PageOptions::default() };
    let (access, secret) = how.rosbridge.access.page_access(options.bind, vec![])?;
    let server = PageServer::start(PageOptions { access, ..options }, demo_content(registry, trial, arm))?;
    announce(&server, "", !how.no_browser, secret);
    Ok(server)
}
