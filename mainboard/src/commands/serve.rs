//! The machine on a line of this computer, for anybody's host.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::Args;
use rigless::emulator::Host;

use super::setup::{Setup, Via, hear, say};
use crate::host::Line;
use crate::machine::Machine;
use crate::run::{Operator, Turn, run};

/// Words of the command.
#[derive(Debug, Args)]
pub struct Serve {
    #[command(flatten)]
    setup: Setup,
    /// The line of the printer that is led out.
    #[arg(long, value_enum, default_value_t = Via::Usb)]
    via: Via,
    /// A pseudo-terminal, under this name.
    #[arg(long, value_name = "PATH", required_unless_present = "tcp", conflicts_with = "tcp")]
    pty: Option<PathBuf>,
    /// A port of this computer (0: any that is free).
    #[arg(long, value_name = "PORT")]
    tcp: Option<u16>,
    /// Virtual time for a second of this computer's; the machine runs as fast as it can if it cannot keep up.
    #[arg(long, default_value_t = 1.0)]
    speed: f64,
}

/// Between the line of this computer and that of the machine.
struct Door {
    line: Line,
    via: Via,
    plugged: bool,
    speed: f64,
    began: Instant,
    failed: Option<String>,
}

/// How often the clocks are compared: each this many ns of virtual time.
const PACE_NS: u64 = 1_000_000;

impl Operator for Door {
    fn turn(&mut self, machine: &mut Machine, now_ns: u64, _: &mut dyn Host) -> Turn {
        if self.via == Via::Usb && !self.plugged {
            self.plugged = true;
            machine.usb_host.plug();
        }
        if now_ns % PACE_NS < crate::run::SLICE_NS {
            let due = Duration::from_secs_f64(now_ns as f64 / 1e9 / self.speed);
            if let Some(ahead) = due.checked_sub(self.began.elapsed()) {
                std::thread::sleep(ahead);
            }
            let read = self.line.read().map_err(|error| error.to_string());
            let written = match read {
                Ok(bytes) => {
                    say(machine, self.via, now_ns, &bytes);
                    self.line.write(&hear(machine, self.via)).map_err(|error| error.to_string())
                }
                Err(error) => Err(error),
            };
            if let Err(error) = written {
                self.failed = Some(error);
                return Turn::Stop;
            }
        }
        Turn::GoOn
    }
}

impl Serve {
    /// Serves until it is interrupted.
    ///
    /// # Errors
    /// The line is in use, what was named cannot be read or does not fit together, or the line broke.
    pub fn run(&self) -> Result<bool, String> {
        if !(self.speed > 0.0 && self.speed.is_finite()) {
            return Err(format!("--speed {}: expected more than 0; 1 is real time", self.speed));
        }
        let line = match (&self.pty, self.tcp) {
            (Some(path), _) => Line::pty(path)?,
            (None, Some(port)) => Line::tcp(port)?,
            (None, None) => return Err("--pty PATH or --tcp PORT: one of them is needed".to_owned()),
        };
        let mut bench = self.setup.bench()?;
        eprintln!("{} on {}", bench.board.title, line.address());
        let spare = Machine::new(&bench.board, &bench.printer, 0)?;
        let machine = std::mem::replace(&mut bench.machine, spare);
        let door = Door { line, via: self.via, plugged: false, speed: self.speed, began: Instant::now(), failed: None };
        let finished = run(machine, &bench.images, &bench.options(), door).map_err(|error| error.to_string())?;
        finished.operator.failed.map_or(Ok(true), Err)
    }
}
