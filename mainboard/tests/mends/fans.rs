//! 1.4: cooling after a fault and after a reset.

use ferrostep_mainboard::chip::Halt;
use ferrostep_mainboard::parts::heat::thermistor::SensorFault;
use ferrostep_mainboard::run::Turn;
use rigless::time::VirtualNanos;

use super::scene::{MS, S, Scenario, Setting, Stage, run_scenario};

/// The failure of a printer at work with a hot nozzle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Event {
    /// Its thermistor breaks.
    OpenThermistor,
    /// The core hangs, and the watchdog resets it.
    Reset,
    /// Both: the restarted image cannot know the nozzle's temperature.
    ResetWithOpenThermistor,
}

struct HotPrint {
    event: Event,
    asked: bool,
    happened_ns: Option<u64>,
    /// Part fan and hot end's fan before.
    before: [f64; 2],
    resets_ns: Option<u64>,
    /// The instant at which the state after the failure is right.
    cooled_ns: Option<u64>,
    /// Part fan, hot end's fan and nozzle at the end.
    after: [f64; 3],
}

impl HotPrint {
    fn new(event: Event) -> Self {
        Self {
            event,
            asked: false,
            happened_ns: None,
            before: [0.0; 2],
            resets_ns: None,
            cooled_ns: None,
            after: [0.0; 3],
        }
    }

    fn happen(&self, stage: &mut Stage<'_>) {
        if self.event != Event::Reset {
            let place = stage.machine.plant.thermistors.iter_mut().find(|place| place.name == "nozzle").unwrap();
            place.thermistor.set_fault(Some(SensorFault::Open));
        }
        if self.event != Event::OpenThermistor {
            stage.machine.chip.halt(VirtualNanos(stage.now_ns), Halt::Stuck);
        }
    }
}

impl Scenario for HotPrint {
    fn turn(&mut self, stage: &mut Stage<'_>) -> Turn {
        if !self.asked && stage.talk.has_started(1) {
            self.asked = true;
            // A nozzle at 200 degrees, the part fan at a quarter, in motion.
            let now_ns = stage.now_ns;
            let nozzle = stage.machine.plant.heaters.iter_mut().find(|place| place.name == "nozzle").unwrap();
            nozzle.heater.set_temperature(now_ns, 200.0);
            for line in ["M104 S200", "M106 S64", "G91", "G1 X-40 F600", "G1 X40", "G1 X-40"] {
                stage.talk.say(line);
            }
        }
        let fans = [stage.fan("part"), stage.fan("hotend")];
        let Some(happened_ns) = self.happened_ns else {
            if stage.now_ns > 2_500 * MS {
                self.before = fans;
                self.happen(stage);
                self.happened_ns = Some(stage.now_ns);
            }
            return Turn::Continue;
        };
        if stage.machine.chip.halted() == Halt::Runs && self.resets_ns.is_none() {
            self.resets_ns = Some(stage.now_ns);
        }
        let nozzle = stage.heater("nozzle");
        // A nozzle with a known temperature needs its own fan only.
        let cools = nozzle == 0.0 && fans[1] == 1.0 && (fans[0] == 1.0 || self.event == Event::Reset);
        if cools && self.resets_ns.is_some() {
            self.cooled_ns.get_or_insert(stage.now_ns);
        } else {
            self.cooled_ns = None;
        }
        self.after = [fans[0], fans[1], nozzle];
        if stage.now_ns > happened_ns + 3 * S { Turn::Stop } else { Turn::Continue }
    }
}

fn cools_within(event: Event, bound_ns: u64) {
    let done = run_scenario(&Setting::default(), 20 * S, HotPrint::new(event));
    let (scenario, text) = (&done.operator.scenario, done.operator.talk.text());
    let from_ns = scenario.resets_ns.expect("the failure occurred");
    let took_ms = scenario.cooled_ns.map(|cooled_ns| (cooled_ns - from_ns) as f64 / 1e6);
    let found = format!(
        "{event:?}: fans (part, hot end) {:?} before, fans and nozzle {:?} 3 s later, cooled {took_ms:?} ms after the fault or \
         reset, resets {:?}",
        scenario.before, scenario.after, done.report.resets
    );
    println!("{found}");
    assert_eq!(scenario.before[1], 1.0, "the nozzle is hot: {found}{text}");
    assert!(took_ms.is_some_and(|took_ms| took_ms * 1e6 <= bound_ns as f64), "{found}{text}");
}

#[test]
fn a_heater_fault_switches_both_fans_to_full() {
    cools_within(Event::OpenThermistor, 1_500 * MS);
}

#[test]
fn the_hot_end_fan_turns_after_a_reset_in_mid_print() {
    cools_within(Event::Reset, 200 * MS);
}

#[test]
fn both_fans_turn_after_a_reset_with_unknown_temperature() {
    cools_within(Event::ResetWithOpenThermistor, 200 * MS);
}
