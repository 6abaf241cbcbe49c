//! A person's own limb, from bodies on upper arm and forearm, or on the hand, beside that of the brace.

use crate::TrackedBody;
use nalgebra::UnitQuaternion;
use proact_arm::{HandFit, LimbFit, LimbFitError};
use proact_testbed::{RunningTrial, TestbedError};
use proact_types::Pose;
use std::str::FromStr;

/// A body of the limb that is older than this is not followed, s.
const STALE_SECS: f64 = 0.25;

/// The bodies of a limb.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LimbBodies {
    /// On its segments: how those turn gives the joints.
    Segments {
        /// On the upper arm.
        upper: String,
        /// On the forearm; none where the limb ends above the elbow.
        forearm: Option<String>,
    },
    /// On the hand: where it goes gives the joints, by inverse kinematics.
    Hand(String),
}

impl LimbBodies {
    /// The names.
    pub fn names(&self) -> impl Iterator<Item = &String> {
        let (first, second) = match self {
            Self::Segments { upper, forearm } => (upper, forearm.as_ref()),
            Self::Hand(hand) => (hand, None),
        };
        std::iter::once(first).chain(second)
    }
}

/// What stands in the place of the bodies of a limb.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{got:?} names no limb; expected the body on the upper arm, and behind a comma that on the forearm")]
pub struct LimbBodiesError {
    /// As given.
    got: String,
}

impl FromStr for LimbBodies {
    type Err = LimbBodiesError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let names: Vec<&str> = text.split(',').map(str::trim).collect();
        match names[..] {
            [upper] if !upper.is_empty() => Ok(Self::Segments { upper: upper.to_owned(), forearm: None }),
            [upper, forearm] if !upper.is_empty() && !forearm.is_empty() && upper != forearm => {
                Ok(Self::Segments { upper: upper.to_owned(), forearm: Some(forearm.to_owned()) })
            }
            _ => Err(LimbBodiesError { got: text.to_owned() }),
        }
    }
}

/// Why a limb is not followed at all.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrackedLimbError {
    /// The arm.
    #[error(transparent)]
    Arm(#[from] LimbFitError),
    /// The angles.
    #[error(transparent)]
    Angles(#[from] TestbedError),
}

/// The limb as the arm was when it was first seen, and as it moved since.
pub struct TrackedLimb {
    bodies: LimbBodies,
    reference: Option<LimbReference>,
    /// Stamps of the poses that were taken last, s.
    last_stamps_secs: [f64; 2],
    status_line: String,
}

/// What began at the first sight of a trial: the fit, and `base_from_body` of each body then.
enum LimbReference {
    Segments(LimbFit, [Option<UnitQuaternion<f64>>; 2]),
    Hand(HandFit, Pose),
}

impl TrackedLimb {
    /// A limb that has not been seen yet.
    pub fn new(bodies: LimbBodies) -> Self {
        let line = "not seen yet".to_owned();
        Self { bodies, reference: None, last_stamps_secs: [f64::NEG_INFINITY; 2], status_line: line }
    }

    /// Another trial begins: the person holds the limb as the arm is again.
    pub fn restart(&mut self) {
        *self = Self::new(self.bodies.clone());
    }

    /// How it stands, in words.
    pub fn status_line(&self) -> &str {
        &self.status_line
    }

    /// Hands the limb's angles to a trial whose base is at `tracking_from_base`. False if not all bodies were seen anew: the
    /// trial sees a silence, which stops the arm.
    ///
    /// # Errors
    /// An arm that has no such segments.
    pub fn apply_to(
        &mut self,
        trial: &mut RunningTrial,
        tracking_from_base: &Pose,
        tracked: &TrackedBody,
    ) -> Result<bool, TrackedLimbError> {
        let (mut seen, mut newest) = ([None; 2], self.last_stamps_secs);
        for (k, name) in self.bodies.names().enumerate() {
            let Some(last) = tracked.newest_extra_pose(name, STALE_SECS) else {
                self.status_line = format!("body {name:?} is not seen");
                return Ok(false);
            };
            seen[k] = Some(tracking_from_base.inv_mul(&last.pose));
            newest[k] = last.stamp_secs;
        }
        // Of several bodies one may come before the other; a body that stays away holds all of them up.
        if (0..2).any(|k| seen[k].is_some() && newest[k] <= self.last_stamps_secs[k]) {
            return Ok(false);
        }
        self.last_stamps_secs = newest;
        let reference = match &mut self.reference {
            Some(reference) => reference,
            none => none.insert(LimbReference::new(trial, &self.bodies, seen)?),
        };
        let (angles, gap) = reference.solve(seen);
        trial.person_stage_mut().track_limb(angles)?;
        let names: Vec<&str> = self.bodies.names().map(String::as_str).collect();
        self.status_line = format!("{} followed, within {gap}", names.join(" and "));
        Ok(true)
    }
}

impl LimbReference {
    /// The limb is as the arm is now, its bodies where they were `seen`.
    fn new(trial: &RunningTrial, bodies: &LimbBodies, seen: [Option<Pose>; 2]) -> Result<Self, LimbFitError> {
        let testbed = trial.testbed();
        let model = testbed.model();
        let angles = &testbed.plant().state().position[..model.arm_count()];
        Ok(match bodies {
            LimbBodies::Segments { .. } => {
                Self::Segments(LimbFit::new(model, angles)?, seen.map(|pose| pose.map(|pose| pose.rotation)))
            }
            LimbBodies::Hand(_) => Self::Hand(HandFit::new(model, angles), seen[0].unwrap_or_default()),
        })
    }

    /// The angles for bodies that are `seen`, and how far off they stay, in words.
    fn solve(&mut self, seen: [Option<Pose>; 2]) -> (&[f64], String) {
        match self {
            Self::Segments(fit, start) => {
                let turns = [0, 1].map(|k| Some(seen[k]?.rotation * start[k]?.inverse()));
                fit.update(turns);
                (fit.angles(), format!("{:.0} deg", fit.rotation_error_rad().to_degrees()))
            }
            Self::Hand(fit, start) => {
                let now = seen[0].unwrap_or(*start);
                let displacement = now.translation.vector - start.translation.vector;
                fit.update(&displacement, &(now.rotation * start.rotation.inverse()));
                let gap = format!(
                    "{:.0} mm and {:.0} deg",
                    1e3 * fit.position_error_m(),
                    fit.rotation_error_rad().to_degrees()
                );
                (fit.angles(), gap)
            }
        }
    }
}
