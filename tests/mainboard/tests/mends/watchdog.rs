//! 1.2: a debugger's halt while a heater is on.

use ferrostep_mainboard::chip::Halt;
use ferrostep_mainboard::run::Turn;
use rigless::time::VirtualNanos;

use super::scene::{MS, S, Scenario, Setting, Stage, run_scenario};
use super::stub::Stub;

/// DBGMCU_APB1_FZ with DBG_IWDG_STOP (RM0090 38.16.4): a probe that stops the watchdog sets it.
const FROZEN_BY_A_PROBE: (u32, u32, u32) = (0xE004_2008, 1 << 12, 0);

/// The watchdog's maximum time-out plus the polling interval of the pins.
const BOUND_NS: u64 = 1_900 * MS;

#[derive(Default)]
struct HaltWhileHeating {
    asked: bool,
    halted_ns: Option<u64>,
    power: f64,
    off_ns: Option<u64>,
    on_again: bool,
}

impl Scenario for HaltWhileHeating {
    fn turn(&mut self, stage: &mut Stage<'_>) -> Turn {
        let power = stage.heater("nozzle");
        if !self.asked && stage.talk.has_started(1) {
            self.asked = true;
            stage.talk.say("M104 S200");
        }
        match self.halted_ns {
            None if power > 0.5 && stage.now_ns > 800 * MS => {
                self.halted_ns = Some(stage.now_ns);
                self.power = power;
                stage.machine.chip.halt(VirtualNanos(stage.now_ns), Halt::Debugger);
            }
            None => {}
            Some(halted_ns) => {
                if power == 0.0 && self.off_ns.is_none() {
                    self.off_ns = Some(stage.now_ns - halted_ns);
                }
                self.on_again |= power > 0.0 && self.off_ns.is_some();
                if stage.now_ns > halted_ns + 4 * S {
                    return Turn::Stop;
                }
            }
        }
        Turn::Continue
    }
}

#[test]
fn a_halted_core_is_reset_and_stops_heating() {
    let boot_loader = Some(Stub { statements: vec![FROZEN_BY_A_PROBE], ..Stub::default() });
    let setting = Setting { boot_loader, ..Setting::default() };
    let done = run_scenario(&setting, 20 * S, HaltWhileHeating::default());
    let scenario = &done.operator.scenario;
    println!(
        "nozzle at {:.0} % when halted, off after {:?} ms, resets {:?}",
        scenario.power * 100.0,
        scenario.off_ns.map(|ns| ns / MS),
        done.report.resets
    );
    let text = done.operator.talk.text();
    assert!(scenario.halted_ns.is_some(), "the nozzle never heated: {text}");
    assert!(
        scenario.off_ns.is_some_and(|off_ns| off_ns <= BOUND_NS),
        "the nozzle keeps heating: {:?}{text}",
        scenario.off_ns
    );
    assert!(!scenario.on_again, "{text}");
    assert_eq!(done.report.resets.len(), 1, "{text}");
    assert!(done.operator.talk.heard("echo:reset: watchdog").is_some(), "{text}");
}
