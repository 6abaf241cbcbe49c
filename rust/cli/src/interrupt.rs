use std::{
    error::Error,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

/// Blocks until Ctrl-C or a request to end.
pub(crate) fn wait_for_interrupt() -> Result<(), Box<dyn Error>> {
    let ended = interrupt_flag()?;
    while !ended.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(50));
    }
    Ok(())
}

/// A flag that Ctrl-C or a request to end raises.
pub(crate) fn interrupt_flag() -> Result<Arc<AtomicBool>, Box<dyn Error>> {
    let ended = Arc::new(AtomicBool::new(false));
    let flag = ended.clone();
    ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed))?;
    Ok(ended)
}
