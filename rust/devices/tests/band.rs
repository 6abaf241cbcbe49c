//! The band check between sessions of five people.
#![allow(clippy::unwrap_used)]

#[allow(dead_code)] // Its main.
#[path = "../examples/band_check.rs"]
mod band_check;

use std::path::PathBuf;

/// Of a check by the classifier alone 35 of these 180 pairs were told to calibrate, and four to turn a band that sat right.
#[test]
fn the_band_of_five_people_is_found_where_it_sits_in_another_session() {
    let beside = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
    let dir =
        std::env::var_os("PROACT_SHARED").map_or_else(beside, PathBuf::from).join("data/emg/myo_readings");
    if !dir.is_dir() {
        println!("skipped: ../shared not found");
        return;
    }
    let counts = band_check::judge(&dir).unwrap();
    println!("{counts:?}");
    assert_eq!((counts.checks, counts.wrong), (180, 0), "{counts:?}");
    assert!((counts.false_alarms as f64) < 0.07 * counts.checks as f64, "{counts:?}");
    assert!(counts.found as f64 > 0.9 * counts.turned as f64, "{counts:?}");
    // Two electrodes that are as strong cannot be told apart; hardly any swap may pass for something else.
    assert!(counts.named as f64 > 0.65 * counts.swapped as f64, "{counts:?}");
    assert!((counts.mistaken as f64) < 0.01 * counts.swapped as f64, "{counts:?}");
}
