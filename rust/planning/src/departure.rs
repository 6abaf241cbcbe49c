//! Off the start: what the hand is around or touches is left by a straight way before any search begins.

use crate::axis_ik::{self, IkGoal};
use crate::context::{ClearanceMode, PlanningContext};
use crate::failure::PlanFailure;
use crate::problem::PlanProblem;
use crate::{PlannerOptions, PlanningError};
use nalgebra::Unit;
use proact_arm::Grasp;
use proact_types::{Obstacle, PlanGoal, PlanStatus, Point, Pose, Shape, Vector};

/// Leaves the start. Settings as in [`PlannerOptions`], metres.
pub(crate) struct DeparturePlanner {
    lift_height_m: f64,
    retreat_height_m: f64,
    start_contact_tolerance_m: f64,
}

/// What the hand touches at the start.
struct StartContacts<'a> {
    /// Pairs that touch.
    contact_pairs: Vec<(String, String)>,
    /// Those of them that press into each other.
    penetrating_pairs: Vec<(String, String)>,
    /// Blocks between the fingers, which the hand may touch on its way out.
    objects_in_hand: Vec<String>,
    /// What the hand may push aside.
    loose_objects: &'a [String],
    /// The links of the hand that may, and what is in it.
    pushing_links: Vec<&'a str>,
}

/// A contact this deep is still a touch, metres: what is touched at the start may go on being touched.
const FINGERTIP_COMPLIANCE_M: f64 = 0.003;
/// Longest straight way that is tried in order to get clear of contacts at the start, metres.
const MAX_DEPARTURE_M: f64 = 0.14;

impl StartContacts<'_> {
    /// True if `pair` may touch on the way out whether it touched at the start or not.
    fn allows_contact(&self, pair: &(String, String)) -> bool {
        self.objects_in_hand.contains(&pair.1)
            || (self.loose_objects.contains(&pair.1) && self.pushing_links.contains(&pair.0.as_str()))
    }

    /// The part of a way out from its start to the first point, at least `wanted` metres on, that is clear for
    /// transit; if there is none that far, to the last clear one. The flag says that `wanted` was covered. `blocked` keeps the
    /// first pair that was in the way.
    fn clear_prefix(
        &self,
        context: &mut PlanningContext,
        line: &[Vec<f64>],
        wanted: f64,
        blocked: &mut Option<(String, String)>,
    ) -> Result<(Vec<Vec<f64>>, bool), PlanFailure> {
        let mut clear_at = None;
        let enough =
            axis_ik::line_steps(wanted.max(MAX_DEPARTURE_M)) as f64 * wanted / wanted.max(MAX_DEPARTURE_M);
        for (k, q) in line.iter().enumerate() {
            context.check_interrupt()?;
            context.set_clearance(ClearanceMode::Transit)?;
            if context.scene.is_free(q)? {
                clear_at = Some(k);
                if k as f64 >= enough - 1e-9 {
                    return Ok((line[..=k].to_vec(), true));
                }
                continue;
            }
            // Nothing new is touched, and what is touched is not pressed into.
            context.scene.set_padding(0.0)?;
            if context.scene.is_free(q)? {
                continue;
            }
            let is_new =
                |pair: &(String, String)| !self.contact_pairs.contains(pair) && !self.allows_contact(pair);
            let mut hit = context.scene.collisions(q)?.into_iter().find(is_new);
            if hit.is_none() {
                context.scene.set_padding(-FINGERTIP_COMPLIANCE_M)?;
                let is_new = |pair: &(String, String)| {
                    !self.penetrating_pairs.contains(pair) && !self.allows_contact(pair)
                };
                hit = context.scene.collisions(q)?.into_iter().find(is_new);
            }
            if let Some(hit) = hit {
                blocked.get_or_insert(hit);
                break;
            }
        }
        Ok((clear_at.map_or_else(Vec::new, |k| line[..=k].to_vec()), false))
    }
}

impl DeparturePlanner {
    pub fn new(options: &PlannerOptions) -> Self {
        Self {
            lift_height_m: options.lift_height_m,
            retreat_height_m: options.retreat_height_m,
            start_contact_tolerance_m: options.start_contact_tolerance_m,
        }
    }

    /// From the start to where the search may begin: straight up while the hand is around a block, touches
    /// something, or carries an object that stands on the table; otherwise the start alone.
    pub fn path(
        &self,
        context: &mut PlanningContext,
        problem: &PlanProblem,
    ) -> Result<Vec<Vec<f64>>, PlanFailure> {
        let request = problem.request;
        let mut path = vec![request.start.to_vec()];
        if problem.start != path[0] {
            path.push(problem.start.clone());
        }
        context.set_clearance(ClearanceMode::Transit)?;
        let stands_clear = context.scene.is_free(&problem.start)?;
        let base_from_tip = context.kinematics.forward(&problem.start).map_err(PlanningError::from)?;
        let world_from_tip = request.world_from_base * base_from_tip;
        let Grasp { center, capture_radius_m: opening, withdrawal_direction: withdrawal, .. } =
            &problem.grasp;
        let grasp_center = Point::from(*center);
        let world_grasp = world_from_tip * grasp_center;
        let is_in_hand = |o: &&Obstacle| {
            (o.pose.translation.vector - world_grasp.coords).norm() < *opening && thickness(&o.shape) < 0.1
        };
        let in_hand: Vec<String> = match request.attached {
            Some(_) => Vec::new(),
            None => request.obstacles.iter().filter(is_in_hand).map(|o| o.name.clone()).collect(),
        };
        let around_block = !in_hand.is_empty();
        let carries = matches!(request.goal, PlanGoal::Place { .. });
        if stands_clear && !around_block && !carries {
            return Ok(path);
        }
        self.refuse_deep_contact(context, problem)?;

        context.scene.set_padding(0.0)?;
        let touching = context.scene.collisions(&problem.start)?;
        context.scene.set_padding(-FINGERTIP_COMPLIANCE_M)?;
        let pressed = context.scene.collisions(&problem.start)?;
        let model = context.model.clone();
        let fingers = model.hand.iter().map(|&joint| model.links[model.joints[joint].child].name.as_str());
        let pushing = fingers.chain(request.attached.as_ref().map(|object| object.name.as_str())).collect();
        let start_contacts = StartContacts {
            contact_pairs: touching,
            penetrating_pairs: pressed,
            objects_in_hand: in_hand,
            loose_objects: &problem.loose_obstacles,
            pushing_links: pushing,
        };
        let (point, wanted) = match &request.attached {
            Some(object) => (Point::from(object.tip_from_object.translation.vector), self.lift_height_m),
            None => (grasp_center, if around_block { self.retreat_height_m } else { 0.0 }),
        };
        let mut best: Option<Vec<Vec<f64>>> = None;
        let mut blocked = None;
        for direction in departure_directions(&problem.up, &base_from_tip, withdrawal) {
            let reach = IkGoal {
                point,
                axis: base_from_tip.rotation.inverse() * problem.up,
                target: base_from_tip * point,
                direction: problem.up,
                orientation: None,
                tolerance: context.goal_tolerance,
            };
            let along = direction * wanted.max(MAX_DEPARTURE_M);
            let line =
                axis_ik::straight_line(&context.chain, &context.limits, &reach, &along, &problem.start);
            let (free, covered) = start_contacts.clear_prefix(context, &line, wanted, &mut blocked)?;
            let better = best.as_ref().is_none_or(|b| free.len() > b.len());
            if !free.is_empty() && better {
                best = Some(free);
            }
            if covered {
                break;
            }
        }
        match best {
            Some(line) => {
                path.extend(line.into_iter().skip(1));
                Ok(path)
            }
            None => {
                context.set_clearance(ClearanceMode::Transit)?;
                let touching = context.scene.collisions(&problem.start)?.into_iter().next();
                let reason = match (touching, blocked) {
                    (Some((a, b)), _) => {
                        format!("The arm touches something and finds no straight way off it: {a} and {b}.")
                    }
                    (None, Some((a, b))) => {
                        format!("Something is in the straight way off the start: {a} and {b}.")
                    }
                    (None, None) => {
                        let what = start_contacts
                            .objects_in_hand
                            .first()
                            .or(request.attached.as_ref().map(|o| &o.name));
                        let what = what.map_or("the start", String::as_str);
                        let hand = &model.links[model.tip].name;
                        format!("{hand} finds no straight way off {what}: the arm is at its limits.")
                    }
                };
                Err(PlanFailure::new(PlanStatus::StartInCollision, reason))
            }
        }
    }

    /// A start that is farther inside an obstacle than a graze is refused: pulling a hand out of a wall is no
    /// plan. Obstacles too thin to tell are left to the way out.
    fn refuse_deep_contact(
        &self,
        context: &mut PlanningContext,
        problem: &PlanProblem,
    ) -> Result<(), PlanFailure> {
        let depth = self.start_contact_tolerance_m;
        context.scene.set_padding(-depth)?;
        let deep = context.scene.collisions(&problem.start)?.into_iter().find(|(_, b)| {
            let obstacle = problem.request.obstacles.iter().find(|o| o.name == *b);
            obstacle.is_some_and(|o| !o.loose && thickness(&o.shape) > 2.2 * depth)
        });
        match deep {
            Some((a, b)) => Err(PlanFailure::new(
                PlanStatus::StartInCollision,
                format!("The arm starts deep inside something: {a} and {b}."),
            )),
            None => Ok(()),
        }
    }
}

/// Directions in which a contact may be left, base frame: straight up first, then up and back towards the
/// person, then up and where the hand comes off best.
fn departure_directions(up: &Vector, base_from_tip: &Pose, withdrawal: &Vector) -> Vec<Vector> {
    let back = -base_from_tip.translation.vector;
    let level = back - up * up.dot(&back);
    let off = base_from_tip.rotation * withdrawal;
    [Some(*up), mean_direction(up, &level), mean_direction(up, &off)].into_iter().flatten().collect()
}

fn mean_direction(up: &Vector, aside: &Vector) -> Option<Vector> {
    let aside = Unit::try_new(*aside, 1e-6)?;
    Unit::try_new(up + 0.7 * aside.into_inner(), 1e-6).map(Unit::into_inner)
}

/// Smallest extent of a shape, metres.
fn thickness(shape: &Shape) -> f64 {
    match *shape {
        Shape::Box { size } => size[0].min(size[1]).min(size[2]),
        Shape::Sphere { radius } => 2.0 * radius,
        Shape::Cylinder { radius, length } => (2.0 * radius).min(length),
        Shape::Capsule { radius, .. } => 2.0 * radius,
    }
}
