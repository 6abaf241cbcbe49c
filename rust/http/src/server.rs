//! A router in a thread of its own, behind the rule.

use crate::{
    AccessConfig, AllowedOrigins, ConnectionLimits, ServeError,
    access::{AccessPolicy, machine_name},
    connections::{ConnectionTable, WriteTimeoutStream},
    guard::{self, AccessGuard},
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
const ACCEPT_RETRY_DELAY: Duration = Duration::from_millis(100);

/// The answer to whom there is no room for.
const SERVICE_UNAVAILABLE_RESPONSE: &[u8] =
    b"HTTP/1.1 503 Service Unavailable\r\nConnection: close\r\nContent-Length: 31\r\n\r\n\
    too many connections, try again";

/// Where to serve, and for whom.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HttpServerOptions {
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
    pub access: AccessConfig,
    /// Pages of which servers may ask, in a browser.
    pub allowed_origins: AllowedOrigins,
    /// What the system may hold back for one connection, bytes. With its own choice of megabytes a slow client would get
    /// everything many seconds late.
    pub send_buffer_bytes: u32,
    /// How long a connection may dawdle, and how many there may be.
    pub limits: ConnectionLimits,
}

/// The ends of a connection, as handlers get them in an [`Extension`].
#[derive(Clone, Copy, Debug)]
pub struct Peer {
    /// The other end.
    pub address: SocketAddr,
    /// The address of ours at which it came in.
    pub local_address: IpAddr,
}

/// A server. Runs in its own thread until it is dropped.
pub struct HttpServer {
    scheme: &'static str,
    address: SocketAddr,
    token: Option<String>,
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl HttpServer {
    /// Listens and begins to serve. `refused` is told of everybody who is turned away; `beside` runs along in the server's
    /// thread and ends with it.
    ///
    /// # Errors
    /// [`ServeError::PortTaken`] or [`ServeError::NoFreePort`] if somebody else listens there, [`ServeError::Listen`] if the
    /// address is not ours or not allowed, [`ServeError::AccessNotConfigured`] if other machines could connect and nothing says
    /// which, [`ServeError::InvalidToken`], [`ServeError::InvalidHostName`], [`ServeError::Certificate`], [`ServeError::Thread`].
    pub fn start(
        options: HttpServerOptions,
        router: Router,
        refused: impl Fn(String) + Send + Sync + 'static,
        beside: impl Future<Output = ()> + Send + 'static,
    ) -> Result<HttpServer, ServeError> {
        let HttpServerOptions { name, bind, .. } = options;
        options.access.check()?;
        if !bind.is_loopback() && options.access.is_local_only() {
            return Err(ServeError::AccessNotConfigured { name, address: bind });
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
                let acceptor = tls::load_or_create_acceptor(
                    advertised_address(bind),
                    tls::certificate_folder().as_deref(),
                );
                Some(acceptor.map_err(|what| ServeError::Certificate { reason: what })?)
            }
            false => None,
        };
        let (scheme, token) = (if options.https { "https" } else { "http" }, options.access.token.clone());
        let rule = AccessPolicy::new(options.access, options.allowed_origins, address.port(), machine_name());
        let guard =
            AccessGuard { policy: Arc::new(rule), https: options.https, report_refusal: Arc::new(refused) };
        let router = router.layer(middleware::from_fn_with_state(guard, guard::check_access));
        let handler = ConnectionHandler { tls, router, limits: options.limits };
        let (stop, stopped) = oneshot::channel();
        let thread = std::thread::Builder::new()
            .name(name.to_owned())
            .spawn(move || run(&runtime, accept(listener, handler), beside, stopped))
            .map_err(thread_failed)?;
        Ok(HttpServer { scheme, address, token, stop: Some(stop), thread: Some(thread) })
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
        let ip = advertised_address(self.address.ip());
        let token = self.token.as_ref()?;
        let authority = SocketAddr::new(ip, self.address.port());
        (!ip.is_loopback()).then(|| format!("{}://{authority}/?token={token}", self.scheme))
    }
}

impl Drop for HttpServer {
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
fn advertised_address(bind: IpAddr) -> IpAddr {
    if !bind.is_unspecified() {
        return bind;
    }
    // Nothing is sent: connecting a datagram socket only chooses the way. The address is one set aside for examples.
    let route_probe = std::net::UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).and_then(|socket| {
        socket.connect((Ipv4Addr::new(192, 0, 2, 1), 9))?;
        socket.local_addr()
    });
    route_probe.map_or(Ipv4Addr::LOCALHOST.into(), |address| address.ip())
}

fn listen(options: &HttpServerOptions) -> Result<TcpListener, ServeError> {
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
struct ConnectionHandler {
    tls: Option<TlsAcceptor>,
    router: Router,
    limits: ConnectionLimits,
}

async fn accept(listener: TcpListener, handler: ConnectionHandler) {
    let connections = ConnectionTable::new(handler.limits);
    loop {
        let Ok((stream, address)) = listener.accept().await else {
            time::sleep(ACCEPT_RETRY_DELAY).await;
            continue;
        };
        let Ok(at) = stream.local_addr() else { continue };
        let Some(slot) = connections.acquire_slot(address.ip().to_canonical()) else {
            // What fits into the system's buffer goes out; nobody waits for the rest, and TLS clients see the end only.
            let _ = stream.try_write(SERVICE_UNAVAILABLE_RESPONSE);
            continue;
        };
        let peer = Peer { address, local_address: at.ip() };
        let mut handler = handler.clone();
        handler.router = handler.router.layer(Extension(peer)).layer(Extension(Arc::clone(&slot)));
        tokio::spawn(async move {
            tokio::select! {
                () = serve_connection(stream, handler) => {}
                () = slot.wait_for_eviction() => {}
            }
            slot.release();
        });
    }
}

/// Answers the requests of one connection until it ends or becomes a WebSocket.
async fn serve_connection(stream: TcpStream, handler: ConnectionHandler) {
    // Small messages must not wait for each other. Failing is no reason to refuse the client.
    let _ = stream.set_nodelay(true);
    let ConnectionHandler { tls, router, limits } = handler;
    let stream = WriteTimeoutStream::new(stream, limits.write_timeout);
    match tls {
        None => serve_requests(stream, router, limits).await,
        Some(acceptor) => {
            if let Ok(Ok(stream)) = time::timeout(limits.request_timeout, acceptor.accept(stream)).await {
                serve_requests(stream, router, limits).await;
            }
        }
    }
}

async fn serve_requests(
    stream: impl AsyncRead + AsyncWrite + Send + Unpin + 'static,
    router: Router,
    limits: ConnectionLimits,
) {
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(limits.request_timeout)
        .serve_connection(TokioIo::new(stream), TowerToHyperService::new(router))
        .with_upgrades();
    // It ends with an error when the client breaks off, which is the client's matter.
    let _ = connection.await;
}
