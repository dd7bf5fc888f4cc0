//! Runs a program that talks to its debugger: benchmarks and tests for a board, which print by
//! semihosting (an Arm specification) and end themselves.
//!
//! With as many instructions per second as their timer has ticks, they count instructions, exactly
//! and the same on every computer.
//!
//! The emulator itself serves the console and the exit call; [`debugger`] serves files and the
//! command line and stops at a hard fault; [`log`] shows the program's log.

mod debugger;
mod log;

use std::io::Write;
use std::net::{SocketAddr, TcpListener};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::Args;
use rigless::emulator::{self, Driver, Host, Start, Stop};
use rigless::session::Session;
use rigless::time::VirtualNanos;

use super::setup::Setup;
use crate::machine::Machine;

/// Length of a slice, ns: long, as nothing outside the chip takes part.
const SLICE_NS: u64 = 100_000_000;

/// The program and its limits.
#[derive(Debug, Args)]
pub struct Count {
    #[command(flatten)]
    setup: Setup,
    /// The program's command line.
    #[arg(long, default_value = "")]
    arguments: String,
    /// The folder with the files that the program may read.
    #[arg(long, value_name = "FOLDER", default_value = ".")]
    folder: PathBuf,
    /// Stop a program that has not ended after this many seconds of virtual time.
    #[arg(long, default_value_t = 3600)]
    seconds: u64,
}

impl Count {
    /// Runs the program and passes its output to standard output. True if the program
    /// reports success.
    ///
    /// # Errors
    /// A file cannot be read, the program does not end, or the emulator failed.
    pub fn run(&self) -> Result<bool, String> {
        let loaded = self.setup.load()?;
        let mut machine = loaded.machine;
        // The entry time would count as instructions.
        machine.chip.set_interrupt_entry(0);
        let (debugger, debugger_address) = listener("debugger")?;
        let (rtt, rtt_address) = listener("log")?;
        let boot = 0x0800_0000 + u64::from(loaded.board.boot_offset);
        let segments = || loaded.images.iter().flat_map(|image| image.segments());
        let calls = debugger::calls(segments());
        let hard_fault = debugger::hard_fault(boot, segments()).ok_or("the image has no vector table")?;
        let has_failed = AtomicBool::new(false);
        let mut start = Start::new(&loaded.images);
        start.boot = Some(boot);
        start.semihosting = true;
        start.debugger = Some(&debugger);
        start.wait_for_debugger = true;
        start.rtt = Some(&rtt);
        start.interrupt = Some(&has_failed);
        let session = Session::new(Box::new(machine), 0, VirtualNanos(SLICE_NS)).map_err(|error| error.to_string())?;
        let console = Console { until_ns: self.seconds.saturating_mul(1_000_000_000), broken: None };
        let finished = std::thread::scope(|scope| {
            let log = scope.spawn(|| log::show(rtt_address, &loaded.image_path));
            let server = scope.spawn(|| {
                let served = debugger::serve(debugger_address, &self.folder, &self.arguments, &calls, hard_fault);
                has_failed.store(served.is_err(), Ordering::Relaxed);
                served
            });
            let finished = emulator::run(session, &start, console).map_err(|error| error.to_string());
            let served = server.join().map_err(|_| "the debugger's side panicked".to_owned())?;
            let logged = log.join().map_err(|_| "the log's side panicked".to_owned())?;
            let finished = finished?;
            served.or_else(|broken| broken.at_end(finished.exit_status.is_some()))?;
            logged.map(|()| finished)
        })?;
        if let Some(error) = finished.driver.broken {
            return Err(format!("the program's output cannot be written to standard output: {error}"));
        }
        match finished.exit_status {
            Some(status) => Ok(status == 0),
            None => Err(format!(
                "the program has not ended within {} s of virtual time; --seconds allows more",
                self.seconds
            )),
        }
    }
}

/// A listener on a free TCP port of this computer, and its address.
///
/// # Errors
/// No port is free; the text names what it is for.
fn listener(purpose: &str) -> Result<(TcpListener, SocketAddr), String> {
    let listen = || -> std::io::Result<_> {
        let listener = TcpListener::bind(("127.0.0.1", 0))?;
        let address = listener.local_addr()?;
        Ok((listener, address))
    };
    listen().map_err(|error| format!("no local TCP port is free for the {purpose}: {error}"))
}

/// Passes the program's output on and waits for its end.
struct Console {
    until_ns: u64,
    broken: Option<std::io::Error>,
}

impl Driver<Machine> for Console {
    fn on_stop(&mut self, session: &mut Session<Machine>, stop: Stop, _: &mut dyn Host) -> Option<VirtualNanos> {
        let now_ns = stop.at.0;
        let resets = session.resets().len();
        session.board_mut().advance(now_ns, resets);
        (now_ns < self.until_ns && self.broken.is_none()).then_some(VirtualNanos(now_ns + SLICE_NS))
    }

    fn on_console(&mut self, _: VirtualNanos, _: u64, bytes: &[u8]) {
        let mut out = std::io::stdout().lock();
        if let Err(error) = out.write_all(bytes).and_then(|()| out.flush()) {
            self.broken.get_or_insert(error);
        }
    }
}
