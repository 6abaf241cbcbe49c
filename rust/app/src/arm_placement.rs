//! Where an arm that no one wears stands, and how a trial begins with it: places about the box, tried by inverse kinematics and
//! then by a trial.

use crate::{Arm, RunOutputs, reach_map::GraspIk, run_to_end, trial};
use proact_arm::{ArmModel, Chain, ChainPoses, FixedBase, JointLimits, NamedPose, OPEN_POSE};
use proact_control::MethodRegistry;
use proact_description::{ArmFolder, Finding, settings_template, to_srdf, to_urdf};
use proact_devices::EmgOrigin;
use proact_planning::CollisionScene;
use proact_testbed::{Setup, TrialConfig};
use proact_types::{EventKind, JointVector, Obstacle, Point, Pose, Scene, Shape, Vector};
use std::{collections::BTreeMap, error::Error, path::Path, sync::atomic::AtomicBool};

/// Pose of the arm in which a trial starts.
const START_POSE: &str = "start";

/// Distances of a base from the middle of the box along x and y, and heights above the table, as shares of the arm's length.
const AHEAD: [f64; 5] = [0.35, 0.45, 0.55, 0.7, 0.85];
const ASIDE: [f64; 3] = [-0.3, 0.0, 0.3];
const ABOVE: [f64; 6] = [-0.4, -0.2, 0.0, 0.2, 0.4, 0.7];
/// No base is nearer to the middle of the box, metres: walls are there.
const MIN_AHEAD_M: f64 = 0.3;
/// Postures from which a start is sought that touches nothing.
const OTHER_STARTS: usize = 6;
/// A hand is carried so far above where it grips, metres.
const LIFT_M: f64 = 0.15;
/// Length of a trial.
const TRIAL_SECS: f64 = 100.0;
/// Length of the trial that shows that one begins.
const BEGUN_SECS: f64 = 0.1;

/// Postures in which links are looked at for contacts, and the shares from which on a contact lasts: of any two links, and of
/// neighbours.
const CONTACT_POSTURES: usize = 300;
const LASTING_SHARE: f64 = 0.5;
const NEIGHBOR_SHARE: f64 = 0.03;

/// A place for the base, and the arm's posture there.
#[derive(Clone, Debug, PartialEq)]
pub struct ArmPlacement {
    /// Where the base stands, `world`, metres.
    pub base: Point,
    /// Positions of the arm's joints at the start, rad or m.
    pub start: Vec<f64>,
    /// Of the places from which and to which blocks are moved, the share that the hand reaches.
    pub reached: f64,
    /// Blocks that a simulated person moved with method D; none if no trial could be run.
    pub blocks_moved: Option<usize>,
    /// Why the last plan of that trial was none, or why no trial could be run.
    pub reason: Option<String>,
}

/// The best place for an arm, by at most `max_trials` trials of method D: its base and start pose are then in the model. None, and nothing is changed,
/// if it reaches nothing or stands by itself already.
///
/// # Errors
/// A task that does not build.
pub fn place_arm(model: &mut ArmModel, max_trials: usize) -> Result<Option<ArmPlacement>, Box<dyn Error>> {
    if model.settings.fixed_base.is_some() {
        return Ok(None);
    }
    let config = TrialConfig::new("D", 1, Setup::named("still")?);
    let scene = config.build_task(model)?.scene().clone();
    let mut places = reachable_places(model, &scene);
    // A trial does not begin with links in each other, or in what stands there.
    let mut contacts = CollisionScene::new(model)?;
    if let Ok(open) = model.pose("hand", OPEN_POSE) {
        contacts.set_hand(open)?;
    }
    let solid = |name: &str, shape: &Shape, pose: &Pose| Obstacle {
        name: name.to_owned(),
        shape: *shape,
        pose: *pose,
        loose: false,
    };
    let fixed = scene.fixed.iter().map(|object| solid(&object.name, &object.shape, &object.pose));
    let blocks = scene.objects.iter().map(|block| solid(&block.name, &block.shape, &block.pose));
    contacts.set_obstacles(&fixed.chain(blocks).collect::<Vec<_>>())?;
    let chain = Chain::new(model);
    let width = scene.objects.first().map_or(0.05, |object| object.shape.grip_width());
    let hand = GraspIk::new(model, model.grasp_for(width).clone());
    let mut random = RandomPostures::new(&chain);
    places.retain_mut(|place| {
        let base = Pose::translation(place.base.x, place.base.y, place.base.z);
        if contacts.set_base(&base).is_err() {
            return false;
        }
        let mut is_free = |q: &[f64]| contacts.collisions(q).is_ok_and(|pairs| pairs.is_empty());
        if is_free(&place.start) {
            return true;
        }
        // Another posture for the same place of the hand, or one higher up.
        let tip = base * chain.forward(&place.start) * Point::from(hand.grasp_center());
        let others = [0.0, LIFT_M].into_iter().flat_map(|lift| std::iter::repeat_n(lift, OTHER_STARTS));
        for lift in others {
            let above = tip + Vector::z() * lift;
            if let Some(start) =
                hand.solve(&base, &above, Some(&random.next_posture())).filter(|q| is_free(q))
            {
                place.start = start.to_vec();
                return true;
            }
        }
        false
    });
    let mut places = spread_over_heights(places);
    places.truncate(max_trials);
    let mut best: Option<ArmPlacement> = None;
    for mut place in places {
        match blocks_moved(&placed(model, &place), &config) {
            Ok((count, reason)) => (place.blocks_moved, place.reason) = (Some(count), reason),
            Err(error) => place.reason = Some(error.to_string()),
        }
        let is_done = place.blocks_moved >= Some(scene.objects.len());
        if best.as_ref().is_none_or(|best| place.blocks_moved > best.blocks_moved) {
            best = Some(place);
        }
        if is_done {
            break;
        }
    }
    if let Some(best) = &best {
        *model = placed(model, best);
    }
    Ok(best)
}

/// The places to try: the best one of each height, then the second ones.
fn spread_over_heights(places: Vec<ArmPlacement>) -> Vec<ArmPlacement> {
    let mut counts: BTreeMap<i64, usize> = BTreeMap::new();
    let mut ranked: Vec<(usize, ArmPlacement)> = places
        .into_iter()
        .map(|place| {
            let count = counts.entry((place.base.z * 1e3).round() as i64).or_default();
            *count += 1;
            (*count, place)
        })
        .collect();
    ranked.sort_by_key(|(rank, _)| *rank);
    ranked.into_iter().map(|(_, place)| place).collect()
}

/// Lets links touch that always do: shapes that enclose meshes overlap where these meet. Allowed is what touches in many of the
/// postures between the joints' limits, and of links with at most two moving joints between them what touches in some. Names of
/// the pairs.
///
/// # Errors
/// A model that the planner refuses.
pub fn allow_lasting_contacts(model: &mut ArmModel) -> Result<Vec<[String; 2]>, Box<dyn Error>> {
    let mut scene = CollisionScene::new(model)?;
    let open = model.pose("hand", OPEN_POSE).map(<[f64]>::to_vec);
    if let Ok(open) = open {
        scene.set_hand(&open)?;
    }
    let chain = Chain::new(model);
    let mut random = RandomPostures::new(&chain);
    let mut counts: BTreeMap<(usize, usize), usize> = BTreeMap::new();
    for _ in 0..CONTACT_POSTURES {
        for (a, b) in scene.collisions_of_all_links(&random.next_posture())? {
            let (a, b) = (model.link(&a)?, model.link(&b)?);
            *counts.entry((a.min(b), a.max(b))).or_default() += 1;
        }
    }
    let mut allowed = Vec::new();
    for ((a, b), count) in counts {
        let share = count as f64 / CONTACT_POSTURES as f64;
        let least = if joints_between(model, a, b) <= 2 { NEIGHBOR_SHARE } else { LASTING_SHARE };
        if share >= least {
            model.allowed_collisions.push((a, b));
            allowed.push([a, b].map(|link| model.links[link].name.clone()));
        }
    }
    model.allowed_collisions.sort_unstable();
    model.allowed_collisions.dedup();
    Ok(allowed)
}

/// Moving joints on the way from one link to another.
fn joints_between(model: &ArmModel, a: usize, b: usize) -> usize {
    let above = |link: usize| -> Vec<usize> {
        std::iter::successors(link.checked_sub(1), |&joint| model.joints[joint].parent.checked_sub(1))
            .collect()
    };
    let (of_a, of_b) = (above(a), above(b));
    let moves = |joint: &&usize| model.joints[**joint].kind.moves();
    of_a.iter().filter(|joint| !of_b.contains(joint)).filter(moves).count()
        + of_b.iter().filter(|joint| !of_a.contains(joint)).filter(moves).count()
}

/// Postures of the arm between its limits, the same ones each time.
struct RandomPostures<'a> {
    chain: &'a Chain,
    state: u64,
}

impl<'a> RandomPostures<'a> {
    fn new(chain: &'a Chain) -> Self {
        Self { chain, state: 1 }
    }

    fn next_posture(&mut self) -> JointVector {
        let state = &mut self.state;
        let position = |limits: &JointLimits| {
            *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let share = (*state >> 11) as f64 / (1_u64 << 53) as f64;
            // A turn tells as much as a hundred.
            let (low, high) = (limits.lower.max(-3.2), limits.upper.min(3.2));
            low + share * (high - low)
        };
        self.chain.limits().iter().map(position).collect()
    }
}

/// `model` on `place`.
fn placed(model: &ArmModel, place: &ArmPlacement) -> ArmModel {
    let mut model = model.clone();
    model.settings.fixed_base = Some(FixedBase { xyz: place.base });
    model.poses.retain(|pose| pose.group != "arm" || pose.name != START_POSE);
    let (name, group) = (START_POSE.to_owned(), "arm".to_owned());
    model.poses.push(NamedPose { name, group, angles: place.start.clone() });
    model
}

/// Places from which the hand reaches something, those from which it reaches most first, and of these the ones whose joints are
/// farthest from their limits.
fn reachable_places(model: &ArmModel, scene: &Scene) -> Vec<ArmPlacement> {
    let chain = Chain::new(model);
    let length = reach_of(&chain);
    let width = scene.objects.first().map_or(0.05, |object| object.shape.grip_width());
    let hand = GraspIk::new(model, model.grasp_for(width).clone());
    // Each block, and its mirror image on the other side, and above both.
    let mut goals: Vec<Point> = Vec::new();
    for object in &scene.objects {
        let at = object.pose.translation.vector;
        for side in [1.0, -1.0] {
            for lift in [0.0, LIFT_M] {
                goals.push(Point::new(at.x, side * at.y, at.z + lift));
            }
        }
    }
    let middle = goals.iter().map(|goal| goal.coords).sum::<Vector>() / goals.len().max(1) as f64;
    let above = Point::new(middle.x, middle.y, scene.table_height + 2.0 * LIFT_M);
    let mut found = Vec::new();
    for ahead in AHEAD {
        for aside in ASIDE {
            for height in ABOVE {
                let base = Point::new(
                    middle.x - (ahead * length).max(MIN_AHEAD_M),
                    middle.y + aside * length,
                    (scene.table_height + height * length).max(0.0),
                );
                let pose = Pose::translation(base.x, base.y, base.z);
                let Some(start) = hand.solve(&pose, &above, None) else { continue };
                let mut last = start.clone();
                let mut margins = margin(&chain, &start);
                let mut count = 0_usize;
                for goal in &goals {
                    if let Some(q) = hand.solve(&pose, goal, Some(&last)) {
                        count += 1;
                        margins += margin(&chain, &q);
                        last = q;
                    }
                }
                let reached = count as f64 / goals.len().max(1) as f64;
                let place =
                    ArmPlacement { base, start: start.to_vec(), reached, blocks_moved: None, reason: None };
                found.push((reached + 0.2 * margins / (count + 1) as f64, place));
            }
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.into_iter().map(|(_, place)| place).filter(|place| place.reached > 0.0).collect()
}

/// Smallest distance from a limit, as a share of the joint's range, 0 to 0.5; of a joint that turns for ever, 0.5.
fn margin(chain: &Chain, q: &JointVector) -> f64 {
    let share = |(q, limits): (&f64, &JointLimits)| {
        ((q - limits.lower).min(limits.upper - q) / (limits.upper - limits.lower)).clamp(0.0, 0.5)
    };
    q.iter().zip(chain.limits()).map(share).fold(0.5, f64::min)
}

/// The arm's length, metres: the farthest of its tip from its base among postures between the limits.
fn reach_of(chain: &Chain) -> f64 {
    const POSTURES: usize = 2000;
    let mut poses = ChainPoses::default();
    let mut random = RandomPostures::new(chain);
    let mut farthest = 0.1_f64;
    for _ in 0..POSTURES {
        chain.link_poses_into(&random.next_posture(), &mut poses);
        farthest = farthest.max(poses.tip.translation.vector.norm());
    }
    farthest
}

/// What keeps a trial from beginning with an arm, if anything does: method D in the set-up `still`, for a tenth of a second.
pub fn trial_obstacle(arm: &Arm) -> Option<Finding> {
    if arm.model().hand.is_empty() {
        let remedy = "Import the file of an arm with a hand, or let proact model import mount a gripper.";
        return Some(Finding::about_trial("no block can be moved", "an arm without a hand", remedy));
    }
    let begun = Setup::named("still")
        .map_err(Into::into)
        .and_then(|setup| run_trial(arm, TrialConfig::new("D", 1, setup), BEGUN_SECS));
    let error = begun.err()?;
    let remedy = "Correct the pose \"start\" in arm.srdf or the base in arm.toml, or import the arm again.";
    Some(Finding::about_trial("no trial begins", error.to_string(), remedy))
}

/// Blocks that a simulated person moves with the arm, across or onto their targets, and why the last plan that failed did.
fn blocks_moved(model: &ArmModel, config: &TrialConfig) -> Result<(usize, Option<String>), Box<dyn Error>> {
    let folder = ArmFolder {
        name: model.name.clone(),
        urdf: to_urdf(model),
        srdf: Some(to_srdf(model)),
        settings: Some(settings_template(model)),
        meshes: BTreeMap::new(),
    };
    let arm = Arm::from_folder(folder, Path::new(&model.name), false)?;
    run_trial(&arm, config.clone(), TRIAL_SECS)
}

/// Runs a trial of a simulated person without a record.
fn run_trial(
    arm: &Arm,
    mut config: TrialConfig,
    limit_secs: f64,
) -> Result<(usize, Option<String>), Box<dyn Error>> {
    config.arm = arm.pinned();
    config.setup = config.setup.with_arm(arm.model());
    config.limit_secs = limit_secs;
    let methods = MethodRegistry::standard();
    let made = trial::simulated_trial_with_model(&methods, arm, config, &EmgOrigin::Synthetic, None)?;
    let interrupted = AtomicBool::new(false);
    let mut outputs = RunOutputs::none(&interrupted);
    let mut failure = None;
    let result = run_to_end(made.trial, None, &mut outputs, None, |step, _| {
        for event in &step.output.events {
            if let EventKind::PlanFinished { reason: Some(reason), .. } = &event.kind {
                failure = Some(reason.clone());
            }
        }
    })?;
    let outcomes = result.legacy_fields.get("outcomes").and_then(|outcomes| outcomes.as_array());
    let crossed = |entry: &&serde_json::Value| {
        entry["outcome"]
            .as_str()
            .is_some_and(|outcome| outcome.ends_with("on_target") || outcome == "crossed_off_target")
    };
    Ok((outcomes.map_or(0, |outcomes| outcomes.iter().filter(crossed).count()), failure))
}
