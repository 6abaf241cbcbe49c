//! The dependency rule: types <- arm <- logic <- testbed <- (native, devices, recording, bridge, ros) <- app <- bench
//! <- cli.

use crate::workspace::{Kind, Workspace, load};

/// The four crates that call C++, and the only ones that may write `unsafe`.
pub const NATIVE: [&str; 4] =
    ["proact-description", "proact-kinematics", "proact-planning", "proact-dynamics"];

/// Crates that no pure crate may contain, at any depth: they bring clocks, threads, sockets, C++ or ROS with them.
const IMPURE: [&str; 13] = [
    "axum",
    "chrono",
    "crossbeam-channel",
    "ctrlc",
    "cxx",
    "hyper",
    "indicatif",
    "mio",
    "notify",
    "rayon",
    "rosrust",
    "socket2",
    "tokio",
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
        | "proact-analysis" => 2,
        "proact-testbed" => 3,
        "proact-description" | "proact-kinematics" | "proact-planning" | "proact-dynamics"
        | "proact-devices" | "proact-recording" | "proact-bridge" | "proact-ros" => 4,
        "proact-app" => 5,
        "proact-bench" => 6,
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
        let direct = |wanted: &str| member.dependencies.iter().any(|(dependency, _)| dependency == wanted);
        for (library, users) in
            [("cxx", &NATIVE[..]), ("cxx-build", &NATIVE[..]), ("rosrust", &["proact-ros"][..])]
        {
            if direct(library) && !users.contains(&name.as_str()) {
                found.push(format!("{name} depends on {library}, which only {users:?} may"));
            }
        }
        if own <= 3 {
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
