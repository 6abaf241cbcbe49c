//! A server: the double that the client is tested against.

use super::{
    NATNET_GROUP, NatNetFrame, NatNetServerInfo,
    packet::{
        CONNECT, KEEP_ALIVE, REQUEST, REQUEST_DEFINITIONS, RESPONSE, RigidBodyDefinition, definitions_packet,
        frame_packet, packet, server_info_packet,
    },
};
use crate::DeviceError;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};

/// Serves frames over UDP. Nothing runs by itself: requests are answered in [`NatNetServer::send_with_faults`]. Speaks 4.1 until it is
/// asked for 3.1, as Motive 3 does; before that it sends no frame.
#[derive(Debug)]
pub struct NatNetServer {
    socket: UdpSocket,
    bodies: Vec<RigidBodyDefinition>,
    /// Where frames go, if not to each client.
    group: Option<(Ipv4Addr, u16)>,
    clients: Vec<SocketAddr>,
    version_requested: bool,
    definitions_changed: bool,
}

impl NatNetServer {
    /// Listens on this machine at a free port, with rigid `bodies`; sends frames to a group at `data_port`, or to each client
    /// where there is none.
    ///
    /// # Errors
    /// [`DeviceError::Udp`].
    pub fn bind(bodies: &[(i32, &str)], data_port: Option<u16>) -> Result<Self, DeviceError> {
        let failed = |source| DeviceError::Udp { address: "127.0.0.1:0".to_owned(), source };
        let socket = UdpSocket::bind(("127.0.0.1", 0)).map_err(failed)?;
        socket.set_nonblocking(true).map_err(failed)?;
        let group = data_port.map(|port| (Ipv4Addr::from(NATNET_GROUP), port));
        if group.is_some() {
            let named = socket2::SockRef::from(&socket);
            named.set_multicast_if_v4(&Ipv4Addr::LOCALHOST).map_err(failed)?;
        }
        let mut server = Self {
            socket,
            bodies: Vec::new(),
            group,
            clients: Vec::new(),
            version_requested: false,
            definitions_changed: false,
        };
        server.set_bodies(bodies);
        server.definitions_changed = false;
        Ok(server)
    }

    /// Where commands go.
    ///
    /// # Errors
    /// The system does not say.
    pub fn address(&self) -> std::io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    /// Bodies are called otherwise from now on.
    pub fn set_bodies(&mut self, bodies: &[(i32, &str)]) {
        self.bodies =
            bodies.iter().map(|&(id, name)| RigidBodyDefinition { id, name: name.to_owned() }).collect();
        self.definitions_changed = true;
    }

    /// Answers what was asked, and sends a frame if anybody asked for 3.1.
    pub fn send(&mut self, frame: &NatNetFrame) {
        self.answer();
        if self.version_requested {
            let changed = std::mem::take(&mut self.definitions_changed);
            self.send_bytes(&frame_packet(&NatNetFrame { definitions_changed: changed, ..frame.clone() }));
        }
    }

    /// Sends these bytes, whatever they are.
    pub fn send_bytes(&self, bytes: &[u8]) {
        match self.group {
            Some(to) => drop(self.socket.send_to(bytes, to)),
            None => self.clients.iter().for_each(|to| drop(self.socket.send_to(bytes, to))),
        }
    }

    fn answer(&mut self) {
        let mut bytes = [0; 1024];
        while let Ok((count, from)) = self.socket.recv_from(&mut bytes) {
            let [low, high, ..] = bytes[..count] else { continue };
            let answer = match u16::from_le_bytes([low, high]) {
                CONNECT => server_info_packet(&NatNetServerInfo {
                    program: "Double".to_owned(),
                    program_version: [3, 1, 0, 0],
                    protocol_version: [4, 1, 0, 0],
                    data_port: self.group.map_or(0, |(_, port)| port),
                    multicast_group: self.group.map(|(group, _)| group.octets()),
                }),
                REQUEST if bytes[4..count].starts_with(b"Bitstream,3.1") => {
                    self.version_requested = true;
                    packet(RESPONSE, &0_i32.to_le_bytes())
                }
                REQUEST_DEFINITIONS => definitions_packet(&self.bodies),
                KEEP_ALIVE => {
                    if !self.clients.contains(&from) {
                        self.clients.push(from);
                    }
                    continue;
                }
                _ => continue,
            };
            let _ = self.socket.send_to(&answer, from);
        }
    }
}
