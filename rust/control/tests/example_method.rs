//! The example of the documentation, compiled and run.
mod common;
#[path = "../../../docs/methods/follow_gaze.rs"]
mod follow_gaze;

use common::{BLOCKS, Rig, model};
use follow_gaze::FollowGaze;
use proact_control::{CommandLimiter, LimiterProfile, MotionCommand};
use proact_types::{Command, ObjectId};

#[test]
fn the_example_carries_the_hand_towards_the_block_in_view_and_stops_on_release() {
    let limiter = LimiterProfile { acceleration_rad_per_s2: 4.0 };
    let mut rig = Rig::with(Box::new(CommandLimiter::new(FollowGaze::default(), &limiter, &model())));
    rig.highlight = Some(ObjectId(0));
    let block = rig.base.inverse_transform_point(&BLOCKS[0]).coords;
    let distance = |rig: &mut Rig| {
        let tip = rig.tip().translation.vector;
        (block + nalgebra::Vector3::z() * 0.15 - tip).norm()
    };
    let before = distance(&mut rig);
    rig.make(Command::WristExtension, 1000);
    let after = distance(&mut rig);
    assert!((0.08..0.11).contains(&(before - after)), "0.1 m/s for a second: {before} m, then {after} m");
    let outputs = rig.make(Command::NoMotion, 10);
    assert_eq!(outputs[0].motion, Some(MotionCommand::Hold));
    assert_eq!(rig.shown.target.object, Some(ObjectId(0)));
}
