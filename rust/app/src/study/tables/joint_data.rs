//! A trial's joints in the layout of ArmSym's file `Joint_Data.csv`: 90 rows a second, with tabs between the columns.

use crate::{recompute_record, replay::ReplayOptions};
use proact_arm::JointKind;
use proact_control::MethodRegistry;
use proact_testbed::Testbed;
use proact_types::{Command, Number, Point, Pose};
use std::{error::Error, fmt::Write, path::Path};

/// Rows a second.
const RATE_HZ: u64 = 90;
/// The columns after those of the joints, in ArmSym's order.
const POSE_COLUMNS: [&str; 8] = [
    "x_controller_in_space",
    "y_controller_in_space",
    "z_controller_in_space",
    "x_trackpad",
    "y_trackpad",
    "x_baserobot_in_space",
    "y_baserobot_in_space",
    "z_baserobot_in_space",
];

/// The rows of the trial in `dir`, which is recomputed with `methods`.
///
/// Of joints that an arm has, `th1` and on: degrees from 0 to 360, of what slides metres. Places are in metres in the axes that ArmSym's program has, x to
/// the right, y up, z ahead. In the place of its controller stands the arm's hand, in that of its trackpad 0 and the movement gesture:
/// 1 for WE, -1 for WF.
///
/// # Errors
/// As [`retrace`]; a trial that is not the recorded one any more.
pub(super) fn joint_data(methods: &MethodRegistry, dir: &Path) -> Result<String, Box<dyn Error>> {
    let options =
        ReplayOptions { allow_other_versions: true, methods: methods.clone(), ..ReplayOptions::default() };
    let mut text = String::new();
    let mut row = 0;
    let retraced = recompute_record(dir, &options, |testbed, _| {
        if row == 0 {
            heading(&mut text, testbed.model().arm_count());
        }
        if testbed.now().0 * RATE_HZ >= row * 1000 {
            write_row(&mut text, row, testbed);
            row += 1;
        }
    })?;
    match retraced.divergence {
        Some(_) => {
            Err("recomputed for its joints, the trial is another one (proact replay says where)".into())
        }
        None => Ok(text),
    }
}

fn heading(text: &mut String, joints: usize) {
    text.push_str("Idx\tTime");
    (1..=joints).for_each(|joint| write_formatted(text, format_args!("\tth{joint}")));
    POSE_COLUMNS.iter().for_each(|name| write_formatted(text, format_args!("\t{name}")));
    text.push('\n');
}

fn write_row(text: &mut String, row: u64, testbed: &Testbed) {
    let model = testbed.model();
    let state = testbed.plant().state();
    write_formatted(text, format_args!("{row}\t{:.3}", testbed.now().as_secs()));
    for (&joint, &position) in model.arm.iter().zip(&state.position) {
        // Degrees, and metres of what slides.
        let value = match model.joints[joint].kind {
            JointKind::Prismatic => position,
            _ => position.to_degrees().rem_euclid(360.0),
        };
        write_formatted(text, format_args!("\t{:.4}", Number(value)));
    }
    let base: Pose = state.world_from_base;
    let hand = base * model.link_poses(&state.position)[model.tip];
    place(text, &hand);
    let along = match testbed.command() {
        Command::WristExtension => 1,
        Command::WristFlexion => -1,
        _ => 0,
    };
    write_formatted(text, format_args!("\t0\t{along}"));
    place(text, &base);
    text.push('\n');
}

/// A place in ArmSym's axes.
fn place(text: &mut String, pose: &Pose) {
    let at = Point::from(pose.translation.vector);
    write_formatted(text, format_args!("\t{:.5}\t{:.5}\t{:.5}", Number(-at.y), Number(at.z), Number(at.x)));
}

fn write_formatted(text: &mut String, words: std::fmt::Arguments<'_>) {
    // Memory takes all.
    let _ = text.write_fmt(words);
}
