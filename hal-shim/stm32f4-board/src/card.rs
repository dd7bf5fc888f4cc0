//! The memory card slot, on the SDIO.

use ferrostep_stm32f4::clock_tree::{Clock, ClockSource};
use ferrostep_stm32f4::sdio::{BlockMemory, SdioSlot};

use crate::board::CARD_DETECT;
use crate::motion_clock::MotionClock;
use crate::pac::{SDIO, TIM5};
use crate::volatile::Volatile;

/// SDIO card slot of the board.
pub type Slot = SdioSlot<Volatile, fn() -> u32>;

/// Buffer for the blocks that DMA moves, in RAM that DMA can reach.
static MEMORY: BlockMemory = BlockMemory::new();

/// Current time of the motion clock, which measures the waits.
fn now_ticks() -> u32 {
    // SAFETY: the counter is only read; `start` is given the clock, so that it runs.
    unsafe { &*TIM5::ptr() }.cnt().read().bits()
}

/// Switches the slot on; `None` without the PLL, whose 48 MHz the SDIO needs. After
/// [`BoardPins::new`](crate::board::BoardPins::new) and the start of the thermistors' converter,
/// which has DMA2's stream 0.
pub fn start(_: SDIO, clock: &Clock, _: MotionClock) -> Option<Slot> {
    if clock.source == ClockSource::Internal {
        return None;
    }
    // SAFETY: the SDIO was given up to this; of DMA2 it has stream 3 and the flags of that alone,
    // which are cleared by writing ones. The pin of the slot is the only part of the ports that it
    // reads. Clocks are switched on before any task runs.
    let registers = unsafe { Volatile::new() };
    // Addresses have 32 bits here.
    let address = MEMORY.0.as_ptr() as u32;
    Some(SdioSlot::new(registers, now_ticks, &MEMORY, address, CARD_DETECT))
}
