//! The gains of the original's joint controllers.

/// Proportional gain, N m/rad, and derivative gain, N m s/rad, by the end of a joint's name: the original's
/// `PID_gains.yaml`. Its integral gains (0.01 for most joints) are left out, because it gives no clamp and the clamp's
/// default of zero takes all of their effect.
const ORIGINAL: [(&str, f64, f64); 27] = [
    ("shoulder", 100.0, 0.15),
    ("humerus", 100.0, 0.15),
    ("elbow", 100.0, 0.15),
    ("forearm", 100.0, 0.15),
    ("wristy", 100.0, 0.01),
    ("wristx", 100.0, 0.01),
    ("wristz", 100.0, 0.01),
    ("index0", 0.2, 0.0005),
    ("index1", 0.2, 0.0005),
    ("index2", 0.1, 0.0001),
    ("index3", 0.1, 0.0001),
    ("middle0", 0.2, 0.0005),
    ("middle1", 0.2, 0.0005),
    ("middle2", 0.1, 0.0001),
    ("middle3", 0.1, 0.0001),
    ("ring0", 0.2, 0.0005),
    ("ring1", 0.2, 0.0005),
    ("ring2", 0.1, 0.0001),
    ("ring3", 0.1, 0.0001),
    ("pinky0", 0.02, 0.0005),
    ("pinky1", 0.02, 0.0005),
    ("pinky2", 0.01, 0.0001),
    ("pinky3", 0.01, 0.0001),
    ("thumb0", 0.5, 0.0005),
    ("thumb1", 0.5, 0.0005),
    ("thumb2", 0.1, 0.0001),
    ("thumb3", 0.1, 0.0001),
];

/// Gains of a joint of the MPL arm, such as `mpl_right_arm__wristx`.
pub(crate) fn original(joint: &str) -> Option<(f64, f64)> {
    let part = joint.rsplit("__").next()?;
    ORIGINAL
        .iter()
        .find(|(name, ..)| *name == part)
        .map(|(_, proportional, derivative)| (*proportional, *derivative))
}
