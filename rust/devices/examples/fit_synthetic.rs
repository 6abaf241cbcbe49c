//! Fits the figures of synthetic EMG to recordings and writes them as JSON:
//!
//! ```text
//! cargo run --release -p proact-devices --example fit_synthetic -- DIR 0,1,2 "ORIGIN AND LICENCE" > FILE
//! ```
//!
//! The file in `data/` is this output with one matrix row a line; a test compares the figures.

use proact_devices::{MYO_RATE_HZ, Recordings, SyntheticModel};
use std::{env, error::Error, path::Path};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [dir, reps, origin] = arguments.as_slice() else {
        return Err("usage: fit_synthetic DIR REPETITIONS ORIGIN".into());
    };
    let reps: Vec<u32> = reps.split(',').map(str::parse).collect::<Result<_, _>>()?;
    let recordings = Recordings::read(Path::new(dir), MYO_RATE_HZ)?;
    let model = SyntheticModel::fit(&recordings, &reps, origin)?;
    println!("{}", serde_json::to_string_pretty(&model)?);
    Ok(())
}
