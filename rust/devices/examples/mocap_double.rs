//! A motion capture system for a desk without one: a shoulder that sways, streamed by VRPN at 120 Hz.
//!
//! ```text
//! cargo run --release -p proact-devices --example mocap_double -- 127.0.0.1:3883 Shoulderpad
//! proact serve --mocap vrpn:127.0.0.1/Shoulderpad
//! ```
#![allow(clippy::disallowed_methods)]

use proact_devices::motion_capture::{HostClock, vrpn::VrpnServer};
use proact_localization::RawBodyPose;
use std::{error::Error, time::Duration};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [address, body] = &arguments[..] else { return Err("expected ADDRESS:PORT BODY".into()) };
    let mut server = VrpnServer::bind(address, &[body])?;
    let clock = HostClock::start();
    loop {
        let stamp = clock.now();
        let t = stamp as f64 * 1e-9;
        let (sin, cos) = (0.1 * (0.9 * t).sin()).sin_cos();
        server.send(&[RawBodyPose {
            body: body.clone(),
            id: None,
            stamp,
            arrival: stamp,
            position: [0.05 * (0.7 * t).sin(), 0.04 * (1.1 * t).cos(), 1.35 + 0.01 * (1.6 * t).sin()],
            quaternion: [0.0, 0.0, sin, cos],
            tracked: true,
        }]);
        std::thread::sleep(Duration::from_micros(8333));
    }
}
