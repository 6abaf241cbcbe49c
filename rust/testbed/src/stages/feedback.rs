use crate::{CueEvent, FeedbackMapping, TrialConfig};
use proact_arm::ArmModel;
use proact_types::{Contact, Cue, Digit, Event, EventKind, FeedbackCue, SimTime, Tone, Vibration};

/// From events and contact forces to what a person is to hear and feel, by the mappings of the configuration.
#[derive(Clone, Debug)]
pub struct FeedbackStage {
    mappings: Vec<MappingState>,
    /// Of each link, the place of its digit in `digits`.
    digit_of: Vec<Option<usize>>,
    digits: Vec<Digit>,
}

/// What enters the feedback in one tick.
#[derive(Clone, Copy, Debug)]
pub struct FeedbackInput<'a> {
    /// Events of this tick.
    pub events: &'a [Event],
    /// Contacts between links and blocks in this tick.
    pub contacts: &'a [Contact],
}

#[derive(Clone, Debug)]
struct MappingState {
    mapping: FeedbackMapping,
    /// Largest force of each digit since it was last said, N; for a grip, the largest sum alone.
    peak_forces: Vec<f64>,
    /// Whether each of them was said to press.
    is_pressing: Vec<bool>,
}

impl FeedbackStage {
    /// The stage of a trial with the arm `model`.
    pub fn new(config: &TrialConfig, model: &ArmModel) -> Self {
        let mut order: Vec<usize> = model.digits().into_iter().flatten().collect();
        order.sort_unstable();
        order.dedup();
        let digit = |(number, link): (usize, &usize)| Digit {
            number: u8::try_from(number).unwrap_or(u8::MAX),
            link: model.links[*link].name.clone(),
        };
        let mapped = |mapping: &FeedbackMapping| {
            let count = match mapping {
                FeedbackMapping::Event { .. } => 0,
                FeedbackMapping::Pressure { .. } => order.len(),
                FeedbackMapping::Grip { .. } => 1,
            };
            MappingState {
                mapping: mapping.clone(),
                peak_forces: vec![0.0; count],
                is_pressing: vec![false; count],
            }
        };
        Self {
            mappings: config.feedback.iter().map(mapped).collect(),
            digit_of: model.digit_indices(),
            digits: order.iter().enumerate().map(digit).collect(),
        }
    }

    /// What is to be heard and felt from tick `now` on: cues of events in their order, then what goes on.
    pub fn step(&mut self, now: SimTime, input: FeedbackInput<'_>) -> Vec<FeedbackCue> {
        let mut cues = Vec::new();
        for event in input.events {
            let Some(happened) = cue_event(&event.kind) else { continue };
            for MappingState { mapping, .. } in &self.mappings {
                let FeedbackMapping::Event { event, sound, vibration } = mapping else { continue };
                if *event == happened && (sound.is_some() || vibration.is_some()) {
                    let (sound, vibration) = (*sound, *vibration);
                    cues.push(FeedbackCue { time: now, cue: happened.into(), digit: None, sound, vibration });
                }
            }
        }
        for mapped in &mut self.mappings {
            mapped.update_peaks(input.contacts, &self.digit_of);
            mapped.emit_cues(now, &self.digits, &mut cues);
        }
        cues
    }
}

fn cue_event(kind: &EventKind) -> Option<CueEvent> {
    match kind {
        EventKind::ObjectAttached { .. } => Some(CueEvent::ContactMade),
        EventKind::ObjectReleased { .. } => Some(CueEvent::ContactLost),
        EventKind::ObjectOnTarget { .. } | EventKind::ObjectCrossed { .. } => Some(CueEvent::OnTarget),
        EventKind::ObjectOffTarget { .. } => Some(CueEvent::OffTarget),
        _ => None,
    }
}

impl MappingState {
    /// Keeps the largest forces: what presses for a moment between two values is felt too.
    fn update_peaks(&mut self, contacts: &[Contact], digit_of: &[Option<usize>]) {
        let digit = |contact: &Contact| digit_of.get(contact.link).copied().flatten();
        match self.mapping {
            FeedbackMapping::Event { .. } => {}
            FeedbackMapping::Pressure { .. } => {
                for (number, largest) in self.peak_forces.iter_mut().enumerate() {
                    let on = contacts.iter().filter(|contact| digit(contact) == Some(number));
                    *largest = largest.max(on.map(|contact| contact.force).sum());
                }
            }
            FeedbackMapping::Grip { .. } => {
                let on = contacts.iter().filter(|contact| digit(contact).is_some());
                self.peak_forces[0] = self.peak_forces[0].max(on.map(|contact| contact.force).sum());
            }
        }
    }

    fn emit_cues(&mut self, now: SimTime, digits: &[Digit], cues: &mut Vec<FeedbackCue>) {
        let (full_n, threshold_n, rate_hz) = match self.mapping {
            FeedbackMapping::Event { .. } => return,
            FeedbackMapping::Pressure { full_n, threshold_n, rate_hz }
            | FeedbackMapping::Grip { full_n, threshold_n, rate_hz, .. } => (full_n, threshold_n, rate_hz),
        };
        let count = |tick: u64| (tick as f64 * rate_hz / 1000.0).floor();
        if now.0 == 0 || count(now.0) == count(now.0 - 1) {
            return;
        }
        // Twice the time to the next value: one that is lost leaves no gap, and when none comes any more it ends by itself.
        let ms = (2000.0 / rate_hz).ceil() as u32;
        for (number, (largest, pressed)) in self.peak_forces.iter_mut().zip(&mut self.is_pressing).enumerate()
        {
            let force = std::mem::take(largest);
            let presses = force > threshold_n;
            if !presses && !*pressed {
                continue;
            }
            *pressed = presses;
            let share = if presses { ((force - threshold_n) / (full_n - threshold_n)).min(1.0) } else { 0.0 };
            cues.push(match self.mapping {
                FeedbackMapping::Grip { hz: [low, high], .. } => FeedbackCue {
                    time: now,
                    cue: Cue::Grip,
                    digit: None,
                    sound: presses.then_some(Tone { hz: [low + share * (high - low); 2], ms }),
                    vibration: None,
                },
                _ => FeedbackCue {
                    time: now,
                    cue: Cue::Pressure,
                    digit: digits.get(number).cloned(),
                    sound: None,
                    vibration: Some(Vibration { strength: share, ms: if presses { ms } else { 0 } }),
                },
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Setup;
    use proact_control::doubles::test_hand;
    use proact_types::{ObjectId, Point, Vector};

    fn stage(feedback: Vec<FeedbackMapping>) -> FeedbackStage {
        let config = TrialConfig::new("D", 1, Setup::named("still").expect("ships"));
        FeedbackStage::new(&TrialConfig { feedback, ..config }, &test_hand())
    }

    /// A contact with `force` of the last link of digit `number`.
    fn contact(stage: &FeedbackStage, number: usize, force: f64) -> Contact {
        let link = stage.digit_of.iter().rposition(|digit| *digit == Some(number)).expect("a digit");
        Contact { object: 0, link, point: Point::origin(), normal: Vector::x(), force }
    }

    /// What is said in the ticks `from` to `to` while `contacts` last.
    fn run(stage: &mut FeedbackStage, from: u64, to: u64, contacts: &[Contact]) -> Vec<FeedbackCue> {
        let mut step = |tick| stage.step(SimTime(tick), FeedbackInput { events: &[], contacts });
        (from..to).flat_map(&mut step).collect()
    }

    #[test]
    fn contact_is_heard_and_felt_and_a_block_on_its_target_is_heard() {
        let event = |kind| Event { time: SimTime(7), kind };
        let object = ObjectId(0);
        let events = [
            event(EventKind::Unlocked),
            event(EventKind::ObjectAttached { object }),
            event(EventKind::ObjectOnTarget { object, distance: 0.01 }),
        ];
        let mut stage = stage(FeedbackMapping::standard());
        let cues = stage.step(SimTime(7), FeedbackInput { events: &events, contacts: &[] });
        assert_eq!(cues.iter().map(|cue| cue.cue).collect::<Vec<_>>(), [Cue::ContactMade, Cue::OnTarget]);
        assert!(cues.iter().all(|cue| cue.time == SimTime(7) && cue.sound.is_some()));
        assert_eq!(cues.iter().map(|cue| cue.vibration.is_some()).collect::<Vec<_>>(), [true, false]);
    }

    #[test]
    fn each_digit_is_felt_as_strongly_as_it_presses_as_often_as_asked_and_its_end_is_said_once() {
        let mut stage =
            stage(vec![FeedbackMapping::Pressure { full_n: 10.0, threshold_n: 2.0, rate_hz: 50.0 }]);
        let contacts = [contact(&stage, 0, 4.0), contact(&stage, 0, 2.0), contact(&stage, 1, 50.0)];
        let weak = [contact(&stage, 0, 2.0)];
        assert!(run(&mut stage, 1, 1001, &weak).is_empty(), "below the threshold nothing is said");
        let cues = run(&mut stage, 1001, 2001, &contacts);
        assert_eq!(cues.len(), 100, "two digits, 50 times in a second");
        let felt: Vec<_> =
            cues[..2].iter().map(|cue| (cue.digit.clone().map(|d| d.number), cue.vibration)).collect();
        let buzz = |strength| Some(Vibration { strength, ms: 40 });
        assert_eq!(
            felt,
            [(Some(0), buzz(0.5)), (Some(1), buzz(1.0))],
            "the sum of a digit's forces, at most one"
        );
        let ended = run(&mut stage, 2001, 3001, &[]);
        assert_eq!(ended.len(), 2);
        assert!(ended.iter().all(|cue| cue.vibration == Some(Vibration { strength: 0.0, ms: 0 })));
    }

    #[test]
    fn a_touch_between_two_values_is_felt_at_the_next() {
        let mut stage =
            stage(vec![FeedbackMapping::Pressure { full_n: 10.0, threshold_n: 0.0, rate_hz: 10.0 }]);
        let touch = [contact(&stage, 1, 5.0)];
        assert!(run(&mut stage, 201, 202, &touch).is_empty());
        let cues = run(&mut stage, 202, 301, &[]);
        assert_eq!(cues.len(), 1);
        assert_eq!((cues[0].time, cues[0].vibration.map(|v| v.strength)), (SimTime(300), Some(0.5)));
    }

    #[test]
    fn the_grip_is_heard_the_higher_the_harder_it_is() {
        let grip =
            FeedbackMapping::Grip { hz: [200.0, 400.0], full_n: 20.0, threshold_n: 0.0, rate_hz: 60.0 };
        let mut stage = stage(vec![grip]);
        let (soft, hard) = ([contact(&stage, 0, 5.0)], [contact(&stage, 0, 5.0), contact(&stage, 1, 5.0)]);
        let tone = |cues: &[FeedbackCue]| cues[0].sound.map(|tone| tone.hz[0]);
        assert_eq!(tone(&run(&mut stage, 1, 18, &soft)), Some(250.0));
        assert_eq!(tone(&run(&mut stage, 18, 35, &hard)), Some(300.0));
        let ended = run(&mut stage, 35, 1001, &[]);
        assert_eq!((ended.len(), ended[0].sound), (1, None));
    }

    #[test]
    fn mappings_out_of_range_are_refused_by_name() {
        let config = TrialConfig::new("D", 1, Setup::named("still").expect("ships"));
        for (mapping, expected) in [
            ("{ from = \"pressure\", full_n = 0.0 }", "feedback.full_n = 0"),
            ("{ from = \"pressure\", full_n = 5.0, threshold_n = 5.0 }", "feedback.threshold_n = 5"),
            ("{ from = \"pressure\", full_n = 5.0, rate_hz = 61.0 }", "feedback.rate_hz = 61"),
            ("{ from = \"grip\", full_n = 5.0, hz = [1.0, 2.0] }", "feedback.hz = [1.0, 2.0]"),
            (
                "{ from = \"event\", event = \"on_target\", vibration = { strength = 2.0, ms = 5 } }",
                "feedback.vibration",
            ),
            ("{ from = \"event\", event = \"sneeze\" }", "unknown variant sneeze"),
            ("{ from = \"warmth\" }", "unknown variant warmth"),
        ] {
            let error =
                config.with_overrides(&[format!("feedback=[{mapping}]")]).expect_err(mapping).to_string();
            assert!(error.contains(expected), "{mapping} gave {error}");
        }
        let text = config.to_toml().expect("writes");
        assert!(!text.contains("feedback"), "records of the standard mappings stay what they were");
        let silent = config.with_overrides(&["feedback=[]"]).expect("no feedback at all");
        assert_eq!(TrialConfig::from_toml(&silent.to_toml().expect("writes")), Ok(silent));
    }
}
