//! The log of a program, as a debug probe shows it: defmt frames over RTT.
//!
//! The emulator finds the program's RTT buffer and passes the bytes to a TCP port; defmt-decoder turns them into text with the
//! table in the image's file.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};

use defmt_decoder::{DecodeError, Table};

/// Reads the log from an emulator's RTT port until the emulator closes it, and writes each line to `out`.
///
/// # Errors
/// The port or `out` fails, or the image's table of log texts is damaged.
pub fn show(rtt: SocketAddr, elf: &[u8], out: &mut impl Write) -> Result<(), String> {
    let stream = TcpStream::connect(rtt).map_err(|error| format!("the log lost the emulator: {error}"))?;
    write_lines(stream, elf, out)
}

fn write_lines(mut log: impl Read, elf: &[u8], out: &mut impl Write) -> Result<(), String> {
    let table = Table::parse(elf).map_err(|error| format!("the image's table of log texts: {error}"))?;
    // A program without a log.
    let Some(table) = table else { return Ok(()) };
    let mut decoder = table.new_stream_decoder();
    let mut bytes = [0; 1024];
    loop {
        let length = log.read(&mut bytes).map_err(|error| format!("the log lost the emulator: {error}"))?;
        if length == 0 {
            return Ok(());
        }
        decoder.received(bytes.get(..length).unwrap_or_default());
        loop {
            match decoder.decode() {
                Ok(frame) => {
                    let level = frame.level().map_or("", |level| level.as_str());
                    writeln!(out, "log: {level} {}", frame.display_message()).map_err(|error| error.to_string())?;
                }
                Err(DecodeError::UnexpectedEof) => break,
                // A frame of which a full buffer kept a part.
                Err(DecodeError::Malformed) => {
                    writeln!(out, "log: a damaged line").map_err(|error| error.to_string())?;
                    if !table.encoding().can_recover() {
                        return Ok(());
                    }
                }
            }
        }
    }
}
