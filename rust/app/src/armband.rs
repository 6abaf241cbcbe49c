//! An armband in a live trial: samples come on a thread of their own and go into the ticks.

use crate::emg_model_file::{model_uses_imu, read_model};
use crate::print_status;
use proact_devices::{EmgPacket, SampleSource, SourceEvent, SourceName, SourceOptions, SourceRegistry};
use proact_emg::EmgModel;
use proact_http::LogThrottle;
use proact_testbed::ports::EmgSource;
use proact_types::{Command, CommandMap, EmgSample, Gesture, MAX_TICK_SAMPLES, SimTime};
use std::{
    error::Error,
    path::Path,
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, AtomicU64, Ordering},
        mpsc::{Receiver, RecvTimeoutError, Sender, SyncSender, TrySendError, channel, sync_channel},
    },
    thread::JoinHandle,
    time::{Duration, Instant},
};

/// Samples that may wait; those beyond are lost and leave a gap in the counter. Four seconds at 1 kHz.
const MAX_QUEUED_SAMPLES: usize = 4096;

/// Samples that come within this time of the first make one packet of [`LiveArmband::wait_for_samples`].
const PACKET_GATHER_TIME: Duration = Duration::from_millis(2);

/// A sample, and when its packet came.
type TimedEmgSample = (Instant, EmgSample);

/// The stream of an armband, shared by the trials of a session. Its loss is told on standard error; the trial itself sees a
/// silence, which stops the arm.
pub struct LiveArmband {
    samples: Arc<Mutex<Receiver<TimedEmgSample>>>,
    prompts: Sender<Gesture>,
    received: Arc<AtomicU64>,
    stop: Arc<AtomicBool>,
    /// Gives the source back when it ends.
    thread: Option<JoinHandle<Box<dyn SampleSource>>>,
    model: EmgModel,
}

impl LiveArmband {
    /// Opens the source, one of `sources`, and reads its model.
    ///
    /// # Errors
    /// A source that cannot be opened, or a model that does not fit it.
    pub fn open(
        sources: &SourceRegistry,
        source: &SourceName,
        model: &Path,
    ) -> Result<LiveArmband, Box<dyn Error>> {
        let options = SourceOptions { imu: model_uses_imu(model)?, ..SourceOptions::default() };
        let source = sources.open(source, &options)?;
        let model = read_model(model, source.info())?;
        Ok(Self::start(source, model))
    }

    /// Samples begin to come from `source`, which `model` fits.
    pub fn start(mut source: Box<dyn SampleSource>, mut model: EmgModel) -> LiveArmband {
        let rails = source.info().rails.map(|(low, high)| [low, high]);
        model.config.liveness = model.liveness(rails);
        let (sender, samples) = sync_channel(MAX_QUEUED_SAMPLES);
        let (prompts, prompted) = channel();
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = stop.clone();
        let received = Arc::new(AtomicU64::new(0));
        let counted = received.clone();
        let thread = std::thread::spawn(move || {
            let mut packet = EmgPacket::default();
            // A band at the edge of its radio's reach is lost and found many times.
            let mut repeats = LogThrottle::default();
            while !stopped.load(Ordering::Relaxed) {
                print_reports(repeats.take_due(Instant::now()));
                if let Some(gesture) = prompted.try_iter().last() {
                    source.prompt(gesture);
                }
                match source.poll(Duration::from_millis(20), &mut packet) {
                    Ok(SourceEvent::Packet) => {
                        if !forward_packet(&sender, &packet) {
                            return source;
                        }
                        counted.fetch_add(packet.samples.len() as u64, Ordering::Release);
                    }
                    Ok(SourceEvent::Lost { reason }) => {
                        print_reports(repeats.report(
                            "lost",
                            format!("armband lost: {reason}"),
                            Instant::now(),
                        ));
                    }
                    Ok(SourceEvent::Restored) => {
                        print_reports(repeats.report(
                            "found",
                            "armband found again".to_owned(),
                            Instant::now(),
                        ));
                    }
                    Ok(SourceEvent::Nothing) => {}
                    Ok(SourceEvent::Ended) => {
                        print_status("the EMG source has ended");
                        return source;
                    }
                    Err(error) => {
                        print_status(format_args!("armband: {error}"));
                        return source;
                    }
                }
            }
            source
        });
        let samples = Arc::new(Mutex::new(samples));
        LiveArmband { samples, prompts, received, stop, thread: Some(thread), model }
    }

    /// Samples that have arrived since the start.
    pub fn received(&self) -> u64 {
        self.received.load(Ordering::Acquire)
    }

    /// The model.
    pub fn model(&self) -> &EmgModel {
        &self.model
    }

    /// Tells simulated people who wear it what to make.
    pub fn prompt(&self, gesture: Gesture) {
        // An error means that the source has ended, which has been told.
        let _ = self.prompts.send(gesture);
    }

    /// Ends the stream; its source, for another model. None if its thread panicked.
    pub fn into_source(mut self) -> Option<Box<dyn SampleSource>> {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.take()?.join().ok()
    }

    /// Waits at most for `timeout`; the samples that came since, oldest first, and those that came with them.
    pub fn wait_for_samples(&self, timeout: Duration) -> Vec<EmgSample> {
        let samples = self.samples.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let mut came = Vec::new();
        let mut end = Instant::now() + timeout;
        loop {
            match samples.recv_timeout(end.saturating_duration_since(Instant::now())) {
                Ok((_, sample)) => {
                    if came.is_empty() {
                        end = Instant::now() + PACKET_GATHER_TIME;
                    }
                    came.push(sample);
                }
                Err(RecvTimeoutError::Timeout) => return came,
                Err(RecvTimeoutError::Disconnected) => {
                    // The source has ended, which has been told; whoever waits again is not to turn in circles.
                    std::thread::sleep(end.saturating_duration_since(Instant::now()));
                    return came;
                }
            }
        }
    }

    /// The armband of the next trial, from now on. Simulated people who wear it give commands as `commands` says.
    pub fn new_port(&self, commands: CommandMap) -> Box<dyn EmgSource> {
        let mut port = ArmbandPort {
            samples: self.samples.clone(),
            prompts: self.prompts.clone(),
            intended: Command::NoMotion,
            commands,
            queue_delay: None,
        };
        // What came before the trial is none of it.
        port.drain(usize::MAX);
        Box::new(port)
    }
}

/// Prints what there is to say.
fn print_reports(texts: impl IntoIterator<Item = String>) {
    for text in texts {
        print_status(text);
    }
}

impl Drop for LiveArmband {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// False if nobody listens any more.
fn forward_packet(sender: &SyncSender<TimedEmgSample>, packet: &EmgPacket) -> bool {
    let now = Instant::now();
    packet.samples.iter().all(|sample| match sender.try_send((now, sample.clone())) {
        Ok(()) | Err(TrySendError::Full(_)) => true,
        Err(TrySendError::Disconnected(_)) => false,
    })
}

struct ArmbandPort {
    samples: Arc<Mutex<Receiver<TimedEmgSample>>>,
    prompts: Sender<Gesture>,
    intended: Command,
    commands: CommandMap,
    queue_delay: Option<Duration>,
}

impl ArmbandPort {
    fn drain(&mut self, max_samples: usize) -> Vec<EmgSample> {
        let samples = self.samples.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let mut out = Vec::new();
        self.queue_delay = None;
        for (came, sample) in samples.try_iter().take(max_samples) {
            self.queue_delay.get_or_insert_with(|| came.elapsed());
            out.push(sample);
        }
        out
    }
}

impl EmgSource for ArmbandPort {
    /// What has arrived, at most eight a tick. The keys of the page are prompts for simulated people; armbands on people
    /// take no notice.
    fn sample_at(&mut self, _now: SimTime, intended: Command) -> Vec<EmgSample> {
        if intended != self.intended {
            self.intended = intended;
            // An error means that the source has ended, which has been told.
            let _ = self.prompts.send(self.commands.gesture_for(intended));
        }
        self.drain(MAX_TICK_SAMPLES)
    }

    fn oldest_sample_wait(&self) -> Option<Duration> {
        self.queue_delay
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_devices::{Pacing, SimulatedPersonSource};
    use proact_emg::{Calibration, CalibrationConfig, CalibrationPhase, EmgConfig};
    use std::collections::BTreeMap;

    /// A model of the generator, from its own samples.
    fn model() -> EmgModel {
        let source = proact_devices::EmgOrigin::Synthetic;
        let mut person =
            SimulatedPersonSource::new(&source, Pacing::AsFastAsPossible, Duration::ZERO, 1).unwrap();
        let config = CalibrationConfig { emg: EmgConfig::default(), ..CalibrationConfig::default() };
        let mut calibration = Calibration::new(config).unwrap();
        let mut packet = EmgPacket::default();
        while calibration.phase() != CalibrationPhase::Reviewing {
            if let CalibrationPhase::Preparing { prompt, .. } = calibration.phase() {
                person.prompt(prompt.gesture);
            }
            person.poll(Duration::ZERO, &mut packet).unwrap();
            calibration.step(SimTime(packet.received.as_millis() as u64), &packet.samples).unwrap();
        }
        calibration.finish().unwrap()
    }

    #[test]
    fn samples_come_in_order_and_a_trial_gets_none_from_before_it() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("model.json");
        std::fs::write(&path, model().to_json().unwrap()).unwrap();
        let armband =
            LiveArmband::open(&SourceRegistry::standard(), &"synthetic".parse().unwrap(), &path).unwrap();
        let commands = || {
            CommandMap::new(&Command::ALL.map(Gesture::from), Gesture::default(), &BTreeMap::new()).unwrap()
        };
        let mut port = armband.new_port(commands());
        let mut counters = Vec::new();
        while counters.len() < 100 {
            let taken = port.sample_at(SimTime(0), Command::NoMotion);
            assert!(taken.len() <= 8);
            counters.extend(taken.iter().map(|s| s.counter));
            std::thread::sleep(Duration::from_millis(1));
        }
        assert!(counters.windows(2).all(|w| w[1] == w[0] + 1), "{counters:?}");
        let last = *counters.last().unwrap();
        // Between two trials samples pile up; the next trial does not see them.
        std::thread::sleep(Duration::from_millis(100));
        let mut next = armband.new_port(commands());
        let first = loop {
            if let Some(sample) = next.sample_at(SimTime(0), Command::NoMotion).first() {
                break sample.counter;
            }
        };
        assert!(first > last + 16, "{first} after {last}");
        let error = LiveArmband::open(
            &SourceRegistry::standard(),
            &"synthetic".parse().unwrap(),
            Path::new("/nowhere"),
        )
        .map(|_| ())
        .unwrap_err()
        .to_string();
        assert!(error.contains("cannot read /nowhere"), "{error}");
    }
}
