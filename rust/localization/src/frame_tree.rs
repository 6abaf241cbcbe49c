//! Frames by name, and the way from one to another at a time.

use proact_types::Pose;
use std::collections::{BTreeMap, BTreeSet, VecDeque};

/// A time stamp, nanoseconds from an epoch that all frames share.
pub type Nanos = i64;

/// So far back a moving frame is remembered from its newest pose, ns: ten seconds, as tf2 does.
const HISTORY_NS: Nanos = 10_000_000_000;
/// Poses of one edge at most: 10 s at 1 kHz. Beyond, the oldest go.
const MAX_POSES: usize = 10_000;
/// Frames at most: a fault that makes up names does not fill the memory.
const MAX_FRAMES: usize = 4096;
/// A rotation may be off unit length by this much.
const UNIT_TOLERANCE: f64 = 1e-6;

/// When a transform is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TransformTime {
    /// The newest time at which every moving frame on the way is known.
    Latest,
    /// This time. Between two poses is interpolated; before the first and after the last there is none.
    Time(Nanos),
}

/// Why a frame is not taken, or a transform not known.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FrameError {
    /// A name that is empty, or the same twice.
    #[error("frame {child:?} in {parent:?}: expected two different names")]
    Name {
        /// As given.
        parent: String,
        /// As given.
        child: String,
    },
    /// A pose with NaN or infinity, or a rotation that is none.
    #[error("frame {child:?}: the pose is not finite, or its rotation not of unit length")]
    Pose {
        /// Whose.
        child: String,
    },
    /// The frame would be above itself.
    #[error("frame {child:?} in {parent:?} would close a loop: {parent:?} is in {child:?} already")]
    Loop {
        /// As given.
        parent: String,
        /// As given.
        child: String,
    },
    /// Too many frames.
    #[error("more than {MAX_FRAMES} frames: {child:?} is not taken")]
    Full {
        /// The one too many.
        child: String,
    },
    /// Nobody has told of it.
    #[error("there is no frame {name:?}")]
    Unknown {
        /// As asked for.
        name: String,
    },
    /// Both are known, and nothing joins them.
    #[error("frames {from:?} and {to:?} are in two trees: nothing joins {from_root:?} and {to_root:?}")]
    NotConnected {
        /// As asked for.
        from: String,
        /// The top of its tree.
        from_root: String,
        /// As asked for.
        to: String,
        /// The top of its tree.
        to_root: String,
    },
    /// An edge is not known at the time.
    #[error(
        "frame {child:?} in {parent:?} is known from {first_secs:.3} s to {last_secs:.3} s, and asked for at {requested_secs:.3} s"
    )]
    Time {
        /// The edge's upper frame.
        parent: String,
        /// The edge's lower frame.
        child: String,
        /// Stamp of its oldest pose, s.
        first_secs: f64,
        /// Stamp of its newest pose, s.
        last_secs: f64,
        /// s.
        requested_secs: f64,
    },
}

/// One frame in its parent: `parent_from_child`.
#[derive(Clone, Debug)]
struct Edge {
    parent: String,
    poses: Poses,
}

#[derive(Clone, Debug)]
enum Poses {
    Fixed(Pose),
    /// By stamp, oldest first.
    Moving(VecDeque<(Nanos, Pose)>),
}

/// Named frames, each in one parent, still or moving. Agrees with tf2 where both answer. A frame that gets another parent
/// forgets the poses in the one before, and a step of more than ten seconds back in time begins anew, where tf2 keeps
/// what has become of the past.
///
/// ```
/// use proact_localization::{TransformTime, FrameTree};
/// let tree = FrameTree::default();
/// assert_eq!(tree.lookup_transform("world", "head", TransformTime::Latest).unwrap_err().to_string(), "there is no frame \"world\"");
/// ```
#[derive(Clone, Debug, Default)]
pub struct FrameTree {
    /// By the child's name.
    edges: BTreeMap<String, Edge>,
}

impl FrameTree {
    /// Tells of a frame that does not move. The newest word counts.
    ///
    /// # Errors
    /// Names, a pose or a loop that cannot be; nothing is changed then.
    pub fn set_static_transform(
        &mut self,
        parent: &str,
        child: &str,
        parent_from_child: Pose,
    ) -> Result<(), FrameError> {
        self.check(parent, child, &parent_from_child)?;
        self.join(parent, child, Poses::Fixed(parent_from_child));
        Ok(())
    }

    /// Tells of a frame that moves: where it was at `stamp`. A second pose of the same stamp is passed over.
    ///
    /// # Errors
    /// As [`FrameTree::set_static_transform`].
    pub fn set_transform(
        &mut self,
        parent: &str,
        child: &str,
        stamp: Nanos,
        parent_from_child: Pose,
    ) -> Result<(), FrameError> {
        self.check(parent, child, &parent_from_child)?;
        let known = self.edges.get_mut(child).filter(|edge| edge.parent == parent);
        let Some(Edge { poses: Poses::Moving(poses), .. }) = known else {
            self.join(parent, child, Poses::Moving(VecDeque::from([(stamp, parent_from_child)])));
            return Ok(());
        };
        let newest = poses.back().map_or(stamp, |(newest, _)| *newest);
        if stamp < newest.saturating_sub(HISTORY_NS) {
            // A clock that was set back, or a simulator that was started again.
            poses.clear();
        }
        let at = poses.partition_point(|(before, _)| *before < stamp);
        if poses.get(at).is_none_or(|(same, _)| *same != stamp) {
            poses.insert(at, (stamp, parent_from_child));
        }
        let oldest = poses.back().map_or(stamp, |(newest, _)| newest.saturating_sub(HISTORY_NS));
        while poses.len() > MAX_POSES || poses.front().is_some_and(|(first, _)| *first < oldest) {
            poses.pop_front();
        }
        Ok(())
    }

    /// `target_from_source`: takes coordinates in `source` to coordinates in `target`.
    ///
    /// # Errors
    /// A frame nobody told of, two trees, or a link that is not known at the time, by its name.
    pub fn lookup_transform(
        &self,
        target: &str,
        source: &str,
        at: TransformTime,
    ) -> Result<Pose, FrameError> {
        let (down, up) = self.path_via_common_ancestor(target, source)?;
        let stamp = match at {
            TransformTime::Time(stamp) => stamp,
            TransformTime::Latest => self.latest_common_time_of(down.iter().chain(&up)).unwrap_or_default(),
        };
        let through = |children: &[&str]| {
            children.iter().try_fold(Pose::identity(), |below, child| Ok(self.edge(child, stamp)? * below))
        };
        Ok(through(&down)?.inverse() * through(&up)?)
    }

    /// Stamp of the oldest among the newest poses of the moving frames between the two; none if nothing moves there.
    ///
    /// # Errors
    /// As [`FrameTree::lookup_transform`].
    pub fn latest_common_time(&self, target: &str, source: &str) -> Result<Option<Nanos>, FrameError> {
        let (down, up) = self.path_via_common_ancestor(target, source)?;
        Ok(self.latest_common_time_of(down.iter().chain(&up)))
    }

    /// The links between the two, by the names of their lower frames.
    ///
    /// # Errors
    /// As [`FrameTree::lookup_transform`].
    pub fn links<'a>(&'a self, target: &'a str, source: &'a str) -> Result<Vec<&'a str>, FrameError> {
        let (mut down, up) = self.path_via_common_ancestor(target, source)?;
        down.extend(up);
        Ok(down)
    }

    /// The names of all frames, in alphabetical order.
    pub fn names(&self) -> BTreeSet<&str> {
        self.edges.iter().flat_map(|(child, edge)| [child.as_str(), edge.parent.as_str()]).collect()
    }

    /// The frames that do not move alone.
    pub fn static_only(&self) -> Self {
        let still = |edge: &Edge| matches!(edge.poses, Poses::Fixed(_));
        let edges = self.edges.iter().filter(|(_, edge)| still(edge));
        Self { edges: edges.map(|(child, edge)| (child.clone(), edge.clone())).collect() }
    }

    fn latest_common_time_of<'a>(&self, children: impl Iterator<Item = &'a &'a str>) -> Option<Nanos> {
        let newest = |child: &&str| match &self.edges.get(*child)?.poses {
            Poses::Moving(poses) => poses.back().map(|(stamp, _)| *stamp),
            Poses::Fixed(_) => None,
        };
        children.filter_map(newest).min()
    }

    fn check(&self, parent: &str, child: &str, pose: &Pose) -> Result<(), FrameError> {
        let names = || (parent.to_owned(), child.to_owned());
        if parent.is_empty() || child.is_empty() || parent == child {
            let (parent, child) = names();
            return Err(FrameError::Name { parent, child });
        }
        let finite = pose.translation.vector.iter().chain(pose.rotation.coords.iter()).all(|v| v.is_finite());
        if !finite || (pose.rotation.coords.norm() - 1.0).abs() > UNIT_TOLERANCE {
            return Err(FrameError::Pose { child: child.to_owned() });
        }
        if !self.edges.contains_key(child) && self.edges.len() >= MAX_FRAMES {
            return Err(FrameError::Full { child: child.to_owned() });
        }
        let known = self.edges.get(child).is_some_and(|edge| edge.parent == parent);
        if !known && self.ancestors(parent).any(|name| name == child) {
            let (parent, child) = names();
            return Err(FrameError::Loop { parent, child });
        }
        Ok(())
    }

    fn join(&mut self, parent: &str, child: &str, poses: Poses) {
        self.edges.insert(child.to_owned(), Edge { parent: parent.to_owned(), poses });
    }

    /// A frame and those above it, up to the top.
    fn ancestors<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a str> {
        std::iter::successors(Some(name), |name| self.edges.get(*name).map(|edge| edge.parent.as_str()))
    }

    fn is_known(&self, name: &str) -> bool {
        self.edges.contains_key(name) || self.edges.values().any(|edge| edge.parent == name)
    }

    /// The edges from each of the two up to the frame that both are in, by their children.
    fn path_via_common_ancestor<'a>(
        &'a self,
        target: &'a str,
        source: &'a str,
    ) -> Result<(Vec<&'a str>, Vec<&'a str>), FrameError> {
        if let Some(name) = [target, source].into_iter().find(|name| !self.is_known(name)) {
            return Err(FrameError::Unknown { name: name.to_owned() });
        }
        let (mut down, mut up): (Vec<&str>, Vec<&str>) =
            (self.ancestors(target).collect(), self.ancestors(source).collect());
        let tops = (down.pop(), up.pop());
        if let (Some(to_root), Some(from_root)) = tops
            && to_root != from_root
        {
            let [from, from_root, to, to_root] = [source, from_root, target, to_root].map(str::to_owned);
            return Err(FrameError::NotConnected { from, from_root, to, to_root });
        }
        while down.last().is_some_and(|last| up.last() == Some(last)) {
            down.pop();
            up.pop();
        }
        Ok((down, up))
    }

    /// `parent_from_child` at a time.
    fn edge(&self, child: &str, stamp: Nanos) -> Result<Pose, FrameError> {
        let unknown = || FrameError::Unknown { name: child.to_owned() };
        let edge = self.edges.get(child).ok_or_else(unknown)?;
        let poses = match &edge.poses {
            Poses::Fixed(pose) => return Ok(*pose),
            Poses::Moving(poses) => poses,
        };
        let at = poses.partition_point(|(before, _)| *before < stamp);
        match (at.checked_sub(1).and_then(|k| poses.get(k)), poses.get(at)) {
            (_, Some((same, pose))) if *same == stamp => Ok(*pose),
            (Some((before, a)), Some((after, b))) => {
                let share = (stamp - before) as f64 / (after - before) as f64;
                // Only half a turn from each other they have no way between them.
                Ok(a.try_lerp_slerp(b, share, 1e-9).unwrap_or(*a))
            }
            _ => {
                let secs = |stamp: Nanos| stamp as f64 * 1e-9;
                let ends = [poses.front(), poses.back()].map(|end| end.map_or(0.0, |(at, _)| secs(*at)));
                Err(FrameError::Time {
                    parent: edge.parent.clone(),
                    child: child.to_owned(),
                    first_secs: ends[0],
                    last_secs: ends[1],
                    requested_secs: secs(stamp),
                })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Translation3, UnitQuaternion, Vector3};
    use proptest::prelude::*;

    const SEC: Nanos = 1_000_000_000;

    fn at(x: f64) -> Pose {
        Pose::translation(x, 0.0, 0.0)
    }

    fn x_of(pose: &Pose) -> f64 {
        pose.translation.x
    }

    fn pose() -> impl Strategy<Value = Pose> {
        let three = || [-2.0..2.0_f64, -2.0..2.0, -2.0..2.0];
        (three(), three()).prop_map(|(t, r)| {
            Pose::from_parts(
                Translation3::new(t[0], t[1], t[2]),
                UnitQuaternion::from_scaled_axis(Vector3::from(r)),
            )
        })
    }

    proptest! {
        /// Each frame in one of those before it: the way between any two is the product of what leads to them.
        #[test]
        fn any_frame_is_found_from_any_other(
            edges in prop::collection::vec((any::<prop::sample::Index>(), pose(), any::<bool>()), 1..20),
            pick in (any::<prop::sample::Index>(), any::<prop::sample::Index>()),
        ) {
            let mut tree = FrameTree::default();
            let mut root_from = vec![Pose::identity()];
            for (k, (parent, parent_from_child, moves)) in edges.iter().enumerate() {
                let parent = parent.index(k + 1);
                let (above, name) = (format!("f{parent}"), format!("f{}", k + 1));
                if *moves {
                    tree.set_transform(&above, &name, 5 * SEC, *parent_from_child).unwrap();
                } else {
                    tree.set_static_transform(&above, &name, *parent_from_child).unwrap();
                }
                root_from.push(root_from[parent] * parent_from_child);
            }
            let (a, b) = (pick.0.index(root_from.len()), pick.1.index(root_from.len()));
            let found = tree.lookup_transform(&format!("f{a}"), &format!("f{b}"), TransformTime::Latest).unwrap();
            let off = (root_from[a].inverse() * root_from[b]).inverse() * found;
            prop_assert!(off.translation.vector.norm() < 1e-9 && off.rotation.angle() < 1e-6);
        }
    }

    #[test]
    fn between_two_poses_is_interpolated_and_beyond_them_there_is_none() {
        let mut tree = FrameTree::default();
        // In another order than that of their times.
        for secs in [3, 1, 2] {
            let turn = UnitQuaternion::from_euler_angles(0.0, 0.0, 0.4 * secs as f64);
            let there = Pose::from_parts(Translation3::new(secs as f64, 0.0, 0.0), turn);
            tree.set_transform("world", "hand", secs * SEC, there).unwrap();
        }
        let half = tree.lookup_transform("world", "hand", TransformTime::Time(5 * SEC / 2)).unwrap();
        assert!((x_of(&half) - 2.5).abs() < 1e-12 && (half.rotation.angle() - 1.0).abs() < 1e-12);
        assert_eq!(x_of(&tree.lookup_transform("world", "hand", TransformTime::Latest).unwrap()), 3.0);
        assert_eq!(x_of(&tree.lookup_transform("world", "hand", TransformTime::Time(SEC)).unwrap()), 1.0);
        for outside in [SEC - 1, 3 * SEC + 1] {
            let error = tree.lookup_transform("world", "hand", TransformTime::Time(outside)).unwrap_err();
            assert!(
                error.to_string().starts_with("frame \"hand\" in \"world\" is known from 1.000 s to 3.000 s")
            );
        }
    }

    #[test]
    fn newest_is_the_newest_time_that_all_moving_links_know() {
        let mut tree = FrameTree::default();
        tree.set_static_transform("world", "table", at(10.0)).unwrap();
        for secs in 0..=4 {
            tree.set_transform("table", "head", secs * SEC, at(secs as f64)).unwrap();
        }
        for secs in 0..=2 {
            tree.set_transform("head", "eye", secs * SEC, at(100.0 * secs as f64)).unwrap();
        }
        assert_eq!(
            x_of(&tree.lookup_transform("world", "eye", TransformTime::Latest).unwrap()),
            10.0 + 2.0 + 200.0
        );
        assert_eq!(tree.latest_common_time("world", "eye"), Ok(Some(2 * SEC)));
        assert_eq!(tree.latest_common_time("world", "head"), Ok(Some(4 * SEC)));
        assert_eq!(tree.latest_common_time("world", "table"), Ok(None));
    }

    #[test]
    fn what_is_missing_is_named() {
        let mut tree = FrameTree::default();
        tree.set_static_transform("world", "table", at(1.0)).unwrap();
        tree.set_static_transform("mocap", "pad", at(1.0)).unwrap();
        let unknown = FrameError::Unknown { name: "hat".to_owned() };
        assert_eq!(tree.lookup_transform("world", "hat", TransformTime::Latest), Err(unknown.clone()));
        assert_eq!(tree.lookup_transform("hat", "hat", TransformTime::Latest), Err(unknown));
        let error = tree.lookup_transform("table", "pad", TransformTime::Latest).unwrap_err();
        assert_eq!(
            error.to_string(),
            "frames \"pad\" and \"table\" are in two trees: nothing joins \"mocap\" and \"world\""
        );
        assert_eq!(
            tree.lookup_transform("world", "world", TransformTime::Latest),
            Ok(Pose::identity()),
            "a top is known too"
        );
    }

    #[test]
    fn what_cannot_be_is_refused_and_changes_nothing() {
        let mut tree = FrameTree::default();
        tree.set_static_transform("world", "a", at(1.0)).unwrap();
        tree.set_static_transform("a", "b", at(1.0)).unwrap();
        assert!(matches!(tree.set_static_transform("b", "world", at(1.0)), Err(FrameError::Loop { .. })));
        assert!(matches!(tree.set_transform("b", "a", 0, at(1.0)), Err(FrameError::Loop { .. })));
        assert!(matches!(tree.set_static_transform("b", "b", at(1.0)), Err(FrameError::Name { .. })));
        assert!(matches!(tree.set_static_transform("", "c", at(1.0)), Err(FrameError::Name { .. })));
        assert!(matches!(tree.set_static_transform("b", "c", at(f64::NAN)), Err(FrameError::Pose { .. })));
        let long = UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(1.1, 0.0, 0.0, 0.0));
        let scaled = Pose::from_parts(Translation3::identity(), long);
        assert!(matches!(tree.set_transform("b", "c", 0, scaled), Err(FrameError::Pose { .. })));
        assert_eq!(x_of(&tree.lookup_transform("world", "b", TransformTime::Latest).unwrap()), 2.0);
        assert!(matches!(
            tree.lookup_transform("world", "c", TransformTime::Latest),
            Err(FrameError::Unknown { .. })
        ));
    }

    #[test]
    fn a_frame_moves_to_another_parent_and_a_clock_back_to_its_start() {
        let mut tree = FrameTree::default();
        tree.set_transform("world", "block", 100 * SEC, at(1.0)).unwrap();
        tree.set_transform("world", "hand", 100 * SEC, at(5.0)).unwrap();
        tree.set_transform("hand", "block", 100 * SEC, at(0.5)).unwrap();
        assert_eq!(x_of(&tree.lookup_transform("world", "block", TransformTime::Latest).unwrap()), 5.5);
        // A simulator that is started again.
        tree.set_transform("world", "hand", SEC, at(7.0)).unwrap();
        assert_eq!(x_of(&tree.lookup_transform("world", "hand", TransformTime::Latest).unwrap()), 7.0);
        assert!(
            tree.lookup_transform("world", "block", TransformTime::Latest).is_err(),
            "its newest pose is of another time"
        );
    }

    #[test]
    fn ten_seconds_are_remembered_and_names_without_end_are_not() {
        let mut tree = FrameTree::default();
        for millis in 0..20_000 {
            tree.set_transform("world", "hand", millis * 1_000_000, at(millis as f64)).unwrap();
        }
        assert!(tree.lookup_transform("world", "hand", TransformTime::Time(10 * SEC)).is_ok());
        assert!(tree.lookup_transform("world", "hand", TransformTime::Time(9 * SEC)).is_err());
        let made_up = |k: usize| format!("ghost{k}");
        let refused =
            (0..2 * MAX_FRAMES).find(|k| tree.set_static_transform("world", &made_up(*k), at(0.0)).is_err());
        assert_eq!(refused, Some(MAX_FRAMES - 1));
        assert!(tree.set_transform("world", "hand", 20 * SEC, at(0.0)).is_ok(), "those that are known go on");
    }
}
