//! Host side of a printer connection: opens the line, sends jobs and commands, and reports the
//! answers.

pub mod black_box_lines;
pub mod connection;
pub mod file_lines;
pub mod printable;
// A web page cannot open serial ports.
#[cfg(not(target_family = "wasm"))]
pub mod printer_line;
pub mod send;
