//! The Buddy board with the image under test, and a host on its serial line.

use std::collections::VecDeque;
use std::env;
use std::num::NonZeroU64;
use std::path::{Path, PathBuf};

use ferrostep_mainboard::commands::setup::{Via, hear, say};
use ferrostep_mainboard::machine::Machine;
use ferrostep_mainboard::run::{Finished, Operator, Options, Turn, run};
use ferrostep_mainboard::wiring::{Board, Printer, check_image};
use rigless::emulator::Host;
use rigless::image::Image;

use super::stub::{self, Stub};

pub const MS: u64 = 1_000_000;
pub const S: u64 = 1_000 * MS;

/// How a machine is put together.
#[derive(Debug, Clone, Default)]
pub struct Setting {
    /// Instructions a second and entry of the step interrupt, ns; none: the usual ones.
    pub pace: Option<(u64, u64)>,
    /// Clock enables take effect late.
    pub late_clocks: bool,
    /// What runs before the image.
    pub boot_loader: Option<Stub>,
}

/// The host: says one line after the other, each when the one before is acknowledged.
#[derive(Debug, Default)]
pub struct Talk {
    begun: String,
    /// What was heard, and when.
    pub heard: Vec<(u64, String)>,
    to_say: VecDeque<String>,
    waits: bool,
    starts: usize,
}

impl Talk {
    pub fn say(&mut self, line: &str) {
        self.to_say.push_back(line.to_owned());
    }

    /// Whether all lines are acknowledged.
    pub fn is_quiet(&self) -> bool {
        self.starts > 0 && self.to_say.is_empty() && !self.waits
    }

    /// Lines that are not said yet.
    pub fn remaining(&self) -> usize {
        self.to_say.len()
    }

    /// Whether the image has said hello so often.
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
        for byte in hear(machine, Via::Uart) {
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
            say(machine, Via::Uart, now_ns, format!("{line}\n").as_bytes());
        }
    }
}

/// What a plot sees and does in a turn.
pub struct Stage<'a> {
    pub machine: &'a mut Machine,
    pub now_ns: u64,
    pub talk: &'a mut Talk,
}

impl Stage<'_> {
    pub fn fan(&self, name: &str) -> f64 {
        self.machine.plant.fans.iter().find(|fan| fan.name == name).unwrap().power
    }

    pub fn heater(&self, name: &str) -> f64 {
        self.machine.plant.heaters.iter().find(|heater| heater.name == name).unwrap().power
    }
}

/// What happens in a scene.
pub trait Plot: Send + 'static {
    fn turn(&mut self, stage: &mut Stage<'_>) -> Turn;
}

/// A plot with its host.
pub struct Play<P> {
    pub plot: P,
    pub talk: Talk,
    ends_ns: u64,
    /// Whether it came to its end before time was up.
    pub ended: bool,
}

impl<P: Plot> Operator for Play<P> {
    fn turn(&mut self, machine: &mut Machine, now_ns: u64, _: &mut dyn Host) -> Turn {
        self.talk.turn(machine, now_ns);
        self.ended = self.plot.turn(&mut Stage { machine, now_ns, talk: &mut self.talk }) == Turn::Stop;
        if self.ended || now_ns >= self.ends_ns { Turn::Stop } else { Turn::GoOn }
    }
}

fn file(variable: &str, in_repository: &str) -> PathBuf {
    env::var_os(variable)
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join(in_repository), PathBuf::from)
}

/// Plays a plot, for this long at most.
pub fn play<P: Plot>(setting: &Setting, at_most_ns: u64, plot: P) -> Finished<Play<P>> {
    let board = Board::read(&file("FERROSTEP_BOARD", "boards/prusa-buddy.toml")).unwrap();
    let printer = Printer::read(&file("FERROSTEP_PROFILE", "profiles/prusa-mini.toml")).unwrap();
    let path = file("FERROSTEP_IMAGE", "target/images/prusa-buddy/ferrostep.elf");
    let bytes = std::fs::read(&path).unwrap_or_else(|error| {
        panic!("{}: {error}; `cargo xtask firmware --board prusa-buddy` builds it", path.display())
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
    let play = Play { plot, talk: Talk::default(), ends_ns: at_most_ns, ended: false };
    run(machine, &images, &options, play).unwrap()
}

/// Says lines and ends when all are acknowledged.
pub struct Say {
    lines: Vec<String>,
}

impl Say {
    pub fn lines(lines: &[&str]) -> Self {
        Self { lines: lines.iter().map(ToString::to_string).collect() }
    }
}

impl Plot for Say {
    fn turn(&mut self, stage: &mut Stage<'_>) -> Turn {
        for line in self.lines.drain(..) {
            stage.talk.say(&line);
        }
        if stage.talk.is_quiet() { Turn::Stop } else { Turn::GoOn }
    }
}
