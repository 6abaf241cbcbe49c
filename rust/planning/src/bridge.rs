//! Signatures and plain values only. Everything that can throw returns `Result`.

use crate::state_check::StateCheck;

use proact_types::{Pose, Shape};

#[cxx::bridge(namespace = "proact::planning")]
pub(crate) mod ffi {
    /// A mesh: three numbers a vertex, three vertices a triangle, in the frame of `pose`.
    struct MeshRow {
        name: String,
        vertices: Vec<f64>,
        triangles: Vec<usize>,
        pose: [f64; 7],
    }

    /// Shapes without a mesh, of `model.hpp`.
    #[repr(u8)]
    enum ShapeKind {
        #[cxx_name = "box"]
        Box,
        #[cxx_name = "sphere"]
        Sphere,
        #[cxx_name = "cylinder"]
        Cylinder,
        #[cxx_name = "capsule"]
        Capsule,
    }

    /// `JointKind` of `model.hpp`.
    #[repr(u8)]
    enum JointKind {
        #[cxx_name = "fixed"]
        Fixed,
        #[cxx_name = "revolute"]
        Revolute,
        #[cxx_name = "prismatic"]
        Prismatic,
    }

    /// `PlannerKind` of `joint_planner.hpp`.
    #[repr(u8)]
    enum PlannerKind {
        #[cxx_name = "rrt_connect"]
        RrtConnect,
        #[cxx_name = "bitrrt"]
        BiTrrt,
        #[cxx_name = "lbkpiece1"]
        LbKpiece1,
        #[cxx_name = "rrt_star"]
        RrtStar,
        #[cxx_name = "prm"]
        Prm,
        #[cxx_name = "anytime"]
        Anytime,
    }

    /// `JointPlanStatus` of `joint_planner.hpp`.
    #[repr(u8)]
    #[derive(Debug)]
    enum JointPlanStatus {
        #[cxx_name = "solved"]
        Solved,
        #[cxx_name = "no_plan"]
        NoPlan,
        #[cxx_name = "start_in_collision"]
        StartInCollision,
        #[cxx_name = "goals_in_collision"]
        GoalsInCollision,
        #[cxx_name = "cancelled"]
        Cancelled,
    }

    /// A shape and where it is; pose is x, y, z, quaternion x, y, z, w.
    struct ShapeRow {
        kind: ShapeKind,
        size: [f64; 3],
        pose: [f64; 7],
    }

    /// A joint of the arm, by indices of its links.
    struct JointRow {
        parent: usize,
        child: usize,
        kind: JointKind,
        pose: [f64; 7],
        axis: [f64; 3],
        lower: f64,
        upper: f64,
    }

    /// Two names that touch.
    struct ContactRow {
        a: String,
        b: String,
    }

    /// A roadmap: one row of arm angles a milestone, two indices of milestones an edge.
    struct RoadmapRow {
        milestones: Vec<f64>,
        edges: Vec<usize>,
    }

    /// What steers and bounds one search; the planner's parameters are names and values in turns.
    struct SearchRow {
        seed: u64,
        planner: PlannerKind,
        parameters: Vec<String>,
        equal_steps: f64,
        max_iterations: u32,
        max_seconds: f64,
        more_searches: u32,
        range: f64,
        shortcut_attempts: u32,
        step_rad: f64,
        step_m: f64,
    }

    /// A plan; the path is row-major, one row of arm angles a point.
    struct PlanRow {
        status: JointPlanStatus,
        goal: usize,
        path: Vec<f64>,
        iterations: u64,
        state_checks: u64,
        seconds: f64,
        timed_out: bool,
    }

    /// A plain program's path, processor time of its searches, and of all that it did.
    struct BaselineRow {
        path: Vec<f64>,
        attempts: u32,
        search_secs: f64,
        cpu_secs: f64,
    }

    extern "Rust" {
        type StateCheck<'a>;
        fn accepts(self: &mut StateCheck<'_>, q: &[f64]) -> bool;
    }

    unsafe extern "C++" {
        include!("proact-planning/src/adapter.hpp");

        // Declared in the core's headers; cxx checks that the names stand for the same numbers.
        type ShapeKind;
        type JointKind;
        type PlannerKind;
        type JointPlanStatus;

        type Arm;
        fn new_arm() -> UniquePtr<Arm>;
        fn add_link(arm: Pin<&mut Arm>, name: &str, shapes: &[ShapeRow]) -> Result<()>;
        fn add_joint(arm: Pin<&mut Arm>, joint: &JointRow) -> Result<()>;
        fn set_groups(arm: Pin<&mut Arm>, chain: &[usize], hand: &[usize], tip: usize) -> Result<()>;
        fn allow_pair(arm: Pin<&mut Arm>, a: usize, b: usize) -> Result<()>;

        type Roadmap;
        fn new_roadmap(row: &RoadmapRow, joints: usize) -> SharedPtr<Roadmap>;

        type Scene;
        fn new_scene(arm: &Arm) -> Result<UniquePtr<Scene>>;
        fn set_base(scene: Pin<&mut Scene>, pose: &[f64; 7]) -> Result<()>;
        fn set_hand(scene: Pin<&mut Scene>, angles: &[f64]) -> Result<()>;
        fn set_obstacles(
            scene: Pin<&mut Scene>,
            names: &[String],
            shapes: &[ShapeRow],
            meshes: &[MeshRow],
        ) -> Result<()>;
        fn set_attached(scene: Pin<&mut Scene>, name: &str, shape: &ShapeRow) -> Result<()>;
        fn clear_attached(scene: Pin<&mut Scene>) -> Result<()>;
        fn set_padding(scene: Pin<&mut Scene>, padding_m: f64) -> Result<()>;
        fn allow_contact(scene: Pin<&mut Scene>, member: &str, obstacle: &str) -> Result<()>;
        fn clear_allowed_contacts(scene: Pin<&mut Scene>) -> Result<()>;
        fn collisions(scene: Pin<&mut Scene>, q: &[f64], all_links: bool) -> Result<Vec<ContactRow>>;
        fn is_free(scene: Pin<&mut Scene>, q: &[f64]) -> Result<bool>;
        fn motion_is_free(scene: Pin<&mut Scene>, a: &[f64], b: &[f64], search: &SearchRow) -> Result<bool>;
        /// States stand one after the other, a row of arm angles each.
        fn path_is_free(scene: Pin<&mut Scene>, states: &[f64], search: &SearchRow) -> Result<bool>;
        fn states_are_free(scene: Pin<&mut Scene>, states: &[f64]) -> Result<bool>;
        /// The roadmap may be null.
        fn plan_joint(
            scene: Pin<&mut Scene>,
            start: &[f64],
            goals: &[f64],
            search: &SearchRow,
            roadmap: &SharedPtr<Roadmap>,
            cancel: &CancelFlag,
        ) -> Result<PlanRow>;
        /// As `plan_joint`; a state is valid only if `check` accepts it too.
        fn plan_joint_constrained(
            scene: Pin<&mut Scene>,
            start: &[f64],
            goals: &[f64],
            search: &SearchRow,
            check: &mut StateCheck,
            cancel: &CancelFlag,
        ) -> Result<PlanRow>;

        fn grow_roadmap(
            scene: Pin<&mut Scene>,
            search: &SearchRow,
            milestones: usize,
            cancel: &CancelFlag,
        ) -> Result<RoadmapRow>;

        fn search_baseline(
            scene: &Scene,
            start: &[f64],
            goals: &[f64],
            search: &SearchRow,
        ) -> Result<BaselineRow>;

        fn check_planner(search: &SearchRow) -> Result<()>;
        fn count_free(scene: Pin<&mut Scene>, states: &[f64]) -> Result<usize>;
        fn count_accepted(states: &[f64], joints: usize, check: &mut StateCheck) -> Result<usize>;
        fn thread_cpu_secs() -> f64;
        fn thread_cpu_clock() -> i32;
        fn cpu_secs_of(clock: i32) -> f64;

        type CancelFlag;
        fn new_cancel_flag() -> SharedPtr<CancelFlag>;
        fn raise_flag(flag: &CancelFlag);
        fn lower_flag(flag: &CancelFlag);
        fn is_raised(self: &CancelFlag) -> bool;
    }
}

/// Position, then quaternion.
pub(crate) fn pose_row(pose: &Pose) -> [f64; 7] {
    let (p, r) = (&pose.translation, &pose.rotation);
    [p.x, p.y, p.z, r.i, r.j, r.k, r.w]
}

/// A shape at its pose.
pub(crate) fn shape_row(shape: &Shape, pose: &Pose) -> ffi::ShapeRow {
    let (kind, size) = match *shape {
        Shape::Box { size } => (ffi::ShapeKind::Box, size),
        Shape::Sphere { radius } => (ffi::ShapeKind::Sphere, [radius, 0.0, 0.0]),
        Shape::Cylinder { radius, length } => (ffi::ShapeKind::Cylinder, [radius, length, 0.0]),
        Shape::Capsule { radius, length } => (ffi::ShapeKind::Capsule, [radius, length, 0.0]),
    };
    ffi::ShapeRow { kind, size, pose: pose_row(pose) }
}
