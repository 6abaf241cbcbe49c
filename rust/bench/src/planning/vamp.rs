//! VAMP (Thomason, Kingston and Kavraki, ICRA 2024), which checks eight postures at once against balls, on an arm of its own:
//! code for another arm is made by a program of its authors that is not in the package.

use super::BenchRun;
use crate::{BenchFigure, python_peer, quantile};
use proact_types::{Obstacle, Shape};
use serde_json::{Value, json};
use std::{error::Error, io::Write as _};

/// Problems that it is given, every second among 20 blocks.
const PROBLEMS: usize = 100;
/// Where the middle of the table's surface stands before the Panda's base, metres.
const PANDA_FROM_TABLE: [f64; 3] = [0.5, 0.0, 0.2];

/// Prints one JSON object: nanoseconds of search and of shortening for each problem that was solved.
const PROGRAM: &str = r#"
import json, sys
import numpy as np
import vamp

panda, plan, settings, shortening = vamp.configure_robot_and_planner_with_kwargs("panda", "rrtc")
draws, random = panda.halton(), np.random.default_rng(1)
low, high = np.array(panda.lower_bounds()), np.array(panda.upper_bounds())
places = json.load(open(sys.argv[1]))
def posture(environment, side):
    # The hand over one half of the box, 10 to 30 cm above the table.
    while True:
        q = random.uniform(low, high)
        x, y, z = panda.eefk(q)[:3, 3] - places["surface"]
        if abs(x) < 0.12 and 0.05 < side * y < 0.26 and 0.1 < z < 0.3 and panda.validate(q, environment):
            return q
search, shorten = [], []
for boxes in places["problems"]:
    environment = vamp.Environment()
    for middle, turn, half in boxes:
        environment.add_cuboid(vamp.Cuboid(middle, turn, half))
    found = plan(posture(environment, -1), posture(environment, 1), environment, settings, draws)
    if found.solved:
        search.append(found.nanoseconds)
        shorten.append(panda.simplify(found.path, environment, shortening, draws).nanoseconds)
print(json.dumps({"search": search, "shorten": shorten}))
"#;

impl BenchRun {
    /// Times of VAMP's search among the same walls and blocks, from one half of the box to the other.
    pub(super) fn vamp(&mut self) -> Result<Vec<BenchFigure>, Box<dyn Error>> {
        let mut problems = Vec::with_capacity(PROBLEMS);
        for number in 0..PROBLEMS {
            let request = self.problem_generator.problem(number, number % 2 == 1)?.request;
            problems.push(cuboids(&request.obstacles));
        }
        let mut file = tempfile::NamedTempFile::new()?;
        let input = json!({ "surface": PANDA_FROM_TABLE, "problems": problems });
        file.write_all(input.to_string().as_bytes())?;
        let output = python_peer::run_peer("vamp", PROGRAM, &[&file.path().to_string_lossy()]);
        let (output, why) = output.map_or_else(|why| (Value::Null, why), |output| (output, String::new()));
        let times = |key: &str| -> Vec<f64> {
            let values = output[key].as_array().into_iter().flatten();
            values.filter_map(Value::as_f64).map(|nanoseconds| 1e-3 * nanoseconds).collect()
        };
        let (search, shorten) = (times("search"), times("shorten"));
        let both: Vec<f64> = search.iter().zip(&shorten).map(|(a, b)| a + b).collect();
        let solved = both.len() as f64 / PROBLEMS as f64;
        let mut figures = vec![BenchFigure::without_peer("VAMP on a Panda: solved", solved, "1", &why)];
        if !both.is_empty() {
            let note = format!(
                "search alone {:.0} us at the median; another arm among the same walls and blocks, between two given postures: nothing is gripped, no arm angles are sought, no path is rounded or timed",
                quantile(&search, 0.5)
            );
            for (share, what, note) in [(0.5, "median", &note[..]), (0.99, "99 %", ""), (1.0, "worst", "")] {
                let name = format!("VAMP on a Panda: search and shortening, {what}");
                figures.push(BenchFigure::without_peer(&name, quantile(&both, share), "us", note));
            }
        }
        Ok(figures)
    }
}

/// Middle, Euler angles and half the sides of each box, with the table before the Panda; without the room's floor.
fn cuboids(obstacles: &[Obstacle]) -> Vec<[[f64; 3]; 3]> {
    let surface = obstacles.iter().find(|o| o.name == "table").map_or(0.0, |table| match table.shape {
        Shape::Box { size } => table.pose.translation.z + size[2] / 2.0,
        _ => table.pose.translation.z,
    });
    let boxes = obstacles.iter().filter(|o| o.name != "floor").filter_map(|o| {
        let Shape::Box { size } = o.shape else { return None };
        let [x, y, z] = [o.pose.translation.x, o.pose.translation.y, o.pose.translation.z - surface];
        let (roll, pitch, yaw) = o.pose.rotation.euler_angles();
        let [ahead, left, up] = PANDA_FROM_TABLE;
        Some([[x + ahead, y + left, z + up], [roll, pitch, yaw], size.map(|side| side / 2.0)])
    });
    boxes.collect()
}
