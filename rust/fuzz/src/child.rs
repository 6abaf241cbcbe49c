//! The process in which a target runs: limits, a hook that makes every panic fatal, and the loop over inputs.

use crate::targets::FuzzTarget;
use nix::sys::resource::{Resource, setrlimit};
use std::{
    error::Error,
    io::{self, Read, Write},
    path::Path,
    thread,
};

/// Address space of a target, bytes. The testbed alone takes a tenth; an input that needs more asks for what it announces.
const MAX_MEMORY_BYTES: u64 = 2 << 30;
/// Stack of a target, bytes: that of a thread. Servers and workers have no more.
const STACK_BYTES: usize = 2 << 20;
/// Largest file that a target may write, bytes.
const MAX_FILE_BYTES: u64 = 256 << 20;
/// What is written for each input that is done with; libraries may write other lines.
pub(crate) const DONE_LINE: &str = "fuzz: done";

/// Runs `target` on each input of standard input: its length as `u32`, little endian, and its bytes.
pub(crate) fn run_inputs(target: &'static FuzzTarget, scratch: &Path) -> Result<(), Box<dyn Error>> {
    setrlimit(Resource::RLIMIT_AS, MAX_MEMORY_BYTES, MAX_MEMORY_BYTES)?;
    setrlimit(Resource::RLIMIT_FSIZE, MAX_FILE_BYTES, MAX_FILE_BYTES)?;
    setrlimit(Resource::RLIMIT_CORE, 0, 0)?;
    // A panic in any thread ends the process, also where somebody would catch it.
    let usual = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        usual(info);
        std::process::abort();
    }));
    let scratch = scratch.to_owned();
    let work = move || -> io::Result<()> {
        let mut run = (target.start)(&scratch);
        let (mut input, mut output) = (io::stdin().lock(), io::stdout());
        // Said once before the first input: what begins a target takes time of its own.
        writeln!(output, "{DONE_LINE}")?;
        let mut length = [0; 4];
        while input.read_exact(&mut length).is_ok() {
            let mut bytes = vec![0; u32::from_le_bytes(length) as usize];
            input.read_exact(&mut bytes)?;
            run(&bytes);
            writeln!(output, "{DONE_LINE}")?;
            output.flush()?;
        }
        Ok(())
    };
    match thread::Builder::new().stack_size(STACK_BYTES).spawn(work)?.join() {
        Ok(done) => Ok(done?),
        Err(_) => Err("the target panicked".into()),
    }
}
