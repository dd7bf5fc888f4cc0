//! Options that all commands share: board, printer and image.

use std::net::TcpListener;
use std::num::NonZeroU64;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use rigless::image::Image;

use crate::machine::{HOST_PORT, INSTRUCTIONS_PER_SECOND, Machine};
use crate::run::Options;
use crate::wiring::{Board, Printer, check_image};

/// The line to the host.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Via {
    /// The USB plug.
    Usb,
    /// The serial line.
    Uart,
}

/// A board, its printer and its image.
#[derive(Debug, Args)]
pub struct Setup {
    /// The board's file.
    #[arg(long, value_name = "TOML")]
    board: PathBuf,
    /// The printer's profile [default: the board's own, in `profiles` beside the board's folder].
    #[arg(long, value_name = "TOML")]
    profile: Option<PathBuf>,
    /// The image with its addresses (ELF) [default: where `cargo xtask firmware` puts it].
    #[arg(long, value_name = "ELF")]
    image: Option<PathBuf>,
    /// Seed of noise, bouncing and everything else that is random.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Instructions per second of virtual time; fewer model wait states.
    #[arg(long, default_value_t = INSTRUCTIONS_PER_SECOND)]
    instructions_per_second: u64,
    /// Time from the request of the step interrupt to its first instruction, ns.
    #[arg(long, default_value_t = crate::chip::entry::ENTRY_NS)]
    entry_ns: u64,
    /// Serve GDB on this port of this computer.
    #[arg(long, value_name = "PORT")]
    gdb: Option<u16>,
    /// Wait for GDB before the first instruction.
    #[arg(long, requires = "gdb")]
    wait_for_gdb: bool,
}

/// The files of [`Setup`], read and checked.
#[derive(Debug)]
pub struct LoadedSetup {
    /// The board.
    pub board: Board,
    /// The printer.
    pub printer: Printer,
    /// The machine.
    pub machine: Machine,
    /// The image.
    pub images: Vec<Image>,
    /// The path of the image's file.
    pub image_path: PathBuf,
    /// SHA-256 of the image's file, in hexadecimal.
    pub image_sha256: String,
    /// The top of the image's stack, which grows down to the start of RAM.
    pub stack_top: u32,
    debugger: Option<TcpListener>,
    wait_for_debugger: bool,
}

impl Setup {
    /// Reads the files and builds the machine.
    ///
    /// # Errors
    /// A file cannot be read, the board contradicts its chip, or the image is for another board;
    /// the text names the file.
    pub fn load(&self) -> Result<LoadedSetup, String> {
        let board = Board::read(&self.board).map_err(|error| error.to_string())?;
        let config = self.board.parent().unwrap_or(Path::new(".")).join("..");
        let profile = self.profile.clone().unwrap_or_else(|| config.join(format!("profiles/{}.toml", board.profile)));
        let image_path =
            self.image.clone().unwrap_or_else(|| config.join(format!("../target/images/{}/ferrostep.elf", board.name)));
        let printer = Printer::read(&profile).map_err(|error| error.to_string())?;
        let name = image_path.display().to_string();
        let bytes = std::fs::read(&image_path)
            .map_err(|error| format!("{name}: {error}; build it with `cargo xtask firmware --board {}`", board.name))?;
        let stack_top = check_image(&board, &name, &bytes).map_err(|error| error.to_string())?.stack_pointer;
        let image_sha256 = sha256(&bytes);
        let image = Image::new(Path::new(&name), bytes, None).map_err(|error| error.to_string())?;
        let mut machine = Machine::new(&board, &printer, self.seed)?;
        let rate = NonZeroU64::new(self.instructions_per_second).ok_or(
            "--instructions-per-second 0: the core would never run; write a number above 0, such as 120000000",
        )?;
        machine.set_instructions_per_second(rate);
        machine.chip.set_interrupt_entry(self.entry_ns);
        let debugger = match self.gdb {
            Some(port) => Some(
                TcpListener::bind(("127.0.0.1", port))
                    .map_err(|error| format!("--gdb {port}: {error}; choose another port, or 0 for any free one"))?,
            ),
            None => None,
        };
        if let Some(address) = debugger.as_ref().and_then(|listener| listener.local_addr().ok()) {
            eprintln!("GDB on {address}: gdb-multiarch -ex 'target remote {address}' {name}");
        }
        Ok(LoadedSetup {
            board,
            printer,
            machine,
            images: vec![image],
            image_path,
            image_sha256,
            stack_top,
            debugger,
            wait_for_debugger: self.wait_for_gdb,
        })
    }
}

impl LoadedSetup {
    /// Options of the run.
    #[must_use]
    pub fn options(&self) -> Options<'_> {
        Options {
            boot: Some(0x0800_0000 + u64::from(self.board.boot_offset)),
            debugger: self.debugger.as_ref(),
            wait_for_debugger: self.wait_for_debugger,
        }
    }
}

fn sha256(bytes: &[u8]) -> String {
    use sha2::{Digest, Sha256};
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Takes the bytes that the printer has sent since the last call.
pub fn receive(machine: &mut Machine, via: Via) -> Vec<u8> {
    match via {
        Via::Usb => machine.usb_host.read(),
        Via::Uart => machine
            .mailbox(HOST_PORT)
            .map(|mailbox| mailbox.take().map(|(_, word)| word as u8).collect())
            .unwrap_or_default(),
    }
}

/// Sends bytes to the printer.
pub fn send(machine: &mut Machine, via: Via, now_ns: u64, bytes: &[u8]) {
    match via {
        Via::Usb => machine.usb_host.write(bytes),
        Via::Uart => {
            if let Some(mailbox) = machine.mailbox(HOST_PORT) {
                bytes.iter().for_each(|byte| mailbox.send(now_ns, u16::from(*byte)));
            }
        }
    }
}

/// The number of bytes that the printer has not taken yet.
pub fn unsent(machine: &mut Machine, via: Via) -> usize {
    match via {
        Via::Usb => machine.usb_host.unsent(),
        Via::Uart => machine.mailbox(HOST_PORT).map_or(0, |mailbox| mailbox.waiting()),
    }
}
