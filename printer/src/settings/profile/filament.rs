//! Filament: retraction, pauses, sensors, and moves without E words.

/// Firmware retraction, G10 and G11, before M207 and M208.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FirmwareRetraction {
    /// Filament drawn back, units of 10 nm.
    pub length_10nm: i64,
    /// Speed of retraction, units of 10 nm a second.
    pub retract_10nm_per_s: i64,
    /// Filament pushed beyond the length on recovery, units of 10 nm.
    pub extra_recover_10nm: i64,
    /// Speed of recovery, units of 10 nm a second.
    pub recover_10nm_per_s: i64,
    /// Lift of Z while retracted, units of 10 nm.
    pub lift_10nm: i64,
}

/// Settings of a pause (M125, M226, M600, M601, M25).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PauseSettings {
    /// Waiting place of the nozzle: X and Y in machine coordinates, units of 10 nm,
    /// within the travel.
    pub place_10nm: [i64; 2],
    /// Rise before that, units of 10 nm.
    pub rise_10nm: i64,
    /// M600: filament that is drawn out before the motor lets it go, units of 10 nm;
    /// 0: a person pulls.
    pub unload_10nm: i64,
    /// M600: filament that is pushed in before the nozzle goes back, units of 10 nm; 0:
    /// a person pushes.
    pub load_10nm: i64,
    /// M600: filament that the second button of its prompt pushes, units of 10 nm; 0:
    /// without this button.
    pub more_10nm: i64,
    /// Speed of all three, units of 10 nm a second.
    pub filament_10nm_per_s: i64,
}

impl PauseSettings {
    /// The longest rise, units of 10 nm: 1 m.
    pub const MAX_RISE_10NM: i64 = 100_000_000;

    /// The most filament that is drawn out or pushed in, units of 10 nm: 2 m.
    pub const MAX_FILAMENT_10NM: i64 = 200_000_000;

    /// Filament that a change draws out and pushes in, units of 10 nm.
    pub const fn filament_10nm(&self) -> [i64; 2] {
        [self.unload_10nm, self.load_10nm]
    }
}

/// A sensor in the filament's path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FilamentSensor {
    /// Kind of its signal.
    pub kind: FilamentSensorKind,
    /// Time for which a level must last to count, ms.
    pub debounce_ms: u16,
}

/// Kind of a filament sensor's signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FilamentSensorKind {
    /// The signal shows that filament is present.
    Switch {
        /// The signal is low while filament is missing.
        missing_is_low: bool,
    },
    /// The signal shows that filament moves: it changes its level every few millimetres.
    Encoder {
        /// Filament pushed without a change before it counts as stuck, units of 10 nm.
        detection_10nm: u32,
    },
}

impl FilamentSensor {
    /// The least that an encoder's `detection_10nm` may be: 1 mm.
    pub const MIN_DETECTION_10NM: i64 = 100_000;

    /// The most that it may be: 100 mm.
    pub const MAX_DETECTION_10NM: i64 = 10_000_000;

    /// An encoder's `detection_10nm`; `None` for a switch.
    pub const fn detection_10nm(&self) -> Option<i64> {
        match self.kind {
            FilamentSensorKind::Switch { .. } => None,
            FilamentSensorKind::Encoder { detection_10nm } => Some(detection_10nm as i64),
        }
    }
}

/// Filament for moves without E words (Wu 2024, eqs. 10 and 11).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ExtrusionSettings {
    /// True if G1 to G3 in the plane without E extrude by their length.
    pub adaptive: bool,
    /// h, units of 10 nm.
    pub layer_height_10nm: i64,
    /// b, units of 10 nm.
    pub line_width_10nm: i64,
    /// D: of the filament, or of the barrel that is pushed, units of 10 nm.
    pub filament_diameter_10nm: i64,
}

impl ExtrusionSettings {
    /// Smallest and largest layer height, line width and filament diameter, units of 10 nm.
    pub const RANGES_10NM: [(i64, i64); 3] = [(1_000, 500_000), (5_000, 2_000_000), (50_000, 10_000_000)];

    /// Filament by E words alone; 0.2 mm by 0.45 mm with 1.75 mm filament if
    /// `adaptive` is switched on.
    pub const DEFAULT: Self =
        Self { adaptive: false, layer_height_10nm: 20_000, line_width_10nm: 45_000, filament_diameter_10nm: 175_000 };
}
