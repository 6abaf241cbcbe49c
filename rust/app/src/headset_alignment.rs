//! A calibrated headset in a trial: where the room is in the world that its wearer sees, corrected while the head is seen.

use crate::SavedCalibration;
use nalgebra::UnitQuaternion;
use proact_localization::{
    DriftCorrection, DriftState, HeadsetCalibration, PosePair, TimedPose, calibrate_headset_from_one_pair,
    pair_streams,
};
use proact_types::{Pose, Vector};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// A headset's calibration with the body that its markers are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeadsetMarkerCalibration {
    /// Name of the marker body on the headset.
    pub markers: String,
    /// Where it sits, and what else was found.
    pub headset: HeadsetCalibration,
}

/// Pairs whose mean is where the room is at first: a second and a half of a headset at 60 Hz, less what is hidden.
const ANCHOR_PAIRS: usize = 60;
/// Head poses that wait for the markers of their time, and markers, s.
const KEPT_SECS: f64 = 2.0;

/// The link between the headset's world and the room.
pub struct HeadsetAlignment {
    calibration: HeadsetMarkerCalibration,
    heads: VecDeque<TimedPose>,
    paired_until: f64,
    anchor_pairs: Vec<PosePair>,
    drift: Option<DriftCorrection>,
    /// Where the room was taken to be at first.
    anchor_pose: Pose,
    state: DriftState,
}

impl HeadsetAlignment {
    /// A headset that has not been seen yet.
    pub fn new(saved: &SavedCalibration<HeadsetMarkerCalibration>) -> Self {
        Self {
            calibration: saved.calibration.clone(),
            heads: VecDeque::new(),
            paired_until: f64::NEG_INFINITY,
            anchor_pairs: Vec::new(),
            drift: None,
            anchor_pose: Pose::identity(),
            state: DriftState::Ignored,
        }
    }

    /// Another trial begins: the wearer may have placed the world anew.
    pub fn restart(&mut self) {
        (self.heads, self.anchor_pairs, self.drift) = (VecDeque::new(), Vec::new(), None);
    }

    /// Name of the marker body.
    pub fn markers(&self) -> &str {
        &self.calibration.markers
    }

    /// The head as the headset tracks it now, and the newest poses of the markers.
    pub fn push_poses(&mut self, now_secs: f64, head: Pose, markers: &[TimedPose]) {
        if self.heads.back().is_some_and(|last| last.pose == head) {
            return;
        }
        self.heads.push_back(TimedPose { stamp_secs: now_secs, pose: head });
        while self.heads.front().is_some_and(|first| first.stamp_secs < now_secs - KEPT_SECS) {
            self.heads.pop_front();
        }
        let offset = self.calibration.headset.clock_offset_secs;
        let pairs = pair_streams(self.heads.make_contiguous(), markers, offset);
        for pair in pairs {
            if pair.stamp_secs > self.paired_until {
                self.paired_until = pair.stamp_secs;
                self.pair(pair);
            }
        }
        let done = self.paired_until;
        self.heads.retain(|head| head.stamp_secs > done || head.stamp_secs == now_secs);
    }

    fn pair(&mut self, pair: PosePair) {
        let Some(drift) = &mut self.drift else {
            self.anchor_pairs.push(pair);
            if self.anchor_pairs.len() == ANCHOR_PAIRS {
                let (world_from_tracking, head_position) = self.compute_anchor();
                let calibration = HeadsetCalibration {
                    headset_world_from_tracking: world_from_tracking,
                    head_position,
                    ..self.calibration.headset.clone()
                };
                self.drift = Some(DriftCorrection::new(&calibration));
                self.anchor_pose = world_from_tracking;
                self.state = DriftState::Corrected;
            }
            return;
        };
        self.state = drift.update(pair.stamp_secs, &pair.head, &pair.markers);
    }

    /// Mean of where the first pairs have the room, and of the markers' places, which that mean turns about.
    fn compute_anchor(&self) -> (Pose, Vector) {
        let x = &self.calibration.headset.head_from_markers;
        let count = self.anchor_pairs.len() as f64;
        let position =
            self.anchor_pairs.iter().map(|pair| pair.markers.translation.vector).sum::<Vector>() / count;
        let alignments: Vec<Pose> = self
            .anchor_pairs
            .iter()
            .map(|pair| calibrate_headset_from_one_pair(x, &pair.head, &pair.markers))
            .collect();
        let base = alignments[0].rotation;
        let turn = alignments
            .iter()
            .map(|world_from_tracking| (world_from_tracking.rotation * base.inverse()).scaled_axis())
            .sum::<Vector>()
            / count;
        let rotation = UnitQuaternion::from_scaled_axis(turn) * base;
        let image = alignments
            .iter()
            .map(|world_from_tracking| {
                world_from_tracking.translation.vector + world_from_tracking.rotation * position
            })
            .sum::<Vector>()
            / count;
        (Pose::from_parts((image - rotation * position).into(), rotation), position)
    }

    /// `world_from_tracking` as the wearer sees the world; none before enough was seen.
    pub fn world_from_tracking(&self) -> Option<Pose> {
        self.drift.as_ref().map(DriftCorrection::headset_world_from_tracking)
    }

    /// How it stands, in words; `placed` is where the box was placed for.
    pub fn status_line(&self, placed: Option<&Pose>) -> String {
        let Some(world_from_tracking) = self.world_from_tracking() else {
            return format!(
                "waits for the head: {} of {ANCHOR_PAIRS} moments in which headset and markers were seen",
                self.anchor_pairs.len()
            );
        };
        let difference = |other: &Pose| {
            let head_position = self.calibration.headset.head_position;
            let (is, was) = (
                world_from_tracking * nalgebra::Point3::from(head_position),
                other * nalgebra::Point3::from(head_position),
            );
            format!(
                "{:.0} mm, {:.1} deg",
                1e3 * (is - was).norm(),
                world_from_tracking.rotation.angle_to(&other.rotation).to_degrees()
            )
        };
        let since = difference(&self.anchor_pose);
        let state = match self.state {
            DriftState::Corrected => "followed",
            DriftState::Ignored => "doubtful at this moment",
            DriftState::Lost => {
                "lost: the markers slipped on the headset, or it found another place in the room; restart the trial, and calibrate \
                 anew if that does not help"
            }
        };
        let from_box = placed.map_or(String::new(), |placed| {
            format!("; the box is seen {} from where it was placed", difference(placed))
        });
        format!("{state}; moved by {since} since the trial began{from_box}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CalibrationSource;
    use proact_localization::{HeadsetCalibrationOptions, calibrate_headset};

    fn pose(position: Vector, turn: Vector) -> Pose {
        Pose::from_parts(position.into(), UnitQuaternion::from_scaled_axis(turn))
    }

    fn markers(t: f64) -> Pose {
        let turn = Vector::new(0.15 * (0.9 * t).sin(), 0.25 * (1.3 * t + 1.0).sin(), 0.35 * (0.7 * t).sin());
        pose(Vector::new(0.4, 0.9, 1.6), turn) * Pose::translation(0.08, 0.0, 0.15)
    }

    #[test]
    fn the_room_is_found_where_the_wearer_placed_the_world_and_followed_when_that_drifts() {
        let x = pose(Vector::new(0.03, 0.02, 0.08), Vector::zeros());
        let before = pose(Vector::new(1.0, -0.5, 0.2), Vector::z());
        let stream = |pose_at: &dyn Fn(f64) -> Pose| -> Vec<TimedPose> {
            (0..2400)
                .map(|k| f64::from(k) / 60.0)
                .map(|t| TimedPose { stamp_secs: t, pose: pose_at(t) })
                .collect()
        };
        let head = stream(&|t| before * markers(t) * x.inverse());
        let headset =
            calibrate_headset(&head, &stream(&markers), &HeadsetCalibrationOptions::default()).unwrap();
        let calibration = HeadsetMarkerCalibration { markers: "HololensSG".into(), headset };
        let sources = vec![CalibrationSource { file: "minute.csv".into(), hash: String::new() }];
        let saved = SavedCalibration { made_at: "2026-11-25T12:00:00Z".into(), sources, calibration };
        let mut worn = HeadsetAlignment::new(&saved);
        assert!(
            worn.world_from_tracking().is_none() && worn.status_line(None).contains("waits for the head")
        );

        // In the trial the world was placed elsewhere, and drifts by 1 cm in a minute.
        let placed = pose(Vector::new(-0.3, 0.8, 0.0), -Vector::z());
        let drifted = |t: f64| Pose::translation(t * 0.01 / 60.0, 0.0, 0.0) * placed;
        let seen: Vec<TimedPose> = (0..6000)
            .map(|k| f64::from(k) * 0.01)
            .map(|t| TimedPose { stamp_secs: t, pose: markers(t) })
            .collect();
        for k in 0..3480 {
            let t = f64::from(k) / 60.0;
            let now = (t * 100.0) as usize + 2;
            worn.push_poses(t, drifted(t) * markers(t) * x.inverse(), &seen[now.saturating_sub(200)..now]);
        }
        let found = worn.world_from_tracking().unwrap();
        let at = nalgebra::Point3::from(markers(58.0).translation.vector);
        let off = (found * at - drifted(58.0) * at).norm();
        assert!(off < 2e-3 && found.rotation.angle_to(&placed.rotation) < 5e-3, "{off}");
        let line = worn.status_line(Some(&placed));
        assert!(line.starts_with("followed; moved by") && line.contains("the box is seen"), "{line}");
        worn.restart();
        assert!(worn.world_from_tracking().is_none());
    }
}
