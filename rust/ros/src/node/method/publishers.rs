//! What the method says to the person, the hand, and rviz.

use crate::{
    frames::WORLD,
    messages::{
        geometry_msgs::PoseStamped,
        moveit_msgs::MotionPlanRequest,
        mpl_control::graspActionGoal,
        proact_msgs::{Command as CommandMessage, View},
        std_msgs::{Bool, Int8, String as Text},
    },
    node::{NodeError, RosGraph, convert, plan_request, wire::MethodStatus},
    publishing::Publisher,
};
use proact_arm::ArmModel;
use proact_control::HandCommand;
use proact_messages::original;
use proact_messages::original::relative;
use proact_types::{PlanRequest, Pose, Scene, SimTime};
use rosrust::error::Result;

/// The method's topics.
pub(super) struct MethodPublishers {
    mode: Publisher<Int8>,
    success: Publisher<Bool>,
    frozen: Publisher<Bool>,
    current_block: Publisher<Text>,
    place: Publisher<PoseStamped>,
    view: Publisher<View>,
    command: Publisher<CommandMessage>,
    request: Publisher<MotionPlanRequest>,
    grasp: Publisher<graspActionGoal>,
    goal_count: u64,
    last_mode: Option<u8>,
}

impl MethodPublishers {
    pub(super) fn new(graph: &RosGraph) -> std::result::Result<Self, NodeError> {
        Ok(Self {
            mode: graph.advertise(relative::MODE, 1, true)?,
            success: graph.advertise(relative::SUCCESS, 1, false)?,
            frozen: graph.advertise(relative::SELECTION_FROZEN, 1, false)?,
            current_block: graph.advertise(relative::CURRENT_BLOCK, 1, false)?,
            place: graph.advertise(relative::PLACE_LOCATION, 1, false)?,
            view: graph.advertise("proact/method", 1, false)?,
            command: graph.advertise("proact/command", 100, false)?,
            request: graph.advertise(relative::PLAN_REQUEST, 1, false)?,
            grasp: graph.advertise(relative::GRASP_GOAL, 1, false)?,
            goal_count: 0,
            last_mode: None,
        })
    }

    pub(super) fn publish_frozen(&self, locked: bool) -> Result<()> {
        self.frozen.send(Bool { data: locked })
    }

    pub(super) fn publish_success(&self, closed: bool) -> Result<()> {
        self.success.send(Bool { data: closed })
    }

    /// Tells what the planner is asked.
    pub(super) fn publish_plan_request(
        &self,
        model: &ArmModel,
        request: &PlanRequest,
        stamp: SimTime,
    ) -> Result<()> {
        self.request.send(plan_request::message(model, request, stamp))
    }

    /// Says what the method asks for, in full.
    pub(super) fn publish_command(&self, command: CommandMessage) -> Result<()> {
        self.command.send(command)
    }

    /// Sends the hand a goal.
    pub(super) fn publish_grasp_goal(&mut self, command: HandCommand, stamp: SimTime) -> Result<()> {
        self.goal_count += 1;
        let id = format!("{}-{}-{}", rosrust::name(), std::process::id(), self.goal_count);
        let mut goal = graspActionGoal { header: convert::header(stamp, ""), ..Default::default() };
        goal.goal_id.stamp = convert::time(stamp);
        goal.goal_id.id = id;
        goal.goal.instruct = match command {
            HandCommand::Close => 1,
            HandCommand::Open => 2,
        };
        self.grasp.send(goal)
    }

    /// Tells what there is to see.
    pub(super) fn publish_status(
        &mut self,
        stamp: SimTime,
        scene: &Scene,
        view: &MethodStatus,
    ) -> Result<()> {
        let mode = view.mode.as_ref().map(|mode| original::mode_number(mode.controlled_dof));
        if let Some(number) = mode.filter(|_| mode != self.last_mode) {
            self.last_mode = mode;
            self.mode.send(Int8 { data: number as i8 })?;
        }
        let marked = view.target.object.filter(|_| view.hand.held_object.is_none());
        if let Some(object) = marked.and_then(|id| scene.objects.get(id.index())) {
            self.current_block.send(Text { data: object.ros_name.clone() })?;
        }
        if let Some(place_point) = view.target.place {
            let pose = Pose::translation(place_point.x, place_point.y, place_point.z);
            self.place.send(convert::pose_stamped(stamp, WORLD, &pose))?;
        }
        self.view.send(View {
            header: convert::header(stamp, WORLD),
            json: serde_json::to_string(view).unwrap_or_default(),
        })
    }
}
