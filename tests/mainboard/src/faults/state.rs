//! The states of a printer in which faults occur, and a run through all of them that takes a
//! snapshot in each.

use std::io::Write as _;
use std::path::Path;

use rigless::emulator::Host;
use rigless::snapshot::{Snapshot, Taken};
use serde::Serialize;

use super::bench::Bench;
use super::host_side::HostSide;
use crate::machine::Machine;
use crate::run::{self, Operator, Options, Turn};

const SECOND: u64 = 1_000_000_000;
/// Targets of nozzle and bed, degrees Celsius.
pub const TARGETS_CELSIUS: [f64; 2] = [200.0, 40.0];
/// Time without a host after which the heaters go off, s: set by M86, so that a run need not
/// last half an hour.
pub const HEATER_TIMEOUT_S: u64 = 30;

/// S of the G4 of [`State::Waiting`].
pub const DWELL_S: u64 = 10;
/// Virtual time limit of the run through all states, ns.
const LIMIT_NS: u64 = 400 * SECOND;
/// Maximum number of the job's moves to print.
const MAX_LINES: usize = 160;

/// The state of the printer at the instant of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum State {
    /// The start, from power-on until the drivers are confirmed.
    Boot,
    /// Cold, motors without current.
    Idle,
    /// Heats nozzle and bed, waits for the nozzle (M109).
    Heating,
    /// G28, hot.
    Homing,
    /// Waits (G4), hot and homed.
    Waiting,
    /// The first layer of a cube, hot.
    Printing,
    /// Halted by M112 during a print.
    Halted,
}

impl State {
    /// All states, in the order of the run.
    pub const ALL: [Self; 7] =
        [Self::Boot, Self::Idle, Self::Heating, Self::Homing, Self::Waiting, Self::Printing, Self::Halted];

    /// The name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Boot => "boot",
            Self::Idle => "idle",
            Self::Heating => "heating",
            Self::Homing => "homing",
            Self::Waiting => "waiting",
            Self::Printing => "printing",
            Self::Halted => "halted",
        }
    }

    /// True if heaters have targets in this state.
    #[must_use]
    pub const fn is_hot(self) -> bool {
        matches!(self, Self::Heating | Self::Homing | Self::Waiting | Self::Printing)
    }

    /// True if the printer knows its position.
    #[must_use]
    pub const fn is_homed(self) -> bool {
        matches!(self, Self::Waiting | Self::Printing)
    }

    /// The time after a snapshot within which a fault may occur, ns.
    #[must_use]
    pub const fn window_ns(self) -> u64 {
        match self {
            Self::Boot => 120_000_000,
            Self::Idle | Self::Halted => 500_000_000,
            Self::Heating | Self::Homing | Self::Waiting | Self::Printing => 1_500_000_000,
        }
    }
}

/// A point from which runs with faults start.
#[derive(Debug)]
pub struct StartingPoint {
    /// The state of the printer.
    pub state: State,
    /// The instant of the snapshot, ns of the run.
    pub at_ns: u64,
    /// Chip and parts.
    pub snapshot: Snapshot,
    /// The host's state at that instant.
    pub host: HostSide,
    /// The motors' positions X, Y, Z minus the position that the printer reports, mm, when it
    /// stands still after homing.
    pub offset_mm: [f64; 3],
}

/// The moves of a job without heating and homing, with a request for the temperature
/// after every eighth.
#[must_use]
pub fn moves(job: &str) -> Vec<String> {
    let mut lines = Vec::new();
    let body = job.lines().skip_while(|line| !line.starts_with("G28")).skip(1);
    for line in body {
        let line = line.split(';').next().unwrap_or_default().trim();
        if line.is_empty() || ["M190", "M109", "M140", "M104", "M73"].iter().any(|word| line.starts_with(word)) {
            continue;
        }
        lines.push(line.to_owned());
        if lines.len() % 8 == 0 {
            lines.push("M105".to_owned());
        }
        if lines.len() >= MAX_LINES {
            break;
        }
    }
    lines
}

/// Condition of the next snapshot.
#[derive(Debug, Clone, Copy)]
enum Due {
    /// An instant of the run.
    At(u64),
    /// A time after the host has sent the line that begins with this text, ns.
    After(&'static str, u64),
    /// The nozzle's true temperature reaches this, degrees Celsius.
    NozzleAt(f64),
}

/// Snapshots in the order in which they are taken.
const PLAN: [(State, Due); 13] = [
    (State::Boot, Due::At(0)),
    (State::Boot, Due::At(60_000_000)),
    (State::Idle, Due::At(1_500_000_000)),
    (State::Heating, Due::NozzleAt(40.0)),
    (State::Heating, Due::NozzleAt(150.0)),
    (State::Homing, Due::After("G28", 500_000_000)),
    (State::Homing, Due::After("G28", 3_000_000_000)),
    (State::Homing, Due::After("G28", 6_000_000_000)),
    (State::Homing, Due::After("G28", 8_500_000_000)),
    (State::Waiting, Due::After("G4", 500_000_000)),
    (State::Printing, Due::After("G92", 1_500_000_000)),
    (State::Printing, Due::After("G92", 6_000_000_000)),
    (State::Halted, Due::After("M112", 500_000_000)),
];

/// A snapshot as it was taken.
struct TakenSnapshot {
    state: State,
    at_ns: u64,
    file: Vec<u8>,
    host: HostSide,
}

/// The operator that leads the printer through all states.
struct StateTour {
    host: HostSide,
    /// The lines to send after the idle state.
    rest: Vec<String>,
    next: usize,
    began_ns: [Option<u64>; 4],
    stopped: bool,
    wants: bool,
    offset_mm: [f64; 3],
    taken: Vec<TakenSnapshot>,
    now_ns: u64,
    refused: Option<String>,
}

/// Lines whose instant of sending is recorded. Each is sent after the line before it
/// is acknowledged.
const MARKS: [&str; 4] = ["G28", "G4", "G92", "M112"];

impl StateTour {
    fn new(printing: Vec<String>) -> Self {
        let [nozzle, bed] = TARGETS_CELSIUS;
        let first = ["M155 S1".to_owned(), format!("M86 S{HEATER_TIMEOUT_S}"), "M115".to_owned()];
        let mut lines = vec![
            format!("M140 S{bed}"),
            format!("M109 S{nozzle}"),
            "G28".to_owned(),
            "M114".to_owned(),
            format!("G4 S{DWELL_S}"),
            "G92 E0".to_owned(),
        ];
        lines.extend(printing);
        Self {
            host: HostSide::new(first),
            rest: lines,
            next: 0,
            began_ns: [None; 4],
            stopped: false,
            wants: false,
            offset_mm: [0.0; 3],
            taken: Vec::new(),
            now_ns: 0,
            refused: None,
        }
    }

    fn due(&self, machine: &Machine, now_ns: u64, due: Due) -> bool {
        match due {
            Due::At(at_ns) => now_ns >= at_ns,
            Due::After(mark, passed_ns) => MARKS
                .iter()
                .position(|other| *other == mark)
                .and_then(|mark| self.began_ns[mark])
                .is_some_and(|began_ns| now_ns >= began_ns + passed_ns),
            Due::NozzleAt(celsius) => machine
                .plant
                .heaters
                .iter()
                .any(|place| place.name.starts_with("nozzle") && place.heater.hottest_celsius() >= celsius),
        }
    }

    fn follow_marks(&mut self, now_ns: u64) {
        let Some(line) = self.host.line_on_its_way() else { return };
        for (mark, text) in MARKS.iter().enumerate() {
            if line.starts_with(text) && self.began_ns[mark].is_none() {
                self.began_ns[mark] = Some(now_ns);
            }
        }
    }
}

/// The position in a reply to M114: `X:176.40 Y:24.10 Z:4.00 E:0.00 Count ...`.
#[must_use]
pub fn position_mm(line: &str) -> Option<[f64; 3]> {
    let mut place = [None; 3];
    for word in line.split("Count").next()?.split_whitespace() {
        for (axis, letter) in ["X:", "Y:", "Z:"].into_iter().enumerate() {
            if let Some(rest) = word.strip_prefix(letter) {
                place[axis] = rest.parse().ok();
            }
        }
    }
    let [Some(x), Some(y), Some(z)] = place else { return None };
    Some([x, y, z])
}

impl Operator for StateTour {
    fn turn(&mut self, machine: &mut Machine, now_ns: u64, _: &mut dyn Host) -> Turn {
        self.now_ns = now_ns;
        let heard = self.host.heard().len();
        self.host.turn(machine, now_ns);
        self.follow_marks(now_ns);
        for line in &self.host.heard()[heard..] {
            if let Some(said_mm) = position_mm(&line.text) {
                self.offset_mm = std::array::from_fn(|axis| machine.plant.motion.position_mm(axis) - said_mm[axis]);
            }
            if line.text.starts_with("Error") && !self.stopped {
                self.refused =
                    Some(format!("the printer reported an error at {:.3} s: \"{}\"", now_ns as f64 / 1e9, line.text));
            }
        }
        let Some(&(state, due)) = PLAN.get(self.next) else { return Turn::Stop };
        if state > State::Idle {
            for line in std::mem::take(&mut self.rest) {
                self.host.push(&line);
            }
        }
        if matches!(due, Due::After("M112", _)) && !self.stopped {
            self.stopped = true;
            self.host.push_urgent("M112");
            self.began_ns[3] = Some(now_ns);
        }
        self.wants = self.due(machine, now_ns, due);
        if now_ns > LIMIT_NS {
            self.refused = {
                let (state, due) = PLAN[self.next];
                let limit_s = LIMIT_NS / SECOND;
                Some(format!("the printer did not reach the state {} ({due:?}) within {limit_s} s", state.name()))
            };
        }
        if self.refused.is_some() { Turn::Stop } else { Turn::Continue }
    }

    fn wants_snapshot(&mut self) -> bool {
        std::mem::take(&mut self.wants)
    }

    fn snapshot_taken(&mut self, snapshot: Result<Taken, rigless::snapshot::Error>) {
        match snapshot {
            Ok(snapshot) => {
                let state = PLAN[self.next].0;
                let (at_ns, host) = (self.now_ns, self.host.clone());
                self.taken.push(TakenSnapshot { state, at_ns, file: snapshot.file, host });
                self.next += 1;
            }
            // A reset is in progress: the next turn tries again.
            Err(rigless::snapshot::Error::Resetting) => {}
            Err(error) => self.refused = Some(format!("the emulator took no snapshot: {error}")),
        }
    }
}

/// Leads the printer through all states once.
///
/// # Errors
/// The printer does not reach all states, or a snapshot cannot be written to this folder, which
/// is left unchanged.
pub fn starting_points(bench: &Bench, folder: &Path) -> Result<Vec<StartingPoint>, String> {
    let options = Options { boot: bench.boot, ..Options::default() };
    let guide = StateTour::new(moves(&bench.job));
    let finished =
        run::run(bench.machine()?, &bench.images, &options, guide).map_err(|error| error.to_string())?.operator;
    if let Some(refused) = finished.refused {
        return Err(refused);
    }
    let offset_mm = finished.offset_mm;
    finished
        .taken
        .into_iter()
        .map(|TakenSnapshot { state, at_ns, file, host }| {
            let file_error = |error: std::io::Error| {
                format!(
                    "{}: the snapshot cannot be written: {error}; check the folder's space and rights",
                    folder.display()
                )
            };
            let mut kept = tempfile::NamedTempFile::new_in(folder).map_err(file_error)?;
            kept.write_all(&file).map_err(file_error)?;
            let snapshot = Snapshot::read(kept.path()).map_err(|error| format!("{}: {error}", kept.path().display()));
            Ok(StartingPoint { state, at_ns, snapshot: snapshot?, host, offset_mm })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_position_of_m114_is_parsed() {
        let line = "X:176.40 Y:24.10 Z:4.00 E:0.00 Count X:17640 Y:2410 Z:1600";
        assert_eq!(position_mm(line), Some([176.4, 24.1, 4.0]));
        assert_eq!(position_mm("ok"), None);
    }

    #[test]
    fn a_job_is_reduced_to_its_moves() {
        let job = "G21\nM104 S210\nG28\nM109 S210 ; wait\nG1 X1\n; text\nG1 X2 ; there\n";
        assert_eq!(moves(job), ["G1 X1", "G1 X2"]);
    }
}
