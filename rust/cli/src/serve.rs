use crate::{
    access_args::listed,
    announce::{announce, print_result, printed},
    interrupt::interrupt_flag,
    person_args::PersonArgs,
    trial_args::TrialArgs,
};
use clap::Args;
use proact_app::{
    Ended, LiveArmband, LivePerson, LiveTrial, Recorder, Registry, default_dir, tell,
    trial::{self, Armband, Assembly},
};
use proact_bridge::{PageContent, PageOptions, PageServer};
use proact_devices::SourceName;
use proact_http::Listed;
use proact_intent::GazeOffset;
use std::{
    error::Error,
    net::{IpAddr, Ipv4Addr},
    path::PathBuf,
};

/// Arguments of `proact serve`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  proact serve\n  proact serve --setup seated --port 8100\n  \
    proact serve --rosbridge --allow 192.168.1.20\n  \
    proact serve --headset\n  \
    proact serve --bind 0.0.0.0 --token-file ~/.proact_token --host-name testbed.example.org\n\n\
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
    /// Address to listen on; where other machines can connect, everybody needs the token that is printed then
    #[arg(long, default_value = "127.0.0.1")]
    bind: IpAddr,
    /// Machine that needs no token to watch the page, with =act to drive and end trials too; may be repeated
    #[arg(long, value_name = "ADDRESS[=act]", value_parser = listed)]
    page_allow: Vec<Listed>,
    /// For a headset: HTTPS on all addresses, and a QR code to open the page with
    #[arg(long)]
    headset: bool,
    /// Folder for the records of the trials
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Do not record
    #[arg(long, conflicts_with = "out")]
    no_record: bool,
    /// Gestures from an armband instead of keys: gforce-sim://HOST:PORT, ble, ble:NAME, lsl, lsl:NAME, file:PATH,
    /// synthetic, person:FOLDER or keys
    #[arg(long, value_name = "SOURCE", requires = "emg_model")]
    emg_source: Option<SourceName>,
    /// Model of the armband, as `proact emg train` writes it
    #[arg(long, value_name = "FILE", requires = "emg_source")]
    emg_model: Option<PathBuf>,
    /// Print the address of the page, open nothing
    #[arg(long)]
    no_browser: bool,
    #[command(flatten)]
    person: PersonArgs,
}

pub(crate) fn command(registry: &Registry, args: &ServeArgs) -> Result<bool, Box<dyn Error>> {
    let mut asked = args.trial.clone();
    let interrupted = interrupt_flag()?;
    let armband = match (&args.emg_source, &args.emg_model) {
        (Some(source), Some(model)) => Some(LiveArmband::open(&registry.sources, source, model)?),
        _ => None,
    };
    let mut gaze_offset = GazeOffset::default();
    let mut server: Option<PageServer> = None;
    let mut person: Option<LivePerson> = None;
    loop {
        let emg = armband.as_ref().map(|armband| armband.model().config.clone());
        let (arm, config) = asked.config(&registry.methods, "still", emg)?;
        let seed = config.seed;
        let worn = match &armband {
            Some(armband) => {
                let trained = armband.model();
                let commands = config.gesture_commands(trained.config.rest, &trained.classifier)?;
                Some(Armband { trained, samples: armband.port(commands) })
            }
            None => None,
        };
        let Assembly { session, classifier, plans, .. } =
            trial::live_with(&registry.methods, &arm, config, worn)?;
        let config = session.testbed().config().clone();
        let dir = match (&args.out, args.no_record) {
            (_, true) => None,
            (Some(out), _) => Some(free_dir(out.join(format!("seed{seed}")))),
            (None, _) => Some(default_dir(&config)),
        };
        let recorder = match &dir {
            Some(dir) => Some(Recorder::create(dir, &config, &arm, classifier.as_ref())?.with_plans(plans)?),
            None => None,
        };
        let content = PageContent {
            title: format!("Method {}", config.method_label()),
            setup: config.setup.name.clone(),
            arm: arm.model().as_ref().clone(),
            meshes: arm.meshes(),
            scene: session.testbed().task().scene().clone(),
            briefing: session.testbed().task().briefing().clone(),
            interactive: true,
            lean: config.setup.body.forward_max_deg > 0.0,
            method: session.testbed().method().clone(),
            methods: registry.methods.infos(),
        };
        let page = match &mut server {
            Some(server) => {
                server.set_content(content)?;
                server
            }
            none => {
                let (options, secret) = page_options(args)?;
                let started = none.insert(PageServer::start(options, content)?);
                announce(started, "", !args.no_browser, secret);
                announce_remote(started, args.headset, secret)?;
                started
            }
        };
        let person = match &mut person {
            Some(person) => {
                person.restart(&session)?;
                person
            }
            none => none.insert(args.person.open(&registry.sinks, &session)?),
        };
        let mut trial = LiveTrial {
            session,
            recorder,
            dir,
            page,
            person,
            gaze_offset: &mut gaze_offset,
            interrupted: &interrupted,
        };
        let (mut ended, result) = trial.run()?;
        print_result(&result)?;
        if matches!(ended, Ended::Finished | Ended::Aborted) {
            ended = trial.wait_for_restart()?;
        }
        let Ended::Restart { method: wanted, again } = ended else { break };
        asked = asked.next(wanted, again);
    }
    Ok(true)
}

/// Where and for whom the page is served, and whether its token is one that was given.
fn page_options(args: &ServeArgs) -> Result<(PageOptions, bool), Box<dyn Error>> {
    let bind = if args.headset { Ipv4Addr::UNSPECIFIED.into() } else { args.bind };
    let (access, given) = args.person.rosbridge.access.page_access(bind, args.page_allow.clone())?;
    let allow_next = !args.exact_port;
    let options =
        PageOptions { port: args.port, allow_next, bind, https: args.headset, access, ..Default::default() };
    Ok((options, given))
}

/// Tells how to open the page on another machine, for a headset as a QR code.
fn announce_remote(server: &PageServer, headset: bool, secret: bool) -> Result<(), Box<dyn Error>> {
    let Some(url) = server.remote_url() else { return Ok(()) };
    tell(format_args!("on another machine: {}", printed(&url, secret)));
    if headset {
        let code = qrcode::QrCode::new(&url)?;
        tell(format_args!("{}", code.render::<qrcode::render::unicode::Dense1x2>().build()));
        tell("The certificate is made anew at each start: the browser asks once whether to go on.");
    }
    Ok(())
}

/// `dir`, or the same with a number added if it is taken: the same blocks again are another trial.
fn free_dir(dir: PathBuf) -> PathBuf {
    let numbered = |k: u32| PathBuf::from(format!("{}-{k}", dir.display()));
    let names = std::iter::once(dir.clone()).chain((2..).map(numbered));
    names.into_iter().find(|name| !name.exists()).unwrap_or(dir)
}
