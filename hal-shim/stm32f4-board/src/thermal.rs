//! The board's heaters, thermistors and fans.

use core::sync::atomic::AtomicU16;

use ferrostep_stm32f4::clock_tree::Clock;
use ferrostep_stm32f4::{BoardHeaters, CONVERSIONS, PwmClocks};

use crate::board::{THERMAL, THERMISTORS};
use crate::pac::{ADC_COMMON, ADC1, ADC3, DMA2};
use crate::volatile::Volatile;

/// The board's heaters.
pub type Heaters = BoardHeaters<Volatile>;

/// Where DMA lays conversions: in RAM that it reaches.
static MEMORY: [AtomicU16; THERMISTORS * CONVERSIONS] = [const { AtomicU16::new(0) }; THERMISTORS * CONVERSIONS];

/// What measures.
pub type Converters = (ADC1, ADC3, ADC_COMMON, DMA2);

/// Starts converter and timers, all heaters and fans off; `None` on a board without heaters. After
/// [`BoardPins::new`](crate::board::BoardPins::new).
pub fn start(_converters: Converters, clock: &Clock) -> Option<Heaters> {
    let pins = THERMAL?;
    let clocks = PwmClocks { slow_hz: clock.slow_timers.raw(), fast_hz: clock.fast_timers.raw() };
    // SAFETY: the converters and the stream were given up to this. The timers are those that the board's file gives to
    // heaters and fans, which are none that the firmware uses otherwise (`boards/src/signals.rs`); their pins are
    // theirs alone. Clocks are switched on before any task runs. The panic and fault handlers take the pins away when
    // nothing else runs any more.
    let registers = unsafe { Volatile::new() };
    // Addresses have 32 bits here.
    let address = MEMORY.as_ptr() as u32;
    Some(BoardHeaters::start(&pins, &MEMORY, address, clocks, registers))
}
