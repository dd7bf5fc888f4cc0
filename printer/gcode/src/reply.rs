//! Replies of the printer to its host, as text.
//!
//! `Display` of a [`Reply`] is one or more complete lines, without the final newline.

/// Temperatures of a report (M105, M155, and the waits M109 and M190). The nozzle is that of
/// the selected tool.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Temperatures {
    /// Nozzle now, degrees Celsius.
    pub nozzle: f32,
    /// Nozzle target; 0 = off.
    pub nozzle_target: f32,
    /// Bed now.
    pub bed: f32,
    /// Bed target; 0 = off.
    pub bed_target: f32,
    /// Nozzle power, 0 to 127.
    pub nozzle_power: u8,
    /// Bed power, 0 to 127.
    pub bed_power: u8,
    /// The chamber, if the machine knows its temperature.
    pub chamber: Option<ChamberTemperature>,
    /// Each nozzle by the number of its tool, if there are several.
    pub nozzles: Option<[NozzleTemperature; 2]>,
}

/// A nozzle's part of [`Temperatures`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NozzleTemperature {
    /// Now, degrees Celsius.
    pub celsius: f32,
    /// Target; 0 = off.
    pub target: f32,
    /// Power, 0 to 127.
    pub power: u8,
}

/// A chamber's part of [`Temperatures`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChamberTemperature {
    /// Now, degrees Celsius.
    pub celsius: f32,
    /// Target; 0 = off.
    pub target: f32,
    /// Power, 0 to 127; `None` without a heater.
    pub power: Option<u8>,
}

/// Position of the machine (M114): logical coordinates in units of 10 nm, and motor step counters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Position {
    /// X, Y, Z and E as the G-code sees them.
    pub logical_10nm: [i64; 4],
    /// Live step counters of the motors that the board names X, Y and Z.
    pub motor_steps: [i64; 3],
    /// Letters of these motors, by the kinematics: X, Y, Z; A, B, Z.
    pub motor_names: [char; 3],
}

/// Figures of everything that the motors were commanded since the start (M797).
///
/// The desk and the board print the same two digests for the same job, so that a print can be
/// compared with its rehearsal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MotionFigures {
    /// Digest of which motors stepped which way, in which order.
    pub order_digest: u64,
    /// Digest of the same with the times.
    pub step_digest: u64,
    /// Times that the step queue was empty at non-zero speed.
    pub underruns: u64,
    /// Blocks that left the look-ahead ring because steps ran out.
    pub starvation_flushes: u64,
    /// Times that waiting moves were executed because the host sent no more.
    pub idle_flushes: u64,
    /// Steps issued to the X, Y, Z (A, B, Z) and extruder motors, both directions added.
    pub issued_steps: [u64; 4],
    /// Moves that were planned slower than requested, because the board could not keep up
    /// with their events.
    pub slowed_moves: u64,
    /// Moves that share the block of the one before.
    pub merged_moves: u64,
    /// Times that planning did not keep up and lowered the speed of the following blocks.
    pub planning_slowdowns: u64,
    /// Updates of the step timer that its interrupt missed.
    pub missed_updates: u64,
    /// Entries that the step queue refused; each has stopped motion.
    pub refused_entries: u64,
    /// Blocks at whose end a motor was not where the block ends.
    pub miscounts: u64,
}

/// Durations of a frequent event (M798). Percentiles are upper limits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TimingFigures {
    /// Name of the event: `step_latency` ...
    pub name: &'static str,
    /// Times that it happened.
    pub count: u32,
    /// Half of them took this or less.
    pub p50: u32,
    /// 99 % did.
    pub p99: u32,
    /// 99.9 % did.
    pub p99_9: u32,
    /// The longest, exactly.
    pub max: u32,
    /// Unit of the times: `cycles` of the core or `ticks` of a timer.
    pub unit: &'static str,
}

/// State of one end stop (M119).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EndStopState {
    /// `x_min`, `y_max`, `z_probe` ...
    pub name: &'static str,
    /// True if it is triggered.
    pub triggered: bool,
}

/// The filter of an axis (M593).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShaperState<'a> {
    /// `zv`, `none` ...
    pub kind: &'a str,
    /// Hz.
    pub frequency_hz: f64,
    /// Damping ratio.
    pub damping: f64,
}

/// Lead of the extruder over the flow (M900, M572).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdvanceState {
    /// K, s.
    pub seconds: f64,
    /// Another K, s, beyond a speed of the filament, mm/s.
    pub above: Option<(f64, f64)>,
    /// Time over which it is averaged, s, if that is set.
    pub smooth_time_s: Option<f64>,
}

/// Content of the M115 report.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FirmwareInfo<'a> {
    /// Version of the firmware, `0.1.0 (commit abcdef0)`. Hosts look for keys in capitals before a
    /// colon, of which it has none.
    pub version: &'a str,
    /// Address of its sources; empty if unknown.
    pub source_code_url: &'a str,
    /// The board's own number, by which a host tells two printers apart; `None` where it has none.
    pub identifier: Option<[u32; 3]>,
    /// Name of the machine.
    pub machine: &'a str,
    /// `Cartesian` or `COREXY`.
    pub kinematics: &'a str,
    /// Number of extruders.
    pub extruders: u8,
    /// Lower ends of the travel of X, Y and Z, units of 10 nm (for the `area:` line).
    pub lower_end_10nm: [i64; 3],
    /// Upper ends.
    pub size_10nm: [i64; 3],
    /// True if M112, M108 and M410 act as their bytes arrive.
    pub emergency_parser: bool,
    /// A host may pack its bytes ([`crate::meatpack`]).
    pub meatpack: bool,
    /// True if there are heaters, which are then watched.
    pub thermal_protection: bool,
    /// True if Z homes with a probe.
    pub z_probe: bool,
    /// True if there is a slot for a memory card.
    pub card: bool,
    /// True if settings can be stored.
    pub stores_settings: bool,
    /// True if there is a filament sensor.
    pub filament_sensor: bool,
    /// The power supply can be switched (M80, M81).
    pub power_supply: bool,
    /// The chamber's temperature is known.
    pub chamber: bool,
}

/// One answer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reply<'a> {
    /// `start`, at boot.
    Start,
    /// `ok`
    Ok,
    /// `ok T:21.30 /0.00 B:22.00 /60.00 @:0 B@:0`
    OkTemperatures(Temperatures),
    /// ` T:21.30 /0.00 B:22.00 /60.00 @:0 B@:0` (begins with a space)
    Temperatures(Temperatures),
    /// Temperatures with ` W:?` or ` W:<seconds left>` at the end.
    Waiting(Temperatures, Option<u32>),
    /// `X:0.00 Y:0.00 Z:0.00 E:0.00 Count X:0 Y:0 Z:0` (CoreXY: `Count A:0 B:0 Z:0`)
    Position(Position),
    /// `echo:motion order_digest:<16 hex> step_digest:<16 hex> underruns:0 starvation_flushes:0`
    /// `steps X:0 Y:0 Z:0 E:0 idle_flushes:0 slowed_moves:0 ...` (one line)
    Motion(MotionFigures),
    /// `echo:motion interpolation:<name> acceleration:<name>` (M796)
    MotionChoice {
        /// `step-bresenham` ...
        interpolation: &'a str,
        /// `trapezoid` ...
        acceleration: &'a str,
    },
    /// `echo:SET_INPUT_SHAPER SHAPER_TYPE_X=<kind> SHAPER_FREQ_X=40 DAMPING_RATIO_X=0.1`
    /// `SHAPER_TYPE_Y=...` (M593, one line), which sets what it says: the filters of X and Y.
    InputShaper([ShaperState<'a>; 2]),
    /// `echo:M572 S0.04 L0.02 T3 W0.02` (M900, M572), which sets what it says.
    PressureAdvance(AdvanceState),
    /// `echo:pressure advance: lines of 0.45 x 0.2 mm accelerate by at most 1200 mm/s2 ...`:
    /// less than asked for.
    AdvanceLimits {
        /// Acceleration that the extruder can follow in such a line, mm/s^2.
        acceleration_mm_per_s2: f64,
    },
    /// `echo:extrusion <gcode|adaptive> H:0.200 W:0.450 D:1.750 lambda:0.037418` (M795)
    Extrusion {
        /// True if moves without E extrude by their length.
        adaptive: bool,
        /// Layer height, line width, filament diameter, units of 10 nm.
        sizes_10nm: [i64; 3],
        /// mm of filament a mm of path.
        lambda: f64,
    },
    /// `echo:timing <name> count:0 p50:0 p99:0 p99.9:0 max:0 unit:<unit>`
    Timing(TimingFigures),
    /// `Reporting endstop status` and a line for each end stop.
    EndStops(&'a [EndStopState]),
    /// Firmware line, capabilities and area.
    Firmware(FirmwareInfo<'a>),
    /// `echo:Unknown command: "<text>"`
    UnknownCommand(&'a str),
    /// `echo:busy: processing`
    Busy,
    /// `echo:M73 Progress: 12%; Time left: 34m`, of which a half may be unknown.
    Progress {
        /// Percent.
        percent: Option<u8>,
        /// Minutes.
        minutes_left: Option<u16>,
    },
    /// `echo:busy: paused for user`
    PausedForUser,
    /// `echo:M113 S<n>`
    KeepAlive(u8),
    /// Answer to M86 without S: seconds until unused heaters go off, 0 = never.
    HeaterTimeout(u16),
    /// `Line: <n>`
    LastLine(i64),
    /// `FR:<n>%`
    FeedPercent(u16),
    /// `echo:E0 Flow: <n>%`
    FlowPercent(u16),
    // ANCHOR: m302
    /// `echo:Cold extrudes are <en|dis>abled (min temp <n>C)`
    ColdExtrusion {
        /// True if extrusion is allowed at any temperature.
        allowed: bool,
        /// The limit, degrees Celsius.
        minimum: f32,
    },
    // ANCHOR_END: m302
    /// `echo:Active Extruder: <n>`
    ActiveExtruder(u32),
    /// `echo:; Soft endstops:` and the M211 line.
    SoftLimits {
        /// True if they are on.
        enabled: bool,
        /// Lower ends of X, Y and Z, units of 10 nm.
        min_10nm: [i64; 3],
        /// Upper ends.
        max_10nm: [i64; 3],
    },
    /// Any text, sent unchanged (M118, notices such as `echo:...`).
    Text(&'a str),
    /// `Error:checksum mismatch, Last Line: <n>`, `Resend: <n+1>`, `ok`: three lines;
    /// likewise the other two.
    Resend {
        /// Reason of the request.
        reason: ResendReason,
        /// Last good line number.
        last: i64,
    },
    /// `Error:Printer halted. kill() called!`
    Killed,
}

/// Reason why a line is requested again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResendReason {
    /// `Error:Line Number is not Last Line Number+1, Last Line: <n>`
    WrongNumber,
    /// `Error:checksum mismatch, Last Line: <n>`
    WrongChecksum,
    /// `Error:No Checksum with line number, Last Line: <n>`
    NoChecksum,
    /// `Error:No Line Number with checksum, Last Line: <n>`
    NoNumber,
}
