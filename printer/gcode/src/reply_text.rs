//! The text of each [`Reply`]. Hosts match these strings letter by letter.

use core::fmt::{self, Display, Formatter, Write};

use crate::decimal::divide_half_away;
use crate::{
    AdvanceState, FirmwareInfo, MotionFigures, Position, Real, Reply, ResendReason, ShaperState, Temperatures,
    TimingFigures,
};

/// Capabilities that M115 reports, in Marlin's order. EMERGENCY_PARSER is between the two lists,
/// because it depends on the port.
const CAPABILITIES_BEFORE: [(&str, bool); 17] = [
    ("PAREN_COMMENTS", true),
    ("SERIAL_XON_XOFF", false),
    ("BINARY_FILE_TRANSFER", false),
    (EEPROM, false),
    ("VOLUMETRIC", false),
    ("AUTOREPORT_POS", false),
    ("AUTOREPORT_TEMP", true),
    ("PROGRESS", false),
    ("PRINT_JOB", false),
    ("AUTOLEVEL", false),
    (RUNOUT, false),
    (Z_PROBE, false),
    ("LEVELING_DATA", false),
    ("BUILD_PERCENT", false),
    (POWER_SUPPLY, false),
    ("TOGGLE_LIGHTS", false),
    ("CASE_LIGHT_BRIGHTNESS", false),
];

/// The capability of a machine that stores settings (M500).
const EEPROM: &str = "EEPROM";

/// The capability of a machine whose Z homes with a probe.
const Z_PROBE: &str = "Z_PROBE";

/// The capability of a machine with a filament sensor.
const RUNOUT: &str = "RUNOUT";

/// The capability of a machine whose power supply can be switched.
const POWER_SUPPLY: &str = "SOFTWARE_POWER";

/// The capability of a machine that knows its chamber's temperature.
const CHAMBER: &str = "CHAMBER_TEMPERATURE";

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
    (CHAMBER, false),
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
                    ResendReason::NoNumber => "No Line Number with checksum",
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
    let Temperatures { nozzle, nozzle_target, bed, bed_target, nozzle_power, bed_power, chamber, nozzles } =
        *temperatures;
    let [chamber_now, chamber_target] = chamber.map_or([0.0; 2], |chamber| [chamber.celsius, chamber.target]);
    let fields = [
        (" T:", nozzle),
        (" /", nozzle_target),
        (" B:", bed),
        (" /", bed_target),
        (" C:", chamber_now),
        (" /", chamber_target),
    ];
    for (label, value) in fields.into_iter().take(if chamber.is_some() { 6 } else { 4 }) {
        formatter.write_str(label)?;
        // A value that is not finite is written as such, so that hosts find no temperature
        // instead of a wrong one.
        write!(formatter, "{}", Real::fixed(value, 2))?;
    }
    // Marlin's order.
    for (tool, nozzle) in nozzles.iter().flatten().enumerate() {
        let (now, target) = (Real::fixed(nozzle.celsius, 2), Real::fixed(nozzle.target, 2));
        write!(formatter, " T{tool}:{now} /{target}")?;
    }
    write!(formatter, " @:{nozzle_power} B@:{bed_power}")?;
    if let Some(power) = chamber.and_then(|chamber| chamber.power) {
        write!(formatter, " C@:{power}")?;
    }
    for (tool, nozzle) in nozzles.iter().flatten().enumerate() {
        write!(formatter, " @{tool}:{}", nozzle.power)?;
    }
    Ok(())
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
        extruders,
        lower_end_10nm,
        size_10nm,
        emergency_parser,
        meatpack,
        thermal_protection,
        z_probe,
        card,
        stores_settings,
        filament_sensor,
        power_supply,
        chamber,
    } = info;
    write!(formatter, "FIRMWARE_NAME:Ferrostep {version}")?;
    if !source_code_url.is_empty() {
        write!(formatter, " SOURCE_CODE_URL:{source_code_url}")?;
    }
    write!(
        formatter,
        " PROTOCOL_VERSION:1.0 MACHINE_TYPE:{machine} KINEMATICS:{kinematics} EXTRUDER_COUNT:{extruders}"
    )?;
    if let Some([first, second, third]) = identifier {
        // A UUID's form, as hosts expect it: "Fsp" and a version of this form, then the 96
        // bits of the board.
        let (high, low) = (second >> 16, second & 0xffff);
        write!(formatter, " UUID:46737001-{:04x}-{:04x}-{high:04x}-{low:04x}{third:08x}", first >> 16, first & 0xffff)?;
    }
    let emergency = [("EMERGENCY_PARSER", *emergency_parser)];
    for (name, has) in CAPABILITIES_BEFORE.iter().chain(&emergency).chain(&CAPABILITIES_AFTER) {
        let has = match *name {
            THERMAL_PROTECTION => *thermal_protection,
            MEATPACK => *meatpack,
            Z_PROBE => *z_probe,
            EEPROM => *stores_settings,
            RUNOUT => *filament_sensor,
            POWER_SUPPLY => *power_supply,
            CHAMBER => *chamber,
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
mod tests;
