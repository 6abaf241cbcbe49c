//! How well a calibration is known, and which movement it lacks.

use crate::{HeadsetCalibrationOptions, PosePair, hand_eye_fit::HandEyeFit};
use nalgebra::{Matrix3, UnitQuaternion};
use proact_types::Vector;
use serde::{Deserialize, Serialize};

/// An axis of the head, with x ahead, y left and z up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HeadAxis {
    /// About x: ear to shoulder.
    Tilt,
    /// About y: yes.
    Nod,
    /// About z: no.
    Turn,
}

impl std::fmt::Display for HeadAxis {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Tilt => "tilt the head to the left and right shoulder",
            Self::Nod => "nod up and down",
            Self::Turn => "turn the head left and right",
        })
    }
}

/// How well a calibration is known, from the curvature of its fit, and what it had to go by.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Observability {
    /// Standard deviation of the markers' place on the headset, m, in its worst direction.
    pub head_from_markers_m: f64,
    /// The same of its attitude, degrees.
    pub head_from_markers_deg: f64,
    /// Standard deviation of the headset's world at the head, m.
    pub headset_world_m: f64,
    /// The same of its attitude, degrees.
    pub headset_world_deg: f64,
    /// Standard deviation of the head's turn about its x, y and z axis (tilt, nod, turn) over the recording, degrees.
    #[serde(rename = "turned_deg")]
    pub head_rotation_sd_deg: [f64; 3],
}

/// A head that turned less than this about an axis, standard deviation in degrees, has hardly done so.
const MIN_ROTATION_SD_DEG: f64 = 3.0;

impl Observability {
    pub(crate) fn from_fit(pairs: &[PosePair], fit: &HandEyeFit) -> Self {
        let worst = |at: usize| {
            let block = fit.covariance.map(|all| all.fixed_view::<3, 3>(at, at).into_owned());
            block.map_or(f64::INFINITY, |block| block.symmetric_eigenvalues().max().max(0.0).sqrt())
        };
        Self {
            head_from_markers_m: worst(3),
            head_from_markers_deg: worst(0).to_degrees(),
            headset_world_m: worst(9),
            headset_world_deg: worst(6).to_degrees(),
            head_rotation_sd_deg: head_rotation_sd_deg(pairs),
        }
    }

    /// The axis about which the head has to turn more; none where all is known well enough.
    pub(crate) fn axis_to_excite(&self, options: &HeadsetCalibrationOptions) -> Option<HeadAxis> {
        let unsure = self.head_from_markers_m > options.max_position_sd_m
            || self.headset_world_m > options.max_position_sd_m
            || self.head_from_markers_deg > options.max_rotation_sd_deg
            || self.headset_world_deg > options.max_rotation_sd_deg;
        let [tilt, nod, turn] = self.head_rotation_sd_deg;
        let (min_rotation, axis) = [(tilt, HeadAxis::Tilt), (nod, HeadAxis::Nod), (turn, HeadAxis::Turn)]
            .into_iter()
            .min_by(|a, b| a.0.total_cmp(&b.0))?;
        (unsure || min_rotation < MIN_ROTATION_SD_DEG / 3.0).then_some(axis)
    }
}

/// Spread of the head's turns about its mean attitude, in the axes of the head.
fn head_rotation_sd_deg(pairs: &[PosePair]) -> [f64; 3] {
    let mut mean = pairs[0].head.rotation;
    // A few steps of the mean on the group; a head stays within half a turn of it.
    let mut turns: Vec<Vector> = Vec::new();
    for _ in 0..5 {
        turns = pairs.iter().map(|pair| (mean.inverse() * pair.head.rotation).scaled_axis()).collect();
        let step = turns.iter().sum::<Vector>() / turns.len() as f64;
        mean *= UnitQuaternion::from_scaled_axis(step);
    }
    let spread = turns.iter().map(|turn| turn * turn.transpose()).sum::<Matrix3<f64>>() / turns.len() as f64;
    [0, 1, 2].map(|k| spread[(k, k)].sqrt().to_degrees())
}
