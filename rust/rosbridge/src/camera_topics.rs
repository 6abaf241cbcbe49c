//! The simulated camera under topics: a picture whenever somebody asks for one.

use crate::{
    bus::{BusError, MemberId, ServiceProvider, ServiceReply, TopicBus, TopicMessage},
    headset::{frame_time, message_value, stamped_pose},
};
use proact_arm::ArmModel;
use proact_camera::{Camera, CameraView, Renderer, RgbdImage};
use proact_messages::{MessageValue, builtin_type};
use proact_types::{DisplayFrame, Scene};
use serde_json::{Value as Json, json};
use std::{
    f64::consts::FRAC_PI_3,
    sync::{
        Arc, Mutex, PoisonError, Weak,
        mpsc::{SyncSender, TrySendError, sync_channel},
    },
    thread::JoinHandle,
};

const IMAGE: &str = "/proact/camera/image_raw";
const INFO: &str = "/proact/camera/camera_info";
const POSE: &str = "/proact/camera/pose";
/// Takes one picture of each view asked for.
const TAKE_PICTURE: &str = "/proact/camera/take";
const FRAME: &str = "proact_camera";
/// Pixels.
const IMAGE_SIZE_PX: [u32; 2] = [640, 480];
/// Pictures that may wait to be taken.
const MAX_PENDING_REQUESTS: usize = 4;

/// A trial's camera on a bus.
///
/// Each call of `/proact/camera/take` (`std_srvs/Trigger`) publishes a picture of the latest instant from the
/// participant's eye, 640 x 480 pixels and 60 degrees high: `/proact/camera/image_raw` (`sensor_msgs/Image`, `rgb8`),
/// `/proact/camera/camera_info` (`sensor_msgs/CameraInfo`, no distortion) and `/proact/camera/pose`
/// (`geometry_msgs/PoseStamped` in `world`; x right, y down, z ahead), all with the stamp of that instant.
pub struct CameraTopics {
    bus: Arc<dyn TopicBus>,
    member: MemberId,
    latest_frame: Arc<LatestFrame>,
    requests: Option<SyncSender<ServiceReply>>,
    worker: Option<JoinHandle<()>>,
}

/// The instant that a picture would show.
#[derive(Default)]
struct LatestFrame(Mutex<Option<Arc<DisplayFrame>>>);

impl LatestFrame {
    fn set(&self, frame: Option<Arc<DisplayFrame>>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = frame;
    }

    fn get(&self) -> Option<Arc<DisplayFrame>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl CameraTopics {
    /// Joins the bus as `/proact_camera`, and starts the thread that takes the pictures.
    ///
    /// # Errors
    /// [`BusError`] if somebody else uses these topics for other types.
    pub fn new(bus: Arc<dyn TopicBus>, arm: &ArmModel, scene: &Scene) -> Result<CameraTopics, BusError> {
        let member = bus.join("/proact_camera");
        let latest = Arc::new(LatestFrame::default());
        let (orders, ordered) = sync_channel::<ServiceReply>(MAX_PENDING_REQUESTS);
        let photographer = PictureWorker {
            bus: Arc::downgrade(&bus),
            renderer: Renderer::new(arm, scene),
            latest_frame: Arc::clone(&latest),
        };
        let worker = std::thread::spawn(move || {
            for reply in ordered {
                reply.answer(Ok(photographer.take_picture()));
            }
        });
        let topics = CameraTopics {
            bus,
            member,
            latest_frame: latest,
            requests: Some(orders.clone()),
            worker: Some(worker),
        };
        for (topic, kind) in [
            (IMAGE, "sensor_msgs/Image"),
            (INFO, "sensor_msgs/CameraInfo"),
            (POSE, "geometry_msgs/PoseStamped"),
        ] {
            topics.bus.advertise(member, topic, kind, false)?;
        }
        topics.bus.advertise_service(
            member,
            TAKE_PICTURE,
            "std_srvs/Trigger",
            Arc::new(PictureService(orders)),
        )?;
        Ok(topics)
    }

    /// The instant that the next picture shows.
    pub fn set_frame(&self, frame: &DisplayFrame) {
        self.latest_frame.set(Some(Arc::new(frame.clone())));
    }
}

impl Drop for CameraTopics {
    fn drop(&mut self) {
        // With the service goes the other sender, so that the thread ends.
        self.bus.leave(self.member);
        self.requests.take();
        if let Some(worker) = self.worker.take() {
            let _ = worker.join();
        }
    }
}

/// Hands orders to the thread that takes the pictures.
struct PictureService(SyncSender<ServiceReply>);

impl ServiceProvider for PictureService {
    fn call(&self, _: Json, reply: ServiceReply) {
        if let Err(TrySendError::Full(reply) | TrySendError::Disconnected(reply)) = self.0.try_send(reply) {
            let message = format!("{MAX_PENDING_REQUESTS} pictures wait to be taken already; ask again");
            reply.answer(Ok(json!({"success": false, "message": message})));
        }
    }
}

struct PictureWorker {
    bus: Weak<dyn TopicBus>,
    renderer: Renderer,
    latest_frame: Arc<LatestFrame>,
}

impl PictureWorker {
    /// Takes a picture and publishes it; the answer of the service.
    fn take_picture(&self) -> Json {
        let (Some(frame), Some(bus)) = (self.latest_frame.get(), self.bus.upgrade()) else {
            return json!({"success": false, "message": "nothing is shown yet; ask again"});
        };
        let camera = self.renderer.camera(CameraView::Head, &frame, IMAGE_SIZE_PX, FRAC_PI_3);
        let picture = self.renderer.render(&frame, &camera);
        bus.publish(&messages(&frame, &camera, picture));
        json!({"success": true, "message": format!("published on {IMAGE}")})
    }
}

fn messages(frame: &DisplayFrame, camera: &Camera, picture: RgbdImage) -> [Arc<TopicMessage>; 3] {
    let header = |frame_id: &str| {
        message_value([
            ("seq", MessageValue::Uint(0)),
            ("stamp", MessageValue::Time(frame_time(frame))),
            ("frame_id", MessageValue::Text(frame_id.to_owned())),
        ])
    };
    let whole = |number: u32| MessageValue::Uint(number.into());
    let size = [("height", whole(camera.height)), ("width", whole(camera.width))];
    let [height, width] = size.clone();
    let image = message_value([
        ("header", header(FRAME)),
        height,
        width,
        ("encoding", MessageValue::Text("rgb8".to_owned())),
        ("is_bigendian", MessageValue::Uint(0)),
        ("step", whole(3 * camera.width)),
        ("data", MessageValue::Bytes(picture.rgb)),
    ]);
    let k = camera.intrinsics();
    let p = [k[0], k[1], k[2], 0.0, k[3], k[4], k[5], 0.0, k[6], k[7], k[8], 0.0];
    let [height, width] = size;
    let info = message_value([
        ("header", header(FRAME)),
        height,
        width,
        ("distortion_model", MessageValue::Text("plumb_bob".to_owned())),
        ("D", MessageValue::Floats(vec![0.0; 5])),
        ("K", MessageValue::Floats(k.to_vec())),
        ("R", MessageValue::Floats(vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])),
        ("P", MessageValue::Floats(p.to_vec())),
        ("binning_x", whole(0)),
        ("binning_y", whole(0)),
        (
            "roi",
            message_value([
                ("x_offset", whole(0)),
                ("y_offset", whole(0)),
                ("height", whole(0)),
                ("width", whole(0)),
                ("do_rectify", MessageValue::Bool(false)),
            ]),
        ),
    ]);
    [
        TopicMessage::new(IMAGE, builtin_type("sensor_msgs/Image"), image),
        TopicMessage::new(INFO, builtin_type("sensor_msgs/CameraInfo"), info),
        stamped_pose(POSE, &header("world"), &camera.world_from_camera),
    ]
}
