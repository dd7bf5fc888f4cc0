//! Names and parameters of the methods that a profile or M796 chooses: data on which only the
//! methods themselves ([`crate::methods`]) branch.

use crate::limits::Limits;
use crate::pressure_advance::PressureAdvance;
use crate::shaping::{AxisShaper, Shaping};
use crate::square_root::square_root;
use crate::tolerance::PathTolerance;

/// Pattern by which the motors' steps follow a straight line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Interpolation {
    /// Step Bresenham: runs of the longest axis's steps, each ended by a step of another (Wu 2024).
    #[default]
    StepBresenham,
    /// Classic Bresenham: a decision per step (Wu 2024, eq. 3).
    Bresenham,
    /// Point-by-point comparison: each pulse along X or along Y (CoreXY paper, method 1).
    PointByPoint,
    /// Minimum deviation: pulses along the longer axis or diagonally (CoreXY paper, method 2).
    MinimumDeviation,
    /// Separate rate of each motor (CoreXY paper, method 3).
    DualRate,
}

impl Interpolation {
    /// All patterns, in the order in which M796 numbers them.
    pub const ALL: [Self; 5] =
        [Self::StepBresenham, Self::Bresenham, Self::PointByPoint, Self::MinimumDeviation, Self::DualRate];

    /// The name that profiles use.
    pub const fn name(self) -> &'static str {
        match self {
            Self::StepBresenham => "step-bresenham",
            Self::Bresenham => "bresenham",
            Self::PointByPoint => "point-by-point",
            Self::MinimumDeviation => "minimum-deviation",
            Self::DualRate => "dual-rate",
        }
    }
}

/// Profile of the speed along the path.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AccelerationProfile {
    /// Constant acceleration (Wu 2024, eqs. 8 to 12).
    #[default]
    Trapezoid,
    /// Acceleration that rises and falls at a constant jerk, and is held once it reaches its limit
    /// (after Li 2017).
    SCurve,
    /// S-curve that is never held, from Li's table of frequencies.
    SCurveTable,
    /// S-curve in closed form, segment by segment: Li's five parts of constant jerk.
    SCurveFiveSegments,
}

impl AccelerationProfile {
    /// All profiles, in the order in which M796 numbers them.
    pub const ALL: [Self; 4] = [Self::Trapezoid, Self::SCurve, Self::SCurveTable, Self::SCurveFiveSegments];

    /// The name that profiles use.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Trapezoid => "trapezoid",
            Self::SCurve => "s-curve",
            Self::SCurveTable => "s-curve-table",
            Self::SCurveFiveSegments => "s-curve-five-segments",
        }
    }
}

/// Shortest and longest pulse period of a motor under dual-rate interpolation (CoreXY paper:
/// T_min and T_max), ns.
///
/// A motor that would have to be slower, while the other is at its shortest period, is in the dead
/// zone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DualRatePeriods {
    /// T_min, ns, above zero.
    pub shortest_ns: u32,
    /// T_max, ns, at least T_min.
    pub longest_ns: u32,
}

/// Parameters of Li's table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SCurveTableSettings {
    /// Start frequency f0, steps/s, above zero. The table's slices last 2/f0.
    pub start_hz: u32,
    /// Highest frequency, steps/s, above f0.
    pub top_hz: u32,
    /// Jerk, steps/s^3, above zero.
    pub jerk_hz_per_s2: u32,
}

impl SCurveTableSettings {
    /// Maximum number of slices of the table.
    pub const MAX_SLICES: u32 = 65_536;

    /// Slices of 2/f0 in the ramp from f0 to the highest frequency (Li 2017, eq. 4), including a
    /// last partial one.
    pub fn slices(&self) -> f64 {
        let [start_hz, top_hz, jerk_hz_per_s2] = [self.start_hz, self.top_hz, self.jerk_hz_per_s2].map(f64::from);
        square_root((top_hz - start_hz) / jerk_hz_per_s2) * start_hz
    }
}

/// The methods in use and their parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionChoice {
    /// Pattern by which the motors' steps follow a straight line.
    pub interpolation: Interpolation,
    /// Profile of the speed along the path.
    pub acceleration: AccelerationProfile,
    /// Largest jerk along the path under [`AccelerationProfile::SCurve`], mm/s^3, above zero.
    pub jerk_mm_per_s3: f64,
    /// Jerk of moves of the filament alone.
    pub filament_jerk_mm_per_s3: f64,
    /// Periods of [`Interpolation::DualRate`].
    pub dual_rate: DualRatePeriods,
    /// The table of [`AccelerationProfile::SCurveTable`].
    pub s_curve_table: SCurveTableSettings,
    /// Shapers of X and Y.
    pub shapers: [AxisShaper; 2],
    /// Time over which X, Y, Z and the extruder are averaged after shaping, s, within
    /// [`crate::SMOOTH_TIME_S`]; `None`: no averaging.
    pub smooth_time_s: Option<f64>,
    /// Maximum distance of the filtered path from the programmed one, mm, within
    /// [`crate::PATH_TOLERANCE_MM`]; `None`: the filters round corners freely.
    pub path_tolerance_mm: Option<f64>,
    /// Lead of the extruder over the flow.
    pub pressure_advance: PressureAdvance,
    /// True to retract and push back filament along the travels between two lines, without a stop
    /// for it ([`crate::Move`]s only).
    pub filament_on_the_way: bool,
}

impl MotionChoice {
    /// True if every image contains these methods.
    pub const fn is_standard(&self) -> bool {
        matches!(self.interpolation, Interpolation::StepBresenham)
            && matches!(self.acceleration, AccelerationProfile::Trapezoid | AccelerationProfile::SCurve)
    }

    /// Acceleration of the filament that the extruder can follow with its advance, mm/s^2; `None`
    /// without an advance, or if the filters are impossible.
    pub fn followed_filament_acceleration_mm_per_s2(&self, limits: &Limits) -> Option<f64> {
        let shaping = Shaping::new(&self.shapers, self.smooth_time_s, &self.pressure_advance).ok()?;
        let advance = shaping.extruder_advance(&self.pressure_advance)?;
        let [.., feed] = limits.max_feed_mm_per_s;
        let [.., acceleration] = limits.max_acceleration_mm_per_s2;
        let (_, acceleration) = advance.left_to_flow(feed as f32, acceleration as f32);
        Some(f64::from(acceleration))
    }

    /// Acceleration that the tolerance allows where corners follow each other within the filters'
    /// reach, mm/s^2; proportional to the tolerance. `None` without a tolerance or filters, and if
    /// the filters cannot be made.
    pub fn tolerance_acceleration_mm_per_s2(&self) -> Option<f64> {
        let shaping = Shaping::new(&self.shapers, self.smooth_time_s, &PressureAdvance::NONE).ok()?;
        let tolerance = PathTolerance::new(self.path_tolerance_mm?, &shaping)?;
        Some(f64::from(tolerance.crowded_mm_per_s2()))
    }

    /// Step Bresenham and trapezoids; the other parameters as profiles have them that do
    /// not say otherwise.
    pub const DEFAULT: Self = Self {
        interpolation: Interpolation::StepBresenham,
        acceleration: AccelerationProfile::Trapezoid,
        jerk_mm_per_s3: 10_000.0,
        filament_jerk_mm_per_s3: 1_000_000.0,
        // CoreXY paper: what drivers can do.
        dual_rate: DualRatePeriods { shortest_ns: 10_000, longest_ns: 3_000_000 },
        // Li 2017, experiment.
        s_curve_table: SCurveTableSettings { start_hz: 1_000, top_hz: 10_000, jerk_hz_per_s2: 100_000 },
        shapers: [AxisShaper::NONE; 2],
        smooth_time_s: None,
        path_tolerance_mm: None,
        pressure_advance: PressureAdvance::NONE,
        filament_on_the_way: false,
    };
}
