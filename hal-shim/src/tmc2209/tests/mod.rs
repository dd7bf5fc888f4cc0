//! The drivers' code against model chips: whole datagrams in virtual time, and levels of a wire.

mod bank;
mod wire;
