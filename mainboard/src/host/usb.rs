//! A host at the other end of the USB cable.

pub mod bus;
