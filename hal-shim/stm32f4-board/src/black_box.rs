//! Memory for the black box's records: the chip's backup SRAM.

use ferrostep_black_box::RecordMemory;
use ferrostep_stm32f4::backup_memory::{self, BACKUP_MEMORY};

use crate::Rcc;
use crate::volatile::Volatile;

/// Switches the memory on. Call once, after the clock was started.
pub fn start(_rcc: &Rcc) -> &'static RecordMemory {
    // SAFETY: registers of the RCC, which is the caller's, and of the power control, which
    // no task writes to.
    backup_memory::start(&mut unsafe { Volatile::new() });
    const { assert!(size_of::<RecordMemory>() == 4096) };
    // SAFETY: 4 KiB of memory that is used here alone, of atomics only, for which every value is
    // valid. On a chip without this memory, as in an emulator, loads give other values than the
    // stored ones, which `RecordMemory::restart` notices.
    unsafe { &*(BACKUP_MEMORY as *const RecordMemory) }
}
