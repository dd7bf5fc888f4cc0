//! Connection to a printer over a serial port of this computer or TCP, as a [`Port`].

use std::fmt;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::path::Path;
use std::str::FromStr;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use serialport::{SerialPortInfo, SerialPortType};

use crate::connection::connect;
use crate::printable;
use crate::send::Port;

/// Timeout of one read; a longer wait repeats the read.
const READ: Duration = Duration::from_millis(100);

/// The address of a printer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Address {
    /// Name of a serial port: `/dev/ttyACM0`, `COM3`.
    Serial(String),
    /// Host and port, written `tcp:octopi.local:5000`.
    Tcp(String),
}

impl FromStr for Address {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.strip_prefix("tcp:") {
            None if text.is_empty() => Err("write the name of a serial port, or tcp:HOST:PORT".to_owned()),
            None => Ok(Self::Serial(text.to_owned())),
            Some(host) => match host.rsplit_once(':') {
                Some((name, port)) if !name.is_empty() && port.parse::<u16>().is_ok() => Ok(Self::Tcp(host.to_owned())),
                _ => Err("expected tcp:HOST:PORT, for example tcp:localhost:5000".to_owned()),
            },
        }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Serial(name) => out.write_str(&printable::one_line(name)),
            Self::Tcp(host) => write!(out, "tcp:{}", printable::one_line(host)),
        }
    }
}

/// A serial port of this computer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FoundPort {
    /// Name of the port, as [`Address::Serial`] takes it.
    pub name: String,
    /// Vendor and product ID of a USB port.
    pub usb: Option<(u16, u16)>,
    /// Manufacturer, product and serial number as the device reports them.
    pub product: String,
}

impl FoundPort {
    /// Returns true if the port has this firmware's USB vendor and product IDs.
    #[must_use]
    pub fn is_ours(&self) -> bool {
        self.usb == Some((ferrostep_usb::VENDOR_ID, ferrostep_usb::PRODUCT_ID))
    }
}

impl From<SerialPortInfo> for FoundPort {
    fn from(port: SerialPortInfo) -> Self {
        let (usb, product) = match port.port_type {
            SerialPortType::UsbPort(usb) => {
                let names = [usb.manufacturer, usb.product, usb.serial_number];
                (Some((usb.vid, usb.pid)), names.into_iter().flatten().collect::<Vec<_>>().join(", "))
            }
            SerialPortType::PciPort => (None, "built in".to_owned()),
            SerialPortType::BluetoothPort => (None, "Bluetooth".to_owned()),
            SerialPortType::Unknown => (None, String::new()),
        };
        Self { name: port.port_name, usb, product }
    }
}

/// Lists the serial ports of this computer, USB ports first.
///
/// # Errors
/// The operating system cannot list them.
pub fn ports() -> Result<Vec<FoundPort>, String> {
    let found = serialport::available_ports().map_err(|error| format!("the serial ports cannot be listed: {error}"))?;
    let mut ports: Vec<FoundPort> = found.into_iter().map(FoundPort::from).collect();
    ports.sort_by(|a, b| a.usb.is_none().cmp(&b.usb.is_none()).then_with(|| a.name.cmp(&b.name)));
    Ok(ports)
}

/// Sending end of a line. Clones share the line; each call of [`Self::send`] writes its bytes
/// without interruption by another clone.
#[derive(Clone)]
pub struct LineOutput(Arc<Mutex<Box<dyn Write + Send>>>);

impl fmt::Debug for LineOutput {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.debug_tuple("LineOutput").finish_non_exhaustive()
    }
}

impl LineOutput {
    /// Sends bytes.
    ///
    /// # Errors
    /// The board is gone.
    pub fn send(&self, bytes: &[u8]) -> io::Result<()> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).write_all(bytes)
    }
}

/// An open line.
pub struct PrinterLine {
    output: LineOutput,
    lines: Receiver<String>,
}

impl fmt::Debug for PrinterLine {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.debug_struct("PrinterLine").finish_non_exhaustive()
    }
}

impl PrinterLine {
    /// Opens the line to a printer. `baud` has no effect on a USB port.
    ///
    /// # Errors
    /// The port is missing or is something else, this user may not open it, or it does not support
    /// the speed; or nothing answers at the address.
    pub fn open(address: &Address, baud: u32) -> Result<Self, String> {
        match address {
            Address::Serial(name) => {
                refuse_what_is_no_port(name)?;
                let port =
                    serialport::new(name.as_str(), baud).timeout(READ).open().map_err(|error| unopened(&error))?;
                let input = port.try_clone().map_err(|error| error.to_string())?;
                Ok(Self::over(input, port))
            }
            Address::Tcp(host) => {
                let stream = connect(host).map_err(|error| format!("no connection: {error}"))?;
                // A line of G-code is a small packet that should leave at once.
                let _ = stream.set_nodelay(true);
                let input = stream.try_clone().map_err(|error| error.to_string())?;
                Ok(Self::over(input, stream))
            }
        }
    }

    /// Returns another sending end, for bytes that must not wait their turn.
    #[must_use]
    pub fn output(&self) -> LineOutput {
        self.output.clone()
    }

    /// Creates a line from a reader and a writer. Reads that time out are repeated.
    pub fn over(input: impl Read + Send + 'static, output: impl Write + Send + 'static) -> Self {
        let (heard, lines) = channel();
        thread::spawn(move || {
            let mut input = BufReader::new(input);
            let mut line = Vec::new();
            loop {
                // On a timeout the bytes read so far stay in the buffer.
                match input.read_until(b'\n', &mut line) {
                    Ok(0) => break,
                    Ok(_) => {
                        let text = String::from_utf8_lossy(&line).trim_end_matches(['\r', '\n']).to_owned();
                        line.clear();
                        if heard.send(text).is_err() {
                            break;
                        }
                    }
                    Err(error) if matches!(error.kind(), io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock) => {}
                    Err(_) => break,
                }
            }
        });
        Self { output: LineOutput(Arc::new(Mutex::new(Box::new(output)))), lines }
    }
}

/// The way to a port that exists.
const LISTED: &str = "`ferrostep ports` lists the ports; or write tcp:HOST:PORT";

/// Describes why a port cannot be opened. A device that is not a terminal refuses its settings with
/// ENOTTY, which is written "Not a typewriter".
fn unopened(error: &serialport::Error) -> String {
    let text = error.to_string();
    match text.as_str() {
        "Not a typewriter" | "Inappropriate ioctl for device" => {
            format!("this device is not a serial port: {LISTED}")
        }
        _ => text,
    }
}

/// Describes why nothing can be said of a port's file.
#[cfg(unix)]
fn unreached(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::NotFound => format!("there is no such port: {LISTED}"),
        _ => error.to_string(),
    }
}

/// Checks that the name is a serial port before the file is opened for writing.
#[cfg(unix)]
fn refuse_what_is_no_port(name: &str) -> Result<(), String> {
    use std::os::unix::fs::FileTypeExt;
    let kind = Path::new(name).metadata().map_err(|error| unreached(&error))?.file_type();
    if kind.is_char_device() {
        return Ok(());
    }
    let what = match () {
        () if kind.is_dir() => "a folder",
        () if kind.is_file() => "an ordinary file",
        () => "another kind of file",
    };
    Err(format!("this is {what}, not a serial port: {LISTED}"))
}

#[cfg(not(unix))]
fn refuse_what_is_no_port(name: &str) -> Result<(), String> {
    if Path::new(name).is_file() {
        return Err(format!("this is an ordinary file, not a serial port: {LISTED}"));
    }
    Ok(())
}

impl Port for PrinterLine {
    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.output.send(bytes)
    }

    fn receive(&mut self, until: Instant) -> io::Result<Option<String>> {
        match self.lines.recv_timeout(until.saturating_duration_since(Instant::now())) {
            Ok(line) => Ok(Some(line)),
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => Err(io::Error::from(io::ErrorKind::BrokenPipe)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_read() {
        assert_eq!("/dev/ttyACM0".parse(), Ok(Address::Serial("/dev/ttyACM0".to_owned())));
        assert_eq!("COM3".parse(), Ok(Address::Serial("COM3".to_owned())));
        assert_eq!("tcp:[::1]:5000".parse(), Ok(Address::Tcp("[::1]:5000".to_owned())));
        for text in ["", "tcp:", "tcp:5000", "tcp::5000", "tcp:host:port", "tcp:host:70000"] {
            assert!(text.parse::<Address>().is_err(), "{text}");
        }
    }
}
