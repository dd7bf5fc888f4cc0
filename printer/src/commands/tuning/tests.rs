//! M301, M303 and M304 on a machine whose heaters are models.
#![allow(clippy::unwrap_used)]

use core::cell::{Cell, RefCell};
use core::future::Future;
use core::pin::pin;
use core::task::{Context, Poll, Waker};
use std::borrow::ToOwned;
use std::string::{String, ToString};
use std::vec::Vec;
use std::{format, vec};

use ferrostep_gcode::Reply;
use ferrostep_hal_shim::{Clock, FanOutput, Heater};
use ferrostep_virtual_board::{HeatedMass, HeaterFailure, VirtualHeaters};

use crate::heat::control::HeatControl;
use crate::heat::gains::PidGains;
use crate::heat::model::HeaterModel;
use crate::heat::relay::RelayProgress;
use crate::heat::report::{HeatFault, HeaterStatus};
use crate::heat::sample_time::SAMPLE_MS;
use crate::heat::step_response::StepProgress;
use crate::job::lines::Source;
use crate::motion::homing::tests::rig::{Rig, RigMotion, wait_once};
use crate::ports::{Heating, Replies};
use crate::printer::Printer;
use crate::signals::Signals;

/// Heaters, their control and the time.
pub(crate) struct World {
    heat: RefCell<(HeatControl, VirtualHeaters)>,
    now_ms: Cell<u64>,
    signals: Signals,
    texts: RefCell<Vec<String>>,
    rig: Rig,
}

impl World {
    pub(crate) fn new() -> Self {
        Self::with(|_| {})
    }

    /// A world with a changed profile.
    pub(crate) fn with(change: impl FnOnce(&mut crate::settings::profile::Profile)) -> Self {
        let rig = Rig::new(|profile| {
            profile.nozzle.mass = HeatedMass { dead_time_s: 1.0, sensor_lag_s: 2.0, ..HeatedMass::NOZZLE };
            change(profile);
        });
        let mut heaters = rig.profile.virtual_heaters();
        let mut control: HeatControl = HeatControl::new(rig.profile.heaters(), rig.profile.fans, &mut heaters);
        control.set_models(|heater| rig.profile.control_model(heater));
        control.set_nozzle_fan(rig.profile.tool_fan());
        let heat = RefCell::new((control, heaters));
        Self { heat, now_ms: Cell::new(0), signals: Signals::new(), texts: RefCell::default(), rig }
    }

    pub(crate) fn printer(&self) -> TestPrinter<'_> {
        Printer::new(&self.rig.profile, RigMotion::new(&self.rig), Warm(self), Time(self), self, &self.signals)
    }

    pub(crate) fn change(&mut self, change: impl FnOnce(&mut crate::settings::profile::Profile)) {
        change(&mut self.rig.profile);
    }

    pub(crate) fn profile(&self) -> &crate::settings::profile::Profile {
        &self.rig.profile
    }

    pub(crate) fn signals(&self) -> &Signals {
        &self.signals
    }

    /// Returns the texts since the last call.
    pub(crate) fn said(&self) -> Vec<String> {
        self.texts.take()
    }

    /// Time since the start, ms.
    pub(crate) fn now_ms(&self) -> u64 {
        self.now_ms.get()
    }

    /// Makes a model control a heater.
    pub(crate) fn set_model(&self, heater: Heater, model: HeaterModel) {
        self.heat.borrow_mut().0.set_model(heater, model);
    }

    pub(crate) fn model(&self, heater: Heater) -> Option<HeaterModel> {
        self.heat.borrow().0.model(heater)
    }

    fn gains(&self, heater: Heater) -> PidGains {
        self.heat.borrow().0.gains(heater)
    }

    pub(crate) fn fan_power(&self, output: FanOutput) -> u8 {
        self.heat.borrow().0.fan(output).power
    }

    pub(crate) fn target(&self, heater: Heater) -> f32 {
        self.heat.borrow().0.status(heater).target_celsius
    }
}

pub(crate) type TestPrinter<'a> = Printer<'a, (RigMotion<'a>, Warm<'a>, Time<'a>, World)>;

pub(crate) struct Warm<'a>(&'a World);

impl Heating for Warm<'_> {
    type Supply = crate::Present;
    type Models = crate::Present;

    fn set_target(&mut self, heater: Heater, celsius: f32) {
        self.0.heat.borrow_mut().0.set_target(heater, celsius);
    }
    fn status(&self, heater: Heater) -> HeaterStatus {
        self.0.heat.borrow().0.status(heater)
    }
    fn has_nozzles(&self) -> bool {
        self.0.heat.borrow().0.has_nozzles()
    }
    fn nozzle(&self) -> Heater {
        self.0.heat.borrow().0.nozzle()
    }
    fn select_nozzle(&mut self, heater: Heater) {
        self.0.heat.borrow_mut().0.select_nozzle(heater);
    }
    fn chamber_is_heated(&self) -> Option<bool> {
        self.0.heat.borrow().0.chamber_is_heated()
    }
    fn all_off(&mut self) {
        self.0.heat.borrow_mut().0.all_off();
    }
    fn gains(&self, heater: Heater) -> PidGains {
        self.0.heat.borrow().0.gains(heater)
    }
    fn set_gains(&mut self, heater: Heater, gains: PidGains) {
        self.0.heat.borrow_mut().0.set_gains(heater, gains);
    }
    fn begin_relay(&mut self, heater: Heater, celsius: f32, cycles: u8, has_fan: bool) {
        self.0.heat.borrow_mut().0.begin_relay(heater, celsius, cycles, has_fan);
    }
    fn relay(&self, heater: Heater) -> Option<RelayProgress> {
        self.0.heat.borrow().0.relay(heater)
    }
    fn model(&self, heater: Heater) -> Option<HeaterModel> {
        self.0.heat.borrow().0.model(heater)
    }
    fn set_model(&mut self, heater: Heater, model: HeaterModel) {
        self.0.heat.borrow_mut().0.set_model(heater, model);
    }
    fn begin_step(&mut self, heater: Heater, celsius: f32, has_fan: bool) {
        self.0.heat.borrow_mut().0.begin_step(heater, celsius, has_fan);
    }
    fn step(&self, heater: Heater) -> Option<StepProgress> {
        self.0.heat.borrow().0.step(heater)
    }
    fn restart(&mut self) -> Result<(), HeatFault> {
        self.0.heat.borrow_mut().0.restart()
    }
}

/// Clock on which time passes while a command waits, once per call, so that a test can act in
/// between.
#[derive(Clone)]
pub(crate) struct Time<'a>(&'a World);

impl Clock for Time<'_> {
    fn now_ms(&self) -> u64 {
        self.0.now_ms.get()
    }
}

impl embedded_hal_async::delay::DelayNs for Time<'_> {
    async fn delay_ns(&mut self, ns: u32) {
        let samples = ns / 1_000_000 / SAMPLE_MS;
        for _ in 0..samples {
            let (control, heaters) = &mut *self.0.heat.borrow_mut();
            heaters.advance(SAMPLE_MS as f32 * 1e-3);
            if control.update(heaters).is_err() {
                self.0.signals.halt();
            }
        }
        self.0.now_ms.set(self.0.now_ms.get() + u64::from(samples * SAMPLE_MS));
        wait_once().await;
    }
}

impl Replies for World {
    fn send(&self, reply: Reply<'_>) {
        self.texts.borrow_mut().extend(reply.to_string().lines().map(ToOwned::to_owned));
    }
}

/// Executes a line of a host; while it waits, `act` is called with the seconds so far.
pub(crate) fn execute(world: &World, printer: &mut TestPrinter<'_>, line: &str, act: impl Fn(u64)) -> bool {
    let begun_ms = world.now_ms.get();
    let mut execution = pin!(printer.execute_for_host(1, line, false));
    loop {
        match execution.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
            Poll::Ready(outcome) => return outcome.is_ok(),
            Poll::Pending => act((world.now_ms.get() - begun_ms) / 1000),
        }
        assert!(world.now_ms.get() - begun_ms < 3_600_000, "{line} does not end");
    }
}

pub(crate) fn say(world: &World, line: &str) -> Vec<String> {
    let mut printer = world.printer();
    execute(world, &mut printer, line, |_| {});
    world.said()
}

#[test]
fn gains_are_set_in_marlins_units_and_reported() {
    let world = World::new();
    assert_eq!(say(&world, "M301"), ["echo:M301 P25.5 I0 D0 F0", "ok"]);
    assert_eq!(say(&world, "M301 P22.2 I1.08 D114 F0.1"), ["ok"]);
    assert_eq!(say(&world, "M301"), ["echo:M301 P22.2 I1.08 D114 F0.1", "ok"]);
    assert_eq!(say(&world, "M301 D0"), ["ok"]);
    assert_eq!(say(&world, "M301"), ["echo:M301 P22.2 I1.08 D0 F0.1", "ok"]);
    assert_eq!(say(&world, "M304 P120 I1.5 D600"), ["ok"]);
    assert_eq!(say(&world, "M304"), ["echo:M304 P120 I1.5 D600", "ok"]);
    let gains = world.heat.borrow().0.gains(Heater::Nozzle);
    assert!((gains.proportional - 22.2 / 255.0).abs() < 1e-6);
}

#[test]
fn absurd_gains_are_refused_by_name_and_nothing_changes() {
    let world = World::new();
    let before = say(&world, "M301");
    for (line, why) in [
        ("M301 P0", "P: 0 is out of range, expected 0.0255 to 2550"),
        ("M301 I5 P-3", "P: -3 is out of range, expected 0.0255 to 2550"),
        ("M301 P20 I1 D99999", "D: 99999 is out of range, expected 0 to 25500"),
        ("M301 P20 I-0.1", "I: -0.1 is out of range, expected 0 to 2550"),
        ("M301 P20 F9", "F: 9 is out of range, expected 0 to 2.55"),
        ("M301 Pnan", "P: \"nan\" is not a number"),
    ] {
        let said = say(&world, line);
        assert!(said[0].contains(why), "{line}: {said:?}");
        assert_eq!(say(&world, "M301"), before, "{line}");
    }
}

#[test]
fn an_autotune_reports_its_cycles_and_the_gains_and_sets_them_only_with_u() {
    for (line, uses) in [("M303 E0 S200 C3", false), ("M303 E0 S200 C3 U", true)] {
        let world = World::new();
        let before = world.heat.borrow().0.gains(Heater::Nozzle);
        let said = say(&world, line);
        assert_eq!(said[0], "PID Autotune start");
        let cycles = said.iter().filter(|text| text.starts_with(" cycle: ")).count();
        assert_eq!(cycles, 7, "{said:?}");
        // The swing of the cycle that has ended, not of the one that has begun.
        for text in said.iter().filter(|text| text.starts_with(" cycle: ")).skip(1) {
            let figures: Vec<f32> = text.split(' ').filter_map(|word| word.parse().ok()).collect();
            let [lowest, highest] = figures[..] else { panic!("{text}") };
            assert!(lowest < 199.0 && highest > 201.0, "{text}");
        }
        assert!(said.iter().any(|text| text == "echo:busy: processing"), "{said:?}");
        assert_eq!(said.iter().filter(|text| text.starts_with("ok")).count(), 1);
        let at = said.iter().position(|text| text == "PID Autotune finished!").unwrap();
        let [p, i, d, m301, keys, fan, ok] = &said[at + 1..] else { panic!("{said:?}") };
        let number = |text: &str| text.rsplit(' ').next().unwrap().parse::<f32>().unwrap();
        assert_eq!(
            *m301,
            format!("echo:M301 P{} I{} D{} F{}", number(p), number(i), number(d), m301.rsplit('F').next().unwrap())
        );
        assert!(p.starts_with("#define DEFAULT_Kp ") && d.starts_with("#define DEFAULT_Kd "));
        assert!(keys.starts_with("echo:nozzle: proportional = 0."), "{keys}");
        assert!(fan.starts_with("echo:nozzle: fan_gain = 0.0"), "{fan}");
        assert_eq!(ok, "ok");
        let after = world.heat.borrow().0.gains(Heater::Nozzle);
        assert_eq!(after != before, uses);
        assert!(!uses || (after.proportional * 255.0 - number(p)).abs() < 1e-3);
        assert_eq!((world.target(Heater::Nozzle), world.target(Heater::Bed)), (0.0, 0.0), "the heater is off");
        // The reported line sets the same values.
        let line = m301.strip_prefix("echo:").unwrap();
        assert_eq!(say(&world, line), ["ok"]);
        assert_eq!(say(&world, "M301"), vec![m301.clone(), "ok".to_owned()]);
    }
}

#[test]
fn the_bed_is_tuned_without_a_fan() {
    let world = World::new();
    world.heat.borrow_mut().0.set_fan_demand(crate::heat::fans::FanDemand::part(10));
    let said = say(&world, "M303 E-1 S60 C3");
    assert!(said.iter().any(|text| text.starts_with("#define DEFAULT_bedKp ")), "{said:?}");
    assert!(said.iter().any(|text| text.starts_with("echo:M304 P")), "{said:?}");
    assert!(!said.iter().any(|text| text.contains("fan_gain")), "{said:?}");
    assert_eq!(said.iter().filter(|text| text.starts_with(" cycle: ")).count(), 3);
}

#[test]
fn m108_a_stop_a_halt_and_a_timeout_end_it_and_the_gains_stay() {
    type Act = fn(&World);
    let ends: [(&str, Act, &str); 4] = [
        ("M108", |world| world.signals.end_wait(), "PID Autotune ended by M108, the gains stay"),
        ("M410", |world| world.rig.stop_from_outside(), "motion was stopped"),
        (
            "M112",
            |world| {
                world.heat.borrow_mut().0.all_off();
                world.signals.halt();
            },
            "the printer is halted",
        ),
        ("M86", |world| world.heat.borrow_mut().0.all_off(), "the heaters were switched off during the wait"),
    ];
    for (name, end, said_so) in ends {
        for at_s in [5, 90] {
            let world = World::new();
            let before = world.heat.borrow().0.gains(Heater::Nozzle);
            let mut printer = world.printer();
            let has_ended = Cell::new(false);
            execute(&world, &mut printer, "M303 S200 U", |second| {
                if second >= at_s && !has_ended.replace(true) {
                    assert_eq!(world.target(Heater::Nozzle), 200.0);
                    end(&world);
                }
            });
            let said = world.said();
            assert!(said.iter().any(|text| text.contains(said_so)), "{name}: {said:?}");
            assert_eq!(world.target(Heater::Nozzle), 0.0, "{name}");
            assert_eq!(world.heat.borrow().0.relay(Heater::Nozzle), None, "{name}");
            assert_eq!(world.heat.borrow().0.gains(Heater::Nozzle), before, "{name}");
            assert!(world.now_ms.get() < (at_s + 2) * 1000, "{name}");
        }
    }
}

#[test]
fn a_fault_ends_it() {
    let world = World::new();
    let mut printer = world.printer();
    let is_ok = execute(&world, &mut printer, "M303 S200", |second| {
        if second >= 90 {
            world.heat.borrow_mut().1.set_failure(Heater::Nozzle, Some(HeaterFailure::ThermistorOpen));
        }
    });
    assert!(!is_ok && world.signals.is_halted());
    assert_eq!(world.heat.borrow().0.fault().map(|fault| fault.heater), Some(Heater::Nozzle));
}

#[test]
fn a_target_out_of_range_and_a_print_refuse_it() {
    for (before, line, why) in [
        ("M105", "M303 S270", "S: 270 is out of range, expected 40 to 260"),
        ("M105", "M303 S20", "S: 20 is out of range, expected 40 to 260"),
        ("M105", "M303 E-1 S270", "S: 270 is out of range, expected 40 to 265"),
        ("M104 S100", "M303 S200", "M303 needs an idle printer"),
        ("M104 S100", "M303 E-1 S60", "M303 needs an idle printer"),
    ] {
        let world = World::new();
        say(&world, before);
        let target = world.target(Heater::Nozzle);
        let said = say(&world, line);
        assert!(said[0].contains(why), "{line}: {said:?}");
        assert_eq!(world.target(Heater::Nozzle), target, "{line}");
        assert_eq!(world.heat.borrow().0.relay(Heater::Nozzle), None);
    }
    let world = World::new();
    let mut printer = world.printer();
    printer.lines.source = Source::Card;
    let paused = {
        let mut pausing = pin!(printer.pause(crate::job::paused::PauseReason::Pause));
        loop {
            if let Poll::Ready(outcome) = pausing.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
                break outcome;
            }
        }
    };
    paused.unwrap();
    world.said();
    execute(&world, &mut printer, "M303 S200", |_| {});
    let said = world.said();
    assert!(said[0].contains("M303 needs an idle printer"), "{said:?}");
}

/// A chamber with a heater, or a thermometer alone.
fn with_chamber(is_heated: bool) -> World {
    use ferrostep_hal_shim::SpareConnector;
    World::with(|profile| {
        let settings = crate::settings::profile::heaters::HeaterSettings {
            max_celsius: 80.0,
            max_target_celsius: 70.0,
            watch: crate::settings::profile::heaters::HeaterWatch::CHAMBER,
            mass: HeatedMass { dead_time_s: 10.0, sensor_lag_s: 20.0, ..HeatedMass::CHAMBER },
            is_heated,
            is_warmed_by_others: true,
            ..profile.bed
        };
        let heater = is_heated.then_some(SpareConnector::Nozzle1);
        profile.chamber = Some(crate::settings::profile::heaters::ChamberSettings {
            thermistor: SpareConnector::Nozzle1,
            heater,
            settings,
        });
    })
}

#[test]
fn m303_finds_the_gains_of_a_chamber() {
    let world = with_chamber(true);
    let before = world.gains(Heater::Chamber);
    let mut printer = world.printer();
    execute(&world, &mut printer, "M303 E-2 S45 C3 U", |second| {
        assert!(second != 5 || world.target(Heater::Chamber) == 45.0 && world.target(Heater::Bed) == 0.0);
    });
    let said = world.said();
    let at = said.iter().position(|text| text == "PID Autotune finished!").unwrap();
    let [p, _, _, m309, last, ok] = &said[at + 1..] else { panic!("{said:?}") };
    assert!(p.starts_with("#define DEFAULT_chamberKp ") && m309.starts_with("echo:M309 P"), "{said:?}");
    assert!(last.starts_with("echo:chamber: proportional = ") && ok == "ok", "{said:?}");
    let found = world.gains(Heater::Chamber);
    assert!(found != before && world.target(Heater::Chamber) == 0.0);
    // The reported line sets the same values.
    assert_eq!(say(&world, m309.strip_prefix("echo:").unwrap()), ["ok"]);
    assert_eq!(say(&world, "M309"), vec![m309.clone(), String::from("ok")]);
    assert_eq!(say(&world, "M309 P25.5 I0.255 D0"), ["ok"]);
    let PidGains { proportional, .. } = world.gains(Heater::Chamber);
    assert!((proportional - 0.1).abs() < 1e-6);
    // 10 degrees below the maximum, and not above the highest target.
    assert!(say(&world, "M303 E-2 S75")[0].contains("S: 75 is out of range, expected 40 to 70"));
}

#[test]
fn a_chamber_without_a_heater_is_refused_by_name() {
    for (world, why) in
        [(with_chamber(false), "the chamber has no heater to tune: the bed warms it"), (World::new(), "chamber")]
    {
        let said = say(&world, "M303 E-2 S50");
        assert!(said[0].starts_with("echo:line 1: ") && said[0].contains(why), "{said:?}");
        assert_eq!(world.target(Heater::Chamber), 0.0);
    }
    assert_eq!(say(&World::new(), "M309 P20").last().unwrap(), "ok");
}
