//! A person's own limb, from bodies on upper arm and forearm beside that of the brace.

use crate::TrackedBody;
use nalgebra::UnitQuaternion;
use proact_arm::{LimbFit, LimbFitError};
use proact_testbed::{Session, TestbedError};
use std::str::FromStr;

/// A body of the limb that is older than this is not followed, s.
const STALE_SECS: f64 = 0.25;

/// The bodies of a limb.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LimbBodies {
    /// On the upper arm.
    upper: String,
    /// On the forearm; none where the limb ends above the elbow.
    forearm: Option<String>,
}

impl LimbBodies {
    /// The names.
    pub fn names(&self) -> impl Iterator<Item = &String> {
        std::iter::once(&self.upper).chain(&self.forearm)
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
            [upper] if !upper.is_empty() => Ok(Self { upper: upper.to_owned(), forearm: None }),
            [upper, forearm] if !upper.is_empty() && !forearm.is_empty() && upper != forearm => {
                Ok(Self { upper: upper.to_owned(), forearm: Some(forearm.to_owned()) })
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
    /// The fit, and `base_from_body` of both segments, at the first sight of a trial.
    begun: Option<(LimbFit, [Option<UnitQuaternion<f64>>; 2])>,
    /// Stamps of the poses that were taken last, s.
    taken: [f64; 2],
    line: String,
}

impl TrackedLimb {
    /// A limb that has not been seen yet.
    pub fn new(bodies: LimbBodies) -> Self {
        let line = "not seen yet".to_owned();
        Self { bodies, begun: None, taken: [f64::NEG_INFINITY; 2], line }
    }

    /// Another trial begins: the person holds the limb as the arm is again.
    pub fn restart(&mut self) {
        *self = Self::new(self.bodies.clone());
    }

    /// How it stands, in words.
    pub fn line(&self) -> &str {
        &self.line
    }

    /// Hands the limb's angles to a trial whose base is at `tracking_from_base`. False if not all bodies were seen anew: the
    /// trial sees a silence, which stops the arm.
    ///
    /// # Errors
    /// An arm that has no such segments.
    pub fn drive(
        &mut self,
        session: &mut Session,
        tracking_from_base: &UnitQuaternion<f64>,
        tracked: &TrackedBody,
    ) -> Result<bool, TrackedLimbError> {
        let (mut seen, mut newest) = ([None; 2], self.taken);
        for (k, name) in self.bodies.names().enumerate() {
            let Some(last) = tracked.newest_beside(name, STALE_SECS) else {
                self.line = format!("body {name:?} is not seen");
                return Ok(false);
            };
            seen[k] = Some(tracking_from_base.inverse() * last.pose.rotation);
            newest[k] = last.stamp_secs;
        }
        // Of several bodies one may come before the other; a body that stays away holds all of them up.
        if (0..2).any(|k| seen[k].is_some() && newest[k] <= self.taken[k]) {
            return Ok(false);
        }
        self.taken = newest;
        let (fit, start) = match &mut self.begun {
            Some(begun) => begun,
            none => {
                let testbed = session.testbed();
                let count = testbed.model().arm_count();
                let fit = LimbFit::new(testbed.model(), &testbed.plant().state().position[..count])?;
                none.insert((fit, seen))
            }
        };
        let turns = [0, 1].map(|k| Some(seen[k]? * start[k]?.inverse()));
        let angles = fit.follow(turns);
        session.person().track_limb(angles)?;
        let names: Vec<&str> = self.bodies.names().map(String::as_str).collect();
        self.line = format!("{} followed, within {:.0} deg", names.join(" and "), fit.gap_rad().to_degrees());
        Ok(true)
    }
}
