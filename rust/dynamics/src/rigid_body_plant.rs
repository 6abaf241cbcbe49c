use crate::bridge::ffi;
use crate::snapshot::{Snapshot, fingerprint};
use arrayvec::ArrayVec;
use proact_arm::{ArmModel, JointKind};
use proact_testbed::{
    JointControl, MassSet, PhysicsConfig, PhysicsEngine,
    ports::{Plant, PlantError},
};
use proact_types::{
    BodyState, Contact, PlantCommand, PlantState, Point, Pose, Scene, Shape, Vector, joints, zeros,
};

/// How the equations of a tick are solved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Solver {
    /// `dWorldStep`: exact, cost grows with the cube of the constraints in one island.
    #[default]
    Direct,
    /// `dWorldQuickStep`: approximate. Its random generator belongs to the process, so the plants of a process
    /// take turns, each with its own seed.
    Iterative {
        /// Sweeps a tick, above zero.
        iterations: u32,
        /// Of the order in which constraints are visited.
        seed: u32,
    },
}

/// Settings of the physics.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DynamicsOptions {
    /// m/s^2, world axes.
    pub gravity: Vector,
    /// Who moves the arm and what it touches.
    pub engine: PhysicsEngine,
    /// ODE's solver: for all that ODE moves, which is everything with [`PhysicsEngine::Ode`] and otherwise the
    /// blocks that do not hang together with the arm.
    pub solver: Solver,
    /// How heavy the arm is.
    pub mass_set: MassSet,
    /// Share of a joint's angle error that the position control takes away in a second, 1/s, at most 1000.
    pub position_gain: f64,
    /// What drives the joints.
    pub control: JointControl,
    /// Hand joints whose command has stood still and been reached for 50 ms become rigid until it changes.
    pub lock_idle_hand: bool,
    /// Blocks at rest cost nothing until something touches them.
    pub sleep: bool,
    /// A carried block shares the body of the link that holds it. False: a fixed joint of ODE holds it, which needs
    /// [`PhysicsEngine::Ode`].
    pub merge_attached: bool,
    /// A base that is told to move faster than this between two ticks stays where it is, m/s, until a command within
    /// reach of that place comes: [`PlantState::base_held`]. The joints follow their commands all the while.
    pub max_base_speed_m_per_s: f64,
    /// The same for its turning, rad/s.
    pub max_base_turn_rate_rad_per_s: f64,
    /// How much the joints of [`PhysicsEngine::Ode`] yield: ODE's constraint force mixing, above zero.
    pub joint_cfm: f64,
}

impl DynamicsOptions {
    /// The defaults with what a trial's configuration chooses.
    pub fn from_config(physics: &PhysicsConfig) -> Self {
        let PhysicsConfig { engine, mass_set, joint_control: control, .. } = *physics;
        Self { engine, mass_set, control, ..Self::default() }
    }
}

impl Default for DynamicsOptions {
    fn default() -> Self {
        Self {
            gravity: Vector::new(0.0, 0.0, -9.80665),
            engine: PhysicsEngine::Reduced,
            solver: Solver::Direct,
            mass_set: MassSet::Description,
            position_gain: 200.0,
            control: JointControl::FeedForward,
            lock_idle_hand: true,
            sleep: true,
            merge_attached: true,
            max_base_speed_m_per_s: 5.0,
            max_base_turn_rate_rad_per_s: 20.0,
            joint_cfm: 1e-7,
        }
    }
}

/// Arm, box and blocks: the arm as [`DynamicsOptions::engine`] says, all else in ODE.
///
/// Determinism: see the crate. Frames and units: those of [`PlantState`]. After a step that failed inside ODE
/// ([`PlantError::Library`]) every further step fails too; the state stays readable.
///
/// Make it in the thread that steps it:
///
/// ```compile_fail
/// fn sendable<T: Send>() {}
/// sendable::<proact_dynamics::OdePlant>();
/// ```
pub struct RigidBodyPlant {
    world: cxx::UniquePtr<ffi::World>,
    state: PlantState,
    joint_count: usize,
    last_step_solved: bool,
    /// Of everything that the plant was made from.
    fingerprint: u64,
}

impl RigidBodyPlant {
    /// A plant at rest: moving joints at `initial_positions` (rad, the model's order), base at
    /// `world_from_base`, blocks as the scene says.
    ///
    /// # Errors
    /// [`PlantError::WrongLength`] and [`PlantError::NotFinite`] for the arguments;
    /// [`PlantError::Model`] for what cannot be simulated, such as a moving link without mass, a joint that
    /// starts outside its limits or a block that starts inside something.
    pub fn new(
        model: &ArmModel,
        scene: &Scene,
        initial_positions: &[f64],
        world_from_base: &Pose,
        options: DynamicsOptions,
    ) -> Result<Self, PlantError> {
        let joint_count = model.moving_count();
        check_joints("initial position", initial_positions, joint_count)?;
        check_pose(world_from_base)?;
        if matches!(options.solver, Solver::Iterative { iterations: 0, .. }) {
            return Err(PlantError::Model("0 solver iterations, expected at least 1".to_owned()));
        }
        let factor = options.mass_set.factor();
        if !(factor.is_finite() && factor > 0.0) {
            return Err(PlantError::Model(format!("mass factor {factor}, expected above 0")));
        }
        let mut blocks = ArrayVec::new();
        if scene.objects.len() > blocks.capacity() {
            return Err(PlantError::Model(format!(
                "{} blocks, at most {} are supported",
                scene.objects.len(),
                blocks.capacity()
            )));
        }
        blocks.extend(scene.objects.iter().map(|block| body_at_rest(block.pose)));

        let described = build_model(model, scene, initial_positions, world_from_base, &options)?;
        let described = described.as_ref().ok_or_else(|| PlantError::Library("no memory".to_owned()))?;
        let world = ffi::new_world(described).map_err(|error| PlantError::Model(error.what().to_owned()))?;
        let mut plant = Self {
            world,
            state: PlantState {
                position: joints(initial_positions),
                velocity: zeros(joint_count),
                effort: zeros(joint_count),
                limit_effort: zeros(joint_count),
                world_from_base: *world_from_base,
                base_held: false,
                objects: blocks,
                attached: None,
                contacts: ArrayVec::new(),
            },
            joint_count,
            last_step_solved: true,
            fingerprint: fingerprint(&(model, scene, &options)),
        };
        plant.read_state()?;
        Ok(plant)
    }

    /// All that the next steps depend on.
    ///
    /// # Errors
    /// [`PlantError::Library`] after a step that failed inside ODE.
    pub fn snapshot(&self) -> Result<Snapshot, PlantError> {
        let numbers = ffi::save_world(&self.world).map_err(library_error)?;
        Ok(Snapshot { fingerprint: self.fingerprint, world_from_base: self.state.world_from_base, numbers })
    }

    /// Goes back to a snapshot, of this plant or of another made from the same arm, scene and options (start angles
    /// and base may differ). Every later step then gives the same bits as it gave there.
    ///
    /// # Errors
    /// [`PlantError::Library`] if the snapshot is of something else or damaged; nothing has changed then.
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<(), PlantError> {
        if snapshot.fingerprint != self.fingerprint {
            return Err(PlantError::Library(
                "the snapshot is of another arm, scene or options: make the plant from the same ones"
                    .to_owned(),
            ));
        }
        check_pose(&snapshot.world_from_base)?;
        ffi::restore_world(self.world.pin_mut(), &snapshot.numbers).map_err(library_error)?;
        self.state.world_from_base = snapshot.world_from_base;
        self.read_state()
    }

    /// `world_from_link` of link `link` (an index in `ArmModel::links`), as ODE's bodies stand.
    ///
    /// # Errors
    /// [`PlantError::Library`] if there is no such link.
    pub fn link_pose(&self, link: usize) -> Result<Pose, PlantError> {
        let mut numbers = [0.0; 7];
        ffi::read_link(&self.world, link, &mut numbers).map_err(library_error)?;
        Ok(to_pose(&numbers))
    }

    /// Bodies that the arm consists of at present, the base included: fewer while hand joints are rigid.
    pub fn arm_body_count(&self) -> usize {
        ffi::arm_body_count(&self.world)
    }

    /// ODE's own words in the latest of [`RigidBodyPlant::solver_warnings`], which it would else print; empty if there was
    /// none, or if it was our own solver's.
    pub fn last_solver_warning(&self) -> String {
        ffi::last_solver_warning(&self.world)
    }

    /// Complaints of ODE's solver since the start, such as a contact problem solved inexactly.
    pub fn solver_warnings(&self) -> u64 {
        ffi::solver_warnings(&self.world)
    }

    fn read_state(&mut self) -> Result<(), PlantError> {
        let state = &mut self.state;
        let PlantState { position, velocity, effort, limit_effort: stop_effort, .. } = state;
        ffi::read_joints(&self.world, position, velocity, effort, stop_effort);
        for (index, block) in state.objects.iter_mut().enumerate() {
            let mut numbers = [0.0; 13];
            ffi::read_block(&self.world, index, &mut numbers).map_err(library_error)?;
            *block = BodyState {
                pose: to_pose(&numbers),
                linear_velocity: Vector::new(numbers[7], numbers[8], numbers[9]),
                angular_velocity: Vector::new(numbers[10], numbers[11], numbers[12]),
            };
        }
        state.base_held = ffi::base_held(&self.world);
        state.contacts.clear();
        for index in 0..ffi::contact_count(&self.world).min(state.contacts.capacity()) {
            let contact = ffi::read_contact(&self.world, index).map_err(library_error)?;
            state.contacts.push(Contact {
                object: contact.block,
                link: contact.link,
                point: Point::from(contact.point),
                normal: Vector::from(contact.normal),
                force: contact.force,
            });
        }
        self.read_attached();
        Ok(())
    }

    fn read_attached(&mut self) {
        let (mut block, mut numbers) = (0, [0.0; 7]);
        let attached = ffi::read_attached(&self.world, &mut block, &mut numbers);
        self.state.attached = attached.then(|| (block, to_pose(&numbers)));
    }
}

impl Plant for RigidBodyPlant {
    fn step(&mut self, command: &PlantCommand) -> Result<(), PlantError> {
        check_joints("position", &command.position, self.joint_count)?;
        check_joints("velocity", &command.velocity, self.joint_count)?;
        check_pose(&command.world_from_base)?;
        let base = from_pose(&command.world_from_base);
        let warnings = self.solver_warnings();
        ffi::step_world(self.world.pin_mut(), &command.position, &command.velocity, &base)
            .map_err(library_error)?;
        self.last_step_solved = self.solver_warnings() == warnings;
        if !ffi::base_held(&self.world) {
            self.state.world_from_base = command.world_from_base;
        }
        self.read_state()
    }

    fn state(&self) -> &PlantState {
        &self.state
    }

    fn contacts_solved(&self) -> bool {
        self.last_step_solved
    }

    fn attach(&mut self, block: usize, link: usize) -> Result<(), PlantError> {
        ffi::attach_block(self.world.pin_mut(), block, link).map_err(library_error)?;
        self.read_attached();
        Ok(())
    }

    fn release(&mut self) {
        // The core can only fail here after a failed step, and then nothing is simulated any more.
        if ffi::release_block(self.world.pin_mut()).is_ok() {
            self.state.attached = None;
        }
    }

    fn place(&mut self, block: usize, body: &BodyState) -> Result<(), PlantError> {
        check_pose(&body.pose)?;
        check_finite("linear", body.linear_velocity.as_slice())?;
        check_finite("angular", body.angular_velocity.as_slice())?;
        let mut numbers = [0.0; 13];
        numbers[..7].copy_from_slice(&from_pose(&body.pose));
        numbers[7..10].copy_from_slice(body.linear_velocity.as_slice());
        numbers[10..].copy_from_slice(body.angular_velocity.as_slice());
        ffi::place_block(self.world.pin_mut(), block, &numbers).map_err(library_error)?;
        self.state.objects[block] = *body;
        Ok(())
    }
}

fn library_error(error: cxx::Exception) -> PlantError {
    PlantError::Library(error.what().to_owned())
}

fn check_joints(what: &'static str, values: &[f64], expected: usize) -> Result<(), PlantError> {
    if values.len() != expected {
        return Err(PlantError::WrongLength { what, got: values.len(), expected });
    }
    check_finite(what, values)
}

fn check_finite(what: &'static str, values: &[f64]) -> Result<(), PlantError> {
    match values.iter().position(|value| !value.is_finite()) {
        Some(index) => Err(PlantError::NotFinite { what, index, value: values[index] }),
        None => Ok(()),
    }
}

fn check_pose(pose: &Pose) -> Result<(), PlantError> {
    check_finite("base pose value", &from_pose(pose))
}

fn body_at_rest(pose: Pose) -> BodyState {
    BodyState { pose, linear_velocity: Vector::zeros(), angular_velocity: Vector::zeros() }
}

fn from_pose(pose: &Pose) -> [f64; 7] {
    let (p, q) = (&pose.translation, &pose.rotation);
    [p.x, p.y, p.z, q.i, q.j, q.k, q.w]
}

/// ODE keeps its quaternions normalized; normalizing again would change the last bit.
fn to_pose(n: &[f64]) -> Pose {
    let rotation = nalgebra::Quaternion::new(n[6], n[3], n[4], n[5]);
    Pose::from_parts(
        nalgebra::Translation3::new(n[0], n[1], n[2]),
        nalgebra::UnitQuaternion::new_unchecked(rotation),
    )
}

fn from_shape(shape: &Shape) -> (ffi::ShapeKind, [f64; 3]) {
    match *shape {
        Shape::Box { size } => (ffi::ShapeKind::Box, size),
        Shape::Sphere { radius } => (ffi::ShapeKind::Sphere, [radius, 0.0, 0.0]),
        Shape::Cylinder { radius, length } => (ffi::ShapeKind::Cylinder, [radius, length, 0.0]),
        Shape::Capsule { radius, length } => (ffi::ShapeKind::Capsule, [radius, length, 0.0]),
    }
}

/// Hands model, scene and settings to the core, which checks them when the world is made.
fn build_model(
    model: &ArmModel,
    scene: &Scene,
    initial_positions: &[f64],
    world_from_base: &Pose,
    options: &DynamicsOptions,
) -> Result<cxx::UniquePtr<ffi::Model>, PlantError> {
    let (solver, iterations, seed) = match options.solver {
        Solver::Direct => (ffi::Solver::Direct, 1, 0),
        Solver::Iterative { iterations, seed } => (ffi::Solver::Iterative, iterations, seed),
    };
    let settings = ffi::DynamicsSettings {
        gravity: options.gravity.into(),
        engine: match options.engine {
            PhysicsEngine::Reduced => ffi::Engine::Reduced,
            PhysicsEngine::Ode => ffi::Engine::Ode,
        },
        solver,
        iterations,
        seed: seed.into(),
        position_gain: options.position_gain,
        lock_idle_hand: options.lock_idle_hand,
        sleep: options.sleep,
        merge_attached: options.merge_attached,
        max_base_speed_m_per_s: options.max_base_speed_m_per_s,
        max_base_turn_rate_rad_per_s: options.max_base_turn_rate_rad_per_s,
        joint_cfm: options.joint_cfm,
    };
    let factor = options.mass_set.factor();
    let mut described = ffi::new_model(&settings, &from_pose(world_from_base));
    for link in &model.links {
        let (mass, pose, inertia) = match &link.inertial {
            Some(inertial) if inertial.mass > 0.0 => {
                (factor * inertial.mass, inertial.pose, inertial.inertia.map(|value| factor * value))
            }
            // Zero would mean a frame without mass, which is not what the description says.
            Some(inertial) => {
                return Err(PlantError::Model(format!(
                    "link {:?}: mass is {} kg, expected above 0",
                    link.name, inertial.mass
                )));
            }
            None => (0.0, Pose::identity(), [0.0; 6]),
        };
        ffi::add_link(described.pin_mut(), &link.name, mass, &from_pose(&pose), &inertia);
        for collision in &link.collisions {
            let (kind, size) = from_shape(&collision.shape);
            ffi::add_collision(described.pin_mut(), kind, &size, &from_pose(&collision.pose));
        }
    }
    for (index, joint) in model.joints.iter().enumerate() {
        if joint.child != index + 1 {
            return Err(PlantError::Model(format!(
                "joint {:?} moves link {}, expected {}: joints must be sorted by child",
                joint.name,
                joint.child,
                index + 1
            )));
        }
        let limits = &joint.limits;
        let effort = factor * limits.effort;
        let (proportional, derivative) = match options.control {
            JointControl::FeedForward => (0.0, 0.0),
            JointControl::OriginalGains if joint.kind == JointKind::Fixed => (0.0, 0.0),
            JointControl::OriginalGains => {
                let gains = model.settings.gains(&joint.name).ok_or_else(|| {
                    PlantError::Model(format!(
                        "joint {:?} has no gains among the controllers of its arm.toml; expected them there, or the \
                         control feed_forward",
                        joint.name
                    ))
                })?;
                (gains.p, gains.d)
            }
        };
        let (lower, upper) = match joint.kind {
            // No stops: the solvers know none beyond half a turn.
            JointKind::Continuous => (f64::NEG_INFINITY, f64::INFINITY),
            _ => (limits.lower, limits.upper),
        };
        let numbers =
            [lower, upper, limits.velocity, effort, joint.damping, joint.friction, proportional, derivative];
        let kind = match joint.kind {
            JointKind::Fixed => ffi::JointKind::Fixed,
            JointKind::Revolute | JointKind::Continuous => ffi::JointKind::Revolute,
            JointKind::Prismatic => ffi::JointKind::Prismatic,
        };
        let axis: [f64; 3] = joint.axis.into();
        let origin = from_pose(&joint.origin);
        ffi::add_joint(described.pin_mut(), &joint.name, kind, joint.parent, &origin, &axis, &numbers);
    }
    let moving: Vec<usize> = model.moving().collect();
    ffi::set_moving(described.pin_mut(), &moving, model.arm_count(), initial_positions);
    for object in &scene.fixed {
        let (kind, size) = from_shape(&object.shape);
        let pose = from_pose(&object.pose);
        ffi::add_fixed(described.pin_mut(), &object.name, kind, &size, &pose, object.friction);
    }
    for block in &scene.objects {
        let (kind, size) = from_shape(&block.shape);
        let numbers = [block.mass, block.friction, block.finger_friction];
        let pose = from_pose(&block.pose);
        ffi::add_block(described.pin_mut(), &block.name, kind, &size, &pose, &numbers);
    }
    Ok(described)
}
