//! A prepared job on the board, and its host's commands during the job.

use std::io::Cursor;

use ferrostep_gcode::MotionFigures;
use ferrostep_gpre::Encoding;
use ferrostep_gpre::transfer::{Report, Word};
use ferrostep_printer::Profile;
use ferrostep_session::JobReplies;
use ferrostep_session::gpre::{self, Target};
use ferrostep_step_player::Pulses;
use ferrostep_testkit::board_model::{
    Board, BoardPrinter, CYCLES_A_MS, CYCLES_PER_S, Costs, JobHost, LOOK_AHEAD_BLOCKS, StopReport, Watch, with_board,
};
use ferrostep_testkit::host_side::numbered;

/// Moves of the job, and the filament that each pushes, units of 0.1 nm.
const MOVES: u32 = 1_200;
const FILAMENT_100PM: i64 = 2_000_000;

/// Feed of the moves.
const FEED_MM_PER_MIN: u32 = 3_600;

/// The moment in the middle of the job at which the host sends a command.
const MIDDLE: u64 = 40 * CYCLES_PER_S;

fn profile() -> Profile {
    ferrostep_profiles::load("cartesian").unwrap()
}

/// End of a move of the job: back and forth along X, a little farther in Y each time, and so uneven
/// that the job is longer than what a board has room for.
fn target_10nm(index: u32) -> [i64; 3] {
    let x_mm = [5, 10, 15, 20, 15, 10, 5, 0][index as usize % 8];
    let uneven = |factor: u32, most: u32| i64::from(index * factor % most) * 100;
    [x_mm * 100_000 + uneven(7_919, 997), i64::from(index / 4) * 20_000 + uneven(4_649, 199), 30_000]
}

/// The job.
fn job() -> Vec<u8> {
    let mm = |length_10nm: i64| length_10nm as f64 / 100_000.0;
    let moves = (0..MOVES).map(|index| {
        let [x, y, z] = target_10nm(index).map(mm);
        format!("G1 X{x:.3} Y{y:.3} Z{z} E{} F{FEED_MM_PER_MIN}\n", FILAMENT_100PM as f64 / 1e7)
    });
    let gcode = format!("M302 P1\nM83\n{}", moves.collect::<String>());
    let mut out = Cursor::new(Vec::new());
    let target = Target { out: &mut out, encoding: Encoding::Compact };
    gpre::prepare(&mut gcode.as_bytes(), None, profile(), JobReplies::new(|_: &str| {}), target, |_, _| {}).unwrap();
    out.into_inner()
}

/// Result of a print.
struct Print {
    report: Report,
    figures: MotionFigures,
    counted_steps: [i64; 4],
    watch: Watch,
    filament_100pm: i64,
    fan_power: u8,
    replies: Vec<String>,
    stops: Vec<StopReport>,
    idle_at: u64,
}

/// Prints the job as its host sends it; afterwards these lines are executed.
#[track_caller]
fn print(host: impl FnOnce(JobHost) -> JobHost, after: &[&str]) -> Print {
    with_board::<Pulses, _>(&profile(), LOOK_AHEAD_BLOCKS, Costs::BOARD, |board| {
        let mut printer = board.printer();
        let report = board.receive_job(&mut printer, &mut host(JobHost::new(job())));
        let idle_at = board.now();
        // The planner task runs.
        board.stay_silent(3);
        let stops = board.take_stop_reports();
        for line in after {
            board.execute(&mut printer, 0, line).unwrap();
        }
        keeps_its_place(board, &printer);
        Print {
            report,
            figures: board.figures(),
            counted_steps: board.counted_steps(),
            watch: board.watch(),
            filament_100pm: printer.tally().filament_100pm,
            fan_power: board.fan_power(),
            replies: board.replies(),
            stops,
            idle_at,
        }
    })
}

/// Checks that the machine is at rest at the position that it reports.
#[track_caller]
fn keeps_its_place(board: &Board<'_, Pulses>, printer: &BoardPrinter<'_, '_, Pulses>) {
    let profile = profile();
    assert!(board.is_idle());
    assert_eq!(board.motor_steps(), board.counted_steps());
    let [x, y, z, extruder] = board.counted_steps();
    let [logical_x, logical_y, logical_z, _] = printer.logical_10nm();
    assert_eq!(profile.geometry().motor_steps([logical_x, logical_y, logical_z]).map(i64::from), [x, y, z]);
    let wanted = printer.tally().filament_100pm as f64 / 1e7 * profile.steps_per_mm[3].to_f64();
    assert!((extruder as f64 - wanted).abs() <= 1.0, "{extruder} extruder steps for {wanted}");
    assert_eq!(board.figures().underruns, 0);
}

/// Prints the job without commands of the host.
fn undisturbed() -> Print {
    let print = print(|host| host, &[]);
    is_whole(&print);
    assert_eq!(print.filament_100pm, i64::from(MOVES) * FILAMENT_100PM);
    assert!(print.watch.seconds() > 2.0 * MIDDLE as f64 / CYCLES_PER_S as f64, "{} s", print.watch.seconds());
    print
}

/// Checks that the job was printed to its end, without a jerk.
#[track_caller]
fn is_whole(print: &Print) {
    assert_eq!((print.report.word, print.report.numbers[0]), (Word::Done, job().len() as u32), "{:?}", print.replies);
    let end = profile().geometry().motor_steps(target_10nm(MOVES - 1)).map(i64::from);
    assert_eq!(print.counted_steps[..3], end);
    assert_eq!(print.watch.all_stops_from_speed(), 0);
}

#[test]
fn a_feed_percentage_changes_the_time_and_not_the_path() {
    let plain = undisturbed();
    let timed = |percent: u32| {
        let print = print(|host| host.says(MIDDLE, &numbered(1, &format!("M220 S{percent}"))), &["M220"]);
        is_whole(&print);
        // Every step of all motors in its order.
        assert_eq!(print.figures.order_digest, plain.figures.order_digest, "{percent} %");
        assert_ne!(print.figures.step_digest, plain.figures.step_digest, "{percent} %");
        assert_eq!(print.filament_100pm, plain.filament_100pm);
        assert!(print.replies.contains(&format!("FR:{percent}%")), "{:?}", print.replies);
        print.watch.seconds() / plain.watch.seconds()
    };
    let [slow, slower, fast] = [50, 25, 200].map(timed);
    assert!(slow > 1.2 && slower > slow * 1.3, "{slow} {slower}");
    assert!(fast < 0.95 && fast > 0.5, "{fast}");
}

#[test]
fn a_feed_percentage_can_change_and_return() {
    let plain = undisturbed();
    let says = |host: JobHost| {
        (0..10u32).fold(host, |host, number| {
            let percent = [20, 400, 90, 110, 100][number as usize % 5];
            let at = MIDDLE / 4 + u64::from(number) * 700 * CYCLES_A_MS;
            host.says(at, &numbered(number + 1, &format!("M220 S{percent}")))
        })
    };
    let print = print(says, &["M220"]);
    is_whole(&print);
    assert_eq!(print.figures.order_digest, plain.figures.order_digest);
    assert!(print.replies.contains(&"FR:100%".to_owned()), "{:?}", print.replies);
}

#[test]
fn a_flow_percentage_scales_the_remaining_filament() {
    let plain = undisturbed();
    for percent in [50, 130] {
        let print = print(|host| host.says(MIDDLE, &numbered(1, &format!("M221 S{percent}"))), &[]);
        is_whole(&print);
        // The moves before M221 have all their filament, the others a part of it.
        let scaled_100pm = FILAMENT_100PM * percent / 100;
        let more_100pm = print.filament_100pm - i64::from(MOVES) * scaled_100pm;
        let before = more_100pm / (FILAMENT_100PM - scaled_100pm);
        assert_eq!(more_100pm % (FILAMENT_100PM - scaled_100pm), 0);
        assert!((200..i64::from(MOVES) - 200).contains(&before), "{before} moves");
        assert_eq!(print.counted_steps[..3], plain.counted_steps[..3]);
    }
}

#[test]
fn fan_and_temperatures_change_during_a_job() {
    let plain = undisturbed();
    let says = |host: JobHost| {
        host.says(MIDDLE, &numbered(1, "M106 S128"))
            .says(MIDDLE, &numbered(2, "M104 S205"))
            .says(MIDDLE, &numbered(3, "M140 S60"))
    };
    let print = print(says, &["M105"]);
    is_whole(&print);
    assert_eq!((plain.fan_power, print.fan_power), (0, 128));
    let temperatures = print.replies.last().unwrap();
    assert!(temperatures.contains("/205.00") && temperatures.contains("/60.00"), "{temperatures}");
    // All steps are the same, at the same times.
    assert_eq!(print.figures.step_digest, plain.figures.step_digest);
}

#[test]
fn a_pause_stops_the_machine_on_its_path() {
    let plain = undisturbed();
    let pause = MIDDLE..5 * MIDDLE;
    let print = print(|host| host.pauses(pause.clone()), &[]);
    is_whole(&print);
    assert_eq!(print.figures.order_digest, plain.figures.order_digest);
    assert_eq!(print.filament_100pm, plain.filament_100pm);
    // The board has made the moves that it had, a minute of them, and then stopped.
    let longer = print.watch.seconds() - plain.watch.seconds();
    assert!((40.0..160.0).contains(&longer), "{longer} s longer");
    let at_rest = (pause.end / CYCLES_A_MS - 1_000) as usize..(pause.end / CYCLES_A_MS) as usize;
    let places = &print.watch.every_ms[at_rest];
    assert!(places.iter().all(|place| *place == places[0]), "it moved");
    let on_path = |index: u32| {
        let [x, y, _] = profile().geometry().motor_steps(target_10nm(index)).map(i64::from);
        [x, y] == places[0]
    };
    assert!((0..MOVES - 1).any(on_path), "it rests at {:?}, where no move ends", places[0]);
}

/// Instants within a time. SplitMix64 (Steele, Lea, Flood 2014): the same ones everywhere.
fn instants(count: u64, end: u64) -> impl Iterator<Item = u64> {
    (1..=count).map(move |index| {
        let mut word = index.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        word = (word ^ word >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        word = (word ^ word >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        (word ^ word >> 31) % end
    })
}

/// A stop in the middle acts as its line arrives: no motor steps after it, and the machine knows
/// their positions.
#[track_caller]
fn stops_at_once(line: &str, after: &[&str]) -> Vec<Print> {
    // Instants from the first moves on; in the last seconds all of the job has been taken, and the
    // machine comes to its end.
    let begin = 2 * CYCLES_PER_S;
    instants(24, undisturbed().idle_at - CYCLES_PER_S - begin)
        .map(|after_begin| begin + after_begin)
        .map(|at| {
            let print = print(|host| host.says(at, line), after);
            assert_eq!(print.report.word, Word::Stopped, "{:?}", print.replies);
            let first = print.stops.first().expect("a stop");
            for stop in &print.stops {
                assert_eq!(stop.motor_steps, stop.counted_steps);
                assert!(!stop.stepped_after, "a motor stepped after the stop: {stop:?}");
                // No item of the job came after it.
                assert_eq!(stop.counted_steps, first.counted_steps);
            }
            let said_ms = print.idle_at.saturating_sub(at) / CYCLES_A_MS;
            assert!(said_ms < 400, "{said_ms} ms");
            print
        })
        .collect()
}

#[test]
fn m410_ends_the_job_at_once() {
    for print in stops_at_once("M410", &["G90", "G1 X3 Y2 F3000", "M400"]) {
        let end = profile().geometry().motor_steps([300_000, 200_000, 0]).map(i64::from);
        assert_eq!(print.counted_steps[..2], end[..2]);
    }
}

#[test]
fn m112_ends_the_job_and_halts() {
    for print in stops_at_once("M112", &["M999", "G90", "G1 X3 Y2 F3000", "M400"]) {
        assert!(print.replies.iter().any(|line| line == "echo:gpre: motion was stopped"), "{:?}", print.replies);
        let end = profile().geometry().motor_steps([300_000, 200_000, 0]).map(i64::from);
        assert_eq!(print.counted_steps[..2], end[..2]);
    }
}

/// M410 at rest in the middle of a job can stop only the job: no more of it is executed.
#[test]
fn m410_ends_a_paused_job() {
    let pause = MIDDLE..5 * MIDDLE;
    let at = 4 * MIDDLE;
    let print = print(|host| host.pauses(pause).says(at, "M410"), &["G90", "G1 X3 Y2 F3000", "M400"]);
    assert_eq!(print.report.word, Word::Stopped, "{:?}", print.replies);
    let said_ms = print.idle_at.saturating_sub(at) / CYCLES_A_MS;
    assert!(said_ms < 400, "{said_ms} ms");
    let end = profile().geometry().motor_steps([300_000, 200_000, 0]).map(i64::from);
    assert_eq!(print.counted_steps[..2], end[..2]);
}
