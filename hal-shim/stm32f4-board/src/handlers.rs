//! The final action of an interrupt handler.

/// Waits until the handler's stores have arrived. Call after the last store to a peripheral.
///
/// If a store with an immediate offset is still waiting on a slow bus while the handler returns, a
/// Cortex-M4 can take the wrong interrupt, at the priority of another (erratum 838869; ES0182
/// 2.1.3, ES0298 2.1.3). Handlers that pop registers at their end are not affected, because those
/// loads follow the store on the same bus; but what a handler pops is the compiler's choice. The
/// barrier costs the few cycles that the store takes.
///
/// `tests/outside/tests/firmware/handlers.rs` checks for it in the images.
#[inline(always)]
pub fn complete_stores() {
    cortex_m::asm::dsb();
}
