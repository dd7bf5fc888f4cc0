//! Reads the answers of a running Marlin (M115, M503) as the definitions of its configuration.

mod command;
mod reasons;

pub(crate) use reasons::reason;

use crate::definitions::{Definition, Definitions, Running};
use command::{Command, command, value_of};

/// Names of the answers, where a file has its name.
const M115: &str = "M115";
const M503: &str = "M503";

/// Axes of lists.
const AXES: [char; 4] = ['X', 'Y', 'Z', 'E'];

/// Marks the place in a list where the printer has given no number.
const NOT_SAID: &str = "not_said";

/// Takes in the answers to M115 and M503. They hold over a file's definitions that are there.
///
/// # Errors
/// The printer is not Marlin, or does not report its settings: the reason.
pub(crate) fn add(about: &[String], settings: &[String], definitions: &mut Definitions) -> Result<(), String> {
    let name = value_of(about, "FIRMWARE_NAME:").unwrap_or_default();
    refuse_others(&name)?;
    let commands: Vec<Command<'_>> =
        settings.iter().enumerate().filter_map(|(index, line)| command(index + 1, line)).collect();
    if settings.iter().any(|line| line.contains("Unknown command")) && commands.is_empty() {
        return Err("this Marlin was built without M503 (DISABLE_M503): import its Configuration.h".to_owned());
    }
    if commands.iter().any(|command| command.code == "G20") {
        return Err("the printer reports in inches (G20): send it G21, and ask again".to_owned());
    }
    if !commands.iter().any(|command| command.code == "M92") {
        return Err(format!(
            "its answer to M503 has no steps per millimetre (M92), {} lines: is it Marlin ({})? Import its Configuration.h",
            settings.len(),
            crate::text::shown(&name)
        ));
    }
    let mut report = Report { definitions };
    report.about(about);
    report.travel(about, settings);
    for command in &commands {
        if !report.setting(command) {
            report.other(command);
        }
    }
    report.lists(&commands);
    Ok(())
}

/// Refuses firmwares that are not Marlin by the name that they say.
fn refuse_others(name: &str) -> Result<(), String> {
    const OTHERS: [(&str, &str); 6] = [
        ("klipper", "import it by --moonraker http://HOST:7125, or its printer.cfg"),
        ("reprapfirmware", "no import reads its config.g"),
        ("repetier", "no import reads its configuration"),
        ("smoothie", "no import reads its configuration"),
        ("grbl", "no import reads its configuration"),
        ("ferrostep", "its image was built from a profile: use that one"),
    ];
    let lower = name.to_ascii_lowercase();
    match OTHERS.into_iter().find(|(other, _)| lower.starts_with(other)) {
        Some((_, cure)) => Err(format!("the printer says that it is {}, not Marlin: {cure}", crate::text::shown(name))),
        None => Ok(()),
    }
}

/// The definitions to which a report is added.
struct Report<'a> {
    definitions: &'a mut Definitions,
}

impl Report<'_> {
    /// Adds a definition instead of all of its name.
    fn define(&mut self, file: &str, line: usize, by: &str, name: &str, value: &str) {
        self.definitions.replace(name);
        self.definitions.values.insert(name.to_owned(), value.to_owned());
        self.definitions.all.push(Definition {
            file: file.to_owned(),
            line,
            name: name.to_owned(),
            value: value.to_owned(),
            by: Some(by.to_owned()),
        });
    }

    fn by(&mut self, command: &Command<'_>, name: &str, value: f64) {
        self.define(M503, command.line, command.code, name, &value.to_string());
    }

    /// Adds a definition for each letter that the command has.
    fn letters(&mut self, command: &Command<'_>, names: &[(char, &str)]) -> bool {
        for (letter, name) in names {
            match command.number(*letter) {
                Some(number) => self.by(command, name, number),
                None if command.has(*letter) => self.define(M503, command.line, command.code, name, NOT_SAID),
                None => {}
            }
        }
        true
    }

    /// The machine's name and extruders.
    fn about(&mut self, about: &[String]) {
        let line = |key: &str| about.iter().position(|line| line.contains(key)).map_or(1, |index| index + 1);
        for (key, name) in [("MACHINE_TYPE:", "CUSTOM_MACHINE_NAME"), ("EXTRUDER_COUNT:", "EXTRUDERS")] {
            if let Some(value) = value_of(about, key) {
                self.define(M115, line(key), M115, name, &value);
            }
        }
    }

    /// The travel: of M115's geometry, or of the software end stops. Both count as G-code does,
    /// with the home offset.
    fn travel(&mut self, about: &[String], settings: &[String]) {
        let area = about.iter().enumerate().find_map(|(index, line)| {
            let full = line.split_once("full:{")?.1;
            let (low, high) = (full.split_once("min:{")?.1, full.split_once("max:{")?.1);
            Some((M115, index + 1, [low, high].map(|text| text.split('}').next().unwrap_or_default().to_owned())))
        });
        let ends = settings.iter().enumerate().find_map(|(index, line)| {
            let (low, high) = line.split_once("Min:")?.1.split_once("Max:")?;
            Some((M503, index + 1, [low, high].map(|text| text.to_owned())))
        });
        let Some((file, line, texts)) = area.or(ends) else { return };
        for axis in ["X", "Y", "Z"] {
            for (end, text) in ["MIN", "MAX"].into_iter().zip(&texts) {
                let mut words =
                    text.split([',', ' ']).map(|word| word.trim_matches(['{', '}', ' ']).to_ascii_uppercase());
                let number =
                    words.find_map(|word| word.strip_prefix(axis).map(|rest| rest.trim_start_matches(':').to_owned()));
                if let Some(number) =
                    number.and_then(|text| text.parse::<f64>().ok()).filter(|number| number.is_finite())
                {
                    let by = if file == M115 { "area" } else { "M211" };
                    self.define(file, line, by, &format!("{axis}_{end}_POS"), &number.to_string());
                }
            }
        }
    }

    /// Lists by axis. The filament's axis may have a separate line for each extruder.
    fn lists(&mut self, commands: &[Command<'_>]) {
        for (code, name) in [
            ("M92", "DEFAULT_AXIS_STEPS_PER_UNIT"),
            ("M203", "DEFAULT_MAX_FEEDRATE"),
            ("M201", "DEFAULT_MAX_ACCELERATION"),
        ] {
            let of_code: Vec<&Command<'_>> =
                commands.iter().filter(|command| command.code == code && command.is_of_first(&['T'])).collect();
            let Some(first) = of_code.first() else { continue };
            let number = |axis: char| {
                let number = of_code.iter().rev().find_map(|command| command.number(axis));
                number.map_or(NOT_SAID.to_owned(), |number| number.to_string())
            };
            let list = format!("{{ {} }}", AXES.map(number).join(", "));
            self.define(M503, first.line, code, name, &list);
        }
    }

    /// Takes in a command that says something a configuration has; `false` for another one.
    fn setting(&mut self, command: &Command<'_>) -> bool {
        match command.code {
            "M92" | "M203" | "M201" => command.is_of_first(&['T']),
            "M204" => {
                // Marlin 1.0 has S for prints, and T for retractions.
                let letters: &[(char, &str)] = if command.has('P') {
                    &[
                        ('P', "DEFAULT_ACCELERATION"),
                        ('R', "DEFAULT_RETRACT_ACCELERATION"),
                        ('T', "DEFAULT_TRAVEL_ACCELERATION"),
                    ]
                } else {
                    &[
                        ('S', "DEFAULT_ACCELERATION"),
                        ('T', "DEFAULT_RETRACT_ACCELERATION"),
                        ('S', "DEFAULT_TRAVEL_ACCELERATION"),
                    ]
                };
                self.letters(command, letters)
            }
            "M205" => self.corners(command),
            "M301" if command.is_of_first(&['E', 'H']) => self.gains(command, "DEFAULT_K"),
            "M304" => self.gains(command, "DEFAULT_BED_K"),
            "M306" if command.is_of_first(&['E']) => {
                self.define(M503, command.line, command.code, "MPCTEMP", "");
                for (letter, name) in [
                    ('P', "MPC_HEATER_POWER"),
                    ('C', "MPC_BLOCK_HEAT_CAPACITY"),
                    ('R', "MPC_SENSOR_RESPONSIVENESS"),
                    ('A', "MPC_AMBIENT_XFER_COEFF"),
                    ('F', "MPC_AMBIENT_XFER_COEFF_FAN255"),
                    ('H', "FILAMENT_HEAT_CAPACITY_PERMM"),
                    ('M', "FILAMENT_HEAT_CAPACITY_PERMM"),
                ] {
                    if let Some(number) = command.number(letter) {
                        self.define(M503, command.line, command.code, name, &format!("{{ {number} }}"));
                    }
                }
                true
            }
            "M851" => {
                let number = |axis| command.number(axis).map_or(NOT_SAID.to_owned(), |number| number.to_string());
                let list = format!("{{ {}, {}, {} }}", number('X'), number('Y'), number('Z'));
                self.define(M503, command.line, command.code, "NOZZLE_TO_PROBE_OFFSET", &list);
                true
            }
            "M900" if command.is_of_first(&['T']) && command.has('K') => {
                self.definitions.replace("LIN_ADVANCE_K");
                self.define(M503, command.line, command.code, "LIN_ADVANCE", "");
                self.letters(command, &[('K', "ADVANCE_K")])
            }
            "M593" => {
                for axis in ['X', 'Y'].into_iter().filter(|axis| command.has(*axis)) {
                    self.define(M503, command.line, command.code, &format!("INPUT_SHAPING_{axis}"), "");
                    let names = [format!("SHAPING_FREQ_{axis}"), format!("SHAPING_ZETA_{axis}")];
                    self.letters(command, &[('F', &names[0]), ('D', &names[1])]);
                }
                command.has('X') || command.has('Y')
            }
            "M906" => self.drivers(command, "CURRENT"),
            "M913" => self.drivers(command, "HYBRID_THRESHOLD"),
            "M914" => self.drivers(command, "STALL_SENSITIVITY"),
            "M200" => {
                let diameter = command.number('D').filter(|diameter| *diameter > 0.0 && command.is_of_first(&['T']));
                diameter.map(|diameter| self.by(command, "DEFAULT_NOMINAL_FILAMENT_DIA", diameter)).is_some()
            }
            "M207" => self.retraction(command, "RETRACT_LENGTH", "RETRACT_FEEDRATE", Some("RETRACT_ZRAISE")),
            "M208" => self.retraction(command, "RETRACT_RECOVER_LENGTH", "RETRACT_RECOVER_FEEDRATE", None),
            "M425" => {
                self.define(M503, command.line, command.code, "BACKLASH_COMPENSATION", "");
                let number = |axis| command.number(axis).unwrap_or(0.0).to_string();
                let list = format!("{{ {}, {}, {} }}", number('X'), number('Y'), number('Z'));
                self.define(M503, command.line, command.code, "BACKLASH_DISTANCE_MM", &list);
                self.letters(command, &[('F', "BACKLASH_CORRECTION"), ('S', "BACKLASH_SMOOTHING_MM")])
            }
            "M852" => {
                self.define(M503, command.line, command.code, "SKEW_CORRECTION", "");
                if command.has('J') {
                    self.define(M503, command.line, command.code, "SKEW_CORRECTION_FOR_Z", "");
                }
                self.letters(command, &[('I', "XY_SKEW_FACTOR"), ('J', "XZ_SKEW_FACTOR"), ('K', "YZ_SKEW_FACTOR")])
            }
            "M218" if command.number('T') == Some(1.0) => {
                for axis in AXES.into_iter().take(3) {
                    if let Some(offset) = command.number(axis) {
                        let name = format!("HOTEND_OFFSET_{axis}");
                        self.define(M503, command.line, command.code, &name, &format!("{{ 0.0, {offset} }}"));
                    }
                }
                true
            }
            "M420" if command.has('Z') => {
                self.define(M503, command.line, command.code, "ENABLE_LEVELING_FADE_HEIGHT", "");
                self.letters(command, &[('Z', "DEFAULT_LEVELING_FADE_HEIGHT")])
            }
            _ => false,
        }
    }

    /// A distance at corners, or speeds; what the file says of the other one no longer holds.
    fn corners(&mut self, command: &Command<'_>) -> bool {
        if command.has('J') {
            self.definitions.replace("CLASSIC_JERK");
        } else if command.has('X') {
            self.definitions.replace("JUNCTION_DEVIATION_MM");
            self.define(M503, command.line, command.code, "CLASSIC_JERK", "");
        }
        self.letters(
            command,
            &[('J', "JUNCTION_DEVIATION_MM"), ('X', "DEFAULT_XJERK"), ('Z', "DEFAULT_ZJERK"), ('E', "DEFAULT_EJERK")],
        )
    }

    /// Reads gains, which replace those of older names and of lists.
    fn gains(&mut self, command: &Command<'_>, start: &str) -> bool {
        for letter in ['P', 'I', 'D'] {
            let name = format!("{start}{letter}");
            let (older, small) = (name.replace("BED_K", "bedK"), letter.to_ascii_lowercase());
            for name in [&name, &older] {
                let start = name.trim_end_matches(letter);
                for old in
                    [format!("{name}_LIST"), format!("{start}{small}"), format!("{start}{small}_LIST"), name.clone()]
                {
                    self.definitions.replace(&old);
                }
            }
            self.letters(command, &[(letter, &name)]);
        }
        true
    }

    /// A number for each motor. Further motors of an axis have an index.
    fn drivers(&mut self, command: &Command<'_>, what: &str) -> bool {
        if !command.is_of_first(&['I', 'T']) {
            return false;
        }
        let names = AXES.map(|axis| if axis == 'E' { format!("E0_{what}") } else { format!("{axis}_{what}") });
        for (axis, name) in AXES.into_iter().zip(&names) {
            self.letters(command, &[(axis, name)]);
        }
        true
    }

    fn retraction(&mut self, command: &Command<'_>, length: &str, feed: &str, lift: Option<&str>) -> bool {
        self.letters(command, &[('S', length)]);
        if let Some(mm_per_min) = command.number('F') {
            self.by(command, feed, mm_per_min / 60.0);
        }
        if let Some(lift) = lift {
            self.letters(command, &[('Z', lift)]);
        }
        true
    }

    /// A command that no definition is for: it gets its row.
    fn other(&mut self, command: &Command<'_>) {
        let name = format!("{} {}", command.code, command.line);
        self.definitions.all.push(Definition {
            file: M503.to_owned(),
            line: command.line,
            name,
            value: command.rest.to_owned(),
            by: Some(command.code.to_owned()),
        });
    }
}

/// Reads a running printer's abilities from its answer to M115.
pub(crate) fn running(about: &[String]) -> Running {
    Running { has_probe: about.iter().any(|line| line.trim() == "Cap:Z_PROBE:1") }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
