//! The clocks that follow from the crystal: the highest frequency at which USB and the motion
//! clock are exact.
//!
//! USB wants 48 MHz and the planner counts ticks of 84 MHz, so both must come out without a
//! remainder; a crystal that cannot do that is refused. The timers count at the slow bus's
//! frequency, twice that where it is divided (RM0090 7.2, RM0390 6.2). 84 MHz is what they
//! have at 168 MHz. An STM32F446 could run at 180 MHz, USB from its second PLL, but its timers
//! would then count at 90 MHz or 180 MHz, from which 84 MHz cannot be derived: exact ticks are
//! worth 7 % of the core's speed. So all three chips run at 168 MHz, without over-drive and
//! without the second PLL.

use ferrostep_planner::TICKS_PER_SECOND;

use crate::chip::Chip;

/// Clock frequency of USB, Hz.
pub const USB_HZ: u32 = 48_000_000;

/// Frequency of the internal oscillator, Hz.
pub const INTERNAL_HZ: u32 = 16_000_000;

/// Frequencies that a crystal may have, MHz: those for which this search and the one of
/// stm32f4xx-hal find the same numbers of the PLL. The HAL stores its own numbers when it takes the
/// clock over (`hal-shim/stm32f4-board/src/clock.rs`), and they must change nothing.
pub const CRYSTALS_MHZ: [u32; 4] = [8, 12, 16, 25];

/// Input of the PLL after its divider M, Hz (RM0090 7.3.2, RM0390 6.3.2: nearest to 2 MHz has
/// the least jitter).
pub const PLL_INPUT_HZ: std::ops::RangeInclusive<u32> = 1_000_000..=2_000_000;

/// The PLL's output, Hz (as above).
pub const PLL_OUTPUT_HZ: std::ops::RangeInclusive<u32> = 100_000_000..=432_000_000;

/// Numbers of the PLL (as above): input divided by M, multiplied by N; the core
/// divides by P, USB by Q.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pll {
    /// 2 to 63.
    pub m: u32,
    /// 50 to 432.
    pub n: u32,
    /// 2, 4, 6 or 8.
    pub p: u32,
    /// 2 to 15.
    pub q: u32,
}

impl Pll {
    /// The word of RCC_PLLCFGR. Bits 28 to 30 are the divider R of an STM32F446, which must not be
    /// 0, and elsewhere reserved: their value after reset is 2.
    pub const fn register(self, is_from_crystal: bool) -> u32 {
        let source = (is_from_crystal as u32) << 22;
        self.m | self.n << 6 | (self.p / 2 - 1) << 16 | source | self.q << 24 | 2 << 28
    }
}

/// A clock: its frequencies, and the numbers of the PLL and dividers that give them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Clock {
    /// The PLL.
    pub pll: Pll,
    /// Frequency of the core, Hz.
    pub core_hz: u32,
    /// The slow bus's divider: 1, 2, 4, 8 or 16.
    pub apb1_divider: u32,
    /// The fast bus's divider.
    pub apb2_divider: u32,
    /// Frequency of the timers on the slow bus, which count the motion clock's ticks, Hz.
    pub timer_hz: u32,
    /// Wait states of the flash at 2.7 V to 3.6 V: one more for every 30 MHz (RM0090 table 10,
    /// RM0390 table 5).
    pub flash_wait_states: u32,
}

impl Clock {
    /// The best clock of a chip with an oscillator of `oscillator_hz`; `None` if USB and ticks
    /// cannot both be exact.
    pub fn of(oscillator_hz: u32, chip: Chip) -> Option<Self> {
        let mut best: Option<(u32, u32, Self)> = None;
        for m in 2..=63 {
            if !within(&PLL_INPUT_HZ, oscillator_hz, m) {
                continue;
            }
            for n in 50..=432 {
                let product = u64::from(oscillator_hz) * n;
                let pll_hz = product / u64::from(m);
                let is_whole = product.is_multiple_of(u64::from(m));
                let Some(pll_hz) = u32::try_from(pll_hz).ok().filter(|hz| is_whole && PLL_OUTPUT_HZ.contains(hz))
                else {
                    continue;
                };
                let Some(q) = (2..=15).find(|q| pll_hz == USB_HZ * q) else { continue };
                for p in [2, 4, 6, 8] {
                    let Some(clock) = Self::with(Pll { m, n: n as u32, p, q }, pll_hz, chip) else { continue };
                    // M divides the input: the smaller M, the higher the input.
                    let rank = (clock.core_hz, 64 - m, clock);
                    if best.is_none_or(|(core_hz, input, _)| (core_hz, input) < (rank.0, rank.1)) {
                        best = Some(rank);
                    }
                }
            }
        }
        best.map(|(_, _, clock)| clock)
    }

    /// The clock with this PLL, if all is within its limits and ticks are exact.
    fn with(pll: Pll, pll_hz: u32, chip: Chip) -> Option<Self> {
        let core_hz = pll_hz / pll.p;
        let divider = |max_hz| [1, 2, 4, 8, 16].into_iter().find(|divider| core_hz / divider <= max_hz);
        let (apb1_divider, apb2_divider) = (divider(chip.max_apb1_hz)?, divider(chip.max_apb2_hz)?);
        let timer_hz = if apb1_divider == 1 { core_hz } else { core_hz / apb1_divider * 2 };
        let is_exact = pll_hz.is_multiple_of(pll.p) && core_hz.is_multiple_of(apb1_divider);
        let fits = core_hz <= chip.max_core_hz && is_exact && timer_hz == TICKS_PER_SECOND;
        let flash_wait_states = (core_hz - 1) / 30_000_000;
        fits.then_some(Self { pll, core_hz, apb1_divider, apb2_divider, timer_hz, flash_wait_states })
    }

    /// Frequency of the slow bus, Hz.
    pub const fn apb1_hz(&self) -> u32 {
        self.core_hz / self.apb1_divider
    }

    /// Frequency of the fast bus, which the host's line counts, Hz.
    pub const fn apb2_hz(&self) -> u32 {
        self.core_hz / self.apb2_divider
    }

    /// Returns the code of RCC_CFGR for a bus's divider.
    pub const fn divider_code(divider: u32) -> u32 {
        // 0xx: not divided; 100: by 2; 101: by 4 ...
        match divider {
            1 => 0,
            _ => 0b011 + divider.ilog2(),
        }
    }
}

/// Returns true if `hz / divisor` is within the range.
fn within(range: &std::ops::RangeInclusive<u32>, hz: u32, divisor: u32) -> bool {
    hz >= range.start() * divisor && hz <= range.end() * divisor
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The search of stm32f4xx-hal 0.23 (`rcc/f4/pll.rs`, `fast_setup`) for a core of
    /// `core_hz` and USB.
    fn found_by_the_hal(oscillator_hz: u32, core_hz: u32) -> Pll {
        let p = 8.min((432_000_000 / core_hz) & !1);
        let m = (oscillator_hz.div_ceil(2_000_000)..=oscillator_hz / 1_000_000)
            .min_by_key(|m| USB_HZ - oscillator_hz / m * (USB_HZ / (oscillator_hz / m)))
            .unwrap();
        let input_hz = oscillator_hz / m;
        let q = (4..=9)
            .min_by_key(|q| {
                let n = USB_HZ * q / input_hz;
                (USB_HZ - input_hz * n / q, core_hz.abs_diff(input_hz * n / p))
            })
            .unwrap();
        let n = USB_HZ * q / input_hz;
        Pll { m, n, p, q: (input_hz * n).div_ceil(USB_HZ) }
    }

    /// The HAL takes the clock over when it runs, and stores its PLL's numbers once more. They are
    /// the same with the crystals that a board may have, and with the internal oscillator.
    #[test]
    fn the_hal_finds_the_same_pll() {
        for chip in chips() {
            for oscillator_mhz in 4..=26 {
                let oscillator_hz = oscillator_mhz * 1_000_000;
                let Some(clock) = Clock::of(oscillator_hz, chip) else { continue };
                let found = found_by_the_hal(oscillator_hz, clock.core_hz);
                let may_be_used = CRYSTALS_MHZ.contains(&oscillator_mhz) || oscillator_hz == INTERNAL_HZ;
                assert!(found == clock.pll || !may_be_used, "{oscillator_mhz} MHz: {found:?}, {:?}", clock.pll);
                let pll_hz = oscillator_hz / found.m * found.n;
                assert_eq!((pll_hz / found.p, pll_hz / found.q), (clock.core_hz, USB_HZ), "{oscillator_mhz} MHz");
            }
        }
    }

    fn chips() -> impl Iterator<Item = Chip> {
        Chip::ALL.into_iter()
    }

    #[test]
    fn usual_crystals_give_168_mhz() {
        for chip in chips() {
            for crystal_mhz in [4, 6, 8, 12, 16, 24, 25] {
                let clock = Clock::of(crystal_mhz * 1_000_000, chip).unwrap();
                assert_eq!(clock.core_hz, 168_000_000);
                assert_eq!((clock.apb1_divider, clock.apb2_divider), (4, 2));
                assert_eq!((clock.timer_hz, clock.flash_wait_states, clock.apb2_hz()), (84_000_000, 5, 84_000_000));
            }
        }
        let chip = Chip::ALL[1];
        assert_eq!(Clock::of(12_000_000, chip).unwrap().pll, Pll { m: 6, n: 168, p: 2, q: 7 });
        assert_eq!(Clock::of(25_000_000, chip).unwrap().pll, Pll { m: 25, n: 336, p: 2, q: 7 });
    }

    #[test]
    fn the_register_has_the_fields_of_the_manual() {
        // RM0090 7.3.2: M in bits 0 to 5, N 6 to 14, P 16 and 17, source 22, Q 24 to 27; after
        // reset 0x24003010.
        assert_eq!(Pll { m: 16, n: 192, p: 2, q: 4 }.register(false), 0x2400_3010);
        assert_eq!(
            Pll { m: 8, n: 336, p: 4, q: 7 }.register(true),
            8 | 336 << 6 | 1 << 16 | 1 << 22 | 7 << 24 | 2 << 28
        );
        let codes = [1, 2, 4, 8, 16].map(Clock::divider_code);
        assert_eq!(codes, [0, 0b100, 0b101, 0b110, 0b111]);
    }

    proptest! {
        #[test]
        fn every_crystal_is_exact_and_within_the_limits_or_refused(
            hz in prop_oneof![
                (4_000_u32..=26_000).prop_map(|khz| khz * 1000),
                4_000_000_u32..=26_000_000,
                (40_u32..=260).prop_map(|tenths| tenths * 100_000),
            ],
        ) {
            for chip in chips() {
                // 48 MHz times Q and 84 MHz times two powers of two meet at 336 MHz only, within
                // the PLL's output.
                let can = (2..=63_u64).any(|m| {
                    let input = u64::from(hz);
                    input >= m * 1_000_000 && input <= m * 2_000_000 && (336_000_000 * m).is_multiple_of(input)
                });
                let Some(Clock { pll: Pll { m, n, p, q }, core_hz, apb1_divider, apb2_divider, timer_hz, flash_wait_states }) =
                    Clock::of(hz, chip)
                else {
                    prop_assert!(!can, "{hz} Hz is refused");
                    continue;
                };
                prop_assert!(can);
                prop_assert!((2..=63).contains(&m) && (50..=432).contains(&n) && (2..=15).contains(&q));
                prop_assert!([2, 4, 6, 8].contains(&p));
                let [hz, m, n, p, q] = [hz, m, n, p, q].map(u64::from);
                // Input, without a division: 1 to 2 MHz.
                prop_assert!(m * 1_000_000 <= hz && hz <= m * 2_000_000);
                prop_assert_eq!(hz * n, 48_000_000 * m * q);
                prop_assert_eq!(hz * n, u64::from(core_hz) * m * p);
                prop_assert!((100_000_000..=432_000_000).contains(&(u64::from(core_hz) * p)));
                prop_assert!(core_hz <= chip.max_core_hz);
                prop_assert!(core_hz / apb1_divider <= chip.max_apb1_hz && core_hz / apb2_divider <= chip.max_apb2_hz);
                prop_assert_eq!(timer_hz, 84_000_000);
                prop_assert_eq!(u64::from(timer_hz) * u64::from(apb1_divider), u64::from(core_hz) * 2);
                prop_assert!(core_hz <= 30_000_000 * (flash_wait_states + 1));
            }
        }
    }
}
