//! Steps at a constant acceleration: the inside of the hot loop (R1, R6).

use crate::real::Real;
use crate::square_root::square_root_f32;
use crate::time_units::FRACTION_BITS;

/// Squared speeds in steps^2/tick^2: at index k from the ramp's slow end, `slow + k * gain`. From
/// the slow end, where relative errors would hurt most.
#[derive(Clone, Copy, Debug)]
pub(super) struct AcceleratedSteps {
    pub(super) slow: f32,
    pub(super) gain: f32,
    /// Speed at the next step.
    pub(super) speed: f32,
    pub(super) index: u32,
    /// 1, or -1 as a wrapping number while slowing down.
    pub(super) direction: u32,
}

/// Time units in two ticks.
const UNITS_IN_TWO_TICKS: f32 = (2u32 << FRACTION_BITS) as f32;

/// Longest ramp for [`HotRamp`]: the numbers of its steps are exact in f32.
const MAX_HOT_STEPS: u32 = 1 << 24;

impl AcceleratedSteps {
    /// Advances to the next step; returns how long it takes, in time units: the nearest whole
    /// number, for cut ones would add up.
    #[inline(always)]
    pub(super) fn units(&mut self) -> u64 {
        self.index = self.index.wrapping_add(self.direction);
        let speed = square_root_f32(self.slow + self.index as f32 * self.gain);
        let units = UNITS_IN_TWO_TICKS / (self.speed + speed);
        self.speed = speed;
        whole_units(units + 0.5)
    }

    /// The steps in a form for a loop that keeps them in registers, and how many of `left`
    /// steps it may take.
    #[inline(always)]
    pub(super) fn hot(&self, left: u32) -> Option<(HotRamp, u32)> {
        let Self { slow, gain, speed, index, direction } = *self;
        if left == 0 || index >= MAX_HOT_STEPS {
            return None;
        }
        let (most, direction) =
            if direction == 1 { (MAX_HOT_STEPS - index, 1.0) } else { (index.saturating_add(1), -1.0) };
        let ramp = ferrostep_square_root::Ramp::new([index as f32, direction], speed, [slow, gain], UNITS_IN_TWO_TICKS);
        Some((HotRamp(ramp), most.min(left)))
    }

    /// Takes over the steps that such a loop has taken.
    #[inline(always)]
    pub(super) fn set_hot(&mut self, ramp: &HotRamp) {
        self.speed = ramp.0.speed;
        self.index = ramp.0.index as u32;
    }
}

/// Steps of a ramp that one loop takes in a row.
#[derive(Clone, Copy, Debug)]
pub(crate) struct HotRamp(ferrostep_square_root::Ramp);

impl HotRamp {
    /// Takes a step. Time units from it to the next one, cut to 32 bits; meaningless after a
    /// ramp's last step.
    #[inline(always)]
    pub(crate) fn take(&mut self) -> u32 {
        self.0.advance()
    }

    /// Result of the last [`Self::take`].
    #[inline(always)]
    pub(crate) fn short_units(&self) -> u32 {
        self.0.interval_and_half as u32
    }

    /// The interval in time units, not cut to 32 bits.
    #[inline(always)]
    pub(crate) fn units(&self) -> u64 {
        whole_units(self.0.interval_and_half)
    }
}

/// Half a time unit more than an interval, cut to a whole number.
#[inline(always)]
fn whole_units(units_and_half: f32) -> u64 {
    // One instruction, and enough for all but slow steps.
    let short = units_and_half as u32;
    if short < u32::MAX { u64::from(short) } else { units_and_half.to_u64() }
}
