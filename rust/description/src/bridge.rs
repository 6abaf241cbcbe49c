//! Signatures and plain values only.

#[cxx::bridge(namespace = "proact::description")]
pub(crate) mod ffi {
    #[derive(Clone, Debug)]
    struct RawPose {
        position: [f64; 3],
        /// x, y, z, w.
        quaternion: [f64; 4],
    }

    /// `ShapeKind` of `robot.hpp`.
    #[repr(u8)]
    #[derive(Clone, Copy, Debug)]
    enum ShapeKind {
        #[cxx_name = "box"]
        Box,
        #[cxx_name = "cylinder"]
        Cylinder,
        #[cxx_name = "sphere"]
        Sphere,
        #[cxx_name = "mesh"]
        Mesh,
    }

    /// `JointKind` of `robot.hpp`.
    #[repr(u8)]
    #[derive(Clone, Copy, Debug)]
    enum JointKind {
        #[cxx_name = "fixed"]
        Fixed,
        #[cxx_name = "revolute"]
        Revolute,
        #[cxx_name = "continuous"]
        Continuous,
        #[cxx_name = "prismatic"]
        Prismatic,
        #[cxx_name = "planar"]
        Planar,
        #[cxx_name = "floating"]
        Floating,
        #[cxx_name = "unknown"]
        Unknown,
    }

    #[derive(Clone, Debug)]
    struct RawShape {
        kind: ShapeKind,
        /// Box: sides; cylinder: radius, length; sphere: radius; mesh: scale.
        size: [f64; 3],
        file: String,
    }

    #[derive(Clone, Debug)]
    struct RawCollision {
        pose: RawPose,
        shape: RawShape,
    }

    #[derive(Clone, Debug)]
    struct RawVisual {
        pose: RawPose,
        shape: RawShape,
        color: [f64; 4],
    }

    #[derive(Clone, Debug)]
    struct RawLink {
        name: String,
        has_inertial: bool,
        mass: f64,
        inertial_pose: RawPose,
        /// ixx, ixy, ixz, iyy, iyz, izz.
        inertia: [f64; 6],
        collisions: Vec<RawCollision>,
        visuals: Vec<RawVisual>,
    }

    #[derive(Clone, Debug)]
    struct RawJoint {
        name: String,
        kind: JointKind,
        parent: String,
        child: String,
        origin: RawPose,
        axis: [f64; 3],
        has_limits: bool,
        /// lower, upper, velocity, effort.
        limits: [f64; 4],
        damping: f64,
        friction: f64,
        /// The joint that it follows; empty if it follows none.
        mimic_joint: String,
        /// Multiplier, offset.
        mimic: [f64; 2],
    }

    /// Links and joints in alphabetical order.
    #[derive(Clone, Debug)]
    struct RawRobot {
        name: String,
        root: String,
        links: Vec<RawLink>,
        joints: Vec<RawJoint>,
    }

    unsafe extern "C++" {
        include!("proact-description/src/adapter.hpp");

        // Declared in `robot.hpp`; cxx checks that the names stand for the same numbers.
        type ShapeKind;
        type JointKind;

        /// Fails with everything that urdfdom logged.
        fn read(text: &str) -> Result<RawRobot>;

        /// By urdfdom's own arithmetic: seven numbers for each of `links`. Fails as `read`, and for unknown names.
        fn link_poses(
            text: &str,
            joints: &Vec<String>,
            angles: &[f64],
            links: &Vec<String>,
        ) -> Result<Vec<f64>>;
    }
}
