//! Types for the words of commands.

use crate::Decimal;

/// The X, Y, Z and E words of a line; `None` where the word is absent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AxisWords {
    /// The X word.
    pub x: Option<Decimal>,
    /// The Y word.
    pub y: Option<Decimal>,
    /// The Z word.
    pub z: Option<Decimal>,
    /// The E word.
    pub e: Option<Decimal>,
}

impl AxisWords {
    /// True if E is given and X, Y and Z are not.
    pub const fn is_e_alone(&self) -> bool {
        self.e.is_some() && self.x.is_none() && self.y.is_none() && self.z.is_none()
    }
}

/// Axes that a line names, with or without a value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AxisFlags {
    /// X is named.
    pub x: bool,
    /// Y is named.
    pub y: bool,
    /// Z is named.
    pub z: bool,
    /// E is named.
    pub e: bool,
}

impl AxisFlags {
    /// True if no axis is named (which most commands take as "all").
    pub const fn is_empty(self) -> bool {
        !(self.x || self.y || self.z || self.e)
    }
}

/// Form in which G2 and G3 name the circle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArcForm {
    /// I and J: the centre, relative to the start. An absent word is zero.
    Centre {
        /// The I word: X offset of the centre.
        i: Decimal,
        /// The J word: Y offset of the centre.
        j: Decimal,
    },
    /// R: the radius; negative asks for the longer arc.
    Radius(Decimal),
}

/// Length unit of the coordinates that follow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Units {
    /// G21.
    Millimetres,
    /// G20.
    Inches,
}

/// Parameters of firmware retraction (M207, M208).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RetractionWords {
    /// S: filament length (M207) or extra length on recovery (M208).
    pub length: Option<Decimal>,
    /// F: feed rate, per minute.
    pub feed: Option<Decimal>,
    /// Z: lift (M207 only).
    pub lift: Option<Decimal>,
}

/// The heater that M303 tunes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TunedHeater {
    /// Nozzle of this tool; without a number that of the selected tool.
    Nozzle(Option<u8>),
    /// E-1 or H0: the bed's.
    Bed,
    /// E-2: the chamber's.
    Chamber,
}

/// Setting of a motor's driver that [`DriverWords`] change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DriverSetting {
    /// M906: current in motion, mA.
    Current,
    /// M913: speed at which spreadCycle takes over from stealthChop, mm/s, 0: none.
    SpreadCycleAbove,
    /// M914: StallGuard's threshold, 0 to 255.
    StallThreshold,
}

impl DriverSetting {
    /// Number after the M that sets it.
    pub const fn code(self) -> u32 {
        match self {
            Self::Current => 906,
            Self::SpreadCycleAbove => 913,
            Self::StallThreshold => 914,
        }
    }

    /// The largest value: more mA than any of the drivers can deliver, the largest speed of a
    /// profile, the chip's largest threshold.
    pub const fn max(self) -> u16 {
        match self {
            Self::Current => 3000,
            Self::SpreadCycleAbove => 2000,
            Self::StallThreshold => 255,
        }
    }
}

/// A whole number for each motor that is named (M906, M913, M914). On a CoreXY machine X and Y name
/// the motors A and B.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DriverWords {
    /// X.
    pub x: Option<u16>,
    /// Y.
    pub y: Option<u16>,
    /// Z.
    pub z: Option<u16>,
    /// E.
    pub e: Option<u16>,
    /// T: whose motor E is; without it the selected tool's.
    pub tool: Option<u8>,
}

impl DriverWords {
    /// The numbers in the order of the motors.
    pub const fn all(self) -> [Option<u16>; 4] {
        [self.x, self.y, self.z, self.e]
    }
}

/// Changes of an axis's filter by M593 or SET_INPUT_SHAPER; `None` leaves a value unchanged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ShaperWords<'a> {
    /// P, SHAPER_TYPE: the kind's name, for the machine to know.
    pub kind: Option<&'a str>,
    /// F, SHAPER_FREQ: Hz; 0: no filter.
    pub frequency: Option<Decimal>,
    /// D, S, DAMPING_RATIO.
    pub damping: Option<Decimal>,
}

/// Words of M900, M572 or SET_PRESSURE_ADVANCE; without any of them it is a query.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AdvanceWords {
    /// K, S, ADVANCE: seconds. It takes the place of both K.
    pub slow: Option<Decimal>,
    /// L: seconds, for the flow beyond `speed`; both or neither.
    pub fast: Option<Decimal>,
    /// T: mm/s of filament.
    pub speed: Option<Decimal>,
    /// W, SMOOTH_TIME: over how many seconds it is averaged.
    pub smooth_time: Option<Decimal>,
}

/// Words of M425; without any of them it is a query.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BacklashWords {
    /// X, Y and Z: the play of their drives.
    pub play: [Option<Decimal>; 3],
    /// F: which part of it is taken up, 0 to 1.
    pub correction: Option<Decimal>,
    /// S: the way on which that happens.
    pub smoothing: Option<Decimal>,
}

/// Action on the settings that survive power-off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SettingsCommand {
    /// M500: those in force are stored.
    Store,
    /// M501: the stored ones come into force.
    Load,
    /// M502: those of the profile come into force.
    Reset,
    /// M503: those in force are reported as commands.
    Report {
        /// True but for S0: adds a line above each command that says what it is.
        headings: bool,
    },
    /// M504: the stored ones are checked.
    Validate,
}

/// Words of M220, executed in this order: B, R, S. Without a word it is a query.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FeedWords {
    /// S: percent.
    pub percent: Option<Decimal>,
    /// B: the present percentage is kept.
    pub keeps: bool,
    /// R: the kept percentage comes back.
    pub restores: bool,
}

/// Words of M412. Without any of them it is a query.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FilamentSensorWords {
    /// S: whether the filament sensor pauses a print.
    pub on: Option<bool>,
    /// D: how much filament may be pushed without a sign that it moves.
    pub distance: Option<Decimal>,
    /// R: what has been pushed without a sign so far counts no more.
    pub resets: bool,
}

impl FilamentSensorWords {
    /// True if it is a query.
    pub const fn is_query(&self) -> bool {
        self.on.is_none() && self.distance.is_none() && !self.resets
    }
}

/// Actions of M75 to M78 on the clock and the counters of the print.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PrintClockCommand {
    /// M75: it starts, or continues.
    Start,
    /// M76: it pauses.
    Pause,
    /// M77: the print is complete.
    Stop,
    /// M78: reports all prints together.
    Report,
    /// M78 S78: counts anew.
    Clear,
}

/// Words of M301 or M304: a heater's gains in Marlin's units, with power from 0 to 255. Without any
/// of them it is a query.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GainWords {
    /// P: per degree.
    pub proportional: Option<Decimal>,
    /// I: per degree and second.
    pub integral: Option<Decimal>,
    /// D: seconds per degree.
    pub derivative: Option<Decimal>,
    /// F (M301): what the part-cooling fan takes, for each degree between 25 degrees
    /// Celsius and the target.
    pub fan: Option<Decimal>,
}

/// Temperature that M109, M190 and M191 wait for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WaitTarget {
    /// S: wait only while heating.
    Heating(Decimal),
    /// R: wait for cooling as well.
    HeatingOrCooling(Decimal),
    /// S and R are missing: wait for the target that is already set.
    Current,
    /// MINIMUM of TEMPERATURE_WAIT: wait until it is this warm, whatever the target.
    AtLeast(Decimal),
}
