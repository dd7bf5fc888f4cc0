//! 1.4: cooling after a fault and after a reset, and a fan that does not turn.

use ferrostep_mainboard::chip::Halt;
use ferrostep_mainboard::parts::fan::FanFault;
use ferrostep_mainboard::parts::heat::thermistor::SensorFault;
use ferrostep_mainboard::run::Turn;
use rigless::time::VirtualNanos;

use super::scene::{MS, S, Scenario, Setting, Stage, run_scenario};

/// The failure of a printer at work with a hot nozzle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Event {
    /// The thermistor breaks.
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

/// A hot nozzle whose fan stops, or turns on.
struct HotEndFan {
    stops: bool,
    /// The next of the times at which something happens, s.
    times: std::vec::IntoIter<u64>,
    next_ns: u64,
    stopped_ns: u64,
}

impl HotEndFan {
    fn new(stops: bool) -> Self {
        Self { stops, times: vec![9, 17, 18].into_iter(), next_ns: 0, stopped_ns: 0 }
    }
}

impl Scenario for HotEndFan {
    fn turn(&mut self, stage: &mut Stage<'_>) -> Turn {
        let now_ns = stage.now_ns;
        if now_ns < self.next_ns || !stage.talk.has_started(1) {
            return Turn::Continue;
        }
        if self.next_ns == 0 {
            let nozzle = stage.machine.plant.heaters.iter_mut().find(|place| place.name == "nozzle").unwrap();
            nozzle.heater.set_temperature(now_ns, 200.0);
            stage.talk.say("M104 S200");
        } else {
            stage.talk.say("M123");
        }
        if self.next_ns == 9 * S && self.stops {
            let fan = stage.machine.plant.fans.iter_mut().find(|fan| fan.name == "hotend").unwrap();
            fan.fan.set_fault(now_ns, Some(FanFault::Stuck));
            self.stopped_ns = now_ns;
        }
        let Some(next_s) = self.times.next() else { return Turn::Stop };
        self.next_ns = next_s * S;
        Turn::Continue
    }
}

/// Time from the stop of a fan to its report, s, and all that was heard.
fn watched(stops: bool) -> (Option<f64>, String) {
    let done = run_scenario(&Setting::default(), 25 * S, HotEndFan::new(stops));
    let (scenario, talk) = (&done.operator.scenario, &done.operator.talk);
    let reported_ns = talk.heard("echo:fan hotend: ");
    (reported_ns.map(|reported_ns| reported_ns.saturating_sub(scenario.stopped_ns) as f64 * 1e-9), talk.text())
}

#[test]
fn a_hot_end_fan_that_stands_is_reported_and_one_that_turns_is_not() {
    let (reported_s, text) = watched(true);
    println!("reported {reported_s:?} s after it stopped\n{text}");
    assert!(reported_s.is_some_and(|reported_s| (1.0..7.0).contains(&reported_s)), "{reported_s:?}{text}");
    assert!(text.contains(" turns a minute at full power, at least 1000 are expected"), "{text}");
    let (reported_s, text) = watched(false);
    assert_eq!(reported_s, None, "{text}");
    let speed = |line: &str| line.split("hotend:").nth(1)?.split(' ').next()?.parse::<f64>().ok();
    let speeds: Vec<f64> = text.lines().filter_map(speed).collect();
    // The model's fan has 6000 turns a minute.
    assert!(speeds.len() == 2 && speeds.iter().all(|rpm| (5_900.0..=6_100.0).contains(rpm)), "{speeds:?}{text}");
}
