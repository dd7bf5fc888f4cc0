//! The last thing that an interrupt's handler does.

/// Waits until the handler's stores have arrived. To be called after the last store
/// to a peripheral.
///
/// A store with an immediate offset that still waits on a slow bus while the handler returns can
/// make a Cortex-M4 take the wrong interrupt, at the priority of another (erratum 838869; ES0182
/// 2.1.3, ES0298 2.1.3). Handlers that pop registers at their end do not meet it, for those loads
/// follow the store on the same bus; but what a handler pops is the compiler's choice. The barrier
/// costs the few cycles that the store takes.
///
/// `tests/outside/tests/firmware/handlers.rs` checks it in the images.
#[inline(always)]
pub fn complete_stores() {
    cortex_m::asm::dsb();
}
