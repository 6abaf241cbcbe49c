//! The testbed's ports, implemented by the feed and the gaze tracker.

use crate::{EmgFeed, SimulatedEyeTracker};
use proact_testbed::ports::{EmgSource, GazeTracker};
use proact_types::{Command, EmgSample, GazeSample, Point, SimTime, Vector};

impl EmgSource for EmgFeed {
    fn sample_at(&mut self, now: SimTime, intended: Command) -> Vec<EmgSample> {
        let gesture = self.gesture_for(intended);
        EmgFeed::sample_at(self, now, gesture)
    }
}

impl GazeTracker for SimulatedEyeTracker {
    fn sample_at(&mut self, now: SimTime, eye: &Point, direction: &Vector, open: bool) -> Option<GazeSample> {
        SimulatedEyeTracker::sample_at(self, now, eye, direction, open)
    }
}
