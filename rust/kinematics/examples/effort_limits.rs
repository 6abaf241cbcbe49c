//! Prints what torque each joint of the MPL right arm needs at rest with a block in the hand, over all its
//! angles and all leans of the trunk, what a finger joint needs to grip the block, and the effort limit that
//! follows: three times the sum.
//!
//! ```text
//! cargo run --release -p proact-kinematics --example effort_limits            # a table
//! cargo run --release -p proact-kinematics --example effort_limits -- --toml
//! ```
//!
//! The URDF stores the result; a test of this crate compares the two.

use proact_kinematics::{EffortOptions, effort_limits};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let toml = match std::env::args().nth(1).as_deref() {
        None => false,
        Some("--toml") => true,
        Some(other) => return Err(format!("got the argument \"{other}\", expected --toml or nothing").into()),
    };
    let options = EffortOptions::default();
    let limits = effort_limits(&proact_description::mpl_right_arm(), &options)?;
    if toml {
        println!(
            "# N m: {} times the largest static torque with {} kg in the hand, grip of the fingers included",
            options.safety_factor, options.payload_kg
        );
        println!("[effort]");
        for limit in &limits {
            println!("{} = {:.5}", limit.joint, limit.effort);
        }
    } else {
        println!("{:<28} {:>12} {:>12} {:>12}", "joint", "static (N m)", "grip (N m)", "effort (N m)");
        for limit in &limits {
            println!(
                "{:<28} {:>12.5} {:>12.5} {:>12.5}",
                limit.joint, limit.static_torque, limit.grip_torque, limit.effort
            );
        }
    }
    Ok(())
}
