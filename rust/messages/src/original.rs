//! The original's names: topics, models and numbers that programs written for it expect. No other part of the program
//! spells them out; what is not the original's gets names made in the same way.

use proact_types::ControlledDof;

/// The arm's model, and the namespace of its controllers: of whatever arm, since programs that were written for the original
/// look for this one.
pub const ARM_MODEL: &str = "mpl_right_arm";

/// Each topic twice: in [`topic`] from the root, as it stands in a bag and in rosbridge's messages; in [`relative`] as a
/// node asks for it, so that a launch file can put the node into a namespace.
macro_rules! topics {
    ($($(#[$meaning:meta])* $name:ident = $words:literal;)*) => {
        /// The original's topics, from the root.
        pub mod topic {
            $($(#[$meaning])* pub const $name: &str = concat!("/", $words);)*
        }
        /// The original's topics, relative to a node's namespace.
        pub mod relative {
            $($(#[$meaning])* pub const $name: &str = $words;)*
        }
    };
}

topics! {
    /// The gesture that was decided.
    EMG = "emg";
    /// The object that is meant.
    BLOCK_ID = "block_id";
    /// The object that is locked.
    CURRENT_BLOCK = "current_block";
    /// What is moved: [`super::mode_number`].
    MODE = "mode";
    /// Whether the hand is closed.
    SUCCESS = "success";
    /// Whether the object is locked.
    SELECTION_FROZEN = "selection_frozen";
    /// Where the object in hand is to be put.
    PLACE_LOCATION = "place_location_selected";
    /// The eye, in the axes of the headset.
    GAZE_POSITION = "gaze_position";
    /// Where it looks, in the axes of the headset.
    GAZE_DIRECTION = "gaze_direction";
    /// The eye, in `world`.
    GAZE_POSITION_ROS = "gaze_position_ros";
    /// Where it looks, in `world`.
    GAZE_DIRECTION_ROS = "gaze_direction_ros";
    /// Where the gaze meets the table.
    GAZE_HIT = "gaze_table_hit_location";
    /// The same before it is filtered.
    GAZE_HIT_LOGGING = "gaze_table_hit_location_logging";
    /// The headset, in its own axes.
    HEAD = "hololens/head";
    /// The headset, in `world`.
    HEAD_ROS = "hololens_unity_camera_pose_ros";
    /// The world, as the headset draws it.
    WORLD_POSE = "rosworld_pose_msg";
    /// The tracked shoulder.
    SHOULDER = "Shoulderpad_filtered_pose";
    /// A joystick.
    JOY = "joy";
    /// The joints, by alphabet.
    JOINT_STATES = "mpl_right_arm/joint_states";
    /// The same within one turn.
    WRAPPED_JOINT_STATES = "mpl_right_arm/wrapped_joint_states";
    /// The arm's base.
    BASE_POSE = "mpl_right_arm/base_pose";
    /// A trajectory for the whole arm.
    ARM_COMMAND = "mpl_right_arm/arm_controller/command";
    /// Poses of the models.
    MODEL_STATES = "gazebo/model_states";
    /// Poses of the links.
    LINK_STATES = "gazebo/link_states";
    /// A pose for the base.
    SET_LINK_STATE = "gazebo/set_link_state";
    /// An object taken into the hand, or let go.
    GRASP_EVENTS = "grasp_event_republisher/grasp_events";
    /// Whether the hand holds something.
    GRASP_STATUS = "grasp_status";
    /// A goal for the hand.
    GRASP_GOAL = "grasp/goal";
    /// What the planner is asked.
    PLAN_REQUEST = "move_group/motion_plan_request";
}

/// Models of the original's blocks, with the topics of their poses.
const BLOCKS: [(&str, &str); 4] = [
    ("redcylinder1", "/red_block1_pose_msg"),
    ("redcylinder2", "/red_block2_pose_msg"),
    ("bluecylinder1", "/blue_block1_pose_msg"),
    ("bluecylinder2", "/blue_block2_pose_msg"),
];

/// The topic on which the headset is told where the object is whose model is called `ros_name`. A name may hold what a topic
/// may not: that becomes `_`.
pub fn object_pose_topic(ros_name: &str) -> String {
    let known = BLOCKS.iter().find(|(model, _)| *model == ros_name);
    known.map_or_else(|| format!("/{}_pose_msg", topic_segment(ros_name)), |(_, topic)| (*topic).to_owned())
}

/// The topic with the distance between gaze and the object called `name`, in a picture at unit distance.
pub fn gaze_distance_topic(name: &str) -> String {
    format!("{}_dist", topic_segment(name))
}

/// The name of an object's collision shape in a grasp event.
pub fn collision_name(ros_name: &str) -> String {
    format!("{ros_name}::link::collision")
}

/// The model of a collision's name, `model::link::collision`.
pub fn model_from_collision(collision: &str) -> &str {
    collision.split("::").next().unwrap_or_default()
}

/// Numbers of `/mode` from which the hand is moved along axes, and turned about them.
const FIRST_TRANSLATION: u8 = 7;
const FIRST_ROTATION: u8 = 10;

/// What is moved, as the original numbers it on `/mode`: joints from 0, translations from 7, rotations from 10. An arm with
/// more than seven joints has numbers twice.
pub fn mode_number(moves: ControlledDof) -> u8 {
    match moves {
        ControlledDof::Joint(joint) => joint,
        ControlledDof::Translation(axis) => FIRST_TRANSLATION + axis,
        ControlledDof::Rotation(axis) => FIRST_ROTATION + axis,
    }
}

/// A word that may be part of a topic.
fn topic_segment(name: &str) -> String {
    let fits = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let word: String = name.chars().map(|c| if fits(c) { c } else { '_' }).collect();
    if word.starts_with(|c: char| c.is_ascii_alphabetic()) { word } else { format!("object_{word}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_originals_blocks_keep_their_topics_and_others_get_such_a_name() {
        for (name, topic) in [
            ("redcylinder1", "/red_block1_pose_msg"),
            ("redcylinder2", "/red_block2_pose_msg"),
            ("bluecylinder1", "/blue_block1_pose_msg"),
            ("bluecylinder2", "/blue_block2_pose_msg"),
        ] {
            assert_eq!(object_pose_topic(name), topic);
        }
        assert_eq!(object_pose_topic("cube7"), "/cube7_pose_msg");
        assert_eq!(object_pose_topic("1 grüner Würfel"), "/object_1_gr_ner_W_rfel_pose_msg");
        assert_eq!(gaze_distance_topic("red1"), "red1_dist");
        assert_eq!(model_from_collision(&collision_name("cube7")), "cube7");
    }
}
