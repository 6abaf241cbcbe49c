//! The parts of a robot as its file has them: what an import reads, completes and writes as a description.

use crate::finding::{Findings, Severity, joint_location, link_location};
use proact_arm::{Inertial, Visual, VisualGeometry};
use proact_types::{Pose, Vector};

/// A robot; joints index into links. Links may be frames, joints may lack limits, and there may be several trees.
#[derive(Clone, Debug, Default)]
pub(crate) struct RobotParts {
    pub(crate) name: String,
    pub(crate) links: Vec<PartLink>,
    pub(crate) joints: Vec<PartJoint>,
}

/// A link.
#[derive(Clone, Debug)]
pub(crate) struct PartLink {
    pub(crate) name: String,
    /// None if the file gives none, or none that a body can have.
    pub(crate) inertial: Option<Inertial>,
    /// Mass that the file gives where the inertia is missing or cannot be used, kg.
    pub(crate) mass_kg: Option<f64>,
    pub(crate) collisions: Vec<PlacedGeometry>,
    pub(crate) visuals: Vec<Visual>,
}

/// A shape or mesh in a link.
#[derive(Clone, Debug)]
pub(crate) struct PlacedGeometry {
    /// `link_from_shape`.
    pub(crate) pose: Pose,
    pub(crate) geometry: VisualGeometry,
}

/// How a joint moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PartKind {
    Fixed,
    Revolute,
    Continuous,
    Prismatic,
}

/// A joint.
#[derive(Clone, Debug)]
pub(crate) struct PartJoint {
    pub(crate) name: String,
    pub(crate) kind: PartKind,
    pub(crate) parent: usize,
    pub(crate) child: usize,
    /// `parent_from_joint`.
    pub(crate) origin: Pose,
    /// Of length one.
    pub(crate) axis: Vector,
    /// Smallest and largest angle, rad.
    pub(crate) range: Option<[f64; 2]>,
    pub(crate) velocity: Option<f64>,
    pub(crate) effort: Option<f64>,
    pub(crate) damping: f64,
    pub(crate) friction: f64,
    pub(crate) mimic: Option<PartMimic>,
}

/// What a joint follows.
#[derive(Clone, Debug)]
pub(crate) struct PartMimic {
    pub(crate) master: String,
    pub(crate) multiplier: f64,
    pub(crate) offset: f64,
}

impl PartJoint {
    /// A joint that does not move.
    pub(crate) fn fixed(name: String, parent: usize, child: usize, origin: Pose) -> Self {
        Self {
            name,
            kind: PartKind::Fixed,
            parent,
            child,
            origin,
            axis: Vector::x(),
            range: None,
            velocity: None,
            effort: None,
            damping: 0.0,
            friction: 0.0,
            mimic: None,
        }
    }
}

impl PartKind {
    pub(crate) fn moves(self) -> bool {
        self != Self::Fixed
    }
}

impl RobotParts {
    /// The joint that carries each link; none for a root.
    pub(crate) fn carriers(&self) -> Vec<Option<usize>> {
        let mut carriers = vec![None; self.links.len()];
        for (index, joint) in self.joints.iter().enumerate() {
            carriers[joint.child] = Some(index);
        }
        carriers
    }

    /// Links in an order in which parents come first, from `root`.
    pub(crate) fn below(&self, root: usize) -> Vec<usize> {
        let mut found = vec![root];
        let mut next = 0;
        while let Some(&link) = found.get(next) {
            next += 1;
            // A loop would go on for ever.
            let children = self.joints.iter().filter(|joint| joint.parent == link).map(|joint| joint.child);
            let new: Vec<usize> = children.filter(|child| !found.contains(child)).collect();
            found.extend(new);
        }
        found
    }

    pub(crate) fn link(&self, name: &str) -> Option<usize> {
        self.links.iter().position(|link| link.name == name)
    }

    /// Keeps the links in `kept`, in that order, and the joints between them.
    pub(crate) fn retain_links(&mut self, kept: &[usize]) {
        let index = |old: usize| kept.iter().position(|&link| link == old);
        let joints = std::mem::take(&mut self.joints);
        self.joints = joints
            .into_iter()
            .filter_map(|joint| {
                Some(PartJoint { parent: index(joint.parent)?, child: index(joint.child)?, ..joint })
            })
            .collect();
        self.links = kept.iter().map(|&link| self.links[link].clone()).collect();
    }
}

/// Notes what an import changed in a link.
pub(crate) fn note_link(
    findings: &mut Findings,
    name: &str,
    problem: &str,
    got: &str,
    expected: &str,
    done: &str,
) {
    findings.add(Severity::Note, link_location(name), problem, got, expected, done);
}

/// Notes what an import changed in a joint.
pub(crate) fn note_joint(
    findings: &mut Findings,
    name: &str,
    problem: &str,
    got: &str,
    expected: &str,
    done: &str,
) {
    findings.add(Severity::Note, joint_location(name), problem, got, expected, done);
}
