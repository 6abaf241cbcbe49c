//! `proact node intent`: gaze and blocks in, the block and the place that are meant out.

use super::{
    Graph, NodeError, convert,
    graph::Jobs,
    stage::{self, Common, Stage, Worldly},
};
use crate::{
    frames::WORLD,
    messages::{
        geometry_msgs::Vector3Stamped,
        proact_msgs::View,
        std_msgs::{Float64, String as Text},
    },
    world::World,
};
use proact_intent::{Candidates, table_hit};
use proact_tasks::TABLE_TOP;
use proact_testbed::GazeFilter;
use proact_types::{GazeSample, Point, Vector};
use rosrust::{Publisher, Time};
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// What the intent stage says beside the original's topics: the text on `/proact/intent`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct IntentView {
    /// Probability of each block, `BlockId::ALL` order.
    pub posterior: [f64; 4],
    /// The gaze that it follows from.
    pub gaze: Option<GazeSample>,
}

struct IntentNode {
    common: Common,
    world: World,
    filter: GazeFilter,
    position: Option<(Time, Point)>,
    block_id: Publisher<Text>,
    hit: Publisher<Vector3Stamped>,
    raw_hit: Publisher<Vector3Stamped>,
    gaze_ros: [Publisher<Vector3Stamped>; 2],
    distances: Vec<Publisher<Float64>>,
    view: Publisher<View>,
}

/// Runs the intent stage until the graph ends the node.
///
/// # Errors
/// [`NodeError`].
pub fn run_intent(world: World, filter: GazeFilter) -> Result<(), NodeError> {
    let graph = Graph::join("proact_intent")?;
    let mut node = IntentNode {
        common: Common::new(&graph)?,
        world,
        filter,
        position: None,
        block_id: graph.publish("block_id", 1, false)?,
        hit: graph.publish("gaze_table_hit_location", 1, false)?,
        raw_hit: graph.publish("gaze_table_hit_location_logging", 1, false)?,
        gaze_ros: [
            graph.publish("gaze_position_ros", 1, false)?,
            graph.publish("gaze_direction_ros", 1, false)?,
        ],
        distances: ["red1_dist", "red2_dist", "blue1_dist", "blue2_dist"]
            .iter()
            .map(|topic| graph.publish(topic, 1, false))
            .collect::<Result<_, _>>()?,
        view: graph.publish("proact/intent", 1, false)?,
    };
    let jobs: Jobs<IntentNode> = Jobs::default();
    let _world = stage::listen_to_world(&graph, &jobs)?;
    let _position =
        graph.listen("gaze_position", 10, &jobs, |node: &mut IntentNode, m: Vector3Stamped| {
            node.position = Some((m.header.stamp, Point::new(m.vector.x, m.vector.y, m.vector.z)));
        })?;
    let _direction =
        graph.listen("gaze_direction", 10, &jobs, |node: &mut IntentNode, m: Vector3Stamped| {
            let Some((_, origin)) = node.position else { return };
            match gaze(origin, Vector::new(m.vector.x, m.vector.y, m.vector.z)) {
                Ok(gaze) => {
                    let done = node.infer(&gaze);
                    node.common.note("publish", done);
                }
                Err(reason) => node.common.faults.refuse("gaze", &reason),
            }
        })?;
    stage::run(graph, &jobs, &mut node)
}

/// A gaze as it came in; the headset publishes none while it has lost the eye.
pub(super) fn gaze(origin: Point, direction: Vector) -> Result<GazeSample, String> {
    let values = || origin.iter().chain(direction.iter());
    if let Some(bad) = values().find(|v| !v.is_finite()) {
        return Err(format!("a gaze holds {bad}, expected finite numbers"));
    }
    match direction.try_normalize(1e-9) {
        Some(direction) => Ok(GazeSample { origin, direction, valid: true }),
        None => Err("a gaze has no direction".to_owned()),
    }
}

impl IntentNode {
    fn infer(&mut self, gaze: &GazeSample) -> rosrust::error::Result<()> {
        if !self.world.is_complete() {
            return Ok(());
        }
        let (now, stamp) = (self.common.now(), self.common.stamp());
        let state = self.world.task().state();
        let scene = Candidates {
            centres: self.world.block_centres(),
            pickable: state.pickable,
            last_released: state.last_released,
            tip: Some(self.world.grasp_centre()),
        };
        self.filter.take(now, gaze, &scene);

        let vector =
            |v: &Vector| Vector3Stamped { header: convert::header(stamp, WORLD), vector: convert::vector(v) };
        if let Some(block) = self.filter.highlight(now) {
            self.block_id.send(Text { data: block.ros_name().to_owned() })?;
        }
        self.hit.send(vector(&self.filter.place().coords))?;
        if let Some(hit) = table_hit(gaze, TABLE_TOP) {
            self.raw_hit.send(vector(&hit.coords))?;
        }
        self.gaze_ros[0].send(vector(&gaze.origin.coords))?;
        self.gaze_ros[1].send(vector(&gaze.direction))?;
        for (publisher, centre) in self.distances.iter().zip(&scene.centres) {
            // In a picture at unit distance, as the original has it.
            let data = gaze.direction.angle(&(centre - gaze.origin)).tan();
            publisher.send(Float64 { data })?;
        }
        let view = IntentView { posterior: *self.filter.posterior(), gaze: self.filter.sample() };
        self.view.send(View {
            header: convert::header(stamp, WORLD),
            json: serde_json::to_string(&view).unwrap_or_default(),
        })
    }
}

impl Stage for IntentNode {
    fn common(&mut self) -> &mut Common {
        &mut self.common
    }

    fn ticks(&mut self, _ticks: RangeInclusive<u64>) -> rosrust::error::Result<()> {
        let now = self.common.now();
        self.world.step(now);
        Ok(())
    }
}

impl Worldly for IntentNode {
    fn world(&mut self) -> &mut World {
        &mut self.world
    }
}
