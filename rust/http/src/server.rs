//! A router in a thread of its own, behind the rule.

use crate::{
    Access, Limits, Pages, ServeError,
    access::{Rule, machine_name},
    connections::{Connections, Unstalled},
    guard::{self, Guard},
    tls,
};
use axum::{Extension, Router, middleware};
use hyper::server::conn::http1;
use hyper_util::{
    rt::{TokioIo, TokioTimer},
    service::TowerToHyperService,
};
use std::{
    net::{IpAddr, Ipv4Addr, SocketAddr},
    sync::Arc,
    thread::JoinHandle,
    time::Duration,
};
use tokio::{
    io::{AsyncRead, AsyncWrite},
    net::{TcpListener, TcpSocket, TcpStream},
    runtime::Runtime,
    sync::oneshot,
    time,
};
use tokio_rustls::TlsAcceptor;

/// Until the next try where the system has no handles left: some come free when clients go.
const NO_HANDLES: Duration = Duration::from_millis(100);

/// The answer to whom there is no room for.
const FULL: &[u8] = b"HTTP/1.1 503 Service Unavailable\r\nConnection: close\r\nContent-Length: 31\r\n\r\n\
    too many connections, try again";

/// Where to serve, and for whom.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Options {
    /// What is served: the name of the thread.
    pub name: &'static str,
    /// TCP port; zero lets the system choose.
    pub port: u16,
    /// How many ports after it are tried if it is taken.
    pub further_ports: u16,
    /// How a person asks for another port, such as `--port`.
    pub port_option: &'static str,
    /// Address to listen on. On a loopback address only this machine can connect.
    pub bind: IpAddr,
    /// Serve HTTPS with a certificate of our own making, which the person's folder for state keeps.
    pub https: bool,
    /// Who may connect.
    pub access: Access,
    /// Pages of which servers may ask, in a browser.
    pub pages: Pages,
    /// What the system may hold back for one connection, bytes. With its own choice of megabytes a slow client would get
    /// everything many seconds late.
    pub send_buffer_bytes: u32,
    /// How long a connection may dawdle, and how many there may be.
    pub limits: Limits,
}

/// The ends of a connection, as handlers get them in an [`Extension`].
#[derive(Clone, Copy, Debug)]
pub struct Peer {
    /// The other end.
    pub address: SocketAddr,
    /// The address of ours at which it came in.
    pub at: IpAddr,
}

/// A server. Runs in its own thread until it is dropped.
pub struct Server {
    scheme: &'static str,
    address: SocketAddr,
    token: Option<String>,
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Listens and begins to serve. `refused` is told of everybody who is turned away; `beside` runs along in the server's
    /// thread and ends with it.
    ///
    /// # Errors
    /// [`ServeError::PortTaken`] or [`ServeError::NoFreePort`] if somebody else listens there, [`ServeError::Listen`] if the
    /// address is not ours or not allowed, [`ServeError::Unguarded`] if other machines could connect and nothing says
    /// which, [`ServeError::Token`], [`ServeError::HostName`], [`ServeError::Certificate`], [`ServeError::Thread`].
    pub fn start(
        options: Options,
        router: Router,
        refused: impl Fn(String) + Send + Sync + 'static,
        beside: impl Future<Output = ()> + Send + 'static,
    ) -> Result<Server, ServeError> {
        let Options { name, bind, .. } = options;
        options.access.check()?;
        if !bind.is_loopback() && options.access.local_only() {
            return Err(ServeError::Unguarded { name, address: bind });
        }
        let thread_failed = |source| ServeError::Thread { name, source };
        let runtime =
            tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(thread_failed)?;
        let listener = {
            let _inside = runtime.enter();
            listen(&options)?
        };
        let address = listener
            .local_addr()
            .map_err(|source| ServeError::Listen { address: (bind, options.port).into(), source })?;
        let tls = match options.https {
            true => {
                let acceptor = tls::acceptor(advertised(bind), tls::kept_folder().as_deref());
                Some(acceptor.map_err(|what| ServeError::Certificate { what })?)
            }
            false => None,
        };
        let (scheme, token) = (if options.https { "https" } else { "http" }, options.access.token.clone());
        let rule = Rule::new(options.access, options.pages, address.port(), machine_name());
        let guard = Guard { rule: Arc::new(rule), https: options.https, refused: Arc::new(refused) };
        let router = router.layer(middleware::from_fn_with_state(guard, guard::admit));
        let door = Door { tls, router, limits: options.limits };
        let (stop, stopped) = oneshot::channel();
        let thread = std::thread::Builder::new()
            .name(name.to_owned())
            .spawn(move || run(&runtime, accept(listener, door), beside, stopped))
            .map_err(thread_failed)?;
        Ok(Server { scheme, address, token, stop: Some(stop), thread: Some(thread) })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Where a browser on this machine finds it, without the token.
    pub fn url(&self) -> String {
        let ip = match self.address.ip() {
            // "All addresses" is none that a browser could open.
            ip if ip.is_unspecified() => IpAddr::V4(Ipv4Addr::LOCALHOST),
            ip => ip,
        };
        format!("{}://{}/", self.scheme, SocketAddr::new(ip, self.address.port()))
    }

    /// What a browser on this machine opens to see the page at `path`, with the token if there is one.
    pub fn page_url(&self, path: &str) -> String {
        let token = self.token.as_ref().map(|token| format!("?token={token}")).unwrap_or_default();
        format!("{}{path}{token}", self.url())
    }

    /// What a browser on another machine opens, with the token that lets it in; none if it cannot connect.
    pub fn remote_url(&self) -> Option<String> {
        let ip = advertised(self.address.ip());
        let token = self.token.as_ref()?;
        let authority = SocketAddr::new(ip, self.address.port());
        (!ip.is_loopback()).then(|| format!("{}://{authority}/?token={token}", self.scheme))
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        if let Some(stop) = self.stop.take() {
            // An error means that the thread has ended already.
            let _ = stop.send(());
        }
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// The address that other machines reach `bind` at: for "all addresses", the one of the way out.
fn advertised(bind: IpAddr) -> IpAddr {
    if !bind.is_unspecified() {
        return bind;
    }
    // Nothing is sent: connecting a datagram socket only chooses the way. The address is one set aside for examples.
    let way_out = std::net::UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).and_then(|socket| {
        socket.connect((Ipv4Addr::new(192, 0, 2, 1), 9))?;
        socket.local_addr()
    });
    way_out.map_or(Ipv4Addr::LOCALHOST.into(), |address| address.ip())
}

fn listen(options: &Options) -> Result<TcpListener, ServeError> {
    let (first, address, option) = (options.port, options.bind, options.port_option);
    let last = first.saturating_add(options.further_ports);
    for port in first..=last {
        let address = SocketAddr::new(address, port);
        match listen_at(address, options.send_buffer_bytes) {
            Ok(listener) => return Ok(listener),
            Err(error) if error.kind() == std::io::ErrorKind::AddrInUse => {}
            Err(source) => return Err(ServeError::Listen { address, source }),
        }
    }
    Err(if first < last {
        ServeError::NoFreePort { first, last, address, option }
    } else {
        ServeError::PortTaken { port: first, address, option }
    })
}

fn listen_at(address: SocketAddr, send_buffer_bytes: u32) -> std::io::Result<TcpListener> {
    let socket = if address.is_ipv4() { TcpSocket::new_v4()? } else { TcpSocket::new_v6()? };
    // A restarted server gets its port back at once, although old connections still linger.
    socket.set_reuseaddr(true)?;
    // Connections inherit it.
    socket.set_send_buffer_size(send_buffer_bytes)?;
    socket.bind(address)?;
    socket.listen(128)
}

/// The server's thread.
fn run(
    runtime: &Runtime,
    accepting: impl Future<Output = ()>,
    beside: impl Future<Output = ()>,
    stopped: oneshot::Receiver<()>,
) {
    runtime.block_on(async {
        // It may end before the server does.
        let beside = async {
            beside.await;
            std::future::pending().await
        };
        tokio::select! {
            () = accepting => {}
            () = beside => {}
            _ = stopped => {}
        }
    });
    // Dropping the runtime ends all connections.
}

/// What every connection comes to.
#[derive(Clone)]
struct Door {
    tls: Option<TlsAcceptor>,
    router: Router,
    limits: Limits,
}

async fn accept(listener: TcpListener, door: Door) {
    let connections = Connections::new(door.limits);
    loop {
        let Ok((stream, address)) = listener.accept().await else {
            time::sleep(NO_HANDLES).await;
            continue;
        };
        let Ok(at) = stream.local_addr() else { continue };
        let Some(place) = connections.enter(address.ip().to_canonical()) else {
            // What fits into the system's buffer goes out; nobody waits for the rest, and TLS clients see the end only.
            let _ = stream.try_write(FULL);
            continue;
        };
        let peer = Peer { address, at: at.ip() };
        let mut door = door.clone();
        door.router = door.router.layer(Extension(peer)).layer(Extension(Arc::clone(&place)));
        tokio::spawn(async move {
            tokio::select! {
                () = attend(stream, door) => {}
                () = place.lost() => {}
            }
            place.leave();
        });
    }
}

/// Answers the requests of one connection until it ends or becomes a WebSocket.
async fn attend(stream: TcpStream, door: Door) {
    // Small messages must not wait for each other. Failing is no reason to refuse the client.
    let _ = stream.set_nodelay(true);
    let Door { tls, router, limits } = door;
    let stream = Unstalled::new(stream, limits.stall);
    match tls {
        None => requests(stream, router, limits).await,
        Some(acceptor) => {
            if let Ok(Ok(stream)) = time::timeout(limits.request, acceptor.accept(stream)).await {
                requests(stream, router, limits).await;
            }
        }
    }
}

async fn requests(
    stream: impl AsyncRead + AsyncWrite + Send + Unpin + 'static,
    router: Router,
    limits: Limits,
) {
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(limits.request)
        .serve_connection(TokioIo::new(stream), TowerToHyperService::new(router))
        .with_upgrades();
    // It ends with an error when the client breaks off, which is the client's matter.
    let _ = connection.await;
}
