//! What is fuzzed: each target calls a reader of the project as the program does.

mod descriptions;
mod devices;
mod messages;
mod planted;
mod servers;
mod trials;

use std::path::Path;

/// Reads one input.
pub(crate) type TargetFn = Box<dyn FnMut(&[u8])>;

/// A reader of bytes.
pub(crate) struct FuzzTarget {
    /// Also the name of its folder in the corpus.
    pub(crate) name: &'static str,
    /// What it reads, for people.
    pub(crate) reads: &'static str,
    /// Makes what the inputs share; gets a folder of its own, which is the current one.
    pub(crate) start: fn(&Path) -> TargetFn,
    /// Inputs beside the corpus that our own writers make; gets a folder for it.
    pub(crate) seed_inputs: fn(&Path) -> Vec<Vec<u8>>,
    /// Makes mutated bytes hold together again where a checksum would end everything.
    pub(crate) repair_checksums: fn(&mut [u8]),
    /// Processor time for one input, seconds.
    pub(crate) limit_secs: f64,
    /// Fails on purpose, to see whether that is found.
    pub(crate) is_planted: bool,
}

impl FuzzTarget {
    const fn new(name: &'static str, reads: &'static str, start: fn(&Path) -> TargetFn) -> FuzzTarget {
        FuzzTarget {
            name,
            reads,
            start,
            seed_inputs: |_| Vec::new(),
            repair_checksums: |_| (),
            limit_secs: 5.0,
            is_planted: false,
        }
    }
}

/// A trial that a mutated file lets through is computed again, and an arm makes a plan.
const LONG_LIMIT_SECS: f64 = 20.0;

/// All targets.
#[rustfmt::skip]
const ALL_TARGETS: &[FuzzTarget] = &[
    FuzzTarget { limit_secs: LONG_LIMIT_SECS, ..FuzzTarget::new("urdf", "an arm's URDF, to its first plan", descriptions::urdf) },
    FuzzTarget::new("sdf", "an arm's SDF, imported", descriptions::sdf),
    FuzzTarget::new("srdf", "the SRDF of the arm that ships", descriptions::srdf),
    FuzzTarget { limit_secs: LONG_LIMIT_SECS, ..FuzzTarget::new("query", "lines of `proact query`", descriptions::query) },
    FuzzTarget { seed_inputs: trials::config_seeds, ..FuzzTarget::new("config", "a trial's configuration", trials::config) },
    FuzzTarget::new("values", "assignments of --set, one a line", trials::values),
    FuzzTarget { seed_inputs: trials::config_seeds, limit_secs: LONG_LIMIT_SECS,
        ..FuzzTarget::new("trial_config", "config.toml of a record, replayed", trials::config_file) },
    FuzzTarget { seed_inputs: trials::inputs_seeds, limit_secs: LONG_LIMIT_SECS, repair_checksums: trials::repair_log,
        ..FuzzTarget::new("trial_inputs", "inputs.log of a record, replayed", trials::inputs_file) },
    FuzzTarget { seed_inputs: trials::digests_seeds, limit_secs: LONG_LIMIT_SECS, repair_checksums: trials::repair_digests,
        ..FuzzTarget::new("trial_digests", "digests.log of a record, replayed", trials::digests_file) },
    FuzzTarget { seed_inputs: trials::events_seeds, limit_secs: LONG_LIMIT_SECS,
        ..FuzzTarget::new("trial_events", "events.jsonl of a record", trials::events_file) },
    FuzzTarget { seed_inputs: trials::result_seeds, limit_secs: LONG_LIMIT_SECS,
        ..FuzzTarget::new("trial_result", "result.json of a record", trials::result_file) },
    FuzzTarget { seed_inputs: trials::manifest_seeds, limit_secs: LONG_LIMIT_SECS,
        ..FuzzTarget::new("trial_manifest", "SHA256SUMS of a record", trials::manifest_file) },
    FuzzTarget { seed_inputs: trials::classifier_seeds, limit_secs: LONG_LIMIT_SECS,
        ..FuzzTarget::new("trial_classifier", "classifier.json of a record, replayed", trials::classifier_file) },
    FuzzTarget { limit_secs: LONG_LIMIT_SECS, ..FuzzTarget::new("trial_arm", "arm.urdf of a record, replayed", trials::arm_file) },
    FuzzTarget { seed_inputs: trials::bag_seeds, ..FuzzTarget::new("bag", "a bag, as the replay page reads it", trials::bag) },
    FuzzTarget::new("emg_csv", "a recording in a folder", devices::csv),
    FuzzTarget { seed_inputs: devices::imu_seeds,
        ..FuzzTarget::new("emg_imu_csv", "an inertial measurement unit in a folder", devices::imu_csv) },
    FuzzTarget::new("emg_metadata", "metadata.json of a folder of recordings", devices::metadata),
    FuzzTarget { seed_inputs: devices::model_seeds, ..FuzzTarget::new("emg_model", "a trained EMG model", devices::model) },
    FuzzTarget { seed_inputs: devices::stream_csv_seeds,
        ..FuzzTarget::new("emg_stream_csv", "a recorded stream as CSV", devices::stream_csv) },
    FuzzTarget { seed_inputs: devices::stream_edf_seeds,
        ..FuzzTarget::new("emg_stream_edf", "a recorded stream as EDF+", devices::stream_edf) },
    FuzzTarget::new("udp_gaze", "a datagram of an eye tracker", devices::udp_gaze),
    FuzzTarget { seed_inputs: devices::vmpl_seeds, ..FuzzTarget::new("udp_vmpl", "a packet of a vMPL", devices::udp_vmpl) },
    FuzzTarget { seed_inputs: devices::natnet_seeds, ..FuzzTarget::new("udp_natnet", "a packet of NatNet", devices::udp_natnet) },
    FuzzTarget { seed_inputs: devices::vrpn_seeds, ..FuzzTarget::new("vrpn", "what a VRPN server sends", devices::vrpn) },
    FuzzTarget { seed_inputs: devices::poses_seeds, ..FuzzTarget::new("poses_csv", "a file of tracked poses", devices::poses) },
    FuzzTarget::new("udp_limb", "a datagram of a tracked limb", trials::udp_limb),
    FuzzTarget::new("udp_libemg", "a datagram of LibEMG", devices::udp_libemg),
    FuzzTarget::new("gforce", "notifications of an armband, each behind its length", devices::gforce),
    FuzzTarget::new("gforce_socket", "frames of an armband on a socket", devices::gforce_socket),
    FuzzTarget { limit_secs: LONG_LIMIT_SECS, ..FuzzTarget::new("page_socket", "WebSocket frames to the page's server", servers::page_socket) },
    FuzzTarget { limit_secs: LONG_LIMIT_SECS, ..FuzzTarget::new("page_http", "requests to the page's server", servers::page_http) },
    FuzzTarget { limit_secs: LONG_LIMIT_SECS, ..FuzzTarget::new("rosbridge_socket", "WebSocket frames to rosbridge", servers::rosbridge_socket) },
    FuzzTarget::new("ros_definition", "a message's definition, and an empty message of it", messages::definition),
    FuzzTarget::new("ros_bytes", "a ROS message: number of its type, bytes", messages::bytes),
    FuzzTarget::new("ros_json", "a ROS message: its type, a line break, JSON", messages::json),
    FuzzTarget::new("xml_rpc_call", "a call to a ROS node", messages::xml_rpc_call),
    FuzzTarget::new("xml_rpc_answer", "what a ROS master answers", messages::xml_rpc_response),
    FuzzTarget { is_planted: true, ..FuzzTarget::new("planted_panic", "panics", planted::panic) },
    FuzzTarget { is_planted: true, ..FuzzTarget::new("planted_thread", "panics in a thread", planted::thread) },
    FuzzTarget { is_planted: true, ..FuzzTarget::new("planted_stack", "overflows the stack", planted::stack) },
    FuzzTarget { is_planted: true, limit_secs: 0.5, ..FuzzTarget::new("planted_hang", "does not end", planted::hang) },
    FuzzTarget { is_planted: true, ..FuzzTarget::new("planted_memory", "allocates without bound", planted::memory) },
];

/// The targets of these names; all that do not fail on purpose, if there is none.
pub(crate) fn targets_by_name(names: &[String]) -> Result<Vec<&'static FuzzTarget>, String> {
    let usual = || ALL_TARGETS.iter().filter(|target| !target.is_planted);
    if names.is_empty() {
        return Ok(usual().collect());
    }
    let find = |name: &String| {
        ALL_TARGETS.iter().find(|target| target.name == name).ok_or_else(|| {
            let known: Vec<&str> = usual().map(|target| target.name).collect();
            format!("there is no target {name:?}; expected some of {}", known.join(", "))
        })
    };
    names.iter().map(find).collect()
}

/// The input as text, as a reader that checks it for UTF-8 would get it; other input is no use to it.
fn utf8_text(bytes: &[u8]) -> Option<&str> {
    std::str::from_utf8(bytes).ok()
}
