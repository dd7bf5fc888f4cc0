//! The Buddy board with the image under test, and a host on its serial line.

use std::collections::VecDeque;
use std::env;
use std::num::NonZeroU64;
use std::path::{Path, PathBuf};

use ferrostep_mainboard::commands::setup::{Via, receive, send};
use ferrostep_mainboard::machine::Machine;
use ferrostep_mainboard::run::{Finished, Operator, Options, Turn, run};
use ferrostep_mainboard::wiring::{Board, Printer, check_image};
use rigless::emulator::Host;
use rigless::image::Image;

use super::stub::{self, Stub};

pub const MS: u64 = 1_000_000;
pub const S: u64 = 1_000 * MS;

/// The properties of a machine.
#[derive(Debug, Clone, Default)]
pub struct Setting {
    /// Instructions per second and entry of the step interrupt, ns; `None` for the defaults.
    pub pace: Option<(u64, u64)>,
    /// Clock enables take effect late.
    pub late_clocks: bool,
    /// A boot loader that runs before the image.
    pub boot_loader: Option<Stub>,
}

/// The host: sends one line after the other, each after the acknowledgement of the one before.
#[derive(Debug, Default)]
pub struct HostTalk {
    begun: String,
    /// The received lines with their instants.
    pub heard: Vec<(u64, String)>,
    to_say: VecDeque<String>,
    waits: bool,
    starts: usize,
}

impl HostTalk {
    pub fn say(&mut self, line: &str) {
        self.to_say.push_back(line.to_owned());
    }

    /// True if all lines are acknowledged.
    pub fn is_quiet(&self) -> bool {
        self.starts > 0 && self.to_say.is_empty() && !self.waits
    }

    /// The number of lines that are not sent yet.
    pub fn remaining(&self) -> usize {
        self.to_say.len()
    }

    /// True if the image has started this many times.
    pub fn has_started(&self, times: usize) -> bool {
        self.starts >= times
    }

    pub fn heard(&self, words: &str) -> Option<u64> {
        self.heard.iter().find(|(_, line)| line.contains(words)).map(|(at_ns, _)| *at_ns)
    }

    /// All lines in one text, for messages.
    pub fn text(&self) -> String {
        self.heard.iter().map(|(at_ns, line)| format!("\n    {:9.3} ms {line}", *at_ns as f64 / 1e6)).collect()
    }

    fn turn(&mut self, machine: &mut Machine, now_ns: u64) {
        for byte in receive(machine, Via::Uart) {
            if byte != b'\n' {
                self.begun.push(char::from(byte));
                continue;
            }
            let line = std::mem::take(&mut self.begun).trim().to_owned();
            if line == "start" {
                self.starts += 1;
                self.waits = false;
            } else if line.starts_with("ok") {
                self.waits = false;
            }
            self.heard.push((now_ns, line));
        }
        if !self.waits
            && self.starts > 0
            && let Some(line) = self.to_say.pop_front()
        {
            self.waits = true;
            send(machine, Via::Uart, now_ns, format!("{line}\n").as_bytes());
        }
    }
}

/// The access of a scenario to the machine in a turn.
pub struct Stage<'a> {
    pub machine: &'a mut Machine,
    pub now_ns: u64,
    pub talk: &'a mut HostTalk,
}

impl Stage<'_> {
    pub fn fan(&self, name: &str) -> f64 {
        self.machine.plant.fans.iter().find(|fan| fan.name == name).unwrap().power
    }

    pub fn heater(&self, name: &str) -> f64 {
        self.machine.plant.heaters.iter().find(|heater| heater.name == name).unwrap().power
    }
}

/// The events of a test.
pub trait Scenario: Send + 'static {
    fn turn(&mut self, stage: &mut Stage<'_>) -> Turn;
}

/// A scenario with its host.
pub struct ScenarioRun<P> {
    pub scenario: P,
    pub talk: HostTalk,
    ends_ns: u64,
    /// The scenario ended before the time limit.
    pub ended: bool,
}

impl<P: Scenario> Operator for ScenarioRun<P> {
    fn turn(&mut self, machine: &mut Machine, now_ns: u64, _: &mut dyn Host) -> Turn {
        self.talk.turn(machine, now_ns);
        self.ended = self.scenario.turn(&mut Stage { machine, now_ns, talk: &mut self.talk }) == Turn::Stop;
        if self.ended || now_ns >= self.ends_ns { Turn::Stop } else { Turn::Continue }
    }
}

fn file(variable: &str, in_repository: &str) -> PathBuf {
    env::var_os(variable)
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(in_repository), PathBuf::from)
}

/// Runs a scenario up to a time limit.
pub fn run_scenario<P: Scenario>(setting: &Setting, at_most_ns: u64, scenario: P) -> Finished<ScenarioRun<P>> {
    let board = Board::read(&file("FERROSTEP_BOARD", "config/boards/prusa-buddy.toml")).unwrap();
    let printer = Printer::read(&file("FERROSTEP_PROFILE", "config/profiles/prusa-mini.toml")).unwrap();
    let path = file("FERROSTEP_IMAGE", "target/images/prusa-buddy/ferrostep.elf");
    let bytes = std::fs::read(&path).unwrap_or_else(|error| {
        panic!("{}: {error}; build it with `cargo xtask firmware --board prusa-buddy`", path.display())
    });
    let start = check_image(&board, &path.display().to_string(), &bytes).unwrap().start;
    let mut images = vec![Image::new(&path, bytes, None).unwrap()];
    let mut boot = start;
    if let Some(boot_loader) = &setting.boot_loader {
        images.push(boot_loader.image(start));
        boot = stub::BASE;
    }
    let mut machine = Machine::new(&board, &printer, 1).unwrap();
    if setting.late_clocks {
        machine.chip.start_clocks_late();
    }
    if let Some((rate, entry_ns)) = setting.pace {
        machine.set_instructions_per_second(NonZeroU64::new(rate).unwrap());
        machine.chip.set_interrupt_entry(entry_ns);
    }
    let options = Options { boot: Some(u64::from(boot)), ..Options::default() };
    let operator = ScenarioRun { scenario, talk: HostTalk::default(), ends_ns: at_most_ns, ended: false };
    run(machine, &images, &options, operator).unwrap()
}

/// Sends lines and ends when all are acknowledged.
pub struct SendLines {
    lines: Vec<String>,
}

impl SendLines {
    pub fn lines(lines: &[&str]) -> Self {
        Self { lines: lines.iter().map(ToString::to_string).collect() }
    }
}

impl Scenario for SendLines {
    fn turn(&mut self, stage: &mut Stage<'_>) -> Turn {
        for line in self.lines.drain(..) {
            stage.talk.say(&line);
        }
        if stage.talk.is_quiet() { Turn::Stop } else { Turn::Continue }
    }
}
