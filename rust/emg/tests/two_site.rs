//! Direct control by two sites, with switching by co-contraction.

use proact_emg::{
    ClassifierKind, EmgConfig, EmgModel, EmgOutput, EmgPipeline, TwoSiteConfig, cross_validate,
};
use proact_types::{Command, EmgSample, Gesture, SimTime};
use std::collections::BTreeMap;

fn config() -> EmgConfig {
    EmgConfig { channels: 4, rate_hz: 200.0, classifier: ClassifierKind::TwoSite, ..EmgConfig::default() }
}

/// Sample `k` (200 Hz): the extensor is below channel 1 and the flexor below channel 3, each heard a little on its neighbour.
fn sample(k: u64, extensor: f64, flexor: f64) -> EmgSample {
    let efforts = [0.3 * extensor, extensor, 0.3 * flexor, flexor];
    let value = |(c, effort): (usize, f64)| {
        let phase = k as f64 * (1.7 + 0.31 * c as f64);
        (1.0 + 20.0 * effort) * (phase.sin() + 0.3 * (2.3 * phase).cos())
    };
    EmgSample { counter: k, channels: efforts.into_iter().enumerate().map(value).collect() }
}

fn recordings(gestures: &[Command]) -> Vec<(Command, Vec<EmgSample>)> {
    let take = |gesture: Command, from: u64| {
        let made = |muscle| f64::from(u8::from(gesture == muscle));
        let (extensor, flexor) = (made(Command::WristExtension), made(Command::WristFlexion));
        (gesture, (from..from + 400).map(|k| sample(k, extensor, flexor)).collect())
    };
    (0..2).flat_map(|rep| gestures.iter().map(move |gesture| take(*gesture, 1000 * rep))).collect()
}

const THREE: [Command; 3] = [Command::NoMotion, Command::WristExtension, Command::WristFlexion];

fn train(config: &EmgConfig, recordings: &[(Command, Vec<EmgSample>)]) -> Result<EmgModel, String> {
    let slices: Vec<_> = recordings.iter().map(|(gesture, samples)| (*gesture, samples.as_slice())).collect();
    EmgModel::train(config, &[0.0; 4], &slices).map_err(|error| error.to_string())
}

fn pipeline(config: &EmgConfig) -> EmgPipeline {
    let model = train(config, &recordings(&THREE)).expect("good recordings");
    EmgPipeline::new(config, model.classifier).expect("they fit")
}

/// Runs phases of (milliseconds, extensor, flexor), one after the other.
fn run(pipeline: &mut EmgPipeline, phases: &[(u64, f64, f64)]) -> Vec<EmgOutput> {
    let mut tick = 0;
    let mut outputs = Vec::new();
    for (millis, extensor, flexor) in phases {
        for now in tick..tick + millis {
            let arrived = now.is_multiple_of(5).then(|| sample(now / 5, *extensor, *flexor));
            outputs.extend(pipeline.step(SimTime(now), arrived.as_slice()));
        }
        tick += millis;
    }
    outputs
}

/// The gestures in force, each once in a row.
fn in_force(outputs: &[EmgOutput]) -> Vec<Gesture> {
    let mut gestures: Vec<Gesture> = outputs.iter().map(|output| output.gesture).collect();
    gestures.dedup();
    gestures
}

#[test]
fn each_gesture_gets_the_channel_on_which_it_stands_out_and_effort_goes_from_its_low_to_its_high() {
    let model = train(&config(), &recordings(&THREE)).expect("good recordings");
    let sites = model.classifier.sites().expect("two sites");
    assert_eq!(sites.map(|site| site.channel), [1, 3]);
    assert_eq!(sites[0].gesture, Command::WristExtension);
    let effort = |made: f64| {
        let outputs = run(&mut pipeline(&config()), &[(600, 0.0, made)]);
        let last = outputs.last().expect("windows ended").clone();
        (last.gesture.same_named_command().expect("one of the five"), last.effort)
    };
    assert_eq!(effort(0.1), (Command::NoMotion, 0.0));
    let (gesture, half) = effort(0.6);
    assert_eq!(gesture, Command::WristFlexion);
    assert!((0.2..0.8).contains(&half), "{half}");
    assert_eq!(effort(1.5), (Command::WristFlexion, 1.0));

    let json = model.to_json().expect("sound");
    assert_eq!(EmgModel::from_json(&json), Ok(model.clone()));
    let same = json.replace("\"channel\": 3", "\"channel\": 1").replace("\"channel\":3", "\"channel\":1");
    assert!(EmgModel::from_json(&same).is_err_and(|e| e.to_string().contains("does not fit")));
    let turned = model.with_channel_shift(1).expect("sound").classifier;
    assert_eq!(turned.sites().map(|sites| sites.map(|site| site.channel)), Some([2, 0]));
    let report = cross_validate(&config(), &recordings(&Command::ALL)).expect("two repetitions");
    assert_eq!((report.accuracy, report.classes.len()), (1.0, 3));
}

#[test]
fn a_co_contraction_switches_and_nothing_moves_until_both_have_relaxed() {
    let switch = Command::HandOpen;
    let both = run(&mut pipeline(&config()), &[(500, 0.0, 0.0), (400, 1.0, 1.0), (500, 0.0, 0.0)]);
    assert_eq!(in_force(&both), [Command::NoMotion, switch, Command::NoMotion]);
    // The flexor follows within the time, and stays when the extensor is over.
    let lingering = [(500, 0.0, 0.0), (100, 1.0, 0.0), (300, 1.0, 1.0), (600, 0.0, 1.0), (500, 0.0, 0.0)];
    let mut phases = lingering.to_vec();
    assert_eq!(
        in_force(&run(&mut pipeline(&config()), &phases)),
        [Command::NoMotion, switch, Command::NoMotion]
    );
    phases.extend([(500, 0.0, 1.0)]);
    let after = run(&mut pipeline(&config()), &phases);
    assert_eq!(in_force(&after).last(), Some(&Command::WristFlexion.into()));
    // It comes too late for a co-contraction: the stronger one moves on.
    let late = [(500, 0.0, 0.0), (600, 1.0, 0.0), (500, 1.0, 0.6), (500, 0.0, 0.0)];
    let moved = [Command::NoMotion, Command::WristExtension, Command::NoMotion];
    assert_eq!(in_force(&run(&mut pipeline(&config()), &late)), moved);
    let two_site = TwoSiteConfig { cocontraction_window_ms: 1000, ..TwoSiteConfig::default() };
    let patient = EmgConfig { two_site, ..config() };
    assert!(in_force(&run(&mut pipeline(&patient), &late)).contains(&switch.into()));
}

#[test]
fn a_silence_ends_what_was_switched_and_only_a_relaxed_hand_moves_again() {
    let mut pipeline = pipeline(&config());
    run(&mut pipeline, &[(500, 1.0, 1.0)]);
    let silent: Vec<EmgOutput> = (500..800).filter_map(|now| pipeline.step(SimTime(now), &[])).collect();
    assert!(silent.len() == 1 && silent[0].stale && silent[0].effort == 0.0);
    let step = |now: u64, made: f64, pipeline: &mut EmgPipeline| {
        pipeline.step(SimTime(now), now.is_multiple_of(5).then(|| sample(now / 5, made, 0.0)).as_slice())
    };
    let held: Vec<EmgOutput> = (800..1400).filter_map(|now| step(now, 1.0, &mut pipeline)).collect();
    assert_eq!(in_force(&held), [Command::NoMotion]);
    (1400..1800).for_each(|now| drop(step(now, 0.0, &mut pipeline)));
    let again: Vec<EmgOutput> = (1800..2200).filter_map(|now| step(now, 1.0, &mut pipeline)).collect();
    assert_eq!(in_force(&again).last(), Some(&Command::WristExtension.into()));
}

#[test]
fn recordings_and_settings_that_give_no_two_sites_are_refused_with_what_to_do() {
    let error = |config: &EmgConfig, gestures: &[Command]| {
        train(config, &recordings(gestures)).expect_err("must be refused")
    };
    let text = error(&config(), &[Command::NoMotion, Command::WristExtension]);
    assert!(text.contains("the training data has no wrist_flexion"), "{text}");
    let text = error(&config(), &THREE[1..]);
    assert!(text.contains("the training data has no no_motion"), "{text}");
    assert!(error(&config(), &[]).contains("has no wrist_extension"));
    let with = |two_site: TwoSiteConfig| EmgConfig { two_site, ..config() };
    let named = |extension, flexion| {
        let channels: BTreeMap<Gesture, usize> =
            [(Command::WristExtension.into(), extension), (Command::WristFlexion.into(), flexion)].into();
        with(TwoSiteConfig { channels, ..TwoSiteConfig::default() })
    };
    let sites = train(&named(0, 2), &recordings(&THREE)).expect("they are heard there, too").classifier;
    assert_eq!(sites.sites().map(|sites| sites.map(|site| site.channel)), Some([0, 2]));
    let text = error(&named(2, 3), &THREE);
    assert!(text.contains("channel 2") && text.contains("name another channel"), "{text}");
    for wrong in [named(1, 1), named(1, 4)] {
        assert!(wrong.check().is_err_and(|e| e.to_string().contains("a different one below 4")));
    }
    let mut flat = recordings(&THREE);
    flat.iter_mut().flat_map(|(_, samples)| samples).for_each(|s| s.channels.fill(1.0));
    let text = train(&config(), &flat).expect_err("all alike");
    assert!(text.contains("expected more"), "{text}");
    flat[0].1[7].channels[0] = f64::NAN;
    assert!(train(&config(), &flat).is_err());

    let refused = |change: fn(&mut EmgConfig)| {
        let mut config = config();
        change(&mut config);
        config.check().expect_err("must be refused").to_string()
    };
    assert!(refused(|c| c.features = "RMS".parse().expect("known")).contains("expected MAV among them"));
    assert!(refused(|c| c.two_site.cocontraction_window_ms = 1001).contains("at most 1000"));
    assert!(refused(|c| c.two_site.switch_gesture = Command::NoMotion.into()).contains("different gestures"));
    assert!(refused(|c| c.rejection_threshold = Some(0.5)).contains("two_site gives no probability"));
}
