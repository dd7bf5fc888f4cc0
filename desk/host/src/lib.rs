//! The host's end of a printer's line: opens it, sends jobs over it, asks, and reports the answers.

pub mod black_box_lines;
pub mod connection;
pub mod file_lines;
pub mod printable;
// A page in a browser opens no ports.
#[cfg(not(target_family = "wasm"))]
pub mod printer_line;
pub mod send;
