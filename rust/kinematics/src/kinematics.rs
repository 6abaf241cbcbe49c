use crate::bridge::ffi;
use nalgebra::{DMatrix, Quaternion, Translation3, UnitQuaternion};
use proact_arm::{ArmModel, Inertial, JointKind};
use proact_control::ports::{ArmKinematics, IkOutcome, KinematicsError};
use proact_types::{JointVector, Pose, Vector, joints, zeros};

/// KDL's chain, tree and solvers for one arm.
///
/// Chain methods take the angles of the moving joints between `base` and `tip` in that order; for the usual
/// chain these are the arm joints. Tree methods take all moving joints in the order of [`ArmModel::moving_count`], and
/// their frame `root` is the model's first link.
///
/// Every method takes `&mut self`: KDL writes to caches even in its const methods, and two threads sharing a
/// chain get wrong poses (7,358 of 400,000 in a measurement on KDL 1.5.1). Make one per thread.
///
/// ```no_run
/// # fn demo(model: &proact_arm::ArmModel) -> Result<(), Box<dyn std::error::Error>> {
/// use proact_kinematics::{ArmKinematics, Kinematics};
/// let mut kinematics = Kinematics::new(model)?;
/// let base_from_tip = kinematics.forward(&[0.0, 0.3, 0.0, 1.2, 0.0, 0.0, 0.0])?;
/// # Ok(()) }
/// ```
///
/// It may move to another thread but not be shared:
///
/// ```compile_fail
/// fn shared<T: Sync>() {}
/// shared::<proact_kinematics::Kinematics>();
/// ```
pub struct Kinematics {
    inner: cxx::UniquePtr<ffi::Arm>,
    chain_joints: usize,
    moving_count: usize,
    link_count: usize,
}

// SAFETY: the C++ object owns all that it points to (chain, tree, solvers, buffers), KDL and Eigen keep no
// thread-local or global state that these calls use, and the object is reached only through `&mut self`; moving
// it between threads is sound. `Sync` is deliberately not granted, because KDL's const methods write.
#[expect(unsafe_code, reason = "a cxx pointer is never Send by itself")]
unsafe impl Send for Kinematics {}

impl Kinematics {
    /// Kinematics of the model's arm group: from its first link to its tip.
    ///
    /// # Errors
    /// [`KinematicsError::Library`] naming the offender, if the model has no links, a name occurs twice, a mass
    /// is negative, an axis has no direction, limits are in the wrong order, a revolute joint is in no group, or
    /// the tip is not below the base; [`KinematicsError::NotFinite`] if a number of the model is not finite.
    pub fn new(model: &ArmModel) -> Result<Self, KinematicsError> {
        Self::build(model, 0, model.tip)
    }

    /// As [`Kinematics::new`], for the chain from the link called `base` to the link called `tip`.
    ///
    /// # Errors
    /// As [`Kinematics::new`], and if there is no such link.
    pub fn with_chain(model: &ArmModel, base: &str, tip: &str) -> Result<Self, KinematicsError> {
        let link = |name| model.link(name).map_err(|error| KinematicsError::Library(error.to_string()));
        Self::build(model, link(base)?, link(tip)?)
    }

    fn build(model: &ArmModel, base: usize, tip: usize) -> Result<Self, KinematicsError> {
        let inner = ffi::new_arm(&to_raw(model, base, tip)?).map_err(library_error)?;
        Ok(Self {
            chain_joints: ffi::chain_joint_count(&inner),
            inner,
            moving_count: model.moving_count(),
            link_count: model.links.len(),
        })
    }

    /// Number of moving joints of the whole tree.
    pub fn moving_count(&self) -> usize {
        self.moving_count
    }

    /// As [`ArmKinematics::forward`], writing into `base_from_tip`. Does not allocate unless it fails.
    ///
    /// # Errors
    /// Wrong length or a value that is not finite; `base_from_tip` is then untouched.
    pub fn forward_into(&mut self, q: &[f64], base_from_tip: &mut Pose) -> Result<(), KinematicsError> {
        check_vector("joint angle", q, self.chain_joints)?;
        let mut raw = [0.0; 7];
        ffi::forward(self.inner.pin_mut(), q, &mut raw).map_err(library_error)?;
        *base_from_tip = from_raw_pose(&raw);
        Ok(())
    }

    /// As [`ArmKinematics::jacobian`], writing into `jacobian` of shape `[6, joints]`. Does not allocate unless
    /// it fails.
    ///
    /// # Errors
    /// Wrong length, a value that is not finite, or a matrix of another shape.
    pub fn jacobian_into(&mut self, q: &[f64], jacobian: &mut DMatrix<f64>) -> Result<(), KinematicsError> {
        check_vector("joint angle", q, self.chain_joints)?;
        if jacobian.shape() != (6, self.chain_joints) {
            let (rows, columns) = jacobian.shape();
            return Err(KinematicsError::Library(format!(
                "the matrix for the Jacobian is {rows} by {columns}, expected 6 by {}",
                self.chain_joints
            )));
        }
        ffi::jacobian(self.inner.pin_mut(), q, jacobian.as_mut_slice()).map_err(library_error)
    }

    /// Condition number of the Jacobian at `q`, and its six singular values, largest first.
    ///
    /// The Jacobian is taken as it is, metres beside radians, as the original does. A chain of fewer than six
    /// joints has singular values of zero. The condition number is infinite when the smallest one is zero.
    ///
    /// # Errors
    /// Wrong length or a value that is not finite.
    pub fn condition(&mut self, q: &[f64]) -> Result<(f64, [f64; 6]), KinematicsError> {
        check_vector("joint angle", q, self.chain_joints)?;
        let mut sigma = [0.0; 6];
        ffi::singular_values(self.inner.pin_mut(), q, &mut sigma).map_err(library_error)?;
        let condition = if sigma[5] > 0.0 { sigma[0] / sigma[5] } else { f64::INFINITY };
        Ok((condition, sigma))
    }

    /// `root_from_link` for every link of the model, in its order, at the moving joints' angles `q`.
    ///
    /// # Errors
    /// Wrong length or a value that is not finite.
    pub fn link_poses(&mut self, q: &[f64]) -> Result<Vec<Pose>, KinematicsError> {
        check_vector("joint angle", q, self.moving_count)?;
        let mut raw = vec![0.0; 7 * self.link_count];
        ffi::link_poses(self.inner.pin_mut(), q, &mut raw).map_err(library_error)?;
        Ok(raw.as_chunks().0.iter().map(from_raw_pose).collect())
    }

    /// Torque of every moving joint, N m, that gives the accelerations `qdd` (rad/s^2) at the angles `q` and
    /// speeds `qd` (rad/s) under `gravity` (m/s^2, axes of the root link): recursive Newton-Euler over the whole
    /// tree, hand and carried body included. Damping and friction are not.
    ///
    /// All vectors run over the moving joints. Another gravity than in the call before costs a new solver
    /// (about as much as the answer itself).
    ///
    /// # Errors
    /// Wrong length or a value that is not finite.
    pub fn inverse_dynamics(
        &mut self,
        q: &[f64],
        qd: &[f64],
        qdd: &[f64],
        gravity: &Vector,
    ) -> Result<JointVector, KinematicsError> {
        check_vector("joint angle", q, self.moving_count)?;
        check_vector("joint speed", qd, self.moving_count)?;
        check_vector("joint acceleration", qdd, self.moving_count)?;
        check_vector("gravity component", gravity.as_slice(), 3)?;
        let mut torque = zeros(self.moving_count);
        ffi::inverse_dynamics(self.inner.pin_mut(), q, qd, qdd, &gravity.data.0[0], &mut torque)
            .map_err(library_error)?;
        // Speeds are squared on the way.
        match torque.iter().position(|value| !value.is_finite()) {
            Some(joint) => Err(KinematicsError::Overflow { what: "torque of joint", index: joint }),
            None => Ok(torque),
        }
    }

    /// Puts a body into the hand, fixed to the tip: `body.pose` is `tip_from_body` with the origin at the centre
    /// of mass. `None` takes it away. Only [`Kinematics::inverse_dynamics`] feels it.
    ///
    /// # Errors
    /// A mass that is not above zero, or a value that is not finite; what was carried before then stays.
    pub fn set_payload(&mut self, body: Option<&Inertial>) -> Result<(), KinematicsError> {
        let Some(body) = body else {
            return ffi::clear_payload(self.inner.pin_mut()).map_err(library_error);
        };
        let pose = to_raw_pose(&body.pose);
        check_vector("mass", &[body.mass], 1)?;
        check_vector("pose component", &pose, 7)?;
        check_vector("inertia", &body.inertia, 6)?;
        ffi::set_payload(self.inner.pin_mut(), body.mass, &pose, &body.inertia).map_err(library_error)
    }

    /// Distinct angles within the limits at which the tip is at `base_from_tip`, found from `starts` random
    /// starts drawn from `random_seed`, in the order found. Two solutions differ by at least 0.1 rad in some
    /// joint. The answer depends on the arguments alone; none found is an empty answer.
    ///
    /// # Errors
    /// A target that is not finite.
    pub fn inverse_all(
        &mut self,
        base_from_tip: &Pose,
        starts: usize,
        random_seed: u64,
    ) -> Result<Vec<JointVector>, KinematicsError> {
        let target = to_raw_pose(base_from_tip);
        check_vector("target component", &target, 7)?;
        let found =
            ffi::inverse_all(self.inner.pin_mut(), &target, starts, random_seed).map_err(library_error)?;
        Ok(found.chunks_exact(self.chain_joints).map(joints).collect())
    }
}

impl ArmKinematics for Kinematics {
    fn joint_count(&self) -> usize {
        self.chain_joints
    }

    fn forward(&mut self, q: &[f64]) -> Result<Pose, KinematicsError> {
        let mut pose = Pose::identity();
        self.forward_into(q, &mut pose)?;
        Ok(pose)
    }

    fn jacobian(&mut self, q: &[f64]) -> Result<DMatrix<f64>, KinematicsError> {
        let mut jacobian = DMatrix::zeros(6, self.chain_joints);
        self.jacobian_into(q, &mut jacobian)?;
        Ok(jacobian)
    }

    /// Solutions are exact to 1e-8 m and 1e-8 rad. The search begins at `seed`, clamped to the limits; if it
    /// gets stuck it goes on from 63 other starts, always the same ones: first around the seed, then anywhere.
    /// The first solution found is the answer, so it is near the seed when there is one near it.
    fn inverse(&mut self, base_from_tip: &Pose, seed: &[f64]) -> Result<IkOutcome, KinematicsError> {
        let target = to_raw_pose(base_from_tip);
        check_vector("target component", &target, 7)?;
        check_vector("seed angle", seed, self.chain_joints)?;
        let mut q = zeros(self.chain_joints);
        let solved = ffi::inverse(self.inner.pin_mut(), &target, seed, &mut q).map_err(library_error)?;
        Ok(if solved { IkOutcome::Solved(q) } else { IkOutcome::NotFound })
    }
}

/// Nanoseconds that KDL alone takes for pose and Jacobian, measured in a C++ loop: once for each of the
/// configurations `q` of the chain from the model's first link to its tip. The peer of the benchmark.
///
/// # Errors
/// As [`Kinematics::new`]; a configuration of the wrong length or with a value that is not finite.
pub fn time_raw_kdl(model: &ArmModel, q: &[JointVector]) -> Result<Vec<f64>, KinematicsError> {
    let mut flat = Vec::with_capacity(q.len() * model.arm_count());
    for configuration in q {
        check_vector("joint angle", configuration, model.arm_count())?;
        flat.extend_from_slice(configuration);
    }
    ffi::time_raw_kdl(&to_raw(model, 0, model.tip)?, &flat, q.len()).map_err(library_error)
}

fn library_error(exception: cxx::Exception) -> KinematicsError {
    KinematicsError::Library(exception.what().to_owned())
}

/// KDL would compute with NaN and report success, and C++ trusts the lengths, so both are stopped here.
fn check_vector(what: &'static str, values: &[f64], expected: usize) -> Result<(), KinematicsError> {
    if values.len() != expected {
        return Err(KinematicsError::WrongJointCount { got: values.len(), expected });
    }
    match values.iter().position(|value| !value.is_finite()) {
        Some(index) => Err(KinematicsError::NotFinite { what, index, value: values[index] }),
        None => Ok(()),
    }
}

fn from_raw_pose(raw: &[f64; 7]) -> Pose {
    let [x, y, z, qx, qy, qz, qw] = *raw;
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(qw, qx, qy, qz));
    Pose::from_parts(Translation3::new(x, y, z), rotation)
}

fn to_raw_pose(pose: &Pose) -> [f64; 7] {
    let (p, q) = (pose.translation.vector, pose.rotation.coords);
    [p.x, p.y, p.z, q.x, q.y, q.z, q.w]
}

fn to_raw(model: &ArmModel, base: usize, tip: usize) -> Result<ffi::RawArm, KinematicsError> {
    let mut links = Vec::with_capacity(model.links.len());
    for (index, link) in model.links.iter().enumerate() {
        // Joint k moves link k + 1; the first link hangs on nothing.
        let joint = match index.checked_sub(1) {
            None => None,
            Some(k) => match model.joints.get(k) {
                Some(joint) if joint.child == index => Some(joint),
                _ => {
                    return Err(KinematicsError::Library(format!(
                        "link \"{}\" (number {index}) has no joint number {k} above it",
                        link.name
                    )));
                }
            },
        };
        let inertial =
            link.inertial.unwrap_or(Inertial { mass: 0.0, pose: Pose::identity(), inertia: [0.0; 6] });
        let raw = ffi::RawLink {
            name: link.name.clone(),
            parent: joint.map_or(0, |j| j.parent),
            joint: joint.map_or_else(String::new, |j| j.name.clone()),
            kind: match joint.map(|j| j.kind) {
                Some(JointKind::Revolute | JointKind::Continuous) => ffi::JointKind::Revolute,
                Some(JointKind::Prismatic) => ffi::JointKind::Prismatic,
                Some(JointKind::Fixed) | None => ffi::JointKind::Fixed,
            },
            origin: to_raw_pose(&joint.map_or_else(Pose::identity, |j| j.origin)),
            axis: joint.map_or([0.0, 0.0, 1.0], |j| j.axis.into()),
            lower: joint.map_or(0.0, |j| j.limits.lower),
            upper: joint.map_or(0.0, |j| j.limits.upper),
            mass: inertial.mass,
            inertial_pose: to_raw_pose(&inertial.pose),
            inertia: inertial.inertia,
        };
        check_vector("joint origin component", &raw.origin, 7)?;
        check_vector("joint axis component", &raw.axis, 3)?;
        check_vector("joint limit", &[raw.lower, raw.upper], 2)?;
        check_vector("link mass", &[raw.mass], 1)?;
        check_vector("inertial pose component", &raw.inertial_pose, 7)?;
        check_vector("inertia", &raw.inertia, 6)?;
        links.push(raw);
    }
    let moving = model.moving().map(|joint| joint + 1).collect();
    Ok(ffi::RawArm { links, moving, base, tip })
}
