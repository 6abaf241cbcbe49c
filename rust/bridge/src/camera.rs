//! `/camera.png` and `/camera.json`: what a simulated camera sees.

use crate::server::PageServerState;
use axum::{
    extract::{Query, State},
    http::{StatusCode, header},
    response::{IntoResponse, Response},
};
use base64::{Engine, engine::general_purpose::STANDARD as BASE64};
use proact_camera::{Camera, CameraView, Renderer, encode_png};
use proact_types::DisplayFrame;
use serde::Deserialize;
use serde_json::json;
use std::sync::Arc;

/// Smallest and largest sides of a picture, pixels.
const SIDE_RANGE_PX: std::ops::RangeInclusive<u32> = 16..=1920;
/// Smallest and largest angle between the upper and the lower edge, degrees.
const FOV_RANGE_DEG: std::ops::RangeInclusive<f64> = 5.0..=150.0;

/// What picture is asked for.
#[derive(Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct CameraQuery {
    view: CameraView,
    width: u32,
    height: u32,
    /// Degrees.
    #[serde(rename = "fov")]
    fov_deg: f64,
}

impl Default for CameraQuery {
    fn default() -> Self {
        CameraQuery { view: CameraView::Head, width: 640, height: 480, fov_deg: 60.0 }
    }
}

/// A picture of the latest instant.
struct CameraPicture {
    frame: Arc<DisplayFrame>,
    camera: Camera,
    png: Vec<u8>,
}

/// `GET /camera.png?view=head|overhead&width=640&height=480&fov=60`: the latest instant.
pub(crate) async fn camera_png(
    State(shared): State<Arc<PageServerState>>,
    Query(wanted): Query<CameraQuery>,
) -> Response {
    match render_picture(&shared, &wanted).await {
        Ok(taken) => ([(header::CONTENT_TYPE, "image/png"), (header::CACHE_CONTROL, "no-store")], taken.png)
            .into_response(),
        Err(refused) => refused.into_response(),
    }
}

/// `GET /camera.json` with the same words: picture (base64 of the PNG file), time (ms), the matrix `k` and
/// `world_from_camera`, all of one instant.
pub(crate) async fn camera_json(
    State(shared): State<Arc<PageServerState>>,
    Query(wanted): Query<CameraQuery>,
) -> Response {
    match render_picture(&shared, &wanted).await {
        Ok(CameraPicture { frame, camera, png }) => {
            let (p, q) =
                (camera.world_from_camera.translation.vector, camera.world_from_camera.rotation.coords);
            axum::Json(json!({
                "time": frame.time,
                "width": camera.width,
                "height": camera.height,
                "k": camera.intrinsics(),
                "world_from_camera": {"position": [p.x, p.y, p.z], "quaternion": [q.x, q.y, q.z, q.w]},
                "png": BASE64.encode(png),
            }))
            .into_response()
        }
        Err(refused) => refused.into_response(),
    }
}

async fn render_picture(
    shared: &Arc<PageServerState>,
    wanted: &CameraQuery,
) -> Result<CameraPicture, (StatusCode, String)> {
    let CameraQuery { view, width, height, fov_deg: fov } = *wanted;
    if !SIDE_RANGE_PX.contains(&width) || !SIDE_RANGE_PX.contains(&height) || !FOV_RANGE_DEG.contains(&fov) {
        let (sides, angles) = (SIDE_RANGE_PX, FOV_RANGE_DEG);
        let reason = format!(
            "a picture of {width} x {height} pixels and {fov} degrees; expected sides of {} to {} pixels, an angle \
             of {} to {} degrees\n",
            sides.start(),
            sides.end(),
            angles.start(),
            angles.end()
        );
        return Err((StatusCode::BAD_REQUEST, reason));
    }
    let Some(frame) = shared.feed.borrow().latest.clone() else {
        return Err((StatusCode::SERVICE_UNAVAILABLE, "nothing is shown yet; try again\n".to_owned()));
    };
    let renderer: Arc<Renderer> = shared.renderer();
    let ends = || (StatusCode::SERVICE_UNAVAILABLE, "the server ends\n".to_owned());
    // One at a time: pictures must not take the processor from the trial.
    let _turn = shared.render_permit.acquire().await.map_err(|_| ends())?;
    tokio::task::spawn_blocking(move || {
        let camera = renderer.camera(view, &frame, [width, height], fov.to_radians());
        let png = encode_png(width, height, &renderer.render(&frame, &camera).rgb);
        CameraPicture { frame, camera, png }
    })
    .await
    .map_err(|_| ends())
}
