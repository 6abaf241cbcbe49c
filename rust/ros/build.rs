//! Gathers the message definitions that the nodes are compiled from.
//!
//! rosrust reads definitions itself, but walks every folder that it is given, knows no actions, and does not
//! notice edited files. So one folder is made here with just the packages that are needed, each from the first
//! place that has it: `ROSRUST_MSG_PATH`, the prefixes of catkin, `/opt/ros`, this repository, then Debian. A package of a
//! workspace or an underlay thus comes before the one that this repository brings under the same name. Debian has none of
//! those names: what lies there is an installed ProACT's, which may be an older one.

// A build script reads files and the environment.
#![allow(clippy::disallowed_methods)]

use std::{
    env, fs,
    path::{Path, PathBuf},
};

/// What the nodes use, with what that refers to.
const PACKAGES: [&str; 20] = [
    "actionlib_msgs",
    "control_msgs",
    "controller_manager_msgs",
    "diagnostic_msgs",
    "gazebo_grasp_plugin_ros",
    "gazebo_msgs",
    "geometry_msgs",
    "moveit_msgs",
    "mpl_control",
    "object_recognition_msgs",
    "proact_msgs",
    "rosgraph_msgs",
    "sensor_msgs",
    "shoulder_localization",
    "std_msgs",
    "std_srvs",
    "tf2_msgs",
    "trajectory_msgs",
    "visualization_msgs",
    "shape_msgs",
];

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    for variable in ["CARGO_FEATURE_ROSRUST", "ROSRUST_MSG_PATH", "CMAKE_PREFIX_PATH"] {
        println!("cargo:rerun-if-env-changed={variable}");
    }
    if env::var_os("CARGO_FEATURE_ROSRUST").is_none() {
        return;
    }
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("Cargo sets it")).join("share");
    // What an earlier build gathered may be gone from its source.
    let _ = fs::remove_dir_all(&out);
    let message_dirs = message_folders();
    for package in PACKAGES {
        let Some(source) = message_dirs.iter().map(|p| p.join(package)).find(|p| has_definitions(p)) else {
            let searched: Vec<String> = message_dirs.iter().map(|p| p.display().to_string()).collect();
            panic!(
                "the message package {package} was not found in {}. On Debian: apt-get install ros-{}; elsewhere source \
                 the setup file of a ROS 1 installation, or set ROSRUST_MSG_PATH to the folders that hold the package",
                searched.join(", "),
                package.replace('_', "-")
            );
        };
        copy_package(&source, &out.join(package));
    }
    write(&out, "definitions.txt", &concatenate_definitions(&out));
    // rosrust reads both while it expands its macro in this crate, and only there.
    println!("cargo:rustc-env=ROSRUST_MSG_PATH={}", out.display());
    println!("cargo:rustc-env=CMAKE_PREFIX_PATH=");
}

/// Folders that hold message packages, best first.
fn message_folders() -> Vec<PathBuf> {
    let listed = |name: &str| env::var_os(name).unwrap_or_default();
    let mut message_dirs: Vec<PathBuf> =
        env::split_paths(&listed("ROSRUST_MSG_PATH")).filter(|p| !p.as_os_str().is_empty()).collect();
    for prefix in env::split_paths(&listed("CMAKE_PREFIX_PATH")).filter(|p| !p.as_os_str().is_empty()) {
        message_dirs.push(prefix.join("share"));
    }
    if let Ok(distributions) = fs::read_dir("/opt/ros") {
        message_dirs.extend(distributions.flatten().map(|d| d.path().join("share")));
    }
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../ros1_ws/src");
    message_dirs.push(own.clone());
    message_dirs.push(own.join("compat"));
    message_dirs.push("/usr/share".into());
    message_dirs
}

fn has_definitions(package: &Path) -> bool {
    ["msg", "srv", "action"].iter().any(|kind| package.join(kind).is_dir())
}

/// Copies a package's messages and services, and writes the messages of its actions.
fn copy_package(source: &Path, target: &Path) {
    for kind in ["msg", "srv", "action"] {
        let folder = source.join(kind);
        let Ok(entries) = fs::read_dir(&folder) else { continue };
        println!("cargo:rerun-if-changed={}", folder.display());
        for entry in entries.flatten() {
            let path = entry.path();
            if path.extension().is_none_or(|e| e != kind) {
                continue;
            }
            println!("cargo:rerun-if-changed={}", path.display());
            let text = fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
            let name = path.file_stem().expect("it has an extension").to_string_lossy().into_owned();
            if kind == "action" {
                for (name, text) in action_messages(&name, &text) {
                    write(&target.join("msg"), &format!("{name}.msg"), &text);
                }
            } else {
                write(&target.join(kind), &format!("{name}.{kind}"), &text);
            }
        }
    }
}

/// The seven messages of an action, as actionlib lays them out.
fn action_messages(name: &str, text: &str) -> Vec<(String, String)> {
    let mut parts: Vec<String> = vec![String::new()];
    for line in text.lines() {
        if line.trim() == "---" {
            parts.push(String::new());
        } else if let Some(part) = parts.last_mut() {
            part.push_str(line);
            part.push('\n');
        }
    }
    let [goal, result, feedback] = parts.try_into().unwrap_or_else(|parts: Vec<String>| {
        panic!("the action {name} has {} parts, expected goal, result and feedback", parts.len())
    });
    let status = "std_msgs/Header header\nactionlib_msgs/GoalStatus status\n";
    let named = |suffix: &str, text: String| (format!("{name}{suffix}"), text);
    vec![
        named("Goal", goal),
        named("Result", result),
        named("Feedback", feedback),
        named(
            "ActionGoal",
            format!("std_msgs/Header header\nactionlib_msgs/GoalID goal_id\n{name}Goal goal\n"),
        ),
        named("ActionResult", format!("{status}{name}Result result\n")),
        named("ActionFeedback", format!("{status}{name}Feedback feedback\n")),
        named(
            "Action",
            format!(
                "{name}ActionGoal action_goal\n{name}ActionResult action_result\n{name}ActionFeedback action_feedback\n"
            ),
        ),
    ]
}

/// The gathered definitions in one text, each after a line `>>> package/kind/Name`: what the program knows where it runs
/// without the packages.
fn concatenate_definitions(share: &Path) -> String {
    let mut text = String::new();
    for package in PACKAGES {
        for kind in ["msg", "srv"] {
            let Ok(entries) = fs::read_dir(share.join(package).join(kind)) else { continue };
            let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
            files.sort();
            for file in files {
                let name =
                    file.file_stem().expect("it was written with a name").to_string_lossy().into_owned();
                let source = fs::read_to_string(&file).expect("it was written just now");
                text += &format!(">>> {package}/{kind}/{name}\n{source}\n");
            }
        }
    }
    text
}

fn write(folder: &Path, name: &str, text: &str) {
    fs::create_dir_all(folder).expect("Cargo's output folder can be written");
    fs::write(folder.join(name), text).expect("Cargo's output folder can be written");
}
