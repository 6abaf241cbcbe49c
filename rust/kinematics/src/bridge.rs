//! Signatures and plain values only. Everything that can throw returns `Result`.

#[cxx::bridge(namespace = "proact::kinematics")]
pub(crate) mod ffi {
    /// `JointKind` of `description.hpp`.
    #[repr(u8)]
    enum JointKind {
        #[cxx_name = "fixed"]
        Fixed,
        #[cxx_name = "revolute"]
        Revolute,
        #[cxx_name = "prismatic"]
        Prismatic,
    }

    /// A link with the joint that carries it; poses are x, y, z and a quaternion x, y, z, w.
    struct RawLink {
        name: String,
        parent: usize,
        joint: String,
        kind: JointKind,
        origin: [f64; 7],
        axis: [f64; 3],
        lower: f64,
        upper: f64,
        mass: f64,
        inertial_pose: [f64; 7],
        inertia: [f64; 6],
    }

    struct RawArm {
        links: Vec<RawLink>,
        moving: Vec<usize>,
        base: usize,
        tip: usize,
    }

    unsafe extern "C++" {
        include!("proact-kinematics/src/adapter.hpp");

        // Declared in `description.hpp`; cxx checks that the names stand for the same numbers.
        type JointKind;

        type Arm;

        fn new_arm(description: &RawArm) -> Result<UniquePtr<Arm>>;
        fn chain_joint_count(arm: &Arm) -> usize;
        fn forward(arm: Pin<&mut Arm>, q: &[f64], pose: &mut [f64; 7]) -> Result<()>;
        fn jacobian(arm: Pin<&mut Arm>, q: &[f64], out: &mut [f64]) -> Result<()>;
        fn singular_values(arm: Pin<&mut Arm>, q: &[f64], out: &mut [f64; 6]) -> Result<()>;
        fn link_poses(arm: Pin<&mut Arm>, q: &[f64], out: &mut [f64]) -> Result<()>;
        fn inverse_dynamics(
            arm: Pin<&mut Arm>,
            q: &[f64],
            qd: &[f64],
            qdd: &[f64],
            gravity: &[f64; 3],
            torque: &mut [f64],
        ) -> Result<()>;
        fn set_payload(arm: Pin<&mut Arm>, mass: f64, pose: &[f64; 7], inertia: &[f64; 6]) -> Result<()>;
        fn clear_payload(arm: Pin<&mut Arm>) -> Result<()>;
        fn inverse(arm: Pin<&mut Arm>, target: &[f64; 7], seed: &[f64], out: &mut [f64]) -> Result<bool>;
        fn inverse_all(
            arm: Pin<&mut Arm>,
            target: &[f64; 7],
            starts: usize,
            random_seed: u64,
        ) -> Result<Vec<f64>>;
        fn time_raw_kdl(description: &RawArm, q: &[f64], count: usize) -> Result<Vec<f64>>;
    }
}
