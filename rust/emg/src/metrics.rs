use serde::Serialize;

/// How well windows were recognised, by the definitions of LibEMG's `OfflineMetrics`; its names are in brackets.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RecognitionMetrics {
    /// Share of windows recognised (`CA`).
    pub accuracy: f64,
    /// Share of windows taken wrongly among those taken for another class than rest: what moves the arm and should not
    /// (`AER`).
    pub active_error: f64,
    /// Changes of the recognised class beyond those of the true one, a window (`INS`).
    pub instability: f64,
    /// Share of the windows of a class that were recognised, mean over classes weighted by their windows (`RECALL`).
    pub recall: f64,
    /// Share of the windows taken for a class that were of it, weighted likewise; 0 for a class that nothing was taken for
    /// (`PREC`).
    pub precision: f64,
    /// Harmonic mean of the two, weighted likewise (`F1`).
    pub f1: f64,
}

impl RecognitionMetrics {
    /// Of the true and the recognised class of each window, in the order of time, at least one; `rest` is the class of the
    /// relaxed hand, if there is one.
    pub fn from_windows(windows: &[(usize, usize)], rest: Option<usize>) -> RecognitionMetrics {
        let share = |part: usize, whole: usize| if whole == 0 { 0.0 } else { part as f64 / whole as f64 };
        let count =
            |keep: &dyn Fn(usize, usize) -> bool| windows.iter().filter(|(t, r)| keep(*t, *r)).count();
        let changes = |of: fn(&(usize, usize)) -> usize| {
            windows.windows(2).filter(|pair| of(&pair[0]) != of(&pair[1])).count() as f64
        };
        let extra = changes(|window| window.1) - changes(|window| window.0);
        let active = count(&|_, predicted| Some(predicted) != rest);
        let wrongly = count(&|truth, predicted| Some(predicted) != rest && truth != predicted);
        let mut metrics = RecognitionMetrics {
            accuracy: share(count(&|truth, predicted| truth == predicted), windows.len()),
            active_error: share(wrongly, active),
            instability: (extra / windows.len().max(1) as f64).max(0.0),
            recall: 0.0,
            precision: 0.0,
            f1: 0.0,
        };
        let classes = windows.iter().map(|(truth, _)| truth + 1).max().unwrap_or(0);
        for class in 0..classes {
            let of_class = count(&|truth, _| truth == class);
            let hits = count(&|truth, predicted| truth == class && predicted == class);
            let recall = share(hits, of_class);
            let precision = share(hits, count(&|_, predicted| predicted == class));
            let both = recall + precision;
            let weight = share(of_class, windows.len());
            metrics.recall += weight * recall;
            metrics.precision += weight * precision;
            metrics.f1 += if both > 0.0 { weight * 2.0 * recall * precision / both } else { 0.0 };
        }
        metrics
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metrics_are_libemgs() {
        let truth = [0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 2, 0, 0, 1, 1, 2];
        let predicted = [0, 1, 0, 0, 1, 1, 2, 1, 2, 2, 0, 2, 2, 0, 2, 1, 0, 2];
        let windows: Vec<(usize, usize)> = truth.into_iter().zip(predicted).collect();
        let got = RecognitionMetrics::from_windows(&windows, Some(2));
        // LibEMG 2.0.3, `extract_offline_metrics` with `null_label=2`.
        let expected = [
            0.7222222222222222,
            0.2727272727272727,
            0.4444444444444444,
            0.7222222222222222,
            0.726984126984127,
            0.7210567210567209,
        ];
        let pairs = [got.accuracy, got.active_error, got.instability, got.recall, got.precision, got.f1];
        for (got, expected) in pairs.into_iter().zip(expected) {
            assert!((got - expected).abs() < 1e-12, "{pairs:?}");
        }
        let never = RecognitionMetrics::from_windows(&[(0, 1), (1, 1)], None);
        assert_eq!((never.precision, never.instability), (0.25, 0.0));
    }
}
