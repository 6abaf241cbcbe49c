//! `proact doctor`: looks at this machine and says, line by line, what works and what to do about the rest.
//!
//! Every line is found out at the moment of asking: libraries from the memory map of this very process, ports by
//! binding them, the working directory by writing into it. Nothing is changed; what is written is removed.
//!
//! ```text
//! $ proact doctor
//! ok    OMPL              1.5.2+ds1-1 (libompl.so.1.5.2)
//! warn  port 9090         taken by another program
//!                         -> give rosbridge another port, or end that program
//! ```

// A doctor asks the machine itself: environment, files and sockets are its subject.
#![allow(clippy::disallowed_methods)]

use std::collections::BTreeMap;
use std::env;
use std::fs;
use std::io::{self, Write};
use std::net::{TcpListener, TcpStream, ToSocketAddrs};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use serde::Serialize;

/// Port of the page. When it is taken the program uses the next free one.
const PAGE_PORT: u16 = 8090;
/// Port of rosbridge, used only when asked for.
const ROSBRIDGE_PORT: u16 = 9090;
/// A ROS master on the same network answers within milliseconds; a filtered port never does.
const MASTER_TIMEOUT: Duration = Duration::from_millis(500);

/// The native libraries: name for people, beginning of the file name, Debian package with the headers.
const LIBRARIES: [(&str, &str, &str); 6] = [
    ("KDL", "liborocos-kdl.so", "liborocos-kdl-dev"),
    ("OMPL", "libompl.so", "libompl-dev"),
    ("ODE", "libode.so", "libode-dev"),
    ("urdfdom", "liburdfdom_model.so", "liburdfdom-dev"),
    ("FCL", "libfcl.so", "libfcl-dev"),
    ("libccd", "libccd.so", "libccd-dev"),
];

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
enum Status {
    /// Works.
    Ok,
    /// Something optional is missing, or the program will do it in another way.
    Warn,
    /// The program cannot do its work.
    Fail,
}

/// One line of the report.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
struct Check {
    name: String,
    status: Status,
    found: String,
    /// What to do about it; empty when there is nothing to do.
    advice: String,
}

impl Check {
    fn ok(name: impl Into<String>, found: impl Into<String>) -> Self {
        Self { name: name.into(), status: Status::Ok, found: found.into(), advice: String::new() }
    }

    fn warn(name: impl Into<String>, found: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { name: name.into(), status: Status::Warn, found: found.into(), advice: advice.into() }
    }

    fn fail(name: impl Into<String>, found: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { name: name.into(), status: Status::Fail, found: found.into(), advice: advice.into() }
    }
}

/// Prints the report on standard output, for people or as one JSON object.
///
/// The object has `version`, `ok` and `checks[{name, status, found, advice}]`, where `status` is `ok`, `warn` or
/// `fail`. Returns whether no check failed; a warning is no failure.
///
/// # Errors
/// Standard output cannot be written to.
pub fn run(json: bool) -> io::Result<bool> {
    let checks = examine();
    let healthy = checks.iter().all(|check| check.status != Status::Fail);
    let mut out = io::stdout().lock();
    if json {
        write_json(&mut out, &checks, healthy)?;
    } else {
        write_text(&mut out, &checks)?;
    }
    Ok(healthy)
}

/// Makes every check, in the order of the report.
fn examine() -> Vec<Check> {
    let mut checks = vec![machine()];
    checks.extend(libraries());
    checks.extend(build_tools());
    checks.push(browser());
    checks.push(display());
    checks.push(port("page port", PAGE_PORT, "the page takes the next free port and prints it"));
    checks.push(port("rosbridge port", ROSBRIDGE_PORT, "end that program before asking for rosbridge"));
    checks.push(writable(Path::new(".")));
    checks.push(Check::ok("EMG", "synthetic generator; recordings with --emg DIR"));
    checks.push(ros_master(env::var("ROS_MASTER_URI").ok().as_deref()));
    checks
}

/// Cores of the machine; one physics loop, one planner and one page want two of them.
fn machine() -> Check {
    let program = format!("proact {} on {}", env!("CARGO_PKG_VERSION"), env::consts::ARCH);
    match std::thread::available_parallelism().map(usize::from) {
        Ok(1) => {
            Check::warn("program", format!("{program}, 1 core"), "a live trial may fall behind on one core")
        }
        Ok(cores) => Check::ok("program", format!("{program}, {cores} cores")),
        Err(_) => Check::ok("program", program),
    }
}

// --- Libraries ----------------------------------------------------------------------------------------------

/// The files of [`LIBRARIES`] that this process has loaded, and their Debian versions.
fn loaded_libraries() -> (Vec<Option<PathBuf>>, BTreeMap<PathBuf, String>) {
    // Only Linux has this file; elsewhere every library is reported as not found, which is the truth there.
    let map = fs::read_to_string("/proc/self/maps").unwrap_or_default();
    let loaded: Vec<Option<PathBuf>> =
        LIBRARIES.iter().map(|(_, file, _)| loaded_library(&map, file)).collect();
    let versions = debian_versions(&loaded.iter().flatten().cloned().collect::<Vec<_>>());
    (loaded, versions)
}

/// The version of each native library that this process has loaded, by its name for people: Debian's, or else the name
/// of its file.
pub(crate) fn library_versions() -> BTreeMap<&'static str, String> {
    let (loaded, versions) = loaded_libraries();
    let version = |path: PathBuf| {
        let file = || path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        versions.get(&path).cloned().unwrap_or_else(file)
    };
    LIBRARIES.iter().zip(loaded).filter_map(|((name, ..), path)| Some((*name, version(path?)))).collect()
}

fn libraries() -> Vec<Check> {
    let (loaded, versions) = loaded_libraries();
    let mut checks: Vec<Check> = LIBRARIES
        .iter()
        .zip(&loaded)
        .map(|((name, file, package), path)| match path {
            Some(path) => {
                let file_name = path.file_name().unwrap_or_default().to_string_lossy();
                let version = versions.get(path).map_or("not from a Debian package", String::as_str);
                Check::ok(*name, format!("{version} ({file_name})"))
            }
            None => Check::warn(
                *name,
                format!("no {file} in this program"),
                format!("build with the feature \"native\"; on Debian it needs {package}"),
            ),
        })
        .collect();
    // Eigen is headers only: what counts is what is there for the next build.
    checks.push(match output_of("pkg-config", &["--modversion", "eigen3"]) {
        Some(version) => Check::ok("Eigen", format!("{version} (headers)")),
        None => Check::warn(
            "Eigen",
            "no headers",
            "needed only for building; on Debian: apt-get install libeigen3-dev",
        ),
    });
    checks
}

/// The file of a library whose name begins with `file`, as mapped into this process.
///
/// `map` is the text of `/proc/self/maps`: the path is the sixth column, and a library has several lines.
fn loaded_library(map: &str, file: &str) -> Option<PathBuf> {
    map.lines()
        .filter_map(|line| line.find('/').map(|start| Path::new(&line[start..])))
        .find(|path| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(file)))
        .map(Path::to_path_buf)
}

/// The Debian version of each file that belongs to a package. Empty where there is no dpkg.
fn debian_versions(paths: &[PathBuf]) -> BTreeMap<PathBuf, String> {
    if paths.is_empty() {
        return BTreeMap::new();
    }
    // `dpkg-query -S` prints "package:architecture: path" and fails for files of no package, after printing the rest.
    let searched = Command::new("dpkg-query").arg("-S").args(paths).output();
    let Ok(searched) = searched else { return BTreeMap::new() };
    let owners: Vec<(String, PathBuf)> = String::from_utf8_lossy(&searched.stdout)
        .lines()
        .filter_map(|line| line.split_once(": "))
        .map(|(package, path)| (package.to_owned(), PathBuf::from(path)))
        .collect();
    owners
        .into_iter()
        .filter_map(|(package, path)| {
            output_of("dpkg-query", &["-W", "-f", "${Version}", &package]).map(|version| (path, version))
        })
        .collect()
}

// --- Programs -----------------------------------------------------------------------------------------------

fn build_tools() -> Vec<Check> {
    BUILD_TOOLS
        .iter()
        .map(|(tool, purpose)| match output_of(tool, &["--version"]) {
            Some(version) => Check::ok(*tool, version),
            None => Check::warn(
                *tool,
                "not found",
                format!("needed only for building ({purpose}); ./proact installs it on Debian"),
            ),
        })
        .collect()
}

/// First line of what a program prints, or nothing when it cannot be run or fails.
fn output_of(program: &str, arguments: &[&str]) -> Option<String> {
    let output = Command::new(program).args(arguments).output().ok()?;
    let text = String::from_utf8_lossy(&output.stdout);
    let line = text.lines().next().unwrap_or_default().trim();
    (output.status.success() && !line.is_empty()).then(|| line.to_owned())
}

fn browser() -> Check {
    match BROWSERS.iter().find(|name| on_path(name)) {
        Some(name) => Check::ok("browser", *name),
        None => Check::warn(
            "browser",
            "none found",
            "open the printed address in a browser, on this machine or through a tunnel",
        ),
    }
}

fn on_path(program: &str) -> bool {
    env::var_os("PATH")
        .is_some_and(|path| env::split_paths(&path).any(|folder| folder.join(program).is_file()))
}

fn display() -> Check {
    let set = |name: &str| env::var(name).ok().filter(|value| !value.is_empty());
    match (set("WAYLAND_DISPLAY"), set("DISPLAY")) {
        (Some(wayland), _) => Check::ok("display", wayland),
        (None, Some(x11)) => Check::ok("display", x11),
        (None, None) => Check::warn(
            "display",
            "none",
            "no browser can be opened here; --headless needs none, and the page works remotely",
        ),
    }
}

// --- Network and files --------------------------------------------------------------------------------------

/// Whether a port of this machine can be bound. The listener is dropped at once, which frees it again.
fn port(name: &str, number: u16, when_taken: &str) -> Check {
    match TcpListener::bind(("127.0.0.1", number)) {
        Ok(_) => Check::ok(name, format!("{number} is free")),
        Err(error) => Check::warn(name, format!("{number} cannot be used: {error}"), when_taken),
    }
}

/// Whether a file can be made in the folder, where trials are written unless `--out` says otherwise.
fn writable(folder: &Path) -> Check {
    let shown = folder.canonicalize().unwrap_or_else(|_| folder.to_path_buf()).display().to_string();
    // The process number keeps two doctors in one folder apart.
    let probe = folder.join(format!(".proact-doctor-{}", std::process::id()));
    let written = fs::OpenOptions::new()
        .write(true)
        .create_new(true)
        .open(&probe)
        .and_then(|mut file| file.write_all(b"proact"))
        .and_then(|()| fs::remove_file(&probe));
    match written {
        Ok(()) => Check::ok("working directory", format!("{shown} can be written to")),
        Err(error) => Check::fail(
            "working directory",
            format!("{shown}: {error}"),
            "trials cannot be written here: change to another folder, or give --out DIR",
        ),
    }
}

/// Whether the ROS master that the environment names answers. ROS is optional, so this never fails.
fn ros_master(uri: Option<&str>) -> Check {
    let Some(uri) = uri.filter(|uri| !uri.is_empty()) else {
        return Check::ok("ROS master", "none named by ROS_MASTER_URI; none is needed");
    };
    // The form is http://host:port/ with an optional slash.
    let address = uri.trim_start_matches("http://").trim_end_matches('/');
    let sockets = match address.to_socket_addrs() {
        Ok(sockets) => sockets,
        Err(error) => {
            return Check::warn(
                "ROS master",
                format!("ROS_MASTER_URI=\"{uri}\": {error}"),
                "expected the form http://HOST:PORT; unset it if ROS is not used",
            );
        }
    };
    for socket in sockets {
        if TcpStream::connect_timeout(&socket, MASTER_TIMEOUT).is_ok() {
            return Check::ok("ROS master", format!("{uri} answers"));
        }
    }
    Check::warn(
        "ROS master",
        format!("{uri} does not answer"),
        "start roscore if ROS is used; nothing else needs it",
    )
}

// --- Writing ------------------------------------------------------------------------------------------------

fn write_text(out: &mut impl Write, checks: &[Check]) -> io::Result<()> {
    for check in checks {
        let status = match check.status {
            Status::Ok => "ok",
            Status::Warn => "warn",
            Status::Fail => "FAIL",
        };
        writeln!(out, "{status:<5} {:<18} {}", check.name, check.found)?;
        if !check.advice.is_empty() {
            writeln!(out, "{:<24} -> {}", "", check.advice)?;
        }
    }
    let count = |wanted: Status| checks.iter().filter(|check| check.status == wanted).count();
    writeln!(
        out,
        "{} in order, {} to know about, {} that must be put right",
        count(Status::Ok),
        count(Status::Warn),
        count(Status::Fail)
    )
}

fn write_json(out: &mut impl Write, checks: &[Check], healthy: bool) -> io::Result<()> {
    #[derive(Serialize)]
    struct Report<'a> {
        version: &'a str,
        ok: bool,
        checks: &'a [Check],
    }
    let report = Report { version: env!("CARGO_PKG_VERSION"), ok: healthy, checks };
    serde_json::to_writer(&mut *out, &report)?;
    writeln!(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MAP: &str = "\
7f0000000000-7f0000001000 r--p 00000000 fe:00 1    /usr/lib/x86_64-linux-gnu/libode.so.8.2.0
7f0000001000-7f0000002000 r-xp 00001000 fe:00 1    /usr/lib/x86_64-linux-gnu/libode.so.8.2.0
7f0000002000-7f0000003000 rw-p 00000000 00:00 0
7f0000003000-7f0000004000 rw-p 00000000 00:00 0    [heap]
";

    #[test]
    fn a_loaded_library_is_found_by_the_beginning_of_its_file_name() {
        let path = loaded_library(MAP, "libode.so").expect("the map lists it");
        assert_eq!(path, Path::new("/usr/lib/x86_64-linux-gnu/libode.so.8.2.0"));
    }

    #[test]
    fn a_library_that_is_not_loaded_is_not_found() {
        assert_eq!(loaded_library(MAP, "libompl.so"), None);
        assert_eq!(loaded_library("", "libode.so"), None);
    }

    #[test]
    fn a_taken_port_is_a_warning_and_a_free_one_is_not() {
        let holder = TcpListener::bind(("127.0.0.1", 0)).expect("some port is free");
        let number = holder.local_addr().expect("it is bound").port();
        assert_eq!(port("p", number, "do this").status, Status::Warn);
        drop(holder);
        assert_eq!(port("p", number, "do this").status, Status::Ok);
    }

    #[test]
    fn a_folder_that_cannot_be_written_to_fails_with_advice() {
        let folder = tempfile::tempdir().expect("a folder can be made");
        assert_eq!(writable(folder.path()).status, Status::Ok);
        let left = fs::read_dir(folder.path()).expect("it can be read").count();
        assert_eq!(left, 0, "the probe must be removed");

        let check = writable(&folder.path().join("missing"));
        assert_eq!(check.status, Status::Fail);
        assert!(check.advice.contains("--out"), "{}", check.advice);
    }

    #[test]
    fn a_master_that_is_not_named_is_not_needed() {
        assert_eq!(ros_master(None).status, Status::Ok);
        assert_eq!(ros_master(Some("")).status, Status::Ok);
    }

    #[test]
    fn a_master_is_asked_at_the_address_that_the_environment_names() {
        let master = TcpListener::bind(("127.0.0.1", 0)).expect("some port is free");
        let uri = format!("http://127.0.0.1:{}/", master.local_addr().expect("it is bound").port());
        assert_eq!(ros_master(Some(&uri)).status, Status::Ok);
        drop(master);
        assert_eq!(ros_master(Some(&uri)).status, Status::Warn);
        let malformed = ros_master(Some("nonsense"));
        assert_eq!(malformed.status, Status::Warn);
        assert!(malformed.advice.contains("http://HOST:PORT"), "{}", malformed.advice);
    }

    #[test]
    fn the_json_report_is_one_object_on_one_line() {
        let checks = [Check::ok("a", "1"), Check::fail("b", "2", "do this")];
        let mut out = Vec::new();
        write_json(&mut out, &checks, false).expect("a vector takes everything");
        let text = String::from_utf8(out).expect("JSON is UTF-8");
        assert_eq!(text.lines().count(), 1);
        let value: serde_json::Value = serde_json::from_str(&text).expect("it is JSON");
        assert_eq!(value["ok"], false);
        assert_eq!(value["checks"][1]["status"], "fail");
        assert_eq!(value["checks"][1]["advice"], "do this");
    }

    #[test]
    fn the_text_report_gives_advice_under_its_line_and_counts_them() {
        let checks = [Check::ok("a", "1"), Check::warn("b", "2", "do this")];
        let mut out = Vec::new();
        write_text(&mut out, &checks).expect("a vector takes everything");
        let text = String::from_utf8(out).expect("the report is UTF-8");
        assert!(text.contains("-> do this"), "{text}");
        assert!(text.ends_with("1 in order, 1 to know about, 0 that must be put right\n"), "{text}");
    }
}
