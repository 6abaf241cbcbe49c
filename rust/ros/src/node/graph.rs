//! A node's place on the graph: its start, its watch over the master, its jobs, its end.

use super::{
    NodeDiagnostics,
    master::{self, MasterAddresses, Registrations},
    reconnect, rosout,
    tcp_nodelay::set_tcp_nodelay,
    type_mismatch,
};
use crate::{
    messages::diagnostic_msgs::DiagnosticArray,
    publishing::{self, Publisher},
};
use proact_types::renamed_keys::{ConfigFile, DuplicateKey, RENAMED_KEYS, RenamedKey};
use rosrust::{Message, ServicePair, Subscriber};
use std::{
    cell::Cell,
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, AtomicU64, Ordering},
        mpsc::{Receiver, SyncSender, sync_channel},
    },
    time::{Duration, Instant},
};

/// Jobs that may wait for one tick of the loop.
const MAX_PENDING_JOBS: usize = 1024;
/// How often the master is looked at. A restart is noticed within two of these.
const MASTER_CHECK_PERIOD: Duration = Duration::from_millis(500);
/// A topic may bring this many messages in [`FLOOD_WINDOW`]; those beyond are refused.
const MAX_MESSAGES_PER_WINDOW: u32 = 200;
/// In lock-step nobody is faster than everybody.
const MAX_MESSAGES_PER_WINDOW_LOCKSTEP: u32 = 100_000;
const FLOOD_WINDOW: Duration = Duration::from_millis(100);
/// Nodes live by `/clock` where it is true.
const USE_SIM_TIME: &str = "/use_sim_time";
/// How long a service call may wait for the loop.
const SERVICE_TIMEOUT: Duration = Duration::from_secs(5);

/// A subscriber that takes nothing for this long is closed, s.
const WRITE_TIMEOUT_PARAM: &str = "~write_timeout_secs";
/// Longer than a person looks at a stopped program in a debugger, shorter than a laptop sleeps.
const DEFAULT_WRITE_TIMEOUT_SECS: f64 = 60.0;
const MAX_WRITE_TIMEOUT: Duration = Duration::from_secs(24 * 3600);
const WRITE_TIMEOUT_RANGE: &str = "seconds, 0.001 to 86400";
/// Messages that wait for each subscriber of each topic; 0 leaves each topic its own number.
const QUEUE_SIZE_PARAM: &str = "~queue_size";
const QUEUE_SIZE_RANGE: &str = "a number of messages, or 0 for each topic's own";

/// Why a node cannot run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NodeError {
    /// Nobody answers at the master's address, or it refuses us.
    #[error(
        "no ROS master at {uri} takes this node: {reason}; start one with roscore, or set ROS_MASTER_URI"
    )]
    NoMaster {
        /// Its address.
        uri: String,
        /// As the library puts it.
        reason: String,
    },
    /// A topic or service could not be set up.
    #[error("{what}: {reason}")]
    Setup {
        /// Its name.
        what: String,
        /// As the library puts it.
        reason: String,
    },
    /// A parameter has another type or value than expected.
    #[error("parameter {name} is {got}, expected {expected}")]
    Parameter {
        /// Its name.
        name: String,
        /// As given.
        got: String,
        /// What is allowed.
        expected: &'static str,
    },
    /// A parameter is set by its old and its new name.
    #[error("parameter {0}; rosparam delete takes one away")]
    DuplicateParameter(DuplicateKey),
    /// The testbed refused.
    #[error(transparent)]
    Testbed(#[from] proact_testbed::TestbedError),
    /// A value could not be written as JSON.
    #[error("cannot write {what}: {source}")]
    Json {
        /// Which value.
        what: &'static str,
        /// Why.
        source: serde_json::Error,
    },
}

pub(super) fn setup_error(what: &str) -> impl FnOnce(rosrust::error::Error) -> NodeError + '_ {
    move |error| NodeError::Setup { what: what.to_owned(), reason: error_chain_text(&error) }
}

pub(super) fn master_uri() -> String {
    std::env::var("ROS_MASTER_URI").unwrap_or_else(|_| "http://localhost:11311/".to_owned())
}

fn error_chain_text(error: &rosrust::error::Error) -> String {
    error.iter().map(ToString::to_string).collect::<Vec<_>>().join(": ")
}

/// The master's address and that of this process, which is on the graph.
pub(super) fn addresses() -> Result<MasterAddresses, NodeError> {
    let uri = master_uri();
    let parse = |text: &str| {
        text.parse().map_err(|e| NodeError::Setup { what: text.to_owned(), reason: format!("{e:?}") })
    };
    let own = rosrust::uri();
    Ok(MasterAddresses { master: parse(&uri)?, slave: parse(&own)?, slave_uri: own, name: rosrust::name() })
}

/// Something for the loop to do with its state `S`.
pub(super) type Job<S> = Box<dyn FnOnce(&mut S) + Send>;

/// A node on the graph. Dropping it leaves the graph.
pub struct RosGraph {
    node_diagnostics: Arc<NodeDiagnostics>,
    master_restarted: Arc<AtomicBool>,
    ended: Arc<AtomicBool>,
    watch_thread: Option<std::thread::JoinHandle<()>>,
    diagnostics: Publisher<DiagnosticArray>,
    last_diagnostics_at: Mutex<Option<Instant>>,
    /// Messages of a topic within [`FLOOD_WINDOW`].
    max_messages_per_window: u32,
}

impl RosGraph {
    /// Joins the graph as `name`, or as `__name:=` says. roslaunch's other words work as well.
    ///
    /// # Errors
    /// [`NodeError::NoMaster`].
    pub fn join(name: &str) -> Result<Self, NodeError> {
        Self::join_with(name, true)
    }

    /// [`RosGraph::join`]; with `interruptible`, Ctrl-C ends the node.
    pub(super) fn join_with(name: &str, interruptible: bool) -> Result<Self, NodeError> {
        let uri = master_uri();
        let joining = publishing::join();
        rosrust::try_init_with_options(name, interruptible)
            .map_err(|error| NodeError::NoMaster { uri: uri.clone(), reason: error_chain_text(&error) })?;
        publishing::start(publishing_settings()?).map_err(|error| NodeError::Setup {
            what: "the port for topics".to_owned(),
            reason: error.to_string(),
        })?;
        rosout::open().map_err(setup_error(rosout::TOPIC))?;
        drop(joining);
        warn_of_unknown_parameters();
        let diagnostics = Publisher::new("/diagnostics", 10, false).map_err(setup_error("/diagnostics"))?;
        Ok(Self {
            node_diagnostics: Arc::new(NodeDiagnostics::default()),
            master_restarted: Arc::new(AtomicBool::new(false)),
            ended: Arc::new(AtomicBool::new(false)),
            watch_thread: None,
            diagnostics,
            last_diagnostics_at: Mutex::default(),
            max_messages_per_window: if super::stage::read_lockstep_parameter()? {
                MAX_MESSAGES_PER_WINDOW_LOCKSTEP
            } else {
                MAX_MESSAGES_PER_WINDOW
            },
        })
    }

    /// Watches the master from now on. Call it when all topics and services are set up.
    ///
    /// # Errors
    /// Addresses that are none.
    pub fn watch_master(&mut self) -> Result<(), NodeError> {
        let addresses = self.addresses()?;
        let (ended, restarted) = (self.ended.clone(), self.master_restarted.clone());
        set_tcp_nodelay();
        reconnect::start(addresses.clone(), ended.clone());
        self.watch_thread =
            Some(std::thread::spawn(move || run_master_watch(&addresses, &ended, &restarted)));
        Ok(())
    }

    /// The master's address and our own.
    pub(super) fn addresses(&self) -> Result<MasterAddresses, NodeError> {
        addresses()
    }

    /// Ends the watch over the master. Call it before publishers and services go, or the watch would register again
    /// what leaves.
    pub fn stop_watching(&mut self) {
        self.ended.store(true, Ordering::Relaxed);
        if let Some(watch) = self.watch_thread.take() {
            // A watch that panicked has told so itself.
            let _ = watch.join();
        }
    }

    /// What was refused.
    pub fn node_diagnostics(&self) -> &Arc<NodeDiagnostics> {
        &self.node_diagnostics
    }

    /// False when the node is to end: Ctrl-C, rosnode kill, a new node of the same name.
    pub fn is_ok(&self) -> bool {
        rosrust::is_ok()
    }

    /// True once after the master was restarted and knows us again.
    pub fn master_restarted(&self) -> bool {
        self.master_restarted.swap(false, Ordering::Relaxed)
    }

    /// Tells `/diagnostics` how things are, once a second; call it as often as you like.
    pub fn publish_diagnostics(&self, stamp: rosrust::Time) {
        let mut last_sent_at = self.last_diagnostics_at.lock().unwrap_or_else(PoisonError::into_inner);
        if last_sent_at.is_none_or(|at| at.elapsed() >= Duration::from_secs(1)) {
            *last_sent_at = Some(Instant::now());
            // Nobody may listen; that is no fault.
            let _ = self.diagnostics.send(self.node_diagnostics.to_message(&rosrust::name(), stamp));
        }
    }

    /// A publisher with a queue of `queue` messages for each subscriber; relative names follow the node's namespace.
    ///
    /// # Errors
    /// [`NodeError::Setup`].
    pub(crate) fn advertise<M: Message>(
        &self,
        topic: &str,
        queue: usize,
        latched: bool,
    ) -> Result<Publisher<M>, NodeError> {
        Publisher::new(topic, queue, latched).map_err(setup_error(topic))
    }

    /// A subscriber whose messages become jobs of the loop. More than two a millisecond are refused.
    ///
    /// # Errors
    /// [`NodeError::Setup`].
    pub fn subscribe<M: Message, S: 'static>(
        &self,
        topic: &str,
        queue: usize,
        jobs: &Jobs<S>,
        take: impl Fn(&mut S, M) + Send + Sync + 'static,
    ) -> Result<Subscriber, NodeError> {
        self.subscribe_with_arrival(topic, queue, jobs, move |state: &mut S, message, _, _: &str| {
            take(state, message)
        })
    }

    /// [`RosGraph::listen`] with the name of the node that sent the message.
    ///
    /// # Errors
    /// [`NodeError::Setup`].
    pub fn subscribe_with_caller<M: Message, S: 'static>(
        &self,
        topic: &str,
        queue: usize,
        jobs: &Jobs<S>,
        take: impl Fn(&mut S, M, &str) + Send + Sync + 'static,
    ) -> Result<Subscriber, NodeError> {
        self.subscribe_with_arrival(topic, queue, jobs, move |state: &mut S, message, _, caller: &str| {
            take(state, message, caller);
        })
    }

    /// [`RosGraph::listen`] with the time at which the message came, and from whom.
    ///
    /// # Errors
    /// [`NodeError::Setup`].
    pub fn subscribe_with_arrival<M: Message, S: 'static>(
        &self,
        topic: &str,
        queue: usize,
        jobs: &Jobs<S>,
        take: impl Fn(&mut S, M, Instant, &str) + Send + Sync + 'static,
    ) -> Result<Subscriber, NodeError> {
        let (faults, sender, take) = (self.node_diagnostics.clone(), jobs.sender.clone(), Arc::new(take));
        let window = Cell::new((Instant::now(), 0_u32));
        let name = topic.to_owned();
        let flood = self.max_messages_per_window;
        let callback = move |message: M, caller: &str| {
            let at = Instant::now();
            let (began, count) = window.get();
            if began.elapsed() > FLOOD_WINDOW {
                window.set((Instant::now(), 1));
            } else {
                window.set((began, count + 1));
                if count >= flood {
                    let reason = format!("{name} brings more than {flood} messages in {FLOOD_WINDOW:?}");
                    return faults.record_refusal("flood", &reason);
                }
            }
            let (take, caller) = (take.clone(), caller.to_owned());
            if sender.try_send(Box::new(move |state| take(state, message, at, &caller))).is_err() {
                faults.record_refusal("flood", &format!("{name}: {MAX_PENDING_JOBS} messages wait already"));
            }
        };
        type_mismatch::record_type::<M>();
        rosrust::subscribe_with_ids(topic, queue, callback).map_err(setup_error(topic))
    }

    /// A service that the loop answers.
    ///
    /// # Errors
    /// [`NodeError::Setup`].
    pub fn advertise_service<P, S>(
        &self,
        service: &str,
        jobs: &Jobs<S>,
        answer: impl Fn(&mut S, P::Request) -> Result<P::Response, String> + Send + Sync + 'static,
    ) -> Result<rosrust::Service, NodeError>
    where
        P: ServicePair,
        S: 'static,
    {
        let (sender, answer) = (jobs.sender.clone(), Arc::new(answer));
        let handler = move |request: P::Request| {
            let (reply, wait) = sync_channel(1);
            let answer = answer.clone();
            let job: Job<S> = Box::new(move |state| {
                // Whoever asked may have gone.
                let _ = reply.send(answer(state, request));
            });
            sender.try_send(job).map_err(|_| "the node is overloaded; call again".to_owned())?;
            wait.recv_timeout(SERVICE_TIMEOUT).map_err(|_| format!("no answer within {SERVICE_TIMEOUT:?}"))?
        };
        rosrust::service::<P, _>(service, handler).map_err(setup_error(service))
    }
}

impl Drop for RosGraph {
    fn drop(&mut self) {
        self.stop_watching();
        // What the library has set up for itself, such as its clock with /use_sim_time, it does not take back.
        if let Ok(addresses) = self.addresses() {
            master::unregister_topics(&addresses);
        }
        // Without this the master keeps the node.
        rosrust::shutdown();
    }
}

/// Jobs between callbacks and the loop.
#[derive(Debug)]
pub struct Jobs<S> {
    sender: SyncSender<Job<S>>,
    receiver: Receiver<Job<S>>,
}

impl<S> Default for Jobs<S> {
    fn default() -> Self {
        let (sender, receiver) = sync_channel(MAX_PENDING_JOBS);
        Self { sender, receiver }
    }
}

impl<S> Jobs<S> {
    /// Does what waits.
    pub fn run(&self, state: &mut S) {
        while let Ok(job) = self.receiver.try_recv() {
            job(state);
        }
    }

    /// Waits for one job, at most for `timeout`, and does it.
    pub fn run_next(&self, state: &mut S, timeout: Duration) {
        if let Ok(job) = self.receiver.recv_timeout(timeout) {
            job(state);
        }
    }
}

/// The parameter `/use_sim_time`, set for as long as this lives.
#[derive(Debug)]
pub(super) struct SimTimeParameter(());

impl SimTimeParameter {
    /// Sets it where it is unset, since other nodes would live on wall time beside the simulator's `/clock`. Where somebody
    /// has set it to false it stays, and a warning says what follows.
    pub(super) fn set() -> Option<SimTimeParameter> {
        let parameter = rosrust::param(USE_SIM_TIME)?;
        match parameter.get::<bool>() {
            Ok(true) => None,
            Ok(false) => {
                rosout::warn(&format!(
                    "{USE_SIM_TIME} is false: other nodes live on wall time, and stamps of theirs are not the simulator's"
                ));
                None
            }
            Err(_) => parameter.set(&true).ok().map(|()| SimTimeParameter(())),
        }
    }
}

impl Drop for SimTimeParameter {
    fn drop(&mut self) {
        // A node that starts after the last simulator would wait for a clock for ever.
        if let Some(parameter) = rosrust::param(USE_SIM_TIME) {
            let _ = parameter.delete();
        }
    }
}

/// Reads the parameters `~write_timeout_secs` and `~queue_size`; a value outside its range is an error.
fn publishing_settings() -> Result<publishing::PublishingSettings, NodeError> {
    let seconds: f64 = parameter(WRITE_TIMEOUT_PARAM, DEFAULT_WRITE_TIMEOUT_SECS, WRITE_TIMEOUT_RANGE)?;
    let closes_after = Duration::try_from_secs_f64(seconds)
        .ok()
        .filter(|time| (Duration::from_millis(1)..=MAX_WRITE_TIMEOUT).contains(time))
        .ok_or_else(|| parameter_error(WRITE_TIMEOUT_PARAM, seconds, WRITE_TIMEOUT_RANGE))?;
    let length: i32 = parameter(QUEUE_SIZE_PARAM, 0, QUEUE_SIZE_RANGE)?;
    let length =
        usize::try_from(length).map_err(|_| parameter_error(QUEUE_SIZE_PARAM, length, QUEUE_SIZE_RANGE))?;
    Ok(publishing::PublishingSettings {
        write_timeout: closes_after,
        queue_size: (length > 0).then_some(length),
        log: rosout::warn,
    })
}

fn parameter_error(name: &str, got: impl ToString, expected: &'static str) -> NodeError {
    NodeError::Parameter { name: name.to_owned(), got: got.to_string(), expected }
}

/// What the parameter `name` was called before.
fn old_names(name: &str) -> impl Iterator<Item = &'static RenamedKey> {
    RENAMED_KEYS.iter().filter(move |row| row.file == ConfigFile::NodeParameter && row.new == name)
}

/// Private parameters of the nodes.
const PRIVATE_PARAMETERS: [&str; 12] = [
    "compat",
    "count",
    "digest_file",
    "exclude_frames",
    "keep_running",
    "lockstep",
    "paused",
    "port",
    "publish_links",
    "queue_size",
    "rate_hz",
    "write_timeout_secs",
];

/// Names the node's own parameters that no node reads: a misspelled one would leave the default.
fn warn_of_unknown_parameters() {
    let own = rosrust::param("~").and_then(|parameter| parameter.get_raw().ok());
    let Some(xml_rpc::Value::Struct(own)) = own else { return };
    let is_known = |name: &str| {
        let private = format!("~{name}");
        let renamed =
            RENAMED_KEYS.iter().any(|row| row.file == ConfigFile::NodeParameter && row.old == private);
        renamed || PRIVATE_PARAMETERS.contains(&name)
    };
    for name in own.keys().filter(|name| !is_known(name)) {
        rosout::warn(&format!(
            "parameter ~{name} is unknown and not read, expected one of ~{}",
            PRIVATE_PARAMETERS.join(", ~")
        ));
    }
}

/// The value of parameter `name`, which may be set by a name that it had before, or `default` when it is not set.
///
/// # Errors
/// A value of another type.
pub fn parameter<T>(name: &str, default: T, expected: &'static str) -> Result<T, NodeError>
where
    T: serde::de::DeserializeOwned,
{
    let set = |name| rosrust::param(name).filter(|parameter| parameter.exists().unwrap_or(false));
    let mut found = set(name);
    for row in old_names(name) {
        let Some(old) = set(row.old) else { continue };
        if found.is_some() {
            let (old, new) = (row.old.to_owned(), row.new.to_owned());
            return Err(NodeError::DuplicateParameter(DuplicateKey { old, new }));
        }
        rosout::warn(&format!("parameter {row}"));
        found = Some(old);
    }
    let Some(parameter) = found else { return Ok(default) };
    parameter.get().map_err(|_| NodeError::Parameter {
        name: parameter.name().to_owned(),
        got: parameter.get_raw().map(|v| format!("{v:?}")).unwrap_or_default(),
        expected,
    })
}

/// A loop that falls behind by more goes on from where it is. One that raced to catch up would leave the other nodes no
/// time to stop the arm: it moved for 100 ms more once the machine had stood still for so long.
const MAX_LAG: Duration = Duration::from_millis(20);

/// Keeps a loop of one-millisecond ticks in step with the clock on the wall.
#[derive(Debug)]
pub(super) struct TickRate {
    start: Instant,
    ticks: u64,
}

impl TickRate {
    pub(super) fn new() -> Self {
        Self { start: Instant::now(), ticks: 0 }
    }

    /// Sleeps until the tick is due.
    pub(super) fn sleep(&mut self) {
        self.ticks += 1;
        let due = self.start + Duration::from_millis(self.ticks);
        let now = Instant::now();
        if due > now {
            std::thread::sleep(due - now);
        } else if now - due > MAX_LAG {
            self.start = now;
            self.ticks = 0;
        }
    }
}

/// Looks at the master until `ended`, and registers again when it was restarted.
pub(super) fn run_master_watch(addresses: &MasterAddresses, ended: &AtomicBool, restarted: &AtomicBool) {
    let mut pid = master::master_pid(addresses).ok();
    let mut known: Option<Registrations> = None;
    // Why it failed last: said when it changes, and not twice a second while the master is coming up.
    let mut failed = None;
    static REFRESH: AtomicU64 = AtomicU64::new(0);
    while !ended.load(Ordering::Relaxed) && rosrust::is_ok() {
        match master::master_pid(addresses) {
            Ok(now) if Some(now) == pid && master::is_registered(addresses) => {
                // What we have registered may have changed.
                let refreshes = known.is_none() || REFRESH.fetch_add(1, Ordering::Relaxed).is_multiple_of(10);
                if refreshes && let Ok(state) = rosrust::state() {
                    known = master::registrations(addresses, state).ok().or(known);
                }
            }
            Ok(now) => {
                if let Some(all) = &mut known {
                    let done = master::refresh_topics(addresses, all)
                        .and_then(|()| master::register(addresses, all));
                    match done {
                        Ok(()) => {
                            pid = Some(now);
                            restarted.store(true, Ordering::Relaxed);
                        }
                        // It may go again while it comes up; the next look tries again.
                        Err(reason) if failed.as_ref() == Some(&reason) => {}
                        Err(reason) => {
                            rosout::warn(&format!("registering with the restarted master: {reason}"));
                            failed = Some(reason);
                        }
                    }
                }
            }
            // It is gone; live connections go on.
            Err(_) => {}
        }
        // A connection that came while a topic was being set up, and our own to services.
        set_tcp_nodelay();
        let wake = Instant::now() + MASTER_CHECK_PERIOD;
        while !ended.load(Ordering::Relaxed) && Instant::now() < wake {
            std::thread::sleep(Duration::from_millis(50));
        }
    }
}
