//! Calls over real sockets, and callers that dawdle, crowd or lie.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)]

use std::{
    io::{Read, Write},
    net::{SocketAddr, TcpListener, TcpStream},
    time::{Duration, Instant},
};
use xml_rpc::{Client, Fault, Server, Url, Value};

/// A server that adds, and where it is.
fn start() -> SocketAddr {
    let mut server = Server::default();
    server.register_value("add", |arguments| match arguments[..] {
        [Value::Int(a), Value::Int(b)] => Ok(vec![Value::Int(a + b)]),
        _ => Err(Fault::new(7, "expected <two> numbers & no more")),
    });
    let bound = server.bind(&"127.0.0.1:0".parse().unwrap()).unwrap();
    let address = bound.local_addr();
    std::thread::spawn(move || bound.run());
    address
}

fn url(address: SocketAddr) -> Url {
    format!("http://{address}/RPC2").parse().unwrap()
}

#[test]
fn a_call_is_answered_by_types_by_a_fault_or_as_missing() {
    let address = url(start());
    let mut client = Client::new().unwrap();
    assert_eq!(client.call::<_, i32>(&address, "add", (40, 2)).unwrap(), Ok(42));
    let fault = client.call::<_, i32>(&address, "add", ("one", 2)).unwrap().unwrap_err();
    assert_eq!((fault.code, fault.message.as_str()), (7, "expected <two> numbers & no more"));
    assert_eq!(client.call::<_, i32>(&address, "subtract", (1, 2)).unwrap().unwrap_err().code, 404);
    let wrong = client.call::<_, Vec<String>>(&address, "add", (1, 2)).unwrap_err();
    assert!(wrong.to_string().contains("expected a sequence"), "{wrong}");
}

/// All that comes back for these bytes.
fn ask(address: SocketAddr, bytes: &[u8]) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    // The server may hang up before it has read all.
    let _ = stream.write_all(bytes);
    let _ = stream.shutdown(std::net::Shutdown::Write);
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer);
    String::from_utf8_lossy(&answer).into_owned()
}

#[test]
fn what_is_no_call_or_too_long_is_refused() {
    let address = start();
    let long_head = format!("POST / HTTP/1.1\r\nX: {}", "x".repeat(100_000));
    for request in [
        "GET / HTTP/1.1\r\nContent-Length: 0\r\n\r\n",
        "POST / HTTP/1.1\r\n\r\n",
        "POST / HTTP/1.1\r\nContent-Length: 99999999999\r\n\r\n",
        "POST / HTTP/1.1\r\nContent-Length: -1\r\n\r\n",
        "POST / HTTP/1.1\r\nContent-Length: 1\r\nContent-Length: 2\r\n\r\nab",
        "POST / HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
        "POST / HTTP/1.1\r\nContent-Length: 8\r\n\r\nnonsense",
        "POST / HTTP/1.1\r\nContent-Length: 80\r\n\r\ncut off",
        "\x16\x03\x01",
        "",
        &long_head,
    ] {
        let answer = ask(address, request.as_bytes());
        assert!(answer.is_empty() || answer.starts_with("HTTP/1.1 400"), "{request:.60}: {answer}");
    }
    assert_eq!(Client::new().unwrap().call::<_, i32>(&url(address), "add", (1, 2)).unwrap(), Ok(3));
}

#[test]
fn callers_that_dawdle_keep_nobody_waiting_and_a_crowd_is_bounded() {
    let address = start();
    let idle: Vec<TcpStream> = (0..60).map(|_| TcpStream::connect(address).unwrap()).collect();
    assert_eq!(Client::new().unwrap().call::<_, i32>(&url(address), "add", (1, 2)).unwrap(), Ok(3));
    // Beyond the bound they are hung up on at once, and not after the time that a call may take.
    let begin = Instant::now();
    let mut more: Vec<TcpStream> = (0..60).map(|_| TcpStream::connect(address).unwrap()).collect();
    let last = more.last_mut().unwrap();
    last.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    assert_eq!(last.read(&mut [0]).unwrap(), 0);
    assert!(begin.elapsed() < Duration::from_secs(5));
    drop((idle, more));
}

#[test]
fn an_answer_without_a_length_goes_on_to_the_end_of_the_connection() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let peer = std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        let mut request = [0; 4096];
        let count = stream.read(&mut request).unwrap();
        let body = "<methodResponse><params><param><value>plain</value></param></params></methodResponse>";
        write!(stream, "HTTP/1.0 200 OK\r\nServer: old\r\n\r\n{body}").unwrap();
        String::from_utf8_lossy(&request[..count]).into_owned()
    });
    let answer = xml_rpc::call_value(&url(address), "getPid", vec![]).unwrap();
    assert_eq!(answer, Ok(vec![Value::String("plain".to_owned())]));
    assert!(peer.join().unwrap().starts_with("POST /RPC2 HTTP/1.0\r\n"));
}

#[test]
fn an_address_is_checked() {
    for good in ["http://localhost:11311", "http://localhost:11311/", "http://[::1]:11311/x", "http://lab"] {
        assert_eq!(good.parse::<Url>().unwrap().to_string(), good);
    }
    for bad in [
        "",
        "localhost:11311",
        "https://lab/",
        "http://",
        "http://lab:port/",
        "http://a b/",
        "http://lab:1\r\nX:/",
    ] {
        assert!(bad.parse::<Url>().unwrap_err().to_string().contains("http://host:11311/"), "{bad}");
    }
}
