use crate::{
    BridgeError, ClientInput, Signals, StudyScreen, TrackingReport, TrialStatus, assets, camera,
    client_slots::{ClientSlot, ClientSlots, SlotKind, SlotLimits},
    encoding::{accepts_gzip, encode_response},
    feed::{GhostArm, PageFeed, ServerMessage, StudyMessages},
    frame_latency::{FrameLatency, FrameLatencyTracker},
    input_arbiter::{ClientId, InputArbiter, PageHeartbeat},
    live::{self, Role},
    meshes::{self, MeshFile, MeshesById},
    trials::{self, StoredTrials, TrialLibrary},
};
use axum::{
    Extension, Router,
    body::Bytes,
    extract::{Path, Query, State, ws::WebSocketUpgrade},
    http::{HeaderMap, StatusCode, header},
    response::{IntoResponse, Response},
    routing::get,
};
use proact_arm::{ArmModel, Side};
use proact_camera::Renderer;
use proact_http::{
    AccessConfig, AccessRight, AllowedOrigins, ConnectionLimits, HttpServer, HttpServerOptions,
};
use proact_types::{Briefing, DisplayFrame, MAX_METHOD_NAME_BYTES, MethodInfo, Scene};
use serde::{Deserialize, Serialize};
use std::{
    net::{IpAddr, Ipv4Addr},
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, AtomicU32, AtomicU64, AtomicUsize, Ordering},
    },
    time::{Duration, Instant},
};
use tokio::sync::{Semaphore, watch};

/// How many ports after the first one are tried.
const MAX_FURTHER_PORTS: u16 = 20;
/// Most pages at once. Of further ones, those that only watch are refused with 503.
const SLOT_LIMITS: SlotLimits = SlotLimits { watching: 64, driving: 64, conducting: 16 };
/// What the system may hold back for one connection, bytes: about 20 frames, a third of a second.
const SEND_BUFFER_BYTES: u32 = 64 * 1024;
/// How often it is checked whether the driving client fell silent.
const WATCHDOG_PERIOD: Duration = Duration::from_millis(50);

/// Where to serve, and to whom.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PageOptions {
    /// TCP port; zero lets the system choose.
    pub port: u16,
    /// If the port is taken, try the next twenty.
    pub allow_next_port: bool,
    /// Address to listen on. On a loopback address only this machine can connect.
    pub bind: IpAddr,
    /// Serve HTTPS with a certificate of our own making.
    pub https: bool,
    /// Who may connect.
    pub access: AccessConfig,
    /// How long a connection may dawdle, and how many there may be.
    pub limits: ConnectionLimits,
    /// A headset's controller that is strapped to the brace: its page sends where it is.
    pub brace_controller: Option<Side>,
}

impl Default for PageOptions {
    /// Port 8090 or the next free one, this machine only.
    fn default() -> Self {
        PageOptions {
            port: 8090,
            allow_next_port: true,
            bind: Ipv4Addr::LOCALHOST.into(),
            https: false,
            access: AccessConfig::default(),
            limits: ConnectionLimits::default(),
            brace_controller: None,
        }
    }
}

impl PageOptions {
    /// As a server in a thread of that name takes them.
    pub(crate) fn server_options(self, name: &'static str) -> HttpServerOptions {
        HttpServerOptions {
            name,
            port: self.port,
            further_ports: if self.allow_next_port { MAX_FURTHER_PORTS } else { 0 },
            port_option: "--port",
            bind: self.bind,
            https: self.https,
            access: self.access,
            allowed_origins: AllowedOrigins::SameServer,
            send_buffer_bytes: SEND_BUFFER_BYTES,
            limits: self.limits,
        }
    }
}

/// What does not change during a trial.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct PageContent {
    /// Shown at the top, such as `demo` or a participant's number.
    pub title: String,
    /// Name of the set-up, such as `seated`.
    pub setup: String,
    /// The arm.
    pub arm: ArmModel,
    /// Its meshes, as far as they are there; a link whose mesh is not is drawn by its collision shapes.
    pub meshes: Vec<MeshFile>,
    /// The room.
    pub scene: Scene,
    /// What the person is told of the task.
    pub briefing: Briefing,
    /// The page drives: mouse is gaze, keys are gestures. Otherwise it only shows, and inputs are refused.
    pub interactive: bool,
    /// The trunk moves: lean keys are offered.
    pub lean: bool,
    /// The control method of the trial.
    pub method: MethodInfo,
    /// The methods by which another trial may begin.
    pub methods: Vec<MethodInfo>,
}

/// State shared by the owner's thread and the server's.
pub(crate) struct PageServerState {
    pub(crate) feed: watch::Sender<PageFeed>,
    pub(crate) page_version: String,
    pub(crate) brace_controller: Option<Side>,
    input_arbiter: Mutex<InputArbiter>,
    content: Mutex<StoredContent>,
    pub(crate) limits: ConnectionLimits,
    slots: Arc<ClientSlots>,
    client_count: AtomicUsize,
    /// A page has drawn.
    drawn: AtomicBool,
    /// How often a gaze check, and a calibration, was asked for.
    gaze_requests: [AtomicU32; 2],
    /// Why what was chosen on the page did not begin.
    start_error: Mutex<Option<String>>,
    next_client: AtomicU64,
    trials: Mutex<Arc<StoredTrials>>,
    /// What tracking sources there are, as JSON.
    tracking: Mutex<Bytes>,
    /// When frames were on a screen.
    frame_latency: Mutex<FrameLatencyTracker>,
    /// Pictures are taken one after the other.
    pub(crate) render_permit: Semaphore,
}

struct StoredContent {
    json: String,
    interactive: bool,
    methods: Vec<String>,
    meshes: MeshesById,
    renderer: Arc<Renderer>,
}

impl PageServerState {
    /// A place for a page of this role and right.
    fn acquire_slot(&self, role: Role, right: AccessRight) -> Result<ClientSlot, usize> {
        let seat = match role {
            Role::Participant if right == AccessRight::Control => SlotKind::Driving,
            Role::Experimenter if right == AccessRight::Control => SlotKind::Conducting,
            _ => SlotKind::Watching,
        };
        let driver = self.input_arbiter().driver().1.map(|(driver, _)| driver);
        self.slots.acquire(self.next_client.fetch_add(1, Ordering::Relaxed), seat, driver)
    }

    /// Counts a connection in.
    pub(crate) fn count_connection(&self) {
        self.client_count.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts a connection out; if it drove, the arm stops.
    pub(crate) fn disconnect(&self, client: ClientId) {
        self.client_count.fetch_sub(1, Ordering::Relaxed);
        self.with_arbiter(|arbiter| arbiter.disconnect(client));
    }

    /// Does something with the arbiter, and tells all pages if another one drives then.
    pub(crate) fn with_arbiter<T>(&self, act: impl FnOnce(&mut InputArbiter) -> T) -> T {
        let mut arbiter = self.input_arbiter();
        let before = arbiter.driver().0;
        let done = act(&mut arbiter);
        let driver = arbiter.driver();
        if driver.0 != before {
            // Under the arbiter's lock, so that no older word comes after a newer one.
            self.feed.send_modify(|feed| feed.driver = driver);
        }
        done
    }

    pub(crate) fn input_arbiter(&self) -> MutexGuard<'_, InputArbiter> {
        // No code that holds these locks can panic half way through a change.
        self.input_arbiter.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A page has the trial's first picture on its screen.
    pub(crate) fn mark_drawn(&self) {
        self.drawn.store(true, Ordering::Relaxed);
    }

    pub(crate) fn interactive(&self) -> bool {
        self.content().interactive
    }

    /// Whether `input` asks for nothing but what there is.
    pub(crate) fn check_offered(&self, input: &ClientInput) -> Result<(), String> {
        let ClientInput::Restart { method: Some(name), .. } = input else { return Ok(()) };
        let known = &self.content().methods;
        if known.contains(name) {
            return Ok(());
        }
        let name: String = name.chars().take(MAX_METHOD_NAME_BYTES).collect();
        Err(format!("message ignored: method is {name:?}, expected one of {}", known.join(", ")))
    }

    pub(crate) fn renderer(&self) -> Arc<Renderer> {
        Arc::clone(&self.content().renderer)
    }

    pub(crate) fn trials(&self) -> Arc<StoredTrials> {
        Arc::clone(&self.trials.lock().unwrap_or_else(PoisonError::into_inner))
    }

    pub(crate) fn frame_latency(&self) -> MutexGuard<'_, FrameLatencyTracker> {
        self.frame_latency.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn tracking(&self) -> MutexGuard<'_, Bytes> {
        self.tracking.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn content(&self) -> MutexGuard<'_, StoredContent> {
        self.content.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The page's web server. Runs in its own thread until it is dropped.
pub struct PageServer {
    shared: Arc<PageServerState>,
    server: HttpServer,
}

impl PageServer {
    /// Listens and begins to serve.
    ///
    /// # Errors
    /// [`BridgeError::Serve`] if the port is taken, the address is not ours, or the system refuses otherwise,
    /// [`BridgeError::Content`] if arm and scene do not fit together.
    pub fn start(options: PageOptions, page: PageContent) -> Result<PageServer, BridgeError> {
        let shared = Arc::new(PageServerState {
            feed: watch::Sender::new(PageFeed::default()),
            page_version: assets::page_version(),
            brace_controller: options.brace_controller,
            input_arbiter: Mutex::default(),
            content: Mutex::new(prepare_content(&page)?),
            limits: options.limits,
            slots: ClientSlots::new(SLOT_LIMITS),
            client_count: AtomicUsize::new(0),
            drawn: AtomicBool::new(false),
            gaze_requests: Default::default(),
            start_error: Mutex::default(),
            next_client: AtomicU64::new(1),
            trials: Mutex::new(Arc::new(StoredTrials::new(Arc::new(Vec::new()))?)),
            tracking: Mutex::new(Bytes::from_static(b"[]")),
            frame_latency: Mutex::default(),
            render_permit: Semaphore::new(1),
        });
        let (router, watchdog) = (router(Arc::clone(&shared)), run_watchdog(Arc::clone(&shared)));
        // Whoever is refused is told so by the browser.
        let server = HttpServer::start(options.server_options("page-server"), router, |_| {}, watchdog)?;
        Ok(PageServer { shared, server })
    }

    /// Where it is served, without the token.
    pub fn url(&self) -> String {
        self.server.url()
    }

    /// The address to open in a browser on this machine, of the page at `path`, with the token if there is one.
    pub fn page_url(&self, path: &str) -> String {
        self.server.page_url(path)
    }

    /// The address for other machines, with the token that lets them in; none if they cannot connect.
    pub fn remote_url(&self) -> Option<String> {
        self.server.remote_url()
    }

    /// Hands a frame to all pages. Never blocks on them; a page that is still busy with an older one gets the
    /// latest next, and the events of those between.
    pub fn publish(&self, frame: &DisplayFrame) {
        let text = ServerMessage::Frame(frame).to_text();
        self.shared.frame_latency().record_sent(frame.time, Instant::now());
        self.shared.feed.send_modify(|feed| feed.publish(frame, text));
    }

    /// When frames were on the screen of whoever drives, or watches where nobody does, as pages have told since the last call;
    /// of each trial on its own clock.
    pub fn take_frame_latencies(&self) -> Vec<FrameLatency> {
        self.shared.frame_latency().drain()
    }

    /// Asks the participant's page for a gaze check, or for a calibration; the next status says so. Counted as long as this server
    /// runs, whatever trial is on: a page that is busy or was told of another trial in between misses none.
    pub fn request_gaze_check(&self, calibration: bool) {
        self.shared.gaze_requests[usize::from(calibration)].fetch_add(1, Ordering::Relaxed);
    }

    /// Why what was chosen on the page does not begin, as a sentence; none when it does. The next status says so.
    pub fn set_start_error(&self, reason: Option<String>) {
        *self.shared.start_error.lock().unwrap_or_else(PoisonError::into_inner) = reason;
    }

    /// Tells all pages whether the trial goes on. How often the gaze was asked for, and what was refused, is this server's to say.
    pub fn set_status(&self, status: &TrialStatus) {
        let [gaze_checks, gaze_calibrations] =
            [0, 1].map(|kind: usize| self.shared.gaze_requests[kind].load(Ordering::Relaxed));
        let refused = self.shared.start_error.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let status = &TrialStatus { gaze_checks, gaze_calibrations, start_error: refused, ..status.clone() };
        let text = ServerMessage::Status(status).to_text();
        self.shared.feed.send_modify(|feed| feed.status = (feed.status.0 + 1, Some(text)));
    }

    /// Shows a screen of a study in place of the one before; to pages only if anything on it differs.
    pub fn publish_study(&self, screen: &StudyScreen) {
        let messages = StudyMessages::new(screen);
        self.shared.feed.send_if_modified(|feed| {
            let has_changed = feed.study.1.as_ref() != Some(&messages);
            if has_changed {
                feed.study = (feed.study.0 + 1, Some(messages));
            }
            has_changed
        });
    }

    /// Shows a second arm, or none; to pages only if it differs from the one before.
    pub fn publish_ghost(&self, arm: Option<&GhostArm>) {
        let text = ServerMessage::Ghost { arm }.to_text();
        self.shared.feed.send_if_modified(|feed| {
            let before = feed.ghost.1.as_ref();
            let has_changed = before.map_or(arm.is_some(), |before| *before != text);
            if has_changed {
                feed.ghost = (feed.ghost.0 + 1, Some(text));
            }
            has_changed
        });
    }

    /// Hands signals to the experimenter's pages; the latest only, as with frames.
    pub fn publish_signals(&self, signals: &Signals) {
        let text = ServerMessage::Signals(signals).to_text();
        self.shared.feed.send_modify(|feed| feed.signals = (feed.signals.0 + 1, Some(text)));
    }

    /// How the tracking sources stand now, for the page of tracking.
    pub fn set_tracking(&self, reports: &[TrackingReport]) {
        // Numbers that are not finite are written as null: nothing here fails.
        if let Ok(text) = proact_types::to_json(reports) {
            *self.shared.tracking() = text.into();
        }
    }

    /// What the person at the page did since the last call, oldest first.
    pub fn drain_inputs(&self) -> Vec<ClientInput> {
        self.shared.input_arbiter().drain()
    }

    /// What the page in control said of its gesture since the last call, if only that it still holds it. Over a line with a longer
    /// round trip than `delay_limit`, nothing that it says moves the arm, and the page warns.
    pub fn take_heartbeat(&self, delay_limit: Option<Duration>) -> Option<PageHeartbeat> {
        self.shared.input_arbiter().take_heartbeat(Instant::now(), delay_limit)
    }

    /// Shows another arm, scene or trial from now on; open pages fetch it by themselves.
    ///
    /// # Errors
    /// [`BridgeError::Content`]; the old content then stays.
    pub fn set_content(&self, page: PageContent) -> Result<(), BridgeError> {
        let stored = prepare_content(&page)?;
        *self.shared.content() = stored;
        self.shared.feed.send_modify(PageFeed::reset);
        Ok(())
    }

    /// Recorded trials for the replay page, instead of those before.
    ///
    /// # Errors
    /// [`BridgeError::Content`] if their list cannot be written out.
    pub fn set_trials(&self, library: Arc<dyn TrialLibrary>) -> Result<(), BridgeError> {
        let stored = Arc::new(StoredTrials::new(library)?);
        *self.shared.trials.lock().unwrap_or_else(PoisonError::into_inner) = stored;
        Ok(())
    }

    /// Whether a page has had a picture of the arm on its screen.
    pub fn has_drawn(&self) -> bool {
        self.shared.drawn.load(Ordering::Relaxed)
    }

    /// Number of pages that are connected.
    pub fn client_count(&self) -> usize {
        self.shared.client_count.load(Ordering::Relaxed)
    }
}

/// Checks what the page relies on and writes it out once for all clients.
fn prepare_content(page: &PageContent) -> Result<StoredContent, BridgeError> {
    let refuse = |what: String| Err(BridgeError::Content { what });
    let (links, joints) = (page.arm.links.len(), page.arm.joints.len());
    if links != joints + 1 {
        return refuse(format!(
            "the arm has {links} links and {joints} joints, expected one link more than joints"
        ));
    }
    if let Some(joint) = page.arm.joints.iter().find(|joint| joint.parent >= links || joint.child >= links) {
        return refuse(format!(
            "joint {:?} leads from link {} to link {}, the arm has {links} links",
            joint.name, joint.parent, joint.child
        ));
    }
    if let Some(joint) = page.arm.moving().find(|&joint| joint >= joints) {
        return refuse(format!("moving joint {joint} does not exist, the arm has {joints} joints"));
    }
    let objects = page.scene.objects.len();
    if let Some(target) = page.scene.targets.iter().find(|target| target.object.index() >= objects) {
        return refuse(format!("a target is for object {}, the scene has {objects}", target.object.0));
    }
    let json =
        proact_types::to_json(page).map_err(|error| BridgeError::Content { what: error.to_string() })?;
    let renderer = Arc::new(Renderer::new(&page.arm, &page.scene));
    let methods = page.methods.iter().map(|method| method.name.clone()).collect();
    let meshes = meshes::meshes_by_id(&page.meshes);
    Ok(StoredContent { json, interactive: page.interactive, methods, meshes, renderer })
}

async fn run_watchdog(shared: Arc<PageServerState>) {
    let mut ticks = tokio::time::interval(WATCHDOG_PERIOD);
    loop {
        ticks.tick().await;
        shared.input_arbiter().check_timeout(Instant::now());
    }
}

fn router(shared: Arc<PageServerState>) -> Router {
    Router::new()
        .route(
            "/",
            get(|request_headers: HeaderMap| async move {
                assets::asset_response("", accepts_gzip(&request_headers))
            }),
        )
        .route("/{*path}", get(file))
        .route("/meshes/{id}", get(mesh))
        .route("/healthz", get(|| async { "ok\n" }))
        .route("/api/content", get(content))
        .route("/live", get(connect))
        .route("/camera.png", get(camera::camera_png))
        .route("/camera.json", get(camera::camera_json))
        .route("/api/tracking", get(tracking))
        .route("/report", get(trials::report))
        .route("/api/trials", get(trials::list))
        .route("/api/trials/{number}", get(trials::get_trial))
        .with_state(shared)
}

async fn file(Path(path): Path<String>, request_headers: HeaderMap) -> Response {
    assets::asset_response(&path, accepts_gzip(&request_headers))
}

async fn content(State(shared): State<Arc<PageServerState>>, request_headers: HeaderMap) -> Response {
    let content = shared.content().json.clone();
    let headers = [(header::CONTENT_TYPE, "application/json"), (header::CACHE_CONTROL, "no-store")];
    encode_response(headers, content.as_bytes(), accepts_gzip(&request_headers))
}

async fn mesh(
    State(shared): State<Arc<PageServerState>>,
    Path(id): Path<String>,
    request_headers: HeaderMap,
) -> Response {
    let mesh = shared.content().meshes.get(&id).cloned();
    let trials = shared.trials();
    let replayed = || trials.meshes.lock().unwrap_or_else(PoisonError::into_inner).get(&id).cloned();
    let found = mesh.or_else(replayed);
    meshes::respond(found, &id, accepts_gzip(&request_headers))
}

async fn tracking(State(shared): State<Arc<PageServerState>>) -> Response {
    json_response(shared.tracking().clone())
}

pub(crate) fn json_response(body: Bytes) -> Response {
    ([(header::CONTENT_TYPE, "application/json"), (header::CACHE_CONTROL, "no-store")], body).into_response()
}

/// What `/live` may be asked with.
#[derive(Deserialize)]
struct LiveQuery {
    #[serde(default)]
    role: Role,
}

async fn connect(
    State(shared): State<Arc<PageServerState>>,
    Extension(right): Extension<AccessRight>,
    Query(connection): Query<LiveQuery>,
    upgrade: WebSocketUpgrade,
) -> Response {
    // Taken here and not when the page begins to talk: a crowd must not slip in between.
    let slot = match shared.acquire_slot(connection.role, right) {
        Ok(slot) => slot,
        Err(limit) => {
            let refusal = format!("{limit} pages of this kind are connected already: close one of them\n");
            return (StatusCode::SERVICE_UNAVAILABLE, refusal).into_response();
        }
    };
    upgrade
        .max_message_size(live::MAX_MESSAGE_BYTES)
        .max_frame_size(live::MAX_MESSAGE_BYTES)
        // Written at once, or the "latest" frame would wait behind older ones.
        .write_buffer_size(0)
        .on_upgrade(async move |socket| live::serve(socket, shared, connection.role, right, slot).await)
}
