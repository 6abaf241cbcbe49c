//! Markers of a trial for other recorders, as ArmSym's: strings that say when the experiment and each trial begin and end.

/// The experiment began: said once, just before its first trial begins.
pub const EXPERIMENT_STARTED: &str = "0";
/// A trial, or a practice, began.
pub const TRIAL_STARTED: &str = "1";
/// It ended, whatever ended it.
pub const TRIAL_ENDED: &str = "2";
/// The experiment is finished: the program leaves.
pub const EXPERIMENT_FINISHED: &str = "3";

/// What sends a marker: the marker, and how long ago it was due, s.
pub type MarkerSender = Box<dyn FnMut(&str, f64)>;

/// Sends the markers of an experiment's trials.
pub struct TrialMarkers {
    send: MarkerSender,
    /// A trial has begun in this experiment.
    experiment_started: bool,
    in_trial: bool,
}

impl TrialMarkers {
    /// Markers that `send` gets.
    pub fn new(send: MarkerSender) -> TrialMarkers {
        TrialMarkers { send, experiment_started: false, in_trial: false }
    }

    /// The time of a trial runs, and is `age_secs` after zero by now.
    pub fn begin(&mut self, age_secs: f64) {
        if std::mem::replace(&mut self.in_trial, true) {
            return;
        }
        if !std::mem::replace(&mut self.experiment_started, true) {
            (self.send)(EXPERIMENT_STARTED, age_secs);
        }
        (self.send)(TRIAL_STARTED, age_secs);
    }

    /// The trial is over; one that never began has no end.
    pub fn end(&mut self) {
        if std::mem::take(&mut self.in_trial) {
            (self.send)(TRIAL_ENDED, 0.0);
        }
    }
}

impl Drop for TrialMarkers {
    fn drop(&mut self) {
        self.end();
        if self.experiment_started {
            (self.send)(EXPERIMENT_FINISHED, 0.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::{cell::RefCell, rc::Rc};

    /// Markers as they came, with their ages.
    type SentMarkers = Rc<RefCell<Vec<(String, f64)>>>;

    fn recording_markers() -> (TrialMarkers, SentMarkers) {
        let sent_markers = SentMarkers::default();
        let to = Rc::clone(&sent_markers);
        let send = move |marker: &str, age: f64| to.borrow_mut().push((marker.to_owned(), age));
        (TrialMarkers::new(Box::new(send)), sent_markers)
    }

    #[test]
    fn each_trial_begins_and_ends_once_between_the_experiments_start_and_end() {
        let (mut markers, sent_markers) = recording_markers();
        for _ in 0..2 {
            markers.begin(0.016);
            markers.begin(0.032);
            markers.end();
            markers.end();
        }
        drop(markers);
        let sent_markers = sent_markers.borrow();
        let order: Vec<&str> = sent_markers.iter().map(|(marker, _)| marker.as_str()).collect();
        assert_eq!(order, ["0", "1", "2", "1", "2", "3"]);
        assert_eq!((sent_markers[1].1, sent_markers[2].1), (0.016, 0.0));
    }

    #[test]
    fn a_program_that_leaves_in_a_trial_ends_it_and_one_that_never_began_says_nothing() {
        let (mut markers, sent_markers) = recording_markers();
        markers.begin(0.0);
        drop(markers);
        let order: Vec<String> = sent_markers.borrow().iter().map(|(marker, _)| marker.clone()).collect();
        assert_eq!(order, ["0", "1", "2", "3"]);
        let (mut markers, sent_markers) = recording_markers();
        markers.end();
        drop(markers);
        assert!(sent_markers.borrow().is_empty());
    }
}
