//! 3.1 and 3.2: leftovers of a boot loader, lost first accesses, and the voltage scale.
//!
//! The same short job after a start from reset and after a boot loader: replies, steps and
//! heat must be equal.

use std::sync::OnceLock;

use ferrostep_mainboard::host::usb::State;
use ferrostep_mainboard::run::{Finished, Turn};
use rigless::mcu::Operate;
use rigless::soc::Width;
use rigless::time::VirtualNanos;

use super::leftovers;
use super::scene::{MS, S, Scenario, ScenarioRun, Setting, Stage, run_scenario};
use super::stub::Stub;

const PWR_CR: u64 = 0x4000_7000;
/// VOS of the F407, RM0090 5.4.1: scale 1, which 168 MHz need (DS8626 table 14).
const VOS: u64 = 1 << 14;
const RCC_CFGR: u64 = 0x4002_3808;

/// The observed behaviour of a printer.
#[derive(Debug, Clone, PartialEq, Default)]
struct Behaviour {
    /// True if the printer executed all commands, in time.
    ended: bool,
    /// Messages of the image, without temperatures.
    lines: Vec<String>,
    /// The nozzle's temperature is right.
    reads_temperatures: bool,
    /// Steps of each motor, and the time from the first to the last, us.
    steps: [usize; 4],
    motion_us: u64,
    /// The nozzle got power on command.
    heats: bool,
    /// Heaters that got power without a command.
    heats_unasked: Vec<&'static str>,
    /// A motor had current without a move.
    holds_unasked: bool,
    usb_is_open: bool,
    resets: usize,
    /// The voltage scale is 1.
    scale_1: bool,
    /// The core runs from the PLL.
    from_pll: bool,
}

#[derive(Default)]
struct ShortJob {
    begun: bool,
    asked_ns: Option<u64>,
    behaviour: Behaviour,
}

impl Scenario for ShortJob {
    fn turn(&mut self, stage: &mut Stage<'_>) -> Turn {
        if !self.begun {
            self.begun = true;
            stage.machine.usb_host.plug();
            for line in ["M105", "G91", "G1 X10 Y4 F6000", "M400", "M84", "M104 S60", "G4 P20"] {
                stage.talk.say(line);
            }
        }
        // Before that, the boot loader drives the pins.
        if stage.now_ns < MS {
            return Turn::Continue;
        }
        if !stage.talk.has_started(1) && stage.now_ns > S {
            return Turn::Stop;
        }
        let may_heat = self.asked_ns.is_some() || stage.talk.remaining() < 2;
        for (heater, may_heat) in [("nozzle", may_heat), ("bed", false)] {
            if stage.heater(heater) > 0.0 && !may_heat && !self.behaviour.heats_unasked.contains(&heater) {
                self.behaviour.heats_unasked.push(heater);
            }
        }
        let on = stage.machine.plant.drivers[0].energized();
        self.behaviour.holds_unasked |= on && !stage.talk.has_started(1);
        if stage.talk.is_quiet() && self.asked_ns.is_none() {
            self.asked_ns = Some(stage.now_ns);
        }
        let Some(asked_ns) = self.asked_ns else { return Turn::Continue };
        self.behaviour.heats |= stage.heater("nozzle") > 0.5;
        if stage.now_ns < asked_ns + 300 * MS {
            return Turn::Continue;
        }
        let at = VirtualNanos(stage.now_ns);
        let mut peek = |address| stage.machine.chip.peek(at, address, Width::W32).unwrap();
        self.behaviour.scale_1 = peek(PWR_CR) & VOS != 0;
        self.behaviour.from_pll = peek(RCC_CFGR) & 0b1111 == 0b1010;
        Turn::Stop
    }
}

fn behaviour(done: &Finished<ScenarioRun<ShortJob>>) -> Behaviour {
    let (machine, talk) = (done.machine(), &done.operator.talk);
    let mut decoder = machine.decoder.clone();
    // Earlier events belong to the boot loader.
    let events: Vec<_> = decoder.finish().iter().filter(|event| event.at_ns > MS).collect();
    // The first step comes at an update of a timer that runs already, at most an idle interval
    // after its start was asked for; the others are at their times after that update.
    let time_ns = events.get(1).zip(events.last()).map_or(0, |(second, last)| last.at_ns - second.at_ns);
    let celsius = talk.heard.iter().find_map(|(_, line)| {
        let (_, rest) = line.split_once("T:")?;
        rest.split_whitespace().next()?.parse::<f64>().ok()
    });
    Behaviour {
        ended: done.operator.ended && done.operator.scenario.asked_ns.is_some(),
        lines: talk.heard.iter().map(|(_, line)| line.clone()).filter(|line| !line.contains("T:")).collect(),
        reads_temperatures: celsius.is_some_and(|celsius| (celsius - machine.plant.ambient_celsius()).abs() < 2.0),
        steps: [1, 2, 4, 8].map(|motor| events.iter().filter(|event| event.axes & motor != 0).count()),
        motion_us: (time_ns + 500) / 1_000,
        usb_is_open: machine.usb_host.state() == State::Open,
        resets: done.report.resets.len(),
        ..done.operator.scenario.behaviour.clone()
    }
}

fn start(boot_loader: Option<Stub>, late_clocks: bool) -> (Behaviour, Vec<String>) {
    let setting = Setting { boot_loader, late_clocks, ..Setting::default() };
    let done = run_scenario(&setting, 6 * S, ShortJob::default());
    (behaviour(&done), done.report.unmodelled)
}

fn from_reset() -> &'static Behaviour {
    static FROM_RESET: OnceLock<Behaviour> = OnceLock::new();
    FROM_RESET.get_or_init(|| start(None, false).0)
}

/// A start from reset executes everything; the other starts are compared with it.
#[test]
fn a_start_from_reset_prints_and_heats() {
    let found = from_reset();
    println!("{found:#?}");
    assert!(found.ended && found.reads_temperatures && found.heats && found.usb_is_open && found.scale_1);
    assert!(found.from_pll && found.heats_unasked.is_empty() && !found.holds_unasked && found.resets == 0);
    assert_eq!(found.steps, [1000, 400, 0, 0]);
}

macro_rules! after {
    ($($(#[$what:meta])* $name:ident: $($left:ident)+,)*) => {
        $(
            $(#[$what])*
            #[test]
            fn $name() {
                let left = Stub::default()$(.and(&leftovers::$left()))+;
                let (found, _) = start(Some(left), false);
                assert_eq!(&found, from_reset());
            }
        )*
    };
}

after! {
    clocks_do_not_change_the_start: pll clocks_of_parts,
    running_parts_do_not_change_the_start: exti dma serial_ports usb ports watchdog,
    settings_of_the_core_do_not_change_the_start: systick deep_sleep priorities faults pended,
    running_timers_do_not_change_the_start: timers,
    masks_do_not_change_the_start: masks,
    stacks_of_a_boot_loader_do_not_change_the_start: stacks,
    guarded_memory_does_not_change_the_start: mpu,
    a_guarded_stack_does_not_change_the_start: guarded_stack,
    a_trap_of_unaligned_words_does_not_change_the_start: unaligned_trap,
    a_voltage_too_low_for_168_mhz_does_not_change_the_start: voltage,
}

/// All leftovers at once, except open ones and the stacks, which would lie in guarded memory.
#[test]
fn all_leftovers_at_once_do_not_change_the_start() {
    use leftovers::{
        deep_sleep, dma, exti, faults, masks, mpu, pended, pll, ports, priorities, serial_ports, systick, timers, usb,
        voltage, watchdog,
    };
    let all = [
        pll(),
        voltage(),
        exti(),
        timers(),
        dma(),
        serial_ports(),
        usb(),
        ports(),
        systick(),
        mpu(),
        deep_sleep(),
        priorities(),
        faults(),
        pended(),
        watchdog(),
    ];
    let all = all.iter().fold(masks(), Stub::and);
    let (found, _) = start(Some(all), false);
    assert_eq!(&found, from_reset());
}

#[test]
fn the_first_access_after_a_clock_enable_arrives() {
    let (found, unmodelled) = start(None, true);
    let lost: Vec<&String> = unmodelled.iter().filter(|what| what.contains("LATE_CLOCKS")).collect();
    println!("{lost:#?}");
    assert!(lost.is_empty(), "{lost:#?}");
    assert_eq!(&found, from_reset());
}
