//! Where every frame of the original's tree is, computed from one instant.

use arrayvec::ArrayVec;
use nalgebra::{Translation3, UnitQuaternion};
use proact_arm::{ArmModel, JointKind};
use proact_types::{BodyState, PlantState, Pose, Scene, Vector, zeros};
use std::{
    collections::BTreeSet,
    f64::consts::{FRAC_PI_2, PI, TAU},
};

/// The frame that everything is in.
pub const WORLD: &str = "world";
/// The world of the original's headset, frozen at the calibration: its gaze is in it.
pub const HEADSET_WORLD: &str = "hololens_world_test";
/// Where the hand grips: the middle of a gripped object, z up where the hand stands as the grasp has it.
pub const GRASP_CENTER: &str = "grasp_centre";
/// From the reference board to the box, metres along x (the paper's distance for the second study).
const BOARD_TO_BOX_M: f64 = 0.6;

/// How a frame of the original is told of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameKind {
    /// Once, on `/tf_static`.
    Fixed,
    /// On `/tf`.
    Moving,
    /// On `/tf` while somebody's head is tracked.
    HeadTracked,
    /// Not: the meaning says what there is in its place.
    Absent,
}

/// A frame of the original, beside the arm's links and the objects, which have their own names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OriginalFrame {
    /// The frame that it is in.
    pub parent: &'static str,
    /// Its name.
    pub child: &'static str,
    /// How it is told of.
    pub kind: FrameKind,
    /// What it is.
    pub meaning: &'static str,
}

const fn row(
    parent: &'static str,
    child: &'static str,
    kind: FrameKind,
    meaning: &'static str,
) -> OriginalFrame {
    OriginalFrame { parent, child, kind, meaning }
}

/// The original's tree. `docs/ros1.md` has the same table.
pub const ORIGINAL_FRAMES: [OriginalFrame; 21] = [
    row(
        "optitrack_world",
        "Clipboard",
        FrameKind::Moving,
        "the reference board on the table, as motion capture sees it",
    ),
    row("optitrack_world", "Clipboard_filtered", FrameKind::Moving, "the same, smoothed"),
    row("optitrack_world", "Shoulderpad", FrameKind::Moving, "the medium brace; the arm hangs on it"),
    row(
        "optitrack_world",
        "Shoulderpad_filtered",
        FrameKind::Moving,
        "the same, smoothed: here they are one",
    ),
    row(
        "optitrack_world",
        "ShoulderpadL",
        FrameKind::Moving,
        "the large brace; here it is where the medium one is, so both names work",
    ),
    row("optitrack_world", "HololensSG", FrameKind::HeadTracked, "the markers on the headset; here its eyes"),
    row(
        "optitrack_world",
        "Hololens_filtered",
        FrameKind::HeadTracked,
        "the same, smoothed: here they are one",
    ),
    row("HololensSG", "hololens_unity_camera", FrameKind::HeadTracked, "the eyes of the headset"),
    row(
        "HololensSG",
        "hololens_world_mocap",
        FrameKind::HeadTracked,
        "the origin of the headset's world, corrected with each pose of the head",
    ),
    row("Clipboard_filtered", "tabletag_ros", FrameKind::Fixed, "the board's printed tag, x ahead"),
    row("tabletag_ros", "world", FrameKind::Fixed, "below the middle of the box, on the floor"),
    row("world", "table", FrameKind::Fixed, "the table, turned as the original's mesh"),
    row(
        "world",
        "hololens_world_test",
        FrameKind::Moving,
        "the headset's world, frozen at the calibration: its gaze is in it",
    ),
    row("Shoulderpad", "base_link", FrameKind::Fixed, "the base of the arm"),
    row("world", "hololens_world", FrameKind::Absent, "never published by the original"),
    row(
        "world",
        "pick_goal",
        FrameKind::Absent,
        "the last plan's goal: here in /proact/markers and /move_group/motion_plan_request",
    ),
    row(
        "world",
        "trying_goal",
        FrameKind::Absent,
        "a goal that the planner tried: plans here are of one goal",
    ),
    row(
        "world",
        "target_pose",
        FrameKind::Absent,
        "the place that was chosen: here /place_location_selected",
    ),
    row(
        "Clipboard",
        "virtual_ref",
        FrameKind::Absent,
        "a hologram to align a rig with: proact localize headset needs none",
    ),
    row("virtual_ref", "holoworld", FrameKind::Absent, "the same"),
    row("holoworld", "holohead", FrameKind::Absent, "the same"),
];

/// One frame in another: `parent_from_child`.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Name of the parent.
    pub parent: String,
    /// Name of the child.
    pub child: String,
    /// `parent_from_child`.
    pub pose: Pose,
}

fn frame(parent: &str, child: &str, pose: Pose) -> Frame {
    Frame { parent: parent.to_owned(), child: child.to_owned(), pose }
}

/// An angle brought to (-pi, pi].
pub fn wrap_angle(angle: f64) -> f64 {
    let turned = (angle + PI).rem_euclid(TAU) - PI;
    if turned == -PI { PI } else { turned }
}

/// Frames that never move: the arm's fixed joints, the grasp centre, the table, and the reference board's tag.
///
/// The original's motion capture gives `optitrack_world` with y up. Here it stands over the box's centre on the
/// floor, and the board [`BOARD_TO_BOX_M`] in front of the box at the height of the table.
pub fn fixed(model: &ArmModel, scene: &Scene, links: bool) -> Vec<Frame> {
    let mut frames = Vec::new();
    if links {
        for joint in model.joints.iter().filter(|j| j.kind == JointKind::Fixed) {
            frames.push(frame(&model.links[joint.parent].name, &model.links[joint.child].name, joint.origin));
        }
    }
    let tag = clipboard_from_tag();
    frames.push(frame("Clipboard_filtered", "tabletag_ros", tag));
    frames.push(frame("tabletag_ros", WORLD, Pose::translation(BOARD_TO_BOX_M, 0.0, -scene.table_height)));
    frames.push(frame(WORLD, "table", rotation_from_rpy(0.0, 0.0, FRAC_PI_2)));
    if let Some(base) = model.links.first() {
        frames.push(frame("Shoulderpad", &base.name, Pose::identity()));
    }
    frames.extend(grasp_center(model, scene));
    frames
}

/// [`GRASP_CENTER`] on the link that carries the hand, by the grasp for the widest object of `scene`; none for a model without
/// links.
pub fn grasp_center(model: &ArmModel, scene: &Scene) -> Option<Frame> {
    let widths = scene.objects.iter().map(|object| object.shape.grip_width());
    let grasp = match widths.max_by(f64::total_cmp) {
        Some(width) => model.grasp_for(width),
        None => model.widest_grasp(),
    };
    let upright = UnitQuaternion::from_axis_angle(&Vector::x_axis(), -grasp.roll_rad);
    let tip = model.links.get(model.tip)?;
    Some(frame(&tip.name, GRASP_CENTER, Pose::from_parts(Translation3::from(grasp.center), upright)))
}

/// The original's constant, with pi where it has 3.14.
fn clipboard_from_tag() -> Pose {
    Pose::from_parts(
        Translation3::new(0.038, -0.016, -0.093),
        rotation_from_rpy(PI, -FRAC_PI_2, FRAC_PI_2).rotation,
    )
}

fn rotation_from_rpy(roll: f64, pitch: f64, yaw: f64) -> Pose {
    Pose::from_parts(Translation3::identity(), UnitQuaternion::from_euler_angles(roll, pitch, yaw))
}

/// `optitrack_world` from `world`: y up.
fn optitrack_from_world() -> Pose {
    rotation_from_rpy(-FRAC_PI_2, 0.0, 0.0)
}

/// Frames of one instant: what motion capture tracks, the headset's world, the objects and, with `links`, the arm.
/// `world_from_head` is left out when nobody tracks the head.
pub fn moving(
    model: &ArmModel,
    scene: &Scene,
    state: &PlantState,
    world_from_head: Option<&Pose>,
    links: bool,
) -> Vec<Frame> {
    let tracked = optitrack_from_world();
    let shoulder = tracked * state.world_from_base;
    let board = tracked
        * (clipboard_from_tag() * Pose::translation(BOARD_TO_BOX_M, 0.0, -scene.table_height)).inverse();
    let mut frames = vec![
        frame("optitrack_world", "Clipboard", board),
        frame("optitrack_world", "Clipboard_filtered", board),
        frame("optitrack_world", "Shoulderpad", shoulder),
        frame("optitrack_world", "Shoulderpad_filtered", shoulder),
        frame("optitrack_world", "ShoulderpadL", shoulder),
        // The headset's world is not calibrated against anything here, so it equals the world.
        frame(WORLD, HEADSET_WORLD, Pose::identity()),
    ];
    if let Some(head) = world_from_head {
        frames.push(frame("optitrack_world", "HololensSG", tracked * head));
        frames.push(frame("optitrack_world", "Hololens_filtered", tracked * head));
        frames.push(frame("HololensSG", "hololens_unity_camera", Pose::identity()));
        frames.push(frame("HololensSG", "hololens_world_mocap", head.inverse()));
    }
    for (object, body) in scene.objects.iter().zip(&state.objects) {
        frames.push(frame(WORLD, &object.ros_name, body.pose));
    }
    if links {
        for (index, angle) in model.moving().zip(&state.position) {
            let joint = &model.joints[index];
            let (parent, child) = (&model.links[joint.parent].name, &model.links[joint.child].name);
            frames.push(frame(parent, child, joint.transform_at(*angle)));
        }
    }
    frames
}

/// The child frames that [`fixed_frames`] and [`moving`] tell of, each of which may be left to somebody else.
pub fn names(model: &ArmModel, scene: &Scene) -> BTreeSet<String> {
    let count = model.moving().count();
    let body = BodyState {
        pose: Pose::identity(),
        linear_velocity: Vector::zeros(),
        angular_velocity: Vector::zeros(),
    };
    let anywhere = PlantState {
        position: zeros(count),
        velocity: zeros(count),
        effort: zeros(count),
        limit_effort: zeros(count),
        world_from_base: Pose::identity(),
        base_held: false,
        objects: scene.objects.iter().map(|_| body).collect(),
        attached: None,
        contacts: ArrayVec::new(),
    };
    let moving = moving(model, scene, &anywhere, Some(&Pose::identity()), true);
    fixed(model, scene, true).into_iter().chain(moving).map(|frame| frame.child).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_arm::{Joint, JointLimits, Link};
    use proact_types::{Object, Shape, joints};
    use std::collections::BTreeMap;

    fn model() -> ArmModel {
        let link =
            |name: &str| Link { name: name.into(), inertial: None, collisions: vec![], visuals: vec![] };
        let joint = |child: usize, kind| Joint {
            name: format!("j{child}"),
            kind,
            parent: child - 1,
            child,
            origin: Pose::translation(0.0, 0.0, -0.3),
            axis: Vector::x(),
            limits: JointLimits::default(),
            damping: 0.0,
            friction: 0.0,
        };
        ArmModel {
            name: "arm".into(),
            links: ["base_link", "mount", "upper", "lower"].map(link).into(),
            joints: vec![
                joint(1, JointKind::Fixed),
                joint(2, JointKind::Revolute),
                joint(3, JointKind::Revolute),
            ],
            arm: vec![1, 2],
            hand: vec![],
            tip: 3,
            poses: vec![],
            allowed_collisions: vec![],
            ..Default::default()
        }
    }

    fn scene() -> Scene {
        let names = ["redcylinder1", "redcylinder2", "bluecylinder1", "bluecylinder2"];
        let shape = Shape::Cylinder { radius: 0.025, length: 0.05 };
        let block = |name| Object::with_default_friction(name, shape, 0.1, Pose::identity());
        Scene { objects: names.map(block).to_vec(), table_height: 1.015, ..Scene::default() }
    }

    fn state() -> PlantState {
        let body = |k: usize| BodyState {
            pose: Pose::translation(0.1 * k as f64, 0.2, 1.04),
            linear_velocity: Vector::zeros(),
            angular_velocity: Vector::zeros(),
        };
        PlantState {
            position: joints(&[0.4, -0.7]),
            velocity: zeros(2),
            effort: zeros(2),
            limit_effort: zeros(2),
            world_from_base: Pose::from_parts(
                Translation3::new(-0.39, 0.12, 1.5),
                UnitQuaternion::from_euler_angles(0.1, 0.2, 0.3),
            ),
            base_held: false,
            objects: (0..4).map(body).collect(),
            attached: None,
            contacts: ArrayVec::new(),
        }
    }

    #[test]
    fn the_frames_form_one_tree_and_lead_from_the_world_to_links_head_and_blocks() {
        let (model, scene, state) = (model(), scene(), state());
        let head = Pose::translation(-0.5, 0.0, 1.8);
        let mut frames = fixed(&model, &scene, true);
        frames.extend(moving(&model, &scene, &state, Some(&head), true));
        let mut tree: BTreeMap<String, (String, Pose)> = BTreeMap::new();
        for f in frames {
            let before = tree.insert(f.child.clone(), (f.parent, f.pose));
            assert!(before.is_none(), "{} has two parents", f.child);
        }
        // The pose of a frame in the root, which is the same for all.
        let in_root = |name: &str| {
            let (mut name, mut pose) = (name.to_owned(), Pose::identity());
            while let Some((parent, step)) = tree.get(&name) {
                pose = step * pose;
                name = parent.clone();
            }
            assert_eq!(name, "optitrack_world");
            pose
        };
        let in_world = |name: &str| in_root(WORLD).inverse() * in_root(name);
        let near = |name: &str, expected: Pose| {
            let off = expected.inverse() * in_world(name);
            assert!(off.translation.vector.norm() < 1e-12 && off.rotation.angle() < 1e-7, "{name}: {off}");
        };
        assert!(tree.keys().eq(&names(&model, &scene)), "what can be left out is what there is");
        near("base_link", state.world_from_base);
        near("HololensSG", head);
        near("bluecylinder2", state.objects[3].pose);
        near("lower", state.world_from_base * model.link_poses(&state.position)[3]);
        for name in tree.keys() {
            in_root(name);
        }
    }

    #[test]
    fn the_originals_frames_are_told_of_as_its_table_says_and_the_guide_has_the_table() {
        let (model, scene, state) = (model(), scene(), state());
        let fixed = fixed(&model, &scene, false);
        let still = moving(&model, &scene, &state, None, false);
        let headed = moving(&model, &scene, &state, Some(&Pose::identity()), false);
        let has = |frames: &[Frame], row: &OriginalFrame| {
            frames.iter().any(|frame| frame.parent == row.parent && frame.child == row.child)
        };
        let guide =
            std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/ros1.md")).unwrap();
        for row in &ORIGINAL_FRAMES {
            let found = [&fixed, &still, &headed].map(|frames| has(frames, row));
            let expected = match row.kind {
                FrameKind::Fixed => [true, false, false],
                FrameKind::Moving => [false, true, true],
                FrameKind::HeadTracked => [false, false, true],
                FrameKind::Absent => [false; 3],
            };
            assert_eq!(found, expected, "{row:?}");
            let line = format!("| `{}` | `{}` | {} |", row.parent, row.child, row.meaning);
            assert!(guide.contains(&line), "docs/ros1.md lacks {line}");
        }
        // And nothing else is there but objects and the grasp centre.
        for frame in fixed.iter().chain(&headed) {
            let known =
                ORIGINAL_FRAMES.iter().any(|row| row.child == frame.child && row.parent == frame.parent);
            let object = scene.objects.iter().any(|object| object.ros_name == frame.child);
            assert!(known || object || frame.child == GRASP_CENTER, "{frame:?}");
        }
    }

    #[test]
    fn the_grasp_centre_has_z_up_when_the_hand_is_rolled_as_the_grasp_asks() {
        let frame = grasp_center(&model(), &scene()).expect("the model has links");
        assert_eq!((frame.parent.as_str(), frame.child.as_str()), ("lower", GRASP_CENTER));
        let up = proact_arm::upright_axis(model().widest_grasp().roll_rad, 0.0);
        assert!((frame.pose.rotation * Vector::z() - up).norm() < 1e-12);
    }

    #[test]
    fn angles_are_wrapped_to_one_turn() {
        for (angle, expected) in
            [(0.5, 0.5), (PI, PI), (-PI, PI), (PI + 0.5, 0.5 - PI), (7.0 * TAU - 0.1, -0.1)]
        {
            assert!((wrap_angle(angle) - expected).abs() < 1e-12, "{angle}");
        }
    }
}
