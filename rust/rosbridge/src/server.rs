//! The server: a router that makes every request a client of the bus.

use crate::{RosbridgeError, actions::ActionBridge, bus::MemberId, bus::TopicBus, connection, rosapi};
use axum::{
    Extension, Router,
    extract::{State, ws::WebSocketUpgrade},
    http::{StatusCode, Uri},
    response::{IntoResponse, Response},
    routing::any,
};
use proact_http::{
    AccessConfig, AllowedOrigins, ConnectionLimits, HttpServer, HttpServerOptions, LogThrottle, Peer,
};
use proact_messages::{RosVersion, Time};
use std::{
    collections::VecDeque,
    net::{IpAddr, Ipv4Addr, SocketAddr},
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
    time::{Duration, Instant, SystemTime, UNIX_EPOCH},
};

/// Most clients at once.
const MAX_CLIENTS: usize = 64;
/// What the system may hold back for one connection, bytes. With its own choice of megabytes a slow client would
/// get messages many seconds late instead of losing old ones.
const SEND_BUFFER_BYTES: u32 = 256 * 1024;
/// Written to the system at least this often while a batch is on its way, bytes.
const WRITE_BUFFER_BYTES: usize = 64 * 1024;
/// Longest rest of a measured gaze: `dead_man.gaze_timeout_ms` of the default profile.
const FROZEN_GAZE_TIMEOUT: Duration = Duration::from_secs(1);
/// Notices kept for an owner that does not fetch them.
const MAX_NOTICES: usize = 200;

/// Where to serve, and for whom.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RosbridgeOptions {
    /// TCP port; zero lets the system choose.
    pub port: u16,
    /// Address to listen on. On a loopback address only this machine can connect.
    pub bind: IpAddr,
    /// Who may connect from other machines.
    pub access: AccessConfig,
    /// How long a connection may dawdle, and how many there may be.
    pub limits: ConnectionLimits,
    /// A client whose gaze is the same for longer is warned that it counts as a frozen eye tracker; none: it does not.
    pub frozen_gaze_timeout: Option<Duration>,
}

impl Default for RosbridgeOptions {
    /// Port 9090, this machine only.
    fn default() -> Self {
        RosbridgeOptions {
            port: 9090,
            bind: Ipv4Addr::LOCALHOST.into(),
            access: AccessConfig::default(),
            limits: ConnectionLimits::default(),
            frozen_gaze_timeout: Some(FROZEN_GAZE_TIMEOUT),
        }
    }
}

/// What all connections share.
pub(super) struct RosbridgeState {
    pub(super) limits: ConnectionLimits,
    pub(super) frozen_gaze_timeout: Option<Duration>,
    pub(super) bus: Arc<dyn TopicBus>,
    pub(super) actions: Arc<ActionBridge>,
    clients: AtomicUsize,
    notices: Mutex<Notices>,
}

/// What the owner is told.
#[derive(Default)]
struct Notices {
    repeats: LogThrottle,
    queued: VecDeque<String>,
}

impl Notices {
    /// The oldest is forgotten if nobody asks.
    fn add(&mut self, text: String) {
        if self.queued.len() == MAX_NOTICES {
            self.queued.pop_front();
        }
        self.queued.push_back(text);
    }
}

impl RosbridgeState {
    /// Tells the owner something; of what happens again and again, the first and the count.
    pub(super) fn notice(&self, kind: &'static str, text: String) {
        // Clients' words are printed on a terminal: no control characters, and no more than one reads.
        let text: String = text.chars().take(300).map(|c| if c.is_control() { '?' } else { c }).collect();
        // No code that holds the lock can panic half way through a change.
        let mut notices = self.notices.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(text) = notices.repeats.report(kind, text, Instant::now()) {
            notices.add(text);
        }
    }
}

/// The rosbridge server. Runs in its own thread until it is dropped.
pub struct RosbridgeServer {
    state: Arc<RosbridgeState>,
    member: MemberId,
    // Some until it is dropped: the clients go first, rosapi's services after them.
    server: Option<HttpServer>,
    address: SocketAddr,
}

impl RosbridgeServer {
    /// Listens and begins to serve the topics and services of `bus`, and those of rosapi.
    ///
    /// # Errors
    /// [`RosbridgeError::Serve`] if the port is taken, the address is not ours, or other machines could connect and nothing
    /// says which; [`RosbridgeError::Bus`] if the bus is full.
    pub fn start(options: RosbridgeOptions, bus: Arc<dyn TopicBus>) -> Result<Self, RosbridgeError> {
        let RosbridgeOptions { port, bind, access, limits, frozen_gaze_timeout: frozen_gaze } = options;
        let shared = Arc::new(RosbridgeState {
            limits,
            frozen_gaze_timeout: frozen_gaze,
            bus: Arc::clone(&bus),
            actions: Arc::new(ActionBridge::new(Arc::clone(&bus))),
            clients: AtomicUsize::new(0),
            notices: Mutex::default(),
        });
        let options = HttpServerOptions {
            name: "rosbridge",
            port,
            further_ports: 0,
            port_option: "--rosbridge PORT",
            bind,
            https: false,
            access,
            // The page of a trial is one of another port.
            allowed_origins: AllowedOrigins::SameHost,
            send_buffer_bytes: SEND_BUFFER_BYTES,
            limits,
        };
        let router = Router::new().fallback(any(connect)).with_state(Arc::clone(&shared));
        let for_refusals = Arc::clone(&shared);
        let member = bus.join("/rosapi");
        let started = rosapi::advertise_services(&bus, member, wall_time)
            .map_err(RosbridgeError::from)
            .and_then(|()| {
                let refused = move |reason| for_refusals.notice("refused", reason);
                Ok(HttpServer::start(options, router, refused, std::future::pending())?)
            });
        match started {
            Ok(server) => {
                let address = server.address();
                Ok(RosbridgeServer { state: shared, member, server: Some(server), address })
            }
            Err(error) => {
                bus.leave(member);
                Err(error)
            }
        }
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Number of clients that are connected.
    pub fn client_count(&self) -> usize {
        self.state.clients.load(Ordering::Relaxed)
    }

    /// What happened since the last call, one line each: clients that came, went or were refused, and the first
    /// mistake of each. Where there are many of a kind, they are counted ([`LogThrottle`]).
    pub fn drain_notices(&self) -> Vec<String> {
        let mut notices = self.state.notices.lock().unwrap_or_else(PoisonError::into_inner);
        for text in notices.repeats.take_due(Instant::now()) {
            notices.add(text);
        }
        notices.queued.drain(..).collect()
    }
}

impl Drop for RosbridgeServer {
    fn drop(&mut self) {
        drop(self.server.take());
        self.state.bus.leave(self.member);
    }
}

/// The time of day, for stamps that clients leave out.
pub(super) fn wall_time() -> Time {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    // ROS 1 counts seconds in 32 bits, until 2106.
    Time { secs: u32::try_from(since.as_secs()).unwrap_or(u32::MAX), nsecs: since.subsec_nanos() }
}

/// Counts a client for as long as it lives.
struct RosbridgeClientSlot(Arc<RosbridgeState>);

impl RosbridgeClientSlot {
    /// None if there are as many as are allowed.
    fn acquire(shared: &Arc<RosbridgeState>) -> Option<Self> {
        let before = shared.clients.fetch_add(1, Ordering::Relaxed);
        let count = RosbridgeClientSlot(Arc::clone(shared));
        (before < MAX_CLIENTS).then_some(count)
    }
}

impl Drop for RosbridgeClientSlot {
    fn drop(&mut self) {
        self.0.clients.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Any path will do, as with other rosbridges. With `?ros=2` the client is one of ROS 2 from the start.
async fn connect(
    State(shared): State<Arc<RosbridgeState>>,
    Extension(peer): Extension<Peer>,
    uri: Uri,
    upgrade: WebSocketUpgrade,
) -> Response {
    let Some(count) = RosbridgeClientSlot::acquire(&shared) else {
        let reason = format!("{MAX_CLIENTS} clients are connected already\n");
        return (StatusCode::SERVICE_UNAVAILABLE, reason).into_response();
    };
    let is_ros2 = uri.query().is_some_and(|query| query.split('&').any(|pair| pair == "ros=2"));
    let convention = if is_ros2 { RosVersion::Ros2 } else { RosVersion::Ros1 };
    upgrade
        .max_message_size(connection::MAX_MESSAGE_BYTES)
        .max_frame_size(connection::MAX_MESSAGE_BYTES)
        .write_buffer_size(WRITE_BUFFER_BYTES)
        .on_upgrade(async move |socket| {
            connection::serve(socket, peer.address, convention, &shared).await;
            drop(count);
        })
}
