//! Answers calls.

use crate::{
    codec,
    error::{Error, Result},
    http::{self, MissingLength},
    value::{Fault, Params, Response},
};
use std::{
    collections::HashMap,
    net::{SocketAddr, TcpListener, TcpStream},
    sync::{
        Arc, OnceLock,
        atomic::{AtomicUsize, Ordering},
    },
    time::{Duration, Instant},
};

/// A call has to be there, and its answer to be taken, within this time.
const TIMEOUT: Duration = Duration::from_secs(10);
/// Most connections at once; further ones are closed, and their callers try again.
const MAX_CONNECTIONS: usize = 64;
/// From one look for new connections to the next, for [`BoundServer::run`].
const POLL_PERIOD: Duration = Duration::from_millis(5);

/// What the signatures of rosrust name: a request and its answer, of the HTTP library that was here before.
pub mod rouille {
    /// The body of a request.
    #[derive(Debug)]
    pub struct Request(pub(crate) String);

    /// The body of an answer; none if the request was no call.
    #[derive(Debug)]
    pub struct Response(pub(crate) Option<String>);
}

type Handler = Box<dyn Fn(Params) -> Response + Send + Sync>;
type CallInterceptor = Box<dyn Fn(&str, &Params) -> Option<Response> + Send + Sync>;

/// Of all servers of the process: rosrust keeps its server to itself.
static CALL_INTERCEPTOR: OnceLock<CallInterceptor> = OnceLock::new();

/// Asks `handler` about every call of every server in this process, by name and arguments, before the server's own handlers.
/// Where it gives `None`, the server answers. The first handler of the process stays; false for a later one.
pub fn intercept_calls(handler: impl Fn(&str, &Params) -> Option<Response> + Send + Sync + 'static) -> bool {
    CALL_INTERCEPTOR.set(Box::new(handler)).is_ok()
}

/// The calls that are answered.
pub struct Server {
    handlers: HashMap<String, Handler>,
    on_missing: Handler,
}

impl Default for Server {
    fn default() -> Self {
        let missing = |_| Err(Fault::new(404, "there is no such method"));
        Server { handlers: HashMap::new(), on_missing: Box::new(missing) }
    }
}

impl Server {
    /// Answers calls of that name.
    pub fn register_value(
        &mut self,
        name: impl Into<String>,
        handler: impl Fn(Params) -> Response + Send + Sync + 'static,
    ) {
        self.handlers.insert(name.into(), Box::new(handler));
    }

    /// Answers all other calls.
    pub fn set_on_missing(&mut self, handler: impl Fn(Params) -> Response + Send + Sync + 'static) {
        self.on_missing = Box::new(handler);
    }

    /// Listens.
    ///
    /// # Errors
    /// [`Error::Listen`].
    pub fn bind(
        self,
        address: &SocketAddr,
    ) -> Result<BoundServer<impl Fn(&rouille::Request) -> rouille::Response + Send + Sync + 'static + use<>>>
    {
        let failed = |source| Error::Listen { address: *address, source };
        let listener = TcpListener::bind(address).map_err(failed)?;
        listener.set_nonblocking(true).map_err(failed)?;
        let local = listener.local_addr().map_err(failed)?;
        let answer = move |request: &rouille::Request| self.answer(request);
        let open = Arc::new(AtomicUsize::new(0));
        Ok(BoundServer { listener, local, answer: Arc::new(answer), open_connections: open })
    }

    fn answer(&self, request: &rouille::Request) -> rouille::Response {
        let Ok((name, params)) = codec::read_call(&request.0) else { return rouille::Response(None) };
        let first = CALL_INTERCEPTOR.get().and_then(|first| first(&name, &params));
        let response = first.unwrap_or_else(|| self.handlers.get(&name).unwrap_or(&self.on_missing)(params));
        rouille::Response(Some(codec::write_response(&response)))
    }
}

/// A server that listens, and answers whenever [`BoundServer::poll`] is called.
pub struct BoundServer<F> {
    listener: TcpListener,
    local: SocketAddr,
    answer: Arc<F>,
    open_connections: Arc<AtomicUsize>,
}

impl<F: Fn(&rouille::Request) -> rouille::Response + Send + Sync + 'static> BoundServer<F> {
    /// Where it listens.
    pub fn local_addr(&self) -> SocketAddr {
        self.local
    }

    /// Answers until the process ends.
    pub fn run(self) {
        loop {
            self.poll();
            std::thread::sleep(POLL_PERIOD);
        }
    }

    /// Has all calls answered that wait, each in a thread of its own; a caller that dawdles keeps nobody else waiting.
    pub fn poll(&self) {
        // An error means that nobody waits, or that the system has no handles left: the next look tells.
        while let Ok((stream, _)) = self.listener.accept() {
            if self.open_connections.load(Ordering::Acquire) >= MAX_CONNECTIONS {
                continue;
            }
            let slot = CallSlot::acquire(&self.open_connections);
            let answer = Arc::clone(&self.answer);
            // Without a thread the caller is hung up on.
            let _ = std::thread::Builder::new().name("xml-rpc".to_owned()).spawn(move || {
                // It ends with an error when the caller breaks off, which is the caller's matter.
                let _ = serve_connection(stream, answer.as_ref());
                drop(slot);
            });
        }
    }
}

/// Counts a connection as long as it lives.
struct CallSlot(Arc<AtomicUsize>);

impl CallSlot {
    fn acquire(open: &Arc<AtomicUsize>) -> CallSlot {
        open.fetch_add(1, Ordering::AcqRel);
        CallSlot(Arc::clone(open))
    }
}

impl Drop for CallSlot {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::AcqRel);
    }
}

fn serve_connection(
    mut stream: TcpStream,
    answer: &impl Fn(&rouille::Request) -> rouille::Response,
) -> std::io::Result<()> {
    stream.set_nonblocking(false)?;
    stream.set_nodelay(true)?;
    let request = http::read(&mut stream, Instant::now() + TIMEOUT, MissingLength::NoBody);
    let answered = match request {
        Ok(message) if message.first_line.starts_with("POST ") => answer(&rouille::Request(message.body)).0,
        _ => None,
    };
    let (head, body) = match &answered {
        Some(body) => ("HTTP/1.1 200 OK", body.as_str()),
        None => ("HTTP/1.1 400 Bad Request", ""),
    };
    http::write(&mut stream, head, body, Instant::now() + TIMEOUT)
}
