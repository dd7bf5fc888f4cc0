//! Shows the log of a program on the virtual mainboard, as a debug probe does: defmt frames on
//! standard input, lines of text on standard error.
//!
//! `ferrostep-mainboard-log ELF`: the image's file has the table of the log's texts.

use std::io::{Read, Write};
use std::process::ExitCode;

use defmt_decoder::{DecodeError, Table};

fn main() -> ExitCode {
    let arguments: Vec<_> = std::env::args_os().skip(1).collect();
    let [elf] = arguments.as_slice() else {
        eprintln!("expected the path of the image whose log is on standard input");
        return ExitCode::from(2);
    };
    let shown = std::fs::read(elf)
        .map_err(|error| format!("{}: {error}", elf.display()))
        .and_then(|elf| write_lines(std::io::stdin().lock(), &elf, &mut std::io::stderr().lock()));
    match shown {
        Ok(()) => ExitCode::SUCCESS,
        Err(reason) => {
            eprintln!("{reason}");
            ExitCode::FAILURE
        }
    }
}

/// Writes a line for each frame of the log.
///
/// # Errors
/// The log or `out` fails, or the table of log texts is damaged.
fn write_lines(mut log: impl Read, elf: &[u8], out: &mut impl Write) -> Result<(), String> {
    let table = Table::parse(elf).map_err(|error| format!("the image's table of log texts: {error}"))?;
    // A program without a log.
    let Some(table) = table else { return Ok(()) };
    let mut decoder = table.new_stream_decoder();
    let mut bytes = [0; 1024];
    loop {
        let length = log.read(&mut bytes).map_err(|error| format!("the log cannot be read: {error}"))?;
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
