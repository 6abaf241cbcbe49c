//! Values as XML and back.

use crate::{
    error::{Error, Result},
    value::{Fault, Params, Response, Value},
};
use base64::{Engine, engine::general_purpose::STANDARD as BASE64};
use roxmltree::{Document, Node, ParsingOptions};
use std::{collections::HashMap, fmt::Write};

/// How deep values may lie in one another. A parameter server's trees have a few levels.
const MAX_DEPTH: usize = 64;
/// Most elements and texts of a message. The state of a graph of a thousand topics has some ten thousand.
const MAX_NODES: u32 = 1_000_000;
/// Numbers as Python's and C++'s masters write them in a fault.
const FAULT_CODE: &str = "faultCode";
const FAULT_STRING: &str = "faultString";

fn invalid_message(what: impl Into<String>) -> Error {
    Error::Message { what: what.into() }
}

/// Reads a call: its name and its arguments.
///
/// # Errors
/// [`Error::Message`].
pub fn read_call(text: &str) -> Result<(String, Params)> {
    let document = parse(text)?;
    let root = expect_element(document.root_element(), "methodCall")?;
    let name = element_text(child(root, "methodName")?);
    let params = root.children().find(|node| node.has_tag_name("params"));
    Ok((name.trim().to_owned(), params.map_or(Ok(Params::new()), read_params)?))
}

/// Reads what a call answers.
///
/// # Errors
/// [`Error::Message`].
pub fn read_response(text: &str) -> Result<Response> {
    let document = parse(text)?;
    let root = expect_element(document.root_element(), "methodResponse")?;
    let Some(fault) = root.children().find(|node| node.has_tag_name("fault")) else {
        return read_params(child(root, "params")?).map(Ok);
    };
    match read_value(child(fault, "value")?, MAX_DEPTH)? {
        Value::Struct(mut parts) => match (parts.remove(FAULT_CODE), parts.remove(FAULT_STRING)) {
            (Some(Value::Int(code)), Some(Value::String(message))) => Ok(Err(Fault { code, message })),
            _ => Err(invalid_message(format!("a fault without {FAULT_CODE} and {FAULT_STRING}"))),
        },
        other => Err(invalid_message(format!("a fault that is {other:?}, expected a struct"))),
    }
}

/// Writes a call.
pub fn write_call(name: &str, params: &[Value]) -> String {
    let mut text = String::from("<?xml version=\"1.0\"?><methodCall><methodName>");
    write_text(&mut text, name);
    text.push_str("</methodName>");
    write_params(&mut text, params);
    text + "</methodCall>"
}

/// Writes what a call answers.
pub fn write_response(response: &Response) -> String {
    let mut text = String::from("<?xml version=\"1.0\"?><methodResponse>");
    match response {
        Ok(params) => write_params(&mut text, params),
        Err(Fault { code, message }) => {
            let parts = [
                (FAULT_CODE.to_owned(), Value::Int(*code)),
                (FAULT_STRING.to_owned(), Value::String(message.clone())),
            ];
            text.push_str("<fault>");
            write_value(&mut text, &Value::Struct(HashMap::from(parts)));
            text.push_str("</fault>");
        }
    }
    text + "</methodResponse>"
}

fn parse(text: &str) -> Result<Document<'_>> {
    // Without a DTD there are no entities that multiply.
    let options = ParsingOptions { allow_dtd: false, nodes_limit: MAX_NODES, ..ParsingOptions::default() };
    Document::parse_with_options(text, options).map_err(|error| invalid_message(error.to_string()))
}

fn expect_element<'a, 'i>(node: Node<'a, 'i>, name: &str) -> Result<Node<'a, 'i>> {
    match node.has_tag_name(name) {
        true => Ok(node),
        false => Err(invalid_message(format!("<{}>, expected <{name}>", node.tag_name().name()))),
    }
}

fn child<'a, 'i>(node: Node<'a, 'i>, name: &str) -> Result<Node<'a, 'i>> {
    let found = node.children().find(|child| child.has_tag_name(name));
    found.ok_or_else(|| invalid_message(format!("<{}> without <{name}>", node.tag_name().name())))
}

/// The text of an element, which comments may interrupt.
fn element_text(node: Node<'_, '_>) -> String {
    node.children().filter(Node::is_text).filter_map(|part| part.text()).collect()
}

fn read_params(params: Node<'_, '_>) -> Result<Params> {
    let each = params.children().filter(|node| node.has_tag_name("param"));
    each.map(|param| read_value(child(param, "value")?, MAX_DEPTH)).collect()
}

fn read_value(value: Node<'_, '_>, depth: usize) -> Result<Value> {
    if depth == 0 {
        return Err(invalid_message(format!("values more than {MAX_DEPTH} deep in one another")));
    }
    let Some(typed) = value.children().find(Node::is_element) else {
        return Ok(Value::String(element_text(value)));
    };
    let kind = typed.tag_name().name();
    let text = || element_text(typed).trim().to_owned();
    let no = |text: &str| invalid_message(format!("{text:?} is no {kind}"));
    Ok(match kind {
        "i4" | "int" => Value::Int(text().parse().map_err(|_| no(&text()))?),
        "boolean" => match text().as_str() {
            "1" | "true" => Value::Bool(true),
            "0" | "false" => Value::Bool(false),
            other => return Err(no(other)),
        },
        "string" => Value::String(element_text(typed)),
        "double" => Value::Double(text().parse().map_err(|_| no(&text()))?),
        "dateTime.iso8601" => Value::DateTime(text()),
        "base64" => {
            let plain: String = element_text(typed).split_whitespace().collect();
            Value::Base64(BASE64.decode(&plain).map_err(|_| no(&plain))?)
        }
        "array" => {
            let data = child(typed, "data")?;
            let values = data.children().filter(|node| node.has_tag_name("value"));
            Value::Array(values.map(|value| read_value(value, depth - 1)).collect::<Result<_>>()?)
        }
        "struct" => {
            let members = typed.children().filter(|node| node.has_tag_name("member"));
            let member = |node| {
                Ok((element_text(child(node, "name")?), read_value(child(node, "value")?, depth - 1)?))
            };
            Value::Struct(members.map(member).collect::<Result<_>>()?)
        }
        other => return Err(invalid_message(format!("a value of type {other:?}"))),
    })
}

fn write_params(text: &mut String, params: &[Value]) {
    text.push_str("<params>");
    for param in params {
        text.push_str("<param>");
        write_value(text, param);
        text.push_str("</param>");
    }
    text.push_str("</params>");
}

fn write_value(text: &mut String, value: &Value) {
    text.push_str("<value>");
    // Writing to a text cannot fail.
    let _ = match value {
        Value::Int(n) => write!(text, "<i4>{n}</i4>"),
        Value::Bool(yes) => write!(text, "<boolean>{}</boolean>", u8::from(*yes)),
        Value::Double(x) => write!(text, "<double>{x}</double>"),
        Value::Base64(bytes) => write!(text, "<base64>{}</base64>", BASE64.encode(bytes)),
        Value::String(words) => {
            text.push_str("<string>");
            write_text(text, words);
            write!(text, "</string>")
        }
        Value::DateTime(time) => {
            text.push_str("<dateTime.iso8601>");
            write_text(text, time);
            write!(text, "</dateTime.iso8601>")
        }
        Value::Array(values) => {
            text.push_str("<array><data>");
            values.iter().for_each(|value| write_value(text, value));
            write!(text, "</data></array>")
        }
        Value::Struct(members) => {
            text.push_str("<struct>");
            for (name, value) in members {
                text.push_str("<member><name>");
                write_text(text, name);
                text.push_str("</name>");
                write_value(text, value);
                text.push_str("</member>");
            }
            write!(text, "</struct>")
        }
    };
    text.push_str("</value>");
}

fn write_text(text: &mut String, words: &str) {
    for letter in words.chars() {
        match letter {
            '&' => text.push_str("&amp;"),
            '<' => text.push_str("&lt;"),
            '>' => text.push_str("&gt;"),
            // A plain one would be read as a line feed.
            '\r' => text.push_str("&#13;"),
            '\t' | '\n' => text.push(letter),
            // XML has no way to say these.
            '\u{fffe}' | '\u{ffff}' => text.push('\u{fffd}'),
            letter if u32::from(letter) < 0x20 => text.push('\u{fffd}'),
            letter => text.push(letter),
        }
    }
}
