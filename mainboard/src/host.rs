//! See the crate.

pub mod usb;
