//! The last thing that an interrupt's handler does.

/// Waits until the handler's stores have arrived. To be called after the last store to a peripheral.
///
/// A store with an immediate offset that still waits on a slow bus while the handler returns can make a Cortex-M4 take the
/// wrong interrupt, at the priority of another (erratum 838869; ES0182 2.1.3, ES0298 2.1.3). Handlers that pop registers
/// at their end do not meet it, for those loads follow the store on the same bus; but what a handler pops is the compiler's
/// choice. The barrier costs the few cycles that the store takes.
///
/// The step interrupt has none, since every cycle counts there: `tests/tests/firmware/handlers.rs` checks that in the images each
/// of its paths ends with loads from the stack, which is at the same bus as its timer and ports.
#[inline(always)]
pub(crate) fn complete_stores() {
    cortex_m::asm::dsb();
}
