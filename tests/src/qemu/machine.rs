//! The emulator as a process.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Write};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread;
use std::time::Instant;

use object::{Object, ObjectSection};

use super::debugger::Debugger;
use super::drivers;
use super::host::Port;

/// The program. Version 7.2 is known to work.
pub const EMULATOR: &str = "qemu-system-arm";

/// `netduinoplus2` is the board with an STM32F405. Virtual time runs 64 ns an instruction. Timers count it two and a
/// half times faster than the nominal time base, so that a print need not take as long as on a printer: what happens
/// and in which order is the same. Much faster, and a host that is held up would look like one that has gone.
const ARGUMENTS: [&str; 13] = [
    "-machine",
    "netduinoplus2",
    "-global",
    "stm32f2xx-timer.clock-frequency=210000000",
    "-display",
    "none",
    "-monitor",
    "none",
    "-serial",
    "stdio",
    "-d",
    "unimp",
    "-D",
];

/// Where the core looks for its stack pointer and its first instruction after reset.
const FLASH: u32 = 0x0800_0000;

/// The time for which the image sleeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sleep {
    /// As long as on the wall: a host that is as quick as a host should be keeps up.
    RealTime,
    /// Over at once: virtual time jumps to the next interrupt. For what takes minutes and does not depend on the host.
    LeftOut,
}

impl Sleep {
    /// Instructions count virtual time in both cases.
    const fn icount(self) -> &'static str {
        match self {
            Self::RealTime => "shift=6",
            Self::LeftOut => "shift=6,sleep=off",
        }
    }
}

/// A running image. It is ended when this is dropped.
#[derive(Debug)]
pub struct Machine {
    child: Child,
    to_image: Sender<Vec<u8>>,
    from_image: Receiver<String>,
    pin_log: PathBuf,
    messages: PathBuf,
    debugger_port: u16,
}

impl Machine {
    /// Starts an image, with motor drivers on USART2; its logs go into `folder`. One that does not begin where flash does gets a boot loader that does
    /// nothing but jump to it.
    ///
    /// # Errors
    /// The emulator does not start, or the folder cannot be written to.
    pub fn start(image: &Path, folder: &Path, sleep: Sleep) -> io::Result<Self> {
        let (pin_log, messages) = (folder.join("pins.log"), folder.join("emulator.log"));
        let debugger_port = free_port()?;
        let mut command = Command::new(EMULATOR);
        command.args(["-icount", sleep.icount()]).args(ARGUMENTS).arg(&pin_log).arg("-kernel").arg(image);
        command.arg("-serial").arg(format!("tcp:127.0.0.1:{}", drivers::start()?));
        command.arg("-gdb").arg(format!("tcp:127.0.0.1:{debugger_port}"));
        if let Some(jump) = jump_to(image)? {
            let path = folder.join("boot-loader.bin");
            std::fs::write(&path, jump)?;
            let path = path.display();
            command.arg("-device").arg(format!("loader,file={path},addr={FLASH:#x},force-raw=on"));
        }
        let mut child =
            command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(File::create(&messages)?).spawn()?;
        let (Some(mut input), Some(output)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(io::Error::other("the emulator has no serial line"));
        };
        // Threads of their own, so that an image that reads or says nothing cannot hold up the test's time limit.
        // Both end with the emulator.
        let (to_image, outgoing) = channel::<Vec<u8>>();
        thread::spawn(move || {
            outgoing.iter().try_for_each(|bytes| input.write_all(&bytes).and_then(|()| input.flush()))
        });
        let (incoming, from_image) = channel();
        thread::spawn(move || {
            let mut output = BufReader::new(output);
            let mut line = Vec::new();
            while output.read_until(b'\n', &mut line).is_ok_and(|length| length > 0) {
                let text = String::from_utf8_lossy(&line).trim_end_matches(['\r', '\n']).to_owned();
                line.clear();
                if incoming.send(text).is_err() {
                    break;
                }
            }
        });
        Ok(Self { child, to_image, from_image, pin_log, messages, debugger_port })
    }

    /// The log of pins, as long as it is by now; the emulator writes each access at once.
    pub fn pin_log(&self) -> &Path {
        &self.pin_log
    }

    /// Halts the processor.
    ///
    /// # Errors
    /// The emulator is gone.
    pub fn halt(&self) -> io::Result<Debugger> {
        Debugger::halt(self.debugger_port)
    }

    /// Ends the emulator; the log of pins is then complete.
    pub fn stop(&mut self) {
        // It may have ended by itself, which is as good.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }

    fn ended(&mut self) -> io::Error {
        let status = self.child.try_wait();
        let messages = std::fs::read_to_string(&self.messages).unwrap_or_default();
        io::Error::new(io::ErrorKind::UnexpectedEof, format!("the emulator ended ({status:?}): {messages}"))
    }
}

/// A port of this computer that nobody listens at.
fn free_port() -> io::Result<u16> {
    Ok(TcpListener::bind("127.0.0.1:0")?.local_addr()?.port())
}

/// The words that the core takes for its own after reset, if the image does not stand where it looks for them.
fn jump_to(image: &Path) -> io::Result<Option<Vec<u8>>> {
    let bytes = std::fs::read(image)?;
    let file = object::File::parse(&*bytes).map_err(io::Error::other)?;
    let table = file.section_by_name(".vector_table").ok_or_else(|| io::Error::other("no vector table"))?;
    let words = table.data().map_err(io::Error::other)?;
    Ok((table.address() != u64::from(FLASH)).then(|| words.iter().take(8).copied().collect()))
}

impl Drop for Machine {
    fn drop(&mut self) {
        self.stop();
    }
}

impl Port for Machine {
    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.to_image.send(bytes.to_vec()).map_err(|_| self.ended())
    }

    fn receive(&mut self, until: Instant) -> io::Result<Option<String>> {
        match self.from_image.recv_timeout(until.saturating_duration_since(Instant::now())) {
            Ok(line) => Ok(Some(line)),
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => Err(self.ended()),
        }
    }
}
