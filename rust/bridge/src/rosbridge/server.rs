//! The WebSocket server, in a thread of its own.

use super::{
    access::{Access, Visitor},
    bus::{MemberId, TopicBus},
    connection, rosapi,
    value::Time,
};
use crate::BridgeError;
use std::{
    collections::VecDeque,
    net::{IpAddr, Ipv4Addr, SocketAddr},
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
    thread::JoinHandle,
    time::{Duration, SystemTime, UNIX_EPOCH},
};
use tokio::{
    net::{TcpListener, TcpSocket, TcpStream},
    runtime::Runtime,
    sync::oneshot,
};
use tokio_tungstenite::{
    WebSocketStream, accept_hdr_async_with_config,
    tungstenite::{
        handshake::server::{ErrorResponse, Request, Response},
        http::{HeaderMap, StatusCode, header},
        protocol::WebSocketConfig,
    },
};

/// Most clients at once.
const MAX_CLIENTS: usize = 64;
/// Connections that may be about to become clients, beyond that.
const MAX_HANDSHAKES: usize = 64;
/// A connection that has not become a WebSocket by then is closed.
const HANDSHAKE_TIMEOUT: Duration = Duration::from_secs(5);
/// What the system may hold back for one connection, bytes. With its own choice of megabytes a slow client would
/// get messages many seconds late instead of losing old ones.
const SEND_BUFFER_BYTES: u32 = 256 * 1024;
/// Written to the system at least this often while a batch is on its way, bytes.
const WRITE_BUFFER_BYTES: usize = 64 * 1024;
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
    pub access: Access,
}

impl Default for RosbridgeOptions {
    /// Port 9090, this machine only.
    fn default() -> Self {
        RosbridgeOptions { port: 9090, bind: Ipv4Addr::LOCALHOST.into(), access: Access::default() }
    }
}

/// What all connections share.
pub(super) struct Shared {
    pub(super) bus: Arc<dyn TopicBus>,
    access: Access,
    clients: AtomicUsize,
    connections: AtomicUsize,
    notices: Mutex<VecDeque<String>>,
}

impl Shared {
    /// Tells the owner something; the oldest is forgotten if nobody asks.
    pub(super) fn notice(&self, text: String) {
        // Clients' words are printed on a terminal: no control characters, and no more than one reads.
        let text: String = text.chars().take(300).map(|c| if c.is_control() { '?' } else { c }).collect();
        // No code that holds the lock can panic half way through a change.
        let mut notices = self.notices.lock().unwrap_or_else(PoisonError::into_inner);
        if notices.len() == MAX_NOTICES {
            notices.pop_front();
        }
        notices.push_back(text);
    }
}

/// The rosbridge server. Runs in its own thread until it is dropped.
pub struct RosbridgeServer {
    shared: Arc<Shared>,
    member: MemberId,
    address: SocketAddr,
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl RosbridgeServer {
    /// Listens and begins to serve the topics and services of `bus`, and those of rosapi.
    ///
    /// # Errors
    /// [`BridgeError::RosbridgePortTaken`] if somebody else listens there, [`BridgeError::Listen`] if the address is
    /// not ours, [`BridgeError::Unguarded`] if other machines could connect and nothing says which,
    /// [`BridgeError::Content`] for a token that cannot be used, [`BridgeError::Thread`] if the system has no thread.
    pub fn start(options: RosbridgeOptions, bus: Arc<dyn TopicBus>) -> Result<Self, BridgeError> {
        let RosbridgeOptions { port, bind, access } = options;
        access.check().map_err(|what| BridgeError::Content { what })?;
        if !bind.is_loopback() && access.local_only() {
            return Err(BridgeError::Unguarded { address: bind });
        }
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .map_err(|source| BridgeError::Thread { source })?;
        let refused = |source: std::io::Error| match source.kind() {
            std::io::ErrorKind::AddrInUse => BridgeError::RosbridgePortTaken { port, address: bind },
            _ => BridgeError::Listen { address: (bind, port).into(), source },
        };
        let listener = {
            let _inside = runtime.enter();
            listen((bind, port).into()).map_err(refused)?
        };
        let address = listener.local_addr().map_err(refused)?;
        let member = bus.join("/rosapi");
        rosapi::offer(&bus, member, wall_clock)
            .map_err(|error| BridgeError::Content { what: error.to_string() })?;
        let shared = Arc::new(Shared {
            bus,
            access,
            clients: AtomicUsize::new(0),
            connections: AtomicUsize::new(0),
            notices: Mutex::default(),
        });
        let (stop, stopped) = oneshot::channel();
        let for_thread = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("rosbridge".to_owned())
            .spawn(move || run(&runtime, listener, &for_thread, stopped))
            .map_err(|source| BridgeError::Thread { source })?;
        Ok(RosbridgeServer { shared, member, address, stop: Some(stop), thread: Some(thread) })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Number of clients that are connected.
    pub fn client_count(&self) -> usize {
        self.shared.clients.load(Ordering::Relaxed)
    }

    /// What happened since the last call, one line each: clients that came, went or were refused, and the first
    /// mistake of each.
    pub fn drain_notices(&self) -> Vec<String> {
        self.shared.notices.lock().unwrap_or_else(PoisonError::into_inner).drain(..).collect()
    }
}

impl Drop for RosbridgeServer {
    fn drop(&mut self) {
        if let Some(stop) = self.stop.take() {
            // An error means that the thread has ended already.
            let _ = stop.send(());
        }
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
        self.shared.bus.leave(self.member);
    }
}

/// The time of day, for stamps that clients leave out.
pub(super) fn wall_clock() -> Time {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    // ROS 1 counts seconds in 32 bits, until 2106.
    Time { secs: u32::try_from(since.as_secs()).unwrap_or(u32::MAX), nsecs: since.subsec_nanos() }
}

fn listen(address: SocketAddr) -> std::io::Result<TcpListener> {
    let socket = if address.is_ipv4() { TcpSocket::new_v4()? } else { TcpSocket::new_v6()? };
    // A restarted server gets its port back at once, although old connections still linger.
    socket.set_reuseaddr(true)?;
    // Connections inherit it.
    socket.set_send_buffer_size(SEND_BUFFER_BYTES)?;
    socket.bind(address)?;
    socket.listen(128)
}

/// The server's thread.
fn run(runtime: &Runtime, listener: TcpListener, shared: &Arc<Shared>, stopped: oneshot::Receiver<()>) {
    runtime.block_on(async {
        tokio::select! {
            () = accept(listener, shared) => {}
            _ = stopped => {}
        }
    });
    // Dropping the runtime ends all connections.
}

async fn accept(listener: TcpListener, shared: &Arc<Shared>) {
    loop {
        let Ok((stream, peer)) = listener.accept().await else {
            // Out of file descriptors, most likely: some come free when clients go.
            tokio::time::sleep(Duration::from_millis(100)).await;
            continue;
        };
        let count = Count::up(Arc::clone(shared), |shared| &shared.connections);
        if count.now() > MAX_CLIENTS + MAX_HANDSHAKES {
            continue;
        }
        let shared = Arc::clone(shared);
        tokio::spawn(async move {
            let _count = count;
            admit(stream, peer, shared).await;
        });
    }
}

/// Counts a connection for as long as it lives.
struct Count {
    shared: Arc<Shared>,
    counter: fn(&Shared) -> &AtomicUsize,
}

impl Count {
    fn up(shared: Arc<Shared>, counter: fn(&Shared) -> &AtomicUsize) -> Self {
        counter(&shared).fetch_add(1, Ordering::Relaxed);
        Count { shared, counter }
    }

    fn now(&self) -> usize {
        (self.counter)(&self.shared).load(Ordering::Relaxed)
    }
}

impl Drop for Count {
    fn drop(&mut self) {
        (self.counter)(&self.shared).fetch_sub(1, Ordering::Relaxed);
    }
}

async fn admit(stream: TcpStream, peer: SocketAddr, shared: Arc<Shared>) {
    // Small messages must not wait for each other. Failing is no reason to refuse the client.
    let _ = stream.set_nodelay(true);
    let client = Count::up(Arc::clone(&shared), |shared| &shared.clients);
    let full = client.now() > MAX_CLIENTS;
    let socket = tokio::time::timeout(HANDSHAKE_TIMEOUT, handshake(stream, peer, full, &shared)).await;
    // Otherwise it was refused, is no WebSocket, or nothing came.
    if let Ok(Some(socket)) = socket {
        connection::serve(socket, peer, &shared).await;
    }
}

async fn handshake(
    stream: TcpStream,
    peer: SocketAddr,
    full: bool,
    shared: &Shared,
) -> Option<WebSocketStream<TcpStream>> {
    let limits = WebSocketConfig::default()
        .max_message_size(Some(connection::MAX_MESSAGE_BYTES))
        .max_frame_size(Some(connection::MAX_MESSAGE_BYTES))
        .write_buffer_size(WRITE_BUFFER_BYTES);
    // The answer's type is the library's.
    #[allow(clippy::result_large_err)]
    let check = |request: &Request, response: Response| {
        let text = |name| request.headers().get(name).and_then(|value| value.to_str().ok());
        let visitor = Visitor {
            origin: text(header::ORIGIN),
            host: text(header::HOST),
            query: request.uri().query(),
            authorization: text(header::AUTHORIZATION),
        };
        if has_unreadable(request.headers(), header::ORIGIN) {
            return Err(refusal(StatusCode::FORBIDDEN, "the origin cannot be read"));
        }
        if full {
            return Err(refusal(
                StatusCode::SERVICE_UNAVAILABLE,
                &format!("{MAX_CLIENTS} clients are connected already"),
            ));
        }
        match shared.access.admit(peer.ip(), visitor) {
            Ok(()) => Ok(response),
            Err(reason) => {
                shared.notice(format!("refused {peer}: {reason}"));
                Err(refusal(StatusCode::FORBIDDEN, &reason))
            }
        }
    };
    accept_hdr_async_with_config(stream, check, Some(limits)).await.ok()
}

/// An origin of strange bytes must not pass for a missing one.
fn has_unreadable(headers: &HeaderMap, name: header::HeaderName) -> bool {
    headers.get(name).is_some_and(|value| value.to_str().is_err())
}

fn refusal(status: StatusCode, reason: &str) -> ErrorResponse {
    let mut response = ErrorResponse::new(Some(format!("{reason}\n")));
    *response.status_mut() = status;
    response
}
