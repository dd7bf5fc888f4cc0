//! Pace of a bit-banged bus, by the core's cycles.

use ferrostep_stm32f4::BusPace;

use crate::board::CORE_HZ;

/// Half a clock period, ns; the surrounding stores lengthen it.
#[derive(Debug)]
pub struct CorePace<const HALF_PERIOD_NS: u32>;

impl<const HALF_PERIOD_NS: u32> CorePace<HALF_PERIOD_NS> {
    const CYCLES: u32 = (CORE_HZ / 1_000_000 * HALF_PERIOD_NS).div_ceil(1000);
}

impl<const HALF_PERIOD_NS: u32> BusPace for CorePace<HALF_PERIOD_NS> {
    const HALF_PERIOD_NS: u32 = HALF_PERIOD_NS;

    #[inline]
    fn half_period(&mut self) {
        cortex_m::asm::delay(Self::CYCLES);
    }
}
