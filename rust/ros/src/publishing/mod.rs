//! Publishers whose subscribers cannot hold each other up.
//!
//! rosrust writes a topic's messages to its subscribers in turn and waits for each, so that one stopped subscriber stops the
//! topic for all. Here every subscriber has a bounded queue and a thread of its own. rosrust goes on to register topics with the
//! master; this module answers `requestTopic` in its place and sends the messages.

mod connection;
mod header;
mod publisher;
mod statistics;
mod topic_server;

pub(crate) use header::exchange as exchange_headers;
pub(crate) use publisher::{Publisher, PublishingSettings, join, start, topics};
pub(crate) use topic_server::TopicDescription;
