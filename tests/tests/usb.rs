//! The USB port on a bus in memory: a host enumerates it, prints through it, and misbehaves.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod broken;
mod bus;
mod conversation;
mod device;
mod enumeration;
mod host;
mod packets;
