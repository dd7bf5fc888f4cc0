//! Report on a black box: records with their times, and the last steps, played again.

mod place;

use std::fmt::{self, Write};

use ferrostep_black_box::{Contents, HeaterSample, Record, Stamped};
use ferrostep_planner::kinematics::UNITS_PER_MM;
use ferrostep_planner::{StepDigests, StepObserver};
use ferrostep_printer::Profile;
use ferrostep_step_player::{PastSlot, PositionMark, Replayed, replay};
use serde::Serialize;

pub use place::Image;

use ferrostep_host::printable::one_line;

/// Gap after the last event of a motion, ticks: at this the motors may have stood for any time.
const REST_RELOAD: u32 = ferrostep_step_player::IDLE_TICKS - 1;

/// The kind of the record that a panic or a fault leaves.
const LAST_WORDS: &str = "last words";

/// Contents of a black box, for a person or as JSON.
#[derive(Clone, Debug, Serialize)]
pub struct BlackBoxReport {
    /// The board that has sent it.
    pub board: String,
    /// Name of the profile.
    pub profile: String,
    /// Version of its firmware.
    pub version: String,
    /// A stop or a reset has left the steps, and nothing has moved since.
    pub is_kept: bool,
    /// True if the board has a memory for records.
    pub has_memory: bool,
    /// True if slots of the queue were damaged and are left out.
    pub is_damaged: bool,
    /// The records, the oldest first.
    pub records: Vec<RecordLine>,
    /// Records that cannot be read.
    pub damaged_records: u32,
    /// The last steps.
    pub steps: StepsReport,
}

/// A record.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RecordLine {
    /// Time since the start of the program that wrote it, s.
    pub time_s: f64,
    /// `command`, `temperatures`, `chamber`, `driver`, `halt`, `reset` or `last words`.
    pub kind: &'static str,
    /// Line in the file or of its host, for a command.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub line: Option<u32>,
    /// The record in words.
    pub text: String,
    /// Place in the source, for last words with an address, if the image is available.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub place: Option<String>,
}

/// The steps of the queue.
#[derive(Clone, Debug, Serialize)]
pub struct StepsReport {
    /// Slots of the queue that were begun, and those that were not.
    pub slots: [u32; 2],
    /// Step events that were made.
    pub events: u64,
    /// Motions, between which the motors stood for a time that is not known.
    pub motions: u32,
    /// Ticks a second.
    pub tick_hz: u32,
    /// Ticks from the first step to the last, rests left out.
    pub ticks: u64,
    /// Steps made, forwards minus backwards, by motor.
    pub made: [i64; 4],
    /// Steps that waited in the queue, the same.
    pub not_made: [i64; 4],
    /// Positions of the motors at the end, steps from their origin; unknown without a position
    /// mark from the board.
    pub motor_steps: Option<[i64; 4]>,
    /// The same of X, Y and Z, mm; without the profile it is not known.
    pub position_mm: Option<[f64; 3]>,
    /// Digest of the order of the steps.
    pub order_digest: String,
    /// Digest of the steps with their times.
    pub step_digest: String,
}

/// Steps that a replay adds up.
#[derive(Clone, Copy, Default)]
struct Sum {
    steps: [i64; 4],
    events: u64,
    first: Option<u64>,
    last: u64,
}

impl Sum {
    fn add(&mut self, step: Replayed) {
        self.events += 1;
        self.first.get_or_insert(step.tick);
        self.last = step.tick;
        for (motor, steps) in self.steps.iter_mut().enumerate() {
            let sign = if step.backwards >> motor & 1 == 1 { -1 } else { 1 };
            *steps += i64::from(step.axes >> motor & 1) * sign;
        }
    }
}

/// Plays the steps that the motors have made, in order.
pub fn replay_made(contents: &Contents<'_>, stepped: impl FnMut(Replayed)) {
    replay_events(contents, contents.events_played(), stepped);
}

fn replay_events(contents: &Contents<'_>, events: u64, stepped: impl FnMut(Replayed)) {
    let slots: Vec<PastSlot> = contents.slots.clone().collect();
    replay(&slots, contents.both_edges, contents.pulse_ticks, contents.past.directions, events, stepped);
}

fn sum(contents: &Contents<'_>, events: u64) -> Sum {
    let mut sum = Sum::default();
    replay_events(contents, events, |step| sum.add(step));
    sum
}

/// Motor positions before the first slot, steps; `None` without a position mark.
fn origin(contents: &Contents<'_>) -> Option<[i64; 4]> {
    let slots: Vec<PastSlot> = contents.slots.clone().collect();
    contents.past.positions.iter().flatten().find_map(|mark: &PositionMark| {
        let place = usize::try_from(mark.filled).ok().filter(|place| *place <= slots.len())?;
        let before: u64 = slots.get(..place)?.iter().map(|slot| u64::from(slot.events)).sum();
        // The position includes the held event, which became the first of the next slot. The end of
        // a pulse is not a step.
        let held = match (contents.both_edges, slots.get(place)) {
            (true, Some(_)) => 1,
            (true, None)
                if place.checked_sub(1).and_then(|last| slots.get(last)).is_some_and(|last| last.then != 0) =>
            {
                return None;
            }
            _ => 0,
        };
        let there = sum(contents, before + held).steps;
        Some(std::array::from_fn(|motor| i64::from(mark.motor_steps[motor]) - there[motor]))
    })
}

impl BlackBoxReport {
    /// Adds the places in the source for the addresses in last words.
    pub fn locate(&mut self, image: &Image) {
        for record in self.records.iter_mut().filter(|record| record.kind == LAST_WORDS) {
            record.place = image.place(&record.text);
        }
    }

    /// Reads the contents of a black box. `profile` is its machine's, if known.
    pub fn new(contents: &Contents<'_>, profile: Option<&Profile>) -> Self {
        let mut damaged_records = 0;
        let mut records = Vec::new();
        for record in contents.records.clone() {
            match record {
                Some(stamped) => records.push(record_line(&stamped)),
                None => damaged_records += 1,
            }
        }
        let identity = contents.identity;
        Self {
            board: identity.board.to_owned(),
            profile: identity.profile.to_owned(),
            version: identity.version.to_owned(),
            is_kept: contents.past.is_kept,
            has_memory: contents.has_memory,
            is_damaged: contents.is_damaged,
            records,
            damaged_records,
            steps: StepsReport::new(contents, profile),
        }
    }
}

impl StepsReport {
    fn new(contents: &Contents<'_>, profile: Option<&Profile>) -> Self {
        let begun = contents.past.next;
        let mut digests = StepDigests::default();
        let mut made = Sum::default();
        replay_made(contents, |step| {
            digests.stepped(step.tick, step.axes, step.backwards);
            made.add(step);
        });
        let all = sum(contents, u64::MAX);
        let motor_steps = origin(contents).map(|origin| add(origin, made.steps));
        let position_mm = motor_steps.zip(profile).map(|([x, y, z, _], profile)| {
            profile.geometry().position_10nm([x, y, z]).map(|units| units as f64 / UNITS_PER_MM as f64)
        });
        let is_rest = |slot: &PastSlot| slot.then == 0 && slot.reload == REST_RELOAD;
        let ends = contents.slots.clone().take(begun as usize).filter(is_rest).count() as u32;
        let goes_on = contents.slots.clone().take(begun as usize).last().is_some_and(|slot| !is_rest(&slot));
        Self {
            slots: [begun, contents.past.filled - begun],
            events: made.events,
            motions: ends + u32::from(goes_on),
            tick_hz: contents.tick_hz,
            ticks: made.last - made.first.unwrap_or(made.last),
            made: made.steps,
            not_made: std::array::from_fn(|motor| all.steps[motor] - made.steps[motor]),
            motor_steps,
            position_mm,
            order_digest: format!("{:016x}", digests.order),
            step_digest: format!("{:016x}", digests.step),
        }
    }
}

fn add(one: [i64; 4], other: [i64; 4]) -> [i64; 4] {
    std::array::from_fn(|motor| one[motor] + other[motor])
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn record_line(stamped: &Stamped<'_>) -> RecordLine {
    let (kind, line, text) = match stamped.record {
        Record::Command { line, text: command } => ("command", Some(line), text(command)),
        Record::Temperatures([nozzle, bed]) => {
            ("temperatures", None, format!("nozzle {}, bed {}", heater(nozzle), heater(bed)))
        }
        Record::Chamber(chamber) => ("chamber", None, heater(chamber)),
        Record::Nozzle1(nozzle) => ("nozzle1", None, heater(nozzle)),
        Record::Driver(words) => ("driver", None, text(words)),
        Record::Halt(words) => ("halt", None, text(words)),
        Record::Reset(words) => ("reset", None, text(words)),
        Record::LastWords(words) => (LAST_WORDS, None, text(words)),
    };
    RecordLine { time_s: f64::from(stamped.now_ms) / 1000.0, kind, line, text, place: None }
}

fn heater(sample: HeaterSample) -> String {
    let degrees = |tenths: i16| f64::from(tenths) / 10.0;
    let HeaterSample { decicelsius, target_decicelsius, power } = sample;
    let (now, target) = (degrees(decicelsius), degrees(target_decicelsius));
    format!("{now:.1} of {target:.1} C at {:.0} %", f64::from(power) / 2.55)
}

impl fmt::Display for BlackBoxReport {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { board, profile, version, .. } = self;
        writeln!(out, "black box of {board}, profile {profile}, firmware {version}")?;
        match (self.has_memory, self.records.is_empty()) {
            (false, _) => writeln!(out, "no records: the board has no memory for them")?,
            (true, true) => writeln!(out, "no records: nothing was recorded since the power came on")?,
            (true, false) => {}
        }
        for RecordLine { time_s, kind, line, text, place } in &self.records {
            let line = line.map_or(String::new(), |line| format!("line {line}: "));
            let place = place.as_ref().map_or(String::new(), |place| format!(", {place}"));
            writeln!(out, "{time_s:10.3} s  {kind:<12}  {line}{}{place}", one_line(text))?;
        }
        if self.damaged_records > 0 {
            writeln!(out, "{} records are damaged and left out", self.damaged_records)?;
        }
        if self.is_damaged {
            writeln!(out, "slots of the step queue are damaged: the steps begin after them")?;
        }
        self.steps.fmt(out)
    }
}

impl fmt::Display for StepsReport {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.slots == [0, 0] {
            return writeln!(out, "steps: none since the power came on, or since the last stop");
        }
        let by_motor = |steps: [i64; 4]| {
            ["x", "y", "z", "e"].iter().zip(steps).fold(String::new(), |mut text, (name, steps)| {
                let _ = write!(text, " {name} {steps}");
                text
            })
        };
        let ms = self.ticks as f64 * 1e3 / f64::from(self.tick_hz.max(1));
        writeln!(out, "steps         {} events in {ms:.3} ms, {} motions", self.events, self.motions)?;
        writeln!(out, "  made       {}", by_motor(self.made))?;
        writeln!(out, "  not made   {}", by_motor(self.not_made))?;
        match self.motor_steps {
            Some(steps) => writeln!(out, "  end, steps {}", by_motor(steps))?,
            None => writeln!(out, "  end         not known: the board has not noted a position in this time")?,
        }
        if let Some([x, y, z]) = self.position_mm {
            writeln!(out, "  end         X {x:.3} Y {y:.3} Z {z:.3} mm")?;
        }
        writeln!(out, "  digests     order {}, step {}", self.order_digest, self.step_digest)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use ferrostep_black_box::{Dump, Facts, RecordMemory, StepPast};
    use ferrostep_step_player::Past;

    use super::*;

    /// Three slots; the second was being played.
    struct Steps(Past);

    const SLOTS: [PastSlot; 3] = [
        PastSlot { first: 0, then: 0b0001, turned: 0, backwards: 0, reload: 199, events: 4 },
        PastSlot { first: 0b0001, then: 0b0010, turned: 0b0010, backwards: 0b0010, reload: 399, events: 3 },
        PastSlot { first: 0b0010, then: 0b1000, turned: 0, backwards: 0, reload: 99, events: 2 },
    ];

    impl StepPast for Steps {
        fn past(&self) -> Past {
            self.0
        }

        fn slot(&self, number: u32) -> Option<PastSlot> {
            SLOTS.get(number.checked_sub(5)? as usize).copied()
        }
    }

    fn fetched(positions: [Option<PositionMark>; 2], memory: &RecordMemory) -> Vec<u8> {
        let past = Past { oldest: 5, next: 7, filled: 8, events_left: 1, directions: 0b0010, is_kept: true, positions };
        let names = ["bench", "cartesian", "0.2.0"];
        let facts = Facts { both_edges: true, tick_hz: 84_000_000, pulse_ticks: 84, now_ms: 9_000, names };
        let mut dump = Dump::new(Steps(past), memory, facts);
        let (mut log, mut line) = (String::new(), Default::default());
        while dump.next_line(&mut line) {
            log += &format!("{line}\nT:20.0 /0.0\n");
        }
        ferrostep_host::black_box_lines::from_text(&log).unwrap()
    }

    #[test]
    fn what_was_made_and_what_was_not() {
        // The mark has the queue's end before the last slot was filled: the event held back then is
        // that slot's first.
        let mark = PositionMark { filled: 7, next: 6, now_ms: 8_000, motor_steps: [104, 47, 0, 7] };
        let bytes = fetched([None, Some(mark)], &RecordMemory::new());
        let contents = Contents::read(&bytes).unwrap();
        let mut steps = Vec::new();
        replay_made(&contents, |step| steps.push((step.tick, step.axes, step.backwards)));
        assert_eq!(steps, [(200, 1, 0), (400, 1, 0), (600, 1, 0), (800, 1, 0), (1200, 2, 2)]);
        let profile = ferrostep_profiles::load("cartesian").unwrap();
        let report = BlackBoxReport::new(&contents, Some(&profile)).steps;
        assert_eq!((report.slots, report.events, report.motions, report.ticks), ([2, 1], 5, 1, 1000));
        assert_eq!((report.made, report.not_made), ([4, -1, 0, 0], [0, -2, 0, 1]));
        assert_eq!(report.motor_steps, Some([104, 49, 0, 7]));
        assert_eq!(report.position_mm, Some([1.3, 0.6125, 0.0]));
    }

    #[test]
    fn a_position_from_another_time_is_none() {
        // The mark at the queue's end has a held event that is unknown; the other is
        // before the first slot.
        for filled in [8, 4, 1_000] {
            let mark = PositionMark { filled, ..PositionMark::default() };
            let bytes = fetched([Some(mark), None], &RecordMemory::new());
            let report = BlackBoxReport::new(&Contents::read(&bytes).unwrap(), None);
            assert_eq!(report.steps.motor_steps, None, "{filled}");
            assert!(report.to_string().contains("no records: the board has no memory for them"));
        }
    }

    #[test]
    fn records_are_told_with_their_times() {
        let memory = RecordMemory::new();
        memory.restart(0);
        memory.record(1_500, 0, &Record::Command { line: 12, text: b"G1 X5 \x1b[2J" });
        memory.record(2_000, 0, &Record::Temperatures([HeaterSample::new(215.0, 215.0, 0.4), HeaterSample::default()]));
        memory.record(2_000, 0, &Record::Chamber(HeaterSample::new(41.5, 50.0, 1.0)));
        memory.add_last(None, &Record::Reset(b"watchdog"));
        let bytes = fetched([None; 2], &memory);
        let text = BlackBoxReport::new(&Contents::read(&bytes).unwrap(), None).to_string();
        let expected = [
            "black box of bench, profile cartesian, firmware 0.2.0",
            "     1.500 s  command       line 12: G1 X5 \\u{1b}[2J",
            "     2.000 s  temperatures  nozzle 215.0 of 215.0 C at 40 %, bed 0.0 of 0.0 C at 0 %",
            "     2.000 s  chamber       41.5 of 50.0 C at 100 %",
            "     2.000 s  reset         watchdog",
            "steps         5 events in 0.012 ms, 1 motions",
        ];
        assert_eq!(text.lines().take(6).collect::<Vec<_>>(), expected);
    }
}
