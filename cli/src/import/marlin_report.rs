//! What a running Marlin says of itself (M115, M503), as the definitions of its configuration.

use super::marlin::{Definition, Definitions, Running};

/// Names of the answers, where a file has its name.
const M115: &str = "M115";
const M503: &str = "M503";

/// Axes of lists.
const AXES: [char; 4] = ['X', 'Y', 'Z', 'E'];

/// Stands in a list where the printer has said no number.
const NOT_SAID: &str = "not_said";

/// A command of the report.
struct Command<'a> {
    line: usize,
    /// Its letter and number.
    code: &'a str,
    /// All after the code, without its comment.
    rest: &'a str,
}

impl Command<'_> {
    /// The number after a letter.
    fn number(&self, letter: char) -> Option<f64> {
        let mut words = self.rest.split_whitespace();
        let text = words.find_map(|word| word.strip_prefix(letter))?;
        text.parse().ok().filter(|number: &f64| number.is_finite())
    }

    fn has(&self, letter: char) -> bool {
        self.rest.split_whitespace().any(|word| word.starts_with(letter))
    }

    /// Whether it is of the first extruder, heater or motor, by the letter that says which.
    fn is_of_first(&self, letters: &[char]) -> bool {
        letters.iter().all(|letter| !self.has(*letter) || self.number(*letter) == Some(0.0))
    }
}

/// Takes in the answers to M115 and M503. They hold over a file's definitions that are there.
///
/// # Errors
/// It is not Marlin, or does not report its settings: the reason.
pub(super) fn add(about: &[String], settings: &[String], definitions: &mut Definitions) -> Result<(), String> {
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
            super::shown(&name)
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
        Some((_, cure)) => Err(format!("the printer says that it is {}, not Marlin: {cure}", super::shown(name))),
        None => Ok(()),
    }
}

/// What stands after a key in the answer to M115, up to the next key.
fn value_of(about: &[String], key: &str) -> Option<String> {
    let is_key = |word: &&str| {
        let key = word.split(':').next().unwrap_or_default();
        word.contains(':') && key.len() > 2 && key.bytes().all(|byte| byte.is_ascii_uppercase() || byte == b'_')
    };
    let rest = about.iter().find_map(|line| line.split_once(key).map(|(_, rest)| rest))?;
    let words: Vec<&str> = rest.split_whitespace().take_while(|word| !is_key(word)).collect();
    Some(words.join(" ")).filter(|value| !value.is_empty())
}

/// The command of a line, if it is one: `echo:  M92 X80.00 ...`.
fn command(line: usize, text: &str) -> Option<Command<'_>> {
    let text = ["echo:", "Config:"].iter().find_map(|start| text.trim().strip_prefix(start)).unwrap_or(text).trim();
    let text = text.split(';').next().unwrap_or_default().trim();
    let (code, rest) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
    let digits = code.strip_prefix(['M', 'G'])?;
    let is_code = !digits.is_empty() && digits.len() < 5 && digits.bytes().all(|byte| byte.is_ascii_digit());
    // The printer repeats the command where it echoes.
    (is_code && code != M503).then_some(Command { line, code, rest: rest.trim() })
}

/// The definitions to which a report is added.
struct Report<'a> {
    definitions: &'a mut Definitions,
}

impl Report<'_> {
    /// Adds a definition in the place of all of its name.
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

    /// The travel: of M115's geometry, or of the software end stops. Both count as G-code does, with the home offset.
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

    /// Lists by axis. The filament's axis may have a line of its own for each extruder.
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

    /// Gains, in the place of those of older names and of lists.
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

/// What a running printer says beside its settings.
pub(super) fn running(about: &[String]) -> Running {
    Running { has_probe: about.iter().any(|line| line.trim() == "Cap:Z_PROBE:1") }
}

/// Why a profile has no place for a command of a report; `None` for a definition.
pub(super) fn reason(name: &str) -> Option<&'static str> {
    let (code, _) = name.split_once(' ').filter(|(code, _)| code.starts_with(['M', 'G']))?;
    Some(match code {
        "G21" | "M149" => "units of the report: a profile has millimetres and degrees Celsius",
        "M92" | "M203" | "M201" => "a second extruder's: write its steps as tools.t1.steps_per_mm",
        "M200" => "volumetric extrusion: a job sets it, M200",
        "M145" => "presets of a screen's menu",
        "M206" => "the travel of M115 and M211 has it in it already: a profile's origin is where G-code has it",
        "M211" => "a profile's soft limits are always on",
        "M217" | "M603" | "M600" => "moves of filament changes: the printer's own",
        "M301" | "M306" | "M900" => "another extruder's",
        "M412" | "M591" => "which level says that filament is missing is not told: write filament_sensor by hand",
        "M420" | "M421" => "the bed is measured by G29",
        "M493" | "M494" => "Marlin's motion by fixed times: write input_shaper by hand",
        "M569" => "the kind of driver and its microsteps are not told: write drivers by hand",
        "M906" | "M913" | "M914" => "of a further motor",
        _ => return None,
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn report(settings: &[&str]) -> Result<Definitions, String> {
        let mut definitions = Definitions::default();
        let settings: Vec<String> = settings.iter().map(|line| (*line).to_owned()).collect();
        add(
            &["FIRMWARE_NAME:Marlin 2.1.2 (Jan  1 2024 10:00:00) MACHINE_TYPE:My printer EXTRUDER_COUNT:1".to_owned()],
            &settings,
            &mut definitions,
        )
        .map(|()| definitions)
    }

    #[track_caller]
    fn says(settings: &[&str], expected: &[(&str, &str)]) {
        let definitions = report(settings).unwrap();
        for (name, value) in expected {
            assert_eq!(definitions.get(name).map(|definition| definition.value.as_str()), Some(*value), "{name}");
        }
    }

    #[test]
    fn reports_of_all_ages_are_read() {
        says(
            &[
                "echo:Steps per unit:",
                "echo:  M92 X80.00 Y80.00 Z400.50 E94.30",
                "echo:  M203 X450.00 Y450.00 Z5.00 E25.00",
                "echo:Acceleration: S=acceleration, T=retract acceleration",
                "echo:  M204 S1000.00 T800.00",
                "echo:  M205 S0.00 T0.00 B20000 X8.00 Z0.40 E1.00",
                "echo:   M301 P33.41 I1.47 D189.27",
                "echo:   M851 Z-1.56",
            ],
            &[
                ("DEFAULT_AXIS_STEPS_PER_UNIT", "{ 80, 80, 400.5, 94.3 }"),
                ("DEFAULT_MAX_FEEDRATE", "{ 450, 450, 5, 25 }"),
                ("DEFAULT_ACCELERATION", "1000"),
                ("DEFAULT_TRAVEL_ACCELERATION", "1000"),
                ("DEFAULT_RETRACT_ACCELERATION", "800"),
                ("DEFAULT_XJERK", "8"),
                ("CLASSIC_JERK", ""),
                ("DEFAULT_KP", "33.41"),
                ("NOZZLE_TO_PROBE_OFFSET", "{ not_said, not_said, -1.56 }"),
                ("CUSTOM_MACHINE_NAME", "My printer"),
            ],
        );
        says(
            &[
                "G21    ; Units in mm (mm)",
                "  M92 X80.00 Y80.00 Z400.00",
                "  M92 T0 E93.00",
                "  M92 T1 E94.00",
                "  M204 P500.00 R1000.00 T1500.00",
                "  M205 B20000.00 S0.00 T0.00 J0.01 E5.00",
                "  M211 S1 ; ON",
                "  Min:  X-1.00 Y0.00 Z0.00   Max:  X235.00 Y230.00 Z250.00",
                "  M301 E0 P21.73 I1.54 D76.55",
                "  M301 E1 P30.00 I1.00 D70.00",
                "  M593 X F40.00 D0.15",
                "  M593 Y F37.50 D0.10",
                "  M906 X580 Y580 Z580",
                "  M906 T0 E650",
                "  M906 I1 Z600",
                "  M207 S3.00 W13.00 F2700.00 Z0.20",
                "  M218 T1 X18.20 Y0.10 Z0.00",
            ],
            &[
                ("DEFAULT_AXIS_STEPS_PER_UNIT", "{ 80, 80, 400, 93 }"),
                ("DEFAULT_TRAVEL_ACCELERATION", "1500"),
                ("JUNCTION_DEVIATION_MM", "0.01"),
                ("DEFAULT_EJERK", "5"),
                ("X_MIN_POS", "-1"),
                ("Z_MAX_POS", "250"),
                ("DEFAULT_KI", "1.54"),
                ("SHAPING_FREQ_X", "40"),
                ("SHAPING_ZETA_Y", "0.1"),
                ("Z_CURRENT", "580"),
                ("E0_CURRENT", "650"),
                ("RETRACT_FEEDRATE", "45"),
                ("HOTEND_OFFSET_X", "{ 0.0, 18.2 }"),
            ],
        );
    }

    #[test]
    fn the_travel_is_that_of_m115_before_that_of_m211() {
        let mut definitions = Definitions::default();
        let area = "area:{full:{min:{x:-3.0000,y:0.0000,z:0.0000},max:{x:220.0000,y:221.5000,z:250.0000}},work:{min:{x:0,y:0,z:0},max:{x:1,y:1,z:1}}}";
        let lines = |lines: &[&str]| lines.iter().map(|line| (*line).to_owned()).collect::<Vec<_>>();
        let settings = lines(&["M92 X80 Y80 Z400 E93", "Min: X1 Y1 Z1   Max: X9 Y9 Z9"]);
        add(&lines(&["FIRMWARE_NAME:Marlin", area]), &settings, &mut definitions).unwrap();
        let value = |name: &str| definitions.get(name).unwrap().value.clone();
        assert_eq!(
            (value("X_MIN_POS"), value("Y_MAX_POS"), value("Z_MAX_POS")),
            ("-3".into(), "221.5".into(), "250".into())
        );
    }

    #[test]
    fn what_is_no_report_is_refused() {
        for (settings, expected) in [
            (&["echo:Unknown command: \"M503\""][..], "DISABLE_M503"),
            (&[], "no steps per millimetre (M92), 0 lines"),
            (&["T:20.0 /0.0"], "no steps per millimetre"),
            (&["  G20 ; Units in inches", "  M92 X2032.00 Y2032.00 Z2.00 E2.00"], "send it G21"),
        ] {
            let error = report(settings).unwrap_err();
            assert!(error.contains(expected), "{settings:?}: {error}");
        }
        for (name, expected) in [
            ("Klipper", "--moonraker"),
            ("RepRapFirmware for Duet 2 WiFi/Ethernet", "config.g"),
            ("Ferrostep 0.2", "its image was built from a profile"),
        ] {
            let about = [format!("FIRMWARE_NAME:{name} FIRMWARE_VERSION: 3.4")];
            let error = add(&about, &[], &mut Definitions::default()).unwrap_err();
            assert!(error.contains(expected) && error.contains(name), "{error}");
        }
    }
}
