//! Where the trunk was in a trial: a file beside its record, from a body that motion capture sees on it.

use proact_recording::RecordingError;
use proact_types::{Pose, SimTime};
use std::{error::Error, fmt::Write, fs, io, path::Path};

/// The file in a trial's directory.
pub const TRUNK_FILE: &str = "trunk.csv";
/// Its first line: seconds since the trial's start, `world_from_trunk` in m and as x, y, z, w.
const CSV_HEADER: &str = "time_s,x,y,z,qx,qy,qz,qw";

/// The text of the file.
pub fn trunk_text(poses: &[(SimTime, Pose)]) -> String {
    let mut text = format!("{CSV_HEADER}\n");
    for (time, pose) in poses {
        // A String takes everything.
        let _ = write!(text, "{}", time.0 as f64 / 1e3);
        for value in pose.translation.vector.iter().chain(pose.rotation.coords.iter()) {
            let _ = write!(text, ",{value}");
        }
        text.push('\n');
    }
    text
}

/// Reads the file in the trial `dir`; nothing where there is none.
///
/// # Errors
/// A file that cannot be read, or a line that is no pose, with its number.
pub fn read_trunk(dir: &Path) -> Result<Vec<(SimTime, Pose)>, Box<dyn Error>> {
    let path = dir.join(TRUNK_FILE);
    let text = match fs::read_to_string(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(format!("{}: {error}", path.display()).into()),
    };
    let mut lines = text.lines().enumerate();
    let wrong =
        |line: usize| format!("{}, line {line}: expected {CSV_HEADER}, a pose a line", path.display());
    if lines.next().map(|(_, line)| line) != Some(CSV_HEADER) {
        let reason = format!("unknown columns, expected {CSV_HEADER}");
        return Err(RecordingError::UnknownKey { file: path, line: 1, reason }.into());
    }
    lines.map(|(k, line)| parse_pose(line).ok_or_else(|| wrong(k + 1).into())).collect()
}

fn parse_pose(line: &str) -> Option<(SimTime, Pose)> {
    let values: Vec<f64> = line.split(',').map(|cell| cell.parse().ok()).collect::<Option<_>>()?;
    let [secs, x, y, z, qx, qy, qz, qw] = values[..] else { return None };
    let turn = nalgebra::Quaternion::new(qw, qx, qy, qz);
    let sane =
        values.iter().all(|value| value.is_finite()) && secs >= 0.0 && (turn.norm() - 1.0).abs() < 1e-3;
    let translation = nalgebra::Translation3::new(x, y, z);
    let turn = nalgebra::UnitQuaternion::from_quaternion(turn);
    sane.then(|| (SimTime((secs * 1e3).round() as u64), Pose::from_parts(translation, turn)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;

    #[test]
    fn what_is_written_is_read_and_a_damaged_line_is_named() {
        let dir = tempfile::tempdir().unwrap();
        assert!(read_trunk(dir.path()).unwrap().is_empty(), "no file");
        let turned = UnitQuaternion::from_euler_angles(0.1, -0.2, 0.3);
        let poses: Vec<(SimTime, Pose)> = (0..3)
            .map(|k| (SimTime(17 * k), Pose::from_parts([0.1 * k as f64, -0.2, 1.2].into(), turned)))
            .collect();
        let path = dir.path().join(TRUNK_FILE);
        fs::write(&path, trunk_text(&poses)).unwrap();
        let read = read_trunk(dir.path()).unwrap();
        for ((time, is), (expected_time, expected)) in read.iter().zip(&poses) {
            assert_eq!(time, expected_time);
            assert!((expected.inverse() * is).translation.vector.norm() < 1e-12);
        }
        assert_eq!(read.len(), 3);
        for wrong in ["1,2,3", "0.1,0,0,0,0,0,0,0", "0.1,0,0,nan,0,0,0,1", "-1,0,0,0,0,0,0,1"] {
            fs::write(&path, format!("{CSV_HEADER}\n0,0,0,0,0,0,0,1\n{wrong}\n")).unwrap();
            let error = read_trunk(dir.path()).unwrap_err().to_string();
            assert!(error.contains("trunk.csv, line 3"), "{error}");
        }
    }
}
