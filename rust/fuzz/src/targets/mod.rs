//! What is fuzzed: each target calls a reader of the project as the program does.

mod descriptions;
mod devices;
mod messages;
mod planted;
mod servers;
mod trials;

use std::path::Path;

/// Reads one input.
pub(crate) type Run = Box<dyn FnMut(&[u8])>;

/// A reader of bytes.
pub(crate) struct Target {
    /// Also the name of its folder in the corpus.
    pub(crate) name: &'static str,
    /// What it reads, for people.
    pub(crate) reads: &'static str,
    /// Makes what the inputs share; gets a folder of its own, which is the current one.
    pub(crate) start: fn(&Path) -> Run,
    /// Inputs beside the corpus that our own writers make; gets a folder for it.
    pub(crate) seeds: fn(&Path) -> Vec<Vec<u8>>,
    /// Makes mutated bytes hold together again where a checksum would end everything.
    pub(crate) mend: fn(&mut [u8]),
    /// Processor time for one input, seconds.
    pub(crate) limit_secs: f64,
    /// Fails on purpose, to see whether that is found.
    pub(crate) is_planted: bool,
}

impl Target {
    const fn new(name: &'static str, reads: &'static str, start: fn(&Path) -> Run) -> Target {
        Target { name, reads, start, seeds: |_| Vec::new(), mend: |_| (), limit_secs: 5.0, is_planted: false }
    }
}

/// A trial that a mutated file lets through is computed again, and an arm makes a plan.
const LONG_SECS: f64 = 20.0;

/// All targets.
#[rustfmt::skip]
const ALL: &[Target] = &[
    Target { limit_secs: LONG_SECS, ..Target::new("urdf", "an arm's URDF, to its first plan", descriptions::urdf) },
    Target::new("sdf", "an arm's SDF, imported", descriptions::sdf),
    Target::new("srdf", "the SRDF of the arm that ships", descriptions::srdf),
    Target { limit_secs: LONG_SECS, ..Target::new("query", "lines of `proact query`", descriptions::query) },
    Target { seeds: trials::config_seeds, ..Target::new("config", "a trial's configuration", trials::config) },
    Target::new("values", "assignments of --set, one a line", trials::values),
    Target { seeds: trials::config_seeds, limit_secs: LONG_SECS,
        ..Target::new("trial_config", "config.toml of a record, replayed", trials::config_file) },
    Target { seeds: trials::inputs_seeds, limit_secs: LONG_SECS, mend: trials::mend_log,
        ..Target::new("trial_inputs", "inputs.log of a record, replayed", trials::inputs_file) },
    Target { seeds: trials::digests_seeds, limit_secs: LONG_SECS, mend: trials::mend_digests,
        ..Target::new("trial_digests", "digests.log of a record, replayed", trials::digests_file) },
    Target { seeds: trials::events_seeds, limit_secs: LONG_SECS,
        ..Target::new("trial_events", "events.jsonl of a record", trials::events_file) },
    Target { seeds: trials::result_seeds, limit_secs: LONG_SECS,
        ..Target::new("trial_result", "result.json of a record", trials::result_file) },
    Target { seeds: trials::manifest_seeds, limit_secs: LONG_SECS,
        ..Target::new("trial_manifest", "SHA256SUMS of a record", trials::manifest_file) },
    Target { seeds: trials::classifier_seeds, limit_secs: LONG_SECS,
        ..Target::new("trial_classifier", "classifier.json of a record, replayed", trials::classifier_file) },
    Target { limit_secs: LONG_SECS, ..Target::new("trial_arm", "arm.urdf of a record, replayed", trials::arm_file) },
    Target { seeds: trials::bag_seeds, ..Target::new("bag", "a bag, as the replay page reads it", trials::bag) },
    Target::new("emg_csv", "a recording in a folder", devices::csv),
    Target { seeds: devices::imu_seeds,
        ..Target::new("emg_imu_csv", "an inertial measurement unit in a folder", devices::imu_csv) },
    Target::new("emg_metadata", "metadata.json of a folder of recordings", devices::metadata),
    Target { seeds: devices::model_seeds, ..Target::new("emg_model", "a trained EMG model", devices::model) },
    Target { seeds: devices::stream_csv_seeds,
        ..Target::new("emg_stream_csv", "a recorded stream as CSV", devices::stream_csv) },
    Target { seeds: devices::stream_edf_seeds,
        ..Target::new("emg_stream_edf", "a recorded stream as EDF+", devices::stream_edf) },
    Target::new("udp_gaze", "a datagram of an eye tracker", devices::udp_gaze),
    Target { seeds: devices::vmpl_seeds, ..Target::new("udp_vmpl", "a packet of a vMPL", devices::udp_vmpl) },
    Target { seeds: devices::natnet_seeds, ..Target::new("udp_natnet", "a packet of NatNet", devices::udp_natnet) },
    Target { seeds: devices::vrpn_seeds, ..Target::new("vrpn", "what a VRPN server sends", devices::vrpn) },
    Target { seeds: devices::poses_seeds, ..Target::new("poses_csv", "a file of tracked poses", devices::poses) },
    Target::new("udp_limb", "a datagram of a tracked limb", trials::udp_limb),
    Target::new("udp_libemg", "a datagram of LibEMG", devices::udp_libemg),
    Target::new("gforce", "notifications of an armband, each behind its length", devices::gforce),
    Target::new("gforce_socket", "frames of an armband on a socket", devices::gforce_socket),
    Target { limit_secs: LONG_SECS, ..Target::new("page_socket", "WebSocket frames to the page's server", servers::page_socket) },
    Target { limit_secs: LONG_SECS, ..Target::new("page_http", "requests to the page's server", servers::page_http) },
    Target { limit_secs: LONG_SECS, ..Target::new("rosbridge_socket", "WebSocket frames to rosbridge", servers::rosbridge_socket) },
    Target::new("ros_definition", "a message's definition, and an empty message of it", messages::definition),
    Target::new("ros_bytes", "a ROS message: number of its type, bytes", messages::bytes),
    Target::new("ros_json", "a ROS message: its type, a line break, JSON", messages::json),
    Target::new("xml_rpc_call", "a call to a ROS node", messages::xml_rpc_call),
    Target::new("xml_rpc_answer", "what a ROS master answers", messages::xml_rpc_answer),
    Target { is_planted: true, ..Target::new("planted_panic", "panics", planted::panic) },
    Target { is_planted: true, ..Target::new("planted_thread", "panics in a thread", planted::thread) },
    Target { is_planted: true, ..Target::new("planted_stack", "overflows the stack", planted::stack) },
    Target { is_planted: true, limit_secs: 0.5, ..Target::new("planted_hang", "does not end", planted::hang) },
    Target { is_planted: true, ..Target::new("planted_memory", "allocates without bound", planted::memory) },
];

/// The targets of these names; all that do not fail on purpose, if there is none.
pub(crate) fn named(names: &[String]) -> Result<Vec<&'static Target>, String> {
    let usual = || ALL.iter().filter(|target| !target.is_planted);
    if names.is_empty() {
        return Ok(usual().collect());
    }
    let find = |name: &String| {
        ALL.iter().find(|target| target.name == name).ok_or_else(|| {
            let known: Vec<&str> = usual().map(|target| target.name).collect();
            format!("there is no target {name:?}; expected some of {}", known.join(", "))
        })
    };
    names.iter().map(find).collect()
}

/// The input as text, as a reader that checks it for UTF-8 would get it; other input is no use to it.
fn text(bytes: &[u8]) -> Option<&str> {
    std::str::from_utf8(bytes).ok()
}
