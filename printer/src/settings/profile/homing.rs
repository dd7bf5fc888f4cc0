//! Homing of the axes, and probing of the bed.

use ferrostep_planner::surface::MeshInterpolation;
use ferrostep_virtual_board::SheetShape;

/// The end of its travel to which an axis homes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HomeEnd {
    /// Towards smaller coordinates.
    Min,
    /// Towards larger coordinates.
    Max,
}

/// The sensor with which an axis finds its home.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HomeSensor {
    /// A switch.
    EndStop,
    /// A probe that finds the bed (only Z).
    Probe,
    /// The frame: the motor's driver signals that it stalls (only X and Y).
    Stall,
}

/// Homing of an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisHoming {
    /// The end to which it homes.
    pub end: HomeEnd,
    /// The sensor at that end.
    pub sensor: HomeSensor,
    /// True if the sensor's signal is low when it triggers; a driver's stall signal is high then.
    pub triggers_low: bool,
    /// Machine coordinate at which the sensor triggers, in units of 10 nm. With a probe it is that
    /// of the bed: the probe triggers at this less the Z of [`SafeHoming::probe_offset_10nm`].
    pub position_10nm: i64,
    /// Speed of the first approach, mm/s.
    pub fast_mm_per_s: f64,
    /// Speed of the second approach, mm/s.
    pub slow_mm_per_s: f64,
    /// Path back between the two, in units of 10 nm.
    pub back_off_10nm: i64,
    /// Maximum excess of the frame over the travel, in units of 10 nm: an approach from an unknown
    /// place goes no farther than the sum of both.
    pub overrun_10nm: i64,
    /// Greatest distance between the places where the two approaches trigger, in units of 10 nm.
    pub agree_10nm: i64,
}

impl AxisHoming {
    /// Maximum distance of an approach to the bed below the place where its sensor must trigger,
    /// units of 10 nm: 0.5 mm.
    pub const MAX_PRESS_10NM: i64 = 50_000;
}

/// Keeps the nozzle off the bed while a machine homes. Lengths in units of 10 nm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SafeHoming {
    /// Minimum height over the bed while X and Y move; a Z that is unknown is raised by this.
    pub raise_10nm: i64,
    /// Place of the nozzle (X, Y) while Z homes; `None`: at any place.
    pub home_at_10nm: Option<[i64; 2]>,
    /// Offset from the nozzle's tip to the place where the probe triggers (X, Y, Z), as M851 has
    /// it: a Z of -1 mm says that the nozzle is 1 mm above the bed when the probe triggers.
    pub probe_offset_10nm: [i64; 3],
    /// Area in which the probe finds the bed: lower and upper end along X and along Y,
    /// machine coordinates.
    pub bed_10nm: [[i64; 2]; 2],
    /// The bed is the circle between these ends, which are as far from each other
    /// along Y as along X.
    pub is_round: bool,
}

impl SafeHoming {
    /// Smallest and largest Z of a probe's offset, units of 10 nm: none triggers when the nozzle is
    /// higher than 10 mm; above 0 the nozzle touches before the probe triggers.
    pub const PROBE_Z_10NM: [i64; 2] = [-1_000_000, 500_000];

    /// Raises no axis; Z homes at any place.
    pub const NONE: Self =
        Self { raise_10nm: 0, home_at_10nm: None, probe_offset_10nm: [0; 3], bed_10nm: [[0; 2]; 2], is_round: false };

    /// Returns true if a place of the probe within the ends of the bed is above it.
    pub fn is_above_bed(&self, place_10nm: [i64; 2]) -> bool {
        let [[left, right], [front, back]] = self.bed_10nm;
        let [x, y] = place_10nm;
        // Twice each length, so that the middle is whole. All are within 5 m.
        let [across, along] = [2 * x - left - right, 2 * y - front - back];
        // Points of a grid are rounded: 10 um beside the rim count as on it.
        let diameter = right - left + 2_000;
        !self.is_round || across * across + along * along <= diameter * diameter
    }
}

/// A probe whose pin a servo's signal puts out and draws in (BLTouch).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlTouch {
    /// Time that the pin may take, and that the signal lasts, ms.
    pub move_ms: u16,
    /// The pin goes in and out between the two approaches to a place.
    pub stows_each_touch: bool,
    /// True to test the pin before each deployment: up, it must read as triggered in touch mode.
    pub tests_signal: bool,
}

/// Measuring of the bed, and the height up to which Z follows it. Lengths in units of 10 nm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MeshSettings {
    /// Points along X and along Y, 2 to [`ferrostep_planner::surface::MAX_MESH_POINTS`].
    pub points: [u8; 2],
    /// Interpolation of the surface between them.
    pub interpolation: MeshInterpolation,
    /// Area of the points: lower and upper end along X and along Y, machine
    /// coordinates of the probe.
    pub area_10nm: [[i64; 2]; 2],
    /// Height of the nozzle from which on Z no longer follows; 0: it follows to the top.
    pub fade_10nm: i64,
    /// Height of the nozzle on the way from point to point.
    pub lift_10nm: i64,
    /// Maximum depth of the bed below its height at home.
    pub depth_10nm: i64,
    /// Number of probings of a point.
    pub samples: u8,
    /// The shape of the virtual board's sheet; used by that alone.
    pub sheet: SheetShape,
}

/// A levelling screw of the bed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BedScrew {
    /// Usual name of the screw.
    pub name: &'static str,
    /// Place of the screw: X and Y in machine coordinates, 10 nm, within reach of the probe.
    pub place_10nm: [i64; 2],
}

/// The levelling screws of the bed (G35).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BedScrews {
    /// Move of the bed by a turn, units of 10 nm, above 0.
    pub pitch_10nm: i64,
    /// A turn clockwise lifts the bed.
    pub clockwise_lifts: bool,
    /// The screws; the others are turned to the height of the first.
    pub screws: [Option<BedScrew>; BedScrews::MAX],
}

impl BedScrews {
    /// The most screws.
    pub const MAX: usize = 8;
}
