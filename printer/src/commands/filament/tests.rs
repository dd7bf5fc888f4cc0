//! The filament sensor, and the pause when the filament has run out.

use core::cell::RefCell;
use core::future::Future;
use core::pin::pin;
use core::task::{Context, Poll, Waker};
use std::borrow::ToOwned;
use std::string::{String, ToString};
use std::vec::Vec;

use ferrostep_gcode::Reply;
use ferrostep_hal_shim::{Clock, Heater};

use super::*;
use crate::heat::report::{HeatFault, HeaterStatus};
use crate::job::filament::FilamentWatch;
use crate::job::lines::Source;
use crate::motion::homing::tests::rig::{Rig, RigMotion, wait_once};
use crate::settings::profile::filament::FilamentSensorKind;
use crate::signals::Signals;

const SENSOR: FilamentSensor =
    FilamentSensor { kind: FilamentSensorKind::Switch { missing_is_low: true }, debounce_ms: 500 };

/// A hot nozzle, and the texts sent.
struct World {
    rig: Rig,
    target_celsius: f32,
    signals: Signals,
    texts: RefCell<Vec<String>>,
}

struct Hot(f32);

impl Heating for Hot {
    type Supply = crate::Present;
    type Models = crate::Present;

    fn set_target(&mut self, _: Heater, _: f32) {}
    fn status(&self, _: Heater) -> HeaterStatus {
        HeaterStatus { celsius: self.0, target_celsius: self.0, power: 0.3 }
    }
    fn all_off(&mut self) {}
    fn restart(&mut self) -> Result<(), HeatFault> {
        Ok(())
    }
}

/// Clock on which every wait is a wait for a person.
#[derive(Clone)]
struct Waits;

impl Clock for Waits {
    fn now_ms(&self) -> u64 {
        0
    }
}

impl embedded_hal_async::delay::DelayNs for Waits {
    async fn delay_ns(&mut self, _: u32) {
        wait_once().await;
    }
}

impl Replies for World {
    fn send(&self, reply: Reply<'_>) {
        self.texts.borrow_mut().extend(reply.to_string().lines().map(ToOwned::to_owned));
    }
}

type TestPrinter<'a> = Printer<'a, (RigMotion<'a>, Hot, Waits, World)>;

impl World {
    fn new(target_celsius: f32, sensor: Option<FilamentSensor>) -> Self {
        let rig = Rig::new(|profile| profile.filament_sensor = sensor);
        Self { rig, target_celsius, signals: Signals::new(), texts: RefCell::default() }
    }

    fn printer(&self) -> TestPrinter<'_> {
        let heating = Hot(self.target_celsius);
        Printer::new(&self.rig.profile, RigMotion::new(&self.rig), heating, Waits, self, &self.signals)
    }

    /// Executes a host's line; returns `true` if it paused and continued after a person's answer.
    fn pauses(&self, printer: &mut TestPrinter<'_>, line: &str, is_numbered: bool) -> bool {
        self.texts.borrow_mut().clear();
        let mut has_paused = false;
        let mut execution = pin!(printer.execute_for_host(1, line, is_numbered));
        for _ in 0..100 {
            if execution.as_mut().poll(&mut Context::from_waker(Waker::noop())).is_ready() {
                return has_paused;
            }
            assert!(self.signals.is_paused_for_user(), "{line} waits for something else");
            has_paused = true;
            self.signals.answer_prompt(0);
        }
        panic!("{line} does not end")
    }

    fn said(&self, text: &str) -> bool {
        self.texts.borrow().iter().any(|said| said.contains(text))
    }
}

#[test]
fn a_state_counts_when_it_has_lasted() {
    let signals = Signals::new();
    let mut watch = FilamentWatch::new();
    // The switch bounces, then reports missing filament for less than the time, then for longer;
    // the clock wraps.
    let begin_ms = u32::MAX - 700;
    let mut look = |after_ms: u32, is_missing| {
        watch.look(begin_ms.wrapping_add(after_ms), is_missing, &SENSOR, &signals);
        signals.is_filament_missing()
    };
    for (after_ms, is_missing, counts) in [
        (0, false, false),
        (100, true, false),
        (200, false, false),
        (300, true, false),
        (700, true, false),
        (799, true, false),
        (800, true, true),
        (900, false, true),
        (1000, true, true),
        (1100, false, true),
        (1599, false, true),
        (1600, false, false),
    ] {
        assert_eq!(look(after_ms, is_missing), counts, "after {after_ms} ms");
    }
}

#[test]
fn a_print_pauses_after_the_line_as_m600_does_and_again_until_filament_is_there() {
    let world = World::new(210.0, Some(SENSOR));
    let mut printer = world.printer();
    assert!(!world.pauses(&mut printer, "G1 X10 E1 F600", true));
    world.signals.set_filament_missing(true);
    assert!(world.pauses(&mut printer, "G1 X20 E2", true));
    for text in [
        "//action:paused",
        "echo:The filament has run out",
        "//action:prompt_begin Change the filament",
        "//action:resumed",
        "ok",
    ] {
        assert!(world.said(text), "{text}: {:?}", world.texts);
    }
    assert_eq!(world.rig.believed_mm(), [20.0, 0.0, 0.0], "back where the line ends");
    assert!(world.pauses(&mut printer, "G1 X30 E3", true), "it is missing still");
    world.signals.set_filament_missing(false);
    assert!(!world.pauses(&mut printer, "G1 X40 E4", true));
}

#[test]
fn nothing_pauses_an_idle_printer_a_person_or_a_sensor_that_is_off() {
    for (celsius, before, line, is_numbered, pauses) in [
        (210.0, "M412 S1", "G1 X20 E2 F600", true, true),
        (210.0, "M412 S1", "G3 X20 I10 E2 F600", true, true),
        (210.0, "M412 S0", "G1 X20 E2 F600", true, false),
        // A person's line, new filament, a travel, a cold nozzle.
        (210.0, "M412 S1", "G1 X20 E2 F600", false, false),
        (210.0, "M412 S1", "G1 E20 F600", true, false),
        (210.0, "M412 S1", "G1 X20 F600", true, false),
        (210.0, "M412 S1", "M105", true, false),
        (0.0, "M302 P1", "G1 X20 E2 F600", true, false),
    ] {
        let world = World::new(celsius, Some(SENSOR));
        let mut printer = world.printer();
        world.pauses(&mut printer, before, true);
        world.signals.set_filament_missing(true);
        assert_eq!(world.pauses(&mut printer, line, is_numbered), pauses, "{before}, {line}");
    }
}

/// A card's reader waits by itself, and continues reading when the print is no longer paused.
#[test]
fn a_print_from_a_card_is_paused_after_the_line() {
    let world = World::new(210.0, Some(SENSOR));
    let mut printer = world.printer();
    world.signals.set_filament_missing(true);
    printer.lines.source = Source::Card;
    let command = ferrostep_gcode::parse("G1 X20 E2 F600").unwrap();
    let outcome = {
        let mut execution = pin!(printer.command_with_signs_of_life(&command));
        execution.as_mut().poll(&mut Context::from_waker(Waker::noop()))
    };
    assert!(matches!(outcome, Poll::Ready(Ok(_))), "{outcome:?}");
    assert!(printer.is_paused());
    assert!(world.said("//action:paused") && world.said("The filament has run out"));
}

#[test]
fn m412_and_m119_report_the_sensor() {
    let world = World::new(210.0, Some(SENSOR));
    let mut printer = world.printer();
    let asks = |printer: &mut TestPrinter<'_>, line: &str, answer: &str| {
        world.pauses(printer, line, false);
        assert!(world.said(answer), "{line}: {:?}", world.texts);
    };
    asks(&mut printer, "M412", "echo:Filament runout ON; filament: present");
    asks(&mut printer, "M119", "filament: TRIGGERED");
    world.signals.set_filament_missing(true);
    asks(&mut printer, "M119", "filament: open");
    asks(&mut printer, "M412 S0", "ok");
    asks(&mut printer, "M412", "echo:Filament runout OFF; filament: missing");
    asks(&mut printer, "M115", "Cap:RUNOUT:1");
    asks(&mut printer, "M412 S2", "S: 2 is out of range");

    let world = World::new(210.0, None);
    let mut printer = world.printer();
    for (line, answer) in [("M412", true), ("M412 S1", true), ("M412 S0", false)] {
        world.pauses(&mut printer, line, false);
        assert_eq!(world.said("echo:no filament sensor: the profile has no filament_sensor"), answer, "{line}");
    }
    world.pauses(&mut printer, "M119", false);
    assert!(!world.said("filament"));
    world.signals.set_filament_missing(true);
    assert!(!world.pauses(&mut printer, "G1 X20 E2 F600", true));
}

const ENCODER: FilamentSensor =
    FilamentSensor { kind: FilamentSensorKind::Encoder { detection_10nm: 700_000 }, debounce_ms: 5 };

#[test]
fn filament_that_stands_pauses_a_print_in_words_of_its_own() {
    let world = World::new(210.0, Some(ENCODER));
    let mut printer = world.printer();
    assert!(!world.pauses(&mut printer, "G1 X10 E1 F600", true));
    world.signals.set_filament_missing(true);
    assert!(world.pauses(&mut printer, "G1 X20 E2", true));
    for text in [
        "//action:paused",
        "echo:The filament does not move, it is jammed or has run out; M412 S0 ignores the sensor",
        "//action:prompt_begin Change the filament",
        "//action:resumed",
    ] {
        assert!(world.said(text), "{text}: {:?}", world.texts);
    }
    // The encoder has not moved since, but a person has handled the filament.
    assert!(!world.pauses(&mut printer, "G1 X30 E3", true));
    assert!(!world.signals.is_filament_missing());
}

#[test]
fn an_encoder_counts_anew_where_a_person_may_have_moved_filament() {
    for (line, is_numbered, counts_anew) in [
        ("G28", true, true),
        ("M104 S200", true, true),
        ("G1 E5 F300", false, true),
        ("G1 E-0.8 F2400", true, false),
        ("G1 X50 F6000", true, false),
        ("M105", false, false),
    ] {
        let world = World::new(210.0, Some(ENCODER));
        let mut printer = world.printer();
        world.pauses(&mut printer, "G1 X10 E1 F600", true);
        assert!(world.signals.take_filament_counts_anew(), "a print begins");
        world.pauses(&mut printer, line, is_numbered);
        world.pauses(&mut printer, "G1 X20 E2 F600", true);
        assert_eq!(world.signals.take_filament_counts_anew(), counts_anew, "{line}");
        world.pauses(&mut printer, "G1 X30 E3", true);
        assert!(!world.signals.take_filament_counts_anew(), "{line}");
    }
}

#[test]
fn m412_sets_an_encoders_length_and_counts_anew() {
    let world = World::new(210.0, Some(ENCODER));
    let mut printer = world.printer();
    let asks = |printer: &mut TestPrinter<'_>, line: &str, answer: &str| {
        world.pauses(printer, line, false);
        assert!(world.said(answer), "{line}: {:?}", world.texts);
    };
    asks(&mut printer, "M412", "echo:Filament runout ON; distance: 7 mm; filament: present");
    world.signals.take_filament_counts_anew();
    asks(&mut printer, "M412 D12.5", "ok");
    assert!(!world.said("echo") && !world.signals.take_filament_counts_anew());
    for refused in ["M412 D0.9", "M412 D100.1", "M412 D-7", "M412 S0 D0"] {
        asks(&mut printer, refused, "is out of range");
    }
    world.signals.set_filament_missing(true);
    asks(&mut printer, "M412", "echo:Filament runout ON; distance: 12.5 mm; filament: missing");
    asks(&mut printer, "M119", "filament: open");
    asks(&mut printer, "M412 R", "ok");
    assert!(world.signals.take_filament_counts_anew());
    asks(&mut printer, "M412 S0", "ok");
    asks(&mut printer, "M412", "echo:Filament runout OFF; distance: 12.5 mm; filament: present");
    asks(&mut printer, "G20", "ok");
    asks(&mut printer, "M412 D1", "ok");
    asks(&mut printer, "M412", "distance: 25.4 mm");

    let world = World::new(210.0, Some(SENSOR));
    let mut printer = world.printer();
    world.pauses(&mut printer, "M412 D5", false);
    assert!(!world.said("out of range") && !world.said("distance"), "{:?}", world.texts);
}

/// Both sensors act, each with its own messages.
#[test]
fn a_switch_beside_an_encoder_speaks_for_itself() {
    let rig = Rig::new(|profile| {
        profile.filament_sensor = Some(ENCODER);
        profile.filament_switch = Some(SENSOR);
    });
    let world = World { rig, target_celsius: 210.0, signals: Signals::new(), texts: RefCell::default() };
    let mut printer = world.printer();
    let mut asks = |line: &str, answer: &str| {
        world.pauses(&mut printer, line, false);
        assert!(world.said(answer), "{line}: {:?}", world.texts);
    };
    asks("M412", "echo:Filament runout ON; distance: 7 mm; filament: present; switch: present");
    let mut watch = FilamentWatch::new();
    for now_ms in [0, 499, 500] {
        assert!(!world.signals.is_filament_out());
        watch.look_beside_encoder(now_ms, true, &SENSOR, &world.signals);
    }
    assert!(world.signals.is_filament_out() && !world.signals.is_filament_missing());
    asks("M412", "filament: present; switch: missing");
    asks("M119", "filament: open");
    // The encoder's count does not bring the switch's filament back.
    asks("M412 R", "ok");
    asks("M412", "filament: present; switch: missing");
    world.signals.set_filament_missing(true);
    assert!(world.pauses(&mut printer, "G1 X10 E1 F600", true));
    assert!(world.said("echo:The filament has run out; M412 S0 ignores the sensor"), "{:?}", world.texts);
    world.signals.set_filament_out(false);
    assert!(!world.pauses(&mut printer, "G1 X20 E2", true), "it counts anew");
    world.signals.set_filament_missing(true);
    assert!(world.pauses(&mut printer, "G1 X30 E3", true));
    assert!(world.said("echo:The filament does not move, it is jammed or has run out"), "{:?}", world.texts);
}
