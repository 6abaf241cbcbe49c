//! Our answers beside those of a pure C++ program on raw KDL, which builds its own tree from the URDF text.
#![allow(clippy::disallowed_methods)] // the test compiles and runs a program

use proact_arm::ArmModel;
use proact_kinematics::{ArmKinematics, Kinematics};
use proact_types::Vector;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

const STATES: usize = 200;
/// Both sides do the same arithmetic; what differs is the path of an orientation through a quaternion, a few
/// units in the last place of numbers of order one.
const TOLERANCE: f64 = 1e-12;

#[test]
fn pose_jacobian_and_inverse_dynamics_agree_with_raw_kdl() {
    let model = proact_description::mpl_right_arm();
    let mut kinematics = Kinematics::new(&model).expect("the arm is usable");
    let states = random_states(&model);
    let answers = raw_kdl(&model, &states);
    assert_eq!(answers.len(), STATES);

    let gravity = Vector::new(0.0, 0.0, -9.80665);
    for (state, answer) in states.iter().zip(&answers) {
        let (q, qd, qdd) = (&state[..27], &state[27..54], &state[54..]);
        let pose = kinematics.forward(&q[..7]).expect("finite angles");
        let rotation = pose.rotation.to_rotation_matrix().into_inner();
        let jacobian = kinematics.jacobian(&q[..7]).expect("finite angles");
        let torque = kinematics.inverse_dynamics(q, qd, qdd, &gravity).expect("finite state");

        // nalgebra runs down the columns, the program prints rows.
        let ours: Vec<f64> = pose
            .translation
            .vector
            .iter()
            .chain(rotation.transpose().iter())
            .chain(jacobian.transpose().iter())
            .chain(&torque)
            .copied()
            .collect();
        assert_eq!(ours.len(), answer.len());
        for (number, (ours, theirs)) in ours.iter().zip(answer).enumerate() {
            assert!((ours - theirs).abs() <= TOLERANCE, "number {number}: {ours} and {theirs} at {state:?}");
        }
    }
}

/// Angles within the limits, speeds within 1 rad/s, accelerations within 5 rad/s^2.
fn random_states(model: &ArmModel) -> Vec<Vec<f64>> {
    let mut random = ChaCha8Rng::seed_from_u64(2);
    let state = |_| {
        let mut state: Vec<f64> = model
            .moving()
            .map(|joint| {
                let limits = &model.joints[joint].limits;
                random.random_range(limits.lower..=limits.upper)
            })
            .collect();
        for bound in [1.0, 5.0] {
            state.extend(model.moving().map(|_| random.random_range(-bound..bound)));
        }
        state
    };
    (0..STATES).map(state).collect()
}

fn raw_kdl(model: &ArmModel, states: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let urdf = folder.join("side_by_side.urdf");
    std::fs::write(&urdf, proact_description::MPL_RIGHT_ARM_URDF).expect("Cargo's folder can be written");
    let names: Vec<&str> = model.moving().map(|joint| model.joints[joint].name.as_str()).collect();
    let mut input = names.join(" ");
    for state in states {
        input.push('\n');
        for value in state {
            write!(input, "{value:.17e} ").expect("a string takes all");
        }
    }

    let mut program = Command::new(compile(folder))
        .arg(&urdf)
        .args([&model.links[0].name, &model.links[model.tip].name])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("the program starts");
    // The program answers each line at once; a writer of its own keeps both pipes from filling up.
    let mut pipe = program.stdin.take().expect("it was asked for");
    let writer = std::thread::spawn(move || pipe.write_all(input.as_bytes()));
    let output = program.wait_with_output().expect("the program ends");
    writer.join().expect("the writer does not panic").expect("the program reads all");
    assert!(output.status.success());
    String::from_utf8(output.stdout)
        .expect("numbers are text")
        .lines()
        .map(|line| line.split_whitespace().map(|word| word.parse().expect("a number")).collect())
        .collect()
}

/// Compiles the program as the crate's own C++ is compiled.
fn compile(folder: &Path) -> PathBuf {
    let source =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/side_by_side/kinematics/kdl_reference.cpp");
    let program = folder.join("kdl_reference");
    // As system folders, or else -Wconversion finds fault with the libraries' headers; the compiler's own folder
    // must not be named, because then it hides the C headers from the C++ ones.
    let flags = pkg_config("--cflags");
    let folders = flags.iter().filter_map(|flag| Path::new(flag.strip_prefix("-I")?).canonicalize().ok());
    let includes = folders
        .filter(|path| path != Path::new("/usr/include"))
        .map(|path| format!("-isystem{}", path.display()));
    let output = Command::new("g++")
        .args(["-std=c++17", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Wconversion", "-Werror"])
        .args(includes)
        .arg(&source)
        .arg("-o")
        .arg(&program)
        .args(pkg_config("--libs"))
        .output()
        .expect("g++ is there: the crate was built with it");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    program
}

fn pkg_config(what: &str) -> Vec<String> {
    let output = Command::new("pkg-config")
        .args([what, "orocos-kdl", "eigen3", "urdfdom"])
        .output()
        .expect("pkg-config is there: the crate was built with it");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).split_whitespace().map(str::to_owned).collect()
}
