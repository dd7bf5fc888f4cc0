//! The filament does not move any more: an encoder's row, on a machine whose time passes
//! as a board's does.

use embedded_hal_async::delay::DelayNs;
use ferrostep_hal_shim::Heater;
use ferrostep_printer::{FilamentSensor, FilamentSensorKind, Profile};
use ferrostep_session::desk::LOOK_AHEAD_BLOCKS;
use ferrostep_session::{LiveSession, Session};
use ferrostep_virtual_board::VirtualDelay;

use super::At;
use super::trial::LONG_S;
use crate::end_to_end::refusals::Collector;

type Machine = LiveSession<Collector>;

/// The person who continues a paused print, and the jam, which is mended in the print's own pause.
struct Person {
    jams_at_s: f64,
    paused_s: Option<f64>,
    pauses: u32,
    mends_in: u32,
}

fn now_s(machine: &Machine) -> f64 {
    machine.clock().now_ns() as f64 * 1e-9
}

impl Person {
    /// Looks at the printer whenever time has passed.
    fn look(&mut self, machine: &Machine) {
        let now_s = now_s(machine);
        if now_s >= self.jams_at_s {
            self.jams_at_s = f64::INFINITY;
            machine.set_filament_stuck(true);
        }
        if !machine.signals().is_paused_for_user() {
            self.paused_s = None;
            return;
        }
        if self.paused_s.is_none() {
            self.pauses += 1;
        }
        if now_s - *self.paused_s.get_or_insert(now_s) > LONG_S {
            if self.pauses >= self.mends_in {
                machine.set_filament_stuck(false);
            }
            machine.signals().end_wait();
        }
    }
}

/// Outcome for the machine, as the table has it.
pub fn outcome(profile: &Profile, at: At) -> String {
    let kind = FilamentSensorKind::Encoder { detection_10nm: 300_000 };
    let profile = Profile { filament_sensor: Some(FilamentSensor { kind, debounce_ms: 5 }), ..*profile };
    let machine: Machine = Session::live(profile, LOOK_AHEAD_BLOCKS, Collector::default());
    machine.desk().grant(u64::MAX / 2);
    let mut printer = machine.printer();
    let own_pauses = u32::from(at == At::Paused);
    let mut person = Person { jams_at_s: f64::INFINITY, paused_s: None, pauses: 0, mends_in: own_pauses + 1 };
    let mut number = 0;
    let mut said = Vec::new();
    let mut say = |person: &mut Person, line: &str| -> Vec<String> {
        number += 1;
        machine.desk().set_host_awaited(false);
        let done = machine.run_with(printer.execute_for_host(number, line, true), |machine| person.look(machine));
        machine.desk().set_host_awaited(true);
        done.unwrap_or_else(|failure| panic!("{at:?}: {line}: {failure}"));
        machine.replies().take()
    };
    for line in at.lines_before() {
        say(&mut person, line);
    }
    let begun_s = now_s(&machine);
    person.jams_at_s = begun_s + at.command().map_or(5.0, |(_, seconds)| seconds);
    if let Some((line, _)) = at.command() {
        said.extend(say(&mut person, line));
    }
    let mut lines = 0;
    let mut lay = |person: &mut Person| {
        lines += 1;
        say(person, &format!("G1 X{} E0.5 F900", 50 + 60 * (lines % 2)))
    };
    while at == At::Printing && now_s(&machine) < begun_s + LONG_S {
        said.extend(lay(&mut person));
    }
    let silence_s = (begun_s + LONG_S - now_s(&machine)).max(10.0);
    let wait = async { VirtualDelay(machine.clock()).delay_ms((silence_s * 1e3) as u32).await };
    machine.run_with(wait, |machine| person.look(machine));
    assert_eq!(person.jams_at_s, f64::INFINITY, "{at:?}: it has not happened");
    let pauses_by_itself = person.pauses > own_pauses;
    // The extruder still turns while a print lays the length without filament motion that
    // counts as a jam.
    for _ in 0..if at.is_hot() && !pauses_by_itself { 20 } else { 0 } {
        said.extend(lay(&mut person));
    }
    let is_heated = |heater: &Heater| machine.heaters().power(*heater) > 0.0;
    assert!(at == At::Idle || Heater::ALL.iter().any(is_heated), "{at:?}: {said:#?}");
    let is_told = said.iter().any(|line| line.starts_with("echo:The filament does not move"));
    assert_eq!(is_told, person.pauses > own_pauses, "{at:?}: {said:#?}");
    match (person.pauses - own_pauses, pauses_by_itself) {
        (0, _) => "none".to_owned(),
        (1, true) => "pauses to change it".to_owned(),
        (1, false) => "pauses to change it, with the next lines of the print".to_owned(),
        (pauses, _) => panic!("{at:?}: {pauses} pauses: {said:#?}"),
    }
}
