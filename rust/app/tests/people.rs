//! Simulated people, with and without physics.
#![allow(clippy::unwrap_used)] // A test.

use proact_app::{Arm, trial};
use proact_control::MethodRegistry;
use proact_devices::EmgOrigin;
use proact_participants::{ParticipantOptions, Population, Practice};
use proact_testbed::{Session, Setup, TrialConfig, TrialResult};

fn run(mut session: Session) -> TrialResult {
    while !session.step(false).unwrap().output.finished {}
    session.result()
}

fn kinematic(method: &str, options: ParticipantOptions) -> TrialResult {
    let config = TrialConfig::new(method, 3, Setup::named("seated").unwrap());
    let config = TrialConfig { participant: Some(options), limit_secs: 150.0, ..config };
    let arm = Arm::of(&config).unwrap();
    run(trial::kinematic(&MethodRegistry::standard(), &arm, config, &EmgOrigin::Synthetic).unwrap())
}

#[test]
fn without_physics_a_trial_goes_as_one_with_physics_would() {
    let result = kinematic("D", ParticipantOptions::default());
    assert_eq!(result.score, 4.0);
    assert_eq!(result.digest, kinematic("D", ParticipantOptions::default()).digest);
}

#[test]
fn a_person_needs_longer_than_nobody_in_particular_and_another_one_another_time() {
    let person = |index| Population::standard().person(5, index, &Practice::default());
    let nobody = kinematic("D", ParticipantOptions::default()).sim_seconds;
    let [one, other] = [0, 1].map(|index| kinematic("D", person(index)).sim_seconds);
    assert!(one > nobody && other > nobody, "{one} s and {other} s, nobody {nobody} s");
    assert_ne!(one, other);
}

#[test]
fn the_text_of_a_trial_keeps_who_the_person_is() {
    let options = Population::standard().person(5, 2, &Practice::default());
    let config = TrialConfig::new("A", 1, Setup::named("seated").unwrap());
    let config = TrialConfig { participant: Some(options), ..config };
    let text = config.to_toml().unwrap();
    assert!(text.contains("[participant.person]"), "{text}");
    assert_eq!(TrialConfig::from_toml(&text).unwrap().participant, Some(options));
}
