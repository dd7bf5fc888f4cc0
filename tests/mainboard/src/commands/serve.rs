//! Serves the machine on a line of this computer, for any host program.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::{ArgGroup, Args};
use ferrostep_host_line::damage::{DamagedLine, LineFault, share};
use rigless::emulator::Host;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag;

use super::setup::{Setup, Via, receive, send};
use crate::host::Line;
use crate::machine::Machine;
use crate::run::{Operator, Turn, run};

/// Options of the command.
#[derive(Debug, Args)]
#[command(group(ArgGroup::new("line").required(true).args(["pty", "tcp"])))]
pub struct Serve {
    #[command(flatten)]
    setup: Setup,
    /// The printer's line to serve.
    #[arg(long, value_enum, default_value_t = Via::Usb)]
    via: Via,
    /// Create a pseudo-terminal under this name.
    #[arg(long, value_name = "PATH")]
    pty: Option<PathBuf>,
    /// Listen on this TCP port of this computer (0: any free port).
    #[arg(long, value_name = "PORT")]
    tcp: Option<u16>,
    /// Virtual seconds per real second; a computer that is too slow for it delays the printer.
    #[arg(long, default_value_t = 1.0)]
    speed: f64,
    /// Damages what the host sends, at once or from @SECONDS of the printer on: drop:RATE or
    /// flip:RATE (of the bytes), drop-line:RATE or flip-line:RATE (of the lines), with RATE such as
    /// 1%. Can be repeated.
    #[arg(long, value_name = "KIND[@SECONDS]", value_parser = damage)]
    fault: Vec<Damage>,
}

/// Damage to the host's line.
#[derive(Clone, Copy, Debug)]
struct Damage {
    fault: LineFault,
    share: f64,
    /// Start of the fault, ns of the machine's time.
    from_ns: u64,
}

fn damage(text: &str) -> Result<Damage, String> {
    let (kind, seconds) = text.split_once('@').unwrap_or((text, "0"));
    let seconds = seconds.parse().ok().and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    let from = seconds.ok_or("write the time after the @ in seconds, for example flip-line:1%@90")?;
    let (fault, rate) = kind.split_once(':').unwrap_or((kind, ""));
    let fault = LineFault::named(fault)
        .ok_or("unknown fault, expected drop:RATE, flip:RATE, drop-line:RATE or flip-line:RATE")?;
    Ok(Damage { fault, share: share(rate)?, from_ns: u64::try_from(from.as_nanos()).unwrap_or(u64::MAX) })
}

/// Connects the line of this computer to the line of the machine.
struct HostBridge {
    line: Line,
    via: Via,
    damaged: DamagedLine,
    /// Damage that is still to begin.
    damage: Vec<Damage>,
    plugged: bool,
    speed: f64,
    began: Instant,
    failed: Option<String>,
    /// Set by a signal that asks the program to end, so that the line is removed before it does.
    stops: Arc<AtomicBool>,
}

/// Virtual time between two comparisons of the clocks, ns.
const PACE_NS: u64 = 1_000_000;

/// Maximum bytes that are taken from the host at once.
const MAX_READ: usize = 4096;

/// Maximum delay that the machine catches up. A larger one stays: a host would see a
/// printer that races.
const PATIENCE: Duration = Duration::from_millis(100);

impl HostBridge {
    /// Waits until this computer's clock reaches the machine's.
    fn keep_pace(&mut self, now_ns: u64) {
        let due = Duration::from_secs_f64(now_ns as f64 / 1e9 / self.speed);
        let passed = self.began.elapsed();
        if let Some(ahead) = due.checked_sub(passed) {
            std::thread::sleep(ahead);
        } else if passed - due > PATIENCE {
            self.began += passed - due;
        }
    }
}

impl Operator for HostBridge {
    fn turn(&mut self, machine: &mut Machine, now_ns: u64, _: &mut dyn Host) -> Turn {
        if self.stops.load(Ordering::Relaxed) {
            return Turn::Stop;
        }
        if self.via == Via::Usb && !self.plugged {
            self.plugged = true;
            machine.usb_host.plug();
        }
        if now_ns % PACE_NS < crate::run::SLICE_NS {
            self.keep_pace(now_ns);
            for Damage { fault, share, .. } in self.damage.extract_if(.., |damage| damage.from_ns <= now_ns) {
                self.damaged.add(fault, share);
            }
            let read = self.line.read(MAX_READ).map_err(|error| error.to_string());
            let written = match read {
                Ok(mut bytes) => {
                    self.damaged.carry(&mut bytes);
                    send(machine, self.via, now_ns, &bytes);
                    self.line.write(&receive(machine, self.via)).map_err(|error| error.to_string())
                }
                Err(error) => Err(error),
            };
            if let Err(error) = written {
                self.failed = Some(error);
                return Turn::Stop;
            }
        }
        Turn::Continue
    }
}

impl Serve {
    /// Serves until a signal interrupts it.
    ///
    /// # Errors
    /// The line is in use, a file cannot be read, the files contradict each other,
    /// or the line broke.
    pub fn run(&self) -> Result<bool, String> {
        if !(self.speed > 0.0 && self.speed.is_finite()) {
            return Err(format!("--speed {}: write a number above 0; 1 is real time", self.speed));
        }
        // Registered before the line exists, so that the line never outlives the program.
        let stops = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM, SIGHUP] {
            flag::register(signal, Arc::clone(&stops)).map_err(|error| error.to_string())?;
        }
        let line = match (&self.pty, self.tcp) {
            (Some(path), _) => Line::pty(path)?,
            (None, Some(port)) => Line::tcp(port)?,
            (None, None) => return Err("no line to serve on: add --pty PATH or --tcp PORT".to_owned()),
        };
        let mut loaded = self.setup.load()?;
        eprintln!("{} on {}", loaded.board.title, line.address());
        let spare = Machine::new(&loaded.board, &loaded.printer, 0)?;
        let mut machine = std::mem::replace(&mut loaded.machine, spare);
        machine.stop_recording_steps();
        let bridge = HostBridge {
            line,
            via: self.via,
            damaged: DamagedLine::default(),
            damage: self.fault.clone(),
            plugged: false,
            speed: self.speed,
            began: Instant::now(),
            failed: None,
            stops,
        };
        let finished = run(machine, &loaded.images, &loaded.options(), bridge).map_err(|error| error.to_string())?;
        finished.operator.failed.map_or(Ok(true), Err)
    }
}
