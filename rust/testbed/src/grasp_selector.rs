use proact_arm::{ArmModel, ArmModelError, CLOSED_POSE, Chain, OPEN_POSE};
use proact_types::{JointVector, PlantState, Point, Scene, joints};

/// How the hand opens and closes for the object that it is about: the one nearest to the centre of the grasp for its width.
///
/// Deterministic: it depends on joints, base and objects alone. Where all objects have one grasp, it is not looked for.
#[derive(Clone, Debug)]
pub struct GraspSelector {
    chain: Chain,
    grasps: Vec<GraspHandPoses>,
    /// Position in `grasps` of each object's, in the order of the scene.
    of_object: Vec<usize>,
    /// For a hand that is about nothing.
    open: JointVector,
    closed: JointVector,
}

/// A grasp, with the angles of its hand poses.
#[derive(Clone, Debug)]
struct GraspHandPoses {
    center: Point,
    opening_m: f64,
    is_closed_grasp: bool,
    open: JointVector,
    closed: JointVector,
}

/// The object that the hand is about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearObject {
    /// Its place in the scene.
    pub object: usize,
    /// From its centre to that of its grasp, metres.
    pub distance_m: f64,
    /// It is between the fingers: nearer than the grasp's opening.
    pub is_between_fingers: bool,
    /// The hand has a grasp that is meant for its width.
    pub is_graspable: bool,
    /// Centre of its grasp, in the tip's frame.
    pub center: Point,
}

impl GraspSelector {
    /// For the hand of `model` among the objects of `scene`.
    ///
    /// # Errors
    /// A hand without the poses `open` and `closed`, or without those that a grasp names.
    pub fn new(model: &ArmModel, scene: &Scene) -> Result<Self, ArmModelError> {
        let pose = |name: &str| model.pose("hand", name).map(joints);
        let mut choice = Self {
            chain: Chain::new(model),
            grasps: Vec::new(),
            of_object: Vec::new(),
            open: pose(OPEN_POSE)?,
            closed: pose(CLOSED_POSE)?,
        };
        let mut known = Vec::new();
        for width in scene.objects.iter().map(|object| object.shape.grip_width()) {
            let (grasp, is_closed_grasp) = (model.grasp_for(width), model.grasp_for(width).fits_width(width));
            let index = known.iter().position(|k| *k == (grasp, is_closed_grasp)).unwrap_or(known.len());
            if index == known.len() {
                known.push((grasp, is_closed_grasp));
                let (open, closed) = (pose(&grasp.open_pose)?, pose(&grasp.closed_pose)?);
                let (center, opening) = (Point::from(grasp.center), grasp.capture_radius_m);
                choice.grasps.push(GraspHandPoses {
                    center,
                    opening_m: opening,
                    is_closed_grasp,
                    open,
                    closed,
                });
            }
            choice.of_object.push(index);
        }
        Ok(choice)
    }

    /// The object whose centre is nearest to the centre of its grasp; none in an empty scene.
    pub fn nearest(&self, world: &PlantState) -> Option<NearObject> {
        let arm = world.position.get(..self.chain.joint_count())?;
        let world_from_tip = world.world_from_base * self.chain.forward(arm);
        let near = |(object, (grasp, body)): (usize, (&usize, &proact_types::BodyState))| {
            let GraspHandPoses { center, opening_m: opening, is_closed_grasp, .. } = self.grasps[*grasp];
            let distance = (world_from_tip * center - Point::from(body.pose.translation.vector)).norm();
            NearObject {
                object,
                distance_m: distance,
                is_between_fingers: distance < opening,
                is_graspable: is_closed_grasp,
                center,
            }
        };
        let objects = self.of_object.iter().zip(&world.objects).enumerate().map(near);
        objects.min_by(|a, b| a.distance_m.total_cmp(&b.distance_m))
    }

    /// Centre of the grasp for an object of the scene, in the tip's frame.
    pub fn grasp_center_of(&self, object: usize) -> Option<Point> {
        self.of_object.get(object).map(|grasp| self.grasps[*grasp].center)
    }

    /// Centre of the grasp for the object that the hand is about, in the tip's frame; none in an empty scene.
    pub fn grasp_center(&self, world: &PlantState) -> Option<Point> {
        match self.grasps.as_slice() {
            [only] => Some(only.center),
            _ => self.nearest(world).map(|near| near.center),
        }
    }

    /// Angles that the hand opens to, rad.
    pub fn open_angles(&self, world: &PlantState) -> &JointVector {
        match self.grasps.as_slice() {
            [] => &self.open,
            [only] => &only.open,
            _ => {
                self.nearest(world).map_or(&self.open, |near| &self.grasps[self.of_object[near.object]].open)
            }
        }
    }

    /// Angles that the hand closes to, rad: with nothing between the fingers, those of the pose `closed`.
    pub fn closed_angles(&self, world: &PlantState) -> &JointVector {
        let near = self.nearest(world).filter(|near| near.is_between_fingers);
        near.map_or(&self.closed, |near| &self.grasps[self.of_object[near.object]].closed)
    }
}
