//! The readers on files made here, good and bad. Every bad file gives an error that names the place.
// The files are the subject of these tests.
#![allow(clippy::disallowed_methods, clippy::unwrap_used)]

use proact_devices::{
    DeviceError, EmgOrigin, FaultPolicy, Recording, RecordingFolder, Recordings, SourceOptions,
    SourceRegistry, evaluate, prepare_emg,
};
use proact_emg::{EmgConfig, ImuChannel, RecordingFault, WindowLength};
use proact_types::{Command, EmgSample, Gesture};
use std::{fs, path::Path};

fn write(dir: &Path, name: &str, text: &str) {
    fs::write(dir.join(name), text).expect("the temporary folder is writable");
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder can be made")
}

/// Two channels of something that varies; the gesture shows in the amplitude.
/// Noise of two channels, louder in each further class; `take` says which.
fn take(count: usize, class: usize, take: usize) -> String {
    let value = |k: usize, c: usize| noise((take, class, c), k) * (1.0 + (class * (c + 2)) as f64);
    (0..count).map(|k| format!("{:.3},{:.3}\n", value(k, 0), value(k, 1))).collect()
}

fn rows(count: usize, class: usize) -> String {
    take(count, class, 0)
}

/// Uniform, of standard deviation one.
fn noise(of: (usize, usize, usize), k: usize) -> f64 {
    let mut bits =
        ((((of.0 * 100 + of.1) * 100 + of.2) * 100_000 + k) as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    for shift in [30, 27, 31] {
        bits = (bits ^ (bits >> shift)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    }
    (bits as f64 / u64::MAX as f64 - 0.5) * 12_f64.sqrt()
}

fn write_libemg(dir: &Path, classes: &[usize], suffix: &str) {
    for rep in 0..3 {
        for &class in classes {
            write(dir, &format!("R_{rep}_C_{class}{suffix}.csv"), &take(60, class, rep));
        }
    }
}

fn error(dir: &Path) -> String {
    Recordings::read(dir, 200.0).expect_err("must be refused").to_string()
}

#[test]
fn both_spellings_of_libemg_names_are_read_and_other_files_left_alone() {
    for suffix in ["", "_EMG"] {
        let dir = folder();
        write_libemg(dir.path(), &[0, 1, 2, 3, 4], suffix);
        write(dir.path(), "README.md", "not a recording");
        write(dir.path(), "R_0_C_x.csv", "not a recording");
        let recordings = Recordings::read(dir.path(), 200.0).expect("a good folder");
        assert_eq!((recordings.items.len(), recordings.channels), (15, 2));
        assert!(recordings.missing().is_empty());
        let third = recordings.find(Command::WristFlexion, 2).expect("it is there");
        assert_eq!(third.samples.len(), 60);
    }
}

#[test]
fn missing_empty_and_crowded_folders_are_told_apart() {
    let dir = folder();
    assert!(error(&dir.path().join("nowhere")).contains("cannot read"));
    assert!(error(dir.path()).contains("has no EMG recordings; expected R_<rep>_C_<class>.csv"));
    write(dir.path(), "file", "");
    assert!(error(&dir.path().join("file")).contains("is a file, expected a folder"));
    for session in ["12-1", "12-2"] {
        fs::create_dir(dir.path().join(session)).expect("a folder can be made");
        write(&dir.path().join(session), "0.txt", "1,2\n");
    }
    let message = error(dir.path());
    assert!(message.contains("several sessions") && message.ends_with("12-1, 12-2"), "{message}");
}

#[test]
fn a_bad_file_is_named_with_row_column_and_text() {
    let bad = |text: &str| {
        let dir = folder();
        write(dir.path(), "R_0_C_0.csv", "1,2\n3,4\n");
        write(dir.path(), "R_0_C_1.csv", text);
        error(dir.path())
    };
    assert!(bad("1,2\n3,4,5\n").ends_with("R_0_C_1.csv, row 2: 3 columns, expected 2"));
    let message = bad("1,2,3\n4,5,6\n");
    assert!(
        message.contains("row 1: 3 columns, expected 2 as in") && message.ends_with("R_0_C_0.csv"),
        "{message}"
    );
    assert!(bad("1,2\n3,x4\n").ends_with("R_0_C_1.csv, row 2, column 2: \"x4\", expected a finite number"));
    assert!(bad("1,NaN\n").contains("row 1, column 2: \"NaN\""));
    assert!(bad("1,inf\n").contains("\"inf\""));
    assert!(bad("1,\n").contains("row 1: 1 columns, expected 2 as in"));
    assert!(bad("1,,\n").contains("column 2: \"\""));
    assert!(bad("").ends_with("R_0_C_1.csv has no samples"));
    assert!(bad(&"1,".repeat(600)).contains("600 columns, expected at most 512"));

    let dir = folder();
    write(dir.path(), "R_0_C_7.csv", "1,2\n");
    assert!(error(dir.path()).contains("class 7 has no name; known are 0 hand_close"));
    let dir = folder();
    write(dir.path(), "R_0_C_1.csv", "1,2\n");
    write(dir.path(), "R_0_C_1_EMG.csv", "1,2\n");
    assert!(error(dir.path()).contains("repeats repetition 0 of hand_open"));
    let dir = folder();
    fs::write(dir.path().join("R_0_C_1.csv"), [0xff, 0xfe, 0x00]).expect("writable");
    assert!(error(dir.path()).contains("cannot read"), "binary data");
}

#[test]
fn the_rate_must_be_a_number_above_zero() {
    for rate in [f64::NAN, 0.0, -200.0, f64::INFINITY] {
        assert!(matches!(Recordings::read(folder().path(), rate), Err(DeviceError::Parameter { .. })));
    }
}

#[test]
fn myo_readings_become_repetitions_with_the_edges_of_each_cue_cut() {
    let dir = folder();
    let row = |label: u32| format!("1,2,3,4,5,6,7,8,{label}\n");
    // Six cues of 1.5 s, each after 1 s of rest; 12 s of rest in a file of its own.
    let cued = |label: u32| (row(0).repeat(200) + &row(label).repeat(300)).repeat(6);
    write(dir.path(), "0.txt", &row(0).repeat(2400));
    for label in [1, 2, 7] {
        write(dir.path(), &format!("{label}.txt"), &cued(label));
    }
    let recordings = Recordings::read(dir.path(), 200.0).expect("a good folder");
    assert_eq!((recordings.channels, recordings.items.len()), (8, 24));
    assert_eq!(recordings.missing(), [Command::HandOpen]);
    assert_eq!(recordings.find(Command::HandClose, 5).expect("six cues").samples.len(), 300 - 200);
    assert_eq!(recordings.find(Command::NoMotion, 5).expect("six parts").samples.len(), 400);

    write(dir.path(), "1.txt", &row(2).repeat(10));
    assert!(error(dir.path()).ends_with("1.txt, row 1: label 2, expected 0 or 1"));
    write(dir.path(), "1.txt", "1,2,3,4,5,6,7,8\n");
    assert!(error(dir.path()).ends_with("row 1: 8 columns, expected 9"));
}

#[test]
fn a_folder_that_lacks_gestures_is_refused_with_the_list_or_filled() {
    let dir = folder();
    write_libemg(dir.path(), &[0, 2, 4], "_EMG");
    let source = |fill| match EmgOrigin::recording(dir.path()).at_rate(Some(200.0)) {
        EmgOrigin::Recording { dir, rate_hz, train_reps, feed_reps, faults, .. } => {
            EmgOrigin::Recording { dir, rate_hz, train_reps, feed_reps, fill, faults }
        }
        EmgOrigin::Synthetic => EmgOrigin::Synthetic,
    };
    let message = prepare_emg(&source(false), 1).expect_err("two gestures are lacking").to_string();
    assert!(
        message.ends_with(
            "no recording of hand_open, wrist_extension; record it, or complete the set with --fill-missing synthetic"
        ),
        "{message}"
    );
    let setup = prepare_emg(&source(true), 1).expect("filled");
    assert_eq!(setup.label, "recording+synthetic");
    assert_eq!((setup.config.rate_hz, setup.config.channels), (200.0, 2));
    assert_eq!(setup.classifier.gestures(), Command::ALL);
}

#[test]
fn repetitions_that_do_not_exist_or_are_too_short_are_refused() {
    let dir = folder();
    write_libemg(dir.path(), &[0, 1, 2, 3, 4], "");
    let with = |train: &[u32], feed: &[u32]| {
        let source = EmgOrigin::Recording {
            dir: dir.path().to_owned(),
            rate_hz: Some(200.0),
            train_reps: train.to_vec(),
            feed_reps: feed.to_vec(),
            fill: false,
            faults: FaultPolicy::Refuse,
        };
        prepare_emg(&source, 1).map(|setup| setup.label).map_err(|e| e.to_string())
    };
    assert_eq!(with(&[0, 1], &[2]), Ok("recording".to_owned()));
    assert_eq!(with(&[0, 9], &[2]), Err("no repetition 9 of hand_close; there are 0, 1, 2".to_owned()));
    assert_eq!(with(&[0], &[7]), Err("no repetition 7 of hand_close; there are 0, 1, 2".to_owned()));
    assert!(with(&[], &[2]).is_err_and(|e| e.contains("to train on")));
    assert!(with(&[0], &[]).is_err_and(|e| e.contains("to feed")));
    write(dir.path(), "R_0_C_3.csv", &rows(19, 3));
    assert!(with(&[0], &[2]).is_err_and(|e| e.ends_with("has 19 samples, expected at least 20, one window")));
}

/// Until the rate came from the folder, a trial asked every folder for 200 Hz and refused those that say another.
#[test]
fn a_trial_takes_the_rate_that_the_folder_says_or_the_one_asked_for() {
    let dir = folder();
    write_libemg(dir.path(), &[0, 1, 2, 3, 4], "");
    let rate = |requested_hz| {
        prepare_emg(&EmgOrigin::recording(dir.path()).at_rate(requested_hz), 1)
            .map(|setup| (setup.config.rate_hz, setup.feed.rate_hz(), setup.config.window_samples().unwrap()))
            .map_err(|e| e.to_string())
    };
    let error = rate(None).expect_err("nobody says the rate");
    assert!(error.contains("does not say its rate") && error.contains("--emg-rate HZ"), "{error}");
    assert_eq!(rate(Some(300.0)), Ok((300.0, 300.0, 30)));

    let long = |rep: usize, class: usize| take(400, class, rep);
    for rep in 0..3 {
        for class in 0..5 {
            write(dir.path(), &format!("R_{rep}_C_{class}.csv"), &long(rep, class));
        }
    }
    write(dir.path(), "metadata.json", r#"{"rate_hz": 1000}"#);
    assert_eq!(rate(None), Ok((1000.0, 1000.0, 100)));
    assert_eq!(rate(Some(1000.0)), Ok((1000.0, 1000.0, 100)));
    let error = rate(Some(200.0)).expect_err("the folder says another");
    assert!(error.contains("recorded at 1000 Hz") && error.contains("asked for was 200 Hz"), "{error}");
    let person = format!("person:{}", dir.path().display()).parse().unwrap();
    let source = SourceRegistry::standard().open(&person, &SourceOptions::default()).expect("a good folder");
    assert_eq!(source.info().rate_hz, 1000.0);
}

#[test]
fn eight_signed_bytes_are_a_myos_and_have_its_rate() {
    let dir = folder();
    let bytes = |from: i64| (0..60).map(|k| format!("{},2,3,4,5,6,7,-8\n", from + k % 5)).collect::<String>();
    write(dir.path(), "R_0_C_0.csv", &bytes(-128));
    assert_eq!(Recordings::open(dir.path(), None).expect("a Myo's").rate_hz, 200.0);
    write(dir.path(), "R_0_C_1.csv", &bytes(124));
    assert!(matches!(Recordings::open(dir.path(), None), Err(DeviceError::UnknownRate { .. })));
    assert_eq!(Recordings::open(dir.path(), Some(1000.0)).expect("told").rate_hz, 1000.0);
}

#[test]
fn what_was_lost_is_bridged_in_the_file_marked_beside_it_and_never_read_as_measured() {
    let dir = folder();
    let at = dir.path().join("kept");
    let gestures = [Command::NoMotion, Command::HandClose].map(Gesture::from);
    let kept = RecordingFolder::create(&at, 200.0, &gestures, Command::NoMotion.into(), &[]).unwrap();
    let sample = |counter: u64| EmgSample { counter, channels: [counter as f64, 0.5].into_iter().collect() };
    let gapped: Vec<EmgSample> =
        (100..160).filter(|k| !(120..124).contains(k) && *k != 150).map(sample).collect();
    let item = Recording::bridge_gaps(0, Command::HandClose.into(), &gapped);
    assert_eq!((item.samples.len(), &item.bridged), (60, &vec![[20, 4], [50, 1]]));
    kept.write_recording(&item).unwrap();
    let whole: Vec<EmgSample> = (0..60).map(sample).collect();
    kept.write_recording(&Recording::bridge_gaps(0, Command::NoMotion.into(), &whole)).unwrap();

    let read = Recordings::open(&at, None).unwrap();
    let close = read.find(Command::HandClose, 0).unwrap();
    assert_eq!((&close.samples, &close.bridged), (&item.samples, &item.bridged));
    let numbered: Vec<EmgSample> = close.numbered_samples().collect();
    let renumbered: Vec<EmgSample> =
        gapped.iter().map(|s| EmgSample { counter: s.counter - 100, channels: s.channels.clone() }).collect();
    assert_eq!(numbered, renumbered);
    assert_eq!(read.find(Command::NoMotion, 0).unwrap().numbered_samples().count(), 60);

    // Recorded again without a loss; the marks go with the file.
    let again = Recording::bridge_gaps(0, Command::HandClose.into(), &whole);
    kept.write_recording(&again).unwrap();
    assert_eq!(
        Recordings::open(&at, None).unwrap().find(Command::HandClose, 0).unwrap().numbered_samples().count(),
        60
    );
    let (resumed, known) =
        RecordingFolder::resume(&at, 200.0, 2, &gestures, Command::NoMotion.into(), &[]).unwrap();
    assert_eq!(known.items.len(), 2);
    resumed.remove_recording(Command::HandClose.into(), 0).unwrap();
    assert_eq!(Recordings::open(&at, None).unwrap().items.len(), 1);
    let refused = |rate, channels, gestures: &[Gesture]| {
        RecordingFolder::resume(&at, rate, channels, gestures, Command::NoMotion.into(), &[])
            .err()
            .unwrap()
            .to_string()
    };
    assert!(refused(1000.0, 2, &gestures).contains("recorded at 200 Hz"));
    assert!(refused(200.0, 3, &gestures).contains("it is for channels 2, this calibration has 3"));
    assert!(refused(200.0, 2, &gestures[..1]).contains("it is for the gestures hand_close, no_motion"));
    let marks = r#"{"rate_hz": 200, "bridged": {"R_0_C_1.csv": [[50, 11]]}}"#;
    write(&at, "metadata.json", marks);
    assert!(error(&at).contains("11 rows from row 50 were lost, it has 60 rows"));
}

#[test]
fn an_inertial_measurement_unit_is_kept_beside_the_electrodes_and_read_only_where_it_is_asked_for() {
    let dir = folder();
    let at = dir.path().join("worn");
    let gestures = [Command::NoMotion, Command::HandClose].map(Gesture::from);
    let rest = Gesture::from(Command::NoMotion);
    let imu = [ImuChannel::new("acceleration_x", "g"), ImuChannel::new("acceleration_z", "g")];
    let kept = RecordingFolder::create(&at, 200.0, &gestures, rest, &imu).unwrap();
    let sample = |counter: u64| {
        let channels = [counter as f64, 0.5, -3.0, 0.01 * (counter / 4) as f64, 1.0];
        EmgSample { counter, channels: channels.into_iter().collect() }
    };
    let samples: Vec<EmgSample> = (0..60).map(sample).collect();
    for gesture in gestures {
        kept.write_recording(&Recording::bridge_gaps(0, gesture, &samples)).unwrap();
    }
    let with = Recordings::open_with_imu(&at, None).unwrap();
    assert_eq!((with.channels, &with.imu[..]), (3, &imu[..]));
    assert_eq!(with.find(Command::HandClose, 0).unwrap().numbered_samples().collect::<Vec<_>>(), samples);
    // Whoever does not ask reads what LibEMG does: the electrodes.
    let without = Recordings::open(&at, None).unwrap();
    assert_eq!((without.channels, without.imu.len(), without.items[0].samples[7].len()), (3, 0, 3));
    // A unit that is slower than the electrodes: each of its rows holds for four of theirs.
    let slow: String = (0..15).map(|k| format!("{},1\n", 0.01 * f64::from(k))).collect();
    write(&at, "R_0_C_0_IMU.csv", &slow);
    let held = Recordings::open_with_imu(&at, None).unwrap();
    let close = held.find(Command::HandClose, 0).unwrap();
    assert_eq!(close.numbered_samples().collect::<Vec<_>>(), samples, "class 0 in alphabetical order");
    write(&at, "R_0_C_0_IMU.csv", "1,2,3\n");
    let error = Recordings::open_with_imu(&at, None).unwrap_err().to_string();
    assert!(error.contains("R_0_C_0_IMU.csv") && error.contains("row 1"), "{error}");
    write(&at, "R_0_C_0_IMU.csv", &slow);
    let resume = |imu: &[ImuChannel]| RecordingFolder::resume(&at, 200.0, 3, &gestures, rest, imu);
    let error = resume(&[]).err().unwrap().to_string();
    assert!(error.contains("it is for the inertial channels acceleration_x, acceleration_z"), "{error}");
    let (resumed, known) = resume(&imu).unwrap();
    assert_eq!(known.items.len(), 2);
    resumed.remove_recording(Command::HandClose.into(), 0).unwrap();
    assert!(!at.join("R_0_C_0_IMU.csv").exists());
    std::fs::remove_file(at.join("R_0_C_1_IMU.csv")).unwrap();
    assert!(Recordings::open_with_imu(&at, None).unwrap_err().to_string().contains("R_0_C_1_IMU.csv"));
    let plain = folder();
    write(plain.path(), "R_0_C_0.csv", &"1,2\n3,4\n".repeat(40));
    let error = Recordings::open_with_imu(plain.path(), Some(200.0)).unwrap_err().to_string();
    assert!(error.contains("names no channels of an inertial measurement unit"), "{error}");
}

/// The names are those of the data set's files, which an earlier version did not find; the samples are made up.
#[test]
fn a_participant_of_the_3dc_data_set_is_read_as_libemg_does() {
    let dir = folder();
    for set in ["train", "test"] {
        let (emg, imu) = (dir.path().join(set).join("EMG"), dir.path().join(set).join("IMU"));
        fs::create_dir_all(&emg).unwrap();
        fs::create_dir(&imu).unwrap();
        for (repetition, class) in (0..2_usize).flat_map(|r| (0..11_usize).map(move |c| (r, c))) {
            let set_part = usize::from(set == "test");
            let row = |k: usize| {
                let value = |c: usize| {
                    let phase = k as f64 * (0.9 + 0.13 * c as f64) + (repetition + 3 * set_part) as f64;
                    format!("{:.4}", (if c == class { 40.0 } else { 5.0 }) * phase.sin())
                };
                (0..10).map(value).collect::<Vec<_>>().join(",") + "\n"
            };
            let text: String = (0..600).map(row).collect();
            write(&emg, &format!("3dc_EMG_gesture_{repetition}_{class}.txt"), &text);
            // Its armband has an inertial measurement unit, too, which LibEMG does not read.
            write(&imu, &format!("3dc_IMU_gesture_{repetition}_{class}.txt"), "(0, 0, 0, 0)\n");
        }
    }
    let read = Recordings::open(dir.path(), None).unwrap();
    assert_eq!((read.rate_hz, read.channels, read.items.len()), (1000.0, 10, 44));
    assert_eq!((read.gestures().len(), read.rest.as_str(), read.missing().len()), (11, "Neutral", 0));
    let grip: Gesture = "Power Grip".parse().unwrap();
    let repetitions: Vec<u32> =
        read.items.iter().filter(|r| r.gesture == grip).map(|r| r.repetition).collect();
    assert_eq!(repetitions, [0, 1, 2, 3], "the test follows the training");
    assert!(read.find(grip, 2).unwrap().path.ends_with("test/EMG/3dc_EMG_gesture_0_7.txt"));
    let config = EmgConfig {
        channels: 10,
        rest: read.rest,
        window: WindowLength::Samples(200),
        increment: WindowLength::Samples(50),
        ..EmgConfig::default()
    };
    let result = evaluate(&read, &[0, 1], &[2, 3], &config).unwrap();
    // Nine windows of each of 22 recordings.
    assert_eq!((result.windows, result.classes.len()), (198, 11));
    assert!(result.accuracy > 0.8, "{}", result.accuracy);
    write(&dir.path().join("train/EMG"), "3dc_EMG_gesture_0_11.txt", "1,2,3,4,5,6,7,8,9,10\n");
    let error = Recordings::open(dir.path(), None).unwrap_err().to_string();
    assert!(error.contains("3dc_EMG_gesture_0_11.txt") && error.contains("class 11"), "{error}");
}

/// 200 Hz were assumed for recordings of 1000 Hz whose metadata calls the rate by another name.
#[test]
fn a_rate_is_found_under_its_usual_names_and_an_unknown_name_is_a_finding() {
    let dir = folder();
    for (rep, class) in (0..3).flat_map(|rep| (0..2).map(move |class| (rep, class))) {
        let row = |k: usize| {
            let values = (0..8).map(|c| format!("{:.0}", 20.0 * noise((rep, class, c), k)));
            values.collect::<Vec<_>>().join(",") + "\n"
        };
        let text: String = (0..400).map(row).collect();
        write(dir.path(), &format!("R_{rep}_C_{class}.csv"), &text);
    }
    for key in ["sample_rate", "SamplingFrequency", "sampling-rate-hz", "sfreq", "EMG_rate"] {
        write(dir.path(), "metadata.json", &format!("{{\"{key}\": 1000}}"));
        let read = Recordings::open(dir.path(), None).unwrap();
        assert_eq!((read.rate_hz, read.notes.len()), (1000.0, 0), "{key}");
        assert_eq!(read.check_faults(&[], FaultPolicy::Refuse).unwrap(), [], "{key}");
    }
    for (text, key) in [
        (r#"{"acquisition_freq": 1000}"#, "acquisition_freq"),
        (r#"{"device": {"name": "x", "sampling_rate": "1000 Hz"}}"#, "device.sampling_rate"),
        (r#"{"sampling_interval_ms": 1}"#, "sampling_interval_ms"),
    ] {
        write(dir.path(), "metadata.json", text);
        let read = Recordings::open(dir.path(), None).unwrap();
        // The finding uses the key.
        assert_eq!(read.notes, Vec::<String>::new());
        let error = read.check_faults(&[], FaultPolicy::Refuse).unwrap_err().to_string();
        assert!(error.contains(key) && error.contains("200 Hz is assumed"), "{error}");
        assert!(
            error.lines().nth(1).is_some_and(|line| line.trim_start().starts_with("- the metadata")),
            "{error}"
        );
        let found = read.check_faults(&[], FaultPolicy::Accept).unwrap();
        assert!(matches!(found.as_slice(), [RecordingFault::UnknownRateKey { .. }]), "{found:?}");
        // The rate is asked for, or the key is another's.
        let recordings = Recordings::open(dir.path(), Some(1000.0)).unwrap();
        assert!(
            recordings.notes.iter().any(|note| note.contains("is unknown and not used")),
            "{:?}",
            recordings.notes
        );
        assert_eq!(recordings.check_faults(&[], FaultPolicy::Refuse).unwrap(), []);
    }
    write(dir.path(), "metadata.json", r#"{"subject": "p7", "gain": 1000, "mains_hz": 50}"#);
    let read = Recordings::open(dir.path(), None).unwrap();
    assert_eq!((read.notes.len(), read.check_faults(&[], FaultPolicy::Refuse).unwrap()), (3, vec![]));
    write(dir.path(), "metadata.json", r#"{"fs": 200, "sampling_rate": 1000}"#);
    let error = Recordings::open(dir.path(), None).unwrap_err().to_string();
    assert!(error.contains("expected one rate"), "{error}");
}

#[test]
fn real_recordings_of_six_people_have_no_finding() {
    let beside = || std::path::PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
    let shared = std::env::var_os("PROACT_SHARED").map_or_else(beside, std::path::PathBuf::from);
    let Ok(people) = fs::read_dir(shared.join("data/emg/myo_readings")) else {
        println!("skipped: ../shared not found");
        return;
    };
    let folders = people.map(|entry| entry.unwrap().path()).filter(|path| path.is_dir());
    let mut count = 0;
    for folder in folders.chain([shared.join("data/emg/libemg_tests_myo")]) {
        let read = Recordings::open(&folder, None).unwrap();
        assert_eq!(read.check_faults(&[], FaultPolicy::Accept).unwrap(), [], "{}", folder.display());
        count += 1;
    }
    assert_eq!(count, 16);
}
