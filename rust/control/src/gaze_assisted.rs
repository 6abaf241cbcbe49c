use crate::jog::DoubleConfirmation;
use crate::ports::ArmKinematics;
use crate::{
    ControlInput, ControlMethod, ControlOutput, HandCommand, JointSubset, LockOnceProfile, MethodDisplay,
    MotionCommand, MotionState, PlanCommand,
};
use proact_arm::{ArmModel, Chain, ChainPoses};
use proact_types::{
    Command, HandState, MethodEvent, ObjectId, PlanGoal, PlanReply, PlanStatus, PlannerView, Point, Pose,
    SimTime, TargetView,
};

/// A base that moves less than this from one control step to the next stands still, metres and rad: 50 mm/s and
/// 3 degrees/s at 100 Hz. Plans are made for a base at rest.
const BASE_STATIONARY_M_RAD: (f64, f64) = (5e-4, 5.2e-4);
/// A target with a block this near its centre is taken, metres: the diameter of a block.
const OCCUPIED_RADIUS_M: f64 = 0.05;
/// An intermediate plan shorter than this leads nowhere, s: the arm is as near as it gets.
const MIN_INTERMEDIATE_PLAN_SECS: f64 = 0.3;

/// Methods C and D: gaze selects a block or a place, WF locks it, WE plans and moves while it is held, HC and HO
/// close and open the hand (ProACT, arXiv:2407.05025, "Gaze-assisted control" and "Context-assisted control").
///
/// C and D differ in the posterior that they are fed, not here. Beyond the paper:
/// - anything but WE stops the arm (the original stops for NM only);
/// - one WF locks, and the lock ends with its phase (the original's toggles outlive the block);
/// - WE acts on what is highlighted or locked (the original on what was locked last);
/// - a block that moves by more than its diameter meanwhile stops the motion, and is planned for where it is;
/// - WE that stays held goes on from an intermediate goal to the real one, and asks again when the base moved.
///
/// Known weakness: while WE is held and nothing is locked, the selection is that of the moment in which the plan
/// was asked for; a look at another block changes it only after the next release of WE.
#[derive(Clone, Debug)]
pub struct GazeAssisted {
    rules: LockOnceProfile,
    confirm: DoubleConfirmation,
    command: Command,
    held_object: Option<ObjectId>,
    locked_selection: Option<Selection>,
    motion_phase: MotionPhase,
    /// Where the block stood for which the plan was asked.
    planned_block_position: Option<Point>,
    /// Intermediate goals reached one after the other from one base.
    intermediates: u32,
    last_base: Option<Pose>,
    /// Of part of an arm: the whole arm, and the position of the last joint that the person's own limb has.
    residual_limb: Option<(Chain, usize)>,
    /// Seconds in which a second HO opens the hand.
    confirm_in_secs: Option<f64>,
}

/// What a plan leads to.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Selection {
    Block(ObjectId),
    Place(Point),
}

/// Where the motion stands.
#[derive(Clone, Debug, PartialEq)]
enum MotionPhase {
    /// Nothing asked for.
    Idle,
    /// A plan is in the making for this base.
    Planning { base: Pose, selection: Selection },
    /// The arm follows a plan made for this base.
    Following { base: Pose, selection: Selection, intermediate: bool, progress: f64 },
    /// The end was reached.
    Arrived { base: Pose, intermediate: bool },
    /// There was no plan for this base.
    Failed { base: Pose, status: PlanStatus, reason: String },
}

impl GazeAssisted {
    /// A method with an empty hand and nothing selected.
    pub fn new(rules: LockOnceProfile) -> Self {
        Self {
            rules,
            confirm: DoubleConfirmation::new(rules.confirm_open_ms),
            command: Command::NoMotion,
            held_object: None,
            locked_selection: None,
            motion_phase: MotionPhase::Idle,
            planned_block_position: None,
            intermediates: 0,
            last_base: None,
            residual_limb: None,
            confirm_in_secs: None,
        }
    }

    /// The same for the joints of `subset` of `model`: plans are for where the person's own limb holds them, and void once
    /// it has moved as far as a base may.
    pub fn with_residual_limb(mut self, subset: &JointSubset, model: &ArmModel) -> Self {
        let last = (0..model.arm_count()).rev().find(|joint| !subset.contains(*joint));
        self.residual_limb = last.map(|joint| (Chain::new(model), joint));
        self
    }

    /// Where what the method drives begins: at the shoulder, or at the end of the person's own limb. In `world`.
    fn base(&self, input: &ControlInput<'_>) -> Pose {
        let Some((chain, last)) =
            self.residual_limb.as_ref().filter(|(chain, _)| chain.joint_count() == input.measured.len())
        else {
            return input.world_from_base;
        };
        let mut poses = ChainPoses::default();
        chain.link_poses_into(input.measured, &mut poses);
        input.world_from_base * poses.links[*last]
    }

    /// Where WE would put the block down: where the gaze is, or the free target near it.
    fn place_point(&self, input: &ControlInput<'_>) -> Point {
        let distance = |a: &Point, b: &Point| (a.xy() - b.xy()).norm();
        let held = self.held_object.map(ObjectId::index);
        let others = || input.objects.iter().enumerate().filter(|(k, _)| Some(*k) != held);
        let taken = |center: &Point| others().any(|(_, object)| distance(object, center) < OCCUPIED_RADIUS_M);
        let free = input.targets.iter().map(|target| target.center).filter(|center| !taken(center));
        let nearest =
            free.min_by(|a, b| distance(a, &input.place_point).total_cmp(&distance(b, &input.place_point)));
        nearest
            .filter(|center| distance(center, &input.place_point) < self.rules.snap_radius_m)
            .unwrap_or(input.place_point)
    }

    /// The selection that WE would act on now.
    fn selection(&self, input: &ControlInput<'_>) -> Option<Selection> {
        self.locked_selection.or(match self.held_object {
            Some(_) => Some(Selection::Place(self.place_point(input))),
            None => input.highlight.map(Selection::Block),
        })
    }

    fn toggle_lock(&mut self, input: &ControlInput<'_>, output: &mut ControlOutput) {
        if self.locked_selection.take().is_some() {
            output.events.push(MethodEvent::Unlocked);
        } else if let Some(selection) = self.selection(input) {
            self.locked_selection = Some(selection);
            let block = match selection {
                Selection::Block(block) => Some(block),
                Selection::Place(_) => None,
            };
            output.events.push(MethodEvent::Locked { object: block });
        }
    }

    /// Ends whatever motion or planning goes on.
    fn stop(&mut self, output: &mut ControlOutput) {
        match self.motion_phase {
            MotionPhase::Planning { .. } => output.plan = Some(PlanCommand::Cancel),
            MotionPhase::Following { .. } => {
                output.motion = Some(MotionCommand::Hold);
                output.events.push(MethodEvent::MotionStopped);
            }
            // What was reached or refused stays on display until the next command.
            MotionPhase::Idle | MotionPhase::Arrived { .. } | MotionPhase::Failed { .. } => return,
        }
        self.motion_phase = MotionPhase::Idle;
    }

    fn request_plan(&mut self, input: &ControlInput<'_>, output: &mut ControlOutput) {
        let base = self.base(input);
        let refuse = |reason: &str| MotionPhase::Failed {
            base,
            status: PlanStatus::Invalid,
            reason: reason.to_owned(),
        };
        if self.held_object.is_none() && input.hand.state == HandState::Opening {
            return;
        }
        if self.held_object.is_none() && input.hand.state != HandState::Open {
            self.motion_phase = refuse("the hand is closed and empty: open it first (HO)");
            return;
        }
        let Some(selection) = self.selection(input) else {
            self.motion_phase = refuse("nothing is selected: look at a block");
            return;
        };
        let goal = match selection {
            Selection::Block(block) => PlanGoal::Pick { object: block, center: input.objects[block.index()] },
            Selection::Place(point) => PlanGoal::Place { point },
        };
        self.planned_block_position = match selection {
            Selection::Block(block) => Some(input.objects[block.index()]),
            Selection::Place(_) => None,
        };
        output.plan = Some(PlanCommand::Request(goal));
        self.motion_phase = MotionPhase::Planning { base, selection };
    }

    /// The block that the plan leads to is elsewhere by now: fallen, pushed, or taken away.
    fn has_target_moved(&self, input: &ControlInput<'_>) -> bool {
        let (MotionPhase::Planning { selection, .. } | MotionPhase::Following { selection, .. }) =
            &self.motion_phase
        else {
            return false;
        };
        let (Selection::Block(block), Some(was)) = (selection, self.planned_block_position) else {
            return false;
        };
        // Written so that a place that is no number counts as gone.
        let stays = (input.objects[block.index()] - was).norm() <= OCCUPIED_RADIUS_M;
        !stays
    }

    fn take_plan(&mut self, reply: &PlanReply, output: &mut ControlOutput) {
        let MotionPhase::Planning { base, selection } = self.motion_phase else { return };
        self.motion_phase = match reply.status {
            PlanStatus::Ok => MotionPhase::Following { base, selection, intermediate: false, progress: 0.0 },
            PlanStatus::Intermediate if reply.trajectory.duration_secs() < MIN_INTERMEDIATE_PLAN_SECS => {
                MotionPhase::Arrived { base, intermediate: true }
            }
            PlanStatus::Intermediate => {
                MotionPhase::Following { base, selection, intermediate: true, progress: 0.0 }
            }
            status => MotionPhase::Failed { base, status, reason: reply.reason.clone() },
        };
        if matches!(self.motion_phase, MotionPhase::Following { .. }) {
            output.motion = Some(MotionCommand::Follow(reply.trajectory.clone()));
        }
    }

    /// WE is held: plan, follow, and go on when the base or an intermediate goal asks for it.
    fn advance(&mut self, input: &ControlInput<'_>, base_still: bool, output: &mut ControlOutput) {
        if self.has_target_moved(input) {
            // From rest, a plan to where it is now; one that is on its way is not followed.
            self.stop(output);
            self.motion_phase = MotionPhase::Idle;
            return;
        }
        if let Some(reply) = input.plan {
            self.take_plan(reply, output);
            return;
        }
        let here = self.base(input);
        match &mut self.motion_phase {
            MotionPhase::Idle if base_still => self.request_plan(input, output),
            MotionPhase::Idle | MotionPhase::Planning { .. } => {}
            MotionPhase::Following { base, .. } if has_base_moved(&self.rules, base, &here) => {
                self.stop(output);
            }
            MotionPhase::Following { base, intermediate, progress, .. } => match input.motion {
                MotionState::Following(now) => *progress = now,
                MotionState::Finished
                    if *intermediate && self.intermediates < self.rules.max_intermediate_goals =>
                {
                    output.events.push(MethodEvent::MotionFinished);
                    self.intermediates += 1;
                    self.motion_phase = MotionPhase::Idle;
                }
                MotionState::Finished => {
                    output.events.push(MethodEvent::MotionFinished);
                    self.motion_phase = MotionPhase::Arrived { base: *base, intermediate: *intermediate };
                }
                MotionState::Holding => {}
            },
            MotionPhase::Arrived { base, intermediate: true } | MotionPhase::Failed { base, .. } => {
                if has_base_moved(&self.rules, base, &here) && base_still {
                    self.intermediates = 0;
                    self.request_plan(input, output);
                }
            }
            MotionPhase::Arrived { intermediate: false, .. } => {}
        }
    }
}

impl ControlMethod for GazeAssisted {
    fn step(
        &mut self,
        now: SimTime,
        input: &ControlInput<'_>,
        _kinematics: &mut dyn ArmKinematics,
    ) -> ControlOutput {
        let mut output = ControlOutput::default();
        let base = self.base(input);
        let base_still = self.last_base.replace(base).is_some_and(|last| {
            let step = last.inv_mul(&base);
            step.translation.vector.norm() < BASE_STATIONARY_M_RAD.0
                && step.rotation.angle() < BASE_STATIONARY_M_RAD.1
        });

        // Taking or losing a block begins a new phase, with a selection of its own.
        if input.hand.held_object != self.held_object {
            self.held_object = input.hand.held_object;
            if self.locked_selection.take().is_some() {
                output.events.push(MethodEvent::Unlocked);
            }
            self.stop(&mut output);
            self.motion_phase = MotionPhase::Idle;
        }

        let changed = input.command != self.command;
        self.command = input.command;
        if input.command != Command::WristExtension {
            self.stop(&mut output);
        }
        match input.command {
            Command::WristExtension => {
                if changed {
                    self.motion_phase = MotionPhase::Idle;
                    self.intermediates = 0;
                }
                self.advance(input, base_still, &mut output);
            }
            Command::WristFlexion if changed => self.toggle_lock(input, &mut output),
            Command::HandClose if changed => output.hand = Some(HandCommand::Close),
            Command::HandOpen if changed => {
                let granted = self.held_object.is_none() || self.confirm.is_confirmed(now);
                output.hand = granted.then_some(HandCommand::Open);
            }
            _ => {}
        }

        self.confirm_in_secs = self.confirm.remaining_secs(now);
        output.display =
            MethodDisplay { mode: None, target: self.target_view(input), planner: self.planner_view() };
        output
    }
}

impl GazeAssisted {
    fn planner_view(&self) -> PlannerView {
        match &self.motion_phase {
            MotionPhase::Idle => match self.confirm_in_secs {
                Some(secs) => PlannerView::Failed {
                    status: PlanStatus::Invalid,
                    reason: format!("HO again within {secs:.1} s opens the hand"),
                },
                None => PlannerView::Idle,
            },
            MotionPhase::Planning { .. } => PlannerView::Planning,
            MotionPhase::Following { intermediate, progress, .. } => {
                PlannerView::Executing { progress: *progress, intermediate: *intermediate }
            }
            MotionPhase::Arrived { intermediate, .. } => PlannerView::Arrived { intermediate: *intermediate },
            MotionPhase::Failed { status, reason, .. } => {
                PlannerView::Failed { status: *status, reason: reason.clone() }
            }
        }
    }
}

impl GazeAssisted {
    /// The marker shows what is locked, else what the arm moves to, else what WE would act on. The place marker
    /// is there from the start (its late appearance is the flaw that the authors fixed between their studies).
    fn target_view(&self, input: &ControlInput<'_>) -> TargetView {
        let driven = match self.motion_phase {
            MotionPhase::Planning { selection, .. } | MotionPhase::Following { selection, .. } => {
                Some(selection)
            }
            _ => None,
        };
        let shown = self.locked_selection.or(driven).or_else(|| self.selection(input));
        TargetView {
            object: match shown {
                Some(Selection::Block(block)) => Some(block),
                _ => None,
            },
            place: Some(match shown {
                Some(Selection::Place(point)) => point,
                _ => self.place_point(input),
            }),
            locked: self.locked_selection.is_some(),
            posterior: input.posterior.to_vec(),
        }
    }
}

fn has_base_moved(rules: &LockOnceProfile, from: &Pose, to: &Pose) -> bool {
    let step = from.inv_mul(to);
    step.translation.vector.norm() > rules.replan_distance_m || step.rotation.angle() > rules.replan_angle_rad
}

#[cfg(test)]
mod tests;
