//! Shows the page without a testbed, for work on the page itself: the arm moves its joints along a fixed script,
//! nothing is computed of gestures, plans or physics. What the browser sends is printed.
//!
//! `cargo run --release -p proact-bridge --example page_demo -- [port] [seated|still]`

// A program at the edge: it has a clock, prints, and may stop with an error message.
#![allow(clippy::disallowed_methods)]

use nalgebra::{Translation3, UnitQuaternion};
use proact_arm::ArmModel;
use proact_bridge::{ClientInput, MeshFile, PageContent, PageOptions, PageServer};
use proact_description::{ArmFolder, mesh_id};
use proact_tasks::{Arrangement, TaskSpec};
use proact_types::*;
use std::time::{Duration, Instant};

/// The meshes of the arm.
fn meshes() -> Vec<MeshFile> {
    let folder = ArmFolder::shipped("mpl_right").expect("ships with the program");
    let file = |(address, bytes): (String, std::borrow::Cow<'static, [u8]>)| MeshFile {
        address,
        id: mesh_id(&bytes),
        bytes: bytes.into_owned().into(),
    };
    folder.meshes.into_iter().map(file).collect()
}

/// Length of the script, seconds.
const LOOP_SECS: f64 = 16.0;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let port = arguments.next().map_or(Ok(8090), |text| text.parse())?;
    let setup = arguments.next().unwrap_or_else(|| "still".to_owned());
    let arm = proact_description::mpl_right_arm();
    let arrangement = Some(Arrangement::numbered(9)?);
    let task = TaskSpec { arrangement, ..TaskSpec::named("modified_bbt", 1)? }.build(false)?;
    let scene = task.scene().clone();
    let content = PageContent {
        title: "page demo".to_owned(),
        setup: setup.clone(),
        arm: arm.clone(),
        meshes: meshes(),
        scene: scene.clone(),
        briefing: task.briefing().clone(),
        interactive: true,
        lean: setup == "seated",
        method: Default::default(),
        methods: vec![],
    };
    let server = PageServer::start(PageOptions { port, ..PageOptions::default() }, content)?;
    println!("{}", server.url());

    let (start, mut tick) = (Instant::now(), 0_u32);
    let mut script =
        Script { arm, scene, shoulder: shoulder(&setup), gesture: Command::NoMotion, gaze: None };
    loop {
        for input in server.drain_inputs() {
            match input {
                ClientInput::Gesture(command) => script.gesture = command,
                ClientInput::Gaze { origin, direction, .. } => {
                    script.gaze = Some(GazeSample { origin, direction, valid: true });
                    continue;
                }
                _ => {}
            }
            println!("{input:?}");
        }
        server.publish(&script.frame(start.elapsed().as_secs_f64()));
        tick += 1;
        let next = start + Duration::from_secs(1) * tick / 60;
        std::thread::sleep(next.saturating_duration_since(Instant::now()));
    }
}

fn shoulder(setup: &str) -> Point {
    if setup == "seated" { Point::new(-0.6, -0.18, 1.445) } else { Point::new(-0.39, 0.12, 1.5) }
}

struct Script {
    arm: ArmModel,
    scene: Scene,
    shoulder: Point,
    gesture: Command,
    gaze: Option<GazeSample>,
}

impl Script {
    fn frame(&self, secs: f64) -> DisplayFrame {
        let t = secs % LOOP_SECS;
        // Reach, close, carry, open: shares from 0 to 1 of each, smooth.
        let ramp = |from: f64, to: f64| {
            let s = ((t - from) / (to - from)).clamp(0.0, 1.0);
            s * s * (3.0 - 2.0 * s)
        };
        let (reach, carry, back) = (ramp(2.0, 5.0), ramp(7.0, 10.0), ramp(12.5, 15.0));
        let grip = ramp(5.2, 6.5) - ramp(11.0, 12.3);
        let holds = (6.3..11.3).contains(&t).then_some(ObjectId(0));
        let start = [1.029, -0.161, 0.1291, 1.029, 1.57, 0.0174, 0.1006];
        let q: Vec<f64> = (0..7)
            .map(|k| {
                let reached = [0.25, 0.1, -0.25, 0.12, 0.0, 0.1, -0.35][k];
                let carried = [0.0, -0.35, 0.5, 0.1, 0.1, 0.0, 0.1][k];
                start[k] + (reached * reach + carried * carry) * (1.0 - back)
            })
            .collect();
        let hand = |name: &str| self.arm.pose("hand", name).map(<[f64]>::to_vec).unwrap_or_default();
        let fingers = hand("open").into_iter().zip(hand("closed")).map(|(o, c)| o + grip * (c - o));
        let joints: JointVector = q.iter().copied().chain(fingers).collect();
        let sway = 0.02 * (secs * 0.8).sin();
        let base = Pose::from_parts(
            Translation3::from(self.shoulder.coords),
            UnitQuaternion::from_euler_angles(0.0, sway, sway),
        );
        let tip = base * self.base_from_tip(&joints);
        let mut blocks: Vec<Pose> = self.scene.objects.iter().map(|block| block.pose).collect();
        if holds.is_some() {
            blocks[0].translation =
                Translation3::from((tip * Point::from(self.arm.widest_grasp().center)).coords);
        } else if t > 11.3 {
            blocks[0].translation.vector =
                self.scene.targets[0].center.coords + Vector::new(0.01, 0.0, 0.025);
        }
        let locked = (1.5..12.0).contains(&t);
        let planner = match t {
            ..2.0 => PlannerView::Idle,
            2.0..2.3 => PlannerView::Planning,
            2.3..5.0 => PlannerView::Executing { progress: reach, intermediate: false },
            5.0..7.0 => PlannerView::Arrived { intermediate: false },
            7.0..10.0 => PlannerView::Executing { progress: carry, intermediate: false },
            10.0..12.5 => PlannerView::Arrived { intermediate: false },
            _ => PlannerView::Failed {
                status: PlanStatus::Unreachable,
                reason: "the block is 4 cm out of reach".to_owned(),
            },
        };
        let eye = Point::new(-0.55, 0.0, 1.7);
        let gaze_target =
            if holds.is_some() { self.scene.targets[0].center } else { blocks[0] * Point::origin() };
        DisplayFrame {
            time: SimTime::from_secs(secs),
            method: "D".to_owned(),
            joints,
            world_from_base: base,
            world_from_tip: tip,
            world_from_head: Pose::translation(eye.x, eye.y, eye.z),
            objects: blocks,
            hand: HandView {
                state: match grip {
                    g if g < 0.05 => HandState::Open,
                    g if g > 0.95 => HandState::Closed,
                    _ if t < 8.0 => HandState::Closing,
                    _ => HandState::Opening,
                },
                held_object: holds,
            },
            gaze: self.gaze.or(Some(GazeSample { origin: eye, direction: gaze_target - eye, valid: true })),
            target: TargetView {
                object: (t > 0.6 && holds.is_none()).then_some(ObjectId(0)),
                place: holds.map(|_| self.scene.targets[0].center + Vector::new(0.004, 0.006, 0.0)),
                locked,
                posterior: vec![0.7, 0.1, 0.15, 0.05],
            },
            planner,
            mode: None,
            stop: None,
            command: self.gesture,
            recognized_gesture: self.gesture.into(),
            confidence: 0.87,
            effort: 0.5,
            emg_source: "keys".to_owned(),
            time_left_secs: 300.0 - secs % 300.0,
            plan_goal: None,
            next_object: Some(if t > 12.0 { ObjectId(2) } else { ObjectId(0) }),
            task_goal: None,
            score: u32::from(t > 12.0),
            finished: false,
            events: self.events(secs, t),
            contacts: Vec::new(),
            feedback: Vec::new(),
        }
    }

    /// The events of the sixtieth of a second before now.
    fn events(&self, secs: f64, t: f64) -> Vec<Event> {
        let block = ObjectId(0);
        [
            (1.5, EventKind::Locked { object: Some(block) }),
            (2.0, EventKind::PlanRequested { request: 1 }),
            (2.3, EventKind::PlanFinished { request: 1, status: PlanStatus::Ok, reason: None }),
            (5.0, EventKind::MotionFinished),
            (6.3, EventKind::ObjectAttached { object: block }),
            (11.3, EventKind::ObjectReleased { object: block }),
            (12.0, EventKind::ObjectOnTarget { object: block, distance: 0.01 }),
        ]
        .into_iter()
        .filter(|(at, _)| (t - 1.0 / 60.0..t).contains(at))
        .map(|(_, kind)| Event { time: SimTime::from_secs(secs), kind })
        .collect()
    }

    fn base_from_tip(&self, joints: &[f64]) -> Pose {
        self.arm.link_poses(joints)[self.arm.tip]
    }
}
