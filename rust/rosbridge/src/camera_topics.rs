//! The simulated camera under topics: a picture whenever somebody asks for one.

use crate::{
    bus::{BusError, MemberId, ServiceProvider, ServiceReply, TopicBus, TopicMessage},
    headset::{named, stamped_pose, time_of},
};
use proact_arm::ArmModel;
use proact_camera::{Camera, Picture, Studio, View};
use proact_messages::{Value, known_type};
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
const TAKE: &str = "/proact/camera/take";
const FRAME: &str = "proact_camera";
/// Pixels.
const SIZE: [u32; 2] = [640, 480];
/// Pictures that may wait to be taken.
const MAX_WAITING: usize = 4;

/// A trial's camera on a bus.
///
/// Each call of `/proact/camera/take` (`std_srvs/Trigger`) publishes a picture of the latest instant from the
/// participant's eye, 640 x 480 pixels and 60 degrees high: `/proact/camera/image_raw` (`sensor_msgs/Image`, `rgb8`),
/// `/proact/camera/camera_info` (`sensor_msgs/CameraInfo`, no distortion) and `/proact/camera/pose`
/// (`geometry_msgs/PoseStamped` in `world`; x right, y down, z ahead), all with the stamp of that instant.
pub struct CameraTopics {
    bus: Arc<dyn TopicBus>,
    member: MemberId,
    latest: Arc<Latest>,
    orders: Option<SyncSender<ServiceReply>>,
    worker: Option<JoinHandle<()>>,
}

/// The instant that a picture would show.
#[derive(Default)]
struct Latest(Mutex<Option<Arc<DisplayFrame>>>);

impl Latest {
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
        let latest = Arc::new(Latest::default());
        let (orders, ordered) = sync_channel::<ServiceReply>(MAX_WAITING);
        let photographer = Photographer {
            bus: Arc::downgrade(&bus),
            studio: Studio::new(arm, scene),
            latest: Arc::clone(&latest),
        };
        let worker = std::thread::spawn(move || {
            for reply in ordered {
                reply.answer(Ok(photographer.take()));
            }
        });
        let topics = CameraTopics { bus, member, latest, orders: Some(orders.clone()), worker: Some(worker) };
        for (topic, kind) in [
            (IMAGE, "sensor_msgs/Image"),
            (INFO, "sensor_msgs/CameraInfo"),
            (POSE, "geometry_msgs/PoseStamped"),
        ] {
            topics.bus.advertise(member, topic, kind, false)?;
        }
        topics.bus.advertise_service(member, TAKE, "std_srvs/Trigger", Arc::new(Shutter(orders)))?;
        Ok(topics)
    }

    /// The instant that the next picture shows.
    pub fn show(&self, frame: &DisplayFrame) {
        self.latest.set(Some(Arc::new(frame.clone())));
    }
}

impl Drop for CameraTopics {
    fn drop(&mut self) {
        // With the service goes the other sender, so that the thread ends.
        self.bus.leave(self.member);
        self.orders.take();
        if let Some(worker) = self.worker.take() {
            let _ = worker.join();
        }
    }
}

/// Hands orders to the thread that takes the pictures.
struct Shutter(SyncSender<ServiceReply>);

impl ServiceProvider for Shutter {
    fn call(&self, _: Json, reply: ServiceReply) {
        if let Err(TrySendError::Full(reply) | TrySendError::Disconnected(reply)) = self.0.try_send(reply) {
            let message = format!("{MAX_WAITING} pictures wait to be taken already; ask again");
            reply.answer(Ok(json!({"success": false, "message": message})));
        }
    }
}

struct Photographer {
    bus: Weak<dyn TopicBus>,
    studio: Studio,
    latest: Arc<Latest>,
}

impl Photographer {
    /// Takes a picture and publishes it; the answer of the service.
    fn take(&self) -> Json {
        let (Some(frame), Some(bus)) = (self.latest.get(), self.bus.upgrade()) else {
            return json!({"success": false, "message": "nothing is shown yet; ask again"});
        };
        let camera = self.studio.camera(View::Head, &frame, SIZE, FRAC_PI_3);
        let picture = self.studio.take(&frame, &camera);
        bus.publish(&messages(&frame, &camera, picture));
        json!({"success": true, "message": format!("published on {IMAGE}")})
    }
}

fn messages(frame: &DisplayFrame, camera: &Camera, picture: Picture) -> [Arc<TopicMessage>; 3] {
    let header = |frame_id: &str| {
        named([
            ("seq", Value::Uint(0)),
            ("stamp", Value::Time(time_of(frame))),
            ("frame_id", Value::Text(frame_id.to_owned())),
        ])
    };
    let whole = |number: u32| Value::Uint(number.into());
    let size = [("height", whole(camera.height)), ("width", whole(camera.width))];
    let [height, width] = size.clone();
    let image = named([
        ("header", header(FRAME)),
        height,
        width,
        ("encoding", Value::Text("rgb8".to_owned())),
        ("is_bigendian", Value::Uint(0)),
        ("step", whole(3 * camera.width)),
        ("data", Value::Bytes(picture.rgb)),
    ]);
    let k = camera.intrinsics();
    let p = [k[0], k[1], k[2], 0.0, k[3], k[4], k[5], 0.0, k[6], k[7], k[8], 0.0];
    let [height, width] = size;
    let info = named([
        ("header", header(FRAME)),
        height,
        width,
        ("distortion_model", Value::Text("plumb_bob".to_owned())),
        ("D", Value::Floats(vec![0.0; 5])),
        ("K", Value::Floats(k.to_vec())),
        ("R", Value::Floats(vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])),
        ("P", Value::Floats(p.to_vec())),
        ("binning_x", whole(0)),
        ("binning_y", whole(0)),
        (
            "roi",
            named([
                ("x_offset", whole(0)),
                ("y_offset", whole(0)),
                ("height", whole(0)),
                ("width", whole(0)),
                ("do_rectify", Value::Bool(false)),
            ]),
        ),
    ]);
    [
        TopicMessage::new(IMAGE, known_type("sensor_msgs/Image"), image),
        TopicMessage::new(INFO, known_type("sensor_msgs/CameraInfo"), info),
        stamped_pose(POSE, &header("world"), &camera.world_from_camera),
    ]
}
