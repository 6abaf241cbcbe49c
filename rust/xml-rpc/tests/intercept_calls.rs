//! A handler that is asked before those of the servers: one for the process, so it has a test program of its own.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)]

use xml_rpc::{Client, Server, Value, intercept_calls};

#[test]
fn it_answers_what_it_wants_and_leaves_the_rest() {
    let mut server = Server::default();
    server.register_value("name", |_| Ok(vec![Value::String("server".to_owned())]));
    server.register_value("length", |arguments| Ok(vec![Value::Int(arguments.len() as i32)]));
    let bound = server.bind(&"127.0.0.1:0".parse().unwrap()).unwrap();
    let address = format!("http://{}/", bound.local_addr()).parse().unwrap();
    std::thread::spawn(move || bound.run());
    let mut client = Client::new().unwrap();
    let mut name = || client.call::<_, String>(&address, "name", (1,)).unwrap().unwrap();
    assert_eq!(name(), "server");
    let handler = |method: &str, arguments: &Vec<Value>| {
        (method == "name").then(|| Ok(vec![Value::String(format!("first of {}", arguments.len()))]))
    };
    assert!(intercept_calls(handler));
    assert_eq!(name(), "first of 1");
    assert!(!intercept_calls(|_, _| Some(Ok(vec![]))), "the first one stays");
    assert_eq!(name(), "first of 1");
    assert_eq!(client.call::<_, i32>(&address, "length", (1, 2)).unwrap(), Ok(2));
}
