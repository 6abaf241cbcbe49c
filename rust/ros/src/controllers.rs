//! The controllers of ros_control that the original loads: which joints each has, which run, what they ask for.

use crate::trajectory::{ControllerTrajectory, JointSetpoint, RawPoint, TrajectoryError};
use proact_arm::{ArmModel, JointLimits};
use proact_testbed::stages::ExternalJointTarget;
use proact_types::{JointVector, SimTime, TICK_SECS};

/// How late a goal may be reached, s (original: `goal_time` 2.0).
const DEFAULT_GOAL_TIME_SECS: f64 = 2.0;
/// How far from its end a goal may end when it says nothing itself, rad (assumed; the original sets none).
const DEFAULT_GOAL_TOLERANCE_RAD: f64 = 0.05;

/// A trajectory may wait so long for its stamp, s.
const MAX_START_DELAY_SECS: f64 = 60.0;

/// How far a joint may be off.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tolerance {
    /// rad; zero checks nothing.
    pub position: f64,
    /// rad/s; zero checks nothing.
    pub velocity: f64,
    /// rad/s^2, by what the speed changed within the last tick; zero checks nothing.
    pub acceleration: f64,
}

/// What an action asks beside its trajectory.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GoalTolerances {
    /// Per joint, on the way.
    pub path: Vec<Tolerance>,
    /// Per joint, at the end.
    pub goal: Vec<Tolerance>,
    /// s.
    pub goal_time_secs: f64,
}

impl GoalTolerances {
    /// A controller's own, for `joints` joints.
    pub fn defaults(joints: usize) -> Self {
        Self {
            path: vec![Tolerance::default(); joints],
            goal: vec![Tolerance { position: DEFAULT_GOAL_TOLERANCE_RAD, ..Tolerance::default() }; joints],
            goal_time_secs: DEFAULT_GOAL_TIME_SECS,
        }
    }
}

/// How the trajectory of a goal ended.
#[derive(Clone, Debug, PartialEq)]
pub enum GoalResult {
    /// At its end, within tolerance.
    Reached,
    /// A joint left the path; the controller holds.
    PathViolated(String),
    /// A joint was not near enough in time.
    GoalViolated(String),
}

#[derive(Clone, Debug)]
struct ActiveTrajectory {
    trajectory: ControllerTrajectory,
    started_at: SimTime,
    /// None for a plain command: it is followed as far as it goes.
    tolerances: Option<GoalTolerances>,
}

impl ActiveTrajectory {
    /// What it asks for at `time`; none without points.
    fn sample(&self, time: SimTime) -> Option<Vec<JointSetpoint>> {
        self.trajectory.sample(time.millis_since(self.started_at) as f64 * TICK_SECS)
    }
}

fn at_rest(setpoint: &JointSetpoint) -> JointSetpoint {
    JointSetpoint { position: setpoint.position, velocity: Some(0.0), acceleration: Some(0.0) }
}

/// A position controller for some of the joints.
#[derive(Clone, Debug)]
pub struct TrajectoryController {
    name: String,
    /// Positions in the order of moving joints.
    joints: Vec<usize>,
    names: Vec<String>,
    loaded: bool,
    running: bool,
    /// Somebody has commanded it, and nobody else its joints since.
    is_commanded: bool,
    desired: Vec<JointSetpoint>,
    active: Option<ActiveTrajectory>,
    /// A trajectory that waits for its stamp; what there is goes on until then.
    pending: Option<ActiveTrajectory>,
    /// Measured speeds of its joints at the last step, rad/s.
    last_velocity: Option<(SimTime, Vec<f64>)>,
}

impl TrajectoryController {
    /// Its name, such as `arm_controller`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Names of its joints.
    pub fn joint_names(&self) -> &[String] {
        &self.names
    }

    /// Positions of its joints in the order of moving joints.
    pub fn joints(&self) -> &[usize] {
        &self.joints
    }

    /// Whether it controls its joints.
    pub fn running(&self) -> bool {
        self.running
    }

    /// What it asks for now.
    pub fn desired(&self) -> &[JointSetpoint] {
        &self.desired
    }

    /// Begins a trajectory in place of whatever it does: now, or when its stamp comes, until when it goes on with what it
    /// does. One without points holds. `begin_secs` as in [`ControllerTrajectory::new`].
    ///
    /// # Errors
    /// [`TrajectoryError`]; the controller then goes on with what it did.
    pub fn follow(
        &mut self,
        named: &[String],
        points: &[RawPoint],
        begin_secs: f64,
        tolerances: Option<GoalTolerances>,
        now: SimTime,
    ) -> Result<(), TrajectoryError> {
        if points.is_empty() && tolerances.is_none() {
            self.hold();
            self.is_commanded = true;
            return Ok(());
        }
        if begin_secs > MAX_START_DELAY_SECS {
            return Err(TrajectoryError::Future { ahead: begin_secs, most: MAX_START_DELAY_SECS });
        }
        if begin_secs < TICK_SECS {
            let trajectory =
                ControllerTrajectory::new(&self.names, named, points, begin_secs, &self.desired)?;
            self.active = Some(ActiveTrajectory { trajectory, started_at: now, tolerances });
            self.pending = None;
        } else {
            let began = SimTime(now.0 + (begin_secs / TICK_SECS).round() as u64);
            let then = self.active.as_ref().and_then(|following| following.sample(began));
            let start = then.unwrap_or_else(|| self.desired.iter().map(at_rest).collect());
            let trajectory = ControllerTrajectory::new(&self.names, named, points, 0.0, &start)?;
            // The goal whose trajectory goes on until then is over: it is no more judged.
            if let Some(following) = &mut self.active {
                following.tolerances = None;
            }
            self.pending = Some(ActiveTrajectory { trajectory, started_at: began, tolerances });
        }
        self.is_commanded = true;
        Ok(())
    }

    /// Stops where it asks to be now.
    pub fn hold(&mut self) {
        (self.active, self.pending) = (None, None);
        for setpoint in &mut self.desired {
            *setpoint = at_rest(setpoint);
        }
    }

    /// Advances to `now`; answers when the trajectory of a goal has ended.
    fn step(&mut self, now: SimTime, position: &[f64], velocity: &[f64]) -> Option<GoalResult> {
        if self.pending.as_ref().is_some_and(|next| next.started_at <= now) {
            self.active = self.pending.take();
        }
        let measured: Vec<f64> = self.joints.iter().map(|joint| velocity[*joint]).collect();
        let before = self.last_velocity.replace((now, measured));
        let following = self.active.as_ref()?;
        let elapsed = now.millis_since(following.started_at) as f64 * TICK_SECS;
        if let Some(desired) = following.sample(now) {
            self.desired = desired;
        }
        let over = elapsed - following.trajectory.duration_secs();
        let Some(tolerances) = &following.tolerances else {
            if over >= 0.0 {
                self.active = None;
            }
            return None;
        };
        let off = |limits: &[Tolerance]| {
            self.joints.iter().enumerate().zip(limits).find_map(|((k, joint), limit)| {
                let setpoint = &self.desired[k];
                let by = (setpoint.position - position[*joint]).abs();
                let speed = (setpoint.velocity.unwrap_or(0.0) - velocity[*joint]).abs();
                // After a pause nobody knows.
                let known = before.as_ref().filter(|(at, _)| now.millis_since(*at) == 1);
                let pull = known.map_or(0.0, |(_, before)| {
                    let measured = (velocity[*joint] - before[k]) / TICK_SECS;
                    (setpoint.acceleration.unwrap_or(0.0) - measured).abs()
                });
                let bad = (limit.position > 0.0 && by > limit.position)
                    || (limit.velocity > 0.0 && speed > limit.velocity)
                    || (limit.acceleration > 0.0 && pull > limit.acceleration);
                bad.then(|| {
                    format!("{} is {by:.4} rad, {speed:.4} rad/s and {pull:.3} rad/s^2 off", self.names[k])
                })
            })
        };
        let ending = if over < 0.0 {
            off(&tolerances.path).map(GoalResult::PathViolated)
        } else {
            match off(&tolerances.goal) {
                None => Some(GoalResult::Reached),
                Some(why) if over > tolerances.goal_time_secs => Some(GoalResult::GoalViolated(why)),
                Some(_) => None,
            }
        };
        if ending.is_some() {
            self.active = None;
        }
        if matches!(ending, Some(GoalResult::PathViolated(_))) {
            self.hold();
        }
        ending
    }
}

/// Why controllers could not be switched.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SwitchError {
    /// There is none of that name.
    #[error("there is no controller {name:?}; expected one of {known}")]
    Unknown {
        /// As asked for.
        name: String,
        /// Those there are.
        known: String,
    },
    /// It was not loaded.
    #[error("controller {name:?} is not loaded; call load_controller first")]
    NotLoaded {
        /// As asked for.
        name: String,
    },
    /// Another running controller has one of its joints.
    #[error("{name} and {other} would both control {joint}; stop {other} in the same call")]
    Conflict {
        /// The one to start.
        name: String,
        /// The one that runs.
        other: String,
        /// A joint of both.
        joint: String,
    },
}

/// The controllers and the joint angles that they ask for together.
#[derive(Clone, Debug)]
pub struct Controllers {
    list: Vec<TrajectoryController>,
    limits: Vec<JointLimits>,
    /// What the joints are asked for now: a controller's wish within the limits of angle and speed.
    position: JointVector,
    velocity: JointVector,
}

impl Controllers {
    /// `arm_controller` and `hand_controller` running, `j0_controller` to `j6_controller` known but not loaded,
    /// all joints held at `start` (moving joints of `model`).
    pub fn new(model: &ArmModel, start: &JointVector) -> Self {
        let names: Vec<&str> = model.moving().map(|j| model.joints[j].name.as_str()).collect();
        let make = |name: String, joints: Vec<usize>, loaded: bool| TrajectoryController {
            name,
            names: joints.iter().map(|&j| names[j].to_owned()).collect(),
            desired: joints
                .iter()
                .map(|&j| JointSetpoint { position: start[j], velocity: Some(0.0), acceleration: Some(0.0) })
                .collect(),
            joints,
            loaded,
            running: loaded,
            is_commanded: false,
            active: None,
            pending: None,
            last_velocity: None,
        };
        let arm = model.arm_count();
        let mut list = vec![
            make("arm_controller".to_owned(), (0..arm).collect(), true),
            make("hand_controller".to_owned(), (arm..model.moving_count()).collect(), true),
        ];
        list.extend((0..arm).map(|j| make(format!("j{j}_controller"), vec![j], false)));
        Self {
            list,
            limits: model.moving().map(|j| model.joints[j].limits).collect(),
            position: start.clone(),
            velocity: start.iter().map(|_| 0.0).collect(),
        }
    }

    /// All of them.
    pub fn list(&self) -> &[TrajectoryController] {
        &self.list
    }

    /// `running`, `stopped`, or none when it is not loaded.
    pub fn state(&self, name: &str) -> Option<&'static str> {
        let controller = self.list.iter().find(|c| c.name == name && c.loaded)?;
        Some(if controller.running { "running" } else { "stopped" })
    }

    /// The controller called `name`.
    pub fn get_mut(&mut self, name: &str) -> Option<&mut TrajectoryController> {
        self.list.iter_mut().find(|c| c.name == name)
    }

    /// Angles asked of the moving joints, rad.
    pub fn position(&self) -> &JointVector {
        &self.position
    }

    /// Speeds that go with them, rad/s.
    pub fn velocity(&self) -> &JointVector {
        &self.velocity
    }

    /// Loads a controller; true unless there is none of that name or it is loaded already.
    pub fn load(&mut self, name: &str) -> bool {
        self.get_mut(name).is_some_and(|c| !std::mem::replace(&mut c.loaded, true))
    }

    /// Unloads a controller that does not run.
    pub fn unload(&mut self, name: &str) -> bool {
        self.get_mut(name).is_some_and(|c| !c.running && std::mem::replace(&mut c.loaded, false))
    }

    /// Stops and starts controllers in one tick. `strict` changes nothing when anything is wrong; otherwise what is
    /// wrong is left out. Answers the names that stopped, and the first thing that was left out.
    ///
    /// # Errors
    /// The first thing that is wrong, if `strict`.
    pub fn switch(
        &mut self,
        start: &[String],
        stop: &[String],
        strict: bool,
    ) -> Result<(Vec<String>, Option<SwitchError>), SwitchError> {
        let before = self.clone();
        let mut first_error = None;
        let mut stopped = Vec::new();
        for name in stop {
            match self.loaded_index(name) {
                Ok(k) => {
                    if std::mem::replace(&mut self.list[k].running, false) {
                        self.list[k].hold();
                        stopped.push(name.clone());
                    }
                }
                Err(error) => first_error = first_error.or(Some(error)),
            }
        }
        for name in start {
            match self.loaded_index(name).and_then(|k| self.check_joints_free(k).map(|()| k)) {
                Ok(k) if !self.list[k].running => {
                    let controller = &mut self.list[k];
                    controller.running = true;
                    for (setpoint, joint) in controller.desired.iter_mut().zip(&controller.joints) {
                        setpoint.position = self.position[*joint];
                    }
                    controller.hold();
                }
                Ok(_) => {}
                Err(error) => first_error = first_error.or(Some(error)),
            }
        }
        match first_error {
            Some(error) if strict => {
                *self = before;
                Err(error)
            }
            left_out => Ok((stopped, left_out)),
        }
    }

    fn loaded_index(&self, name: &str) -> Result<usize, SwitchError> {
        let k = self.list.iter().position(|c| c.name == name).ok_or_else(|| SwitchError::Unknown {
            name: name.to_owned(),
            known: self.list.iter().map(|c| c.name.as_str()).collect::<Vec<_>>().join(", "),
        })?;
        if self.list[k].loaded { Ok(k) } else { Err(SwitchError::NotLoaded { name: name.to_owned() }) }
    }

    fn check_joints_free(&self, k: usize) -> Result<(), SwitchError> {
        let one = &self.list[k];
        for other in self.list.iter().filter(|c| c.running && c.name != one.name) {
            if let Some(shared) = one.joints.iter().position(|j| other.joints.contains(j)) {
                return Err(SwitchError::Conflict {
                    name: one.name.clone(),
                    other: other.name.clone(),
                    joint: one.names[shared].clone(),
                });
            }
        }
        Ok(())
    }

    /// Joints of `range` are commanded by something else from now on: trajectories of controllers that have one of them
    /// are over.
    pub fn release_joints(&mut self, range: std::ops::Range<usize>) {
        for controller in self.list.iter_mut().filter(|c| c.joints.iter().any(|j| range.contains(j))) {
            controller.hold();
            controller.is_commanded = false;
        }
    }

    /// What the joints were asked for in the end, rad. A controller that drives none follows it, so that its next
    /// trajectory begins there.
    pub fn sync_to_targets(&mut self, position: &[f64]) {
        self.position.copy_from_slice(position);
        self.velocity.iter_mut().for_each(|v| *v = 0.0);
        for controller in self.list.iter_mut().filter(|c| !c.is_commanded) {
            for (setpoint, joint) in controller.desired.iter_mut().zip(&controller.joints) {
                *setpoint = JointSetpoint {
                    position: position[*joint],
                    velocity: Some(0.0),
                    acceleration: Some(0.0),
                };
            }
        }
    }

    /// The joints that controllers drive, with the targets of the last step.
    pub fn joint_targets(&self) -> Vec<ExternalJointTarget> {
        let drive = |controller: &&TrajectoryController| controller.running && controller.is_commanded;
        let joints = self.list.iter().filter(drive).flat_map(|controller| controller.joints.iter().copied());
        let target = |joint| ExternalJointTarget {
            joint,
            position: self.position[joint],
            velocity: self.velocity[joint],
        };
        joints.map(target).collect()
    }

    /// Advances all running controllers to `now`. Answers the goals' trajectories that ended, by controller.
    pub fn step(&mut self, now: SimTime, position: &[f64], velocity: &[f64]) -> Vec<(String, GoalResult)> {
        let mut endings = Vec::new();
        for controller in self.list.iter_mut().filter(|c| c.running && c.is_commanded) {
            if let Some(ending) = controller.step(now, position, velocity) {
                endings.push((controller.name.clone(), ending));
            }
            for (setpoint, &joint) in controller.desired.iter().zip(&controller.joints) {
                let limits = &self.limits[joint];
                let max_step = limits.velocity * TICK_SECS;
                let within = setpoint.position.clamp(limits.lower, limits.upper);
                let step = (within - self.position[joint]).clamp(-max_step, max_step);
                self.position[joint] += step;
                self.velocity[joint] = step / TICK_SECS;
            }
        }
        endings
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn controllers() -> Controllers {
        let one = |name: &str| TrajectoryController {
            name: name.to_owned(),
            names: vec![],
            joints: vec![],
            desired: vec![],
            active: None,
            pending: None,
            last_velocity: None,
            loaded: true,
            running: true,
            is_commanded: false,
        };
        let list = vec![one("arm_controller"), one("hand_controller")];
        Controllers {
            list,
            limits: vec![],
            position: JointVector::default(),
            velocity: JointVector::default(),
        }
    }

    #[test]
    fn best_effort_tells_what_stopped_beside_what_it_left_out_and_strict_changes_nothing() {
        let stop = ["arm_controller".to_owned(), "nonsense".to_owned()];
        let mut all = controllers();
        assert!(all.switch(&[], &stop, true).is_err());
        assert!(all.list[0].running);
        let (stopped, left_out) = all.switch(&[], &stop, false).unwrap();
        assert_eq!(stopped, ["arm_controller"]);
        assert!(matches!(left_out, Some(SwitchError::Unknown { name, .. }) if name == "nonsense"));
        assert!(!all.list[0].running && all.list[1].running);
    }

    /// One joint that is where it is asked to be, but for what `measured` makes of position and speed.
    fn run(
        controller: &mut TrajectoryController,
        ticks: std::ops::RangeInclusive<u64>,
        measured: impl Fn(u64, JointSetpoint) -> (f64, f64),
    ) -> Vec<(u64, f64, Option<GoalResult>)> {
        let mut seen = Vec::new();
        for tick in ticks {
            let setpoint = controller.desired[0];
            let (position, velocity) = measured(tick, setpoint);
            let ending = controller.step(SimTime(tick), &[position], &[velocity]);
            seen.push((tick, controller.desired[0].position, ending));
        }
        seen
    }

    fn elbow() -> TrajectoryController {
        let mut controller = controllers().list.remove(0);
        controller.names = vec!["elbow".to_owned()];
        controller.joints = vec![0];
        controller.desired =
            vec![JointSetpoint { position: 0.0, velocity: Some(0.0), acceleration: Some(0.0) }];
        controller
    }

    fn to(position: f64, time_secs: f64) -> RawPoint {
        RawPoint { positions: vec![position], velocities: vec![0.0], time_secs, ..RawPoint::default() }
    }

    fn as_asked(_: u64, setpoint: JointSetpoint) -> (f64, f64) {
        (setpoint.position, setpoint.velocity.unwrap_or(0.0))
    }

    #[test]
    fn a_trajectory_with_a_stamp_ahead_waits_for_it_and_what_there_is_goes_on() {
        let named = ["elbow".to_owned()];
        let goal = || Some(GoalTolerances::defaults(1));
        let mut waiting = elbow();
        waiting.follow(&named, &[to(1.0, 1.0)], 0.5, goal(), SimTime(0)).unwrap();
        let seen = run(&mut waiting, 1..=1600, as_asked);
        assert!(
            seen.iter().all(|(tick, setpoint, _)| (*tick <= 500) == (*setpoint == 0.0)),
            "it waits, then moves"
        );
        let ended: Vec<u64> = seen.iter().filter(|(_, _, e)| e.is_some()).map(|(tick, ..)| *tick).collect();
        assert_eq!(ended.first(), Some(&1500), "half a second later than without a stamp");

        // A second one that begins half way through the first takes over there, without a step.
        let mut busy = elbow();
        busy.follow(&named, &[to(1.0, 1.0)], 0.0, goal(), SimTime(0)).unwrap();
        run(&mut busy, 1..=100, as_asked);
        busy.follow(&named, &[to(0.0, 1.0)], 0.4, goal(), SimTime(100)).unwrap();
        let seen = run(&mut busy, 101..=1600, as_asked);
        let largest = seen.windows(2).map(|pair| (pair[1].1 - pair[0].1).abs()).fold(0.0, f64::max);
        assert!(largest < 0.003, "a step of {largest} rad");
        let highest = seen.iter().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
        assert!(highest.0 > 500 && highest.1 > 0.5 && highest.1 < 0.9, "{highest:?}");
        let ended: Vec<u64> = seen.iter().filter(|(_, _, e)| e.is_some()).map(|(tick, ..)| *tick).collect();
        assert_eq!(ended, [1500], "the goal that it took the place of is judged no more");

        // A stamp of another clock is refused with the way out, and a hold forgets what waits.
        let error = busy.follow(&named, &[to(1.0, 1.0)], 1.7e9, goal(), SimTime(1600)).unwrap_err();
        assert!(error.to_string().contains("/use_sim_time"), "{error}");
        busy.follow(&named, &[to(1.0, 1.0)], 0.2, goal(), SimTime(1600)).unwrap();
        busy.hold();
        assert!(
            run(&mut busy, 1601..=2500, as_asked)
                .iter()
                .all(|(_, setpoint, e)| *setpoint < 0.01 && e.is_none())
        );
    }

    #[test]
    fn a_joint_that_is_jerked_off_its_path_violates_a_tolerance_of_acceleration_alone() {
        let named = ["elbow".to_owned()];
        let follow = |acceleration: f64| {
            let mut controller = elbow();
            let path = vec![Tolerance { acceleration, ..Tolerance::default() }];
            let tolerances = GoalTolerances { path, ..GoalTolerances::defaults(1) };
            controller.follow(&named, &[to(1.0, 2.0)], 0.0, Some(tolerances), SimTime(0)).unwrap();
            // At 700 ms its speed changes by 0.02 rad/s within a tick, which is 20 rad/s^2.
            let jerked = |tick: u64, setpoint: JointSetpoint| {
                let (position, velocity) = as_asked(tick, setpoint);
                (position, velocity + if tick == 700 { 0.02 } else { 0.0 })
            };
            let seen = run(&mut controller, 1..=1900, jerked);
            seen.into_iter().find_map(|(tick, _, ending)| Some((tick, ending?)))
        };
        assert_eq!(follow(0.0), None, "nothing is asked for");
        assert_eq!(follow(25.0), None, "it is within");
        match follow(15.0) {
            Some((700, GoalResult::PathViolated(text))) => assert!(text.contains("rad/s^2"), "{text}"),
            other => panic!("{other:?}"),
        }
    }
}
