//! Motion capture over real sockets, against servers of ours and against the byte vectors of the protocols.

#![allow(clippy::disallowed_methods, clippy::unwrap_used)]

use proact_devices::motion_capture::{
    CaptureStatus, HostClock, MotionCapture,
    natnet::{NatNetClient, NatNetFrame, NatNetMessage, NatNetOptions, NatNetRigidBody, NatNetServer, parse},
    vrpn::{VrpnClient, VrpnEvent, VrpnParser, VrpnServer, cookie},
};
use proact_localization::RawBodyPose;
use std::time::{Duration, Instant};

/// Sockets of one machine answer within milliseconds; a loaded one may take its time.
const TIMEOUT: Duration = Duration::from_secs(20);

fn pose(body: &str, stamp_ms: i64, x: f64) -> RawBodyPose {
    RawBodyPose {
        body: body.to_owned(),
        id: None,
        stamp: stamp_ms * 1_000_000,
        arrival: 0,
        position: [x, 0.2, 1.4],
        quaternion: [0.0, 0.0, 0.6, 0.8],
        tracked: true,
    }
}

/// Calls `send` until `done` agrees with everything that came, and how the source stands.
fn until(
    capture: &mut dyn MotionCapture,
    mut send: impl FnMut(),
    done: impl Fn(&[RawBodyPose], &CaptureStatus) -> bool,
) -> Vec<RawBodyPose> {
    let (mut poses, start) = (Vec::new(), Instant::now());
    loop {
        send();
        let link = capture.drain_poses(&mut poses).unwrap();
        if done(&poses, &link) {
            return poses;
        }
        assert!(start.elapsed() < TIMEOUT, "{link:?}, {} poses", poses.len());
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn waits_for(part: &str) -> impl Fn(&[RawBodyPose], &CaptureStatus) -> bool {
    move |_, link| matches!(link, CaptureStatus::Waiting { reason } if reason.contains(part))
}

#[test]
fn a_vrpn_client_gets_poses_as_sent_and_a_lost_server_back() {
    let mut server = VrpnServer::bind("127.0.0.1:0", &["Shoulderpad", "Head"]).unwrap();
    let address = server.address().unwrap();
    let mut client = VrpnClient::open(&address.to_string(), HostClock::start()).unwrap();
    let mut number = 0;
    let mut send = |server: &mut VrpnServer| {
        number += 1;
        server.send(&[
            pose("Shoulderpad", number, 0.5),
            pose("Head", number, 0.1),
            pose("Nobody", number, 0.0),
        ]);
    };
    let poses = until(&mut client, || send(&mut server), |poses, _| poses.len() >= 20);
    assert!(poses.iter().all(|pose| pose.body != "Nobody"));
    let first = poses.iter().find(|pose| pose.body == "Shoulderpad").unwrap();
    assert_eq!(
        (first.position, first.quaternion, first.id),
        ([0.5, 0.2, 1.4], [0.0, 0.0, 0.6, 0.8], Some(0))
    );
    let stamps: Vec<i64> = poses.iter().filter(|p| p.body == "Head").map(|p| p.stamp).collect();
    assert!(stamps.windows(2).all(|pair| pair[1] - pair[0] == 1_000_000), "{stamps:?}");
    assert!(poses.is_sorted_by_key(|pose| pose.arrival) && first.arrival > 0);

    server.disconnect();
    until(&mut client, || (), waits_for("closed the connection"));
    until(&mut client, || send(&mut server), |poses, _| poses.len() >= 4);
}

#[test]
fn a_vrpn_server_that_sends_rubbish_is_left_and_taken_again() {
    let mut server = VrpnServer::bind("127.0.0.1:0", &["pad"]).unwrap();
    let mut client = VrpnClient::open(&server.address().unwrap().to_string(), HostClock::start()).unwrap();
    until(&mut client, || server.send(&[pose("pad", 1, 0.0)]), |poses, _| !poses.is_empty());
    server.send_bytes(&[0xff; 48]);
    until(&mut client, || (), waits_for("a message of 4294967295 bytes"));
    assert_eq!(client.malformed(), 1);
    until(&mut client, || server.send(&[pose("pad", 2, 0.0)]), |poses, _| !poses.is_empty());
}

#[test]
fn a_server_that_is_not_there_is_waited_for_and_said() {
    let free = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let mut client = VrpnClient::open(&free.to_string(), HostClock::start()).unwrap();
    until(&mut client, || (), waits_for("is VRPN streaming switched on there?"));
    let mut server = VrpnServer::bind(&free.to_string(), &["pad"]).unwrap();
    until(&mut client, || server.send(&[pose("pad", 1, 0.0)]), |poses, _| !poses.is_empty());
}

fn frame(number: i32) -> NatNetFrame {
    let body = |id: i32, tracked| NatNetRigidBody {
        id,
        position: [0.25, 1.5, -0.125],
        quaternion: [0.0, 0.0, 0.0, 1.0],
        error: 0.0003,
        tracked,
    };
    NatNetFrame {
        number,
        bodies: vec![body(7, true), body(8, false)],
        timestamp_secs: f64::from(number) * 0.01,
        definitions_changed: false,
    }
}

fn natnet(data_port: Option<u16>) {
    let mut server = NatNetServer::bind(&[(7, "Shoulderpad"), (8, "Head")], data_port).unwrap();
    let address = server.address().unwrap().to_string();
    let mut client = NatNetClient::open(&address, NatNetOptions::default(), HostClock::start()).unwrap();
    let mut number = 0;
    let mut send = |server: &mut NatNetServer| {
        number += 1;
        server.send(&frame(number));
    };
    let poses = until(&mut client, || send(&mut server), |poses, _| poses.len() >= 20);
    let first = poses.iter().find(|pose| pose.body == "Shoulderpad").unwrap();
    assert_eq!((first.position, first.id, first.tracked), ([0.25, 1.5, -0.125], Some(7), true));
    assert!(poses.iter().any(|pose| pose.body == "Head" && !pose.tracked));

    // Truncated, oversized and senseless datagrams are counted and left out.
    let whole = [7_u8, 0, 200, 0, 1, 2, 3];
    for bytes in [&whole[..], &[7, 0, 4, 0, 1, 0, 0, 0], &[], &[9], &vec![7; 60_000]] {
        server.send_bytes(bytes);
    }
    // Sixty thousand bytes that begin with 7, 7 claim a payload of 1799 and are no known packet.
    until(&mut client, || send(&mut server), |poses, _| poses.len() >= 4);
    assert!(client.malformed() >= 4, "{}", client.malformed());

    // A body that gets another name is known by that.
    server.set_bodies(&[(7, "ShoulderpadL"), (8, "Head")]);
    until(&mut client, || send(&mut server), |poses, _| poses.iter().any(|pose| pose.body == "ShoulderpadL"));
    // A server that falls silent is told, and greeted anew.
    until(&mut client, || (), waits_for("no frame for 2 s"));
    until(&mut client, || send(&mut server), |poses, _| poses.len() >= 4);
}

#[test]
fn a_natnet_client_asks_for_3_1_and_gets_poses_by_unicast() {
    natnet(None);
}

#[test]
fn a_natnet_client_listens_to_the_group_that_the_server_names() {
    // A free port for the group.
    let port = std::net::UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    natnet(Some(port));
}

/// The byte vectors, where they are.
fn vectors(protocol: &str) -> Option<Vec<(String, Vec<u8>)>> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data/mocap_vectors.json");
    let Ok(text) = std::fs::read_to_string(path) else {
        eprintln!("skipped: ../shared/data/mocap_vectors.json is not there");
        return None;
    };
    let all: serde_json::Value = serde_json::from_str(&text).unwrap();
    let bytes = |hex: &str| {
        (0..hex.len() / 2).map(|k| u8::from_str_radix(&hex[2 * k..2 * k + 2], 16).unwrap()).collect()
    };
    let list = all[protocol]["vectors"].as_array().unwrap();
    Some(
        list.iter()
            .map(|v| (v["name"].as_str().unwrap().to_owned(), bytes(v["hex"].as_str().unwrap())))
            .collect(),
    )
}

fn vector<'a>(all: &'a [(String, Vec<u8>)], name: &str) -> &'a [u8] {
    &all.iter().find(|(known, _)| known == name).unwrap().1
}

#[test]
fn the_byte_vectors_of_vrpn_are_understood() {
    let Some(all) = vectors("vrpn") else { return };
    assert_eq!(vector(&all, "cookie_tcp_no_logging"), cookie());
    let mut parser = VrpnParser::new();
    for (name, bytes) in &all {
        if name != "udp_connect_request" {
            parser.push(bytes);
        }
    }
    let events: Vec<VrpnEvent> = std::iter::from_fn(|| parser.next_event().unwrap()).collect();
    let [
        VrpnEvent::CookieReceived,
        VrpnEvent::Device(device),
        VrpnEvent::Pose(pose),
        VrpnEvent::Ping { .. },
        VrpnEvent::Pong,
    ] = &events[..]
    else {
        panic!("{events:?}")
    };
    assert_eq!(device, "hand");
    assert_eq!((pose.body.as_str(), pose.secs, pose.micros), ("hand", 1, 2));
    assert_eq!((pose.position, pose.quaternion), ([0.5, -0.25, 1.0], [0.0, 0.0, 0.0, 1.0]));
}

#[test]
fn the_byte_vectors_of_natnet_are_understood() {
    let Some(all) = vectors("natnet") else { return };
    let Ok(NatNetMessage::Frame(frame)) = parse(vector(&all, "frame_3_1")) else { panic!("frame") };
    assert_eq!((frame.number, frame.timestamp_secs, frame.definitions_changed), (42, 12.5, false));
    let [first, second] = &frame.bodies[..] else { panic!("{frame:?}") };
    assert_eq!((first.id, first.position, first.error, first.tracked), (7, [0.1, 0.2, 0.3], 0.0005, true));
    assert_eq!((second.id, second.position, second.tracked), (8, [-1.0, 1.25, 0.5], false));
    assert!((second.quaternion[1] - 0.707_106_77).abs() < 1e-6);
    // A frame of another version is never taken for one of 3.1.
    assert!(parse(vector(&all, "frame_4_1")).is_err());
    let Ok(NatNetMessage::Server(info)) = parse(vector(&all, "server_info_v3")) else { panic!("info") };
    assert_eq!(
        (info.program.as_str(), info.data_port, info.multicast_group),
        ("Motive", 1511, Some([239, 255, 42, 99]))
    );

    // What our client says, byte by byte.
    let spy = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    spy.set_read_timeout(Some(TIMEOUT)).unwrap();
    let address = spy.local_addr().unwrap().to_string();
    let _client = NatNetClient::open(&address, NatNetOptions::default(), HostClock::start()).unwrap();
    let mut bytes = [0; 1024];
    let (count, from) = spy.recv_from(&mut bytes).unwrap();
    assert_eq!(&bytes[..count], vector(&all, "connect_v3"));
    // A server of 2.2 that sends to a group is asked for 3.1, for names, and kept alive.
    spy.send_to(vector(&all, "server_info_v3"), from).unwrap();
    let mut requests = Vec::new();
    while requests.len() < 3 {
        let count = spy.recv(&mut bytes).unwrap();
        requests.push(bytes[..count].to_vec());
    }
    requests.retain(|packet| packet != vector(&all, "connect_v3"));
    assert!(requests.iter().any(|packet| packet == vector(&all, "keepalive")), "{requests:?}");
    assert!(requests.iter().any(|packet| packet == vector(&all, "request_model_def")), "{requests:?}");
}
