//! The two step counts that all decisions of a line depend on.

/// Largest step count either axis of a line may have; keeps every decision value in 32 bits.
pub const MAX_STEPS: u32 = 1 << 28;

/// Reason why a line is impossible.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineError {
    /// An axis would make more than [`MAX_STEPS`] steps.
    TooLong,
    /// The minor axis would make more steps than the major one.
    TooSteep,
}

impl core::fmt::Display for LineError {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::TooLong => write!(out, "a line has at most {MAX_STEPS} steps an axis"),
            Self::TooSteep => out.write_str("the minor axis makes at most as many steps as the major one"),
        }
    }
}

impl core::error::Error for LineError {}

/// Steps of the major axis, and the number of them that the minor axis joins.
///
/// Arithmetic with them wraps in name only: from 0 to 2^28, no product here reaches 2^31.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slope {
    major: i32,
    minor: i32,
}

impl Slope {
    /// `minor <= major <=` [`MAX_STEPS`] steps; both may be 0.
    ///
    /// # Errors
    /// The counts exceed this range.
    #[inline]
    pub const fn new(major: u32, minor: u32) -> Result<Self, LineError> {
        if major > MAX_STEPS || minor > MAX_STEPS {
            return Err(LineError::TooLong);
        }
        if minor > major {
            return Err(LineError::TooSteep);
        }
        Ok(Self { major: major as i32, minor: minor as i32 })
    }

    /// Steps of the major axis.
    #[inline]
    pub const fn major(self) -> u32 {
        self.major as u32
    }

    /// Steps of the minor axis.
    #[inline]
    pub const fn minor(self) -> u32 {
        self.minor as u32
    }

    /// dx.
    #[inline(always)]
    pub const fn dx(self) -> i32 {
        self.major
    }

    /// dy.
    #[inline(always)]
    pub const fn dy(self) -> i32 {
        self.minor
    }

    /// True if the minor axis joins more than half of the major axis's steps. Stairs are then runs
    /// of steps of both axes, each ended by one of the major axis alone.
    #[inline(always)]
    pub const fn is_steep(self) -> bool {
        self.minor > self.major.wrapping_sub(self.minor)
    }

    /// Number of steps of the rarer kind: the line's stairs are those of a slope of at most 1/2.
    #[inline(always)]
    pub const fn rarer(self) -> i32 {
        if self.is_steep() { self.major.wrapping_sub(self.minor) } else { self.minor }
    }

    /// First decision value of stairs, before the first step.
    ///
    /// Classic Bresenham steps the minor axis where d > 0. In the complement, whose steps are those
    /// that the minor axis does not join, all decision values are negated: with dy' = dx - dy, d'_1
    /// = 2 dy' - dx = -(2 dy - dx) = -d_1, and both sums change by opposite amounts. It steps where
    /// d <= 0, which is d' >= 0, in integers d' + 1 > 0: the complement's decision values are 1
    /// more.
    #[inline(always)]
    pub const fn start(self) -> i32 {
        if self.is_steep() { 1i32.wrapping_sub(self.major) } else { self.major.wrapping_neg() }
    }
}
