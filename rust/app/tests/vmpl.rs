//! A decoder of miniVIE's virtual limb drives arm and fingers over UDP, gets percepts, and the trial replays without it.
#![allow(clippy::disallowed_methods)] // A test of sockets and files.

use proact_app::{Recorder, ReplayOptions, replay_trial, trial};
use proact_control::MethodProgram;
use proact_testbed::{Setup, TrialConfig};
use std::{error::Error, net::UdpSocket};

/// Where the double sends the elbow, and the first joint of the index finger's flexion, rad.
const ELBOW: f32 = 1.2;
const INDEX: f32 = 0.6;
/// Angles of 27 joints, as bytes.
const COMMAND_BYTES: usize = 108;

/// The limb as a decoder sees it, byte by byte: nothing of the program's own reader or writer.
fn command(angles: [f32; 27]) -> [u8; COMMAND_BYTES] {
    let mut packet = [0; COMMAND_BYTES];
    for (bytes_out, angle) in packet.chunks_exact_mut(4).zip(angles) {
        bytes_out.copy_from_slice(&angle.to_le_bytes());
    }
    packet
}

fn angle(percepts: &[u8], joint: usize) -> f32 {
    f32::from_le_bytes(percepts[12 * joint..12 * joint + 4].try_into().expect("four bytes"))
}

#[test]
fn an_unchanged_decoder_drives_arm_and_fingers_and_its_trial_replays_without_it() -> Result<(), Box<dyn Error>>
{
    let decoder = UdpSocket::bind("127.0.0.1:0")?;
    decoder.set_nonblocking(true)?;
    let words = ["proact:vmpl".to_owned(), "listen=127.0.0.1:0".to_owned()];
    let answers = format!("decoder={}", decoder.local_addr()?);
    let program = MethodProgram::new(words.into_iter().chain([answers]).collect());
    let config = TrialConfig::new("A", 1, Setup::named("still")?);
    let config = TrialConfig { limit_secs: 4.0, method_process: Some(program), ..config };

    let temp_dir = tempfile::tempdir()?;
    let dir = temp_dir.path().join("trial");
    let trial::Assembly { mut trial, arm, classifier, .. } = trial::live_trial(config)?;
    let used = trial.testbed().config().clone();
    let mut recorder = Recorder::create(&dir, &used, &arm, classifier.as_ref())?;
    let (mut bytes, mut first, mut felt, mut received_count) = ([0; 2048], Vec::new(), Vec::new(), 0);
    loop {
        let step = trial.step(false)?;
        recorder.write(&step, trial.testbed().plant().state())?;
        // The double answers each packet of percepts and, as a decoder does, goes on from the first.
        while let Ok((count, limb)) = decoder.recv_from(&mut bytes) {
            assert_eq!(count, 458, "joints, contacts and forces");
            felt = bytes[..count].to_vec();
            if first.is_empty() {
                first = felt.clone();
            }
            received_count += 1;
            let mut angles: [f32; 27] = std::array::from_fn(|joint| angle(&first, joint));
            (angles[3], angles[8]) = (ELBOW, INDEX);
            decoder.send_to(&command(angles), limb)?;
            // What is no command changes nothing.
            decoder.send_to(&command([f32::NAN; 27]), limb)?;
            decoder.send_to(&[0xff; 109], limb)?;
        }
        if step.output.finished {
            break;
        }
    }
    recorder.finish(&trial.result())?;
    assert!((198..=201).contains(&received_count), "percepts every 20 ms for 4 s: {received_count}");

    // Joint by joint, as the packets name them: the elbow is the fourth of the arm, `index1` the second of the index finger.
    let testbed = trial.testbed();
    let model = testbed.model();
    let position = |name: &str| {
        let joint =
            model.moving().position(|joint| proact_arm::matches_short_name(&model.joints[joint].name, name));
        joint.map(|joint| testbed.plant().state().position[joint])
    };
    for (name, number, expected) in [("forearm", 3, ELBOW), ("index1", 8, INDEX)] {
        let reached = position(name).ok_or(name)?;
        assert!(
            (reached - f64::from(expected)).abs() < 0.05,
            "{name} is at {reached} rad, {expected} was asked"
        );
        assert!((reached - f64::from(angle(&felt, number))).abs() < 0.02, "{name} is felt where it is");
    }
    let (ring, before) = (position("ring1").ok_or("ring1")?, f64::from(angle(&first, 16)));
    assert!((ring - before).abs() < 0.05, "the other fingers stay: {ring} rad, {before} before");

    drop(trial);
    let replayed = replay_trial(&dir, ReplayOptions::default())?;
    assert!(replayed.agrees, "{:?}", replayed.divergence);
    Ok(())
}
