//! The debugger of a program that asks for files and for its command line.
//!
//! The covered part of GDB's remote protocol ("Debugging with GDB", appendix E): packets
//! `$TEXT#SUM`, each acknowledged by a `+`; the file calls `Fopen`, `Fread` and `Fclose` of its
//! section on File-I/O; and breakpoints at the semihosting calls, where SYS_GET_CMDLINE (0x15) is
//! answered, which the emulator lets fail. Files are opened for reading, by name, in one folder. A
//! further breakpoint, at the hard fault handler, ends a program that panicked or faulted.
//!
//! **Left out:** all other calls. They fail, as the protocol permits.

use std::fs::File;
use std::io::{self, BufReader, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::{Component, Path};

/// Registers by their numbers in the protocol: operation and answer, parameter, stack pointer,
/// next instruction.
const OPERATION: usize = 0;
const PARAMETER: usize = 1;
const STACK: usize = 13;
const NEXT: usize = 15;

/// Semihosting's call for the command line.
const GET_COMMAND_LINE: u32 = 0x15;

/// The protocol's errors: the file does not exist; the call is unknown.
const NO_FILE: &str = "F-1,2";
const UNKNOWN: &str = "F-1,270f";

/// Maximum bytes of memory in a packet.
const MAX_BYTES: usize = 1024;

/// The instruction of a semihosting call: `bkpt 0xab`.
const CALL: [u8; 2] = [0xab, 0xbe];

/// Addresses of possible semihosting calls: the instruction, or data that looks like it.
pub fn calls<'a>(segments: impl Iterator<Item = (u64, &'a [u8])>) -> Vec<u64> {
    let calls = segments.flat_map(|(start, bytes)| {
        bytes
            .as_chunks::<2>()
            .0
            .iter()
            .enumerate()
            .filter(|(_, half)| **half == CALL)
            .map(move |(place, _)| start + 2 * place as u64)
    });
    calls.collect()
}

/// The place of the hard fault's vector in the vector table, and of the faulting instruction in the
/// words that the core pushes (PM0214, 2.3.4 and 2.3.7).
const HARD_FAULT_VECTOR: u64 = 3 * 4;
const FAULTING_INSTRUCTION: usize = 6 * 4;

/// The address of the hard fault handler of an image whose vector table is at `vectors`, if
/// the image has one.
pub fn hard_fault<'a>(vectors: u64, mut segments: impl Iterator<Item = (u64, &'a [u8])>) -> Option<u64> {
    let vector = vectors + HARD_FAULT_VECTOR;
    segments.find_map(|(start, bytes)| {
        let place = usize::try_from(vector.checked_sub(start)?).ok()?;
        let word = bytes.get(place..)?.first_chunk()?;
        // Bit 0 says that it is Thumb code.
        Some(u64::from(u32::from_le_bytes(*word) & !1))
    })
}

/// Reason why a program was not served to its end.
#[derive(Debug)]
pub enum Broken {
    /// The emulator closed the connection without a word.
    Connection(io::Error),
    /// The program reached its hard fault handler or stopped outside its calls, a file cannot be
    /// read, or the emulator said something unexpected.
    Program(io::Error),
}

impl Broken {
    /// Nothing is wrong with a connection that closes after the program's end: the emulator,
    /// which knows the end by itself, may be gone before the debugger has heard or acknowledged
    /// its last packet.
    ///
    /// # Errors
    /// The program stopped, or the connection closed before its end.
    pub fn at_end(self, has_ended: bool) -> Result<(), String> {
        match self {
            Self::Connection(_) if has_ended => Ok(()),
            Self::Connection(error) => Err(format!("the debugger lost the emulator: {error}")),
            Self::Program(error) => Err(format!("the debugger's side: {error}")),
        }
    }
}

impl From<io::Error> for Broken {
    fn from(error: io::Error) -> Self {
        match error.kind() {
            ErrorKind::ConnectionReset
            | ErrorKind::ConnectionAborted
            | ErrorKind::BrokenPipe
            | ErrorKind::UnexpectedEof => Self::Connection(error),
            _ => Self::Program(error),
        }
    }
}

/// Serves a program from its first instruction to its end. A program without arguments runs without
/// breakpoints at its calls.
///
/// # Errors
/// The emulator closed the connection, or the program reached its hard fault handler or stopped
/// outside its calls.
pub fn serve(
    emulator: SocketAddr,
    folder: &Path,
    arguments: &str,
    calls: &[u64],
    hard_fault: u64,
) -> Result<(), Broken> {
    let mut server = Server::connect(emulator)?;
    Ok(server.serve(folder, arguments, calls, hard_fault)?)
}

struct Server {
    out: TcpStream,
    incoming: BufReader<TcpStream>,
    files: Vec<File>,
}

impl Server {
    fn connect(emulator: SocketAddr) -> io::Result<Self> {
        let out = TcpStream::connect(emulator)?;
        out.set_nodelay(true)?;
        let incoming = BufReader::new(out.try_clone()?);
        Ok(Self { out, incoming, files: Vec::new() })
    }

    fn serve(&mut self, folder: &Path, arguments: &str, calls: &[u64], hard_fault: u64) -> io::Result<()> {
        self.ask("qSupported:swbreak+;hwbreak+")?;
        self.ask("?")?;
        self.command(&format!("Z1,{hard_fault:x},2"))?;
        let calls = if arguments.is_empty() { &[] } else { calls };
        for call in calls {
            self.command(&format!("Z1,{call:x},2"))?;
        }
        self.send("c")?;
        loop {
            let said = self.receive()?;
            match said.as_bytes().first() {
                // The emulator handles console output.
                Some(b'O') => {}
                Some(b'F') => {
                    let answer = self.file_call(&said[1..], folder)?;
                    self.send(&answer)?;
                }
                Some(b'S' | b'T') => {
                    self.stopped(arguments, calls, hard_fault)?;
                    self.send("c")?;
                }
                Some(b'W' | b'X') => return Ok(()),
                _ => return Err(unexpected(&said)),
            }
        }
    }

    fn file_call(&mut self, request: &str, folder: &Path) -> io::Result<String> {
        let mut words = request.split(',');
        let (call, words) = (words.next().unwrap_or_default(), words.collect::<Vec<_>>());
        let number = |index: usize| {
            let word: &str = words.get(index).copied().unwrap_or_default();
            usize::from_str_radix(word, 16).map_err(|_| unexpected(request))
        };
        Ok(match call {
            "open" => {
                let place = words.first().and_then(|word| word.split_once('/')).ok_or_else(|| unexpected(request))?;
                let (Ok(address), Ok(length)) =
                    (usize::from_str_radix(place.0, 16), usize::from_str_radix(place.1, 16))
                else {
                    return Err(unexpected(request));
                };
                // The last byte is the terminating zero.
                let name = self.read_memory(address, length.saturating_sub(1))?;
                let name = String::from_utf8_lossy(&name).into_owned();
                let is_name = Path::new(&name).components().all(|part| matches!(part, Component::Normal(_)));
                match File::open(folder.join(&name)) {
                    Ok(file) if is_name => {
                        self.files.push(file);
                        format!("F{:x}", FIRST_HANDLE + self.files.len() - 1)
                    }
                    _ => NO_FILE.to_owned(),
                }
            }
            "read" => {
                let (handle, address, length) = (number(0)?, number(1)?, number(2)?);
                let Some(file) = handle.checked_sub(FIRST_HANDLE).and_then(|index| self.files.get_mut(index)) else {
                    return Ok(NO_FILE.to_owned());
                };
                let mut bytes = Vec::new();
                Read::take(file, length as u64).read_to_end(&mut bytes)?;
                self.write_memory(address, &bytes)?;
                format!("F{:x}", bytes.len())
            }
            "close" => "F0".to_owned(),
            _ => UNKNOWN.to_owned(),
        })
    }

    /// Answers the call at which the program has stopped if it asks for the command line,
    /// which it does once.
    fn stopped(&mut self, arguments: &str, calls: &[u64], hard_fault: u64) -> io::Result<()> {
        let place = self.register(NEXT)?;
        if u64::from(place) == hard_fault {
            let frame = self.register(STACK)? as usize;
            let faulting = word(&self.read_memory(frame + FAULTING_INSTRUCTION, 4)?, 0);
            return Err(io::Error::other(format!(
                "the program panicked or faulted: a hard fault at {faulting:#010x}; its log says why if it panicked"
            )));
        }
        let (operation, parameter) = (self.register(OPERATION)?, self.register(PARAMETER)? as usize);
        if !calls.contains(&u64::from(place)) {
            return Err(io::Error::other(format!(
                "the program stopped at {place:#010x}, which is not a semihosting call"
            )));
        }
        if operation != GET_COMMAND_LINE {
            return Ok(());
        }
        for call in calls {
            self.command(&format!("z1,{call:x},2"))?;
        }
        // The parameter block has two words: the buffer's address, and its size, which the answer
        // replaces by the length.
        let block = self.read_memory(parameter, 8)?;
        let fits = arguments.len() < word(&block, 4) as usize;
        if fits {
            self.write_memory(word(&block, 0) as usize, format!("{arguments}\0").as_bytes())?;
            self.write_memory(parameter + 4, &(arguments.len() as u32).to_le_bytes())?;
        }
        self.set_register(OPERATION, if fits { 0 } else { u32::MAX })?;
        self.set_register(NEXT, place + CALL.len() as u32)
    }

    fn read_memory(&mut self, address: usize, length: usize) -> io::Result<Vec<u8>> {
        let answer = self.ask(&format!("m{address:x},{length:x}"))?;
        let digits = answer.as_bytes().chunks(2).map(|pair| std::str::from_utf8(pair).ok());
        let bytes = digits.map(|pair| u8::from_str_radix(pair?, 16).ok()).collect::<Option<Vec<u8>>>();
        bytes
            .filter(|bytes| bytes.len() == length)
            .ok_or_else(|| io::Error::other(format!("{length} bytes at {address:#x}: {answer}")))
    }

    fn write_memory(&mut self, address: usize, bytes: &[u8]) -> io::Result<()> {
        for (place, part) in (address..).step_by(MAX_BYTES).zip(bytes.chunks(MAX_BYTES)) {
            let digits: String = part.iter().map(|byte| format!("{byte:02x}")).collect();
            self.command(&format!("M{place:x},{:x}:{digits}", part.len()))?;
        }
        Ok(())
    }

    fn register(&mut self, number: usize) -> io::Result<u32> {
        let answer = self.ask(&format!("p{number:x}"))?;
        Ok(u32::from_str_radix(&answer, 16).map_err(|_| unexpected(&answer))?.swap_bytes())
    }

    fn set_register(&mut self, number: usize, value: u32) -> io::Result<()> {
        self.command(&format!("P{number:x}={:08x}", value.swap_bytes()))
    }

    fn command(&mut self, text: &str) -> io::Result<()> {
        match self.ask(text)?.as_str() {
            "OK" => Ok(()),
            answer => Err(io::Error::other(format!("{text}: {answer}"))),
        }
    }

    fn ask(&mut self, text: &str) -> io::Result<String> {
        self.send(text)?;
        self.receive()
    }

    fn send(&mut self, text: &str) -> io::Result<()> {
        self.out.write_all(packet(text).as_bytes())
    }

    /// Receives the next packet.
    fn receive(&mut self) -> io::Result<String> {
        while self.byte()? != b'$' {}
        let mut text = Vec::new();
        loop {
            match self.byte()? {
                b'#' => break,
                byte => text.push(byte),
            }
        }
        // The checksum: a connection within this computer loses nothing.
        self.byte()?;
        self.byte()?;
        self.out.write_all(b"+")?;
        Ok(String::from_utf8_lossy(&text).into_owned())
    }

    fn byte(&mut self) -> io::Result<u8> {
        let mut byte = [0];
        self.incoming.read_exact(&mut byte)?;
        Ok(byte[0])
    }
}

/// The first file handle; lower numbers belong to the console.
const FIRST_HANDLE: usize = 3;

/// The little-endian word at a place in memory that was read; 0 if it lies outside.
fn word(memory: &[u8], at: usize) -> u32 {
    memory.get(at..).and_then(<[u8]>::first_chunk).map_or(0, |bytes| u32::from_le_bytes(*bytes))
}

/// A text as a packet with its checksum.
fn packet(text: &str) -> String {
    let sum = text.bytes().fold(0_u8, u8::wrapping_add);
    format!("${text}#{sum:02x}")
}

fn unexpected(answer: &str) -> io::Error {
    io::Error::other(format!("unexpected packet {answer:?}"))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
