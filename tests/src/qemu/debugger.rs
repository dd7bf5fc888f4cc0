//! The emulator's side door: its processor halted, a register changed, and on it goes.
//!
//! GDB's remote protocol, as much of it as that takes: packets `$TEXT#SUM`, each acknowledged by a `+`.

use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// How long the emulator may take to open its door, and then for each answer.
const LIMIT: Duration = Duration::from_secs(20);

/// A pause between two attempts.
const PAUSE: Duration = Duration::from_millis(20);

/// A register of the core, by its number in the protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Register {
    /// The first argument of a call.
    R0 = 0,
    /// The stack pointer.
    StackPointer = 13,
    /// Where a call returns to.
    Link = 14,
    /// The next instruction's address.
    ProgramCounter = 15,
}

/// A processor that stands still until [`Self::resume`].
#[derive(Debug)]
pub struct Debugger {
    stream: TcpStream,
}

impl Debugger {
    /// Halts the processor of the emulator at a port of this computer.
    ///
    /// # Errors
    /// Nobody is there, or nobody that speaks the protocol.
    pub fn halt(port: u16) -> io::Result<Self> {
        let until = Instant::now() + LIMIT;
        let stream = loop {
            match TcpStream::connect(("127.0.0.1", port)) {
                Ok(stream) => break stream,
                Err(error) if Instant::now() > until => return Err(error),
                Err(_) => std::thread::sleep(PAUSE),
            }
        };
        stream.set_read_timeout(Some(LIMIT))?;
        let mut debugger = Self { stream };
        // Without having been asked what its registers are, the emulator tells and takes only all of them at once.
        debugger.ask("qXfer:features:read:target.xml:0,ffb")?;
        Ok(debugger)
    }

    /// A register's value.
    ///
    /// # Errors
    /// The emulator is gone or does not understand.
    pub fn register(&mut self, register: Register) -> io::Result<u32> {
        let answer = self.ask(&format!("p{:x}", register as u8))?;
        let bytes = u32::from_str_radix(&answer, 16).map_err(|_| unexpected(&answer))?;
        Ok(bytes.swap_bytes())
    }

    /// Changes a register.
    ///
    /// # Errors
    /// The emulator is gone or refuses.
    pub fn set_register(&mut self, register: Register, value: u32) -> io::Result<()> {
        self.command(&format!("P{:x}={:08x}", register as u8, value.swap_bytes()))
    }

    /// Changes memory.
    ///
    /// # Errors
    /// The emulator is gone or refuses.
    pub fn write_memory(&mut self, address: u32, bytes: &[u8]) -> io::Result<()> {
        let digits: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        self.command(&format!("M{address:x},{:x}:{digits}", bytes.len()))
    }

    /// A word of memory, or a register of a device.
    ///
    /// # Errors
    /// The emulator is gone or refuses.
    pub fn word(&mut self, address: u32) -> io::Result<u32> {
        let answer = self.ask(&format!("m{address:x},4"))?;
        let bytes = u32::from_str_radix(&answer, 16).map_err(|_| unexpected(&answer))?;
        Ok(bytes.swap_bytes())
    }

    /// Lets the processor go on, for good.
    ///
    /// # Errors
    /// The emulator is gone or refuses.
    pub fn resume(mut self) -> io::Result<()> {
        self.command("D")
    }

    fn command(&mut self, text: &str) -> io::Result<()> {
        match self.ask(text)?.as_str() {
            "OK" => Ok(()),
            answer => Err(unexpected(answer)),
        }
    }

    /// Sends a packet and returns its answer.
    fn ask(&mut self, text: &str) -> io::Result<String> {
        self.stream.write_all(packet(text).as_bytes())?;
        loop {
            let answer = self.answer()?;
            // That the processor has stopped is said in between, and known.
            if !answer.starts_with('T') {
                return Ok(answer);
            }
        }
    }

    /// The next packet that comes.
    fn answer(&mut self) -> io::Result<String> {
        while self.byte()? != b'$' {}
        let mut answer = Vec::new();
        loop {
            match self.byte()? {
                b'#' => break,
                byte => answer.push(byte),
            }
        }
        // The sum: the line is within this computer, and loses nothing.
        self.byte()?;
        self.byte()?;
        self.stream.write_all(b"+")?;
        Ok(String::from_utf8_lossy(&answer).into_owned())
    }

    fn byte(&mut self) -> io::Result<u8> {
        let mut byte = [0];
        self.stream.read_exact(&mut byte)?;
        Ok(byte[0])
    }
}

/// A text as a packet.
fn packet(text: &str) -> String {
    let sum = text.bytes().fold(0_u8, u8::wrapping_add);
    format!("${text}#{sum:02x}")
}

fn unexpected(answer: &str) -> io::Error {
    io::Error::other(format!("the emulator's debugger answers {answer:?}"))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::net::TcpListener;

    use super::*;

    #[test]
    fn a_packet_ends_with_the_sum_of_its_bytes() {
        assert_eq!(packet(""), "$#00");
        assert_eq!(packet("OK"), "$OK#9a");
    }

    #[test]
    fn a_conversation_is_packets_and_their_answers() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap().port();
        let emulator = std::thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            stream.write_all(packet("T05thread:01;").as_bytes()).unwrap();
            for (asked, answer) in [
                ("$qXfer:features:read:target.xml:0,ffb#", "l<?xml?>"),
                ("$pf#", "01020304"),
                ("$m40000440,4#", "e8030000"),
                ("$P0=78563412#", "OK"),
                ("$M20000000,2:0aff#", "E14"),
            ] {
                let mut heard = Vec::new();
                while !String::from_utf8_lossy(&heard).contains(asked) {
                    let mut byte = [0];
                    stream.read_exact(&mut byte).unwrap();
                    heard.push(byte[0]);
                }
                stream.write_all(format!("+{}", packet(answer)).as_bytes()).unwrap();
            }
        });
        let mut debugger = Debugger::halt(port).unwrap();
        assert_eq!(debugger.register(Register::ProgramCounter).unwrap(), 0x0403_0201);
        assert_eq!(debugger.word(0x4000_0440).unwrap(), 1000);
        debugger.set_register(Register::R0, 0x1234_5678).unwrap();
        assert!(debugger.write_memory(0x2000_0000, &[10, 255]).is_err());
        emulator.join().unwrap();
    }
}
