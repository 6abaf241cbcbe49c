//! Where a block may stand in the open hand for the closing fingers to hold it:
//! `cargo run --release -p proact-dynamics --example grasp_map`.
//!
//! One line a grasp: how far the hand is moved from the position in which the grasp centre is the block's centre, its
//! tilt, when two opposing contacts have lasted 40 ms, what touched, and how far the block went by then.

#[path = "../tests/common/mod.rs"]
mod common;

use common::{
    HEIGHT, OpposedGrip, START, TABLE, bare_table, base_that_puts_tip_at, close_until_held, plant_at,
    positions, standing,
};
use nalgebra::UnitQuaternion;
use proact_testbed::ports::{Plant, PlantError};
use proact_types::{ObjectId, Pose, Vector};

fn main() -> Result<(), PlantError> {
    let model = proact_description::mpl_right_arm();
    let open = positions(&model, &START, "open");
    let block = Vector::new(0.0, 0.0, TABLE + 0.5 * HEIGHT);
    let grasp = |tilt_degrees: f64, shift: Vector| {
        let rotation =
            UnitQuaternion::from_euler_angles(f64::to_radians(tilt_degrees), f64::to_radians(-1.0), 0.0);
        let tip = Pose::from_parts((block + shift - rotation * model.widest_grasp().center).into(), rotation);
        let base = base_that_puts_tip_at(&model, &open, &tip);
        let result = plant_at(&model, &bare_table(vec![standing(ObjectId(0), 0.0, 0.0)]), &open, &base);
        let mut plant = match result {
            Ok(plant) => plant,
            Err(PlantError::Model(reason)) => return Ok(format!("impossible: {reason}")),
            Err(error) => return Err(error),
        };
        let holding = close_until_held(&mut plant, &model, &base, 800)?;
        let state = plant.state().objects[0];
        let moved = (state.pose.translation.vector - block) * 1e3;
        let tilt = (state.pose.rotation * Vector::z()).angle(&Vector::z()).to_degrees();
        let moved =
            format!("block moved {:.1} {:.1} {:.1} mm, tilted {tilt:.1} degrees", moved.x, moved.y, moved.z);
        Ok(match holding {
            Some(OpposedGrip { tick, degrees, links, forces }) => format!(
                "held at {tick} ms by {} and {} ({degrees:.0} degrees, {:.1} and {:.1} N), {moved}",
                links.0, links.1, forces.0, forces.1
            ),
            None => format!("NOT HELD, {moved}"),
        })
    };
    println!("tilt in degrees, shift of the hand in mm (x, y in the table plane, z up)");
    for tilt in [0.0, 10.0, 25.6, 40.0, 55.0, 70.0, 90.0] {
        println!("tilt {tilt:4}: {}", grasp(tilt, Vector::zeros())?);
    }
    for axis in 0..3 {
        for step in -5..=5 {
            let mut shift = Vector::zeros();
            shift[axis] = f64::from(step) * 4e-3;
            println!(
                "shift {:5.0} {:5.0} {:5.0}: {}",
                shift.x * 1e3,
                shift.y * 1e3,
                shift.z * 1e3,
                grasp(25.6, shift)?
            );
        }
    }
    println!(
        "\nheld out of 12 (tilts 10, 25.6, 40 degrees; heights -8, 0, 8, 16 mm); columns: shift y -8 to 16 mm"
    );
    for x in -6..=4 {
        let mut line = format!("shift x {:4}: ", x * 4);
        for y in -2..=4 {
            let mut held = 0;
            for tilt in [10.0, 25.6, 40.0] {
                for z in [-2, 0, 2, 4] {
                    let shift = Vector::new(f64::from(x), f64::from(y), f64::from(z)) * 4e-3;
                    held += usize::from(grasp(tilt, shift)?.starts_with("held"));
                }
            }
            line += &format!("{held:4}");
        }
        println!("{line}");
    }
    Ok(())
}
