//! M410, M112, M108 and a vanishing host, at any instant of anything the board does: it answers
//! within the times that the book promises (Overload), no motor steps after a stop, and the machine
//! continues from the motors' positions.
//!
//! Everything follows from a seed, which a failure names. `FERROSTEP_INSTANTS` says how many
//! instants of each kind are tried, in all states together.

mod states;

use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};

use ferrostep_gcode::Emergency;
use ferrostep_gpre::transfer::Word;
use ferrostep_printer::{CommandError, Failure};
use ferrostep_random_cases::Share;
use ferrostep_step_player::Pulses;
use ferrostep_testkit::board_model::{
    Board, BoardPrinter, CYCLES_A_MS, Costs, JOB_SILENCE_S, JobHost, LOOK_AHEAD_BLOCKS, with_board,
};
use ferrostep_testkit::hostile::Random;

use states::{State, Work};

/// Instants of a kind in all states, unless `FERROSTEP_INSTANTS` is set; a run tries
/// its share of them.
const INSTANTS: u64 = 100;

/// Maximum time from a stop to the answer of a command that waits for motion, and from a line's
/// arrival to its answer if it need not wait, ms.
const ANSWER_MS: u64 = 5;

/// Interval at which a wait for time or heat checks for stops, ms.
const LOOK_MS: u64 = 100;

/// Time for which a prepared job waits for its line before it checks for stops, ms.
const LINE_MS: u64 = 150;

/// Time for which a wait for heat that nothing ends is watched, ms.
const HEAT_MS: u64 = 1_500;

/// Maximum time of homing and a move on these machines, ms.
const HOMING_MS: u64 = 60_000;

/// The event at the instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    QuickStop,
    Stop,
    EndWait,
    HostGoes,
}

impl Kind {
    fn stops_motion(self) -> bool {
        matches!(self, Self::QuickStop | Self::Stop)
    }
}

/// The undisturbed course of a state; cycles since its beginning.
struct Undisturbed {
    /// End of each line: its answer; for a wait for heat, the end of its motion.
    answers: Vec<u64>,
    /// End of the whole course.
    end: u64,
    /// Positions of X, Y and Z by the signals when all axes are homed.
    homed_steps: [i64; 3],
}

fn waits_for_heat(line: &str) -> bool {
    line.starts_with("M109") || line.starts_with("M190")
}

/// The host of a job that begins at a cycle.
fn job_host(job: &[u8], begin: u64, pause_ms: &Range<u64>) -> JobHost {
    let [start, end] = [pause_ms.start, pause_ms.end].map(|ms| begin + ms * CYCLES_A_MS);
    JobHost::new(job.to_vec()).pauses(start..end)
}

/// A board and its host.
struct Talk<'b, 'a> {
    state: &'b State,
    board: &'b Board<'a, Pulses>,
    printer: BoardPrinter<'b, 'a, Pulses>,
    longest_ms: f64,
}

impl<'b, 'a> Talk<'b, 'a> {
    /// A board that is about to enter the state.
    fn new(state: &'b State, board: &'b Board<'a, Pulses>) -> Self {
        let mut talk = Self { state, board, printer: board.printer(), longest_ms: 0.0 };
        talk.line("M302 P1", HOMING_MS).unwrap();
        for line in &state.before {
            talk.line(line, HOMING_MS).unwrap();
        }
        talk
    }

    /// Sends a line that must be answered within this many ms.
    #[track_caller]
    fn line(&mut self, line: &str, within_ms: u64) -> Result<(), Failure> {
        self.line_by(line, self.board.now() + within_ms * CYCLES_A_MS)
    }

    /// Sends a line that must be answered by a cycle.
    #[track_caller]
    fn line_by(&mut self, line: &str, cycle: u64) -> Result<(), Failure> {
        let answers = self.board.answers();
        let outcome = self.board.execute_by(&mut self.printer, 1, line, cycle);
        let outcome = outcome.unwrap_or_else(|| panic!("{line} has no answer by cycle {cycle}"));
        assert_eq!(self.board.answers(), answers + 1, "{line} has one answer");
        outcome
    }

    /// Sends a line that is answered at once.
    #[track_caller]
    fn at_once(&mut self, line: &str) -> Result<(), Failure> {
        let began = self.board.now();
        let outcome = self.line(line, ANSWER_MS);
        self.answered(began);
        outcome
    }

    /// Notes the wait of a line that came at this cycle and has just been answered.
    fn answered(&mut self, came: u64) {
        let waited_ms = (self.board.now() - came) as f64 / CYCLES_A_MS as f64;
        self.longest_ms = self.longest_ms.max(waited_ms);
    }

    /// Homes; returns the motors' positions by the signals.
    #[track_caller]
    fn home(&mut self) -> [i64; 3] {
        self.line("G28", HOMING_MS).unwrap();
        let [steps @ .., _] = self.board.counted_steps();
        steps
    }

    /// Completes the state's work; returns the time of each line.
    fn work_undisturbed(&mut self) -> Vec<u64> {
        let begin = self.board.now();
        let mut answers = Vec::new();
        match &self.state.work {
            Work::Lines(lines) => {
                for line in lines {
                    // A wait for heat begins as M400 does.
                    self.line(if waits_for_heat(line) { "M400" } else { line }, HOMING_MS).unwrap();
                    answers.push(self.board.now() - begin);
                }
            }
            Work::Job(job, pause_ms) => {
                let mut host = job_host(job, begin, pause_ms);
                let report = self.board.receive_job(&mut self.printer, &mut host);
                assert_eq!(report.word, Word::Done, "{:?}", self.board.replies());
                answers.push(self.board.now() - begin);
            }
        }
        answers
    }

    /// Cycle by which a line in execution at the instant `at` is answered, and whether that is
    /// exact: undisturbed, it ends as ever. M108 comes at `end_wait_at`.
    fn deadline(&self, kind: Kind, line: &str, own_end: u64, at: u64, end_wait_at: u64) -> (u64, bool) {
        let after = |cycle: u64, ms: u64| cycle + ms * CYCLES_A_MS;
        if waits_for_heat(line) {
            let waits_for = if kind == Kind::Stop { at } else { end_wait_at.max(own_end) };
            return (after(waits_for, LOOK_MS + ANSWER_MS), false);
        }
        if own_end <= at {
            return (own_end, true);
        }
        match kind {
            Kind::Stop if line.starts_with("G4") => (after(at, LOOK_MS + ANSWER_MS), false),
            // Its wait continues as before, its motion does not.
            Kind::QuickStop if line.starts_with("G4") => (after(own_end, ANSWER_MS), false),
            Kind::Stop | Kind::QuickStop => (after(at, ANSWER_MS), false),
            Kind::EndWait | Kind::HostGoes => (own_end, true),
        }
    }

    /// Runs the board up to the instant, and checks the answers that are due then.
    #[track_caller]
    fn disturb(&mut self, kind: Kind, undisturbed: &Undisturbed, random: &mut Random) {
        let begin = self.board.now();
        let at = begin + random.below(undisturbed.end);
        // The host comes back; since M410 does not end a wait, it sends M108.
        let back = at + random.below(1_200) * CYCLES_A_MS + random.below(CYCLES_A_MS);
        let end_wait_at = if kind == Kind::EndWait { at } else { back };
        match kind {
            Kind::QuickStop => self.board.act_at(at, Emergency::QuickStop),
            Kind::Stop => self.board.act_at(at, Emergency::Stop),
            Kind::EndWait | Kind::HostGoes => {}
        }
        match &self.state.work {
            Work::Lines(lines) => {
                if kind != Kind::Stop {
                    self.board.act_at(end_wait_at, Emergency::EndWait);
                }
                for (line, end) in lines.iter().zip(&undisturbed.answers) {
                    if self.board.now() > at {
                        break;
                    }
                    let (deadline, is_exact) = self.deadline(kind, line, begin + end, at, end_wait_at);
                    let outcome = self.line_by(line, deadline);
                    if is_exact {
                        assert_eq!((self.board.now(), outcome), (deadline, Ok(())), "{line} ends as ever");
                    } else if !line.starts_with("G4") || kind == Kind::Stop {
                        let waited_for =
                            if waits_for_heat(line) && kind != Kind::Stop { end_wait_at.max(begin + end) } else { at };
                        self.answered(waited_for.min(self.board.now()));
                    }
                }
            }
            Work::Job(job, pause_ms) => {
                let host = job_host(job, begin, pause_ms);
                self.disturb_job(host, kind, at, undisturbed, random);
            }
        }
        self.board.wait_for_line(at);
        if kind == Kind::HostGoes {
            self.board.wait_for_line(back.max(self.board.now()));
        }
    }

    #[track_caller]
    fn disturb_job(&mut self, mut host: JobHost, kind: Kind, at: u64, undisturbed: &Undisturbed, random: &mut Random) {
        let begin = self.board.now();
        let silence_ms = u64::from(JOB_SILENCE_S) * 1_000;
        let (until, words): (u64, &[Word]) = match kind {
            Kind::QuickStop | Kind::Stop => (at + (LINE_MS + ANSWER_MS) * CYCLES_A_MS, &[Word::Stopped, Word::Refused]),
            Kind::EndWait => {
                self.board.act_at(at, Emergency::EndWait);
                (begin + undisturbed.end, &[Word::Done])
            }
            Kind::HostGoes => {
                let comes_back = random.below(4) > 0;
                let absence_ms = if comes_back { random.below(2_000) } else { 2 * silence_ms };
                host = host.leaves(at..at + absence_ms * CYCLES_A_MS);
                // All of it may have arrived before, or nothing that can be executed.
                let (waits_ms, words): (_, &[Word]) = if comes_back {
                    (absence_ms + 1_000, &[Word::Done])
                } else {
                    (silence_ms + LINE_MS + ANSWER_MS, &[Word::Done, Word::Stopped, Word::Refused])
                };
                (begin + undisturbed.end + waits_ms * CYCLES_A_MS, words)
            }
        };
        let report = self.board.receive_job_by(&mut self.printer, &mut host, until);
        let report = report.unwrap_or_else(|| panic!("the job does not end by cycle {until}"));
        assert!(words.contains(&report.word), "{report:?} {:?}", self.board.replies());
        if kind.stops_motion() {
            self.answered(at);
        }
    }

    /// Later lines of the host are answered at once.
    #[track_caller]
    fn speak_again(&mut self, kind: Kind, random: &mut Random) {
        if random.below(2) == 0 {
            self.board.stay_silent(random.below(9));
        }
        match kind {
            Kind::QuickStop => {
                // A line whose number is wrong has acted, but is not executed.
                if random.below(2) == 0 {
                    self.at_once("M410").unwrap();
                } else {
                    self.board.stay_silent(3);
                }
            }
            Kind::Stop => {
                assert!(self.board.is_halted());
                for line in ["M105", "M115", "M114", "M84"] {
                    assert_eq!(self.at_once(line), Ok(()), "{line}");
                }
                for line in ["M112", "G1 X5"] {
                    assert_eq!(self.at_once(line), Err(Failure::Command(CommandError::Halted)), "{line}");
                }
                self.at_once("M999").unwrap();
            }
            Kind::EndWait => self.at_once("M108").unwrap(),
            Kind::HostGoes => {}
        }
        for line in ["M105", "M115", "M114"] {
            self.at_once(line).unwrap();
        }
        if !kind.stops_motion() {
            self.line("M400", HOMING_MS).unwrap();
        }
    }

    /// Checks that signals, machine and G-code agree, and that the machine still homes and goes
    /// where it is sent.
    #[track_caller]
    fn agrees_and_goes_on(&mut self, undisturbed: &Undisturbed) {
        assert!(self.board.is_idle(), "at rest");
        self.agrees();
        self.tells_filament();
        self.line("G90", ANSWER_MS).unwrap();
        self.line("G92 E0", ANSWER_MS).unwrap();
        self.line("G1 X5 Y6 F6000", HOMING_MS).unwrap();
        self.line("M400", HOMING_MS).unwrap();
        self.agrees();
        assert_eq!(self.home(), undisturbed.homed_steps, "the place where the sensors trigger");
        let zero = undisturbed.homed_steps;
        let [machine @ .., _] = self.board.motor_steps();
        let zero: Vec<i64> = zero.iter().zip(machine).map(|(zero, machine)| zero - machine).collect();
        self.line("G1 X5 Y6 Z4 F6000", HOMING_MS).unwrap();
        self.line("M400", HOMING_MS).unwrap();
        let wanted = self.state.profile.geometry().motor_steps([500_000, 600_000, 400_000]).map(i64::from);
        let counted: Vec<i64> =
            self.board.counted_steps().into_iter().zip(&zero).map(|(counted, zero)| counted - zero).collect();
        assert_eq!(counted, wanted);
    }

    #[track_caller]
    fn agrees(&mut self) {
        for report in self.board.take_stop_reports() {
            assert!(!report.stepped_after, "a motor stepped after the stop: {report:?}");
        }
        let profile = &self.state.profile;
        let position_10nm = self.board.position_10nm();
        let [machine @ .., machine_extruder] = self.board.motor_steps();
        assert_eq!(profile.geometry().motor_steps(position_10nm).map(i64::from), machine);
        let state = self.printer.prepared_state();
        let [logical @ .., _] = self.printer.logical_10nm();
        let [x, y, z] = logical;
        let offset = state.offset_10nm;
        assert_eq!(
            [x - offset[0], y - offset[1], z - offset[2] + state.lift_10nm],
            position_10nm,
            "the G-code's position"
        );
        let [.., extruder] = self.board.counted_steps();
        assert_eq!(extruder, machine_extruder);
        let per_mm = profile.steps_per_mm[3].to_f64();
        let filament_mm = self.printer.tally().filament_100pm as f64 / 1e7;
        assert!(
            (extruder as f64 - filament_mm * per_mm).abs() <= 1.0,
            "{extruder} extruder steps for {filament_mm} mm"
        );
    }

    /// Checks that E is what was pushed.
    #[track_caller]
    fn tells_filament(&self) {
        let [.., extruder] = self.board.counted_steps();
        let [.., told_10nm] = self.printer.logical_10nm();
        let pushed_mm = extruder as f64 / self.state.profile.steps_per_mm[3].to_f64();
        let told_mm = told_10nm as f64 / 1e5;
        let agrees = (pushed_mm - told_mm).abs() < 0.02 || !self.state.tells_filament();
        assert!(agrees, "{pushed_mm} mm pushed, {told_mm} mm told");
    }
}

/// Runs the state's work undisturbed.
fn undisturbed(state: &State) -> Undisturbed {
    with_board::<Pulses, _>(&state.profile, state.look_ahead, Costs::BOARD, |board| {
        let mut talk = Talk::new(state, board);
        let answers = talk.work_undisturbed();
        let heat_ms = match &state.work {
            Work::Lines(lines) if lines.iter().any(|line| waits_for_heat(line)) => HEAT_MS,
            _ => state.silence_ms,
        };
        let end = answers.last().unwrap() + heat_ms * CYCLES_A_MS;
        talk.line("G90", ANSWER_MS).unwrap();
        Undisturbed { answers, end, homed_steps: talk.home() }
    })
}

/// Tries one instant; returns the longest time to an answer, ms.
fn instant(state: &State, undisturbed: &Undisturbed, kind: Kind, seed: u64) -> f64 {
    with_board::<Pulses, _>(&state.profile, state.look_ahead, Costs::BOARD, |board| {
        let mut random = Random::new(seed);
        let mut talk = Talk::new(state, board);
        talk.disturb(kind, undisturbed, &mut random);
        talk.speak_again(kind, &mut random);
        talk.agrees_and_goes_on(undisturbed);
        talk.longest_ms
    })
}

/// Tries any instants of a kind, in all states.
fn at_any_instant(kind: Kind) {
    let wanted = std::env::var("FERROSTEP_INSTANTS").ok().map(|count| count.parse().unwrap());
    let share = if wanted.is_some() { Share::ALL } else { Share::of_this_run() };
    let instants = wanted.unwrap_or(INSTANTS);
    let states = State::all();
    let instants = instants.div_ceil(states.len() as u64);
    let mut failed = Vec::new();
    for (number, state) in states.iter().enumerate() {
        let indices: Vec<u64> = (0..instants).filter(|index| share.has(number as u64 * instants + index)).collect();
        if indices.is_empty() {
            continue;
        }
        let undisturbed = undisturbed(state);
        let mut longest_ms = 0.0f64;
        for &index in &indices {
            let seed = (kind as u64) << 56 | (number as u64) << 48 | index;
            match catch_unwind(AssertUnwindSafe(|| instant(state, &undisturbed, kind, seed))) {
                Ok(ms) => longest_ms = longest_ms.max(ms),
                Err(_) => failed.push((state.name, seed)),
            }
            assert!(failed.len() < 10, "{kind:?}: {failed:?}");
        }
        println!(
            "{kind:?}, {}: {} instants within {} ms, longest answer {longest_ms:.2} ms",
            state.name,
            indices.len(),
            undisturbed.end / CYCLES_A_MS
        );
    }
    assert!(failed.is_empty(), "{kind:?}: {failed:?}");
}

#[test]
fn m410_at_any_instant() {
    at_any_instant(Kind::QuickStop);
}

#[test]
fn m112_at_any_instant() {
    at_any_instant(Kind::Stop);
}

#[test]
fn m108_at_any_instant() {
    at_any_instant(Kind::EndWait);
}

#[test]
fn host_leaves_at_any_instant() {
    at_any_instant(Kind::HostGoes);
}

/// M108 is meant for the wait of the command in execution, also while the motion
/// before it is not over.
#[test]
fn m108_before_a_wait_ends_it_at_its_start() {
    let profile = ferrostep_profiles::load("cartesian").unwrap();
    with_board::<Pulses, _>(&profile, LOOK_AHEAD_BLOCKS, Costs::BOARD, |board| {
        let mut printer = board.printer();
        board.execute(&mut printer, 1, "G1 X20 F1200").unwrap();
        let at = board.now() + 300 * CYCLES_A_MS;
        board.act_at(at, Emergency::EndWait);
        let outcome = board.execute_by(&mut printer, 2, "M109 S200", board.now() + 3_000 * CYCLES_A_MS);
        assert_eq!(outcome, Some(Ok(())));
        // The motion has ended by itself.
        assert_eq!(board.counted_steps()[0], 1_600);
        assert!(board.now() > at + 600 * CYCLES_A_MS);
        // The next wait is another.
        assert_eq!(board.execute_by(&mut printer, 3, "M109 S200", board.now() + 3_000 * CYCLES_A_MS), None);
    });
}

/// M410 has acted, but its line had a wrong number: the next executed line accounts for the
/// filament that was not pushed.
#[test]
fn position_is_exact_after_a_stop_whose_line_was_lost() {
    let profile = ferrostep_profiles::load("cartesian").unwrap();
    with_board::<Pulses, _>(&profile, LOOK_AHEAD_BLOCKS, Costs::BOARD, |board| {
        let mut printer = board.printer();
        for line in ["M302 P1", "G1 X20 E5 F1200", "G1 X40 E10"] {
            board.execute(&mut printer, 1, line).unwrap();
        }
        board.act_at(board.now() + 300 * CYCLES_A_MS, Emergency::QuickStop);
        board.stay_silent(400);
        board.execute(&mut printer, 1, "M114").unwrap();
        let [x, .., extruder] = board.counted_steps();
        let [logical_x, .., logical_extruder] = printer.logical_10nm().map(|length_10nm| length_10nm as f64 / 1e5);
        assert!(x > 0 && x < 1_600);
        let per_mm = profile.steps_per_mm.map(|steps| steps.to_f64());
        assert!((logical_x - x as f64 / per_mm[0]).abs() < 0.02, "{x} steps, {logical_x} mm");
        assert!(
            (logical_extruder - extruder as f64 / per_mm[3]).abs() < 0.02,
            "{extruder} steps, {logical_extruder} mm"
        );
        let filament_mm = printer.tally().filament_100pm as f64 / 1e7;
        assert!((filament_mm - logical_extruder).abs() < 0.02, "{filament_mm} mm");
    });
}
