//! The shapers that exist, by their published definitions.
//!
//! Sources: ZV, ZVD and ZVDD: Singer and Seering 1990; EI and its humps: Singhose, Seering and
//! Singer 1996, and with damping the polynomials of Singhose and Vaughan that Klipper has since
//! 2025; MZV: Klipper's definition.

use core::fmt;

use super::even_spacing::EvenSpacing;
use super::kernel::{Kernel, MAX_LENGTH_TICKS};
use crate::square_root::square_root;
use crate::time_units::TICKS_PER_SECOND;

/// The kinds of shaper.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
pub enum ShaperKind {
    /// No shaper: the command itself.
    #[default]
    None,
    /// Zero vibration: two impulses.
    Zv,
    /// Klipper's modified zero vibration: three impulses over three quarters of a period.
    Mzv,
    /// MZV with another number of impulses over another time (Klipper since 2026).
    EvenMzv(EvenSpacing),
    /// Zero vibration and derivative: three impulses.
    Zvd,
    // ANCHOR: zvdd_kind
    /// Zero vibration and two derivatives: four impulses.
    Zvdd,
    // ANCHOR_END: zvdd_kind
    /// Extra-insensitive with fitted damping (Klipper since 2025).
    Ei,
    /// Extra-insensitive as it was before (Marlin, Prusa, Klipper until 2025).
    EiOld,
    /// Two humps, with fitted damping.
    TwoHumpEi,
    /// Three humps, with fitted damping.
    ThreeHumpEi,
}

/// A shaper of an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisShaper {
    /// Kind of shaper.
    pub kind: ShaperKind,
    /// Undamped frequency of the axis's mode, Hz.
    pub frequency_hz: f64,
    /// Damping ratio of the mode.
    pub damping: f64,
}

/// A shaper cannot be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShaperError {
    /// The frequency is not within [`AxisShaper::FREQUENCY_HZ`].
    Frequency,
    /// The damping ratio is negative or above [`ShaperKind::max_damping`].
    Damping,
    /// No such impulses at equal distances, or one of them would be negative.
    Spacing,
    /// The filter is longer than [`MAX_LENGTH_TICKS`]: the frequency is too low for this shaper.
    TooLong {
        /// The lowest frequency at which it is not, 1/100 Hz.
        lowest_hundredths_hz: u32,
        /// True if a moving average is a part of the filter.
        is_smooth: bool,
    },
    /// The time of the moving average is not within [`super::SMOOTH_TIME_S`].
    SmoothTime,
    /// Speeds follow an S-curve: its average would be of a degree that the steps
    /// are not solved for.
    SmoothSCurve,
    /// Two motors move one axis, with different steps/mm.
    UnequalMotors,
    /// The steps follow another pattern than step Bresenham, or speeds another law than
    /// trapezoid and S-curve.
    Methods,
}

impl AxisShaper {
    /// No shaper; the frequency and damping that a shaper is made for where only its kind is given.
    pub const NONE: Self = Self { kind: ShaperKind::None, frequency_hz: 40.0, damping: 0.1 };

    /// The lowest and the highest frequency, Hz.
    pub const FREQUENCY_HZ: [f64; 2] = [5.0, 500.0];

    /// The kernel.
    ///
    /// # Errors
    /// [`ShaperError`].
    pub fn kernel(&self) -> Result<Kernel, ShaperError> {
        self.kernel_beside(0)
    }

    /// The kernel beside a moving average over that number of ticks, less than
    /// [`MAX_LENGTH_TICKS`], with which it makes one filter.
    ///
    /// # Errors
    /// [`ShaperError`].
    pub fn kernel_beside(&self, smooth_ticks: u32) -> Result<Kernel, ShaperError> {
        let [lowest, highest] = Self::FREQUENCY_HZ;
        if self.kind == ShaperKind::None {
            return Ok(Kernel::IDENTITY);
        }
        // NaN is in no range.
        if !(self.frequency_hz >= lowest && self.frequency_hz <= highest) {
            return Err(ShaperError::Frequency);
        }
        if !(self.damping >= 0.0 && self.damping <= self.kind.max_damping()) {
            return Err(ShaperError::Damping);
        }
        if let ShaperKind::EvenMzv(spacing) = self.kind
            && spacing.weights().is_none()
        {
            return Err(ShaperError::Spacing);
        }
        let kernel = self.of_any_length();
        let most_ticks = MAX_LENGTH_TICKS.saturating_sub(smooth_ticks);
        if kernel.length_ticks() <= most_ticks {
            return Ok(kernel);
        }
        let lowest_hundredths_hz = (self.lowest_frequency_hz(smooth_ticks) * 100.0 + 0.5) as u32;
        Err(ShaperError::TooLong { lowest_hundredths_hz, is_smooth: smooth_ticks > 0 })
    }

    /// The lowest frequency of this kind and damping ratio, both in their ranges, at which the
    /// filter, beside a moving average over `smooth_ticks`, is no longer than [`MAX_LENGTH_TICKS`];
    /// Hz, to the next hundredth above.
    pub fn lowest_frequency_hz(&self, smooth_ticks: u32) -> f64 {
        let [lowest, _] = Self::FREQUENCY_HZ;
        let most_ticks = MAX_LENGTH_TICKS.saturating_sub(smooth_ticks);
        let at_lowest = Self { frequency_hz: lowest, ..*self }.of_any_length().length_ticks();
        // Delays are proportional to the period. A tick more, for they are rounded.
        let frequency_hz = lowest * f64::from(at_lowest.saturating_add(1)) / f64::from(most_ticks);
        let hundredths = (frequency_hz * 100.0) as u32;
        if frequency_hz <= lowest { lowest } else { f64::from(hundredths.saturating_add(1)) / 100.0 }
    }

    /// Variance by which this shaper's kernel and the mode that it is made for spread the path
    /// together, squared ticks.
    ///
    /// The mode 1 / (1 + 2 zeta s / omega + s^2 / omega^2) has the variance -2 (1 - 2 zeta^2) /
    /// omega^2, the second derivative of its logarithm at s = 0. It is negative: the frame runs
    /// wide where the kernel cuts a corner. Without a shaper nothing is known of the mode, and the
    /// path is not spread.
    #[cold]
    pub(super) fn path_variance(&self, kernel: &Kernel) -> f64 {
        if self.kind == ShaperKind::None {
            return 0.0;
        }
        let radian_ticks = f64::from(TICKS_PER_SECOND) / (core::f64::consts::TAU * self.frequency_hz);
        kernel.variance() - 2.0 * (1.0 - 2.0 * self.damping * self.damping) * radian_ticks * radian_ticks
    }

    /// The kernel of a frequency and damping in their ranges.
    #[cold]
    #[inline(never)]
    fn of_any_length(&self) -> Kernel {
        let mode = Mode::new(self.frequency_hz, self.damping);
        let mut kernel = match self.kind {
            ShaperKind::None => Kernel::IDENTITY,
            ShaperKind::Zv => mode.halves(&[1.0, 1.0]),
            ShaperKind::Zvd => mode.halves(&[1.0, 2.0, 1.0]),
            // ANCHOR: zvdd_kernel
            ShaperKind::Zvdd => mode.halves(&[1.0, 3.0, 3.0, 1.0]),
            // ANCHOR_END: zvdd_kernel
            ShaperKind::EiOld => mode.halves(&[1.0 + TOLERANCE, 2.0 - 2.0 * TOLERANCE, 1.0 + TOLERANCE]),
            ShaperKind::Mzv => {
                let outer = 1.0 - core::f64::consts::FRAC_1_SQRT_2;
                mode.equal_distances(0.375, &[outer, core::f64::consts::SQRT_2 - 1.0, outer])
            }
            ShaperKind::EvenMzv(spacing) => match spacing.weights() {
                Some(weights) => mode.equal_distances(spacing.distance_periods(), weights.as_slice()),
                None => Kernel::IDENTITY,
            },
            ShaperKind::Ei => mode.fitted_ei(),
            ShaperKind::TwoHumpEi => mode.fitted(&TWO_HUMP_EI),
            ShaperKind::ThreeHumpEi => mode.fitted(&THREE_HUMP_EI),
        };
        kernel.normalise();
        kernel
    }
}

impl ShaperKind {
    /// Kinds without numbers, with their names in profiles and in `SET_INPUT_SHAPER`.
    pub const NAMED: [(&'static str, Self); 9] = [
        ("none", Self::None),
        ("zv", Self::Zv),
        ("mzv", Self::Mzv),
        ("zvd", Self::Zvd),
        ("zvdd", Self::Zvdd),
        ("ei", Self::Ei),
        ("ei_old", Self::EiOld),
        ("2hump_ei", Self::TwoHumpEi),
        ("3hump_ei", Self::ThreeHumpEi),
    ];

    /// One of each kind.
    pub const EXAMPLES: [Self; 10] = {
        let mut kinds = [Self::EvenMzv(EvenSpacing { impulses: 5, period_thousandths: 1100 }); 10];
        let mut index = 0;
        while index < Self::NAMED.len() {
            kinds[index] = Self::NAMED[index].1;
            index += 1;
        }
        kinds
    };

    /// The kind of this name, in upper or lower case: one of [`Self::NAMED`], or as `mzv(5,0.9)`
    /// and `mzv(n=5,t=0.9)` with the number of impulses and the periods that they last.
    pub fn from_name(name: &str) -> Option<Self> {
        if let Some((_, kind)) = Self::NAMED.iter().find(|(known, _)| known.eq_ignore_ascii_case(name)) {
            return Some(*kind);
        }
        let (kind, numbers) = name.strip_suffix(')')?.split_once('(')?;
        kind.eq_ignore_ascii_case("mzv").then(|| EvenSpacing::from_text(numbers).map(Self::EvenMzv)).flatten()
    }

    /// Largest damping ratio; the fitted shapers hold no farther than they were fitted.
    pub const fn max_damping(self) -> f64 {
        match self {
            Self::Ei => 0.4,
            Self::TwoHumpEi => 0.3,
            Self::ThreeHumpEi => 0.2,
            Self::None | Self::Zv | Self::Mzv | Self::EvenMzv(_) | Self::Zvd | Self::Zvdd | Self::EiOld => 0.99,
        }
    }
}

impl fmt::Display for ShaperKind {
    /// The name that [`Self::from_name`] knows.
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Self::EvenMzv(EvenSpacing { impulses, period_thousandths }) = self {
            return write!(out, "mzv({impulses},{}.{:03})", period_thousandths / 1000, period_thousandths % 1000);
        }
        let name = Self::NAMED.iter().find(|(_, kind)| kind == self).map_or("", |(name, _)| name);
        out.pad(name)
    }
}

impl fmt::Debug for ShaperKind {
    /// Writes the type's name too: an image's profile is compiled from this form, in which `None`
    /// alone would be an `Option`'s.
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            Self::None => "ShaperKind::None",
            Self::Zv => "ShaperKind::Zv",
            Self::Mzv => "ShaperKind::Mzv",
            Self::EvenMzv(spacing) => return write!(out, "ShaperKind::EvenMzv({spacing:?})"),
            Self::Zvd => "ShaperKind::Zvd",
            Self::Zvdd => "ShaperKind::Zvdd",
            Self::Ei => "ShaperKind::Ei",
            Self::EiOld => "ShaperKind::EiOld",
            Self::TwoHumpEi => "ShaperKind::TwoHumpEi",
            Self::ThreeHumpEi => "ShaperKind::ThreeHumpEi",
        })
    }
}

/// Vibration that shapers with humps leave on purpose, as everywhere.
const TOLERANCE: f64 = 0.05;

/// An impulse's weight, and its delay in undamped periods, as polynomials in the damping ratio.
type Fitted = [[f64; 4]; 2];

/// Two humps of 5 % (Singhose and Vaughan).
const TWO_HUMP_EI: [Fitted; 4] = [
    [[0.16054, 0.76699, 2.26560, -1.22750], [0.0; 4]],
    [[0.33911, 0.45081, -2.58080, 1.73650], [0.49890, 0.16270, -0.54262, 6.16180]],
    [[0.34089, -0.61533, -0.68765, 0.42261], [0.99748, 0.18382, -1.58270, 8.17120]],
    [[0.15997, -0.60246, 1.00280, -0.93145], [1.49920, -0.09297, -0.28338, 1.85710]],
];

/// Three humps of 5 % (Singhose and Vaughan).
const THREE_HUMP_EI: [Fitted; 5] = [
    [[0.11275, 0.76632, 3.29160, -1.44380], [0.0; 4]],
    [[0.23698, 0.61164, -2.57850, 4.85220], [0.49974, 0.23834, 0.44559, 12.4720]],
    [[0.30008, -0.19062, -2.14560, 0.13744], [0.99849, 0.29808, -2.36460, 23.3990]],
    [[0.23775, -0.73297, 0.46885, -2.08650], [1.49870, 0.10306, -2.01390, 17.0320]],
    [[0.11244, -0.45439, 0.96382, -1.46000], [1.99960, -0.28231, 0.61536, 5.40450]],
];

/// A polynomial with these coefficients, the constant first.
#[cold]
#[inline(never)]
fn polynomial(coefficients: &[f64; 4], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, coefficient| sum * x + coefficient)
}

/// The mode that a shaper is made for.
struct Mode {
    damping: f64,
    undamped_period_ticks: f64,
    damped_period_ticks: f64,
    /// Decay of the vibration over a damped period, as an exponent of e.
    decrement: f64,
}

impl Mode {
    fn new(frequency_hz: f64, damping: f64) -> Self {
        let root = square_root(1.0 - damping * damping);
        let undamped_period_ticks = f64::from(TICKS_PER_SECOND) / frequency_hz;
        Self {
            damping,
            undamped_period_ticks,
            damped_period_ticks: undamped_period_ticks / root,
            decrement: -core::f64::consts::TAU * damping / root,
        }
    }

    /// Impulses half a damped period apart; these are the weights without damping.
    fn halves(&self, weights: &[f64]) -> Kernel {
        self.equal_distances(0.5, weights)
    }

    /// Impulses this part of a damped period apart; these are the weights without damping.
    #[cold]
    #[inline(never)]
    fn equal_distances(&self, periods: f64, weights: &[f64]) -> Kernel {
        let decay = libm::exp(self.decrement * periods);
        let (mut remaining, mut delay_ticks) = (1.0, 0.0);
        let mut kernel = Kernel::EMPTY;
        for weight in weights {
            kernel.push(weight * remaining, delay_ticks);
            remaining *= decay;
            delay_ticks += periods * self.damped_period_ticks;
        }
        kernel
    }

    /// EI with the published polynomials in tolerance and damping.
    #[cold]
    #[inline(never)]
    fn fitted_ei(&self) -> Kernel {
        let (v, damping, period) = (TOLERANCE, self.damping, self.damped_period_ticks);
        let first = polynomial(&[0.24968 + 0.24961 * v, 0.80008 + 1.23328 * v, 0.49599 + 3.17316 * v, 0.0], damping);
        let last = polynomial(&[0.25149 + 0.21474 * v, -0.83249 + 1.41498 * v, 0.85181 - 4.90094 * v, 0.0], damping);
        let middle = [0.4999, (0.46159 + 8.57843 * v) * v, (4.26169 - 108.644 * v) * v, (1.75601 + 336.989 * v) * v];
        let mut kernel = Kernel::EMPTY;
        kernel.push(first, 0.0);
        kernel.push(1.0 - first - last, polynomial(&middle, damping) * period);
        kernel.push(last, period);
        kernel
    }

    #[cold]
    #[inline(never)]
    fn fitted(&self, parts: &[Fitted]) -> Kernel {
        let mut kernel = Kernel::EMPTY;
        for [weight, delay] in parts {
            let delay_ticks = polynomial(delay, self.damping) * self.undamped_period_ticks;
            kernel.push(polynomial(weight, self.damping), delay_ticks);
        }
        kernel
    }
}
