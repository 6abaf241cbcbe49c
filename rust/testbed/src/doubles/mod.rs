//! Doubles of the ports, for tests without a native library: a plant without physics, plans without a search, an eye
//! tracker without errors but those that a test asks for.
//!
//! With `proact_control::doubles` they are all that [`Testbed`](crate::Testbed) needs:
//!
//! ```
//! use proact_testbed::{Setup, Testbed, TrialConfig, doubles};
//! use proact_types::{SimTime, TickInput};
//! let config = TrialConfig::new("D", 1, Setup::named("still")?);
//! let parts = doubles::testbed_parts(&config);
//! let mut testbed = Testbed::new(config, parts)?;
//! testbed.tick(&TickInput::default(), false)?;
//! assert_eq!(testbed.now(), SimTime(1));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod gaze;
mod plans;
mod plant;

pub use gaze::{GazeFault, ScriptedGaze};
pub use plans::{InstantPlans, PlanCall, PlanCalls};
pub use plant::KinematicPlant;

use crate::{TestbedParts, TrialConfig};
use proact_control::{
    MethodRegistry,
    doubles::{SerialKinematics, test_hand},
};
use std::sync::Arc;

/// The testbed of `config` made of doubles: the arm with two fingers, under the name that the configuration has for its
/// arm, before box and blocks, without an armband.
pub fn testbed_parts(config: &TrialConfig) -> TestbedParts {
    let model = Arc::new(test_hand());
    let task = config.task.build(false).expect("the tests' tasks can be built");
    let scene = task.scene().clone();
    let base = config.setup.body.shoulder_pose(&Default::default());
    TestbedParts {
        arm: config.arm.clone(),
        kinematics: Box::new(SerialKinematics::new(&model)),
        plant: Box::new(KinematicPlant::new(model.clone(), scene, base)),
        plans: Box::new(InstantPlans::new(model.clone())),
        methods: MethodRegistry::standard(),
        classifier: None,
        process: None,
        model,
    }
}
