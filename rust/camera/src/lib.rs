//! A simulated camera in the trial's room, for vision code: colours and depths of what one instant looks like.
//!
//! Rays are cast at the bodies: table, box, blocks, and the arm's drawn shapes, or its collision shapes where it is
//! drawn from meshes. Not drawn are markers, targets, the numbers on the blocks and the person. One light, no
//! shadows, no noise, no distortion. The same instant gives the same picture.
//!
//! Pure: no clock, no files, no threads. Who takes the picture, and for whom, is the page's and rosbridge's matter.
//!
//! ```
//! use proact_camera::{Renderer, CameraView};
//! # fn example(arm: proact_arm::ArmModel, scene: proact_types::Scene, frame: proact_types::DisplayFrame) {
//! let studio = Renderer::new(&arm, &scene);
//! let camera = studio.camera(CameraView::Head, &frame, [640, 480], 60f64.to_radians());
//! let picture = studio.render(&frame, &camera);
//! std::hint::black_box(proact_camera::encode_png(camera.width, camera.height, &picture.rgb));
//! # }
//! ```
#![cfg_attr(test, allow(clippy::unwrap_used))]

mod ray;

use nalgebra::{Matrix3, Rotation3, UnitQuaternion};
use proact_arm::{ArmModel, VisualGeometry};
use proact_types::{DisplayFrame, Point, Pose, Scene, Shape, Vector};
use serde::Deserialize;

/// Nothing nearer is seen, metres.
const NEAR_PLANE_M: f64 = 0.02;
/// How high above the table the camera of [`CameraView::Overhead`] hangs, metres.
const OVERHEAD_HEIGHT_M: f64 = 0.9;
/// Colour where nothing is.
const BACKGROUND: [f64; 3] = [0.82, 0.86, 0.9];
/// Share of the light that comes from everywhere.
const AMBIENT: f64 = 0.4;

/// From where the camera looks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CameraView {
    /// From the participant's eye at the middle of the table.
    #[default]
    Head,
    /// From above the middle of the table, straight down; the person is at the lower edge.
    Overhead,
}

/// A pinhole camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// `world_from_camera`, with a camera's axes: x right, y down, z ahead.
    pub world_from_camera: Pose,
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// Between the upper and the lower edge, rad, above 0 and below pi.
    pub vertical_fov_rad: f64,
}

impl Camera {
    /// Distance of the picture's plane, pixels; the same along both axes.
    pub fn focal_length(&self) -> f64 {
        f64::from(self.height) / 2.0 / (self.vertical_fov_rad / 2.0).tan()
    }

    /// The matrix K of the camera, row by row: focal lengths, and the centre in the middle of the picture. The middle
    /// of the upper left pixel is (0, 0).
    pub fn intrinsics(&self) -> [f64; 9] {
        let f = self.focal_length();
        let [cx, cy] = [self.width, self.height].map(|size| (f64::from(size) - 1.0) / 2.0);
        [f, 0.0, cx, 0.0, f, cy, 0.0, 0.0, 1.0]
    }
}

/// What a camera has taken.
#[derive(Clone, Debug, PartialEq)]
pub struct RgbdImage {
    /// Red, green and blue, row by row from the top, `3 * width * height` bytes.
    pub rgb: Vec<u8>,
    /// Distance along the camera's z, metres, row by row; infinite where nothing is.
    pub depth_m: Vec<f32>,
}

/// A body as the camera sees it.
struct RenderBody {
    shape: Shape,
    parent: BodyParent,
    color: [f64; 3],
}

/// What carries a body.
enum BodyParent {
    /// `world_from_shape`.
    World(Pose),
    /// Which object.
    Object(usize),
    /// Which link, and `link_from_shape`.
    Link(usize, Pose),
}

/// The bodies of a room, ready to have their picture taken.
pub struct Renderer {
    arm: ArmModel,
    bodies: Vec<RenderBody>,
    table_center: Point,
}

impl Renderer {
    /// A room with an arm in it.
    pub fn new(arm: &ArmModel, scene: &Scene) -> Renderer {
        let fixed = scene.fixed.iter().map(|object| RenderBody {
            shape: object.shape,
            parent: BodyParent::World(object.pose),
            color: if object.name.starts_with("table") { [0.76, 0.64, 0.5] } else { [0.62, 0.62, 0.6] },
        });
        let blocks = scene.objects.iter().enumerate().map(|(n, block)| RenderBody {
            shape: block.shape,
            parent: BodyParent::Object(n),
            color: block.color,
        });
        let mut bodies: Vec<RenderBody> = fixed.chain(blocks).collect();
        for (index, link) in arm.links.iter().enumerate() {
            let mut drawn = Vec::new();
            for visual in &link.visuals {
                if let VisualGeometry::Shape(shape) = visual.geometry {
                    let [red, green, blue, _] = visual.color;
                    drawn.push((shape, visual.pose, [red, green, blue]));
                }
            }
            if drawn.len() < link.visuals.len() || drawn.is_empty() {
                drawn = link.collisions.iter().map(|c| (c.shape, c.pose, [0.35, 0.37, 0.4])).collect();
            }
            bodies.extend(drawn.into_iter().map(|(shape, pose, color)| RenderBody {
                shape,
                parent: BodyParent::Link(index, pose),
                color,
            }));
        }
        let sum: Vector = scene.targets.iter().map(|target| target.center.coords).sum();
        let starts: Vector = scene.objects.iter().map(|block| block.pose.translation.vector).sum();
        let count = (scene.targets.len() + scene.objects.len()).max(1) as f64;
        let mut table_center = Point::from((sum + starts) / count);
        table_center.z = scene.table_height;
        Renderer { arm: arm.clone(), bodies, table_center }
    }

    /// A camera at one of the usual places at the instant of `frame`.
    pub fn camera(
        &self,
        view: CameraView,
        frame: &DisplayFrame,
        size: [u32; 2],
        vertical_fov: f64,
    ) -> Camera {
        let eye = match view {
            CameraView::Head => frame.world_from_head.translation.vector.into(),
            CameraView::Overhead => self.table_center + Vector::new(0.0, 0.0, OVERHEAD_HEIGHT_M),
        };
        let world_from_camera = look_at(eye, &self.table_center);
        let [width, height] = size;
        Camera { world_from_camera, width, height, vertical_fov_rad: vertical_fov }
    }

    /// Takes a picture of an instant. What `frame` leaves out, such as an object, is not seen.
    pub fn render(&self, frame: &DisplayFrame, camera: &Camera) -> RgbdImage {
        let pixels = camera.width as usize * camera.height as usize;
        let background = BACKGROUND.map(color_byte);
        let mut picture = RgbdImage { rgb: background.repeat(pixels), depth_m: vec![f32::INFINITY; pixels] };
        let base_from_link = self.arm.link_poses(&frame.joints);
        let camera_from_world = camera.world_from_camera.inverse();
        for body in &self.bodies {
            let world_from_shape = match &body.parent {
                BodyParent::World(pose) => Some(*pose),
                BodyParent::Object(n) => frame.objects.get(*n).copied(),
                BodyParent::Link(n, pose) => Some(frame.world_from_base * base_from_link[*n] * pose),
            };
            if let Some(world_from_shape) = world_from_shape {
                draw_body(body, &(camera_from_world * world_from_shape), camera, &mut picture);
            }
        }
        picture
    }
}

/// `world_from_camera` of an upright camera at `eye` that looks at `point`; from straight above, the person's side is
/// the lower edge.
fn look_at(eye: Point, point: &Point) -> Pose {
    let ahead = (point - eye).try_normalize(1e-9).unwrap_or(-Vector::z());
    let right = ahead.cross(&Vector::z()).try_normalize(1e-6).unwrap_or(-Vector::y());
    let axes = Matrix3::from_columns(&[right, ahead.cross(&right), ahead]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    Pose::from_parts(eye.into(), rotation)
}

/// Draws a body where it is nearer than what the picture has so far.
fn draw_body(body: &RenderBody, camera_from_shape: &Pose, camera: &Camera, picture: &mut RgbdImage) {
    let [f, _, cx, _, _, cy, ..] = camera.intrinsics();
    let center = camera_from_shape.translation.vector;
    let reach = ray::bounding_radius(&body.shape);
    let columns = pixel_range(center.x, center.z, reach, f, cx, camera.width);
    let rows = pixel_range(center.y, center.z, reach, f, cy, camera.height);
    let shape_from_camera = camera_from_shape.inverse();
    let eye = shape_from_camera.translation.vector;
    let light =
        shape_from_camera.rotation * (camera.world_from_camera.inverse().rotation * light_direction());
    for row in rows {
        for column in columns.clone() {
            // With z = 1 the way along the ray is the depth.
            let ray = Vector::new((f64::from(column) - cx) / f, (f64::from(row) - cy) / f, 1.0);
            let Some((depth, normal)) =
                ray::intersect_ray(&body.shape, &eye, &(shape_from_camera.rotation * ray), NEAR_PLANE_M)
            else {
                continue;
            };
            let pixel = row as usize * camera.width as usize + column as usize;
            if (depth as f32) < picture.depth_m[pixel] {
                picture.depth_m[pixel] = depth as f32;
                let bright = AMBIENT + (1.0 - AMBIENT) * normal.dot(&light).max(0.0);
                picture.rgb[3 * pixel..3 * pixel + 3]
                    .copy_from_slice(&body.color.map(|c| color_byte(c * bright)));
            }
        }
    }
}

/// Where the light comes from, in `world`: from above, behind the person's left shoulder.
fn light_direction() -> Vector {
    Vector::new(-0.4, 0.5, 1.0).normalize()
}

/// Pixels along one axis on which a ball of radius `reach` at `(across, ahead)` may be seen.
fn pixel_range(across: f64, ahead: f64, reach: f64, f: f64, center: f64, size: u32) -> std::ops::Range<u32> {
    if ahead + reach < NEAR_PLANE_M {
        return 0..0;
    }
    if ahead - reach < NEAR_PLANE_M {
        return 0..size;
    }
    let edge = |side: f64| {
        let near = side / (ahead - reach);
        let far = side / (ahead + reach);
        (near.min(far) * f + center, near.max(far) * f + center)
    };
    let (first, last) = (edge(across - reach).0.floor(), edge(across + reach).1.ceil() + 1.0);
    // Both are within the picture's size after the clamp.
    let [first, last] = [first, last].map(|edge| edge.clamp(0.0, f64::from(size)) as u32);
    first..last
}

fn color_byte(share: f64) -> u8 {
    (share.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// An 8-bit RGB picture as a PNG file; `rgb` has `3 * width * height` bytes.
///
/// # Panics
/// For another number of bytes.
pub fn encode_png(width: u32, height: u32, rgb: &[u8]) -> Vec<u8> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    encoder
        .write_header()
        .and_then(|mut writer| writer.write_image_data(rgb))
        .expect("a vector takes every byte and the size fits the data");
    file
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_arm::{CollisionShape, Joint, JointKind, JointLimits, Link};
    use proact_types::{Command, HandView, PlannerView, SimTime, TargetView};

    /// A beam that hangs from a joint at the base: 12 cm wide and 60 cm long.
    fn arm() -> ArmModel {
        let link =
            |name: &str, collisions| Link { name: name.into(), inertial: None, collisions, visuals: vec![] };
        let beam = Shape::Box { size: [0.12, 0.12, 0.6] };
        let shape = CollisionShape { pose: Pose::translation(0.0, 0.0, -0.3), shape: beam };
        ArmModel {
            name: "beam".into(),
            links: vec![link("base", vec![]), link("beam", vec![shape])],
            joints: vec![Joint {
                name: "shoulder".into(),
                kind: JointKind::Revolute,
                parent: 0,
                child: 1,
                origin: Pose::identity(),
                axis: Vector::x(),
                limits: JointLimits::default(),
                damping: 0.0,
                friction: 0.0,
            }],
            arm: vec![0],
            hand: vec![],
            tip: 1,
            poses: vec![],
            allowed_collisions: vec![],
            ..Default::default()
        }
    }

    /// An instant with a red block ahead and below the head, and nothing else but the arm at the origin.
    fn frame() -> DisplayFrame {
        DisplayFrame {
            time: SimTime(1500),
            method: "D".to_owned(),
            joints: proact_types::joints(&[0.0]),
            world_from_base: Pose::identity(),
            world_from_tip: Pose::identity(),
            world_from_head: Pose::translation(2.0, 0.1, 1.5),
            objects: vec![Pose::translation(2.8, 0.0, 1.3)],
            hand: HandView::default(),
            gaze: None,
            target: TargetView::default(),
            planner: PlannerView::Idle,
            mode: None,
            stop: None,
            command: Command::NoMotion,
            recognized_gesture: Command::NoMotion.into(),
            confidence: 1.0,
            effort: 0.0,
            emg_source: "keys".to_owned(),
            time_left_secs: 1.0,
            plan_goal: None,
            next_object: None,
            task_goal: None,
            score: 0,
            finished: false,
            events: Vec::new(),
            contacts: Vec::new(),
            feedback: Vec::new(),
        }
    }

    fn renderer() -> Renderer {
        let shape = Shape::Sphere { radius: 0.05 };
        let ball = proact_types::Object {
            color: [0.784, 0.267, 0.173],
            ..proact_types::Object::with_default_friction(
                "ball",
                shape,
                0.1,
                Pose::translation(2.8, 0.0, 1.3),
            )
        };
        let scene = Scene { objects: vec![ball], table_height: 1.3, ..Scene::default() };
        Renderer::new(&arm(), &scene)
    }

    /// A level camera that looks along x, or against it.
    fn camera(eye: &[f64; 3], along_x: f64, vertical_fov: f64) -> Camera {
        let eye = Point::from(*eye);
        let world_from_camera = look_at(eye, &(eye + Vector::x() * along_x));
        Camera { world_from_camera, width: 320, height: 240, vertical_fov_rad: vertical_fov }
    }

    #[test]
    fn a_ball_is_where_the_matrix_puts_it_and_as_far_and_as_wide_as_it_is() {
        let (renderer, frame) = (renderer(), frame());
        let camera = camera(&[2.0, 0.1, 1.5], 1.0, 1.0);
        let picture = renderer.render(&frame, &camera);
        let red = |pixel: usize| picture.rgb[3 * pixel] / 2 > picture.rgb[3 * pixel + 2];
        let pixels: Vec<usize> = (0..320 * 240).filter(|&pixel| red(pixel)).collect();
        // 0.8 m ahead, 0.1 m to the right, 0.2 m down.
        let f = camera.focal_length();
        let expected = [f * 0.1 / 0.8 + 159.5, f * 0.2 / 0.8 + 119.5];
        let count = pixels.len() as f64;
        let mean = [
            pixels.iter().map(|p| (p % 320) as f64).sum::<f64>() / count,
            pixels.iter().map(|p| (p / 320) as f64).sum::<f64>() / count,
        ];
        for (mean, expected) in mean.iter().zip(expected) {
            assert!((mean - expected).abs() < 1.0, "{mean} for {expected}");
        }
        let across = 2.0 * (count / std::f64::consts::PI).sqrt() * 0.8 / f;
        assert!((across - 0.1).abs() < 0.01, "{across} m across");
        let nearest = pixels.iter().map(|&p| picture.depth_m[p]).fold(f32::INFINITY, f32::min);
        assert!((f64::from(nearest) - 0.75).abs() < 0.01, "{nearest} m ahead");
        assert!(picture.depth_m[0].is_infinite(), "there is nothing in the corner");
        assert_eq!(renderer.render(&frame, &camera), picture, "the same instant");
    }

    #[test]
    fn what_is_nearer_hides_what_is_behind_and_what_is_behind_the_camera_is_not_seen() {
        let (renderer, mut frame) = (renderer(), frame());
        let red = |picture: &RgbdImage| picture.rgb.chunks(3).filter(|p| p[0] / 2 > p[2]).count();
        assert_eq!(
            red(&renderer.render(&frame, &camera(&[2.0, 0.1, 1.5], -1.0, 1.0))),
            0,
            "the ball is behind"
        );
        // The arm, at the origin, stands before a ball that is moved behind it.
        let camera = camera(&[1.0, 0.0, -0.3], -1.0, 0.6);
        frame.objects[0] = Pose::translation(-0.2, 0.0, -0.3);
        let hidden = red(&renderer.render(&frame, &camera));
        frame.objects[0] = Pose::translation(0.2, 0.0, -0.3);
        let whole = red(&renderer.render(&frame, &camera));
        assert!(hidden < whole / 2, "{hidden} pixels behind the arm, {whole} before it");
        // The arm is raised out of the way.
        frame.objects[0] = Pose::translation(-0.2, 0.0, -0.3);
        frame.joints[0] = std::f64::consts::FRAC_PI_2;
        let free = red(&renderer.render(&frame, &camera));
        assert!(free > whole / 3, "{free} pixels past the raised arm, {whole} before the hanging one");
    }

    #[test]
    fn a_camera_within_a_body_or_an_instant_with_little_in_it_is_no_fault() {
        let (renderer, mut frame) = (renderer(), frame());
        frame.world_from_head = frame.objects[0];
        frame.joints.clear();
        let camera = renderer.camera(CameraView::Overhead, &frame, [16, 16], 1.0);
        let down = camera.world_from_camera * Vector::new(0.1, 0.2, 0.3);
        assert!(
            (down - Vector::new(-0.2, -0.1, -0.3)).norm() < 1e-12,
            "x is to the right, y towards the person"
        );
        let eye =
            renderer.camera(CameraView::Head, &frame, [16, 16], 1.0).world_from_camera.translation.vector;
        assert_eq!(eye, frame.world_from_head.translation.vector);
        renderer.render(&frame, &renderer.camera(CameraView::Head, &frame, [16, 16], 1.0));
        frame.objects.clear();
        renderer.render(&frame, &camera);
    }
}
