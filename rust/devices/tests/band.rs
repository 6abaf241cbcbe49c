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
    let tally = band_check::judge(&dir).unwrap();
    println!("{tally:?}");
    assert_eq!((tally.checks, tally.wrong), (180, 0), "{tally:?}");
    assert!((tally.false_alarms as f64) < 0.07 * tally.checks as f64, "{tally:?}");
    assert!(tally.found as f64 > 0.9 * tally.turned as f64, "{tally:?}");
    // Two electrodes that are as strong cannot be told apart; hardly any swap may pass for something else.
    assert!(tally.named as f64 > 0.65 * tally.swapped as f64, "{tally:?}");
    assert!((tally.mistaken as f64) < 0.01 * tally.swapped as f64, "{tally:?}");
}
