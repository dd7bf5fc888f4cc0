//! M955 and M956: the image records the accelerations of a frame that the virtual mainboard knows,
//! and the desk finds the frame in the record.

use std::fmt::Write;
use std::path::PathBuf;

use ferrostep_analysis::calibrate::from_record;
use ferrostep_mainboard::conversation::{Conversation, Via};
use ferrostep_mainboard::decode::{Comparison, Event, Rules, TraceStep, compare};
use ferrostep_mainboard::machine::Machine;
use ferrostep_mainboard::parts::adxl345::{Adxl345, Config, Violations};
use ferrostep_mainboard::wiring::{Board, Printer};
use ferrostep_planner::{StepObserver, TICKS_PER_SECOND};
use ferrostep_session::desk::LOOK_AHEAD_BLOCKS;
use ferrostep_session::job::{self, JobProgress};
use ferrostep_session::record::Observer;
use ferrostep_session::{JobReplies, Session};
use ferrostep_testkit::boards::{BOARDS, pin};

use crate::firmware::bench::Line;
use crate::firmware::host::{Host, Port};
use crate::firmware::images::{image_of, root};
use crate::firmware::port_log::{PortState, PortWrite};
use crate::firmware::same_steps::Motion;
use rigless::image::Image;

/// The board with the plug.
const BOARD: &str = "btt-octopus-1.1";

/// The frame of X and Y, Hz.
const FRAME_HZ: [f64; 2] = [52.3, 38.7];

/// Virtual time after which a silent printer counts as dead, ns.
const LIMIT_NS: u64 = 40_000_000_000;

/// A line that keeps what the printer says.
#[derive(Debug)]
struct LoggedLine {
    line: Line,
    heard: Vec<String>,
}

impl Port for LoggedLine {
    fn send(&mut self, bytes: &[u8]) -> Result<(), String> {
        self.line.send(bytes)
    }

    fn receive(&mut self, until_ns: u64) -> Result<Option<String>, String> {
        let line = self.line.receive(until_ns)?;
        self.heard.extend(line.clone());
        Ok(line)
    }

    fn now_ns(&self) -> u64 {
        self.line.now_ns()
    }
}

/// The board with its image in a printer with a frame, and a host that has been connected.
struct Scene {
    host: Host<LoggedLine>,
}

impl Scene {
    fn new(via: Via, change: impl FnOnce(&mut Machine)) -> Self {
        let facts = BOARDS.iter().find(|board| board.name == BOARD).unwrap();
        let board = Board::read(&root().join(format!("config/boards/{BOARD}.toml"))).unwrap();
        let mut profile = std::fs::read_to_string(root().join("config/profiles/corexy.toml")).unwrap();
        for (axis, frequency_hz) in ["x", "y"].into_iter().zip(FRAME_HZ) {
            write!(profile, "\n[frame.{axis}]\nfrequency_hz = {frequency_hz}\ndamping = 0.06\n").unwrap();
        }
        let printer = Printer::parse("corexy.toml", &profile).unwrap();
        let mut machine = Machine::new(&board, &printer, 1).unwrap();
        change(&mut machine);
        let image = Image::read(&image_of(BOARD), None).unwrap();
        let conversation = Conversation::start_via(via, machine, vec![image], u64::from(facts.image_address)).unwrap();
        let mut host = Host::new(LoggedLine { line: Line(conversation), heard: Vec::new() }, LIMIT_NS);
        host.connect().unwrap();
        Self { host }
    }

    /// Bench with another chip, or another specimen of it.
    fn with_chip(via: Via, config: Config) -> Self {
        Self::new(via, move |machine| {
            machine.plant.accelerometer.as_mut().unwrap().chip = Adxl345::new(config);
        })
    }

    fn say(&mut self, line: &str) {
        self.host.send(line).unwrap_or_else(|error| panic!("{line}: {error}"));
    }

    fn machine<T: Send + 'static>(&mut self, look: impl FnOnce(&mut Machine) -> T + Send + 'static) -> T {
        self.host.port().line.0.with(move |machine, _| look(machine)).unwrap()
    }

    fn set_plugged(&mut self, plugged: bool) {
        self.machine(move |machine| {
            machine.plant.accelerometer.as_mut().unwrap().chip.set_plugged(plugged);
            machine.plant.refresh_inputs();
        });
    }

    fn heard(&mut self) -> Vec<String> {
        std::mem::take(&mut self.host.port().heard)
    }

    /// Lines that the board sends until the record's last line.
    fn record(&mut self) -> Vec<String> {
        let ends = |line: &str| line.starts_with("Rate ") || line.starts_with("echo:record ended");
        if !self.host.port().heard.iter().any(|line| ends(line)) {
            self.host.wait_for("the end of the record", ends).unwrap();
        }
        self.heard()
    }

    fn violations(&mut self) -> Violations {
        self.machine(|machine| machine.plant.accelerometer.as_ref().unwrap().chip.violations())
    }
}

fn samples(lines: &[String]) -> usize {
    lines.iter().filter(|line| line.starts_with(|first: char| first.is_ascii_digit())).count()
}

/// Lines that shake an axis to and fro, half a second each at frequencies around one: at f from
/// rest to rest over a/(16 f^2).
fn shaking(letter: char, around_hz: f64) -> Vec<String> {
    let mut lines = vec!["M201 X20000 Y20000".to_owned(), "G91".to_owned(), format!("G1 {letter}0.01 F6000")];
    for difference in -12..=16 {
        let frequency_hz = around_hz.round() + f64::from(difference);
        let acceleration = 100.0 * frequency_hz;
        let length_mm = acceleration / (16.0 * frequency_hz * frequency_hz);
        lines.push(format!("M204 T{acceleration}"));
        for _ in 0..(frequency_hz / 2.0) as u32 {
            lines.extend([length_mm, -length_mm].map(|length| format!("G1 {letter}{length:.4}")));
        }
    }
    lines
}

/// Shakes an axis and writes what the printer says to a file.
fn shaken(scene: &mut Scene, axis: usize, name: &str) -> (PathBuf, Vec<String>) {
    scene.heard();
    scene.say("M956 P0 S65535 A1");
    for line in shaking(['X', 'Y'][axis], FRAME_HZ[axis]) {
        scene.say(&line);
    }
    for line in ["M400", "M956 S0"] {
        scene.say(line);
    }
    let said = scene.record();
    let file = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::write(&file, said.join("\n")).unwrap();
    (file, said)
}

/// A chip whose oscillator is 3 % fast, as real ones are: the image measures that by its own clock.
#[test]
fn a_host_that_shakes_an_axis_finds_the_frame() {
    let mut scene = Scene::with_chip(Via::Usb, Config { fast: 0.03, ..Config::default() });
    let settings = "Accelerometer 0 type ADXL345 with orientation 20 samples at 800Hz with 13-bit resolution";
    assert_eq!(scene.host.ask("M955 P0 S700 R12", "Accelerometer").unwrap(), settings);
    for (axis, letter) in ["X", "Y"].into_iter().enumerate() {
        let (file, said) = shaken(&mut scene, axis, &format!("octopus-{letter}.log"));
        let last = said.iter().find(|line| line.starts_with("Rate ")).unwrap();
        assert_eq!(last, "Rate 824, overflows 0");
        let count = samples(&said);
        let measured = from_record(&file, axis).unwrap_or_else(|error| panic!("{error}"));
        let frequency_hz = measured.mode.frequency_hz;
        eprintln!("{letter}: {frequency_hz:.3} Hz of {} Hz, from {count} samples", FRAME_HZ[axis]);
        assert!((frequency_hz - FRAME_HZ[axis]).abs() < 0.5, "{letter}: {frequency_hz} Hz");
        let error = from_record(&file, 1 - axis).unwrap_err().to_string();
        assert!(error.contains(&format!("--axis {}", letter.to_lowercase())), "{error}");
    }
    assert_eq!(scene.violations(), Violations::default());
}

/// A computer that asks again after each empty answer, as real ones do, every 50 us; the
/// mainboard's own takes its time.
fn eager(machine: &mut Machine) {
    machine.usb_host.timing.nak_retry_ns = 50_000;
}

/// At the fastest rate no sample is lost over USB.
#[test]
fn the_fastest_rate_loses_nothing_over_usb() {
    let mut scene = Scene::new(Via::Usb, eager);
    scene.say("M955 S3200");
    scene.say("M956 S6400");
    let said = scene.record();
    assert_eq!((samples(&said), said.last().unwrap().as_str()), (6400, "Rate 3200, overflows 0"));
    // At rest it feels gravity.
    let last = said.iter().rfind(|line| line.starts_with("6399,")).unwrap();
    let g: Vec<f64> = last.split(',').skip(1).map(|g| g.parse().unwrap()).collect();
    assert!(g[0].abs() < 0.05 && g[1].abs() < 0.05 && (g[2] - 1.0).abs() < 0.05, "{last}");
    assert_eq!(scene.violations(), Violations::default());
}

/// A serial line is too slow for it: the record says so, and commands are answered meanwhile.
#[test]
fn what_a_slow_line_loses_is_told() {
    let mut scene = Scene::new(Via::Serial, |_| {});
    scene.say("M955 S1600");
    scene.say("M956 S1500");
    scene.host.ask("M115", "FIRMWARE_NAME").unwrap();
    let said = scene.record();
    let overflows: u32 = said.last().unwrap().strip_prefix("Rate 1600, overflows ").unwrap().parse().unwrap();
    assert!(overflows > 10 && samples(&said) == 1500, "{overflows} overflows");
    // A slower rate fits.
    scene.say("M955 S200");
    scene.say("M956 S400");
    assert_eq!(scene.record().last().unwrap(), "Rate 200, overflows 0");
}

#[test]
fn a_missing_chip_is_refused_by_name_and_one_that_is_pulled_ends_the_record() {
    let mut scene = Scene::new(Via::Usb, |_| {});
    scene.set_plugged(false);
    for command in ["M955", "M955 S800", "M956 S100", "M956 S100 A1"] {
        let line = scene.host.ask(command, "echo:line").unwrap();
        let says = "the accelerometer does not answer: its identity reads 0xff, expected 0xe5: check its plug, its wires and its supply";
        assert!(line.ends_with(says), "{line}");
    }
    scene.say("M956 S0");
    // It is plugged in, and pulled while it records.
    scene.set_plugged(true);
    scene.say("M955 S800");
    scene.say("M956 S60000");
    scene.host.listen(500).unwrap();
    scene.set_plugged(false);
    let said = scene.record();
    assert!(samples(&said) > 200, "{} samples", samples(&said));
    let end = "echo:record ended: the accelerometer does not answer: it says that 63 samples wait: check its plug, its wires and its supply";
    assert_eq!(said.last().unwrap(), end);
    let file = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("pulled.log");
    std::fs::write(&file, said.join("\n")).unwrap();
    let error = from_record(&file, 0).unwrap_err().to_string();
    assert!(error.contains("the printer has ended the record: the accelerometer does not answer"), "{error}");
    // Another chip's number.
    let mut scene = Scene::with_chip(Via::Usb, Config { identity: 0x44, ..Config::default() });
    let line = scene.host.ask("M955", "echo:line").unwrap();
    assert!(line.contains("its identity reads 0x44, expected 0xe5"), "{line}");
}

/// The cable is pulled: the record ends after a while, and the chip rests.
#[test]
fn an_unread_record_ends() {
    let mut scene = Scene::new(Via::Usb, |_| {});
    scene.say("M955 S100");
    scene.say("M956 S60000");
    scene.host.listen(200).unwrap();
    scene.machine(|machine| machine.usb_host.unplug());
    let measures =
        |machine: &mut Machine| machine.plant.accelerometer.as_ref().unwrap().chip.next_sample_ns().is_some();
    scene.host.listen(1000).unwrap();
    assert!(scene.machine(measures));
    scene.host.listen(12_000).unwrap();
    assert!(!scene.machine(measures), "the chip rests");
}

/// Boards without a plug have no code for it.
#[test]
fn other_boards_refuse() {
    let mut bench = crate::firmware::bench::Bench::boot();
    for command in ["M955", "M956 S100"] {
        let line = bench.host.ask(command, "echo:line").unwrap();
        assert!(
            line.contains("this board has no accelerometer: a board has one where its file has the table"),
            "{line}"
        );
    }
}

/// The pins, from the maker's drawing of the plug and not from the board's file: the bus rests high
/// before the first frame.
#[test]
fn the_bus_rests_until_it_is_used() {
    let mut scene = Scene::new(Via::Serial, Machine::keep_stores);
    let writes: Vec<PortWrite> = scene.machine(|machine| machine.stores().iter().filter_map(PortWrite::of).collect());
    let mut state = PortState::new();
    for write in writes {
        state.apply(write);
        for rests_high in ["B3", "A15"].map(pin) {
            assert!(!state.is_output(rests_high) || state.is_high(rests_high), "{rests_high:?} by {write:x?}");
        }
    }
    assert!(["B3", "A15", "B5"].iter().all(|name| state.is_output(pin(name))));
    assert!(!state.is_output(pin("B4")) && !state.is_high(pin("B5")));
}

/// The steps of the desk, with their ticks.
#[derive(Default)]
struct Steps(Vec<TraceStep>);

impl StepObserver for Steps {
    fn stepped(&mut self, tick: u64, axes: u8, directions: u8) {
        self.0.push(TraceStep { tick, axes, directions, line: 0 });
    }
}

impl Observer for Steps {
    fn redefined(&mut self, _tick: u64, _motor_steps: [i64; 4]) {}
    fn move_ended(&mut self, _tick: u64, _line: u32) {}
}

/// A job of X and Y: shaking, and long diagonals at speed.
fn job() -> String {
    let mut lines = shaking('X', 50.0);
    lines.truncate(400);
    for _ in 0..6 {
        lines.extend(["G1 X40 Y25 F18000", "G1 X-40 Y-25", "G1 Y30 F9000", "G1 X12 Y-30"].map(str::to_owned));
    }
    lines.push("M400".to_owned());
    lines.join("\n") + "\n"
}

fn desk_steps() -> (Vec<TraceStep>, u64) {
    let profile = ferrostep_profiles::load("corexy").unwrap();
    let session = Session::print(profile, LOOK_AHEAD_BLOCKS, Steps::default(), JobReplies::new(|_: &str| {}));
    let mut printer = session.printer();
    let mut progress = JobProgress::default();
    session.run(job::run(&mut job().as_bytes(), &mut printer, &mut progress, |_| {})).unwrap();
    let order = session.figures().digests.order;
    (session.into_observer().0, order)
}

/// The job on the image, with or without a record at the fastest rate.
fn printed(records: bool) -> (Vec<Event>, Motion, usize) {
    let mut scene = Scene::new(Via::Usb, eager);
    if records {
        scene.say("M955 S3200");
        scene.say("M956 S65535 A1");
    }
    for line in job().lines() {
        scene.say(line);
    }
    let motion = Motion::parse(&scene.host.ask("M797", "echo:motion ").unwrap());
    let samples = samples(&scene.heard());
    (scene.machine(|machine| machine.decoder.finish().to_vec()), motion, samples)
}

/// Recording at the fastest rate: the same steps in the same order, and no later than without.
#[test]
fn a_record_changes_no_step_and_delays_none() {
    let (desk, order) = desk_steps();
    let rules = Rules::default();
    let compared = |events: &[Event]| compare(events, &desk, u64::from(TICKS_PER_SECOND), &rules);
    let latest_ns = |comparison: &Comparison| comparison.latest.as_ref().unwrap().latency_ns;
    let (events, motion, none) = printed(false);
    let without = compared(&events);
    let (events, recorded, samples) = printed(true);
    let with = compared(&events);
    eprintln!(
        "{} steps, {samples} samples: latest {} ns, with the record {} ns",
        desk.len(),
        latest_ns(&without),
        latest_ns(&with)
    );
    assert!(none == 0 && samples > 10_000, "{samples} samples");
    for (comparison, motion) in [(&without, &motion), (&with, &recorded)] {
        assert!(comparison.difference.is_none() && comparison.too_late == 0, "{comparison:?}");
        assert_eq!((motion.order_digest, motion.underruns, motion.planning_slowdowns), (order, 0, 0), "{motion:x?}");
    }
    assert_eq!(motion.step_digest, recorded.step_digest);
    assert!(latest_ns(&with) <= latest_ns(&without) + 500, "{} and {} ns", latest_ns(&without), latest_ns(&with));
}
