//! A client that keeps its connection.

use super::{
    VRPN_PORT, VrpnEvent, VrpnParser,
    message::{PING, PONG, cookie, write_description, write_message},
};
use crate::{
    DeviceError,
    motion_capture::{
        CaptureStatus, HostClock, MotionCapture, pose_queue::PoseQueue, pose_queue::ThreadedCapture,
    },
};
use proact_localization::RawBodyPose;
use std::{
    io::{ErrorKind, Read, Write},
    net::{TcpStream, ToSocketAddrs},
    time::{Duration, Instant},
};

/// A server on the same network answers within milliseconds.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(1);
/// From one attempt to the next.
const RETRY_INTERVAL: Duration = Duration::from_millis(300);
/// Longest wait in which the end of the source is not noticed.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// From ping to ping, and how long a server may say nothing at all: VRPN's own.
const PING_INTERVAL: Duration = Duration::from_secs(1);
const SILENCE_TIMEOUT: Duration = Duration::from_secs(3);

/// Our numbers of the two message types that we send.
const PING_TYPE_ID: i32 = 0;
const PONG_TYPE_ID: i32 = 1;

/// All trackers of a VRPN server. A connection that ends is made again.
pub struct VrpnClient(ThreadedCapture);

impl VrpnClient {
    /// Connects to `host`, such as `192.168.1.5` or `motive.local:3883`; the server need not be there yet.
    ///
    /// # Errors
    /// [`DeviceError::Tcp`] for a name that cannot be one.
    pub fn open(host: &str, clock: HostClock) -> Result<Self, DeviceError> {
        let address = if host.contains(':') { host.to_owned() } else { format!("{host}:{VRPN_PORT}") };
        if let Err(source) = address.to_socket_addrs() {
            return Err(DeviceError::Tcp { address, source });
        }
        let waiting = format!("connecting to {address}");
        let name = format!("VRPN {address}");
        Ok(Self(ThreadedCapture::start(name, clock, waiting, move |inflow| {
            keep_connected(&address, &inflow)
        })))
    }
}

impl MotionCapture for VrpnClient {
    fn name(&self) -> &str {
        self.0.name()
    }

    fn drain_poses(&mut self, poses: &mut Vec<RawBodyPose>) -> Result<CaptureStatus, DeviceError> {
        self.0.drain_poses(poses)
    }

    fn malformed(&self) -> u64 {
        self.0.malformed()
    }
}

/// Connection after connection until nobody takes poses any more.
fn keep_connected(address: &str, inflow: &PoseQueue) {
    while !inflow.is_closed() {
        let reason = match connect(address) {
            Ok(stream) => read_connection(stream, inflow),
            Err(error) => format!("{error}; is the server running, and is VRPN streaming switched on there?"),
        };
        inflow.set_waiting(format!("{address}: {reason}"));
        let again = Instant::now() + RETRY_INTERVAL;
        while !inflow.is_closed() && Instant::now() < again {
            std::thread::sleep(POLL_INTERVAL);
        }
    }
}

fn connect(address: &str) -> std::io::Result<TcpStream> {
    let mut last = std::io::Error::new(ErrorKind::NotFound, "the name has no address");
    for socket_address in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&socket_address, CONNECT_TIMEOUT) {
            Ok(stream) => {
                stream.set_nodelay(true)?;
                stream.set_read_timeout(Some(POLL_INTERVAL))?;
                stream.set_write_timeout(Some(CONNECT_TIMEOUT))?;
                return Ok(stream);
            }
            Err(error) => last = error,
        }
    }
    Err(last)
}

/// Follows a connection to its end; why it ended.
fn read_connection(mut stream: TcpStream, inflow: &PoseQueue) -> String {
    let mut out = cookie().to_vec();
    write_description(&mut out, false, PING_TYPE_ID, PING);
    write_description(&mut out, false, PONG_TYPE_ID, PONG);
    let mut devices: Vec<String> = Vec::new();
    let (mut parser, mut bytes) = (VrpnParser::new(), [0; 16 * 1024]);
    let (mut received_at, mut pinged) = (Instant::now(), Instant::now());
    loop {
        if inflow.is_closed() {
            return "closed".to_owned();
        }
        if !devices.is_empty() && pinged.elapsed() >= PING_INTERVAL {
            (0..devices.len()).for_each(|n| write_message(&mut out, (0, 0), n as i32, PING_TYPE_ID, &[]));
            pinged = Instant::now();
        }
        if !out.is_empty() {
            if let Err(error) = stream.write_all(&out) {
                return error.to_string();
            }
            out.clear();
        }
        match stream.read(&mut bytes) {
            Ok(0) => return "the server closed the connection".to_owned(),
            Ok(count) => {
                received_at = Instant::now();
                parser.push(&bytes[..count]);
            }
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                if received_at.elapsed() > SILENCE_TIMEOUT {
                    return format!(
                        "silent for {} s, not even an answer to a ping",
                        SILENCE_TIMEOUT.as_secs()
                    );
                }
                continue;
            }
            Err(error) => return error.to_string(),
        }
        loop {
            match parser.next_event() {
                Ok(None) => break,
                Ok(Some(VrpnEvent::CookieReceived)) => inflow.set_status(CaptureStatus::Connected),
                Ok(Some(VrpnEvent::Pong)) => {}
                Ok(Some(VrpnEvent::Disconnect)) => return "the server took its leave".to_owned(),
                Ok(Some(VrpnEvent::Device(name))) => {
                    // Pings and pongs are about a device, under our own number for it.
                    if !devices.contains(&name) {
                        write_description(&mut out, true, devices.len() as i32, &name);
                        devices.push(name);
                    }
                }
                Ok(Some(VrpnEvent::Ping { device })) => {
                    if let Some(number) = devices.iter().position(|known| *known == device) {
                        write_message(&mut out, (0, 0), number as i32, PONG_TYPE_ID, &[]);
                    }
                }
                Ok(Some(VrpnEvent::Pose(pose))) => inflow.push(RawBodyPose {
                    body: pose.body,
                    id: Some(pose.device),
                    stamp: i64::from(pose.secs) * 1_000_000_000 + i64::from(pose.micros) * 1000,
                    arrival: inflow.clock.now(),
                    position: pose.position,
                    quaternion: pose.quaternion,
                    // VRPN has no word for a body that is not seen: such a one is silent.
                    tracked: true,
                }),
                Err(error) => {
                    inflow.count_malformed();
                    return error.to_string();
                }
            }
        }
    }
}
