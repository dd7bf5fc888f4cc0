//! `ferrostep ports`.

use std::process::ExitCode;

use ferrostep_host::printable;
use ferrostep_host::printer_line::{self, FoundPort};

use crate::outcome::exit_code;
use crate::terminal::{self, tell};

/// Lists the serial ports of this computer.
///
/// # Errors
/// The operating system cannot list them.
pub fn run() -> Result<ExitCode, String> {
    let ports = printer_line::ports()?;
    if ports.is_empty() {
        tell("no serial port: is the printer connected and switched on?");
    }
    let text: String = ports.iter().map(|port| describe(port) + "\n").collect();
    Ok(exit_code(terminal::write_result(&text)))
}

fn describe(port: &FoundPort) -> String {
    let usb = port.usb.map_or("         ".to_owned(), |(vendor, product)| format!("{vendor:04x}:{product:04x}"));
    let ours = if port.is_ours() { "  (Ferrostep)" } else { "" };
    format!("{}  {usb}  {}{ours}", printable::one_line(&port.name), printable::one_line(&port.product))
        .trim_end()
        .to_owned()
}
