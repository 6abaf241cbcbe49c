use super::{PersonTraits, stream};
use proact_types::{Command, SimTime, TrunkPosture};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Exp};

/// A gesture goes on being taken for another one in steps of a decision, ms.
const DECISION_MILLIS: u64 = 50;
/// A relaxed hand is confused this much less often than a working one. Assumed.
const REST_CONFUSION_FACTOR: f64 = 0.1;
/// A lean that counts once, rad.
const REFERENCE_LEAN_RAD: f64 = 25.0 * std::f64::consts::PI / 180.0;

/// From the gesture that is meant to what the muscles show: a two-state Markov chain, good and confused. While confused,
/// most decisions see the neighbour of what is meant: extensors open the hand and extend the wrist, flexors close it and
/// flex the wrist. A relaxed hand tenses.
pub(crate) struct ConfusionModel {
    rng: ChaCha8Rng,
    traits: PersonTraits,
    /// Confused until then, while there is a burst.
    confused_until: Option<SimTime>,
    /// What the decision under way sees.
    decoded_command: Command,
    next_decision: SimTime,
}

impl ConfusionModel {
    pub(crate) fn new(traits: &PersonTraits, seed: u64) -> Self {
        Self {
            rng: stream(seed, "muscles"),
            traits: *traits,
            confused_until: None,
            decoded_command: Command::NoMotion,
            next_decision: SimTime(0),
        }
    }

    /// What the muscles show of `intended`, with the trunk at `posture`.
    pub(crate) fn step(&mut self, now: SimTime, intended: Command, posture: &TrunkPosture) -> Command {
        if self.traits.confusions_per_min <= 0.0 {
            return intended;
        }
        while now >= self.next_decision {
            let at = self.next_decision;
            self.next_decision = at.plus_millis(DECISION_MILLIS);
            self.decoded_command = self.decode(at, intended, posture);
        }
        // A gesture that was just begun or ended is not taken for the one before.
        if self.confused_until.is_none() { intended } else { self.decoded_command }
    }

    fn decode(&mut self, at: SimTime, intended: Command, posture: &TrunkPosture) -> Command {
        if self.confused_until.is_some_and(|until| at >= until) {
            self.confused_until = None;
        }
        if self.confused_until.is_none() {
            let lean = posture.forward.hypot(posture.lateral) / REFERENCE_LEAN_RAD;
            let resting = if intended == Command::NoMotion { REST_CONFUSION_FACTOR } else { 1.0 };
            let per_min = self.traits.confusions_per_min
                * resting
                * (1.0 + self.traits.confusion_gain_per_25_deg * lean);
            let probability = per_min * DECISION_MILLIS as f64 / 60_000.0;
            if self.rng.random::<f64>() < probability {
                let mean = self.traits.confusion_burst_ms.max(1) as f64;
                let millis = Exp::new(1.0 / mean).map_or(mean, |length| length.sample(&mut self.rng));
                self.confused_until = Some(at.plus_millis(millis as u64 + 1));
            }
        }
        let confused =
            self.confused_until.is_some() && self.rng.random::<f64>() < self.traits.confused_decision_share;
        if confused { confused_with(intended) } else { intended }
    }
}

/// What a gesture is taken for.
fn confused_with(intended: Command) -> Command {
    match intended {
        Command::NoMotion => Command::WristExtension,
        Command::WristExtension => Command::HandOpen,
        Command::HandOpen => Command::WristExtension,
        Command::WristFlexion => Command::HandClose,
        Command::HandClose => Command::WristFlexion,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is shown each 17 ms of an hour of WE.
    fn shown(traits: &PersonTraits, forward: f64) -> Vec<Command> {
        let mut muscles = ConfusionModel::new(traits, 5);
        let posture = TrunkPosture { forward, ..TrunkPosture::default() };
        (0..3_600_000)
            .step_by(17)
            .map(|now| muscles.step(SimTime(now), Command::WristExtension, &posture))
            .collect()
    }

    fn wrong(decoded_commands: &[Command]) -> usize {
        decoded_commands.iter().filter(|command| **command != Command::WristExtension).count()
    }

    #[test]
    fn errors_come_in_bursts_of_the_neighbouring_gesture_as_often_as_said() {
        let traits = PersonTraits { confusions_per_min: 6.0, ..PersonTraits::default() };
        let seen = shown(&traits, 0.0);
        assert!(seen.iter().all(|g| matches!(g, Command::WristExtension | Command::HandOpen)));
        // 6 a minute of 0.7 s with 0.8 of the decisions wrong: 5.6 % of the time.
        let share = wrong(&seen) as f64 / seen.len() as f64;
        assert!((0.047..0.062).contains(&share), "{share}");
        // In runs that outlast three decisions, which single errors of that rate hardly ever would.
        let max_run = seen.split(|g| *g == Command::WristExtension).map(<[Command]>::len).max();
        assert!(max_run > Some(9), "{max_run:?} samples of 17 ms");
    }

    #[test]
    fn a_lean_makes_it_worse_and_nobody_in_particular_is_never_confused() {
        let traits = PersonTraits {
            confusions_per_min: 6.0,
            confusion_gain_per_25_deg: 2.0,
            ..PersonTraits::default()
        };
        assert!(wrong(&shown(&traits, 0.43)) > 2 * wrong(&shown(&traits, 0.0)));
        assert_eq!(wrong(&shown(&PersonTraits::default(), 0.4)), 0);
    }
}
