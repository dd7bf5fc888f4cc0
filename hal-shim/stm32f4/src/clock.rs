//! The system clock, with every wait bounded: a board with a broken crystal still prints, and says so.

use cortex_m::peripheral::SCB;
use cortex_m::peripheral::scb::SystemHandler;
use stm32f4xx_hal::pac::{FLASH, RCC};

use ferrostep_planner::TICKS_PER_SECOND;

/// Most looks at a ready flag. A crystal takes 2 ms, a PLL 0.2 ms; a look takes at least four cycles of 16 MHz, so this
/// waits for 12 ms or longer.
const MOST_LOOKS: u32 = 50_000;

/// Frequency of the internal oscillator, Hz.
const INTERNAL_HZ: u32 = 16_000_000;

/// Frequency of the core with the PLL, Hz.
const FULL_HZ: u32 = 168_000_000;

/// Where the clock comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClockSource {
    /// The crystal, multiplied by the PLL.
    Crystal,
    /// The internal oscillator (1 % accurate), multiplied by the PLL: the crystal did not start.
    InternalWithPll,
    /// The internal oscillator as it is: the PLL did not lock. All motion is slower.
    Internal,
}

/// The clock as it was set up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clock {
    /// Where it comes from.
    pub source: ClockSource,
    /// Frequency of the core and of its SysTick, Hz.
    pub core_hz: u32,
    /// Frequency of the timers on APB1, which count the ticks of the motion clock, Hz.
    pub timer_hz: u32,
    /// Frequency of the peripherals on APB2, USART1 among them, Hz.
    pub apb2_hz: u32,
}

impl Clock {
    /// By how much time is stretched against the nominal time base, in hundredths: 100 is not at all.
    pub const fn stretch_percent(&self) -> u32 {
        (TICKS_PER_SECOND as u64 * 100 / self.timer_hz as u64) as u32
    }
}

/// Starts the best clock there is: crystal (of `crystal_mhz`, 4 to 25), else internal oscillator, both with the PLL,
/// else the internal oscillator alone.
pub fn start(rcc: &RCC, flash: &FLASH, crystal_mhz: u8) -> Clock {
    rcc.cr().modify(|_, w| w.hseon().set_bit());
    let crystal = comes_true(|| rcc.cr().read().hserdy().bit_is_set());
    let full = |source| Clock { source, core_hz: FULL_HZ, timer_hz: FULL_HZ / 2, apb2_hz: FULL_HZ / 2 };
    if crystal && start_pll(rcc, flash, crystal_mhz, true) {
        return full(ClockSource::Crystal);
    }
    if !crystal {
        rcc.cr().modify(|_, w| w.hseon().clear_bit());
    }
    if start_pll(rcc, flash, (INTERNAL_HZ / 1_000_000) as u8, false) {
        return full(ClockSource::InternalWithPll);
    }
    Clock { source: ClockSource::Internal, core_hz: INTERNAL_HZ, timer_hz: INTERNAL_HZ, apb2_hz: INTERNAL_HZ }
}

/// Multiplies an oscillator to [`FULL_HZ`] and switches over to it; `false` if the PLL does not lock, and then nothing
/// has been switched.
fn start_pll(rcc: &RCC, flash: &FLASH, oscillator_mhz: u8, from_crystal: bool) -> bool {
    rcc.cr().modify(|_, w| w.pllon().clear_bit());
    // 1 MHz x 336 / 2 = 168 MHz; / 7 = 48 MHz for USB.
    let (divider, multiplier, half_divider_code, usb_divider) = (u32::from(oscillator_mhz), 336, 0, 7);
    let source = u32::from(from_crystal) << 22;
    // SAFETY: the register has no reserved combination among these; RM0090 6.3.2: M 2 to 63, N 50 to 432, P 2, Q 7.
    rcc.pllcfgr()
        .write(|w| unsafe { w.bits(divider | multiplier << 6 | half_divider_code << 16 | source | usb_divider << 24) });
    rcc.cr().modify(|_, w| w.pllon().set_bit());
    if !comes_true(|| rcc.cr().read().pllrdy().bit_is_set()) {
        rcc.cr().modify(|_, w| w.pllon().clear_bit());
        return false;
    }
    // Five wait states at 168 MHz and 3.3 V, before the core speeds up (RM0090 3.5.1); caches hide most of them.
    // SAFETY: five is a latency this chip has.
    flash.acr().modify(|_, w| unsafe { w.latency().bits(5) }.prften().set_bit().icen().set_bit().dcen().set_bit());
    // SAFETY: APB1 / 4 = 42 MHz (timers: twice that), APB2 / 2 = 84 MHz, the highest each bus may have; SW = PLL.
    rcc.cfgr().modify(|_, w| unsafe { w.ppre1().bits(0b101).ppre2().bits(0b100).sw().bits(0b10) });
    let switched = comes_true(|| rcc.cfgr().read().sws().bits() == 0b10);
    if !switched {
        // SAFETY: all dividers off, SW = internal oscillator: the state after reset.
        rcc.cfgr().modify(|_, w| unsafe { w.ppre1().bits(0).ppre2().bits(0).sw().bits(0) });
    }
    switched
}

/// Gives SysTick, the timer of the waits, a priority from 1 to 16 in RTIC's sense. After reset it has the highest, and
/// the step interrupt would have to wait for it.
pub fn set_systick_priority(scb: &mut SCB, priority: u8) {
    // Four bits of priority, in the upper half of the byte, 0 the highest.
    let hardware = (16 - priority.clamp(1, 16)) << 4;
    // SAFETY: called in `init`, before any task or critical section by priority exists.
    unsafe { scb.set_priority(SystemHandler::SysTick, hardware) };
}

/// Whether a flag comes up within [`MOST_LOOKS`].
fn comes_true(mut flag: impl FnMut() -> bool) -> bool {
    (0..MOST_LOOKS).any(|_| flag())
}
