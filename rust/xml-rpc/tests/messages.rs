//! Messages as Python's and C++'s nodes write them, round trips, and anything at all.
#![allow(clippy::unwrap_used)]

use proptest::prelude::*;
use std::collections::HashMap;
use xml_rpc::{
    Fault, Value, from_params, into_params,
    text::{read_call, read_response, write_call, write_response},
};

#[test]
fn the_words_of_other_implementations_are_understood() {
    // Python's xmlrpc.client, with line feeds and <int>.
    let python = "<?xml version='1.0'?>\n<methodCall>\n<methodName>publisherUpdate</methodName>\n<params>\n<param>\n\
        <value><string>/master</string></value>\n</param>\n<param>\n<value><array><data>\n<value><string>http://a:1/</string>\
        </value>\n</data></array></value>\n</param>\n</params>\n</methodCall>\n";
    let uris = Value::Array(vec![Value::String("http://a:1/".to_owned())]);
    let expected = ("publisherUpdate".to_owned(), vec![Value::String("/master".to_owned()), uris]);
    assert_eq!(read_call(python).unwrap(), expected);
    // roscpp's, where a value without a type is a text, and a method may have no params.
    let cpp = "<?xml version=\"1.0\"?>\r\n<methodCall><methodName>getPid</methodName>\r\n<params><param><value>/n &amp; m\
        </value></param><param><value/></param></params></methodCall>\r\n";
    let params = vec![Value::String("/n & m".to_owned()), Value::String(String::new())];
    assert_eq!(read_call(cpp).unwrap(), ("getPid".to_owned(), params));
    assert_eq!(read_call("<methodCall><methodName>a</methodName></methodCall>").unwrap().1, []);
    let fault = "<methodResponse><fault><value><struct><member><name>faultCode</name><value><int>1</int></value></member>\
        <member><name>faultString</name><value>no</value></member></struct></value></fault></methodResponse>";
    assert_eq!(read_response(fault).unwrap(), Err(Fault::new(1, "no")));
}

#[test]
fn bombs_and_depths_are_refused() {
    let entities = "<!DOCTYPE a [<!ENTITY b \"cc\"><!ENTITY d \"&b;&b;\">]><methodCall><methodName>&d;</methodName>\
        </methodCall>";
    assert!(read_call(entities).is_err());
    for depth in [63, 65, 5_000, 200_000] {
        let (open, close) = ("<value><array><data>".repeat(depth), "</data></array></value>".repeat(depth));
        let text = format!(
            "<methodCall><methodName>a</methodName><params><param>{open}{close}</param></params></methodCall>"
        );
        assert_eq!(read_call(&text).is_ok(), depth == 63, "{depth}");
    }
    let many = "<value/>".repeat(2_000_000);
    let text = format!(
        "<methodCall><methodName>a</methodName><params><param><value><array><data>{many}</data></array></value></param>\
         </params></methodCall>"
    );
    assert!(read_call(&text).is_err());
}

#[test]
fn values_become_types_as_parameters_of_ros_need_it() {
    let single = |value| vec![value];
    assert_eq!(from_params::<f64>(single(Value::Int(3))).unwrap(), 3.0);
    assert_eq!(from_params::<f64>(single(Value::String(" 2.5 ".to_owned()))).unwrap(), 2.5);
    assert!(from_params::<bool>(single(Value::String("true".to_owned()))).unwrap());
    assert_eq!(from_params::<Option<i32>>(single(Value::Array(vec![]))).unwrap(), None);
    assert_eq!(
        from_params::<(i32, String)>(vec![Value::Int(1), Value::String("a".into())]).unwrap(),
        (1, "a".into())
    );
    for wrong in [Value::Int(-1), Value::Int(300), Value::String("x".into()), Value::Array(vec![])] {
        assert!(from_params::<u8>(single(wrong.clone())).is_err(), "{wrong:?}");
    }
    assert_eq!(into_params(&("a", [["TCPROS"]])).unwrap().len(), 2);
    assert_eq!(into_params(&1.0).unwrap(), [Value::Double(1.0)]);
    assert!(into_params(&(1_i64 << 40)).unwrap_err().to_string().contains("32 bits"));
}

fn values() -> impl Strategy<Value = Value> {
    let leaf = prop_oneof![
        any::<i32>().prop_map(Value::Int),
        any::<bool>().prop_map(Value::Bool),
        "[ -~äß\t\n\r&<>]{0,12}".prop_map(Value::String),
        (-1e300..1e300_f64).prop_map(Value::Double),
        any::<Vec<u8>>().prop_map(Value::Base64),
    ];
    leaf.prop_recursive(4, 32, 6, |inner| {
        prop_oneof![
            prop::collection::vec(inner.clone(), 0..6).prop_map(Value::Array),
            prop::collection::hash_map("[a-z&<]{1,6}", inner, 0..6)
                .prop_map(|members: HashMap<String, Value>| Value::Struct(members)),
        ]
    })
}

proptest! {
    #[test]
    fn what_is_written_is_read_again(params in prop::collection::vec(values(), 0..4), name in "[a-zA-Z]{1,12}") {
        prop_assert_eq!(read_call(&write_call(&name, &params)).unwrap(), (name, params.clone()));
        prop_assert_eq!(read_response(&write_response(&Ok(params.clone()))).unwrap(), Ok(params));
    }

    #[test]
    fn anything_at_all_is_survived(bytes in any::<Vec<u8>>()) {
        let text = String::from_utf8_lossy(&bytes);
        let _ = (read_call(&text), read_response(&text));
    }

    #[test]
    fn a_message_that_was_tampered_with_is_survived(
        params in prop::collection::vec(values(), 0..4),
        at in any::<prop::sample::Index>(),
        with in "[<>/a-z&;!\\[\\]]{0,8}",
    ) {
        let mut text = write_call("a", &params);
        let mut at = at.index(text.len());
        while !text.is_char_boundary(at) { at -= 1; }
        text.insert_str(at, &with);
        if let Ok((_, params)) = read_call(&text) {
            let _ = from_params::<(i32, String, Vec<String>)>(params);
        }
    }
}
