//! Signatures and plain values only.

#[cxx::bridge(namespace = "proact::description")]
pub(crate) mod ffi {
    #[derive(Clone, Debug)]
    struct RawPose {
        position: [f64; 3],
        /// x, y, z, w.
        quaternion: [f64; 4],
    }

    #[derive(Clone, Copy, Debug)]
    enum RawShapeKind {
        Box,
        Cylinder,
        Sphere,
        Mesh,
    }

    #[derive(Clone, Debug)]
    struct RawShape {
        kind: RawShapeKind,
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
        colour: [f64; 4],
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
        kind: String,
        parent: String,
        child: String,
        origin: RawPose,
        axis: [f64; 3],
        has_limits: bool,
        /// lower, upper, velocity, effort.
        limits: [f64; 4],
        damping: f64,
        friction: f64,
        mimics: bool,
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

        /// Fails with everything that urdfdom logged.
        fn read(text: &str) -> Result<RawRobot>;
    }
}
