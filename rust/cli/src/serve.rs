use crate::{
    demo::{announce, interrupt_flag, print_result},
    experimenter::{Experimenter, store_gaze_check},
    pace::Pace,
    person::{Person, PersonArgs, drive_by_page},
    record::{Recorder, default_dir},
    trial::{self, Assembly},
    trial_args::TrialArgs,
};
use clap::Args;
use proact_bridge::{ClientInput, GazeCheck, PageContent, PageOptions, PageServer};
use proact_intent::GazeOffset;
use proact_testbed::{MethodName, Session};
use proact_types::SimTime;
use std::{
    error::Error,
    net::{IpAddr, Ipv4Addr},
    path::{Path, PathBuf},
    sync::atomic::{AtomicBool, Ordering},
    time::{Duration, Instant},
};

/// Arguments of `proact serve`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  proact serve\n  proact serve --setup seated --port 8100\n  \
    proact serve --rosbridge --allow 192.168.1.20\n  \
    proact serve --headset\n\n\
    Mouse is gaze; keys are gestures and are shown on the page. R starts a new trial. Ctrl-C ends.")]
pub(crate) struct ServeArgs {
    #[command(flatten)]
    trial: TrialArgs,
    /// Port of the page
    #[arg(long, default_value_t = 8090)]
    port: u16,
    /// Fail if the port is taken instead of trying the next ones
    #[arg(long)]
    exact_port: bool,
    /// Address to listen on; other machines need the token that is printed then
    #[arg(long, default_value = "127.0.0.1")]
    bind: IpAddr,
    /// Machine that needs no token for the page; may be repeated
    #[arg(long, value_name = "ADDRESS")]
    page_allow: Vec<IpAddr>,
    /// For a headset: HTTPS on all addresses, and a QR code to open the page with
    #[arg(long)]
    headset: bool,
    /// Folder for the records of the trials
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Do not record
    #[arg(long, conflicts_with = "out")]
    no_record: bool,
    /// Gestures from an armband instead of keys: a source as for `proact emg stream`
    #[arg(long, value_name = "SOURCE", requires = "emg_model")]
    emg_source: Option<String>,
    /// Model of the armband, as `proact emg train` writes it
    #[arg(long, value_name = "FILE", requires = "emg_source")]
    emg_model: Option<PathBuf>,
    /// Print the address of the page, open nothing
    #[arg(long)]
    no_browser: bool,
    #[command(flatten)]
    person: PersonArgs,
}

/// Why a live trial ended.
enum Ended {
    Finished,
    Aborted,
    Restart { method: Option<MethodName>, again: bool },
    Interrupted,
}

pub(crate) fn command(args: &ServeArgs) -> Result<bool, Box<dyn Error>> {
    let mut asked = args.trial.clone();
    let interrupted = interrupt_flag()?;
    let armband = match (&args.emg_source, &args.emg_model) {
        (Some(source), Some(model)) => Some(crate::emg::LiveArmband::open(source, model)?),
        _ => None,
    };
    let mut gaze_offset = GazeOffset::default();
    let mut server: Option<PageServer> = None;
    let mut person: Option<Person> = None;
    loop {
        let config = asked.config("still")?;
        let seed = config.seed;
        let Assembly { mut session, model, classifier, plans } = match &armband {
            Some(armband) => trial::live_with_armband(config, armband.model(), armband.port())?,
            None => trial::live(config)?,
        };
        let config = session.testbed().config().clone();
        let dir = match (&args.out, args.no_record) {
            (_, true) => None,
            (Some(out), _) => Some(free_dir(out.join(format!("seed{seed}")))),
            (None, _) => Some(default_dir(&config)),
        };
        let mut recorder = match &dir {
            Some(dir) => {
                Some(Recorder::create(dir, &config, &model, classifier.as_ref())?.with_plans(plans)?)
            }
            None => None,
        };
        let content = PageContent {
            title: format!("Method {}", config.method_label()),
            setup: config.setup.name.clone(),
            arm: model.as_ref().clone(),
            scene: session.testbed().task().scene().clone(),
            interactive: true,
            lean: config.setup.body.forward_max_deg > 0.0,
        };
        let page = match &mut server {
            Some(server) => {
                server.set_content(content)?;
                server
            }
            none => {
                let started = none.insert(PageServer::start(page_options(args)?, content)?);
                announce(started, "", !args.no_browser);
                announce_remote(started, args.headset)?;
                started
            }
        };
        let person = match &mut person {
            Some(person) => {
                person.restart(&session);
                person
            }
            none => none.insert(args.person.open(&session)?),
        };
        let start = Instant::now();
        session.person().set_gaze_offset(gaze_offset);
        let mut ended = live_trial(
            &mut session,
            &mut recorder,
            dir.as_deref(),
            page,
            person,
            &mut gaze_offset,
            &interrupted,
        )?;
        finish(&session, recorder, dir.as_deref(), start)?;
        if matches!(ended, Ended::Finished | Ended::Aborted) {
            let now = session.testbed().now();
            ended = wait_for_restart(dir.as_deref(), now, page, &mut gaze_offset, &interrupted)?;
        }
        let Ended::Restart { method: wanted, again } = ended else { break };
        asked = asked.next(wanted, again);
    }
    Ok(true)
}

fn page_options(args: &ServeArgs) -> Result<PageOptions, Box<dyn Error>> {
    let bind = if args.headset { Ipv4Addr::UNSPECIFIED.into() } else { args.bind };
    Ok(PageOptions {
        port: args.port,
        allow_next: !args.exact_port,
        bind,
        https: args.headset,
        token: new_token(bind)?,
        allowed: args.page_allow.clone(),
    })
}

/// A secret for a page that other machines can reach.
pub(crate) fn new_token(bind: IpAddr) -> Result<Option<String>, Box<dyn Error>> {
    if bind.is_loopback() {
        return Ok(None);
    }
    let mut secret = [0; 16];
    getrandom::fill(&mut secret).map_err(|error| format!("the system gives no random numbers: {error}"))?;
    Ok(Some(secret.iter().map(|byte| format!("{byte:02x}")).collect()))
}

/// Tells how to open the page on another machine, for a headset as a QR code.
fn announce_remote(server: &PageServer, headset: bool) -> Result<(), Box<dyn Error>> {
    let Some(url) = server.remote_url() else { return Ok(()) };
    eprintln!("on another machine: {url}");
    if headset {
        let code = qrcode::QrCode::new(&url)?;
        eprintln!("{}", code.render::<qrcode::render::unicode::Dense1x2>().build());
        eprintln!("The certificate is made anew at each start: the browser asks once whether to go on.");
    }
    Ok(())
}

/// `dir`, or the same with a number added if it is taken: the same blocks again are another trial.
fn free_dir(dir: PathBuf) -> PathBuf {
    let numbered = |k: u32| PathBuf::from(format!("{}-{k}", dir.display()));
    let names = std::iter::once(dir.clone()).chain((2..).map(numbered));
    names.into_iter().find(|name| !name.exists()).unwrap_or(dir)
}

/// What a page's choice of method means.
fn restart(method: Option<char>, again: bool) -> Result<Ended, Box<dyn Error>> {
    let method = method.map(|name| name.to_string().parse::<MethodName>()).transpose()?;
    Ok(Ended::Restart { method, again })
}

/// Records a gaze check. The error that a calibration found comes on top of what is taken off already.
fn take_gaze_check(
    dir: Option<&Path>,
    now: SimTime,
    check: &GazeCheck,
    gaze_offset: &mut GazeOffset,
) -> std::io::Result<()> {
    if let Some([left, up]) = check.correction_deg {
        *gaze_offset += GazeOffset { left: left.to_radians(), up: up.to_radians() };
    }
    store_gaze_check(dir, now, check)
}

/// Runs one trial in real time on what the page sends.
fn live_trial(
    session: &mut Session,
    recorder: &mut Option<Recorder>,
    dir: Option<&Path>,
    page: &PageServer,
    person: &mut Person,
    gaze_offset: &mut GazeOffset,
    interrupted: &AtomicBool,
) -> Result<Ended, Box<dyn Error>> {
    let mut pace = Pace::new();
    let mut experimenter = Experimenter::new(page, session.testbed().config(), dir, person.gaze_source());
    let mut ending = None;
    loop {
        let now = session.testbed().now();
        if session.testbed().frame_is_due() || now.0 == 0 {
            let mut inputs = page.drain_inputs();
            inputs.extend(experimenter.wait_while_paused(&mut pace, interrupted));
            for input in drive_by_page(page, inputs, session) {
                match input {
                    ClientInput::Restart { method, again } => ending = Some(restart(method, again)?),
                    ClientInput::Study(action) if experimenter.act(action) => ending = Some(Ended::Aborted),
                    ClientInput::GazeCheck(check) => {
                        take_gaze_check(dir, now, &check, gaze_offset)?;
                        session.person().set_gaze_offset(*gaze_offset);
                    }
                    // A refused action; the person's inputs have been taken.
                    _ => {}
                }
            }
            person.drive(session)?;
            if interrupted.load(Ordering::Relaxed) {
                ending = Some(Ended::Interrupted);
            }
        }
        // The tick that ends a trial closes its digest.
        let began = Instant::now();
        let step = session.step(ending.is_some())?;
        experimenter.take(&step, began.elapsed());
        if let Some(recorder) = recorder {
            recorder.write(&step, session.testbed().plant().state())?;
        }
        if let Some(frame) = &step.frame {
            page.publish(frame);
        }
        person.show(&step);
        if step.output.finished && ending.is_none() {
            return Ok(Ended::Finished);
        }
        if let Some(ended) = ending.take() {
            return Ok(ended);
        }
        pace.tick();
    }
}

fn finish(
    session: &Session,
    recorder: Option<Recorder>,
    dir: Option<&Path>,
    start: Instant,
) -> Result<(), Box<dyn Error>> {
    let mut result = session.result();
    result.wall_seconds = start.elapsed().as_secs_f64();
    result.real_time_factor = result.sim_seconds / result.wall_seconds.max(1e-9);
    result.trial_dir = dir.map(|d| d.display().to_string());
    if let Some(recorder) = recorder {
        recorder.finish(&result)?;
    }
    print_result(&result);
    Ok(())
}

/// Keeps the last frame on the page until the person asks for a new trial or the command is ended.
fn wait_for_restart(
    dir: Option<&Path>,
    now: SimTime,
    page: &PageServer,
    gaze_offset: &mut GazeOffset,
    interrupted: &AtomicBool,
) -> Result<Ended, Box<dyn Error>> {
    while !interrupted.load(Ordering::Relaxed) {
        for input in page.drain_inputs() {
            match input {
                ClientInput::Restart { method, again } => return restart(method, again),
                ClientInput::GazeCheck(check) => take_gaze_check(dir, now, &check, gaze_offset)?,
                _ => {}
            }
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    Ok(Ended::Interrupted)
}
