use std::time::{Duration, Instant};

/// Keeps simulated time in step with the clock on the wall.
pub struct RealTimePacer {
    start: Instant,
    ticks: u64,
}

impl Default for RealTimePacer {
    fn default() -> Self {
        Self::new()
    }
}

impl RealTimePacer {
    /// Time begins now.
    pub fn new() -> Self {
        Self { start: Instant::now(), ticks: 0 }
    }

    /// Call once per tick: sleeps until the tick's time has come. A machine that cannot keep up falls behind
    /// and is forgiven, so that it does not race afterwards.
    pub fn wait_for_tick(&mut self) {
        self.ticks += 1;
        let due = self.start + Duration::from_millis(self.ticks);
        let now = Instant::now();
        if due > now {
            // Sleeping costs tens of microseconds: a few ticks at a time are smooth enough for 60 Hz.
            if due - now > Duration::from_millis(2) {
                std::thread::sleep(due - now);
            }
        } else if now - due > Duration::from_millis(100) {
            self.start = now;
            self.ticks = 0;
        }
    }
}
