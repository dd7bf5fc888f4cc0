//! M112 and M410 at any moment: the machine knows its motors' positions and continues from there.

use ferrostep_gcode::Emergency;
use ferrostep_printer::Profile;
use ferrostep_step_player::{BothEdges, Pulses, Stepping};
use ferrostep_testkit::board_model::{
    Board, BoardPrinter, CYCLES_A_MS, Costs, HostLine, LOOK_AHEAD_BLOCKS, with_board,
};

/// SplitMix64 (Steele, Lea, Flood 2014): a seed gives the same instants everywhere.
struct Random(u64);

impl Random {
    fn below(&mut self, end: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut word = self.0;
        word = (word ^ word >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        word = (word ^ word >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        (word ^ word >> 31) % end
    }
}

/// The first lines of a print, without heat and homing.
fn cube() -> Vec<String> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/cube.gcode");
    let text = std::fs::read_to_string(path).unwrap();
    let cold = |line: &&str| !["M104", "M109", "M140", "M190", "G28", ";"].iter().any(|start| line.starts_with(start));
    ["M302 P1"]
        .into_iter()
        .chain(text.lines().filter(|line| !line.is_empty()).filter(cold))
        .take(1_500)
        .map(str::to_owned)
        .collect()
}

/// A print that is stopped again and again.
struct StoppedPrint<'b, 'a, M: Stepping> {
    board: &'b Board<'a, M>,
    profile: &'b Profile,
    printer: BoardPrinter<'b, 'a, M>,
    host: HostLine,
}

impl<'b, 'a, M: Stepping> StoppedPrint<'b, 'a, M> {
    fn new(board: &'b Board<'a, M>, profile: &'b Profile, host: HostLine) -> Self {
        Self { board, profile, printer: board.printer(), host }
    }

    /// Executes a line when it arrives; returns true if it was executed.
    fn line(&mut self, text: &str) -> bool {
        self.board.wait_for_line(self.host.next_at(self.board.now()));
        self.board.execute(&mut self.printer, 1, text).is_ok()
    }

    /// Checks that the machine is where it believes to be after a stop. Then sends the host's
    /// lines, and checks again.
    #[track_caller]
    fn check(&mut self, lines: &[&str]) {
        self.reports_are_true();
        for line in lines {
            self.line(line);
        }
        self.reports_are_true();
        let [x, y, z, _] = self.printer.logical_10nm();
        assert_eq!([x, y, z], self.board.position_10nm());
        let filament_mm = self.printer.tally().filament_100pm as f64 / 1e7;
        let extruder = self.board.counted_steps()[3] as f64;
        let wanted = filament_mm * self.profile.steps_per_mm[3].to_f64();
        assert!((extruder - wanted).abs() <= 1.0, "{extruder} extruder steps for {wanted}");
        assert!(self.board.is_idle());
    }

    #[track_caller]
    fn reports_are_true(&self) {
        for report in self.board.take_stop_reports() {
            assert_eq!(report.motor_steps, report.counted_steps);
            let [x, y, z, _] = report.counted_steps;
            assert_eq!(report.position_10nm, self.profile.geometry().position_10nm([x, y, z]));
            assert!(!report.stepped_after, "a motor stepped after the stop: {report:?}");
        }
    }

    /// Prints lines again and again; a stop comes after this many cycles. Returns whether
    /// motion was under way.
    #[track_caller]
    fn stop_after(&mut self, cycles: u64, lines: &mut impl Iterator<Item = String>, emergency: Emergency) -> bool {
        let events = self.board.events();
        let at = self.board.now() + cycles;
        self.board.act_at(at, emergency);
        while self.board.now() <= at {
            let line = lines.next().unwrap();
            self.line(&line);
        }
        let moved = self.board.events() != events;
        // The planner task runs.
        self.board.stay_silent(3);
        self.check(if emergency == Emergency::Stop { &["M112", "M999"] } else { &["M410"] });
        moved
    }
}

fn stopped_again_and_again<M: Stepping>(profile: &Profile, lines: &[String], stops: u32, longest_ms: u64, seed: u64) {
    let mut random = Random(seed);
    let mut under_way = 0;
    with_board::<M, _>(profile, LOOK_AHEAD_BLOCKS, Costs::BOARD, |board| {
        let mut print = StoppedPrint::new(board, profile, HostLine::bursts(3_000, 7));
        assert!(print.line("M302 P1"));
        let mut lines = lines.iter().cloned().cycle();
        for stop in 0..stops {
            let longest = if random.below(4) == 0 { longest_ms / 20 } else { longest_ms };
            let emergency = if stop % 2 == 0 { Emergency::Stop } else { Emergency::QuickStop };
            under_way += u32::from(print.stop_after(random.below(longest * CYCLES_A_MS), &mut lines, emergency));
        }
        // The machine still goes where it is sent.
        assert!(print.line("G90") && print.line("G1 X10 Y20 Z0.3 F6000") && print.line("M400"));
        assert_eq!(board.position_10nm(), [1_000_000, 2_000_000, 30_000]);
        let [x, y, z, _] = board.counted_steps();
        assert_eq!([x, y, z], profile.geometry().motor_steps(board.position_10nm()).map(i64::from));
        assert_eq!(board.figures().underruns, 0);
    });
    println!("{under_way} of {stops} stops came in motion");
    assert!(under_way > stops / 3);
}

#[test]
fn ten_thousand_stops_of_a_print_in_pulses() {
    let profile = ferrostep_profiles::load("cartesian").unwrap();
    stopped_again_and_again::<Pulses>(&profile, &cube(), 10_000, 500, 1);
}

#[test]
fn ten_thousand_stops_of_a_print_in_edges() {
    let profile = ferrostep_profiles::load("cartesian").unwrap();
    stopped_again_and_again::<BothEdges>(&profile, &cube(), 10_000, 500, 2);
}

#[test]
fn stops_while_every_step_changes_direction() {
    let profile = ferrostep_profiles::load("corexy").unwrap();
    let to_and_fro: Vec<String> = (0..100)
        .map(|index| format!("G1 X{} Y{} F30000", [0.0, 0.00625][index % 2], [0.0, 0.0125][index / 2 % 2]))
        .collect();
    stopped_again_and_again::<Pulses>(&profile, &to_and_fro, 2_000, 200, 3);
    stopped_again_and_again::<BothEdges>(&profile, &to_and_fro, 2_000, 200, 4);
}
