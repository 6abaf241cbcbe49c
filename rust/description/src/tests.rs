//! Bad input and the embedded arm.

use super::*;
use proact_arm::JointKind;

#[test]
fn the_embedded_right_arm_is_read_in_the_order_that_everyone_relies_on() {
    let arm = mpl_right_arm();
    assert_eq!((arm.links.len(), arm.joints.len(), arm.moving_count()), (29, 28, 27));
    for (k, joint) in arm.joints.iter().enumerate() {
        assert_eq!(joint.child, k + 1);
        assert!(joint.parent < joint.child, "{} stands before its parent", arm.links[joint.child].name);
    }
    let names: Vec<&str> = arm.moving().map(|j| arm.joints[j].name.as_str()).collect();
    assert_eq!(names[0], "mpl_right_arm__shoulder");
    assert_eq!(names[6], "mpl_right_arm__wristz");
    assert_eq!(names[7], "mpl_right_arm__index0");
    assert_eq!(names[26], "mpl_right_arm__thumb3");
    assert_eq!(arm.links[arm.tip].name, "mpl_right_arm__wristz_link");
    let of_blocks = arm.grasp_for(0.05);
    assert!((of_blocks.center - proact_types::Vector::new(0.0145, -0.0825, -0.091)).norm() < 1e-15);
    let usual = proact_arm::Grasp::default();
    assert_eq!(
        *of_blocks,
        proact_arm::Grasp { width_range_m: of_blocks.width_range_m, center: of_blocks.center, ..usual }
    );
    assert_eq!(arm.joints[0].kind, JointKind::Fixed);
    assert_eq!(arm.pose("arm", "start").unwrap()[0], 1.029);
}
