//! Run-time replacement of an interrupt handler.
//!
//! The core finds its handlers in a table, at the address in VTOR (PM0214, 4.4.4). The image's
//! table is in flash. While a handler is replaced, a copy in RAM takes its place; so the
//! interrupt's own code needs no flag to test, and costs nothing extra without a replacement.

use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::asm::{dsb, isb};
use cortex_m::peripheral::SCB;

use crate::pac::Interrupt;

/// Entries before the first interrupt: the initial stack pointer and 15 exceptions.
const EXCEPTIONS: usize = 16;

/// The last interrupt that the chip has: the floating-point unit's (RM0090, table 61) ...
#[cfg(not(feature = "stm32f446"))]
const LAST: Interrupt = Interrupt::FPU;
/// ... or the second of the fast-mode I2C (RM0390, table 38).
#[cfg(feature = "stm32f446")]
const LAST: Interrupt = Interrupt::FMPI2C1_ERROR;

/// Number of all entries.
const ENTRIES: usize = EXCEPTIONS + LAST as usize + 1;

/// A handler, as the core calls it.
pub type Handler = unsafe extern "C" fn();

/// Copy of the table. VTOR requires it to be aligned to its size, rounded up to a power of two.
#[repr(C, align(512))]
struct Table([AtomicU32; ENTRIES]);

const _: () = assert!(size_of::<Table>() == 512, "the alignment is less than the table");

static COPY: Table = Table([const { AtomicU32::new(0) }; ENTRIES]);

unsafe extern "C" {
    /// The image's table, placed by cortex-m-rt's linker script. An entry that the chip does not
    /// have is 0; the first is the stack pointer, which only the core uses.
    static __vector_table: [Option<Handler>; ENTRIES];
}

/// The image's handler for an interrupt.
#[inline(always)]
pub fn original(interrupt: Interrupt) -> Option<Handler> {
    // SAFETY: the table is in flash, as long as said, and never written; `None` is what a word of 0
    // means for such a type, and any other word is a handler (or the stack pointer, which no
    // interrupt's number leads to).
    unsafe { __vector_table.get(EXCEPTIONS.wrapping_add(interrupt as usize)).copied().flatten() }
}

/// The core's vector table register.
pub struct VectorTable {
    scb: SCB,
    /// Address of the image's table, which cortex-m-rt has set, overriding a boot loader's.
    of_image: u32,
}

impl VectorTable {
    /// Takes ownership of VTOR.
    pub fn new(scb: SCB) -> Self {
        let of_image = scb.vtor.read();
        Self { scb, of_image }
    }

    /// Makes the core call `handler` at an interrupt from now on. Replaces at most one handler; the
    /// last call counts.
    ///
    /// # Safety
    /// `handler` must be sound to run at any moment at which the interrupt may come, at its
    /// priority, and must do everything that the replaced handler is relied on for.
    pub unsafe fn replace(&mut self, interrupt: Interrupt, handler: Handler) {
        // SAFETY: as in `original`; read as words, each of which is valid.
        let image = unsafe { &*(&raw const __vector_table).cast::<[u32; ENTRIES]>() };
        for (entry, (copy, &word)) in COPY.0.iter().zip(image).enumerate() {
            let is_replaced = entry == EXCEPTIONS.wrapping_add(interrupt as usize);
            // Addresses have 32 bits on this target; bit 0 marks Thumb code and is set for every
            // function.
            copy.store(if is_replaced { handler as usize as u32 } else { word }, Ordering::Relaxed);
        }
        self.point_to((&raw const COPY) as usize as u32);
    }

    /// Restores the image's own handlers.
    pub fn restore(&mut self) {
        self.point_to(self.of_image);
    }

    fn point_to(&mut self, table: u32) {
        // The copy must be complete before the core may read it; the next interrupt uses the new
        // table.
        dsb();
        // SAFETY: a table of handlers, aligned as it has to be: either the image's or the copy,
        // complete by now.
        unsafe { self.scb.vtor.write(table) };
        dsb();
        isb();
    }
}
