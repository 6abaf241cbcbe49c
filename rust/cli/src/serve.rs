use crate::{
    access_args::listed,
    announce::{announce, print_result, printed},
    interrupt::interrupt_flag,
    person_args::PersonArgs,
    trial_args::TrialArgs,
};
use clap::{Args, Parser};
use proact_app::{
    Ended, LiveArmband, LivePerson, LiveTrial, Recorder, Registry, ResultCards, default_dir, tell,
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
    sync::atomic::AtomicBool,
};

/// Arguments of `proact serve`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  proact serve\n  proact serve --setup seated --port 8100\n  \
    proact serve --rosbridge --allow 192.168.1.20\n  \
    proact serve --headset\n  \
    proact serve --bind 0.0.0.0 --token-file ~/.proact_token --host-name testbed.example.org\n\n\
    Mouse is gaze; keys are gestures and are shown on the page. Time begins with the first action at the page. \
    R starts a new trial. Ctrl-C ends.")]
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
    let mut gaze_offset = GazeOffset::default();
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
            results: &mut results,
            interrupted,
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
        tell(qr_code(&url)?);
        tell(
            "The certificate is our own: the browser asks once whether to go on, and not again at the next start.",
        );
    }
    Ok(())
}

/// The QR code of `text` in black on white, whatever the colours of the terminal are: scanners want dark on light.
fn qr_code(text: &str) -> Result<String, qrcode::types::QrError> {
    const BLACK_ON_WHITE: &str = "\x1b[38;5;16;48;5;231m";
    let code = qrcode::QrCode::new(text)?;
    let picture = code.render::<qrcode::render::unicode::Dense1x2>().build();
    Ok(picture.lines().map(|line| format!("{BLACK_ON_WHITE}{line}\x1b[0m\n")).collect())
}

/// `dir`, or the same with a number added if it is taken: the same blocks again are another trial.
pub(crate) fn free_dir(dir: PathBuf) -> PathBuf {
    let numbered = |k: u32| PathBuf::from(format!("{}-{k}", dir.display()));
    let names = std::iter::once(dir.clone()).chain((2..).map(numbered));
    names.into_iter().find(|name| !name.exists()).unwrap_or(dir)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The modules of what is printed, dark ones true, as a scanner sees them on a terminal of any colours.
    fn seen(printed: &str) -> Result<Vec<Vec<bool>>, String> {
        let mut rows = Vec::new();
        for line in printed.lines() {
            let line = line.strip_prefix("\x1b[38;5;16;48;5;231m").ok_or("no colours of its own")?;
            let line = line.strip_suffix("\x1b[0m").ok_or("the colours go on")?;
            let halves: &[fn(char) -> bool] =
                &[|c| matches!(c, '\u{2580}' | '\u{2588}'), |c| matches!(c, '\u{2584}' | '\u{2588}')];
            rows.extend(halves.iter().map(|dark| line.chars().map(dark).collect::<Vec<_>>()));
        }
        Ok(rows)
    }

    #[test]
    fn the_qr_code_is_dark_on_light_with_a_margin_on_any_terminal() -> Result<(), Box<dyn Error>> {
        let url = "https://192.168.1.20:8090/?token=0123456789abcdef";
        let rows = seen(&qr_code(url)?)?;
        let code = qrcode::QrCode::new(url)?;
        const MARGIN: usize = 4;
        assert!(rows[..MARGIN].iter().flatten().all(|dark| !dark), "light around it");
        let width = code.width();
        for (y, modules) in code.to_colors().chunks(width).enumerate() {
            for (x, module) in modules.iter().enumerate() {
                let dark = *module == qrcode::Color::Dark;
                assert_eq!(rows[y + MARGIN][x + MARGIN], dark, "module {x}, {y}");
            }
        }
        Ok(())
    }
}
