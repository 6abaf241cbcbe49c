//! Fits the figures of synthetic EMG to recordings and writes them as JSON:
//!
//! ```text
//! cargo run --release -p proact-devices --example fit_synthetic -- DIR 0,1,2 "ORIGIN AND LICENCE" > FILE
//! ```
//!
//! The covariance of a gesture is that of all its samples about their mean. The fluctuation of the amplitude is
//! the standard deviation of the logarithm of the root mean square over blocks of half a second, less what blocks
//! of white noise of constant amplitude would show.

use proact_devices::{FittedGesture, MYO_RATE_HZ, Recordings, SyntheticModel};
use std::{env, error::Error, path::Path};

const BLOCK_SECS: f64 = 0.5;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [dir, reps, origin] = arguments.as_slice() else {
        return Err("usage: fit_synthetic DIR REPETITIONS ORIGIN".into());
    };
    let reps: Vec<u32> = reps.split(',').map(str::parse).collect::<Result<_, _>>()?;
    let recordings = Recordings::read(Path::new(dir), MYO_RATE_HZ)?;
    let mut gestures = Vec::new();
    for gesture in recordings.gestures() {
        let mut rows: Vec<Vec<f64>> = Vec::new();
        for &rep in &reps {
            rows.extend(recordings.find(gesture, rep)?.samples.iter().map(|s| s.to_vec()));
        }
        let (covariance, amplitude_log_sd) = fit(&rows, (BLOCK_SECS * recordings.rate_hz) as usize);
        gestures.push(FittedGesture { gesture, covariance, amplitude_log_sd });
    }
    let model = SyntheticModel {
        origin: origin.clone(),
        unit: "counts of a Myo armband, signed 8 bit".into(),
        gestures,
    };
    println!("{}", serde_json::to_string_pretty(&model)?);
    Ok(())
}

/// Covariance, and fluctuation of the amplitude over blocks of `block` samples, both rounded.
fn fit(rows: &[Vec<f64>], block: usize) -> (Vec<Vec<f64>>, f64) {
    let (count, channels) = (rows.len() as f64, rows[0].len());
    let mean: Vec<f64> = (0..channels).map(|c| rows.iter().map(|r| r[c]).sum::<f64>() / count).collect();
    let entry =
        |i: usize, j: usize| rows.iter().map(|r| (r[i] - mean[i]) * (r[j] - mean[j])).sum::<f64>() / count;
    let covariance: Vec<Vec<f64>> =
        (0..channels).map(|i| (0..channels).map(|j| round(entry(i, j), 100.0)).collect()).collect();

    let log_rms = |rows: &[Vec<f64>]| {
        let square: f64 = rows.iter().flatten().map(|v| v * v).sum();
        0.5 * (square / (rows.len() * channels) as f64).ln()
    };
    let logs: Vec<f64> = rows.chunks_exact(block).map(log_rms).collect();
    let centre = logs.iter().sum::<f64>() / logs.len() as f64;
    let variance = logs.iter().map(|v| (v - centre).powi(2)).sum::<f64>() / (logs.len() - 1) as f64;
    // A mean square of n independent Gaussian values with weights w has a relative variance of
    // 2 sum w^2 / (sum w)^2 / n; its logarithm's half a quarter of that.
    let trace: f64 = (0..channels).map(|k| entry(k, k)).sum();
    let squares: f64 = (0..channels)
        .flat_map(|i| (0..channels).map(move |j| (i, j)))
        .map(|(i, j)| entry(i, j).powi(2))
        .sum();
    let by_noise = 0.5 * squares / (trace * trace) / block as f64;
    (covariance, round((variance - by_noise).max(0.0).sqrt(), 1000.0))
}

fn round(value: f64, steps: f64) -> f64 {
    (value * steps).round() / steps
}
