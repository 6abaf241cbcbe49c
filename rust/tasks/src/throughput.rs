//! Throughput of pointing, both ways in which it is reported.

/// Width of a normal distribution in its standard deviations that holds as much information as a target of that width:
/// sqrt(2 pi e). That ISO/TS 9241-411:2012 asks for this width is recalled and not confirmed: the standard is not public.
const EFFECTIVE_WIDTH_SDS: f64 = 4.132_731_354_122_493;

/// One movement to a target that was reached.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PointingMovement {
    /// Which pair of distance and width.
    pub(crate) condition: usize,
    /// From the target before to this one, metres.
    pub(crate) distance: f64,
    /// Diameter of the target, metres.
    pub(crate) width: f64,
    /// Until it was entered for the last time.
    pub(crate) seconds: f64,
    /// How far the hand went along the line from the target before to this one, metres.
    pub(crate) along: f64,
    /// How far beyond the target's middle it ended on that line, metres.
    pub(crate) overshoot_m: f64,
}

/// Index of difficulty in Shannon's form, bits.
pub(crate) fn index_of_difficulty(distance: f64, width: f64) -> f64 {
    (distance / width + 1.0).log2()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Movements by condition.
fn conditions(movements: &[PointingMovement]) -> Vec<Vec<PointingMovement>> {
    let last = movements.iter().map(|m| m.condition).max();
    let of = |k: usize| movements.iter().filter(|m| m.condition == k).copied().collect::<Vec<_>>();
    (0..last.map_or(0, |last| last + 1)).map(of).filter(|some| !some.is_empty()).collect()
}

/// Bits a second with the widths and distances that were shown: of each condition its difficulty over its mean movement
/// time, and of these the mean (Soukoreff and MacKenzie 2004, Int. J. Human-Computer Studies 61:751, mean of means). None
/// without a movement.
pub(crate) fn nominal_throughput(movements: &[PointingMovement]) -> Option<f64> {
    let of = |some: &Vec<PointingMovement>| {
        let times: Vec<f64> = some.iter().map(|m| m.seconds.max(1e-3)).collect();
        let bits: Vec<f64> = some.iter().map(|m| index_of_difficulty(m.distance, m.width)).collect();
        mean(&bits) / mean(&times)
    };
    let rates: Vec<f64> = conditions(movements).iter().map(of).collect();
    (!rates.is_empty()).then(|| mean(&rates))
}

/// The same with the effective width, 4.133 standard deviations of the ends along the way, and the effective distance,
/// the mean way along it. None where no condition has two movements.
pub(crate) fn effective_throughput(movements: &[PointingMovement]) -> Option<f64> {
    let of = |some: &Vec<PointingMovement>| {
        let ends: Vec<f64> = some.iter().map(|m| m.overshoot_m).collect();
        let middle = mean(&ends);
        let squares: f64 = ends.iter().map(|end| (end - middle).powi(2)).sum();
        let deviation = (squares / (ends.len() as f64 - 1.0)).sqrt();
        let distance = mean(&some.iter().map(|m| m.along).collect::<Vec<_>>());
        let time = mean(&some.iter().map(|m| m.seconds.max(1e-3)).collect::<Vec<_>>());
        // Ends that are all alike say nothing of a width.
        (some.len() > 1 && deviation > 1e-9 && distance > 0.0)
            .then(|| index_of_difficulty(distance, EFFECTIVE_WIDTH_SDS * deviation) / time)
    };
    let rates: Vec<f64> = conditions(movements).iter().filter_map(of).collect();
    (!rates.is_empty()).then(|| mean(&rates))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn aimed(condition: usize, seconds: f64, beyond: f64) -> PointingMovement {
        PointingMovement {
            condition,
            distance: 0.3,
            width: 0.1,
            seconds,
            along: 0.3 + beyond,
            overshoot_m: beyond,
        }
    }

    #[test]
    fn throughputs_are_those_worked_out_by_hand() {
        // Two bits each; 1 s and 3 s in the first condition, 1 s in the second: (2 / 2 + 2 / 1) / 2.
        let some = [aimed(0, 1.0, 0.01), aimed(0, 3.0, -0.01), aimed(1, 1.0, 0.0)];
        assert!((nominal_throughput(&some).expect("some") - 1.5).abs() < 1e-12);
        // The first condition alone has a spread: sqrt(2) cm, so a width of 5.845 cm at 30 cm, 2 s a movement.
        let bits = (0.3 / (4.132_731_354_122_493 * 0.02_f64.hypot(0.0) / 2.0_f64.sqrt()) + 1.0).log2();
        assert!(
            (effective_throughput(&some).expect("some") - bits / 2.0).abs() < 1e-12,
            "{:?}",
            effective_throughput(&some)
        );
        assert_eq!((nominal_throughput(&[]), effective_throughput(&some[2..])), (None, None));
    }

    #[test]
    fn the_widths_of_a_normal_distribution_are_the_root_of_two_pi_e() {
        let expected = (2.0 * std::f64::consts::PI * std::f64::consts::E).sqrt();
        assert!((EFFECTIVE_WIDTH_SDS - expected).abs() < 1e-12);
    }
}
