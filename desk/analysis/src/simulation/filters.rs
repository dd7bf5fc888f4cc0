//! The filters of the printed and of the compared plan, and the frame that they are made for or
//! that differs from them.

use std::fmt;

use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::{
    AxisShaper, ChoiceError, EvenSpacing, MotionChoice, Planner, PressureAdvance, ShaperError, ShaperKind, smooth_ticks,
};
use ferrostep_printer::Profile;
use ferrostep_session::rules::ByRules;
use ferrostep_simulator::frame::FrameSettings;
use ferrostep_simulator::plan::{ExtruderFilter, Filters};
use ferrostep_simulator::shapers::{Shaper, ShaperKind as ComparedKind, UnknownShaper};

/// The most by which a frame may differ from its filters, per cent: beyond it, no filter is of use.
const MAX_DETUNE_PERCENT: f64 = 50.0;

/// The compared plan's filter if none is named.
const COMPARED: ComparedKind = ComparedKind::Mzv;

/// The options of the command line for filters and for the frame's frequencies.
#[derive(Clone, Copy, Debug, Default)]
pub struct FilterWords {
    /// `--input-shaper`: the kind for X and Y instead of the profile's.
    pub input_shaper: Option<ShaperKind>,
    /// `--shaper-frequency`: the frequencies that the filters are made for, Hz.
    pub shaper_frequency_hz: Option<[f64; 2]>,
    /// `--shaper-damping`: the damping ratio that they are made for.
    pub shaper_damping: Option<f64>,
    /// `--frequency-x` and `--frequency-y`: the frequencies of the frame, Hz.
    pub frame_hz: [Option<f64>; 2],
    /// `--detune`: excess of the frame's frequencies over the filters', per cent.
    pub detune_percent: Option<f64>,
    /// True if there is a compared plan.
    pub is_compared: bool,
    /// `--shaper`: the kind of the compared plan.
    pub compared: Option<ComparedKind>,
}

/// Klipper's `pressure_advance_smooth_time` where no other is given, s.
const KLIPPERS_SMOOTH_TIME_S: f64 = 0.04;

/// Filters and frame of a simulation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimulatedFilters {
    /// Filters of the steps when the job begins; [`ShaperKind::None`] on both axes for a trace,
    /// whose filters are unknown.
    pub steps: [AxisShaper; 2],
    /// Filter of the compared plan, if there is one.
    pub compared: Option<ComparedFilter>,
    /// The frequencies of the frame, Hz.
    pub frame_hz: [f64; 2],
}

/// The filters of the compared plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ComparedFilter {
    /// The kind, of X and Y.
    pub kind: ComparedKind,
    /// The frequencies that they are made for, Hz.
    pub frequency_hz: [f64; 2],
    /// The damping ratios that they are made for.
    pub damping: [f64; 2],
}

/// The words contradict each other, or mean nothing.
#[derive(Clone, Debug, PartialEq)]
pub enum FilterError {
    /// `--input-shaper` for a trace.
    OfTrace,
    /// A filter of the machine cannot be made: its axis, the filter, why.
    Shaper(char, AxisShaper, ShaperError),
    /// The machine can have no filter.
    Methods {
        /// Method by which its steps follow a line.
        interpolation: &'static str,
        /// Method by which its speeds change.
        acceleration: &'static str,
    },
    /// Klipper has no filter of this name.
    NotKlippers(ShaperKind),
    /// `--detune` and the frame's own frequency.
    FrameTwice,
    /// `--detune` is out of range.
    Detune(f64),
    /// `--detune` without any filter.
    NothingToDetune,
    /// A plan by other rules cannot have the filter of this axis: why.
    OfPlan(char, String),
    /// `--detune`, and the filters of an axis are made for two frequencies: the axis, that of the
    /// steps' and of the compared plan's, Hz.
    TwoFrequencies(char, [f64; 2]),
}

impl fmt::Display for FilterError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OfTrace => out.write_str(
                "--input-shaper: the steps of a trace are made already; give the G-code itself, or set the filter of the \
                 compared plan with --shaper",
            ),
            Self::Shaper(axis, shaper, error) => write_shaper(out, *axis, shaper, *error),
            Self::Methods { interpolation, acceleration } => write!(
                out,
                "--input-shaper: the profile moves by {interpolation} with {acceleration}, expected step-bresenham with \
                 trapezoid or s-curve"
            ),
            Self::NotKlippers(kind) => write!(
                out,
                "--input-shaper {kind}: Klipper has no such filter; say with --shaper which one its plan has",
            ),
            Self::FrameTwice => out.write_str(
                "--detune moves the frame away from the filters' frequencies: give those with --shaper-frequency X,Y, and \
                 leave --frequency-x and --frequency-y out",
            ),
            Self::Detune(percent) => write!(
                out,
                "--detune is {percent} %, expected -{MAX_DETUNE_PERCENT} to {MAX_DETUNE_PERCENT} % of the filters' \
                 frequencies"
            ),
            Self::NothingToDetune => out.write_str(
                "--detune: no filter is known that the frame could differ from; give --input-shaper NAME or a profile with \
                 input_shaper, or set the frame's own frequency with --frequency-x and --frequency-y",
            ),
            Self::OfPlan(axis, reason) => write!(out, "the filter of {axis}: {reason}"),
            Self::TwoFrequencies(axis, [steps_hz, compared_hz]) => write!(
                out,
                "--detune: the filter of {axis} is made for {steps_hz} Hz, that of the compared plan for {compared_hz} Hz; \
                 set both with --input-shaper NAME --shaper-frequency X,Y, or the frame with --frequency-x and --frequency-y"
            ),
        }
    }
}

fn write_shaper(out: &mut fmt::Formatter<'_>, axis: char, shaper: &AxisShaper, error: ShaperError) -> fmt::Result {
    let AxisShaper { kind, frequency_hz, damping } = *shaper;
    match error {
        ShaperError::Frequency => {
            let [lowest, highest] = AxisShaper::FREQUENCY_HZ;
            write!(
                out,
                "the filter of {axis} is made for {frequency_hz} Hz, expected {lowest} to {highest} Hz (--shaper-frequency)"
            )
        }
        ShaperError::Damping => write!(
            out,
            "the filter of {axis} is made for a damping ratio of {damping}, expected 0 to {} for {kind} (--shaper-damping)",
            kind.max_damping()
        ),
        ShaperError::Spacing => {
            write!(out, "the filter of {axis} is {kind}, which does not exist, expected in mzv(N,T) {}", EvenSpacing::RULE)
        }
        ShaperError::TooLong { lowest_hundredths_hz, is_smooth } => write!(
            out,
            "the filter of {axis}, {kind} for {frequency_hz} Hz, lasts longer than 100 ms{}, expected at least {} Hz \
             (--shaper-frequency) or a shorter kind",
            if is_smooth { " with the profile's input_shaper.smooth_time_s" } else { "" },
            f64::from(lowest_hundredths_hz) / 100.0
        ),
        ShaperError::UnequalMotors
        | ShaperError::Methods
        | ShaperError::SmoothTime
        | ShaperError::SmoothSCurve => out.write_str(
            "--input-shaper: two motors that move an axis together have different steps/mm in this profile, expected the \
             same of both",
        ),
    }
}

impl std::error::Error for FilterError {}

impl SimulatedFilters {
    /// The filters of the job's plan by another firmware's rules: the shapers of the steps, and the
    /// profile's pressure advance, which only Klipper smooths.
    ///
    /// # Errors
    /// [`FilterError::OfPlan`].
    pub fn of_plan(&self, profile: &Profile, by: &ByRules) -> Result<Filters, FilterError> {
        let [x, y] = &self.steps;
        let PressureAdvance { seconds, smooth_time_s, .. } = profile.motion.pressure_advance;
        let smooth_time_s = if by.smooths_advance() { smooth_time_s.unwrap_or(KLIPPERS_SMOOTH_TIME_S) } else { 0.0 };
        Ok(Filters {
            shapers: [planned_shaper('X', x)?, planned_shaper('Y', y)?],
            extruder: ExtruderFilter::klipper(seconds, smooth_time_s),
        })
    }
}

/// The filter of an axis, as the simulator has it.
fn planned_shaper(axis: char, shaper: &AxisShaper) -> Result<Shaper, FilterError> {
    if !is_filter(shaper) {
        return Ok(Shaper::identity());
    }
    let of_plan = |reason: String| FilterError::OfPlan(axis, reason);
    let kind: ComparedKind =
        shaper.kind.to_string().parse().map_err(|error: UnknownShaper| of_plan(error.to_string()))?;
    Shaper::new(kind, shaper.frequency_hz, shaper.damping).map_err(|error| of_plan(error.to_string()))
}

impl FilterWords {
    /// Applies the words to a job on a machine, or to a trace (`None`).
    ///
    /// # Errors
    /// [`FilterError`].
    pub fn of(&self, profile: Option<&Profile>) -> Result<SimulatedFilters, FilterError> {
        let profiles = profile.map_or([AxisShaper::NONE; 2], |profile| profile.motion.shapers);
        let steps = match (self.input_shaper, profile) {
            (None, _) => profiles,
            (Some(_), None) => return Err(FilterError::OfTrace),
            (Some(kind), Some(profile)) => {
                let shapers = [0, 1].map(|axis: usize| self.shaper(kind, axis, profiles[axis]));
                check(profile, shapers)?;
                shapers
            }
        };
        let nominal_hz =
            [0, 1].map(
                |axis: usize| {
                    if is_filter(&steps[axis]) { steps[axis].frequency_hz } else { self.frequency_hz(axis, None) }
                },
            );
        let own_frame_hz = [0, 1].map(|axis: usize| self.frame_hz[axis].unwrap_or(DEFAULT_HZ[axis]));
        let is_nominal = self.input_shaper.is_some() || self.detune_percent.is_some();
        let compared = ComparedFilter {
            kind: self.compared_kind()?,
            frequency_hz: self.shaper_frequency_hz.unwrap_or(if is_nominal { nominal_hz } else { own_frame_hz }),
            damping: [0, 1].map(|axis: usize| {
                let steps = self.input_shaper.map_or(AxisShaper::NONE.damping, |_| steps[axis].damping);
                self.shaper_damping.unwrap_or(steps)
            }),
        };
        let compared = self.is_compared.then_some(compared);
        let frame_hz = match self.detune_percent {
            None => own_frame_hz,
            Some(percent) => {
                self.check_detune(percent, &steps, compared.as_ref())?;
                nominal_hz.map(|hz| hz * (1.0 + percent / 100.0))
            }
        };
        Ok(SimulatedFilters { steps, compared, frame_hz })
    }

    /// The filter of an axis under `--input-shaper`: frequency and damping are the
    /// profile's unless given.
    fn shaper(&self, kind: ShaperKind, axis: usize, profiles: AxisShaper) -> AxisShaper {
        let profiles = Some(profiles).filter(is_filter);
        AxisShaper {
            kind,
            frequency_hz: self.frequency_hz(axis, profiles.map(|shaper| shaper.frequency_hz)),
            damping: self.shaper_damping.unwrap_or(profiles.map_or(AxisShaper::NONE.damping, |shaper| shaper.damping)),
        }
    }

    /// The frequency that a filter is made for, Hz.
    fn frequency_hz(&self, axis: usize, profiles: Option<f64>) -> f64 {
        let named = self.shaper_frequency_hz.map(|hz| hz[axis]);
        named.or(profiles).or(self.frame_hz[axis]).unwrap_or(DEFAULT_HZ[axis])
    }

    fn compared_kind(&self) -> Result<ComparedKind, FilterError> {
        match (self.compared, self.input_shaper) {
            (Some(kind), _) => Ok(kind),
            (None, Some(kind)) if self.is_compared => {
                let klippers = kind.to_string().parse().ok().filter(|_| kind != ShaperKind::Zvdd);
                klippers.ok_or(FilterError::NotKlippers(kind))
            }
            (None, _) => Ok(COMPARED),
        }
    }

    fn check_detune(
        &self,
        percent: f64,
        steps: &[AxisShaper; 2],
        compared: Option<&ComparedFilter>,
    ) -> Result<(), FilterError> {
        // NaN is in no range.
        if !(-MAX_DETUNE_PERCENT..=MAX_DETUNE_PERCENT).contains(&percent) {
            return Err(FilterError::Detune(percent));
        }
        if self.frame_hz != [None; 2] {
            return Err(FilterError::FrameTwice);
        }
        let compared = compared.filter(|compared| compared.kind != ComparedKind::None);
        if compared.is_none() && !steps.iter().any(is_filter) {
            return Err(FilterError::NothingToDetune);
        }
        let Some(compared) = compared else { return Ok(()) };
        for ((axis, steps), compared_hz) in ['X', 'Y'].into_iter().zip(steps).zip(compared.frequency_hz) {
            if is_filter(steps) && steps.frequency_hz != compared_hz {
                return Err(FilterError::TwoFrequencies(axis, [steps.frequency_hz, compared_hz]));
            }
        }
        Ok(())
    }
}

/// The frame's frequencies if none are given, Hz.
const DEFAULT_HZ: [f64; 2] = FrameSettings::USUAL.frequency_hz;

/// Returns true if it filters anything.
fn is_filter(shaper: &AxisShaper) -> bool {
    shaper.kind != ShaperKind::None
}

/// Checks that a machine can have these filters.
fn check(profile: &Profile, shapers: [AxisShaper; 2]) -> Result<(), FilterError> {
    for (axis, shaper) in ['X', 'Y'].into_iter().zip(&shapers) {
        let kernel = smooth_ticks(profile.motion.smooth_time_s).and_then(|ticks| shaper.kernel_beside(ticks));
        kernel.map_err(|error| FilterError::Shaper(axis, *shaper, error))?;
    }
    if !shapers.iter().any(is_filter) {
        return Ok(());
    }
    let choice = MotionChoice { shapers, ..profile.motion };
    let mut planner: Planner<Vec<Slot>> = Planner::new(profile.geometry(), profile.limits, vec![Slot::EMPTY; 2]);
    planner.set_motion_choice(&choice).map_err(|error| match error {
        ChoiceError::Shaper(error @ ShaperError::UnequalMotors) => FilterError::Shaper('X', shapers[0], error),
        _ => FilterError::Methods {
            interpolation: choice.interpolation.name(),
            acceleration: choice.acceleration.name(),
        },
    })
}

#[cfg(test)]
mod tests;
