//! The delay of a host's pause and cancel: virtual time from a click to standstill, and to
//! heaters that are off.
//!
//! A host streams a file and clicks at the worst moment, just when it has sent a line: that line is
//! answered when there is room for it, and then the host sends no more. The same instants with
//! Marlin's queue are computed: it ends the move under way and 15 more.

use std::cell::RefCell;
use std::fmt::Write;

use embedded_hal_async::delay::DelayNs;
use ferrostep_checked_toml::book;
use ferrostep_gcode::Reply;
use ferrostep_hal_shim::Heater;
use ferrostep_planner::{StepObserver, TICKS_PER_SECOND};
use ferrostep_printer::{Heating, Profile, Replies};
use ferrostep_session::Session;
use ferrostep_session::desk::{Desk, Figures, LOOK_AHEAD_BLOCKS};
use ferrostep_session::record::Observer;
use ferrostep_testkit::program::repository;
use ferrostep_virtual_board::VirtualDelay;

use crate::end_to_end::command::example;
use crate::end_to_end::desk::profile;

/// Blocks of Marlin's queue.
const MARLIN_BLOCKS: usize = 16;

/// Lines of a file that are printed: the first layers.
const LINES: usize = 6_000;

/// Lines between two clicks.
const CLICK_EVERY: usize = 211;

/// The nozzle's temperature in these prints, degrees Celsius: set again after each cancel.
const NOZZLE_CELSIUS: f32 = 205.0;

struct Silent;

impl Replies for Silent {
    fn send(&self, _: Reply<'_>) {}
}

/// Lines of a file's moves and the ticks at which these end, without clicks.
#[derive(Default)]
struct MoveEnds(Vec<(u32, u64)>);

impl StepObserver for MoveEnds {
    fn stepped(&mut self, _: u64, _: u8, _: u8) {}
}

impl Observer for MoveEnds {
    fn redefined(&mut self, _: u64, _: [i64; 4]) {}

    fn move_ended(&mut self, tick: u64, line: u32) {
        self.0.push((line, tick));
    }
}

/// The commands of a file's first lines.
fn commands(text: &[u8]) -> Vec<String> {
    let text = std::str::from_utf8(text).unwrap();
    let commands = text.lines().filter_map(|line| line.split(';').next()).map(str::trim);
    commands.filter(|command| !command.is_empty()).take(LINES).map(str::to_owned).collect()
}

/// The print of a file.
struct Printed {
    move_ends: Vec<(u32, u64)>,
    figures: Figures,
}

fn printed(profile: &Profile, commands: &[String]) -> Printed {
    let session = Session::print(*profile, LOOK_AHEAD_BLOCKS, MoveEnds::default(), Silent);
    let mut printer = session.printer();
    session.run(async {
        for (line, command) in (1..).zip(commands) {
            printer.execute(line, command).await.unwrap();
        }
        printer.finish().await.unwrap();
    });
    let figures = session.figures();
    Printed { move_ends: session.into_observer().0, figures }
}

/// Times after a click, s.
#[derive(Clone, Copy, Debug, Default)]
struct Click {
    /// Time from a pause or cancel to standstill.
    standstill: f64,
    /// Time from a cancel that switches the heaters off first to targets of 0.
    heaters_first: f64,
    /// The same where M84 comes first, which waits for the motion.
    motors_first: f64,
    /// Time to Marlin's standstill.
    marlin: f64,
}

/// Prints a file as a host does, and clicks at intervals.
fn clicks(profile: &Profile, commands: &[String]) -> Vec<Click> {
    let ends = printed(profile, commands).move_ends;
    let session = Session::live(*profile, LOOK_AHEAD_BLOCKS, Silent);
    session.desk().grant(u64::MAX / 2);
    let mut printer = session.printer();
    let printer = RefCell::new(&mut printer);
    let say = |line: usize, command: &str, is_numbered: bool| {
        session.desk().set_host_awaited(false);
        let mut printer = printer.borrow_mut();
        session.run(printer.execute_for_host(line as u32, command, is_numbered)).unwrap();
    };
    let now_s = || session.desk().now_ns() as f64 / 1e9;
    let target = || session.heating().status(Heater::Nozzle).target_celsius;
    let mut clicks = Vec::new();
    for (line, command) in (1..).zip(commands) {
        let is_click = line % CLICK_EVERY == 0 && target() > 0.0 && !session.desk().is_idle();
        let clicked_s = now_s();
        say(line, command, true);
        if !is_click {
            continue;
        }
        for off in ["M104 S0", "M140 S0", "M107"] {
            say(line, off, false);
        }
        assert_eq!(target(), 0.0);
        let heaters_first = now_s() - clicked_s;
        let moves_left = ends.partition_point(|(of, _)| *of <= line as u32);
        // The host is silent now.
        session.desk().set_host_awaited(true);
        let is_idle = std::future::poll_fn(|_| match session.desk().is_idle() {
            true => std::task::Poll::Ready(()),
            false => std::task::Poll::Pending,
        });
        session.run(is_idle);
        let standstill = now_s() - clicked_s;
        say(line, "M84 E", false);
        let motors_first = now_s() - clicked_s;
        say(line, &format!("M104 S{NOZZLE_CELSIUS}"), false);
        let Some((_, last)) = moves_left.checked_sub(1).and_then(|index| ends.get(index)) else { continue };
        let at = last.saturating_sub((standstill * f64::from(TICKS_PER_SECOND)) as u64);
        let under_way = ends.partition_point(|(_, end)| *end <= at);
        let Some((_, end)) = ends.get(under_way + MARLIN_BLOCKS - 1) else { continue };
        let marlin = (end - at) as f64 / f64::from(TICKS_PER_SECOND);
        clicks.push(Click { standstill, heaters_first, motors_first, marlin });
    }
    clicks
}

/// Median and maximum.
fn spread(clicks: &[Click], of: impl Fn(&Click) -> f64) -> (f64, f64) {
    let mut values: Vec<f64> = clicks.iter().map(of).collect();
    values.sort_by(f64::total_cmp);
    (values[values.len() / 2], values[values.len() - 1])
}

/// Squares of long moves, 180 mm at 50 mm/s.
fn long_moves() -> Vec<u8> {
    let mut text = String::from("G28\nG90\nM83\nM109 S205\nG1 Z0.2 F3000\n");
    for _ in 0..500 {
        for place in ["X10 Y10", "X190 Y10", "X190 Y190", "X10 Y190"] {
            writeln!(text, "G1 {place} E6 F3000").unwrap();
        }
    }
    text.into_bytes()
}

#[test]
fn pause_and_cancel_act_within_seconds() {
    let profile = profile("cartesian");
    let mut table =
        "| file | clicks | pause or cancel: standstill | cancel, heaters first: off | cancel, M84 first: off | \
                     Marlin's 16 blocks: standstill |\n|---|---|---|---|---|---|\n"
            .to_owned();
    for (name, text, limit_s, heaters_limit_s) in [
        ("`examples/cube.gcode`", example("cube.gcode"), 2.1, 0.9),
        ("`examples/supports.gcode.gz`", example("supports.gcode.gz"), 2.8, 1.6),
        ("`examples/vase.gcode.gz`", example("vase.gcode.gz"), 2.4, 0.8),
        // The limit: moves that are certain, the move whose end speed the next one may change, and
        // the one that the host has just sent.
        ("moves of 180 mm at 50 mm/s", long_moves(), 0.6 + 2.0 * 3.7, 3.7),
    ] {
        let clicks = clicks(&profile, &commands(&text));
        assert!(clicks.len() >= 8, "{name}: {clicks:?}");
        let [standstill, heaters, motors, marlin]: [fn(&Click) -> f64; 4] =
            [|click| click.standstill, |click| click.heaters_first, |click| click.motors_first, |click| click.marlin];
        let show = |of: fn(&Click) -> f64| {
            let (median, longest) = spread(&clicks, of);
            format!("{median:.1} s, at most {longest:.1} s")
        };
        let (_, longest) = spread(&clicks, motors);
        assert!(longest < limit_s, "{name}: {longest} s");
        let (_, longest) = spread(&clicks, heaters);
        assert!(longest < heaters_limit_s, "{name}: heaters {longest} s");
        let cells = [show(standstill), show(heaters), show(motors), show(marlin)];
        writeln!(table, "| {name} | {} | {} |", clicks.len(), cells.join(" | ")).unwrap();
    }
    book::keep(&repository().join("docs/src/hosts.md"), "pause times", &table).unwrap();
}

/// A host that takes 10 ms for each line, OctoPrint on a small computer, sends fast enough for
/// these files: the plan is that of the whole file, to the tick.
#[test]
fn a_host_of_ten_milliseconds_a_line_makes_the_steps_of_the_file() {
    let profile = profile("cartesian");
    for (name, text) in [
        ("cube", example("cube.gcode")),
        ("supports", example("supports.gcode.gz")),
        ("vase", example("vase.gcode.gz")),
        ("long moves", long_moves()),
    ] {
        let commands = commands(&text);
        let session = Session::live(profile, LOOK_AHEAD_BLOCKS, Silent);
        session.desk().grant(u64::MAX / 2);
        let mut printer = session.printer();
        for (line, command) in (1..).zip(&commands) {
            session.desk().set_host_awaited(false);
            session.run(printer.execute_for_host(line, command, true)).unwrap();
            session.desk().set_host_awaited(true);
            session.run(VirtualDelay(session.clock()).delay_ms(10));
        }
        session.desk().set_host_awaited(false);
        session.run(printer.finish()).unwrap();
        let (streamed, file) = (session.figures(), printed(&profile, &commands).figures);
        eprintln!("{name}: {streamed:?}");
        assert_eq!((streamed.starvation_flushes, streamed.underruns), (0, 0), "{name}");
        assert_eq!(streamed.digests, file.digests, "{name}");
    }
}
