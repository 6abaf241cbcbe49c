//! A body whose pose `/tf` tells: one frame seen from another, through as many links as lie between them.

use nalgebra::{Quaternion, Translation3, UnitQuaternion};
use proact_localization::{FrameError, FrameTree, Nanos, RawBodyPose, TransformTime};
use proact_types::Pose;

/// A rotation may be off unit length by this much and is then made unit; what is further off is handed on as it came, to be named.
const NORM_TOLERANCE: f64 = 0.01;
/// Names of frames that an error lists.
const MAX_LISTED_FRAMES: usize = 12;

/// One transform of a message.
#[derive(Clone, Debug, PartialEq)]
pub struct TfLink {
    /// The frame above.
    pub parent: String,
    /// The frame below.
    pub child: String,
    /// Of the message, ns.
    pub stamp: Nanos,
    /// `parent_from_child`, m.
    pub position: [f64; 3],
    /// x, y, z, w.
    pub quaternion: [f64; 4],
}

impl TfLink {
    /// As a pose; none if it is not one.
    fn pose(&self) -> Option<Pose> {
        let [x, y, z, w] = self.quaternion;
        let turn = Quaternion::new(w, x, y, z);
        let finite = self.position.iter().chain(&self.quaternion).all(|value| value.is_finite());
        let is_unit = (turn.norm() - 1.0).abs() <= NORM_TOLERANCE;
        let translation = Translation3::from(self.position);
        (finite && is_unit).then(|| Pose::from_parts(translation, UnitQuaternion::from_quaternion(turn)))
    }

    /// As a pose of a body, as it came.
    fn raw_pose(&self, body: &str, arrival: Nanos) -> RawBodyPose {
        RawBodyPose {
            body: body.to_owned(),
            id: None,
            stamp: self.stamp,
            arrival,
            position: self.position,
            quaternion: self.quaternion,
            tracked: true,
        }
    }
}

/// Follows `body` in `parent`. Frames right below `parent` come along as further bodies, as they are sent.
///
/// What is wrong with a link between the two is handed on under the body's name, for [`proact_localization::PoseStreamCheck`] to name:
/// numbers that are no pose, and a stamp before the newest of the same link.
#[derive(Debug)]
pub struct TfBody {
    parent: String,
    body: String,
    tree: FrameTree,
    published_stamp: Option<Nanos>,
}

impl TfBody {
    /// Nothing is known yet.
    pub fn new(parent: &str, body: &str) -> Self {
        let [parent, body] = [parent, body].map(|name| name.trim_start_matches('/').to_owned());
        Self { parent, body, tree: FrameTree::default(), published_stamp: None }
    }

    /// Takes links of `/tf_static`.
    pub fn add_static(&mut self, links: &[TfLink]) {
        for link in links {
            // What is no pose leaves a gap, which `missing` then names.
            let Some(pose) = link.pose() else { continue };
            let _ = self.tree.set_static_transform(&link.parent, &link.child, pose);
        }
    }

    /// Takes a message of `/tf` that arrived at `arrival`; the poses that follow from it.
    pub fn update(&mut self, links: &[TfLink], arrival: Nanos) -> Vec<RawBodyPose> {
        let mut poses = Vec::new();
        for link in links {
            if link.parent == self.parent && link.child != self.body {
                poses.push(link.raw_pose(&link.child, arrival));
            }
            let newest = self.tree.latest_common_time(&link.parent, &link.child).ok().flatten();
            let goes_back = newest.is_some_and(|newest| link.stamp < newest);
            let taken = link.pose().filter(|_| !goes_back).is_some_and(|pose| {
                self.tree.set_transform(&link.parent, &link.child, link.stamp, pose).is_ok()
            });
            if !taken && self.is_between(&link.child) {
                poses.push(link.raw_pose(&self.body, arrival));
                if goes_back {
                    // The clock of who sends it was set back. The past is of no use.
                    (self.tree, self.published_stamp) = (self.tree.static_only(), None);
                }
            }
        }
        poses.extend(self.pose(arrival));
        poses
    }

    /// Whether the link to `child` is one of those between both frames.
    fn is_between(&self, child: &str) -> bool {
        match self.tree.links(&self.parent, &self.body) {
            Ok(links) => links.contains(&child),
            Err(_) => child == self.body,
        }
    }

    /// The body at the newest time for which every link is known, if that is new.
    fn pose(&mut self, arrival: Nanos) -> Option<RawBodyPose> {
        let stamp = self.tree.latest_common_time(&self.parent, &self.body).ok()??;
        if self.published_stamp.is_some_and(|published| stamp <= published) {
            return None;
        }
        let pose = self.tree.lookup_transform(&self.parent, &self.body, TransformTime::Time(stamp)).ok()?;
        self.published_stamp = Some(stamp);
        Some(RawBodyPose {
            body: self.body.clone(),
            id: None,
            stamp,
            arrival,
            position: pose.translation.vector.into(),
            quaternion: pose.rotation.coords.into(),
            tracked: true,
        })
    }

    /// Why there is no pose, and what to do about it; none if there is one, or will be with the next message.
    pub fn missing(&self) -> Option<String> {
        match self.tree.latest_common_time(&self.parent, &self.body) {
            Ok(Some(_)) => None,
            Ok(None) => Some(format!(
                "frame {:?} is fixed in {:?}: only /tf_static tells of what lies between; name a frame that moves",
                self.body, self.parent
            )),
            Err(error @ FrameError::Unknown { .. }) => {
                let known: Vec<&str> = self.tree.names().into_iter().take(MAX_LISTED_FRAMES).collect();
                Some(match known.is_empty() {
                    true => {
                        format!("{error}: nothing comes on /tf; is the program that publishes it running?")
                    }
                    false => format!("{error}; /tf tells of {}", known.join(", ")),
                })
            }
            Err(error) => Some(error.to_string()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_localization::PoseStreamCheck;
    use proact_types::Vector;

    const MS: Nanos = 1_000_000;

    fn link(parent: &str, child: &str, stamp: Nanos, x: f64) -> TfLink {
        let [parent, child] = [parent, child].map(str::to_owned);
        TfLink { parent, child, stamp, position: [x, 0.0, 1.0], quaternion: [0.0, 0.0, 0.6, 0.8] }
    }

    /// The names of what is wrong with `poses`, of the body alone.
    fn faults(check: &mut PoseStreamCheck, poses: &[RawBodyPose]) -> Vec<&'static str> {
        let own = poses.iter().filter(|pose| pose.body == "pad");
        own.filter_map(|pose| check.check(pose).err().map(|fault| fault.name())).collect()
    }

    #[test]
    fn a_body_is_found_through_moving_and_fixed_links_once_for_each_time_that_all_are_known() {
        let mut body = TfBody::new("room", "/pad");
        assert!(body.missing().unwrap().contains("nothing comes on /tf"));
        assert_eq!(body.update(&[link("room", "board", 0, 2.0)], 0).len(), 1, "the board alone");
        assert!(body.missing().unwrap().contains("there is no frame \"pad\"; /tf tells of board, room"));
        body.add_static(&[link("holder", "pad", 0, 0.1)]);
        let missing = body.missing().unwrap();
        assert!(missing.contains("two trees"), "{missing}");
        let poses = body.update(&[link("board", "holder", 0, 0.5)], 7);
        let [pose] = &poses[..] else { panic!("{poses:?}") };
        assert_eq!((pose.body.as_str(), pose.stamp, pose.arrival), ("pad", 0, 7));
        let turned = UnitQuaternion::from_quaternion(Quaternion::new(0.8, 0.0, 0.0, 0.6));
        let step = |x: f64| Pose::from_parts(Vector::new(x, 0.0, 1.0).into(), turned);
        let expected = (step(2.0) * step(0.5) * step(0.1)).translation.vector;
        assert!((Vector::from(pose.position) - expected).norm() < 1e-12);
        assert_eq!(body.missing(), None);
        // The other link is not known yet at the new time.
        assert!(body.update(&[link("board", "holder", 10 * MS, 0.6)], 8).is_empty());
        let poses = body.update(&[link("room", "board", 10 * MS, 2.1)], 9);
        assert_eq!(poses.iter().map(|pose| pose.body.as_str()).collect::<Vec<_>>(), ["board", "pad"]);
    }

    #[test]
    fn what_is_wrong_with_a_link_is_named_and_a_clock_that_was_set_back_begins_anew() {
        let (mut body, mut check) = (TfBody::new("room", "pad"), PoseStreamCheck::new());
        let bad = |quaternion| vec![TfLink { quaternion, ..link("room", "pad", 0, 0.0) }];
        assert_eq!(faults(&mut check, &body.update(&bad([0.0; 4]), 0)), ["no_rotation"]);
        assert_eq!(faults(&mut check, &body.update(&bad([f64::NAN, 0.0, 0.0, 1.0]), 0)), ["not_finite"]);
        assert!(faults(&mut check, &body.update(&[link("room", "pad", 100 * MS, 0.0)], 0)).is_empty());
        assert_eq!(faults(&mut check, &body.update(&[link("room", "pad", 50 * MS, 0.0)], 0)), ["time_back"]);
        // From there on it goes on.
        let poses = body.update(&[link("room", "pad", 60 * MS, 0.3)], 0);
        assert_eq!(poses.iter().map(|pose| pose.stamp).collect::<Vec<_>>(), [60 * MS]);
        // What is wrong elsewhere concerns nobody here.
        let elsewhere = [TfLink { quaternion: [0.0; 4], ..link("hall", "door", 0, 0.0) }];
        assert!(body.update(&elsewhere, 0).is_empty());
        let mut fixed = TfBody::new("room", "pad");
        fixed.add_static(&[link("room", "pad", 0, 0.0)]);
        assert!(fixed.missing().unwrap().contains("is fixed in \"room\""));
    }
}
