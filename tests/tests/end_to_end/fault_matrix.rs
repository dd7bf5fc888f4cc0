//! The matrix of faults: what the printer does after each fault in each state, as the
//! book's table has it.

mod card;
mod jam;
mod sensors;
mod trial;

use ferrostep_checked_toml::book;
use ferrostep_hal_shim::{FanOutput, Heater, SpareConnector};
use ferrostep_printer::{
    ChamberSettings, FilamentSensor, FilamentSensorKind, HeaterSettings, HeaterWatch, Profile, SUPPLY_FAILS,
    SupplySignal,
};
use ferrostep_random_cases::Share;
use ferrostep_tmc2209::DriverStatus;
use ferrostep_virtual_board::{EndStopFailure, HeaterFailure};

use crate::end_to_end::command::repository;
use crate::end_to_end::desk::profile;
use crate::end_to_end::hosts::machine;
use trial::{HOST_IS_GONE_S, LONG_S, Trial, now_s};

/// A fault.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    Heater(Heater, HeaterFailure),
    FilamentRunsOut,
    HotEndFanStands,
    HostGoes,
    /// A driver reports this status.
    Driver(u32),
    DriverIsSilent,
    EmergencyStop,
    /// A module reports it, and feeds the board.
    SupplyFails,
    /// The sensor with which this axis homes fails.
    EndStop(usize, EndStopFailure),
}

const FAULTS: [(&str, Fault); 16] = [
    ("the nozzle's thermistor breaks", Fault::Heater(Heater::Nozzle, HeaterFailure::ThermistorOpen)),
    ("the nozzle's thermistor is shorted", Fault::Heater(Heater::Nozzle, HeaterFailure::ThermistorShorted)),
    ("the nozzle's thermistor falls out", Fault::Heater(Heater::Nozzle, HeaterFailure::ThermistorFellOut)),
    ("the nozzle's heater has no power", Fault::Heater(Heater::Nozzle, HeaterFailure::Dead)),
    ("the nozzle's heater cannot be switched off", Fault::Heater(Heater::Nozzle, HeaterFailure::StuckOn)),
    ("the bed's thermistor breaks", Fault::Heater(Heater::Bed, HeaterFailure::ThermistorOpen)),
    ("the bed's heater has no power", Fault::Heater(Heater::Bed, HeaterFailure::Dead)),
    ("the bed's heater cannot be switched off", Fault::Heater(Heater::Bed, HeaterFailure::StuckOn)),
    ("the chamber's thermistor breaks", Fault::Heater(Heater::Chamber, HeaterFailure::ThermistorOpen)),
    ("a driver is too hot and switches its motor off", Fault::Driver(DriverStatus::OVER_TEMPERATURE)),
    ("a driver does not answer any more", Fault::DriverIsSilent),
    ("the filament runs out", Fault::FilamentRunsOut),
    ("the hot end's fan stands", Fault::HotEndFanStands),
    ("the host is gone for 35 minutes", Fault::HostGoes),
    ("M112", Fault::EmergencyStop),
    ("a module says that the supply fails", Fault::SupplyFails),
];

/// State of the printer at the fault.
#[derive(Clone, Copy, Debug, PartialEq)]
enum At {
    Idle,
    Heating,
    Printing,
    Waiting,
    Paused,
    Homing,
    Probing,
}

const TIMES: [(&str, At); 7] = [
    ("idle", At::Idle),
    ("heating", At::Heating),
    ("printing", At::Printing),
    ("waiting", At::Waiting),
    ("paused", At::Paused),
    ("homing", At::Homing),
    ("probing", At::Probing),
];

impl At {
    /// Returns true if the printer is hot in this state, and false while it heats up.
    fn is_hot(self) -> bool {
        !matches!(self, Self::Idle | Self::Heating)
    }

    /// Lines that a host has sent before.
    fn lines_before(self) -> Vec<&'static str> {
        let mut lines = vec!["G28", "G90", "M83"];
        if self.is_hot() {
            let heats = ["M141 S40", "M140 S60", "M104 S210", "M190 S60", "M109 S210", "G1 X50 Y50 Z5 F3000", "M400"];
            lines.extend(heats);
        }
        lines
    }

    /// The command during which the fault happens, and its time, s after the command's beginning.
    fn command(self) -> Option<(&'static str, f64)> {
        match self {
            Self::Idle | Self::Printing => None,
            Self::Heating => Some(("M109 S210", 5.0)),
            Self::Waiting => Some(("G4 S400", 20.0)),
            Self::Paused => Some(("M601", 20.0)),
            Self::Homing => Some(("G28 X Y", 0.5)),
            Self::Probing => Some(("G28 Z", 0.5)),
        }
    }
}

/// Outcome for the machine, as the table has it.
fn outcome(profile: &Profile, at: At, fault: Fault) -> String {
    let machine = machine(profile);
    let mut trial = Trial::new(&machine, at, fault);
    let begun_s = now_s(&machine);
    trial.fails_at(begun_s + at.command().map_or(5.0, |(_, seconds)| seconds));
    if let Some((line, _)) = at.command() {
        trial.say(line);
    }
    let lasts_s = if fault == Fault::HostGoes { HOST_IS_GONE_S } else { LONG_S };
    let host_is_here = fault != Fault::HostGoes;
    let mut lines = 0;
    while at == At::Printing && host_is_here && now_s(&machine) < begun_s + lasts_s && !machine.signals().is_halted() {
        lines += 1;
        let said_s = now_s(&machine);
        trial.say(&format!("G1 X{} E0.5 F900", 50 + 60 * (lines % 2)));
        if now_s(&machine) == said_s {
            // The line was refused; a host takes its time nevertheless.
            trial.be_silent(1.0);
        }
    }
    if at == At::Printing && !host_is_here {
        trial.say("G1 X110 E0.5 F900");
    }
    trial.be_silent((begun_s + lasts_s - now_s(&machine)).max(10.0));
    assert!(trial.has_failed(), "{at:?} {fault:?}: it has not happened");
    let heated = at != At::Idle;
    let is_off = Heater::ALL.iter().all(|heater| machine.heaters().power(*heater) == 0.0);
    let own_pauses = usize::from(at == At::Paused);
    if machine.signals().is_halted() {
        return halted(&mut trial, is_off);
    }
    // It works, and a print continues.
    let off = trial.count("echo:heaters switched off: ") > 0;
    assert!(off || !is_off || !heated, "{at:?} {fault:?}: {:#?}", trial.said);
    // A print that a person continues has heated up again already.
    let is_hot_again = off && !is_off;
    if at.is_hot() {
        trial.say("G1 X70 E0.5 F900");
        assert!(!machine.signals().is_halted(), "{at:?} {fault:?}: {:#?}", trial.said);
    }
    let heats_again = trial.count("echo:heaters were switched off (M86)") > 0;
    let goes_on = match (is_hot_again, heats_again) {
        (true, _) => "; going on heats up again",
        (false, true) => "; the next line heats up again",
        (false, false) => "",
    };
    match (off, trial.count("//action:paused") > own_pauses) {
        (true, _) => format!("switches the heaters off{goes_on}"),
        (false, true) => {
            let what =
                if fault == Fault::FilamentRunsOut { "pauses to change it" } else { "pauses, with a cold nozzle" };
            let when = if at == At::Printing { "" } else { ", with the next line of the print" };
            format!("{what}{when}")
        }
        (false, false) if trial.count("echo:fan hotend: ") > 0 => "is reported".to_owned(),
        (false, false) => "none".to_owned(),
    }
}

/// Checks that nothing is hot or moves, that the host knows why, and that commands are refused
/// until M999 or a reset.
fn halted(trial: &mut Trial<'_>, is_off: bool) -> String {
    let (machine, fault) = (trial.machine, trial.fault);
    assert!(is_off, "{fault:?}");
    let steps = machine.figures().motor_steps;
    trial.be_silent(5.0);
    assert_eq!(machine.figures().motor_steps, steps, "{fault:?}");
    trial.say("G1 X90 F3000");
    assert_eq!(machine.figures().motor_steps, steps, "{fault:?}");
    assert!(trial.said.iter().any(|line| line.contains("M999") || line.contains("reset")), "{:#?}", trial.said);
    if fault == Fault::SupplyFails {
        assert_eq!(trial.count(SUPPLY_FAILS), 1, "{:#?}", trial.said);
    }
    if matches!(fault, Fault::EmergencyStop | Fault::SupplyFails) {
        return "halts".to_owned();
    }
    if matches!(fault, Fault::Heater(..)) {
        assert_eq!(machine.heaters().fan_power(FanOutput::Part), 255, "{fault:?}");
    }
    let error = trial.said.iter().find_map(|line| line.strip_prefix("Error:")?.split([',', ':']).next());
    let error = error.unwrap_or_else(|| panic!("{fault:?}: {:#?}", trial.said));
    format!("halts: {error}")
}

/// A row of the table: the outcomes, each with the times at which it comes. The one that comes at
/// most times is the last, without them.
fn row_of(name: &str, outcomes: &[String; TIMES.len()]) -> String {
    let mut groups: Vec<(&String, Vec<&str>)> = Vec::new();
    for (outcome, (time, _)) in outcomes.iter().zip(TIMES) {
        match groups.iter_mut().find(|(known, _)| *known == outcome) {
            Some((_, times)) => times.push(time),
            None => groups.push((outcome, vec![time])),
        }
    }
    groups.sort_by_key(|(_, times)| times.len());
    let usual = groups.pop().map_or("", |(outcome, _)| outcome.as_str());
    let others: String =
        groups.iter().map(|(outcome, times)| format!("*{}*: {outcome}<br>", times.join(", "))).collect();
    let otherwise = if others.is_empty() { "" } else { "*otherwise*: " };
    format!("| {name} | {others}{otherwise}{usual} |\n")
}

#[test]
fn each_fault_at_each_time_is_in_the_book() {
    let mut machine = profile("prusa-mini");
    machine.filament_sensor =
        Some(FilamentSensor { kind: FilamentSensorKind::Switch { missing_is_low: true }, debounce_ms: 500 });
    machine.supply_signal = Some(SupplySignal { failing_is_low: false, debounce_ms: 6, rise_10nm: 0 });
    let settings = HeaterSettings { is_warmed_by_others: true, watch: HeaterWatch::CHAMBER, ..machine.bed };
    let connector = SpareConnector::Nozzle1;
    machine.chamber = Some(ChamberSettings { thermistor: connector, heater: Some(connector), settings });
    let mut text = "| fault | the printer |\n|---|---|\n".to_owned();
    // A run tries its share of the rows, and always the emergency stop.
    let share = if book::is_written() { Share::ALL } else { Share::of_this_run() };
    let rows = FAULTS.len() + 3 + sensors::ROWS.len();
    let tried: Vec<u64> = share.cases(rows as u64).collect();
    let mut is_tried = (0..).map(|row| tried.contains(&row));
    for (name, fault) in FAULTS {
        if is_tried.next() == Some(false) && fault != Fault::EmergencyStop {
            continue;
        }
        let cells = TIMES.map(|(_, at)| outcome(&machine, at, fault));
        for ((_, at), cell) in TIMES.iter().zip(&cells) {
            // A broken thermistor is noticed cold or hot, a heater that fails only where it should
            // heat: the bed is cold while the nozzle heats.
            let must_halt = match fault {
                Fault::EmergencyStop | Fault::SupplyFails | Fault::Driver(_) => true,
                Fault::Heater(_, HeaterFailure::ThermistorOpen | HeaterFailure::ThermistorShorted) => true,
                Fault::Heater(Heater::Bed, _) => at.is_hot(),
                Fault::Heater(..) => *at != At::Idle,
                Fault::EndStop(..) => false,
                Fault::DriverIsSilent | Fault::FilamentRunsOut | Fault::HotEndFanStands | Fault::HostGoes => false,
            };
            assert!(!must_halt || cell.starts_with("halts"), "{name}, {at:?}: {cell}");
        }
        text += &row_of(name, &cells);
    }
    let mut row = |name: &str, cell: &dyn Fn(At) -> String| {
        if is_tried.next() == Some(false) {
            return;
        }
        text += &row_of(name, &TIMES.map(|(_, at)| cell(at)));
    };
    row("the filament does not move any more", &|at| jam::outcome(&machine, at));
    row("the card that prints is pulled out", &|at| card::outcome(&machine, at, true));
    row("a card that does not print is pulled out", &|at| card::outcome(&machine, at, false));
    for (name, sensors, axis, failure) in sensors::ROWS {
        row(name, &|at| sensors::outcome(sensors, at, axis, failure));
    }
    let page = repository().join("docs/src/safety.md");
    if share.is_all() { book::keep(&page, "faults", &text) } else { book::has_lines(&page, "faults", &text) }.unwrap();
}
