//! The dependency rule: types <- arm <- logic <- testbed <- (native, devices, recording, rosbridge, bridge, ros) <- app
//! <- (bench, fuzz, python) <- cli.

use crate::workspace::{Kind, Workspace, load};

/// The four crates that call C++, and the only ones that may write `unsafe`.
pub const NATIVE: [&str; 4] =
    ["proact-description", "proact-kinematics", "proact-planning", "proact-dynamics"];

/// Crates that no pure crate may contain, at any depth: they bring clocks, threads, sockets, C++ or ROS with them.
const IMPURE: [&str; 13] = [
    "axum",
    "chrono",
    "crossbeam-channel",
    "cxx",
    "hyper",
    "indicatif",
    "mio",
    "notify",
    "rayon",
    "rosrust",
    "signal-hook",
    "socket2",
    "tokio",
];

/// Below the outer crates because the page's server and rosbridge's share it; not pure, unlike all others down there.
const SHARED_BY_SERVERS: &str = "proact-http";

/// Below the outer crates because all that write files share it; not pure either.
const WRITER: &str = "proact-files";

/// Ours under the name of the crate in whose place it stands, with that crate's names for what it has.
pub const STAND_IN: &str = "xml-rpc";

/// Libraries that only some crates may depend on. There is one WebSocket stack, axum's, and one place that accepts
/// connections; `tokio-tungstenite`, which axum has inside, is for clients: those of tests, and those that take figures.
const RESERVED: [(&str, &[&str]); 9] = [
    ("cxx", &NATIVE),
    ("cxx-build", &NATIVE),
    ("rosrust", &["proact-ros"]),
    ("axum", &[SHARED_BY_SERVERS, "proact-bridge", "proact-rosbridge"]),
    ("hyper", &[SHARED_BY_SERVERS]),
    ("hyper-util", &[SHARED_BY_SERVERS]),
    ("tokio-rustls", &[SHARED_BY_SERVERS]),
    ("tokio-tungstenite", &["proact-bench"]),
    (STAND_IN, &["proact-ros", "proact-fuzz"]),
];

/// The layer of a crate; a crate may depend on lower layers only.
fn layer(package: &str) -> Option<u8> {
    Some(match package {
        "proact-types" => 0,
        "proact-arm" => 1,
        "proact-emg"
        | "proact-intent"
        | "proact-control"
        | "proact-tasks"
        | "proact-localization"
        | "proact-study"
        | "proact-participants"
        | "proact-analysis"
        | "proact-camera"
        | "proact-messages" => 2,
        "proact-testbed" | SHARED_BY_SERVERS | WRITER | STAND_IN => 3,
        "proact-description" | "proact-kinematics" | "proact-planning" | "proact-dynamics"
        | "proact-devices" | "proact-recording" | "proact-rosbridge" | "proact-bridge" | "proact-ros" => 4,
        "proact-app" => 5,
        "proact-bench" | "proact-fuzz" | "proact-python" => 6,
        "proact-cli" => 7,
        _ => return None,
    })
}

/// What in the workspace goes against the rule; empty when nothing does.
fn complaints(workspace: &Workspace) -> Vec<String> {
    let mut found = Vec::new();
    for (name, member) in &workspace.members {
        let Some(own) = layer(name) else {
            found.push(format!("{name} has no layer: give it one in this test and in ARCHITECTURE.md"));
            continue;
        };
        for (dependency, kind) in &member.dependencies {
            let Some(other) = layer(dependency) else { continue };
            // The tests of an outer crate may use its neighbours; those of a pure crate must run on a machine
            // without any native library.
            let allowed = match kind {
                Kind::Normal | Kind::Build => other < own,
                Kind::Dev => other < own || (own > 3 && other <= own),
            };
            if !allowed {
                found.push(format!(
                    "{name} (layer {own}) must not depend on {dependency} (layer {other}) as {kind:?}"
                ));
            }
        }
        for (library, users) in RESERVED {
            // Tests may speak to a server with a client of their own.
            let wanted = |(dependency, kind): &(String, Kind)| {
                dependency == library && (*kind != Kind::Dev || library != "tokio-tungstenite")
            };
            if member.dependencies.iter().any(wanted) && !users.contains(&name.as_str()) {
                found.push(format!("{name} depends on {library}, which only {users:?} may"));
            }
        }
        if own <= 3 && ![SHARED_BY_SERVERS, WRITER, STAND_IN].contains(&name.as_str()) {
            for impure in IMPURE.iter().filter(|impure| member.closure.contains(**impure)) {
                found.push(format!(
                    "{name} is pure but contains {impure}: cargo tree -p {name} -i {impure} shows how"
                ));
            }
        }
    }
    found
}

#[test]
fn arrows_between_crates_never_point_back() {
    let workspace = load();
    let found = complaints(&workspace);
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn every_kind_of_planted_offence_is_found() {
    let workspace = load();
    assert!(
        workspace.members["proact-cli"].closure.contains("proact-types"),
        "the closure reaches the vocabulary"
    );

    let offences = [
        ("proact-types", "proact-control", Kind::Normal, "must not depend on proact-control"),
        ("proact-arm", "proact-control", Kind::Normal, "must not depend on proact-control"),
        ("proact-emg", "proact-intent", Kind::Normal, "must not depend on proact-intent"),
        ("proact-participants", "proact-testbed", Kind::Normal, "must not depend on proact-testbed"),
        ("proact-planning", "proact-kinematics", Kind::Normal, "must not depend on proact-kinematics"),
        ("proact-testbed", "proact-dynamics", Kind::Dev, "must not depend on proact-dynamics"),
        ("proact-bridge", "rosrust", Kind::Normal, "depends on rosrust"),
        ("proact-bridge", "proact-rosbridge", Kind::Normal, "must not depend on proact-rosbridge"),
        ("proact-rosbridge", "proact-bridge", Kind::Normal, "must not depend on proact-bridge"),
        ("proact-testbed", "proact-http", Kind::Normal, "must not depend on proact-http"),
        ("proact-http", "proact-rosbridge", Kind::Normal, "must not depend on proact-rosbridge"),
        ("proact-rosbridge", "tokio-tungstenite", Kind::Normal, "depends on tokio-tungstenite"),
        ("proact-bridge", "hyper", Kind::Normal, "depends on hyper"),
        ("proact-devices", "axum", Kind::Normal, "depends on axum"),
        ("proact-control", "cxx", Kind::Normal, "depends on cxx"),
    ];
    for (from, to, kind, expected) in offences {
        let mut planted = workspace.clone();
        planted.members.get_mut(from).expect("the crate exists").dependencies.insert((to.to_owned(), kind));
        let found = complaints(&planted);
        assert!(
            found.iter().any(|c| c.starts_with(from) && c.contains(expected)),
            "{from} -> {to}: {found:?}"
        );
    }

    let mut planted = workspace.clone();
    planted.members.get_mut("proact-tasks").expect("the crate exists").closure.insert("tokio".to_owned());
    assert!(complaints(&planted).iter().any(|c| c.contains("proact-tasks is pure but contains tokio")));

    let mut planted = workspace;
    planted.members.insert("proact-unheard-of".to_owned(), crate::workspace::Member::default());
    assert!(complaints(&planted).iter().any(|c| c.contains("proact-unheard-of has no layer")));
}
