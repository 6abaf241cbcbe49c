use super::{check_name, lsl_error};
use crate::DeviceError;
use lsl::{Pullable, StreamInlet};
use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc::{Receiver, SyncSender, TrySendError, sync_channel},
    },
    thread::JoinHandle,
};

/// A stream that is read in a thread of its own, because an inlet cannot leave the thread that made it.
pub(super) struct LslReader<S> {
    /// What came, as long as there is room; closed when liblsl gives the stream up.
    pub(super) samples: Receiver<S>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl<S: Send + 'static> LslReader<S> {
    /// Opens the stream called `name`, or without a name the only one of type `kind`. `connect` is given the property to
    /// find it by and its value, and gives what is known of the stream and what makes a sample of values and stamp.
    /// Up to `waiting` samples are kept; those beyond are dropped.
    ///
    /// # Errors
    /// An unusable name, and those of `connect`.
    pub(super) fn open<I, C, F>(
        name: Option<&str>,
        kind: &str,
        waiting: usize,
        connect: C,
    ) -> Result<(LslReader<S>, I), DeviceError>
    where
        I: Send + 'static,
        C: FnOnce(&str, &str) -> Result<(StreamInlet, I, F), DeviceError> + Send + 'static,
        F: FnMut(&StreamInlet, &[f64], f64) -> S,
    {
        let label = name.unwrap_or(kind).to_owned();
        check_name(&label)?;
        let property = if name.is_some() { "name" } else { "type" };
        let stop = Arc::new(AtomicBool::new(false));
        let (sender, samples) = sync_channel(waiting);
        let (ready, opened) = sync_channel(1);
        let thread = std::thread::spawn({
            let (label, stop) = (label.clone(), stop.clone());
            move || match connect(property, &label) {
                Ok((inlet, info, make)) => {
                    // If nobody waits any more, nobody takes samples either.
                    let _ = ready.send(Ok(info));
                    pull(&inlet, make, &sender, &stop);
                }
                Err(error) => {
                    let _ = ready.send(Err(error));
                }
            }
        });
        let info = opened.recv().map_err(|_| lsl_error(&label, "the thread of the stream has ended"))??;
        Ok((LslReader { samples, stop, thread: Some(thread) }, info))
    }
}

impl<S> Drop for LslReader<S> {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic of the thread has been told by itself.
            let _ = thread.join();
        }
    }
}

/// Hands samples over until it is told to stop, or liblsl gives up.
fn pull<S>(
    inlet: &StreamInlet,
    mut make: impl FnMut(&StreamInlet, &[f64], f64) -> S,
    samples: &SyncSender<S>,
    stop: &AtomicBool,
) {
    let mut values: Vec<f64> = Vec::new();
    while !stop.load(Ordering::Relaxed) {
        // A time-out gives a stamp of zero.
        let stamp = match inlet.pull_sample_buf(&mut values, 0.1) {
            Ok(0.0) => continue,
            Ok(stamp) => stamp,
            Err(_) => return,
        };
        match samples.try_send(make(inlet, &values, stamp)) {
            Ok(()) | Err(TrySendError::Full(_)) => {}
            Err(TrySendError::Disconnected(_)) => return,
        }
    }
}
