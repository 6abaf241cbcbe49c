//! Inputs that must not move the arm: a limb that does not fit, a shoulder that jumps, a source that died.

mod common;

use common::{Outcome, Run, config, replayed};
use proact_participants::Participant;
use proact_testbed::{
    PersonParts, RunningTrial, Testbed, TestbedError, doubles,
    ports::{Plant, PlantError},
};
use proact_types::{
    BodyState, Command, DisplayFrame, EventKind, GazeSample, InputSource, Intention, JointVector,
    PlantCommand, PlantState, Point, Pose, SimTime, StopCause, TickInput, TrunkPosture, Vector, joints,
};

fn testbed(method: &str) -> Outcome<Testbed> {
    let config = config(method, 60.0);
    let parts = doubles::testbed_parts(&config);
    Ok(Testbed::new(config, parts)?)
}

// Catches a limb of another arm, or one that is no number, on its way into the joints.
#[test]
fn a_tracked_limb_that_does_not_fit_is_refused_with_what_was_expected() -> Outcome {
    let mut trial = RunningTrial::new(testbed("A")?, PersonParts::default());
    for wrong in [&[0.0; 3][..], &[f64::NAN; 7], &[]] {
        let refused = trial.person_stage_mut().track_limb(wrong);
        assert!(matches!(refused, Err(TestbedError::Limb { expected: 7, .. })), "{wrong:?}: {refused:?}");
    }
    // Nothing of it stays behind: the next ticks have no limb.
    let run = Run::of(&mut trial, 50)?;
    assert!(run.inputs.iter().all(|(_, input)| input.limb.is_none()));
    trial.person_stage_mut().track_limb(&[0.1; 7])?;
    let run = Run::of(&mut trial, 50)?;
    assert!(run.inputs.iter().any(|(_, input)| input.limb.is_some()));

    // The same by way of a log.
    for wrong in [joints(&[0.0; 3]), joints(&[f64::INFINITY; 7])] {
        let input = TickInput { limb: Some(wrong), ..TickInput::default() };
        let refused = testbed("A")?.tick(&input, false);
        assert!(matches!(refused, Err(TestbedError::Input { what: "tracked limb", .. })), "{refused:?}");
    }
    Ok(())
}

/// What a testbed did in some ticks: its joints after each, and what happened.
#[derive(Default)]
struct Course {
    joints: Vec<JointVector>,
    bases: Vec<Pose>,
    events: Vec<EventKind>,
}

impl Course {
    /// `ticks` ticks, of which the first has `input` and all others none.
    fn of(testbed: &mut Testbed, input: TickInput, ticks: usize) -> Outcome<Self> {
        let mut run_log = Self::default();
        for tick in 0..ticks {
            let input = if tick == 0 { &input } else { &TickInput::default() };
            let output = testbed.tick(input, false)?;
            run_log.events.extend(output.events.into_iter().map(|event| event.kind));
            run_log.joints.push(testbed.plant().state().position.clone());
            run_log.bases.push(testbed.plant().state().world_from_base);
        }
        Ok(run_log)
    }

    /// How far joint `k` turned, rad.
    fn turned(&self, k: usize) -> f64 {
        self.joints.windows(2).map(|pair| (pair[1][k] - pair[0][k]).abs()).sum()
    }
}

fn gesture(command: Command) -> TickInput {
    TickInput { command: Some(command), ..TickInput::default() }
}

fn shoulder(pose: Pose) -> TickInput {
    TickInput { shoulder: Some(pose), ..TickInput::default() }
}

/// The first finger joint, after the seven of the arm.
const FINGER: usize = 7;

// Catches a tracker's jump that hurls the arm, and a hand that goes on closing on its own.
#[test]
fn a_shoulder_that_jumps_pauses_base_arm_and_hand_until_it_is_back() -> Outcome {
    let mut testbed = testbed("A")?;
    let home = testbed.plant().state().world_from_base;
    // The hand closes, and meanwhile the first joint turns.
    Course::of(&mut testbed, gesture(Command::HandClose), 100)?;
    Course::of(&mut testbed, gesture(Command::NoMotion), 100)?;
    let before = Course::of(&mut testbed, gesture(Command::WristExtension), 300)?;
    let driven = (0..FINGER).find(|&k| before.turned(k) > 0.01).ok_or("no joint of the arm turns")?;
    assert!(before.turned(FINGER) > 0.01, "the hand closes");

    let away = Pose::translation(0.5, 0.0, 0.0) * home;
    let jumped = Course::of(&mut testbed, shoulder(away), 300)?;
    assert!(matches!(jumped.events[..], [EventKind::BaseHeld { distance }] if (distance - 0.5).abs() < 1e-9));
    assert!(jumped.bases.iter().all(|base| *base == home), "the base stays");
    assert_eq!((jumped.turned(driven), jumped.turned(FINGER)), (0.0, 0.0), "arm and hand stand");

    let back = Course::of(&mut testbed, shoulder(home), 300)?;
    assert!(back.events.contains(&EventKind::BaseFollows), "{:?}", back.events);
    assert!(back.turned(driven) > 0.01 && back.turned(FINGER) > 0.01, "both go on");
    Ok(())
}

/// A plant whose solver fails in ticks 5, 6 and 9.
struct Failing {
    plant: Box<dyn Plant>,
    steps: u32,
}

impl Plant for Failing {
    fn step(&mut self, command: &PlantCommand) -> Result<(), PlantError> {
        self.steps += 1;
        self.plant.step(command)
    }
    fn state(&self) -> &PlantState {
        self.plant.state()
    }
    fn contacts_solved(&self) -> bool {
        !matches!(self.steps, 5 | 6 | 9)
    }
    fn attach(&mut self, block: usize, link: usize) -> Result<(), PlantError> {
        self.plant.attach(block, link)
    }
    fn release(&mut self) {
        self.plant.release();
    }
    fn place(&mut self, block: usize, body: &BodyState) -> Result<(), PlantError> {
        self.plant.place(block, body)
    }
}

// Catches physics that are inexact without a word.
#[test]
fn contacts_that_are_not_solved_are_said_with_the_tick_and_counted_in_the_result() -> Outcome {
    let config = config("A", 60.0);
    let mut parts = doubles::testbed_parts(&config);
    parts.plant = Box::new(Failing { plant: parts.plant, steps: 0 });
    let mut trial = RunningTrial::new(Testbed::new(config, parts)?, PersonParts::default());
    let run = Run::of(&mut trial, 20)?;
    assert_eq!(run.times(|kind| *kind == EventKind::ContactsUnsolved), [5, 9]);
    assert_eq!(trial.result().unsolved_ticks, 3);
    Ok(())
}

// Catches a pause at every movement of the shoulder.
#[test]
fn a_shoulder_that_moves_as_people_do_is_followed() -> Outcome {
    let mut testbed = testbed("A")?;
    let home = testbed.plant().state().world_from_base;
    for step in 1..=20 {
        let pose = Pose::translation(0.0, 0.005 * f64::from(step), 0.0) * home;
        let run_log = Course::of(&mut testbed, shoulder(pose), 10)?;
        assert_eq!(run_log.events, []);
    }
    let rest = Course::of(&mut testbed, TickInput::default(), 1000)?;
    assert_eq!(rest.events, []);
    let moved = testbed.plant().state().world_from_base.translation.vector - home.translation.vector;
    assert!((moved - Vector::y() * 0.1).norm() < 1e-9, "{moved}");
    Ok(())
}

// Catches an arm that goes on when the page that held a gesture has died, and one that starts again by itself.
#[test]
fn the_arm_stops_when_its_page_dies_and_goes_on_after_a_relaxed_gesture() -> Outcome {
    let mut trial = RunningTrial::new(testbed("A")?, PersonParts::default());
    let page = InputSource::Page;
    // A page that gives a gesture is there.
    let send_command = |trial: &mut RunningTrial, command| {
        trial.person_stage_mut().record_heartbeat(page);
        trial.person_stage_mut().set_command_from(page, command);
    };
    send_command(&mut trial, Command::WristExtension);
    let alive = Run::of(&mut trial, 200)?;
    assert!(alive.turned(20, 200) > 0.01);
    let dead = Run::of(&mut trial, 800)?;
    let stop = dead.events.iter().find_map(|event| match &event.kind {
        EventKind::Stopped { source, cause, .. } => Some((event.time.0, *source, *cause)),
        _ => None,
    });
    let (at, source, cause) = stop.ok_or("the arm goes on")?;
    assert_eq!((source, cause), (page, StopCause::Silent));
    assert!(at <= 260, "stopped at {at} ms");
    // `Run` counts from its own first tick, which is that at 201 ms.
    assert_eq!(dead.turned(at + 1 - 200, 800), 0.0);

    // A page that is back, with the gesture still held, must not start the arm.
    for _ in 0..5 {
        send_command(&mut trial, Command::WristExtension);
        assert_eq!(Run::of(&mut trial, 50)?.turned(1, 50), 0.0);
    }
    send_command(&mut trial, Command::NoMotion);
    let relaxed = Run::of(&mut trial, 50)?;
    assert!(relaxed.events.iter().any(|event| event.kind == EventKind::Rearmed));
    send_command(&mut trial, Command::WristExtension);
    assert!(Run::of(&mut trial, 200)?.turned(20, 200) > 0.01);
    Ok(())
}

/// A person in another program who holds a gesture, gives nothing from `fails` to `acts`, and relaxes from `relaxes` on for a moment.
struct Stumbler {
    now: SimTime,
    relaxes: u64,
}

const FAILS: u64 = 1000;
const ACTS: u64 = 1500;

impl Participant for Stumbler {
    fn step(&mut self, frame: &DisplayFrame) -> Intention {
        self.now = frame.time;
        let rests = self.fault().is_some() || (self.relaxes..self.relaxes + 100).contains(&self.now.0);
        Intention {
            gesture: if rests { Command::NoMotion } else { Command::WristExtension },
            gaze_direction: Vector::x(),
            eyes_open: true,
            trunk: TrunkPosture::default(),
            limb: None,
        }
    }

    fn fault(&self) -> Option<&str> {
        let reason = if self.now.0 < 1200 { "division by zero" } else { "no camera" };
        (FAILS..ACTS).contains(&self.now.0).then_some(reason)
    }
}

// Catches a participant whose program fails while nobody is told, one that moves the arm when it is back before the hand was
// relaxed, and a log that does not know of it.
#[test]
fn a_participant_that_fails_stops_the_arm_with_its_reason_until_it_acts_again_with_a_relaxed_hand() -> Outcome
{
    let config = config("A", 60.0);
    let stumbler = Stumbler { now: SimTime(0), relaxes: 2000 };
    let person = PersonParts { participant: Some(Box::new(stumbler)), emg: None, gaze: None };
    let mut trial = RunningTrial::new(Testbed::new(config.clone(), doubles::testbed_parts(&config))?, person);
    let run = Run::of(&mut trial, 3000)?;

    let is_participant_stop = |kind: &EventKind| match kind {
        EventKind::Stopped { source: InputSource::Participant, cause, reason } => {
            *cause == StopCause::UnusableOutput && reason == "division by zero"
        }
        _ => false,
    };
    let (stops, goes_on) = (run.times(is_participant_stop), run.times(|kind| *kind == EventKind::Rearmed));
    // From one display frame to the next are 17 ms.
    assert!(matches!(stops[..], [at] if (FAILS..FAILS + 20).contains(&at)), "{stops:?}");
    assert!(matches!(goes_on[..], [at] if (2000..2020).contains(&at)), "{goes_on:?}");
    assert!(run.turned(500, FAILS) > 0.05 && run.turned(2200, 2900) > 0.05, "it moves while all is well");
    assert_eq!(run.turned(FAILS + 250, 2000), 0.0);

    let participant_inputs: Vec<_> =
        run.inputs.iter().filter_map(|(_, input)| input.participant.clone()).collect();
    assert_eq!(participant_inputs, [Err("division by zero".to_owned()), Err("no camera".to_owned()), Ok(())]);
    assert_eq!(replayed(&config, &run.inputs)?, run.spans);
    let without =
        |(time, input): &(SimTime, TickInput)| (*time, TickInput { participant: None, ..input.clone() });
    let forgets: Vec<_> = run.inputs.iter().map(without).collect();
    assert_ne!(replayed(&config, &forgets)?, run.spans, "the log would not be missed");
    Ok(())
}

/// A limb tracker that the method did not use stopped the arm.
#[test]
fn a_device_that_the_method_does_not_use_may_fall_silent_and_one_that_it_uses_may_not() -> Outcome {
    for (method, stops) in [("A", None), ("C", Some(InputSource::EyeTracker))] {
        let mut trial = RunningTrial::new(testbed(method)?, PersonParts::default());
        let mut found = Vec::new();
        for tick in 1..=4000_u32 {
            if tick < 500 && tick.is_multiple_of(10) {
                let moves = 1e-4 * f64::from(tick);
                trial.person_stage_mut().track_limb(&[moves; 7])?;
                let direction = Vector::new(1.0, moves, -0.3);
                trial.person_stage_mut().set_gaze(GazeSample {
                    origin: Point::origin(),
                    direction,
                    valid: true,
                });
            }
            trial.person_stage_mut().set_command(Command::WristExtension);
            found.extend(trial.step(false)?.output.events.into_iter().filter_map(|event| match event.kind {
                EventKind::Stopped { source, .. } => Some(source),
                _ => None,
            }));
        }
        assert_eq!(found.first().copied(), stops, "method {method}: {found:?}");
        assert!(!found.contains(&InputSource::LimbTracker), "the whole arm is lost");
    }
    Ok(())
}
