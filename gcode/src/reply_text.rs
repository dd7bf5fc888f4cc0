//! The text of each [`Reply`]. Hosts match these strings letter by letter.

use core::fmt::{self, Display, Formatter, Write};

use crate::decimal::divide_half_away;
use crate::{
    AdvanceState, FirmwareInfo, MotionFigures, Position, Real, Reply, ResendReason, ShaperState, Temperatures,
    TimingFigures,
};

/// Capabilities that M115 reports, in Marlin's order. EMERGENCY_PARSER stands between the two
/// lists, because it depends on the port.
const CAPABILITIES_BEFORE: [(&str, bool); 17] = [
    ("PAREN_COMMENTS", true),
    ("SERIAL_XON_XOFF", false),
    ("BINARY_FILE_TRANSFER", false),
    ("EEPROM", false),
    ("VOLUMETRIC", false),
    ("AUTOREPORT_POS", false),
    ("AUTOREPORT_TEMP", true),
    ("PROGRESS", false),
    ("PRINT_JOB", false),
    ("AUTOLEVEL", false),
    ("RUNOUT", false),
    (Z_PROBE, false),
    ("LEVELING_DATA", false),
    ("BUILD_PERCENT", false),
    ("SOFTWARE_POWER", false),
    ("TOGGLE_LIGHTS", false),
    ("CASE_LIGHT_BRIGHTNESS", false),
];

/// The capability of a machine whose Z homes with a probe.
const Z_PROBE: &str = "Z_PROBE";

/// The capability of a machine that watches its heaters.
const THERMAL_PROTECTION: &str = "THERMAL_PROTECTION";

/// The capability of a port whose bytes may be packed.
const MEATPACK: &str = "MEATPACK";

/// The capabilities of a machine with a slot for a memory card.
const CARD: [&str; 5] = ["SDCARD", "SD_WRITE", "AUTOREPORT_SD_STATUS", "LONG_FILENAME", "EXTENDED_M20"];

/// The capabilities after EMERGENCY_PARSER; some of them depend on the machine and the port.
const CAPABILITIES_AFTER: [(&str, bool); 19] = [
    ("HOST_ACTION_COMMANDS", true),
    ("PROMPT_SUPPORT", true),
    ("SDCARD", false),
    ("REPEAT", false),
    ("SD_WRITE", false),
    ("AUTOREPORT_SD_STATUS", false),
    ("LONG_FILENAME", false),
    ("LFN_WRITE", false),
    ("CUSTOM_FIRMWARE_UPLOAD", false),
    ("EXTENDED_M20", false),
    (THERMAL_PROTECTION, false),
    ("MOTION_MODES", false),
    ("ARCS", true),
    ("BABYSTEPPING", true),
    ("EP_BABYSTEP", false),
    ("CHAMBER_TEMPERATURE", false),
    ("COOLER_TEMPERATURE", false),
    (MEATPACK, false),
    ("CONFIG_EXPORT", false),
];

/// The filter of an axis, as the words that set it.
struct ShaperText<'a>(char, &'a ShaperState<'a>);

impl fmt::Display for ShaperText<'_> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(axis, state) = *self;
        let [frequency, damping] = [state.frequency_hz, state.damping].map(|value| Real::short(value, 9));
        write!(formatter, " SHAPER_TYPE_{axis}={} SHAPER_FREQ_{axis}={frequency}", state.kind)?;
        write!(formatter, " DAMPING_RATIO_{axis}={damping}")
    }
}

/// The line that sets an advance.
#[inline(never)]
fn write_advance(formatter: &mut Formatter<'_>, state: &AdvanceState) -> fmt::Result {
    write!(formatter, "echo:M572 S{}", Real::short(state.seconds, 6))?;
    if let Some((seconds, speed)) = state.above {
        write!(formatter, " L{} T{}", Real::short(seconds, 6), Real::short(speed, 6))?;
    }
    match state.smooth_time_s {
        Some(time_s) => write!(formatter, " W{}", Real::short(time_s, 6)),
        None => Ok(()),
    }
}

impl Display for Reply<'_> {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Reply::Start => formatter.write_str("start"),
            Reply::Ok => formatter.write_str("ok"),
            Reply::OkTemperatures(temperatures) => {
                formatter.write_str("ok")?;
                write_temperatures(formatter, temperatures)
            }
            Reply::Temperatures(temperatures) => write_temperatures(formatter, temperatures),
            Reply::Waiting(temperatures, seconds_left) => {
                write_temperatures(formatter, temperatures)?;
                match seconds_left {
                    Some(seconds) => write!(formatter, " W:{seconds}"),
                    None => formatter.write_str(" W:?"),
                }
            }
            Reply::Position(position) => write_position(formatter, position),
            Reply::Motion(figures) => write_motion(formatter, figures),
            Reply::MotionChoice { interpolation, acceleration } => {
                write!(formatter, "echo:motion interpolation:{interpolation} acceleration:{acceleration}")
            }
            Reply::InputShaper(axes) => {
                let [x, y] = axes;
                write!(formatter, "echo:SET_INPUT_SHAPER{}{}", ShaperText('X', x), ShaperText('Y', y))
            }
            Reply::PressureAdvance(state) => write_advance(formatter, state),
            Reply::AdvanceLimits { acceleration_mm_per_s2 } => {
                let acceleration = Real::fixed(*acceleration_mm_per_s2, 0);
                formatter.write_str("echo:pressure advance: lines of 0.45 x 0.2 mm accelerate by at most ")?;
                write!(formatter, "{acceleration} mm/s2, which the extruder can follow (M201 E, M203 E, M572 W)")
            }
            Reply::Extrusion { adaptive, sizes_10nm, lambda } => {
                let mode = if *adaptive { "adaptive" } else { "gcode" };
                let [h, w, d] = sizes_10nm.map(|size| Real::fixed(size as f64 / 100_000.0, 3));
                let lambda = Real::fixed(*lambda, 6);
                write!(formatter, "echo:extrusion {mode} H:{h} W:{w} D:{d} lambda:{lambda}")
            }
            Reply::Timing(figures) => write_timing(formatter, figures),
            Reply::EndStops(states) => {
                formatter.write_str("Reporting endstop status")?;
                states.iter().try_for_each(|state| {
                    let word = if state.triggered { "TRIGGERED" } else { "open" };
                    write!(formatter, "\n{}: {word}", state.name)
                })
            }
            Reply::Firmware(info) => write_firmware(formatter, info),
            Reply::UnknownCommand(text) => write!(formatter, "echo:Unknown command: \"{text}\""),
            Reply::Busy => formatter.write_str("echo:busy: processing"),
            Reply::Progress { percent, minutes_left } => {
                formatter.write_str("echo:M73 Progress: ")?;
                match percent {
                    Some(percent) => write!(formatter, "{percent}%")?,
                    None => formatter.write_str("?")?,
                }
                minutes_left.map_or(Ok(()), |minutes| write!(formatter, "; Time left: {minutes}m"))
            }
            Reply::PausedForUser => formatter.write_str("echo:busy: paused for user"),
            Reply::KeepAlive(seconds) => write!(formatter, "echo:M113 S{seconds}"),
            Reply::HeaterTimeout(seconds) => write!(formatter, "echo:M86 S{seconds}"),
            Reply::LastLine(number) => write!(formatter, "Line: {number}"),
            Reply::FeedPercent(percent) => write!(formatter, "FR:{percent}%"),
            Reply::FlowPercent(percent) => write!(formatter, "echo:E0 Flow: {percent}%"),
            // ANCHOR: m302
            Reply::ColdExtrusion { allowed, minimum } => {
                let state = if *allowed { "en" } else { "dis" };
                write!(formatter, "echo:Cold extrudes are {state}abled (min temp {}C)", Real::fixed(*minimum, 0))
            }
            // ANCHOR_END: m302
            Reply::ActiveExtruder(tool) => write!(formatter, "echo:Active Extruder: {tool}"),
            Reply::SoftLimits { enabled, min_10nm, max_10nm } => {
                let (digit, word) = if *enabled { (1, "ON") } else { (0, "OFF") };
                let [least_x, least_y, least_z] = min_10nm.map(Millimetres);
                let [x, y, z] = max_10nm.map(Millimetres);
                write!(
                    formatter,
                    "echo:; Soft endstops:\necho:  M211 S{digit} ; {word}\n\
                     echo:  Min:  X{least_x} Y{least_y} Z{least_z}   Max:  X{x} Y{y} Z{z}"
                )
            }
            Reply::Text(text) => formatter.write_str(text),
            Reply::Resend { reason, last } => {
                let what = match reason {
                    ResendReason::WrongNumber => "Line Number is not Last Line Number+1",
                    ResendReason::WrongChecksum => "checksum mismatch",
                    ResendReason::NoChecksum => "No Checksum with line number",
                };
                let next = last.saturating_add(1);
                write!(formatter, "Error:{what}, Last Line: {last}\nResend: {next}\nok")
            }
            Reply::Killed => formatter.write_str("Error:Printer halted. kill() called!"),
        }
    }
}

/// A length in units of 10 nm, as millimetres with two decimals, halves away from zero.
struct Millimetres(i64);

impl Display for Millimetres {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        write_hundredths(formatter, divide_half_away(self.0, 1000))
    }
}

/// `hundredths / 100` with two decimals; zero has no sign.
fn write_hundredths(formatter: &mut Formatter<'_>, hundredths: i64) -> fmt::Result {
    let magnitude = hundredths.unsigned_abs();
    let sign = if hundredths < 0 { "-" } else { "" };
    write!(formatter, "{sign}{}.{:02}", magnitude / 100, magnitude % 100)
}

fn write_temperatures(formatter: &mut Formatter<'_>, temperatures: &Temperatures) -> fmt::Result {
    let fields = [
        (" T:", temperatures.nozzle),
        (" /", temperatures.nozzle_target),
        (" B:", temperatures.bed),
        (" /", temperatures.bed_target),
    ];
    for (label, value) in fields {
        formatter.write_str(label)?;
        // A value that is not finite is written as such, so that hosts find no temperature instead of a wrong one.
        write!(formatter, "{}", Real::fixed(value, 2))?;
    }
    write!(formatter, " @:{} B@:{}", temperatures.nozzle_power, temperatures.bed_power)
}

fn write_position(formatter: &mut Formatter<'_>, position: &Position) -> fmt::Result {
    let [x, y, z, e] = position.logical_10nm.map(Millimetres);
    write!(formatter, "X:{x} Y:{y} Z:{z} E:{e} Count")?;
    let mut motors = position.motor_names.into_iter().zip(position.motor_steps);
    motors.try_for_each(|(name, steps)| write!(formatter, " {name}:{steps}"))
}

fn write_motion(formatter: &mut Formatter<'_>, figures: &MotionFigures) -> fmt::Result {
    let MotionFigures {
        order_digest,
        step_digest,
        underruns,
        starvation_flushes,
        idle_flushes,
        issued_steps,
        slowed_moves,
        merged_moves,
        planning_slowdowns,
        missed_updates,
        refused_entries,
        miscounts,
    } = figures;
    let [x, y, z, e] = issued_steps;
    write!(
        formatter,
        "echo:motion order_digest:{order_digest:016x} step_digest:{step_digest:016x} underruns:{underruns} \
         starvation_flushes:{starvation_flushes} steps X:{x} Y:{y} Z:{z} E:{e} idle_flushes:{idle_flushes} \
         slowed_moves:{slowed_moves} merged_moves:{merged_moves} planning_slowdowns:{planning_slowdowns} \
         missed_updates:{missed_updates} refused_entries:{refused_entries} miscounts:{miscounts}"
    )
}

fn write_timing(formatter: &mut Formatter<'_>, figures: &TimingFigures) -> fmt::Result {
    let TimingFigures { name, count, p50, p99, p99_9, max, unit } = figures;
    write!(formatter, "echo:timing {name} count:{count} p50:{p50} p99:{p99} p99.9:{p99_9} max:{max} unit:{unit}")
}

fn write_firmware(formatter: &mut Formatter<'_>, info: &FirmwareInfo<'_>) -> fmt::Result {
    let FirmwareInfo {
        version,
        source_code_url,
        identifier,
        machine,
        kinematics,
        lower_end_10nm,
        size_10nm,
        emergency_parser,
        meatpack,
        thermal_protection,
        z_probe,
        card,
    } = info;
    write!(formatter, "FIRMWARE_NAME:Ferrostep {version}")?;
    if !source_code_url.is_empty() {
        write!(formatter, " SOURCE_CODE_URL:{source_code_url}")?;
    }
    write!(formatter, " PROTOCOL_VERSION:1.0 MACHINE_TYPE:{machine} KINEMATICS:{kinematics} EXTRUDER_COUNT:1")?;
    if let Some([first, second, third]) = identifier {
        // A UUID's form, as hosts expect it: "Fsp" and a version of this form, then the 96 bits of the board.
        let (high, low) = (second >> 16, second & 0xffff);
        write!(formatter, " UUID:46737001-{:04x}-{:04x}-{high:04x}-{low:04x}{third:08x}", first >> 16, first & 0xffff)?;
    }
    let emergency = [("EMERGENCY_PARSER", *emergency_parser)];
    for (name, has) in CAPABILITIES_BEFORE.iter().chain(&emergency).chain(&CAPABILITIES_AFTER) {
        let has = match *name {
            THERMAL_PROTECTION => *thermal_protection,
            MEATPACK => *meatpack,
            Z_PROBE => *z_probe,
            name => *has || *card && CARD.contains(&name),
        };
        write!(formatter, "\nCap:{name}:{}", u8::from(has))?;
    }
    formatter.write_str("\narea:{")?;
    for (region, end) in [("full", ','), ("work", '}')] {
        let [least_x, least_y, least_z] = lower_end_10nm.map(Millimetres);
        let [x, y, z] = size_10nm.map(Millimetres);
        write!(formatter, "{region}:{{min:{{x:{least_x},y:{least_y},z:{least_z}}},max:{{x:{x},y:{y},z:{z}}}}}")?;
        formatter.write_char(end)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::EndStopState;

    #[track_caller]
    fn says(reply: Reply<'_>, text: &str) {
        assert_eq!(reply.to_string(), text);
    }

    #[test]
    fn temperatures() {
        let temperatures = Temperatures {
            nozzle: 21.3,
            nozzle_target: 0.0,
            bed: 22.0,
            bed_target: 60.0,
            nozzle_power: 0,
            bed_power: 127,
        };
        says(Reply::OkTemperatures(temperatures), "ok T:21.30 /0.00 B:22.00 /60.00 @:0 B@:127");
        says(Reply::Temperatures(temperatures), " T:21.30 /0.00 B:22.00 /60.00 @:0 B@:127");
        says(Reply::Waiting(temperatures, None), " T:21.30 /0.00 B:22.00 /60.00 @:0 B@:127 W:?");
        says(Reply::Waiting(temperatures, Some(9)), " T:21.30 /0.00 B:22.00 /60.00 @:0 B@:127 W:9");
        let odd = Temperatures {
            nozzle: f32::NAN,
            nozzle_target: f32::INFINITY,
            bed: -0.004,
            bed_target: -15.125,
            ..temperatures
        };
        says(Reply::Temperatures(odd), " T:NaN /inf B:0.00 /-15.13 @:0 B@:127");
        says(
            Reply::ColdExtrusion { allowed: false, minimum: 169.6 },
            "echo:Cold extrudes are disabled (min temp 170C)",
        );
        says(Reply::ColdExtrusion { allowed: true, minimum: -0.2 }, "echo:Cold extrudes are enabled (min temp 0C)");
    }

    #[test]
    fn positions() {
        let position = Position {
            logical_10nm: [8_715_300, -499, -500, i64::MIN],
            motor_steps: [6972, -40, 0],
            motor_names: ['X', 'Y', 'Z'],
        };
        says(Reply::Position(position), "X:87.15 Y:0.00 Z:-0.01 E:-92233720368547.76 Count X:6972 Y:-40 Z:0");
        says(
            Reply::Position(Position { motor_names: ['A', 'B', 'Z'], ..Position::default() }),
            "X:0.00 Y:0.00 Z:0.00 E:0.00 Count A:0 B:0 Z:0",
        );
        says(
            Reply::SoftLimits {
                enabled: true,
                min_10nm: [-20_000, -300_000, 0],
                max_10nm: [20_000_000, 20_000_000, 18_500_500],
            },
            "echo:; Soft endstops:\necho:  M211 S1 ; ON\n\
             echo:  Min:  X-0.20 Y-3.00 Z0.00   Max:  X200.00 Y200.00 Z185.01",
        );
    }

    #[test]
    fn motion() {
        let figures = MotionFigures {
            order_digest: 0xcbf2_9ce4_8422_2325,
            step_digest: 0x2a,
            underruns: 1,
            starvation_flushes: 2,
            idle_flushes: 7,
            issued_steps: [3, 4, 5, 6],
            slowed_moves: 8,
            merged_moves: 9,
            planning_slowdowns: 10,
            missed_updates: 11,
            refused_entries: 12,
            miscounts: 13,
        };
        says(
            Reply::Motion(figures),
            "echo:motion order_digest:cbf29ce484222325 step_digest:000000000000002a underruns:1 \
             starvation_flushes:2 steps X:3 Y:4 Z:5 E:6 idle_flushes:7 slowed_moves:8 merged_moves:9 \
             planning_slowdowns:10 missed_updates:11 refused_entries:12 miscounts:13",
        );
    }

    #[test]
    fn timing() {
        let figures = TimingFigures {
            name: "step_latency",
            count: 12,
            p50: 31,
            p99: 47,
            p99_9: u32::MAX,
            max: u32::MAX,
            unit: "ticks",
        };
        says(
            Reply::Timing(figures),
            "echo:timing step_latency count:12 p50:31 p99:47 p99.9:4294967295 max:4294967295 unit:ticks",
        );
    }

    #[test]
    fn resends() {
        let resend = |reason| Reply::Resend { reason, last: 11 };
        says(
            resend(ResendReason::WrongNumber),
            "Error:Line Number is not Last Line Number+1, Last Line: 11\nResend: 12\nok",
        );
        says(resend(ResendReason::WrongChecksum), "Error:checksum mismatch, Last Line: 11\nResend: 12\nok");
        says(
            Reply::Resend { reason: ResendReason::NoChecksum, last: -1 },
            "Error:No Checksum with line number, Last Line: -1\nResend: 0\nok",
        );
    }

    #[test]
    fn other_replies() {
        says(Reply::Start, "start");
        says(Reply::Ok, "ok");
        says(Reply::UnknownCommand("M862 P"), "echo:Unknown command: \"M862 P\"");
        says(Reply::Busy, "echo:busy: processing");
        says(Reply::Progress { percent: Some(12), minutes_left: Some(34) }, "echo:M73 Progress: 12%; Time left: 34m");
        says(Reply::Progress { percent: None, minutes_left: None }, "echo:M73 Progress: ?");
        says(Reply::PausedForUser, "echo:busy: paused for user");
        says(Reply::KeepAlive(2), "echo:M113 S2");
        says(Reply::HeaterTimeout(1800), "echo:M86 S1800");
        says(Reply::LastLine(-1), "Line: -1");
        says(Reply::FeedPercent(100), "FR:100%");
        says(Reply::FlowPercent(95), "echo:E0 Flow: 95%");
        says(Reply::ActiveExtruder(0), "echo:Active Extruder: 0");
        says(Reply::Text("//action:notification hello"), "//action:notification hello");
        says(Reply::Killed, "Error:Printer halted. kill() called!");
        let states =
            [EndStopState { name: "x_min", triggered: true }, EndStopState { name: "z_probe", triggered: false }];
        says(Reply::EndStops(&states), "Reporting endstop status\nx_min: TRIGGERED\nz_probe: open");
    }

    #[test]
    fn firmware() {
        let info = FirmwareInfo {
            version: "0.1.0 (commit abcdef0)",
            source_code_url: "",
            identifier: None,
            machine: "corexy",
            kinematics: "COREXY",
            lower_end_10nm: [0, -300_000, 0],
            size_10nm: [30_000_000, 30_000_000, 29_999_900],
            emergency_parser: true,
            meatpack: false,
            thermal_protection: true,
            z_probe: false,
            card: false,
        };
        let probed = Reply::Firmware(FirmwareInfo { z_probe: true, ..info }).to_string();
        assert_eq!(probed, Reply::Firmware(info).to_string().replace("Z_PROBE:0", "Z_PROBE:1"));
        let identifier = Some([0x0123_4567, 0x89ab_cdef, 0xfedc_ba98]);
        let source_code_url = "https://example.org/sources";
        let named = Reply::Firmware(FirmwareInfo { source_code_url, identifier, ..info }).to_string();
        assert_eq!(
            named.lines().next(),
            Some(
                "FIRMWARE_NAME:Ferrostep 0.1.0 (commit abcdef0) SOURCE_CODE_URL:https://example.org/sources \
                 PROTOCOL_VERSION:1.0 MACHINE_TYPE:corexy KINEMATICS:COREXY EXTRUDER_COUNT:1 \
                 UUID:46737001-0123-4567-89ab-cdeffedcba98"
            )
        );
        let with_card = Reply::Firmware(FirmwareInfo { card: true, ..info }).to_string();
        for name in ["SDCARD", "SD_WRITE", "AUTOREPORT_SD_STATUS", "LONG_FILENAME", "EXTENDED_M20"] {
            assert!(with_card.contains(&format!("\nCap:{name}:1\n")), "{with_card}");
        }
        assert!(with_card.contains("\nCap:LFN_WRITE:0\n"));
        let cold = Reply::Firmware(FirmwareInfo { thermal_protection: false, ..info }).to_string();
        assert_eq!(cold, Reply::Firmware(info).to_string().replace("THERMAL_PROTECTION:1", "THERMAL_PROTECTION:0"));
        let packed = Reply::Firmware(FirmwareInfo { meatpack: true, ..info }).to_string();
        assert_eq!(packed, Reply::Firmware(info).to_string().replace("MEATPACK:0", "MEATPACK:1"));
        let text = Reply::Firmware(info).to_string();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(
            lines[0],
            "FIRMWARE_NAME:Ferrostep 0.1.0 (commit abcdef0) PROTOCOL_VERSION:1.0 MACHINE_TYPE:corexy KINEMATICS:COREXY \
             EXTRUDER_COUNT:1"
        );
        assert_eq!(lines.len(), 1 + 37 + 1);
        let capabilities = &lines[1..38];
        assert!(capabilities.iter().all(|line| line.starts_with("Cap:")));
        let on: Vec<_> = capabilities.iter().filter(|line| line.ends_with(":1")).copied().collect();
        let expected = [
            "PAREN_COMMENTS",
            "AUTOREPORT_TEMP",
            "EMERGENCY_PARSER",
            "HOST_ACTION_COMMANDS",
            "PROMPT_SUPPORT",
            "THERMAL_PROTECTION",
            "ARCS",
            "BABYSTEPPING",
        ];
        assert_eq!(on, expected.map(|name| format!("Cap:{name}:1")));
        assert_eq!(
            lines[38],
            "area:{full:{min:{x:0.00,y:-3.00,z:0.00},max:{x:300.00,y:300.00,z:300.00}},\
             work:{min:{x:0.00,y:-3.00,z:0.00},max:{x:300.00,y:300.00,z:300.00}}}"
        );
        // Hosts switch on quirks of other firmware at these names.
        let lower = text.to_lowercase();
        let names = ["repetier", "klipper", "prusa-firmware", "malyan", "reprapfirmware", "teacup", "ultimaker2"];
        assert!(names.iter().all(|name| !lower.contains(name)));
    }
}
