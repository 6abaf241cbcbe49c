//! Poses of a graph as a source of motion capture: `PoseStamped` topics, or frames of `/tf`.
//!
//! A process has one place on the graph. It is joined by the first source and shared by all; when the last one leaves, nothing of
//! this process is registered any more.

use super::{graph, master, master::MasterAddresses, reconnect, type_mismatch};
use crate::{
    messages::{geometry_msgs, std_msgs::Header, tf2_msgs::TFMessage},
    tf_body::{TfBody, TfLink},
};
use proact_localization::{Nanos, RawBodyPose};
use rosrust::{Message, Subscriber};
use std::{
    collections::{BTreeMap, btree_map::Entry},
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    thread::JoinHandle,
    time::{Duration, Instant},
};

/// What a topic of poses carries.
const POSE_STAMPED: &str = "geometry_msgs/PoseStamped";
/// From look to look at the graph, and from try to try to find it.
const POLL_PERIOD: Duration = Duration::from_millis(300);
/// Topics beside the one that is named, at most.
const MAX_TOPICS: usize = 32;
/// Messages that may wait for a callback.
const QUEUE: usize = 100;

/// Who takes poses.
pub trait PoseSink: Clone + Send + Sync + 'static {
    /// This machine's clock, ns.
    fn now(&self) -> Nanos;
    /// A pose.
    fn push(&self, pose: RawBodyPose);
    /// There are none, and why.
    fn report_waiting(&self, reason: String);
    /// Nobody takes any more.
    fn is_closed(&self) -> bool;
}

/// The graph of this process, and how many sources are on it.
static GRAPH_MEMBERSHIP: Mutex<Option<(usize, MasterWatch)>> = Mutex::new(None);

/// The watch over the master.
struct MasterWatch {
    addresses: MasterAddresses,
    ended: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

fn lock_membership() -> MutexGuard<'static, Option<(usize, MasterWatch)>> {
    GRAPH_MEMBERSHIP.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A source's place on the graph.
struct GraphMembership(());

impl GraphMembership {
    /// Joins the graph, or shares the place that this process has on it.
    fn join() -> Result<Self, String> {
        let mut membership = lock_membership();
        if let Some((count, _)) = &mut *membership {
            *count += 1;
            return Ok(Self(()));
        }
        let uri = graph::master_uri();
        let no_master = |reason: String| {
            format!("no ROS master at {uri}: {reason}; start roscore, or set ROS_MASTER_URI")
        };
        // The library leaves a thread behind for each try that fails, so somebody must be there.
        master::check_master(&uri).map_err(no_master)?;
        if !rosrust::is_initialized() {
            let name = format!("proact_mocap_{}", std::process::id());
            rosrust::try_init_with_options(&name, false).map_err(|error| no_master(error.to_string()))?;
        }
        let addresses = graph::addresses().map_err(|error| error.to_string())?;
        let ended = Arc::new(AtomicBool::new(false));
        reconnect::start(addresses.clone(), ended.clone());
        let (theirs, over) = (addresses.clone(), ended.clone());
        let watch = move || graph::run_master_watch(&theirs, &over, &AtomicBool::new(false));
        let thread = Some(std::thread::spawn(watch));
        *membership = Some((1, MasterWatch { addresses, ended, thread }));
        Ok(Self(()))
    }
}

impl Drop for GraphMembership {
    fn drop(&mut self) {
        let mut membership = lock_membership();
        let Some((count, watched)) = &mut *membership else { return };
        *count -= 1;
        if *count > 0 {
            return;
        }
        watched.ended.store(true, Ordering::Relaxed);
        if let Some(thread) = watched.thread.take() {
            // A watch that panicked has told so itself.
            let _ = thread.join();
        }
        master::unregister_topics(&watched.addresses);
        *membership = None;
    }
}

/// Joins the graph for `sink`, as soon as there is one; none if nobody takes poses any more.
fn join(sink: &impl PoseSink) -> Option<GraphMembership> {
    while !sink.is_closed() {
        match GraphMembership::join() {
            Ok(seat) => return Some(seat),
            Err(reason) => sink.report_waiting(reason),
        }
        pause(sink);
    }
    None
}

fn pause(sink: &impl PoseSink) {
    let until = Instant::now() + POLL_PERIOD;
    while !sink.is_closed() && Instant::now() < until {
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn subscribe<M: Message>(
    topic: &str,
    take: impl Fn(M) + Send + Sync + 'static,
) -> Result<Subscriber, String> {
    type_mismatch::record_type::<M>();
    rosrust::subscribe(topic, QUEUE, take).map_err(|error| format!("{topic}: {error}"))
}

/// Stamp of a message, ns.
fn stamp(header: &Header) -> Nanos {
    Nanos::from(header.stamp.sec) * 1_000_000_000 + Nanos::from(header.stamp.nsec)
}

/// Follows the topic of poses `topic`, and those whose names differ from it in one part, until nobody takes any more. The body of
/// each is named as its topic. A topic keeps the frame of its first pose: what comes in another one is left out, and said.
pub fn follow_pose_topic(topic: &str, sink: &impl PoseSink) {
    let Some(_seat) = join(sink) else { return };
    let mut subscribers: BTreeMap<String, Subscriber> = BTreeMap::new();
    while !sink.is_closed() {
        let known = rosrust::topics().unwrap_or_default();
        let carries = |name: &str| known.iter().find(|known| known.name == name).map(|known| &known.datatype);
        let mut wanted: Vec<String> = known
            .iter()
            .filter(|other| other.datatype == POSE_STAMPED && differs_in_one_part(&other.name, topic))
            .map(|other| other.name.clone())
            .take(MAX_TOPICS)
            .collect();
        if carries(topic).is_none_or(|datatype| datatype == POSE_STAMPED || datatype == "*") {
            wanted.push(topic.to_owned());
        }
        for name in wanted {
            let Entry::Vacant(free) = subscribers.entry(name) else { continue };
            match subscribe_poses(free.key(), free.key() == topic, sink) {
                Ok(subscriber) => _ = free.insert(subscriber),
                Err(reason) => sink.report_waiting(reason),
            }
        }
        match (carries(topic), subscribers.get(topic).map(Subscriber::publisher_count)) {
            (Some(other), _) if other != POSE_STAMPED && other != "*" => {
                sink.report_waiting(format!("topic {topic} carries {other}, expected {POSE_STAMPED}"));
            }
            (_, Some(0)) => {
                let poses = known.iter().filter(|other| other.datatype == POSE_STAMPED);
                let poses: Vec<&str> = poses.map(|other| other.name.as_str()).collect();
                let there = if poses.is_empty() { "none".to_owned() } else { poses.join(", ") };
                sink.report_waiting(format!(
                    "nobody publishes on {topic}; topics of {POSE_STAMPED}: {there}"
                ));
            }
            _ => {}
        }
        pause(sink);
    }
}

/// Subscribes to one topic of poses.
fn subscribe_poses(topic: &str, named: bool, sink: &impl PoseSink) -> Result<Subscriber, String> {
    let (sink, body) = (sink.clone(), topic.to_owned());
    let frame: Mutex<Option<String>> = Mutex::new(None);
    subscribe(topic, move |message: geometry_msgs::PoseStamped| {
        let mut frame = frame.lock().unwrap_or_else(PoisonError::into_inner);
        let first = frame.get_or_insert_with(|| message.header.frame_id.clone());
        if *first != message.header.frame_id {
            if named {
                let got = &message.header.frame_id;
                sink.report_waiting(format!(
                    "poses on {body} came in frame {first:?} and come in {got:?}; one publisher must keep to one frame"
                ));
            }
            return;
        }
        let geometry_msgs::Pose { position: p, orientation: q } = &message.pose;
        sink.push(RawBodyPose {
            body: body.clone(),
            id: None,
            stamp: stamp(&message.header),
            arrival: sink.now(),
            position: [p.x, p.y, p.z],
            quaternion: [q.x, q.y, q.z, q.w],
            tracked: true,
        });
    })
}

/// Whether two names have as many parts, of which one differs.
fn differs_in_one_part(name: &str, other: &str) -> bool {
    let (a, b): (Vec<&str>, Vec<&str>) = (name.split('/').collect(), other.split('/').collect());
    a.len() == b.len() && a.iter().zip(&b).filter(|(a, b)| a != b).count() == 1
}

/// Follows the frame `body` of `/tf` in `parent`, and those right below `parent`, until nobody takes any more.
pub fn follow_tf(parent: &str, body: &str, sink: &impl PoseSink) {
    let Some(_seat) = join(sink) else { return };
    let followed = SharedBody(Arc::new(Mutex::new(TfBody::new(parent, body))));
    let (moving, fixed) = (followed.clone(), followed.clone());
    let theirs = sink.clone();
    let subscribed = [
        subscribe("/tf", move |message: TFMessage| {
            let poses = moving.with(|body| body.update(&links(&message), theirs.now()));
            poses.into_iter().for_each(|pose| theirs.push(pose));
        }),
        subscribe("/tf_static", move |message: TFMessage| {
            fixed.with(|body| body.add_static(&links(&message)))
        }),
    ];
    let failed = subscribed.iter().find_map(|subscriber| subscriber.as_ref().err().cloned());
    while !sink.is_closed() {
        if let Some(reason) = failed.clone().or_else(|| followed.with(|body| body.missing())) {
            sink.report_waiting(reason);
        }
        pause(sink);
    }
}

/// A body that callbacks share.
#[derive(Clone)]
struct SharedBody(Arc<Mutex<TfBody>>);

impl SharedBody {
    fn with<T>(&self, act: impl FnOnce(&mut TfBody) -> T) -> T {
        // Each change is whole before anything can panic.
        act(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

fn links(message: &TFMessage) -> Vec<TfLink> {
    let link = |transform: &geometry_msgs::TransformStamped| {
        let (t, q) = (&transform.transform.translation, &transform.transform.rotation);
        TfLink {
            // tf2 refuses names with a slash in front; the older tf sent them.
            parent: transform.header.frame_id.trim_start_matches('/').to_owned(),
            child: transform.child_frame_id.trim_start_matches('/').to_owned(),
            stamp: stamp(&transform.header),
            position: [t.x, t.y, t.z],
            quaternion: [q.x, q.y, q.z, q.w],
        }
    };
    message.transforms.iter().map(link).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn topics_of_one_family_differ_in_one_part() {
        let pad = "/vrpn_client_node/Shoulderpad/pose";
        assert!(differs_in_one_part("/vrpn_client_node/HololensSG/pose", pad));
        for other in [pad, "/vrpn_client_node/Shoulderpad/pose/raw", "/other/HololensSG/pose", "/goal"] {
            assert!(!differs_in_one_part(other, pad), "{other}");
        }
    }
}
