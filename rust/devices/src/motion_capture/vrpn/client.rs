//! A client that keeps its connection.

use super::{
    VRPN_PORT, VrpnEvent, VrpnParser,
    message::{PING, PONG, cookie, write_description, write_message},
};
use crate::{
    DeviceError,
    motion_capture::{CaptureLink, HostClock, MotionCapture, inflow::Inflow, inflow::ThreadedCapture},
};
use proact_localization::RawBodyPose;
use std::{
    io::{ErrorKind, Read, Write},
    net::{TcpStream, ToSocketAddrs},
    time::{Duration, Instant},
};

/// A server on the same network answers within milliseconds.
const CONNECT: Duration = Duration::from_secs(1);
/// From one attempt to the next.
const RETRY: Duration = Duration::from_millis(300);
/// Longest wait in which the end of the source is not noticed.
const GLANCE: Duration = Duration::from_millis(20);
/// From ping to ping, and how long a server may say nothing at all: VRPN's own.
const PING_EVERY: Duration = Duration::from_secs(1);
const MOST_SILENCE: Duration = Duration::from_secs(3);

/// Our numbers of the two message types that we send.
const OUR_PING: i32 = 0;
const OUR_PONG: i32 = 1;

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
        Ok(Self(ThreadedCapture::start(name, clock, waiting, move |inflow| follow(&address, &inflow))))
    }
}

impl MotionCapture for VrpnClient {
    fn name(&self) -> &str {
        self.0.name()
    }

    fn take(&mut self, poses: &mut Vec<RawBodyPose>) -> Result<CaptureLink, DeviceError> {
        self.0.take(poses)
    }

    fn malformed(&self) -> u64 {
        self.0.malformed()
    }
}

/// Connection after connection until nobody takes poses any more.
fn follow(address: &str, inflow: &Inflow) {
    while !inflow.is_over() {
        let reason = match connect(address) {
            Ok(stream) => serve(stream, inflow),
            Err(error) => format!("{error}; is the server running, and is VRPN streaming switched on there?"),
        };
        inflow.wait(format!("{address}: {reason}"));
        let again = Instant::now() + RETRY;
        while !inflow.is_over() && Instant::now() < again {
            std::thread::sleep(GLANCE);
        }
    }
}

fn connect(address: &str) -> std::io::Result<TcpStream> {
    let mut last = std::io::Error::new(ErrorKind::NotFound, "the name has no address");
    for place in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&place, CONNECT) {
            Ok(stream) => {
                stream.set_nodelay(true)?;
                stream.set_read_timeout(Some(GLANCE))?;
                stream.set_write_timeout(Some(CONNECT))?;
                return Ok(stream);
            }
            Err(error) => last = error,
        }
    }
    Err(last)
}

/// Follows a connection to its end; why it ended.
fn serve(mut stream: TcpStream, inflow: &Inflow) -> String {
    let mut out = cookie().to_vec();
    write_description(&mut out, false, OUR_PING, PING);
    write_description(&mut out, false, OUR_PONG, PONG);
    let mut devices: Vec<String> = Vec::new();
    let (mut parser, mut bytes) = (VrpnParser::new(), [0; 16 * 1024]);
    let (mut heard, mut pinged) = (Instant::now(), Instant::now());
    loop {
        if inflow.is_over() {
            return "closed".to_owned();
        }
        if !devices.is_empty() && pinged.elapsed() >= PING_EVERY {
            (0..devices.len()).for_each(|n| write_message(&mut out, (0, 0), n as i32, OUR_PING, &[]));
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
                heard = Instant::now();
                parser.push(&bytes[..count]);
            }
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                if heard.elapsed() > MOST_SILENCE {
                    return format!("silent for {} s, not even an answer to a ping", MOST_SILENCE.as_secs());
                }
                continue;
            }
            Err(error) => return error.to_string(),
        }
        loop {
            match parser.next_event() {
                Ok(None) => break,
                Ok(Some(VrpnEvent::Greeted)) => inflow.link(CaptureLink::Connected),
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
                        write_message(&mut out, (0, 0), number as i32, OUR_PONG, &[]);
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
                    inflow.malformed();
                    return error.to_string();
                }
            }
        }
    }
}
