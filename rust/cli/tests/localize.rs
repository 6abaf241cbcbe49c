//! `proact localize`: from files of poses to calibrations that are found again, and refused when they were changed.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)] // A test of programs starts programs.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde_json::Value;
use std::{
    fmt::Write,
    path::Path,
    process::{Command, Output, Stdio},
};

type Pose = Isometry3<f64>;

fn localize(dir: &Path, words: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_proact"));
    command.current_dir(dir).args(["localize", "--json"]).args(words).stdin(Stdio::null()).output().unwrap()
}

fn object(output: &Output) -> Value {
    let stderr = String::from_utf8_lossy(&output.stderr);
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {stderr}"))
}

fn pose(position: [f64; 3], turn: [f64; 3]) -> Pose {
    Pose::from_parts(Vector3::from(position).into(), UnitQuaternion::from_scaled_axis(Vector3::from(turn)))
}

/// One file of poses in the order of time.
fn write_poses(path: &Path, count: u32, hz: f64, bodies: &[(&str, &dyn Fn(f64) -> Pose)], unit: f64) {
    let mut text = "body,id,stamp_ns,x,y,z,qx,qy,qz,qw,tracked\n".to_owned();
    for k in 0..count {
        let t = f64::from(k) / hz;
        for (body, at) in bodies {
            let is = at(t);
            let (p, q) = (is.translation.vector * unit, is.rotation.coords);
            let stamp = (t * 1e9).round();
            writeln!(text, "{body},,{stamp},{},{},{},{},{},{},{},1", p.x, p.y, p.z, q.x, q.y, q.z, q.w)
                .unwrap();
        }
    }
    std::fs::write(path, text).unwrap();
}

/// The markers of a head that nods, turns and tilts, `tilt` as much as it may.
fn markers(t: f64, tilt: f64) -> Pose {
    let turn = [tilt * (0.9 * t).sin(), 0.25 * (1.3 * t + 1.0).sin(), 0.35 * (0.7 * t + 2.0).sin()];
    pose([0.4 + 0.05 * (0.5 * t).sin(), 0.9, 1.6], turn) * Translation3::new(0.08, 0.0, 0.15)
}

#[test]
fn a_headset_is_calibrated_from_a_file_saved_shown_and_refused_when_somebody_changed_it() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let (x, y) = (pose([0.03, 0.02, 0.08], [0.0; 3]), pose([1.0, -0.5, 0.2], [0.0, 0.0, 1.0]));
    let head = |t: f64| y * markers(t, 0.15) * x.inverse();
    let record = |name: &str, tilt: f64, unit: f64| {
        let seen = move |t: f64| markers(t, tilt);
        let head = move |t: f64| y * markers(t, tilt) * x.inverse();
        write_poses(&dir.join(name), 2400, 60.0, &[("head", &head), ("HololensSG", &seen)], unit);
    };
    record("minute.csv", 0.15, 1.0);
    record("level.csv", 0.0005, 1.0);
    assert!(head(0.0).translation.vector.norm() > 0.1);

    // A head that never tilts: told which movement is missing, nothing saved.
    let output = localize(dir, &["headset", "level.csv", "--marker-body", "HololensSG"]);
    let report = object(&output);
    assert!(!output.status.success() && report["good"] == false, "{report}");
    assert!(report["verdict"].as_str().unwrap().contains("tilt the head"), "{report}");
    assert!(!dir.join("calibrations").exists());

    let output = localize(dir, &["headset", "minute.csv", "--marker-body", "HololensSG"]);
    let report = object(&output);
    assert!(output.status.success() && report["verdict"] == "good", "{report}");
    assert!(report["residual_m"].as_f64().unwrap() < 1e-4, "{report}");
    assert!(report["details"]["observability"]["turned_deg"][2].as_f64().unwrap() > 5.0, "{report}");

    let output = localize(dir, &["show"]);
    assert!(output.status.success());
    let line = object(&output)["calibrations"][0]["line"].as_str().unwrap().to_owned();
    assert!(line.contains("residual 0.0 mm: good") && line.starts_with("of 20"), "{line}");
    let file = dir.join("calibrations/headset.toml");
    let text = std::fs::read_to_string(&file).unwrap();
    assert!(text.contains("minute.csv") && text.contains("markers = \"HololensSG\""), "{text}");
    std::fs::write(&file, text.replace("good", "Good")).unwrap();
    let output = localize(dir, &["show"]);
    assert!(!output.status.success());
    assert!(String::from_utf8_lossy(&output.stderr).contains("changed or damaged"), "{output:?}");
}

#[test]
fn a_shoulder_is_calibrated_from_rest_and_circles_and_what_is_wrong_with_a_file_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let brace = pose([1.0, 2.0, 1.4], [0.2, -0.3, 1.0]);
    let center = Vector3::new(0.02, -0.03, -0.06);
    let still = move |_: f64| brace;
    let arm = move |t: f64| {
        let turn = UnitQuaternion::from_euler_angles(0.7 * t.sin(), 0.6 * (1.7 * t).cos(), 0.0);
        brace * Pose::from_parts((center + turn * Vector3::new(0.0, 0.0, -0.2)).into(), turn)
    };
    write_poses(&dir.join("rest.csv"), 300, 100.0, &[("Shoulderpad", &still)], 1.0);
    write_poses(&dir.join("mm.csv"), 300, 100.0, &[("Shoulderpad", &still)], 1000.0);
    write_poses(&dir.join("circles.csv"), 900, 100.0, &[("Shoulderpad", &still), ("UpperArm", &arm)], 1.0);
    let words = ["shoulder", "rest.csv", "--body", "Shoulderpad", "--heading-deg", "40"];
    let circles = ["--circles", "circles.csv", "--upper-arm-body", "UpperArm"];
    let output = localize(dir, &[&words[..], &circles[..]].concat());
    let report = object(&output);
    assert!(output.status.success() && report["verdict"] == "good", "{report}");
    let is: Vec<f64> = serde_json::from_value(report["details"]["world_from_shoulder"].clone()).unwrap();
    let expected = [-0.6, -0.18, 1.445];
    assert!(is.iter().zip(expected).all(|(is, expected)| (is - expected).abs() < 1e-3), "{report}");
    // The doctor finds it in the folder in which it is asked.
    let mut doctor = Command::new(env!("CARGO_BIN_EXE_proact"));
    let output = doctor.current_dir(dir).args(["doctor"]).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(text.contains("calibration shoulder"), "{text}");

    // What is in reach from there, and the box moved by keys.
    let output = localize(dir, &["reach"]);
    let report = object(&output);
    let (still, leaning) =
        (report["still_share"].as_f64().unwrap(), report["leaning_share"].as_f64().unwrap());
    assert!(report["calibrated"] == true && still < leaning && leaning > 0.9, "{report}");
    let keys = |typed: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_proact"));
        let command = command.current_dir(dir).args(["localize", "--json", "correct"]);
        let mut child =
            command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        std::io::Write::write_all(&mut child.stdin.take().unwrap(), typed.as_bytes()).unwrap();
        child.wait_with_output().unwrap()
    };
    let moved = object(&keys("ww a\nf\nq"));
    assert_eq!(moved["correction_m"], serde_json::json!([0.01, 0.005, -0.005]));
    assert!((moved["box_ahead_m"].as_f64().unwrap() - 0.61).abs() < 1e-9, "{moved}");
    for (typed, part) in [("x", "expected w, s, a, d, r, f"), (&*"w".repeat(30), "at most 0.1 m")] {
        let output = keys(typed);
        assert!(!output.status.success());
        assert!(String::from_utf8_lossy(&output.stderr).contains(part), "{output:?}");
    }
    assert_eq!(object(&keys(""))["correction_m"], moved["correction_m"], "what was refused is not saved");

    let refused = |words: &[&str]| {
        let output = localize(dir, words);
        assert!(!output.status.success() && output.stdout.is_empty(), "{output:?}");
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    let millimeters = refused(&["shoulder", "mm.csv", "--body", "Shoulderpad"]);
    assert!(millimeters.contains("meters_per_unit = 0.001"), "{millimeters}");
    let unknown = refused(&["shoulder", "rest.csv", "--body", "ShoulderpadL"]);
    assert!(unknown.contains("there are Shoulderpad"), "{unknown}");
    let legs = refused(&["shoulder", "rest.csv", "--body", "Shoulderpad", "--box-placement", "study_1"]);
    assert!(legs.contains("knees"), "{legs}");
}
