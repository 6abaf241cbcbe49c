//! A client that keeps asking.

use super::{
    NATNET_COMMAND_PORT, NATNET_DATA_PORT, NATNET_GROUP, NatNetFrame, NatNetMessage, ServerInfo,
    packet::{KEEP_ALIVE, MOST, REQUEST, REQUEST_DEFINITIONS, VERSION, connect_packet, packet, parse},
};
use crate::{
    DeviceError,
    motion_capture::{CaptureLink, HostClock, MotionCapture, inflow::Inflow, inflow::ThreadedCapture},
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
const GLANCE: Duration = Duration::from_millis(20);
/// From greeting to greeting, and from request to request.
const ASK_EVERY: Duration = Duration::from_millis(300);
/// What keeps a unicast stream up.
const KEEP_ALIVE_EVERY: Duration = Duration::from_secs(1);
/// A server that sends no frame for so long is greeted anew: it may have been started again.
const MOST_SILENCE: Duration = Duration::from_secs(2);
/// A frame that is older than the newest by up to so many was overtaken; by more, the numbering began anew.
const OVERTAKEN: i32 = 100;

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
        let mut places = address.to_socket_addrs().map_err(failed)?;
        let server =
            places.find(SocketAddr::is_ipv4).ok_or_else(|| failed(ErrorKind::AddrNotAvailable.into()))?;
        let command =
            UdpSocket::bind((options.interface.unwrap_or(Ipv4Addr::UNSPECIFIED), 0)).map_err(failed)?;
        command.connect(server).map_err(failed)?;
        let interface = match command.local_addr().map_err(failed)? {
            SocketAddr::V4(local) => *local.ip(),
            SocketAddr::V6(_) => Ipv4Addr::UNSPECIFIED,
        };
        let (name, waiting) = (format!("NatNet {address}"), format!("asking {address}"));
        Ok(Self(ThreadedCapture::start(name, clock, waiting, move |inflow| {
            Session {
                command,
                data: None,
                interface,
                address,
                server: None,
                names: BTreeMap::new(),
                newest: None,
            }
            .run(&inflow);
        })))
    }
}

impl MotionCapture for NatNetClient {
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

struct Session {
    command: UdpSocket,
    /// Where frames come, if the server sends them to a group.
    data: Option<UdpSocket>,
    interface: Ipv4Addr,
    address: String,
    server: Option<ServerInfo>,
    names: BTreeMap<i32, String>,
    newest: Option<i32>,
}

impl Session {
    fn run(&mut self, inflow: &Inflow) {
        let mut bytes = vec![0; MOST + 1];
        let mut asked: Option<Instant> = None;
        let mut kept = Instant::now();
        let (mut framed, mut needs_names) = (Instant::now(), true);
        while !inflow.is_over() {
            if self.server.is_some() && framed.elapsed() > MOST_SILENCE {
                (self.server, self.data, self.newest) = (None, None, None);
                needs_names = true;
                inflow.wait(format!(
                    "{}: no frame for {} s; is the server in Live mode or playing, and is Broadcast Frame Data on?",
                    self.address,
                    MOST_SILENCE.as_secs()
                ));
            }
            if (self.server.is_none() || needs_names) && asked.is_none_or(|at| at.elapsed() >= ASK_EVERY) {
                asked = Some(Instant::now());
                match self.server {
                    None => self.say(&connect_packet(), inflow),
                    Some(_) => self.say(&packet(REQUEST_DEFINITIONS, &[]), inflow),
                }
            }
            if self.server.is_some() && kept.elapsed() >= KEEP_ALIVE_EVERY {
                kept = Instant::now();
                self.say(&packet(KEEP_ALIVE, &[]), inflow);
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
                        inflow.wait(format!("{}: {error}; is streaming switched on there?", self.address));
                        std::thread::sleep(GLANCE);
                        continue;
                    }
                };
                match message {
                    Ok(NatNetMessage::Server(info)) if self.server.is_none() => {
                        framed = Instant::now();
                        self.meet(info, inflow);
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
                        self.take(frame, inflow);
                    }
                    Ok(_) => {}
                    Err(_) => inflow.malformed(),
                }
            }
        }
    }

    /// What cannot be sent is told; it is sent again by and by.
    fn say(&self, bytes: &[u8], inflow: &Inflow) {
        if let Err(error) = self.command.send(bytes) {
            inflow.wait(format!("{}: {error}; is streaming switched on there?", self.address));
        }
    }

    /// A server has answered: where do its frames come, and of which version.
    fn meet(&mut self, info: ServerInfo, inflow: &Inflow) {
        if info.protocol_version[..2] != VERSION[..2] {
            self.say(&packet(REQUEST, b"Bitstream,3.1\0"), inflow);
        }
        if let Some(group) = info.group {
            match listen(Ipv4Addr::from(group), info.data_port, self.interface) {
                Ok(data) => self.data = Some(data),
                Err(error) => {
                    inflow.wait(format!(
                        "{}: cannot listen to group {} at UDP {}: {error}; switch the server to unicast",
                        self.address,
                        Ipv4Addr::from(group),
                        info.data_port
                    ));
                    return;
                }
            }
        }
        self.say(&packet(KEEP_ALIVE, &[]), inflow);
        inflow.link(CaptureLink::Connected);
        self.server = Some(info);
    }

    fn take(&mut self, frame: NatNetFrame, inflow: &Inflow) {
        let behind = self.newest.map_or(0, |newest| newest.wrapping_sub(frame.number));
        if (1..=OVERTAKEN).contains(&behind) {
            return;
        }
        self.newest = Some(frame.number);
        let arrival = inflow.clock.now();
        for body in frame.bodies {
            // Until its name has come a body is nobody.
            let Some(name) = self.names.get(&body.id) else { continue };
            inflow.push(RawBodyPose {
                body: name.clone(),
                id: Some(body.id),
                // Far times saturate: a time that is none is found by who checks the stream.
                stamp: (frame.seconds * 1e9) as i64,
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
        socket.set_read_timeout(Some(GLANCE))?;
    }
    match socket.recv(bytes) {
        Ok(count) => Ok(Some(count)),
        Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => Ok(None),
        Err(error) => Err(error),
    }
}

/// A socket in the group. Its port is shared: other programs on this machine may listen, too.
fn listen(group: Ipv4Addr, port: u16, interface: Ipv4Addr) -> std::io::Result<UdpSocket> {
    let port = if port == 0 { NATNET_DATA_PORT } else { port };
    let group = if group.is_multicast() { group } else { Ipv4Addr::from(NATNET_GROUP) };
    let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
    socket.set_reuse_address(true)?;
    // Bound to the group, not to any address: other groups at this port are none of ours.
    socket.bind(&SocketAddrV4::new(group, port).into())?;
    socket.join_multicast_v4(&group, &interface)?;
    Ok(socket.into())
}
