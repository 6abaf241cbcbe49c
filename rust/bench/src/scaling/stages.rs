//! What is measured in this program: physics, plans and the page.

use super::{ScalingChart, ScalingLine};
use crate::{bridge, dynamics, planning, quantile};
use proact_types::MAX_OBJECTS;
use std::error::Error;

/// Up to nearly the most that a scene may have.
const OBJECTS: [u32; 9] = [1, 2, 5, 10, 20, 50, 100, 200, 500];
/// Blocks on the table of a plan; drawn places for more than these are hard to find.
const BLOCKS: [usize; 5] = [4, 8, 12, 16, 20];
/// Plans for each number of blocks.
const PLANS: usize = 60;
const CLIENTS: [usize; 6] = [1, 2, 5, 10, 20, 50];

/// A tick of an arm that swings far from blocks that lie around.
pub(super) fn objects() -> Result<ScalingChart, Box<dyn Error>> {
    let mut lines = Vec::new();
    for (name, sleep) in [("tick, blocks asleep", true), ("tick, blocks kept awake", false)] {
        let points =
            OBJECTS.map(|count| Ok((f64::from(count), dynamics::tick_among_blocks_us(count, sleep)?)));
        let points = points.into_iter().collect::<Result<Vec<_>, Box<dyn Error>>>()?;
        let (count, max_ms) = points.last().copied().unwrap_or_default();
        let bound = format!(
            "one core; of the 1,000 us of a tick in real time {max_ms:.0} are used at {count:.0}; a scene may have {MAX_OBJECTS}"
        );
        lines.push(ScalingLine { name: name.to_owned(), points, bound });
    }
    Ok(ScalingChart { file: "objects", size_label: "objects", cost_label: "mean tick", unit: "us", lines })
}

/// Plans to reach, carry and place among blocks.
pub(super) fn clutter() -> Result<ScalingChart, Box<dyn Error>> {
    let mut times = Vec::new();
    for blocks in BLOCKS {
        times.push((blocks as f64, planning::plan_among_blocks(blocks, PLANS)?));
    }
    let line = |name: &str, share| ScalingLine {
        name: name.to_owned(),
        points: times.iter().map(|(blocks, times)| (*blocks, quantile(times, share))).collect(),
        bound: "one core a plan".to_owned(),
    };
    let lines = vec![line("plan, median", 0.5), line("plan, 90 %", 0.9)];
    Ok(ScalingChart {
        file: "clutter",
        size_label: "blocks",
        cost_label: "processor time of a plan",
        unit: "ms",
        lines,
    })
}

/// The page's server while clients watch at 60 Hz.
pub(super) fn clients() -> Result<ScalingChart, Box<dyn Error>> {
    let mut points = Vec::new();
    for count in CLIENTS {
        let (_, core) = bridge::page_scene(count)?;
        points.push((count as f64, 100.0 * core));
    }
    let each = points.last().map_or(0.0, |(count, core)| core / count);
    let bound = format!("one core; at {each:.2} % a client it is full at some {:.0}", 100.0 / each);
    let lines = vec![ScalingLine { name: "page at 60 Hz".to_owned(), points, bound }];
    Ok(ScalingChart {
        file: "clients",
        size_label: "clients",
        cost_label: "share of a core",
        unit: "%",
        lines,
    })
}
