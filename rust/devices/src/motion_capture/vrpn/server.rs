//! A server: the double that the client is tested against, and a relay for what has no VRPN of its own.

use super::{
    VrpnEvent, VrpnParser,
    message::{PING, PONG, POS_QUAT, cookie, pose_payload, write_description, write_message},
};
use crate::DeviceError;
use proact_localization::RawBodyPose;
use std::{
    io::{ErrorKind, Read, Write},
    net::{SocketAddr, TcpListener, TcpStream},
};

/// Our numbers of the message types.
const POSE_TYPE_ID: i32 = 0;
const PING_TYPE_ID: i32 = 1;
const PONG_TYPE_ID: i32 = 2;

/// Serves trackers over TCP, to any number of clients. Nothing runs by itself: connections are taken and answered in
/// [`VrpnServer::send_with_faults`].
#[derive(Debug)]
pub struct VrpnServer {
    listener: TcpListener,
    devices: Vec<String>,
    clients: Vec<VrpnServerClient>,
}

#[derive(Debug)]
struct VrpnServerClient {
    stream: TcpStream,
    parser: VrpnParser,
}

impl VrpnServer {
    /// Listens at `address`, such as `127.0.0.1:0`, with trackers called `devices`.
    ///
    /// # Errors
    /// [`DeviceError::Tcp`] if the address is taken.
    pub fn bind(address: &str, devices: &[&str]) -> Result<Self, DeviceError> {
        let failed = |source| DeviceError::Tcp { address: address.to_owned(), source };
        let listener = TcpListener::bind(address).map_err(failed)?;
        listener.set_nonblocking(true).map_err(failed)?;
        Ok(Self {
            listener,
            devices: devices.iter().map(|&name| name.to_owned()).collect(),
            clients: Vec::new(),
        })
    }

    /// Where it listens.
    ///
    /// # Errors
    /// The system does not say.
    pub fn address(&self) -> std::io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Clients that are connected.
    pub fn clients(&self) -> usize {
        self.clients.len()
    }

    /// Takes who wants to connect, answers pings, and sends the poses of devices that there are: to the first device of
    /// that name, or where a pose has an id, to the device of this place.
    pub fn send(&mut self, poses: &[RawBodyPose]) {
        self.accept_clients();
        let mut bytes = Vec::new();
        for pose in poses.iter().filter(|pose| pose.tracked) {
            let named = self.devices.iter().position(|device| *device == pose.body);
            let numbered =
                pose.id.and_then(|id| usize::try_from(id).ok()).filter(|id| *id < self.devices.len());
            let Some(device) = numbered.or(named) else { continue };
            let stamp = ((pose.stamp / 1_000_000_000) as u32, (pose.stamp % 1_000_000_000 / 1000) as u32);
            let payload = pose_payload(0, pose.position, pose.quaternion);
            write_message(&mut bytes, stamp, device as i32, POSE_TYPE_ID, &payload);
        }
        self.send_bytes(&bytes);
    }

    /// Sends these bytes, whatever they are.
    pub fn send_bytes(&mut self, bytes: &[u8]) {
        self.clients
            .retain_mut(|client| client.answer_pings().is_ok() && client.stream.write_all(bytes).is_ok());
    }

    /// Ends all connections.
    pub fn disconnect(&mut self) {
        self.clients.clear();
    }

    fn accept_clients(&mut self) {
        while let Ok((stream, _)) = self.listener.accept() {
            let mut hello = cookie().to_vec();
            write_description(&mut hello, true, self.devices.len() as i32, "VRPN Control");
            for (number, device) in self.devices.iter().enumerate() {
                write_description(&mut hello, true, number as i32, device);
            }
            for (number, kind) in [(POSE_TYPE_ID, POS_QUAT), (PING_TYPE_ID, PING), (PONG_TYPE_ID, PONG)] {
                write_description(&mut hello, false, number, kind);
            }
            let mut client = VrpnServerClient { stream, parser: VrpnParser::new() };
            let ready =
                client.stream.set_nonblocking(false).is_ok() && client.stream.set_nodelay(true).is_ok();
            if ready && client.stream.write_all(&hello).is_ok() {
                self.clients.push(client);
            }
        }
    }
}

impl VrpnServerClient {
    /// Answers the pings that came.
    fn answer_pings(&mut self) -> std::io::Result<()> {
        let mut bytes = [0; 1024];
        self.stream.set_nonblocking(true)?;
        loop {
            match self.stream.read(&mut bytes) {
                Ok(0) => return Err(ErrorKind::ConnectionAborted.into()),
                Ok(count) => self.parser.push(&bytes[..count]),
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) => return Err(error),
            }
        }
        self.stream.set_nonblocking(false)?;
        let mut pongs = Vec::new();
        while let Some(event) =
            self.parser.next_event().map_err(|error| std::io::Error::new(ErrorKind::InvalidData, error))?
        {
            if matches!(event, VrpnEvent::Ping { .. }) {
                write_message(&mut pongs, (0, 0), 0, PONG_TYPE_ID, &[]);
            }
        }
        self.stream.write_all(&pongs)
    }
}
