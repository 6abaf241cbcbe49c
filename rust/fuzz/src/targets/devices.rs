//! What armbands, eye trackers and folders of recordings say.

use super::{TargetFn, utf8_text};
use proact_devices::{
    EmgPacket, EmgRecorder, LibEmgOutput, MYO_RATE_HZ, RawGazeSample, Recordings, SourceInfo, VmplCommand,
    VmplGhostSetup, VmplPercepts,
    gforce::{
        GForceParser, GattLink, SocketLink,
        protocol::{EmgCapability, EmgSetting, GForceCommand, GForceReply},
    },
    motion_capture::{natnet, read_poses, vrpn, write_pose, write_pose_header},
    read_recorded, read_samples,
};
use proact_emg::{
    ClassifierKind, DecoderProcessConfig, EmgConfig, EmgModel, EmgPipeline, ImuChannel, ImuConfig,
};
use proact_localization::RawBodyPose;
use proact_types::{Command, EmgSample, SimTime};
use std::{fs, io::Write, os::unix::net::UnixStream, path::Path, time::Duration};

/// The input is a file of that name in a folder of good ones.
fn among_valid_recordings(scratch: &Path, name: &'static str) -> TargetFn {
    let folder = scratch.join("recordings");
    fs::create_dir_all(&folder).expect("the scratch folder takes folders");
    for class in 0..5 {
        let rows: String = (0..200).map(|row| format!("{},{}\n", (row * 7 + class) % 13, row % 5)).collect();
        for repetition in 0..3 {
            let path = folder.join(format!("R_{repetition}_C_{class}.csv"));
            fs::write(path, &rows).expect("the scratch folder takes files");
            let imu = folder.join(format!("R_{repetition}_C_{class}_IMU.csv"));
            fs::write(imu, "0.5,1\n0.25,1\n").expect("the scratch folder takes files");
        }
    }
    let metadata = r#"{"imu": [{"name": "x", "unit": "g"}, {"name": "z", "unit": "g"}]}"#;
    fs::write(folder.join("metadata.json"), metadata).expect("the scratch folder takes files");
    Box::new(move |bytes| {
        let path = folder.join(name);
        fs::write(&path, bytes).expect("the scratch folder takes files");
        if name.ends_with(".csv") {
            let _ = read_samples(&path);
        }
        let _ = Recordings::open(&folder, None);
        let _ = Recordings::open_with_imu(&folder, None);
        let _ = Recordings::read(&folder, MYO_RATE_HZ);
    })
}

pub(super) fn csv(scratch: &Path) -> TargetFn {
    among_valid_recordings(scratch, "R_0_C_0.csv")
}

pub(super) fn imu_csv(scratch: &Path) -> TargetFn {
    among_valid_recordings(scratch, "R_0_C_0_IMU.csv")
}

pub(super) fn imu_seeds(_: &Path) -> Vec<Vec<u8>> {
    vec![b"0.5,1\n0.25,1\n".to_vec()]
}

pub(super) fn metadata(scratch: &Path) -> TargetFn {
    among_valid_recordings(scratch, "metadata.json")
}

/// A model that is taken classifies windows, too.
pub(super) fn model(_: &Path) -> TargetFn {
    Box::new(|bytes| {
        let Some(Ok(model)) = utf8_text(bytes).map(EmgModel::from_json) else { return };
        let written = model.to_json();
        assert!(
            written.is_ok_and(|json| EmgModel::from_json(&json).is_ok()),
            "a model that was read can be written"
        );
        // Its settings or its classifier may be refused; one that is taken says something of every window.
        let channels = model.config.sample_channels();
        let Ok(mut pipeline) = EmgPipeline::new(&model.config, model.classifier.clone()) else { return };
        for (tick, sample) in synthetic_stream(channels, 3).into_iter().take(300).enumerate() {
            let output = pipeline.step(SimTime(5 * tick as u64), &[sample]);
            let driven = output.iter().flat_map(|output| &output.drives);
            assert!(driven.into_iter().all(|drive| drive.abs() <= 1.0), "a drive beyond its range");
        }
    })
}

/// Samples of one loudness, 1 to 5 from channel to channel, at the usual rate.
fn synthetic_stream(channels: usize, loudness: usize) -> Vec<EmgSample> {
    // Without a period, so that the features of the windows differ in all directions.
    let value = |counter: usize, channel: usize| {
        let mixed = ((counter * 64 + channel) as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        (mixed >> 40) as f64 / f64::from(1 << 23) * 11.0 - 11.0
    };
    let sample = |counter: usize| EmgSample {
        counter: counter as u64,
        channels: (0..channels).map(|c| (1 + (loudness + c) % 5) as f64 * value(counter, c)).collect(),
    };
    (0..3000).map(sample).collect()
}

fn recorded_stream(scratch: &Path, name: &str) -> TargetFn {
    let path = scratch.join(name);
    Box::new(move |bytes| {
        fs::write(&path, bytes).expect("the scratch folder takes files");
        let _ = read_recorded(&path);
    })
}

pub(super) fn stream_csv(scratch: &Path) -> TargetFn {
    recorded_stream(scratch, "stream.csv")
}

pub(super) fn stream_edf(scratch: &Path) -> TargetFn {
    recorded_stream(scratch, "stream.edf")
}

pub(super) fn udp_gaze(_: &Path) -> TargetFn {
    Box::new(|bytes| {
        if let Ok(gaze) = RawGazeSample::parse(bytes) {
            assert!(RawGazeSample::parse(&gaze.to_bytes()).is_ok(), "what was read can be sent on");
        }
    })
}

pub(super) fn udp_vmpl(_: &Path) -> TargetFn {
    Box::new(|bytes| {
        if let Ok(command) = VmplCommand::parse(bytes) {
            assert!(VmplCommand::parse(&command.to_packet()).is_ok(), "what was read can be sent on");
        }
        if let Ok(setup) = VmplGhostSetup::parse(bytes) {
            assert!((0.0..=1.0).contains(&setup.alpha));
        }
        if let Ok(percepts) = VmplPercepts::parse(bytes) {
            assert!(VmplPercepts::parse(&percepts.to_packet()).is_ok());
        }
    })
}

pub(super) fn vmpl_seeds(_: &Path) -> Vec<Vec<u8>> {
    let command = VmplCommand { arm: [0.5; 7], fingers: Some([0.25; 20]) }.to_packet();
    let setup = [1.0_f32, 0.3, 0.4, 0.5, 0.8].map(f32::to_le_bytes).concat();
    vec![command.to_vec(), command[..28].to_vec(), setup, VmplPercepts::default().to_packet().to_vec()]
}

pub(super) fn udp_libemg(_: &Path) -> TargetFn {
    Box::new(|bytes| {
        if let Ok(output) = LibEmgOutput::parse(bytes, 5) {
            assert!(LibEmgOutput::parse(output.to_message().as_bytes(), 5).is_ok());
        }
    })
}

/// Every notification is read as each thing that an armband says.
pub(super) fn gforce(_: &Path) -> TargetFn {
    Box::new(|bytes| {
        let setting = EmgSetting { rate_hz: 500, channel_mask: 0xff, packet_bytes: 128, bits: 8 };
        for ids in [false, true] {
            let mut parser = GForceParser::new(setting, ids).expect("a setting that works");
            let mut packet = EmgPacket::default();
            let mut rest = bytes;
            for number in 0.. {
                let [length, more @ ..] = rest else { break };
                let (notification, behind) = more.split_at(usize::from(*length).min(more.len()));
                rest = behind;
                parser.push(notification, Duration::from_millis(32 * number), &mut packet);
                let _ = (GForceCommand::from_bytes(notification), GForceReply::from_bytes(notification));
                let _ = EmgCapability::from_bytes(notification);
                if let Ok(setting) = EmgSetting::from_bytes(notification) {
                    let _ = parser.restart(setting, ids);
                }
            }
        }
    })
}

pub(super) fn gforce_socket(_: &Path) -> TargetFn {
    Box::new(|bytes| {
        let (ours, mut theirs) = UnixStream::pair().expect("a pair of sockets");
        let mut link = SocketLink::new(ours);
        // No more than a socket takes at once: nobody reads beside us.
        for chunk in bytes.chunks(32 << 10) {
            theirs.write_all(chunk).expect("there is room");
            let mut frame = Vec::new();
            while let Ok(Some(_)) = link.next_notification(Duration::ZERO, &mut frame) {}
        }
    })
}

/// A stream of four channels with a gap, as our own recorder writes it.
fn recorded_seed(scratch: &Path, name: &str) -> Vec<Vec<u8>> {
    let info = SourceInfo {
        name: "seed".to_owned(),
        rate_hz: 500.0,
        channels: 4,
        packet_samples: 8,
        zero_code: 0.0,
        rails: None,
        loss_is_counted: true,
        volts_per_code: None,
        imu: Vec::new(),
    };
    let path = scratch.join(name);
    let mut recorder = EmgRecorder::create(&path, &info).expect("the scratch folder takes files");
    for first in [0, 8, 40, 48] {
        let sample = |counter: u64| EmgSample {
            counter,
            channels: (0..4).map(|c| (counter * 3 + c) as f64).collect(),
        };
        let packet = EmgPacket { samples: (first..first + 8).map(sample).collect(), ..EmgPacket::default() };
        recorder.packet(&packet).expect("the disk takes it");
    }
    recorder.finish().expect("the disk takes it");
    vec![fs::read(path).expect("it was just written")]
}

pub(super) fn stream_csv_seeds(scratch: &Path) -> Vec<Vec<u8>> {
    recorded_seed(scratch, "seed.csv")
}

pub(super) fn stream_edf_seeds(scratch: &Path) -> Vec<Vec<u8>> {
    recorded_seed(scratch, "seed.edf")
}

/// Models trained on five loudnesses, one of each kind: classifiers, regressors, two sites, processes.
pub(super) fn model_seeds(_: &Path) -> Vec<Vec<u8>> {
    let takes: Vec<(Command, Vec<EmgSample>)> = Command::ALL
        .into_iter()
        .zip(0..)
        .map(|(gesture, loudness)| (gesture, synthetic_stream(8, loudness)))
        .collect();
    let slices: Vec<(Command, &[EmgSample])> =
        takes.iter().map(|(gesture, take)| (*gesture, take.as_slice())).collect();
    let trained = |classifier: ClassifierKind| {
        let process =
            DecoderProcessConfig::from_toml("command = [\"net\"]").ok().filter(|_| classifier.is_process());
        let config = EmgConfig { classifier, process, ..EmgConfig::default() };
        let model = EmgModel::train(&config.without_process(), &[0.0; 8], &slices)
            .expect("five gestures that differ");
        let model = match classifier.is_process() {
            true => model.decoded_by_process(&config, "[1, 2]").expect("the same gestures"),
            false => model,
        };
        model.to_json().expect("a model can be written").into_bytes()
    };
    let mut models = ClassifierKind::ALL.map(trained).to_vec();
    // Six electrodes, and two channels of an inertial measurement unit.
    let imu = ImuConfig::record_only(["x", "z"].map(|name| ImuChannel::new(name, "g")).into());
    let imu = imu.with_features(&["all"]).expect("both are there");
    let config = EmgConfig { channels: 6, imu, ..EmgConfig::default() };
    let model = EmgModel::train(&config, &[0.0; 6], &slices).expect("five gestures that differ");
    models.push(model.to_json().expect("a model can be written").into_bytes());
    models
}

pub(super) fn udp_natnet(_: &Path) -> TargetFn {
    Box::new(|bytes| {
        let _ = natnet::parse(bytes);
    })
}

/// An empty frame, an empty list of definitions, and a server without a name.
pub(super) fn natnet_seeds(_: &Path) -> Vec<Vec<u8>> {
    let packet = |id: u8, length: u16| {
        let mut bytes = vec![id, 0];
        bytes.extend(length.to_le_bytes());
        bytes.resize(4 + usize::from(length), 0);
        bytes
    };
    vec![packet(7, 78), packet(5, 4), packet(1, 279)]
}

pub(super) fn vrpn(_: &Path) -> TargetFn {
    Box::new(|bytes| {
        let mut parser = vrpn::VrpnParser::new();
        for piece in bytes.chunks(100) {
            parser.push(piece);
            while let Ok(Some(_)) = parser.next_event() {}
        }
    })
}

/// A greeting with a device, a type and a pose of it.
pub(super) fn vrpn_seeds(_: &Path) -> Vec<Vec<u8>> {
    let message = |number: i32, kind: i32, payload: &[u8]| {
        let mut bytes = (24 + payload.len() as u32).to_be_bytes().to_vec();
        bytes.extend([0; 8]);
        bytes.extend(number.to_be_bytes());
        bytes.extend(kind.to_be_bytes());
        bytes.extend([0; 4]);
        bytes.extend(payload);
        bytes.resize(bytes.len().next_multiple_of(8), 0);
        bytes
    };
    let mut stream = vrpn::cookie().to_vec();
    stream.extend(message(0, -1, b"\0\0\0\x04pad\0"));
    stream.extend(message(0, -2, b"\0\0\0\x16vrpn_Tracker Pos_Quat\0"));
    stream.extend(message(0, 0, &[0; 64]));
    vec![stream]
}

pub(super) fn poses(scratch: &Path) -> TargetFn {
    let path = scratch.join("poses.csv");
    Box::new(move |bytes| {
        fs::write(&path, bytes).expect("the scratch folder takes files");
        let _ = read_poses(&path);
    })
}

pub(super) fn poses_seeds(_: &Path) -> Vec<Vec<u8>> {
    let mut text = String::new();
    write_pose_header(&mut text);
    for stamp in 0..3 {
        let quaternion = [0.0, 0.0, 0.0, 1.0];
        let (body, position) = ("pad".to_owned(), [0.1, 0.2, 1.4]);
        let id = Some(7);
        write_pose(
            &mut text,
            &RawBodyPose { body, id, stamp, arrival: 0, position, quaternion, tracked: true },
        );
    }
    vec![text.into_bytes()]
}
