//! Commands of G-code lines, as an enum.

use crate::command_words::{
    AdvanceWords, ArcForm, AxisFlags, AxisWords, BacklashWords, DriverSetting, DriverWords, FeedWords,
    FilamentSensorWords, GainWords, PrintClockCommand, RetractionWords, SettingsCommand, ShaperWords, TunedHeater,
    Units, WaitTarget,
};
use crate::{BedCommand, CardCommand, Decimal, PinCommand, SkewCommand, SupplyCommand, TowerWords};

/// One command, its words checked for form but not against any machine.
///
/// Feeds are per minute and lengths in the current unit (G20, G21), as written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command<'a> {
    /// G0, G1.
    Linear {
        /// G0: a move without extrusion.
        rapid: bool,
        /// Target.
        axes: AxisWords,
        /// F.
        feed: Option<Decimal>,
    },
    /// G2, G3 in the XY plane; Z and E follow evenly.
    Arc {
        /// G2.
        clockwise: bool,
        /// Target.
        axes: AxisWords,
        /// Form of the circle.
        form: ArcForm,
        /// F.
        feed: Option<Decimal>,
    },
    /// G4: P milliseconds, or S seconds (S wins, as in Marlin).
    Dwell {
        /// Time in milliseconds.
        milliseconds: u64,
    },
    /// G10 without parameters.
    Retract,
    /// G11.
    Recover,
    /// G20, G21.
    SetUnits(Units),
    /// G28; no axis means all.
    Home {
        /// The axes.
        axes: AxisFlags,
        /// O: of these only those that are not homed.
        unless_homed: bool,
    },
    /// G90: all axes, the extruder included.
    AbsolutePositioning,
    /// G91: all axes, the extruder included.
    RelativePositioning,
    /// G92: the axes with a value.
    SetPosition(AxisWords),
    /// M17.
    EnableMotors(AxisFlags),
    /// M20 to M34, M413, M524, M928, M1000: the memory card.
    Card(CardCommand<'a>),
    /// M18, M84 without S; no axis means all.
    DisableMotors(AxisFlags),
    /// M18 S, M84 S: idle seconds after which motors are switched off; 0 = never.
    IdleTimeout {
        /// Seconds.
        seconds: u64,
    },
    /// M85 S, M86 S: seconds without a line and without motion after which heaters go off, 0 =
    /// never; without S a query.
    HeaterTimeout(Option<u16>),
    /// M80, M81: the power supply.
    Supply(SupplyCommand),
    /// M280, M401, M402, BLTOUCH_DEBUG: the pin of the probe.
    ProbePin(PinCommand),
    /// M82.
    AbsoluteExtrusion,
    /// M83.
    RelativeExtrusion,
    /// M104 T and S: of which tool, `None` for the selected one; without S only reports nothing and
    /// changes nothing.
    SetNozzle(Option<u8>, Option<Decimal>),
    /// M109, T as in M104.
    WaitNozzle(Option<u8>, WaitTarget),
    /// M140 S.
    SetBed(Option<Decimal>),
    /// M190.
    WaitBed(WaitTarget),
    /// M141 S.
    SetChamber(Option<Decimal>),
    /// M191.
    WaitChamber(WaitTarget),
    /// M105.
    ReportTemperatures,
    /// M122: the motor drivers.
    ReportDrivers,
    /// M155 S: seconds between automatic reports, 0 = off.
    AutoReportTemperatures {
        /// Seconds.
        seconds: u8,
    },
    /// M106 S (0 to 255; 255 without S), M107.
    Fan {
        /// P: which fan; 0 is the part-cooling fan.
        number: u8,
        /// Power, 0 to 255.
        power: u8,
    },
    /// SET_FAN_SPEED, SET_PIN: a fan, or what else a fan's output switches.
    NamedFan {
        /// FAN, PIN.
        name: &'a str,
        /// SPEED, VALUE as 0 to 255.
        power: u8,
    },
    /// M42: an output of the profile.
    SetOutput {
        /// P; `None` without one, or with one above 255, which no output has.
        number: Option<u8>,
        /// S, 0 to 255.
        power: u8,
    },
    /// M150, SET_LED: a light of several colours.
    SetLight {
        /// Powers of red, green, blue and white, 0 to 255.
        colors: [u8; 4],
    },
    /// M123: powers and speeds of the fans.
    ReportFans,
    /// M603: what filament changes draw out and push in; without words a query.
    FilamentLengths {
        /// U.
        unload: Option<Decimal>,
        /// L.
        load: Option<Decimal>,
    },
    /// M701 pushes filament in, M702 draws it out.
    LoadFilament {
        /// M701.
        loads: bool,
        /// T: of which tool.
        tool: Option<u8>,
        /// L of M701, U of M702.
        length: Option<Decimal>,
        /// Z: the rise of the nozzle meanwhile.
        rise: Option<Decimal>,
    },
    /// M108: end a wait.
    EndWait,
    /// M73: how far the print is; without words a query.
    Progress {
        /// P, percent.
        percent: Option<u8>,
        /// R.
        minutes_left: Option<u16>,
    },
    /// M0, M1: waits for a person; P milliseconds or S seconds (S wins) at the longest.
    Stop {
        /// The longest wait, ms.
        longest_ms: Option<u64>,
        /// The text for the person; may be empty.
        text: &'a str,
    },
    /// M125, M226, M601: pauses and waits for a person. X and Y are where the nozzle waits, Z is by
    /// how much it rises.
    Pause(AxisWords),
    /// M600: the same, to change the filament.
    ChangeFilament {
        /// T: of which tool.
        tool: Option<u8>,
        /// Place where the nozzle waits.
        park: AxisWords,
        /// U: length of filament to draw out; its sign is ignored.
        unload: Option<Decimal>,
        /// L: how much is pushed in before the print continues; its sign is ignored.
        load: Option<Decimal>,
    },
    /// M602: a paused print continues.
    ResumePrint,
    /// M412; without words a query.
    FilamentSensor(FilamentSensorWords),
    /// M876 S: the number of the button that was pressed on a prompt.
    PromptAnswer(u8),
    /// M110 N: the last line number.
    SetLineNumber(Option<i64>),
    /// M112.
    EmergencyStop,
    /// M113 S: seconds between `busy` messages, 0 = off; without S a query.
    KeepAlive(Option<u8>),
    /// M114.
    ReportPosition,
    /// M115.
    ReportFirmware,
    /// M117: text for the display.
    Display(&'a str),
    /// M118: text for the host.
    Echo {
        /// E1: prefix `echo:`.
        echo_prefix: bool,
        /// A1: prefix `//`.
        action_prefix: bool,
        /// The text.
        text: &'a str,
    },
    /// M119.
    ReportEndStops,
    /// M201, M203, M204, M205, M207 or M208 without words: the values in force; its code.
    ReportSetting(&'static str),
    /// M201 X Y Z E: largest accelerations.
    MaxAcceleration(AxisWords),
    /// M92 T and X Y Z E: steps for each mm; without words a query.
    StepsPerMm(Option<u8>, AxisWords),
    /// M203 X Y Z E: largest feed rates, mm/s.
    MaxFeed(AxisWords),
    /// M204.
    Acceleration {
        /// P.
        print: Option<Decimal>,
        /// R.
        retract: Option<Decimal>,
        /// T.
        travel: Option<Decimal>,
        /// S: print and travel together (older slicers).
        both: Option<Decimal>,
    },
    /// SET_VELOCITY_LIMIT: limits of the moves to come, mm/s and mm/s^2 in any unit of the G-code.
    VelocityLimit {
        /// VELOCITY: of X and of Y.
        velocity: Option<Decimal>,
        /// ACCEL: of moves that print and of those that travel.
        acceleration: Option<Decimal>,
        /// SQUARE_CORNER_VELOCITY: the speed in a corner of 90 degrees.
        corner: Option<Decimal>,
        /// MINIMUM_CRUISE_RATIO of short moves; without effect here.
        cruise_ratio: Option<Decimal>,
        /// ACCEL_TO_DECEL of short moves, which Klipper had before; without effect here.
        to_deceleration: Option<Decimal>,
    },
    /// TURN_OFF_HEATERS: targets of 0.
    HeatersOff,
    /// SET_PRINT_STATS_INFO: which layer comes.
    Layer {
        /// CURRENT_LAYER.
        current: Option<u32>,
        /// TOTAL_LAYER.
        total: Option<u32>,
    },
    /// M205; S T B are accepted without effect.
    Junction {
        /// J, mm.
        deviation: Option<Decimal>,
        /// X Y Z E ("jerk"): maximum difference of an axis's speed before and
        /// after a corner, mm/s.
        corner_velocity: AxisWords,
    },
    /// M207.
    RetractSettings(RetractionWords),
    /// M208.
    RecoverSettings(RetractionWords),
    /// M211 S: soft limits on or off; without S a query.
    SoftLimits(Option<bool>),
    /// M220: feed rate in percent.
    FeedPercent(FeedWords),
    /// M221 T and S: flow in percent; without S a query.
    FlowPercent(Option<u8>, Option<Decimal>),
    /// M301: gains of the heater of a nozzle, E.
    NozzleGains(Option<u8>, GainWords),
    /// M304: gains of the bed's heater.
    BedGains(GainWords),
    /// M309: gains of the chamber's heater.
    ChamberGains(GainWords),
    /// M303: finds the gains of a heater.
    Autotune {
        /// E, H: which heater.
        of: TunedHeater,
        /// S, degrees Celsius.
        target: Option<Decimal>,
        /// C.
        cycles: Option<u8>,
        /// U: the gains are used.
        uses: bool,
    },
    /// M306: the model of a heater. A machine whose heaters have none answers as to an unknown
    /// command, and reads no words.
    HeaterModel {
        /// The whole line.
        text: &'a str,
        /// Words of the command: [`crate::HeaterModelWords::read`].
        words: &'a str,
    },
    // ANCHOR: m302
    /// M302: S = smallest extrusion temperature, P1 = allow cold extrusion; neither: a query.
    ColdExtrusion {
        /// S, degrees Celsius.
        minimum: Option<Decimal>,
        /// P.
        allow: Option<bool>,
    },
    // ANCHOR_END: m302
    /// M290 Z (or S): shifts Z while the G-code's coordinates stay; without Z a query. X, Y and E
    /// are for the machine to refuse.
    ShiftZ {
        /// Shift, with its sign.
        words: AxisWords,
        /// P0: the probe's offset is unchanged.
        keeps_offset: bool,
    },
    /// SET_GCODE_OFFSET Z: how far the nozzle is above what the G-code says, mm in any
    /// unit of the G-code.
    OffsetZ {
        /// Z, or Z_ADJUST.
        offset: Decimal,
        /// Z_ADJUST: it is added to the offset in force.
        adds: bool,
        /// MOVE=1: the nozzle follows at once; else its next move along Z does.
        moves: bool,
    },
    /// M500 to M504: the stored settings.
    Settings(SettingsCommand),
    /// The bed's mesh, and what measures it.
    Bed(BedCommand),
    /// M851: from the nozzle to the probe; without words a query.
    ProbeOffset(AxisWords),
    /// M75 to M78.
    PrintClock(PrintClockCommand),
    /// M206: what the coordinates of home are beyond the profile's; without words a query.
    HomeOffset(AxisWords),
    /// M852, and Klipper's words for it: axes that are not at right angles.
    Skew(SkewCommand),
    /// M425: the play of the drives; without words a query.
    Backlash(BacklashWords),
    /// M400.
    Finish,
    /// M410.
    QuickStop,
    /// M569 S: stealthChop (1) or spreadCycle (0) for the motors named; without S a query.
    StealthChop {
        /// Motors; an empty set in a query means all.
        motors: AxisFlags,
        /// T: whose motor E is; without it the selected tool's.
        tool: Option<u8>,
        /// S.
        on: Option<bool>,
    },
    /// M906, M913 or M914: a setting of the drivers; without words a query.
    Driver(DriverSetting, DriverWords),
    /// M796: I chooses the interpolation, A the acceleration's profile, by their numbers;
    /// neither: a query.
    MotionChoice {
        /// I, 0 to 4.
        interpolation: Option<u8>,
        /// A, 0 to 2.
        acceleration: Option<u8>,
    },
    /// M593, SET_INPUT_SHAPER: the filters of X and Y; without a word a query.
    InputShaper {
        /// Changes of X and of Y.
        axes: [ShaperWords<'a>; 2],
        /// The kind for an axis that gets a frequency and has no filter: `zv` in M593, as in
        /// Marlin, and `mzv` in SET_INPUT_SHAPER, as in Klipper.
        usual: &'static str,
    },
    /// TUNING_TOWER: a value that changes with the height of the print; without words a query.
    Tower(Option<TowerWords<'a>>),
    /// M900, M572, SET_PRESSURE_ADVANCE: how far the extruder runs ahead of the flow.
    PressureAdvance(Option<u8>, AdvanceWords),
    /// M955: the accelerometer's settings; without words a query.
    Accelerometer {
        /// S, samples a second.
        rate_hz: Option<u16>,
        /// R, bits of a sample.
        resolution_bits: Option<u8>,
    },
    /// M956: an accelerometer's record begins.
    RecordAcceleration {
        /// S, how many; 0: the one before ends.
        samples: u16,
        /// A1: it waits for the next move.
        at_next_move: bool,
    },
    /// M790: the host sends a prepared job, and G-code no more until it has ended.
    ReceiveJob {
        /// S: its length, bytes.
        size: u32,
        /// T: how long the host may be silent, s.
        silence_s: u16,
    },
    /// M791: the black box is sent to the host that asks, or with R is emptied.
    BlackBox {
        /// R.
        clear: bool,
    },
    /// M795: S chooses whether moves without E extrude by their length (1) or not (0); H, W and D,
    /// in the current unit, are what they extrude by. None of them: a query.
    AdaptiveExtrusion {
        /// S.
        on: Option<bool>,
        /// H: layer height.
        layer_height: Option<Decimal>,
        /// W: line width.
        line_width: Option<Decimal>,
        /// D: the filament's diameter.
        filament_diameter: Option<Decimal>,
    },
    /// M797: digests of all steps queued so far (on the desk: made so far), and motion counters.
    ReportMotion,
    /// M798: S switches the measuring of times on (and begins anew) or off, R begins anew;
    /// neither: a query.
    Timing {
        /// S.
        on: Option<bool>,
        /// R.
        clear: bool,
    },
    /// M862.1: the diameter of the nozzle that the job is for, mm; without P a query.
    CheckNozzle(Option<Decimal>),
    /// M862.3: the model of the printer that the job is for; empty where it is a query.
    CheckModel(&'a str),
    /// M999.
    Restart,
    /// T: the tool, alone a query.
    SelectTool {
        /// Number of the tool.
        tool: Option<u32>,
        /// S1: the nozzle stays where it is.
        stays: bool,
    },
    /// M218: from the first tool's nozzle to that of tool T; without T or words a query.
    ToolOffset {
        /// T.
        tool: Option<u8>,
        /// X, Y and Z.
        offset: AxisWords,
    },
    /// A command that is accepted and changes nothing on this machine (M486, M862.2 ...).
    Accepted,
    /// Anything else: answered `echo:Unknown command: "..."`.
    Unknown(&'a str),
}
