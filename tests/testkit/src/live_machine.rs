//! Any bytes as a conversation with the board in virtual time: nasty but grammatical lines, raw
//! bytes, silences, and M108, M112 and M410 at any moment.
//!
//! The printer must answer any input without a panic, and the motors must be where the machine and
//! the G-code believe them to be.

use arbitrary::Unstructured;
use ferrostep_gcode::{Command, Emergency, EmergencyScanner, LineReader, parse};
use ferrostep_planner::StepsPerMm;
use ferrostep_printer::{HomeEnd, HomeSensor, Host, Profile, SafeHoming};
use ferrostep_step_player::{BothEdges, Pulses, Stepping};

use crate::board_model::{Board, BoardPrinter, CYCLES_A_MS, Costs, Ended, with_board};

mod grammar;

use grammar::{Said, said};

/// Limits of a conversation: a longer one costs more than it finds.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    /// Maximum number of lines.
    lines: u32,
    /// Maximum time for which the host waits for an answer, ms.
    patience_ms: u64,
    /// The same for a homing, ms.
    homing_patience_ms: u64,
    /// Longest virtual time, ms.
    longest_ms: u64,
}

const LIFE_SIZE: Bounds = Bounds { lines: 200, patience_ms: 500, homing_patience_ms: 20_000, longest_ms: 60_000 };

/// Bounds for [`small_machine`], which does everything in milliseconds.
const SMALL: Bounds = Bounds { lines: 16, patience_ms: 40, homing_patience_ms: 600, longest_ms: 1_500 };

/// Greatest difference between filament and the extruder's steps.
const EXTRUDER_STEPS: f64 = 1.0;

/// The board and its host's state.
struct Talk<'b, 'a, M: Stepping> {
    board: &'b Board<'a, M>,
    profile: &'b Profile,
    bounds: Bounds,
    printer: BoardPrinter<'b, 'a, M>,
    host: Host,
    reader: LineReader,
    scanner: EmergencyScanner,
    /// Position of the X, Y and Z motors by their signals when the machine has them at 0;
    /// homing sets it again.
    zero_steps: [i64; 3],
    /// True if homing has set it since the last look.
    has_homed: bool,
    /// Cycle at which an M410 or M112 acts that has no answer yet.
    stops_at: Option<(u64, Emergency)>,
    lines: u32,
    /// The conversation so far, for failure messages.
    said: Vec<String>,
}

impl<'b, 'a, M: Stepping> Talk<'b, 'a, M> {
    fn new(board: &'b Board<'a, M>, profile: &'b Profile, bounds: Bounds) -> Self {
        Self {
            board,
            profile,
            bounds,
            printer: board.printer(),
            host: Host::new(),
            reader: LineReader::new(),
            scanner: EmergencyScanner::new(),
            zero_steps: [0; 3],
            has_homed: false,
            stops_at: None,
            lines: 0,
            said: Vec::new(),
        }
    }

    /// Sends bytes; all lines that end in them are answered.
    fn say(&mut self, mut bytes: &[u8]) {
        self.said.push(String::from_utf8_lossy(bytes).into_owned());
        let mut acted = None;
        for &byte in bytes {
            if let Some(emergency) = self.scanner.feed(byte) {
                self.board.act(emergency);
                acted = Some(emergency);
            }
        }
        let mut reader = std::mem::take(&mut self.reader);
        while !bytes.is_empty() {
            let (used, line) = reader.feed(bytes);
            bytes = &bytes[used..];
            let Some(line) = line else { continue };
            self.lines += 1;
            let homes = line.is_ok_and(|line| matches!(parse(line.text), Ok(Command::Home { .. })));
            self.has_homed |= homes;
            let patience_ms = if homes { self.bounds.homing_patience_ms } else { self.bounds.patience_ms };
            let answers = self.board.answers();
            let ended = self.board.answer((&mut self.printer, &mut self.host), line, patience_ms);
            assert_eq!(self.board.answers(), answers + 1, "{line:?} has one answer\n{}", self.told());
            if let Ended::By(Emergency::QuickStop | Emergency::Stop) = ended {
                self.settle();
            }
        }
        self.reader = reader;
        if let Some(Emergency::QuickStop | Emergency::Stop) = acted {
            // The board may have asked for its own line again, since the number was wrong.
            self.settle();
        }
    }

    /// Sends the remaining lines of a host that has stopped the machine, and checks them.
    fn settle(&mut self) {
        self.board.stay_silent(3);
        let lines: &[&str] = if self.board.is_halted() { &["M112", "M999"] } else { &["M410"] };
        for text in lines {
            self.said.push((*text).to_owned());
            let mut reader = LineReader::new();
            let line = format!("{text}\n");
            if let (_, Some(line)) = reader.feed(line.as_bytes()) {
                self.board.answer((&mut self.printer, &mut self.host), line, self.bounds.patience_ms);
            }
        }
        self.check();
    }

    /// Sends M410 or M112 after this number of cycles.
    fn stop_after(&mut self, cycles: u64, emergency: Emergency) {
        if self.stops_at.is_none() {
            let at = self.board.now() + cycles;
            self.board.act_at(at, emergency);
            self.stops_at = Some((at, emergency));
        }
    }

    /// Answers the line of an M410 or M112 that has acted, in its turn.
    fn answer_stop(&mut self) {
        if let Some((at, emergency)) = self.stops_at
            && at <= self.board.now()
        {
            self.stops_at = None;
            self.said.push(format!("({emergency:?} at {at})"));
            self.settle();
        }
    }

    /// Ends all motion, by a stop if needed; then everything must agree.
    fn finish(&mut self) {
        if let Some((at, _)) = self.stops_at {
            self.board.wait_for_line(at);
            self.answer_stop();
        }
        if !self.board.is_halted() {
            self.say(b"\nM400\n");
            self.check();
        }
    }

    fn told(&self) -> String {
        format!("{:#?}\n{:#?}", self.said, self.board.replies())
    }

    /// Homing sets the motors' position, which no signal shows.
    fn look_where_zero_is(&mut self) {
        let [machine, counted] = [self.board.motor_steps(), self.board.counted_steps()];
        for ((zero, counted), machine) in self.zero_steps.iter_mut().zip(counted).zip(machine) {
            *zero = counted - machine;
        }
    }

    /// Positions of the motors as the machine counts, steps.
    fn counted_steps(&self, mut counted: [i64; 4]) -> [i64; 4] {
        for (counted, zero) in counted.iter_mut().zip(self.zero_steps) {
            *counted -= zero;
        }
        counted
    }

    /// Checks that motors, machine and G-code agree.
    fn check(&mut self) {
        assert!(self.board.is_idle(), "at rest\n{}", self.told());
        for report in self.board.take_stop_reports() {
            assert!(!report.stepped_after, "no step after a stop: {report:?}\n{}", self.told());
        }
        if std::mem::take(&mut self.has_homed) {
            self.look_where_zero_is();
        }
        let counted = self.counted_steps(self.board.counted_steps());
        assert_eq!(self.board.motor_steps(), counted, "machine and motors\n{}", self.told());
        let position_10nm = self.board.position_10nm();
        let [x, y, z, extruder] = counted;
        let wanted = self.profile.geometry().motor_steps(position_10nm).map(i64::from);
        assert_eq!([x, y, z], wanted, "position and motors\n{}", self.told());
        let state = self.printer.prepared_state();
        let [logical @ .., _] = self.printer.logical_10nm();
        if state.lift_10nm == 0 && !self.printer.is_shifted() {
            let machine: Vec<i64> =
                logical.iter().zip(state.offset_10nm).map(|(logical, offset)| logical - offset).collect();
            assert_eq!(machine, position_10nm, "the G-code's position and the machine's\n{}", self.told());
        }
        let filament_mm = self.printer.tally().filament_100pm as f64 / 1e7;
        let wanted = filament_mm * self.profile.steps_per_mm[3].to_f64();
        assert!(
            (extruder as f64 - wanted).abs() <= EXTRUDER_STEPS,
            "{extruder} extruder steps for {wanted}\n{}",
            self.told()
        );
        assert_eq!(self.board.figures().refused_entries, 0, "no entry is refused\n{}", self.told());
    }
}

fn talk<M: Stepping>(profile: &Profile, bounds: Bounds, look_ahead: usize, bytes: &mut Unstructured<'_>) {
    with_board::<M, _>(profile, look_ahead, Costs::BOARD, |board| {
        let mut talk = Talk::new(board, profile, bounds);
        talk.say(b"M302 P1\nM83\n");
        let mut number = 1;
        while !bytes.is_empty() && talk.lines < bounds.lines && board.now() < bounds.longest_ms * CYCLES_A_MS {
            match said(bytes, &mut number) {
                Ok(Said::Bytes(bytes)) => talk.say(&bytes),
                Ok(Said::Silence(ms)) => board.stay_silent(ms),
                Ok(Said::Finish) => talk.finish(),
                Ok(Said::Emergency(Emergency::EndWait, _)) => board.act(Emergency::EndWait),
                Ok(Said::Emergency(emergency, cycles)) => talk.stop_after(cycles, emergency),
                Err(_) => break,
            }
            talk.answer_stop();
        }
        talk.finish();
        // The half of a line that may be left.
        talk.say(b"\nM112\nM999\n");
        talk.check();
        // The machine still goes where it is sent in the end.
        talk.say(b"G90\nG21\nM211 S0\nM220 S100\nM201 X500 Y500 Z100\nM203 X100 Y100 Z10\nM204 S500\nM205 J0.05\n");
        talk.say(b"G92 X0 Y0 Z0 E0\nG1 X1 Y2 Z0.1 F3000\nM400\n");
        talk.check();
    });
}

/// Makes a conversation of any bytes with a board of this machine, on one of the kinds of boards.
///
/// # Panics
/// If the printer panics, does not answer, or is wrong about its motors; the message contains
/// the conversation.
pub fn live_machine(profile: &Profile, bytes: &[u8]) {
    converse(profile, LIFE_SIZE, bytes);
}

/// Converses as [`live_machine`] does, but briefly, with a machine from [`small`]: a hundred times
/// as many conversations in the same time.
///
/// # Panics
/// As [`live_machine`].
pub fn small_machine(profile: &Profile, bytes: &[u8]) {
    converse(profile, SMALL, bytes);
}

/// Edge of a small machine, units of 10 nm: 20 mm.
const SMALL_10NM: i64 = 2_000_000;

/// Makes a machine a tenth of this one in size, a sixteenth in steps/mm, and far faster, so that
/// every action takes milliseconds and few steps.
pub fn small(profile: &Profile) -> Profile {
    let mut small = *profile;
    small.size_10nm = [SMALL_10NM; 3];
    small.lower_end_10nm = [0; 3];
    for steps in &mut small.steps_per_mm {
        *steps = StepsPerMm::from_f64(steps.to_f64() / 16.0).unwrap_or(*steps);
    }
    let limits = &mut small.limits;
    limits.max_feed_mm_per_s = [1_000.0; 4];
    limits.max_acceleration_mm_per_s2 = [50_000.0; 4];
    limits.print_acceleration_mm_per_s2 = 50_000.0;
    limits.travel_acceleration_mm_per_s2 = 50_000.0;
    limits.retract_acceleration_mm_per_s2 = 50_000.0;
    small.safe_homing = SafeHoming::NONE;
    for axis in &mut small.homing {
        axis.sensor = HomeSensor::EndStop;
        axis.position_10nm = if axis.end == HomeEnd::Max { SMALL_10NM } else { 0 };
        (axis.fast_mm_per_s, axis.slow_mm_per_s) = (400.0, 200.0);
        (axis.back_off_10nm, axis.overrun_10nm, axis.agree_10nm) = (100_000, 200_000, 50_000);
    }
    small.pause.place_10nm = [100_000, 1_900_000];
    small.pause.rise_10nm = 100_000;
    small
}

fn converse(profile: &Profile, bounds: Bounds, bytes: &[u8]) {
    let mut bytes = Unstructured::new(bytes);
    let Ok(build) = bytes.int_in_range(0..=3u8) else { return };
    let look_ahead = if build & 1 == 0 { 128 } else { 3 };
    if build & 2 == 0 {
        talk::<Pulses>(profile, bounds, look_ahead, &mut bytes);
    } else {
        talk::<BothEdges>(profile, bounds, look_ahead, &mut bytes);
    }
}
