//! A macro at the beginning of a file that the profile lacks is taken for the machine's start: it
//! homes and heats.

use ferrostep_gcode::{AxisWords, Command, Decimal, Units, parse};
use ferrostep_hal_shim::Heater;
use ferrostep_printer::{Ports, Printer};

use super::first_targets::{FirstTargets, Source, Told};
use super::lines;
use super::words::Words;
use crate::ahead::Ahead;

/// Minimum value of a word that is a temperature of the nozzle: below are diameters and
/// numbers of tools.
const MIN_NOZZLE_CELSIUS: f64 = 100.0;

/// Minimum value of a word that is a temperature of the bed or the chamber.
const MIN_BED_CELSIUS: f64 = 20.0;

/// Degrees above the lowest temperature for extruding at which a nozzle without a target is
/// assumed: a wait ends a little below.
const ABOVE_LOWEST_CELSIUS: f64 = 10.0;

/// Beginnings of names that are Klipper's own commands and no macros of a person's.
const OWN_NAMES: [&str; 22] = [
    "ACCELEROMETER_",
    "ACTIVATE_",
    "BED_MESH_",
    "CANCEL_PRINT",
    "CLEAR_PAUSE",
    "DUMP_",
    "END_PRINT",
    "EXCLUDE_OBJECT",
    "GET_",
    "INIT_",
    "PRINT_END",
    "QUERY_",
    "RESPOND",
    "RESTORE_",
    "SAVE_",
    "SDCARD_",
    "SET_",
    "SKEW_PROFILE",
    "STEPPER_",
    "TEST_",
    "TIMELAPSE_",
    "UPDATE_",
];

/// Kinds of heaters by what the keys of their words contain.
const NOZZLE_PARTS: [&str; 4] = ["EXTRUDER", "HOTEND", "NOZZLE", "TOOL"];
const BED_PART: &str = "BED";
const CHAMBER_PART: &str = "CHAMBER";
/// Part of the keys of temperatures after the first layer.
const LATER_PART: &str = "OTHER";

/// Returns true if a command, in capitals, may be a person's macro that starts the machine: a
/// name, and not a letter with a mark as Prusa's `Tx`.
pub(super) fn may_be_start(name: &str) -> bool {
    name.len() > 2
        && name.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_')
        && !OWN_NAMES.iter().any(|own| name.starts_with(own))
}

/// Temperatures in the words of a macro.
#[derive(Debug, Default, PartialEq)]
struct Temperatures {
    nozzle: Option<f64>,
    bed: Option<f64>,
    chamber: Option<f64>,
}

impl Temperatures {
    fn of(text: &str) -> Self {
        let mut found = Self::default();
        for (key, value) in Words::of(text).pairs() {
            // Of several tools the first.
            let value = value.split(',').next().and_then(|value| Decimal::parse(value.trim().as_bytes()).ok());
            let (Some(celsius), key) = (value.map(Decimal::to_f64), key.to_ascii_uppercase()) else { continue };
            let (target, minimum_celsius) = if key.contains(BED_PART) {
                (&mut found.bed, MIN_BED_CELSIUS)
            } else if key.contains(CHAMBER_PART) {
                (&mut found.chamber, MIN_BED_CELSIUS)
            } else if NOZZLE_PARTS.iter().any(|part| key.contains(part)) {
                (&mut found.nozzle, MIN_NOZZLE_CELSIUS)
            } else {
                continue;
            };
            if celsius >= minimum_celsius && target.is_none() && !key.contains(LATER_PART) {
                *target = Some(celsius);
            }
        }
        found
    }
}

/// A macro that may be the start: the next move shows whether the file has homed and
/// heated by other lines.
#[derive(Debug)]
pub(super) struct Call {
    /// Line of the command.
    pub line: u32,
    /// Text of the command.
    pub text: String,
    /// The printer knows its name, as one that is not executed.
    pub is_known: bool,
    /// The temperatures that it names, in words for a remark.
    heated: String,
}

/// The start of a file's machine.
#[derive(Debug, Default)]
pub(super) struct Start {
    first_targets: FirstTargets,
    call: Option<Call>,
    /// The axes count as homed, and have not been.
    is_assumed_home: bool,
    /// Axes whose place the next move says.
    unknown: [bool; 3],
}

/// Sets heaters, and waits for them. Returns the temperatures in words for a remark.
async fn heat<P: Ports>(printer: &mut Printer<'_, P>, line: u32, heaters: [Option<Told>; 3]) -> Result<String, String> {
    const NAMES: [[&str; 3]; 3] = [["nozzle", "M104", "M109"], ["bed", "M140", "M190"], ["chamber", "M141", "M191"]];
    let heaters = || NAMES.into_iter().zip(heaters).filter_map(|(names, told)| Some((names, told?)));
    let sets = heaters().map(|([_, set, _], told)| format!("{set} S{}", told.celsius));
    let waits = heaters().map(|([.., wait], told)| format!("{wait} S{}", told.celsius));
    let all: Vec<String> = sets.chain(waits).collect();
    lines::execute_all(printer, line, &all).await?;
    Ok(heaters().map(|([name, ..], told)| format!(" {name} at {} C ({});", told.celsius, told.by)).collect())
}

impl Start {
    /// Reads a portion of the file before its lines are executed.
    pub fn look(&mut self, portion: &[u8]) {
        self.first_targets.read(portion);
    }

    /// A macro is called that may be the start: the heaters of its words are set. Returns this
    /// call, or the one before, if it is not the start.
    ///
    /// # Errors
    /// The printer refuses a temperature.
    pub async fn call<P: Ports>(
        &mut self,
        printer: &mut Printer<'_, P>,
        (line, text): (u32, &str),
        is_known: bool,
    ) -> Result<Option<Call>, String> {
        let words = Temperatures::of(text);
        let by_word = |celsius: Option<f64>| celsius.map(|celsius| Told { celsius, by: Source::Word });
        let has_chamber = printer.profile().heater(Heater::Chamber).is_some_and(|chamber| chamber.is_heated);
        let chamber = by_word(words.chamber).filter(|_| has_chamber);
        let heated = heat(printer, line, [by_word(words.nozzle), by_word(words.bed), chamber]).await?;
        let call = Call { line, text: text.to_owned(), is_known, heated };
        if call.heated.is_empty() && self.call.is_some() {
            return Ok(Some(call));
        }
        Ok(self.call.replace(call))
    }

    /// The call that is waiting, before a line that needs a machine that is homed and heated.
    pub fn take_call_before(&mut self, text: &str) -> Option<Call> {
        self.call.as_ref()?;
        let needs_start = match parse(text) {
            Ok(Command::Linear { axes, .. }) => axes.x.or(axes.y).or(axes.z).or(axes.e).is_some(),
            Ok(Command::Arc { .. } | Command::Retract | Command::Recover | Command::Bed(_)) => true,
            _ => false,
        };
        self.call.take_if(|_| needs_start)
    }

    /// The call that is waiting.
    pub fn take_call(&mut self) -> Option<Call> {
        self.call.take()
    }

    /// Takes a call for the machine's start. Returns a remark that says what the desk assumed;
    /// `None`: other lines have homed and heated.
    ///
    /// # Errors
    /// The printer refuses a temperature.
    pub async fn assume<P: Ports>(
        &mut self,
        printer: &mut Printer<'_, P>,
        call: &Call,
        ahead: &mut Ahead<'_>,
    ) -> Result<Option<String>, String> {
        let (state, targets) = (printer.gcode_state(), printer.prepared_state());
        let mut heated = call.heated.clone();
        if targets.nozzle_celsius == 0 {
            self.first_targets.read(ahead.see());
            self.first_targets.end();
            let lowest_celsius = f64::from(state.min_extrusion_celsius).ceil() + ABOVE_LOWEST_CELSIUS;
            let lowest = Told { celsius: lowest_celsius, by: Source::Lowest };
            let nozzle = self.first_targets.nozzle().unwrap_or(lowest);
            let bed = self.first_targets.bed().filter(|_| targets.bed_celsius == 0);
            heated += &heat(printer, call.line, [Some(nozzle), bed, None]).await?;
        }
        let is_homed = state.homed == [true; 3];
        if is_homed && heated.is_empty() {
            return Ok(None);
        }
        let mut remark = "the profile has no such macro; taken for the machine's start:".to_owned();
        if !is_homed {
            let home_10nm = printer.profile().homing.map(|homing| homing.position_10nm);
            printer.take_place(home_10nm).await.map_err(|error| error.to_string())?;
            (self.unknown, self.is_assumed_home) = ([true; 3], true);
            remark.push_str(" homed, the nozzle where the next move begins;");
        }
        Ok(Some(remark + &heated + " --strict-macros gives it no effect, as on a board"))
    }

    /// Homes all axes before a line that homes or probes some, if they only count as homed: the
    /// motors are elsewhere.
    ///
    /// # Errors
    /// Homing fails.
    pub async fn home_truly<P: Ports>(
        &mut self,
        printer: &mut Printer<'_, P>,
        line: u32,
        text: &str,
    ) -> Result<(), String> {
        let is_homing = matches!(parse(text), Ok(Command::Home { unless_homed: false, .. } | Command::Bed(_)));
        if self.is_assumed_home && is_homing {
            (self.unknown, self.is_assumed_home) = ([false; 3], false);
            lines::execute_all(printer, line, &["M84".to_owned(), "G28".to_owned()]).await?;
        }
        Ok(())
    }

    /// Returns true if the axes only count as homed.
    pub fn is_assumed_home(&self) -> bool {
        self.is_assumed_home
    }

    /// Returns true while the next move says where the nozzle is.
    pub fn seeks_place(&self) -> bool {
        self.unknown != [false; 3]
    }

    /// Learns from a line, before it is executed, where the nozzle is: a first move to a
    /// place begins there.
    ///
    /// # Errors
    /// Motion was stopped before.
    pub async fn learn_place<P: Ports>(&mut self, printer: &mut Printer<'_, P>, text: &str) -> Result<(), String> {
        let axes = match parse(text) {
            Ok(Command::Linear { axes, .. }) => axes,
            Ok(Command::SetPosition(AxisWords { x: None, y: None, z: None, .. })) => return Ok(()),
            // They begin where the nozzle is taken to be.
            Ok(Command::Arc { .. } | Command::Home { .. } | Command::SetPosition(_)) => {
                self.unknown = [false; 3];
                return Ok(());
            }
            _ => return Ok(()),
        };
        let state = printer.gcode_state();
        let mut machine_10nm = state.machine_10nm;
        let places = machine_10nm.iter_mut().zip(state.logical_10nm).zip(&mut self.unknown);
        for (((machine_10nm, logical_10nm), unknown), word) in places.zip([axes.x, axes.y, axes.z]) {
            let Some(value) = word else { continue };
            let length_10nm = match state.units {
                Units::Millimetres => Some(value.to_10nm_from_mm()),
                Units::Inches => value.to_10nm_from_inches(),
            };
            // A place beyond any machine is refused when the line is executed.
            let Some(length_10nm) = length_10nm else { continue };
            if std::mem::take(unknown) && !state.is_relative {
                *machine_10nm = length_10nm.saturating_sub(logical_10nm.saturating_sub(*machine_10nm));
            }
        }
        if machine_10nm != state.machine_10nm {
            printer.take_place(machine_10nm).await.map_err(|error| error.to_string())?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_name_heaters_by_kind() {
        for (words, [nozzle, bed, chamber]) in [
            ("EXTRUDER_TEMP=240 BED_TEMP=100", [240.0, 100.0, 0.0]),
            ("BED=60 EXTRUDER=215.5 CHAMBER=40", [215.5, 60.0, 40.0]),
            ("hotend='230' bed_temp=\"55\"", [230.0, 55.0, 0.0]),
            ("TOOL_TEMP=250,0 INITIAL_TOOL=0 BED_TYPE=textured NOZZLE_SIZE=0.4", [250.0, 0.0, 0.0]),
            ("EXTRUDER_OTHER_LAYER_TEMP=205 EXTRUDER_TEMP=210 BED_SIZE=0", [210.0, 0.0, 0.0]),
            ("EXTRUDER=0 NOZZLE_TEMP=200 BED_MESH=1 BED_TEMP=0", [200.0, 0.0, 0.0]),
            ("EXTRUDER_TEMP={first_layer_temperature[0]} MATERIAL=ABS SPEED=300", [0.0; 3]),
            ("EXTRUDER_TEMP= BED_TEMP", [0.0; 3]),
        ] {
            let some = |celsius: f64| (celsius > 0.0).then_some(celsius);
            let expected = Temperatures { nozzle: some(nozzle), bed: some(bed), chamber: some(chamber) };
            assert_eq!(Temperatures::of(&format!("START_PRINT {words}")), expected, "{words}");
        }
    }

    #[test]
    fn klippers_own_commands_are_no_start() {
        for name in ["START_PRINT", "PRINT_START", "_PREPARE", "LINE_PURGE", "PRINTER_START2"] {
            assert!(may_be_start(name), "{name}");
        }
        for name in ["SET_GCODE_VARIABLE", "BED_MESH_PROFILE", "END_PRINT", "TIMELAPSE_RENDER", "WHAT?"] {
            assert!(!may_be_start(name), "{name}");
        }
    }
}
