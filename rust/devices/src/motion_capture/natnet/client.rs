//! A client that keeps asking.

use super::{
    NATNET_COMMAND_PORT, NATNET_DATA_PORT, NATNET_GROUP, NatNetFrame, NatNetMessage, NatNetServerInfo,
    packet::{
        KEEP_ALIVE, MAX_PACKET_BYTES, REQUEST, REQUEST_DEFINITIONS, VERSION, connect_packet, packet, parse,
    },
};
use crate::{
    DeviceError,
    motion_capture::{
        CaptureStatus, HostClock, MotionCapture, pose_queue::PoseQueue, pose_queue::ThreadedCapture,
    },
};
use proact_localization::RawBodyPose;
use socket2::{Domain, Protocol, Socket, Type};
use std::{
    collections::BTreeMap,
    io::ErrorKind,
    net::{Ipv4Addr, SocketAddr, SocketAddrV4, ToSocketAddrs, UdpSocket},
    time::{Duration, Instant},
};

/// Longest wait in which the end of the source is not noticed.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// From greeting to greeting, and from request to request.
const REQUEST_INTERVAL: Duration = Duration::from_millis(300);
/// What keeps a unicast stream up.
const KEEP_ALIVE_INTERVAL: Duration = Duration::from_secs(1);
/// A server that sends no frame for so long is greeted anew: it may have been started again.
const FRAME_TIMEOUT: Duration = Duration::from_secs(2);
/// A frame that is older than the newest by up to so many was overtaken; by more, the numbering began anew.
const MAX_REORDERED_FRAMES: i32 = 100;

/// How a server is asked.
#[derive(Clone, Copy, Debug, Default)]
pub struct NatNetOptions {
    /// The address of this machine by which the server is reached; found by itself where there is one way.
    pub interface: Option<Ipv4Addr>,
}

/// All rigid bodies of a NatNet server.
pub struct NatNetClient(ThreadedCapture);

impl NatNetClient {
    /// Asks `host`, such as `192.168.1.5` or `127.0.0.1:1510`; the server need not be there yet.
    ///
    /// # Errors
    /// [`DeviceError::Udp`] for a name that has no IPv4 address, or where no socket can be had.
    pub fn open(host: &str, options: NatNetOptions, clock: HostClock) -> Result<Self, DeviceError> {
        let address =
            if host.contains(':') { host.to_owned() } else { format!("{host}:{NATNET_COMMAND_PORT}") };
        let failed = |source| DeviceError::Udp { address: address.clone(), source };
        let mut addresses = address.to_socket_addrs().map_err(failed)?;
        let server =
            addresses.find(SocketAddr::is_ipv4).ok_or_else(|| failed(ErrorKind::AddrNotAvailable.into()))?;
        let command =
            UdpSocket::bind((options.interface.unwrap_or(Ipv4Addr::UNSPECIFIED), 0)).map_err(failed)?;
        command.connect(server).map_err(failed)?;
        let interface = match command.local_addr().map_err(failed)? {
            SocketAddr::V4(local) => *local.ip(),
            SocketAddr::V6(_) => Ipv4Addr::UNSPECIFIED,
        };
        let (name, waiting) = (format!("NatNet {address}"), format!("asking {address}"));
        Ok(Self(ThreadedCapture::start(name, clock, waiting, move |inflow| {
            NatNetConnection {
                command,
                data: None,
                interface,
                address,
                server: None,
                names: BTreeMap::new(),
                newest_frame: None,
            }
            .run(&inflow);
        })))
    }
}

impl MotionCapture for NatNetClient {
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

struct NatNetConnection {
    command: UdpSocket,
    /// Where frames come, if the server sends them to a group.
    data: Option<UdpSocket>,
    interface: Ipv4Addr,
    address: String,
    server: Option<NatNetServerInfo>,
    names: BTreeMap<i32, String>,
    newest_frame: Option<i32>,
}

impl NatNetConnection {
    fn run(&mut self, inflow: &PoseQueue) {
        let mut bytes = vec![0; MAX_PACKET_BYTES + 1];
        let mut last_request: Option<Instant> = None;
        let mut kept = Instant::now();
        let (mut framed, mut needs_names) = (Instant::now(), true);
        while !inflow.is_closed() {
            if self.server.is_some() && framed.elapsed() > FRAME_TIMEOUT {
                (self.server, self.data, self.newest_frame) = (None, None, None);
                needs_names = true;
                inflow.set_waiting(format!(
                    "{}: no frame for {} s; is the server in Live mode or playing, and is Broadcast Frame Data on?",
                    self.address,
                    FRAME_TIMEOUT.as_secs()
                ));
            }
            if (self.server.is_none() || needs_names)
                && last_request.is_none_or(|at| at.elapsed() >= REQUEST_INTERVAL)
            {
                last_request = Some(Instant::now());
                match self.server {
                    None => self.send(&connect_packet(), inflow),
                    Some(_) => self.send(&packet(REQUEST_DEFINITIONS, &[]), inflow),
                }
            }
            if self.server.is_some() && kept.elapsed() >= KEEP_ALIVE_INTERVAL {
                kept = Instant::now();
                self.send(&packet(KEEP_ALIVE, &[]), inflow);
            }
            // The socket on which frames come is waited for, the other is looked at.
            for from_group in [true, false] {
                let (socket, waits) = match (from_group, &self.data) {
                    (true, Some(data)) => (data, true),
                    (true, None) => continue,
                    (false, data) => (&self.command, data.is_none()),
                };
                let message = match receive(socket, waits, &mut bytes) {
                    Ok(None) => continue,
                    Ok(Some(count)) => parse(&bytes[..count]),
                    Err(error) => {
                        // Nobody listens at that port (yet).
                        inflow.set_waiting(format!(
                            "{}: {error}; is streaming switched on there?",
                            self.address
                        ));
                        std::thread::sleep(POLL_INTERVAL);
                        continue;
                    }
                };
                match message {
                    Ok(NatNetMessage::Server(info)) if self.server.is_none() => {
                        framed = Instant::now();
                        self.handle_server_info(info, inflow);
                        break;
                    }
                    Ok(NatNetMessage::Definitions(definitions)) => {
                        self.names = definitions.into_iter().map(|body| (body.id, body.name)).collect();
                        needs_names = false;
                    }
                    Ok(NatNetMessage::Frame(frame)) if self.server.is_some() => {
                        framed = Instant::now();
                        needs_names |= frame.definitions_changed;
                        needs_names |= frame.bodies.iter().any(|body| !self.names.contains_key(&body.id));
                        self.handle_frame(frame, inflow);
                    }
                    Ok(_) => {}
                    Err(_) => inflow.count_malformed(),
                }
            }
        }
    }

    /// What cannot be sent is told; it is sent again by and by.
    fn send(&self, bytes: &[u8], inflow: &PoseQueue) {
        if let Err(error) = self.command.send(bytes) {
            inflow.set_waiting(format!("{}: {error}; is streaming switched on there?", self.address));
        }
    }

    /// A server has answered: where do its frames come, and of which version.
    fn handle_server_info(&mut self, info: NatNetServerInfo, inflow: &PoseQueue) {
        if info.protocol_version[..2] != VERSION[..2] {
            self.send(&packet(REQUEST, b"Bitstream,3.1\0"), inflow);
        }
        if let Some(group) = info.multicast_group {
            match join_multicast_group(Ipv4Addr::from(group), info.data_port, self.interface) {
                Ok(data) => self.data = Some(data),
                Err(error) => {
                    inflow.set_waiting(format!(
                        "{}: cannot listen to group {} at UDP {}: {error}; switch the server to unicast",
                        self.address,
                        Ipv4Addr::from(group),
                        info.data_port
                    ));
                    return;
                }
            }
        }
        self.send(&packet(KEEP_ALIVE, &[]), inflow);
        inflow.set_status(CaptureStatus::Connected);
        self.server = Some(info);
    }

    fn handle_frame(&mut self, frame: NatNetFrame, inflow: &PoseQueue) {
        let behind = self.newest_frame.map_or(0, |newest| newest.wrapping_sub(frame.number));
        if (1..=MAX_REORDERED_FRAMES).contains(&behind) {
            return;
        }
        self.newest_frame = Some(frame.number);
        let arrival = inflow.clock.now();
        for body in frame.bodies {
            // Until its name has come a body is nobody.
            let Some(name) = self.names.get(&body.id) else { continue };
            inflow.push(RawBodyPose {
                body: name.clone(),
                id: Some(body.id),
                // Far times saturate: a time that is none is found by who checks the stream.
                stamp: (frame.timestamp_secs * 1e9) as i64,
                arrival,
                position: body.position.map(f64::from),
                quaternion: body.quaternion.map(f64::from),
                tracked: body.tracked,
            });
        }
    }
}

/// Length of the next datagram; none if none came.
fn receive(socket: &UdpSocket, waits: bool, bytes: &mut [u8]) -> std::io::Result<Option<usize>> {
    socket.set_nonblocking(!waits)?;
    if waits {
        socket.set_read_timeout(Some(POLL_INTERVAL))?;
    }
    match socket.recv(bytes) {
        Ok(count) => Ok(Some(count)),
        Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => Ok(None),
        Err(error) => Err(error),
    }
}

/// A socket in the group. Its port is shared: other programs on this machine may listen, too.
fn join_multicast_group(group: Ipv4Addr, port: u16, interface: Ipv4Addr) -> std::io::Result<UdpSocket> {
    let port = if port == 0 { NATNET_DATA_PORT } else { port };
    let group = if group.is_multicast() { group } else { Ipv4Addr::from(NATNET_GROUP) };
    let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
    socket.set_reuse_address(true)?;
    // Bound to the group, not to any address: other groups at this port are none of ours.
    socket.bind(&SocketAddrV4::new(group, port).into())?;
    socket.join_multicast_v4(&group, &interface)?;
    Ok(socket.into())
}
