//! What of this machine works for ProACT, and what to do about the rest.
//!
//! Every line is found out at the moment of asking: libraries from the memory map of this very process, ports by
//! binding them, the working directory by writing into it. Nothing is changed; what is written is removed.

use std::env;
use std::net::{TcpListener, TcpStream, ToSocketAddrs};
use std::path::Path;
use std::time::{Duration, Instant};

use crate::{
    CALIBRATIONS_DIR, Calibrations, MocapAxes, Registry, TrackedBody,
    libraries::{LIBRARIES, command_output, loaded_libraries},
};
use proact_devices::{SourceName, SourceScheme, motion_capture::OpenedCapture};
use proact_files::check_folder;
use serde::Serialize;

/// Port of the page. When it is taken the program uses the next free one.
const PAGE_PORT: u16 = 8090;
/// Port of rosbridge, used only when asked for.
const ROSBRIDGE_PORT: u16 = 9090;
/// A ROS master on the same network answers within milliseconds; a filtered port never does.
const MASTER_TIMEOUT: Duration = Duration::from_millis(500);

/// Programs that build ProACT: name, and what it is for.
const BUILD_TOOLS: [(&str, &str); 6] = [
    ("cargo", "builds the program"),
    ("rustc", "builds the program"),
    ("g++", "builds the C++ cores"),
    ("pkg-config", "finds the C++ libraries"),
    ("node", "bundles the page"),
    ("npm", "fetches the page's libraries"),
];

/// Browsers in the order in which they are looked for; the last opens whatever the desktop prefers.
const BROWSERS: [&str; 6] =
    ["chromium", "google-chrome", "chromium-browser", "firefox", "firefox-esr", "xdg-open"];

/// How one line of the report came out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum CheckStatus {
    /// Works.
    Ok,
    /// Something optional is missing, or the program will do it in another way.
    Warn,
    /// The program cannot do its work.
    Fail,
}

/// One line of the report.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct DoctorCheck {
    /// What was looked at.
    pub name: String,
    /// How it came out.
    pub status: CheckStatus,
    /// What was found.
    pub found: String,
    /// What to do about it; empty when there is nothing to do.
    pub advice: String,
}

impl DoctorCheck {
    pub(crate) fn ok(name: impl Into<String>, found: impl Into<String>) -> Self {
        Self { name: name.into(), status: CheckStatus::Ok, found: found.into(), advice: String::new() }
    }

    pub(crate) fn warn(name: impl Into<String>, found: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { name: name.into(), status: CheckStatus::Warn, found: found.into(), advice: advice.into() }
    }

    pub(crate) fn fail(name: impl Into<String>, found: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { name: name.into(), status: CheckStatus::Fail, found: found.into(), advice: advice.into() }
    }
}

/// Makes every check, in the order of the report, with what `registry` offers.
pub fn run_checks(registry: &Registry) -> Vec<DoctorCheck> {
    let mut checks = vec![machine()];
    checks.extend(libraries());
    checks.extend(build_tools());
    checks.push(browser());
    checks.push(display());
    checks.push(port("page port", PAGE_PORT, "the page takes the next free port and prints it"));
    checks.push(port("rosbridge port", ROSBRIDGE_PORT, "end that program before asking for rosbridge"));
    checks.push(check_writable(Path::new(".")));
    checks.push(DoctorCheck::ok("methods", registry.methods.names().join(", ")));
    checks.extend(check_features(registry));
    checks.extend(calibrations(Path::new(CALIBRATIONS_DIR)));
    checks.push(DoctorCheck::ok("feedback", sinks(registry)));
    checks.push(ros_master(env::var("ROS_MASTER_URI").ok().as_deref()));
    checks
}

/// The optional features, and the sources that this program can open.
fn check_features(registry: &Registry) -> Vec<DoctorCheck> {
    let mut checks: Vec<DoctorCheck> = FEATURES.iter().map(CargoFeature::check).collect();
    let sources = registry.sources.schemes().iter().filter(|scheme| is_built_in(scheme.scheme));
    let sources: Vec<String> = sources.map(SourceScheme::syntax).collect();
    checks.push(DoctorCheck::ok("EMG", sources.join(", ")));
    let captures = registry.captures.iter().filter(|scheme| is_built_in(scheme.scheme));
    let captures: Vec<&str> = captures.map(|scheme| scheme.form).collect();
    checks.push(DoctorCheck::ok("motion capture", captures.join(", ")));
    checks
}

/// A part of the program that is compiled only when its feature is asked for.
struct CargoFeature {
    name: &'static str,
    built_in: bool,
    what: &'static str,
    /// Kinds of sources that need it.
    schemes: &'static [&'static str],
    /// What a build with it needs on Debian.
    needs: &'static str,
}

const FEATURES: [CargoFeature; 3] = [
    CargoFeature {
        name: "ble",
        built_in: cfg!(feature = "ble"),
        what: "armbands over Bluetooth",
        schemes: &["ble", "myo"],
        needs: "libdbus-1-dev",
    },
    CargoFeature {
        name: "lsl",
        built_in: cfg!(feature = "lsl"),
        what: "streams of the lab streaming layer",
        schemes: &["lsl"],
        needs: "cmake",
    },
    CargoFeature {
        name: "ros",
        built_in: cfg!(feature = "ros"),
        what: "nodes and poses of a ROS 1 graph",
        schemes: &["ros", "tf"],
        needs: "ros-std-msgs and the other message packages of docs/ros1.md",
    },
];

impl CargoFeature {
    fn check(&self) -> DoctorCheck {
        let Self { name, built_in, what, schemes, needs } = self;
        let (label, sources) = (format!("feature {name}"), schemes.join(", "));
        if *built_in {
            return DoctorCheck::ok(label, format!("built in: {what} ({sources})"));
        }
        let advice = format!("PROACT_FEATURES={name} ./proact builds it in; on Debian it needs {needs}");
        DoctorCheck::warn(label, format!("not built in: {what} ({sources})"), advice)
    }
}

/// Whether a source of this kind can be opened by this program.
fn is_built_in(scheme: &str) -> bool {
    FEATURES.iter().all(|feature| feature.built_in || !feature.schemes.contains(&scheme))
}

/// How long a tracking source is listened to: connecting, names of bodies, and some seconds of poses.
const LISTEN_TIME: Duration = Duration::from_secs(4);
/// From look to look.
const POLL_PERIOD: Duration = Duration::from_millis(10);
/// Slower than this a shoulder is followed in steps, Hz.
const MIN_RATE_HZ: f64 = 30.0;
/// More than this share of the time in drop-outs is too much.
const MAX_DROPOUT_FRACTION: f64 = 0.1;

/// Listens to a tracking source for some seconds: its rate, the age of its newest pose, and whether an arm could follow it.
pub fn tracking(registry: &Registry, name: &SourceName, axes: MocapAxes) -> DoctorCheck {
    let label = format!("tracking {name}");
    let mut body = match OpenedCapture::open(&registry.captures, name) {
        Ok(opened) => TrackedBody::new(opened, axes),
        Err(error) => return DoctorCheck::fail(label, "cannot be opened", error.to_string()),
    };
    let began = Instant::now();
    while began.elapsed() < LISTEN_TIME {
        if let Err(error) = body.poll() {
            return DoctorCheck::fail(label, "cannot be used", error.to_string());
        }
        std::thread::sleep(POLL_PERIOD);
    }
    let report = body.report();
    let age = report
        .age_secs
        .map_or("no pose yet".to_owned(), |age| format!("newest pose {:.0} ms old", age * 1e3));
    let noise = report.noise_m.zip(report.noise_rad);
    let noise = noise.map_or(String::new(), |(position_noise, turn)| {
        format!(", noise {:.2} mm and {:.2} deg", position_noise * 1e3, turn.to_degrees())
    });
    let stream = report.stream.map_or(String::new(), |stream| {
        format!(
            ", lag {:.0} ms, jitter {:.0} ms, {} drop-outs ({:.1} % of the time, longest {:.0} ms)",
            stream.lag_secs * 1e3,
            stream.jitter_secs * 1e3,
            stream.dropouts,
            stream.missing_fraction * 1e2,
            stream.longest_gap_secs * 1e3
        )
    });
    let found = format!("body {:?}: {:.0} Hz, {age}{stream}{noise}", report.body, report.rate_hz);
    match report.fault {
        Some(fault) => DoctorCheck::fail(label, found, fault),
        None if report.rate_hz < MIN_RATE_HZ => DoctorCheck::warn(
            label,
            found,
            format!("slower than {MIN_RATE_HZ} Hz: raise the rate of the stream"),
        ),
        None if report.stream.is_some_and(|stream| stream.missing_fraction > MAX_DROPOUT_FRACTION) => {
            let advice = "the body is often not seen: clear the view of the cameras, check its markers";
            DoctorCheck::warn(label, found, advice)
        }
        None => DoctorCheck::ok(label, found),
    }
}

/// What `proact localize` found, a line each; one without any.
fn calibrations(dir: &Path) -> Vec<DoctorCheck> {
    let found = match Calibrations::load(dir) {
        Ok(found) => found.summaries(),
        Err(error) => return vec![DoctorCheck::fail("calibrations", "cannot be read", error.to_string())],
    };
    if found.is_empty() {
        let found = format!("none in {}", dir.display());
        return vec![DoctorCheck::ok("calibrations", found)];
    }
    let check = |(kind, line, good): (&str, String, bool)| {
        let label = format!("calibration {kind}");
        if good {
            DoctorCheck::ok(label, line)
        } else {
            DoctorCheck::warn(label, line, format!("repeat it: proact localize {kind} --help"))
        }
    };
    found.into_iter().map(check).collect()
}

fn sinks(registry: &Registry) -> String {
    let forms = registry.sinks.iter().map(|sink| format!("{}{}", sink.scheme, sink.address));
    forms.collect::<Vec<_>>().join(", ")
}

/// Cores of the machine; one physics loop, one planner and one page want two of them.
fn machine() -> DoctorCheck {
    let program = format!("proact {} on {}", env!("CARGO_PKG_VERSION"), env::consts::ARCH);
    match std::thread::available_parallelism().map(usize::from) {
        Ok(1) => DoctorCheck::warn(
            "program",
            format!("{program}, 1 core"),
            "a live trial may fall behind on one core",
        ),
        Ok(cores) => DoctorCheck::ok("program", format!("{program}, {cores} cores")),
        Err(_) => DoctorCheck::ok("program", program),
    }
}

// --- Libraries ----------------------------------------------------------------------------------------------

fn libraries() -> Vec<DoctorCheck> {
    let (loaded, versions) = loaded_libraries();
    let mut checks: Vec<DoctorCheck> = LIBRARIES
        .iter()
        .zip(&loaded)
        .map(|((name, file, package), path)| match path {
            Some(path) => {
                let file_name = path.file_name().unwrap_or_default().to_string_lossy();
                let version = versions.get(path).map_or("not from a Debian package", String::as_str);
                DoctorCheck::ok(*name, format!("{version} ({file_name})"))
            }
            None => DoctorCheck::warn(
                *name,
                format!("no {file} in this program"),
                format!("build with the feature \"native\"; on Debian it needs {package}"),
            ),
        })
        .collect();
    // Eigen is headers only: what counts is what is there for the next build.
    checks.push(match command_output("pkg-config", &["--modversion", "eigen3"]) {
        Some(version) => DoctorCheck::ok("Eigen", format!("{version} (headers)")),
        None => DoctorCheck::warn(
            "Eigen",
            "no headers",
            "needed only for building; on Debian: apt-get install libeigen3-dev",
        ),
    });
    checks
}

// --- Programs -----------------------------------------------------------------------------------------------

fn build_tools() -> Vec<DoctorCheck> {
    BUILD_TOOLS
        .iter()
        .map(|(tool, purpose)| match command_output(tool, &["--version"]) {
            Some(version) => DoctorCheck::ok(*tool, version),
            None => DoctorCheck::warn(
                *tool,
                "not found",
                format!("needed only for building ({purpose}); ./proact installs it on Debian"),
            ),
        })
        .collect()
}

fn browser() -> DoctorCheck {
    match BROWSERS.iter().find(|name| is_on_path(name)) {
        Some(name) => DoctorCheck::ok("browser", *name),
        None => DoctorCheck::warn(
            "browser",
            "none found",
            "open the printed address in a browser, on this machine or through a tunnel",
        ),
    }
}

fn is_on_path(program: &str) -> bool {
    env::var_os("PATH")
        .is_some_and(|path| env::split_paths(&path).any(|folder| folder.join(program).is_file()))
}

fn display() -> DoctorCheck {
    let set = |name: &str| env::var(name).ok().filter(|value| !value.is_empty());
    match (set("WAYLAND_DISPLAY"), set("DISPLAY")) {
        (Some(wayland), _) => DoctorCheck::ok("display", wayland),
        (None, Some(x11)) => DoctorCheck::ok("display", x11),
        (None, None) => DoctorCheck::warn(
            "display",
            "none",
            "no browser can be opened here; --headless needs none, and the page works remotely",
        ),
    }
}

// --- Network and files --------------------------------------------------------------------------------------

/// Whether a port of this machine can be bound. The listener is dropped at once, which frees it again.
fn port(name: &str, number: u16, when_taken: &str) -> DoctorCheck {
    match TcpListener::bind(("127.0.0.1", number)) {
        Ok(_) => DoctorCheck::ok(name, format!("{number} is free")),
        Err(error) => DoctorCheck::warn(name, format!("{number} cannot be used: {error}"), when_taken),
    }
}

/// Whether a file can be made in the folder, where trials are written unless `--out` says otherwise.
fn check_writable(folder: &Path) -> DoctorCheck {
    let shown = folder.canonicalize().unwrap_or_else(|_| folder.to_path_buf()).display().to_string();
    match check_folder(folder) {
        Ok(()) => DoctorCheck::ok("working directory", format!("{shown} can be written to")),
        Err(error) => DoctorCheck::fail(
            "working directory",
            error.to_string(),
            "trials cannot be written here: change to another folder, or give --out DIR",
        ),
    }
}

/// Whether the ROS master that the environment names answers. ROS is optional, so this never fails.
fn ros_master(uri: Option<&str>) -> DoctorCheck {
    let Some(uri) = uri.filter(|uri| !uri.is_empty()) else {
        return DoctorCheck::ok("ROS master", "none named by ROS_MASTER_URI; none is needed");
    };
    // The form is http://host:port/ with an optional slash.
    let address = uri.trim_start_matches("http://").trim_end_matches('/');
    let sockets = match address.to_socket_addrs() {
        Ok(sockets) => sockets,
        Err(error) => {
            return DoctorCheck::warn(
                "ROS master",
                format!("ROS_MASTER_URI=\"{uri}\": {error}"),
                "expected the form http://HOST:PORT; unset it if ROS is not used",
            );
        }
    };
    for socket in sockets {
        if TcpStream::connect_timeout(&socket, MASTER_TIMEOUT).is_ok() {
            return DoctorCheck::ok("ROS master", format!("{uri} answers"));
        }
    }
    DoctorCheck::warn(
        "ROS master",
        format!("{uri} does not answer"),
        "start roscore if ROS is used; nothing else needs it",
    )
}

// --- Writing ------------------------------------------------------------------------------------------------

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    /// It listed Bluetooth, LSL and ROS sources that the program could not open.
    #[test]
    fn only_sources_that_are_built_in_are_listed_and_each_feature_says_whether_it_is() {
        let checks = check_features(&Registry::standard());
        let found = |name: &str| checks.iter().find(|check| check.name == name).expect("it is checked");
        let mut forms = found("EMG").found.split(", ").chain(found("motion capture").found.split(", "));
        assert!(forms.clone().any(|form| form.starts_with("file:")), "what is always there is listed");
        for feature in &FEATURES {
            let check = found(&format!("feature {}", feature.name));
            assert_eq!(check.status == CheckStatus::Ok, feature.built_in, "{check:?}");
            let lists =
                |scheme: &&str| forms.clone().any(|form| form.split([':', '[']).next() == Some(scheme));
            assert_eq!(feature.schemes.iter().all(lists), feature.built_in, "{:?}", feature.schemes);
            assert_eq!(feature.schemes.iter().any(lists), feature.built_in, "{:?}", feature.schemes);
        }
        assert!(forms.all(|form| !form.is_empty()));
    }

    #[test]
    fn a_taken_port_is_a_warning_and_a_free_one_is_not() {
        let holder = TcpListener::bind(("127.0.0.1", 0)).expect("some port is free");
        let number = holder.local_addr().expect("it is bound").port();
        assert_eq!(port("p", number, "do this").status, CheckStatus::Warn);
        drop(holder);
        // Another test may take a port in the moment after it is free; it does not take five in turn.
        let freed = || {
            let holder = TcpListener::bind(("127.0.0.1", 0)).expect("some port is free");
            holder.local_addr().expect("it is bound").port()
        };
        assert!((0..5).any(|_| port("p", freed(), "do this").status == CheckStatus::Ok));
    }

    #[test]
    fn a_folder_that_cannot_be_written_to_fails_with_advice() {
        let folder = tempfile::tempdir().expect("a folder can be made");
        assert_eq!(check_writable(folder.path()).status, CheckStatus::Ok);
        let left = fs::read_dir(folder.path()).expect("it can be read").count();
        assert_eq!(left, 0, "the probe must be removed");

        let file = folder.path().join("file");
        fs::write(&file, "").expect("it can be written");
        let check = check_writable(&file);
        assert_eq!(check.status, CheckStatus::Fail);
        assert!(check.advice.contains("--out"), "{}", check.advice);
    }

    #[test]
    fn a_master_that_is_not_named_is_not_needed() {
        assert_eq!(ros_master(None).status, CheckStatus::Ok);
        assert_eq!(ros_master(Some("")).status, CheckStatus::Ok);
    }

    #[test]
    fn a_master_is_asked_at_the_address_that_the_environment_names() {
        // An address of its own: another test's listener on 127.0.0.1 could take the port over once it is free.
        let master = TcpListener::bind(("127.83.17.5", 0)).expect("all of 127/8 is this machine");
        let uri = format!("http://{}/", master.local_addr().expect("it is bound"));
        assert_eq!(ros_master(Some(&uri)).status, CheckStatus::Ok);
        drop(master);
        assert_eq!(ros_master(Some(&uri)).status, CheckStatus::Warn);
        let malformed = ros_master(Some("nonsense"));
        assert_eq!(malformed.status, CheckStatus::Warn);
        assert!(malformed.advice.contains("http://HOST:PORT"), "{}", malformed.advice);
    }
}
