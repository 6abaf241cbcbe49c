//! Signatures only. Everything that can throw returns `Result`.
//!
//! Flat numbers: a pose is `[x, y, z, qx, qy, qz, qw]`; a shape is its kind and three sizes.

#[cxx::bridge(namespace = "proact::dynamics")]
pub(crate) mod ffi {
    /// A contact as `World` reports it.
    #[derive(Clone, Copy)]
    struct ContactRecord {
        block: usize,
        link: usize,
        point: [f64; 3],
        normal: [f64; 3],
        force: f64,
    }

    /// Who moves the arm: `PhysicsEngine` of `model.hpp`.
    #[repr(u8)]
    enum Engine {
        #[cxx_name = "reduced"]
        Reduced,
        #[cxx_name = "ode"]
        Ode,
    }

    /// `Solver` of `model.hpp`.
    #[repr(u8)]
    enum Solver {
        #[cxx_name = "direct"]
        Direct,
        #[cxx_name = "iterative"]
        Iterative,
    }

    /// `ShapeKind` of `model.hpp`.
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

    /// The settings of `Options`.
    struct DynamicsSettings {
        gravity: [f64; 3],
        engine: Engine,
        solver: Solver,
        /// Of the iterative solver.
        iterations: u32,
        seed: u64,
        position_gain: f64,
        lock_idle_hand: bool,
        sleep: bool,
        merge_attached: bool,
        max_base_speed_m_per_s: f64,
        max_base_turn_rate_rad_per_s: f64,
        joint_cfm: f64,
    }

    unsafe extern "C++" {
        include!("proact-dynamics/src/adapter.hpp");

        // Declared in `model.hpp`; cxx checks that the names stand for the same numbers.
        type Engine;
        type Solver;
        type ShapeKind;
        type JointKind;

        type Model;
        type World;

        fn new_model(settings: &DynamicsSettings, world_from_base: &[f64]) -> UniquePtr<Model>;
        fn add_link(model: Pin<&mut Model>, name: &str, mass: f64, inertial: &[f64], inertia: &[f64]);
        fn add_collision(model: Pin<&mut Model>, kind: ShapeKind, size: &[f64], pose: &[f64]);
        /// `numbers`: lower, upper, velocity, effort, damping, friction, proportional and derivative gain.
        fn add_joint(
            model: Pin<&mut Model>,
            name: &str,
            kind: JointKind,
            parent: usize,
            origin: &[f64],
            axis: &[f64],
            numbers: &[f64],
        );
        fn set_moving(model: Pin<&mut Model>, joints: &[usize], arm_count: usize, positions: &[f64]);
        fn add_fixed(
            model: Pin<&mut Model>,
            name: &str,
            kind: ShapeKind,
            size: &[f64],
            pose: &[f64],
            friction: f64,
        );
        /// `numbers`: mass, friction, finger friction.
        fn add_block(
            model: Pin<&mut Model>,
            name: &str,
            kind: ShapeKind,
            size: &[f64],
            pose: &[f64],
            numbers: &[f64],
        );
        fn new_world(model: &Model) -> Result<UniquePtr<World>>;

        fn step_world(
            world: Pin<&mut World>,
            position: &[f64],
            velocity: &[f64],
            world_from_base: &[f64],
        ) -> Result<()>;
        fn read_joints(
            world: &World,
            position: &mut [f64],
            velocity: &mut [f64],
            effort: &mut [f64],
            limit_effort: &mut [f64],
        );
        /// 13 numbers: pose, linear and angular velocity.
        fn read_block(world: &World, block: usize, out: &mut [f64]) -> Result<()>;
        fn contact_count(world: &World) -> usize;
        fn read_contact(world: &World, index: usize) -> Result<ContactRecord>;
        /// True if a block is attached; then `pose` is `link_from_block`.
        fn read_attached(world: &World, block: &mut usize, pose: &mut [f64]) -> bool;
        fn base_held(world: &World) -> bool;
        fn save_world(world: &World) -> Result<Vec<f64>>;
        fn restore_world(world: Pin<&mut World>, numbers: &[f64]) -> Result<()>;
        fn read_link(world: &World, link: usize, pose: &mut [f64]) -> Result<()>;
        fn attach_block(world: Pin<&mut World>, block: usize, link: usize) -> Result<()>;
        fn release_block(world: Pin<&mut World>) -> Result<()>;
        /// 13 numbers: pose, linear and angular velocity.
        fn place_block(world: Pin<&mut World>, block: usize, state: &[f64]) -> Result<()>;
        fn arm_body_count(world: &World) -> usize;
        fn solver_warnings(world: &World) -> u64;
        fn last_solver_warning(world: &World) -> String;
    }
}
