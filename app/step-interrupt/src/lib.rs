//! The step interrupt of an image: its queue, its timer, and the two handlers.
//!
//! A separate package, because a generic function is compiled as the package that names its types:
//! the rest of the application is compiled for the least flash, and this for the fewest cycles.
//! RTIC has no task here. Both handlers have the core's highest priority, which BASEPRI cannot
//! mask, so there is nothing for RTIC to guard.
#![no_std]

use core::cell::UnsafeCell;
use core::mem::MaybeUninit;

use cortex_m::peripheral::NVIC;
use ferrostep_profile_constant::StepSignals;
use ferrostep_step_player::StepPlayer;
use ferrostep_stm32f4_board::board::MOTOR_PORTS;
use ferrostep_stm32f4_board::handlers::complete_stores;
use ferrostep_stm32f4_board::pac::Interrupt;
use ferrostep_stm32f4_board::step_timer::StepTimer;

/// Slots in the step queue: with one port about as many as entries on the desk, 32 KiB. With
/// each port more a slot has two words more, and half as many still last for several of the
/// planner's intervals.
pub const STEP_QUEUE_SLOTS: usize = if MOTOR_PORTS == 1 { 2048 } else { 1024 };

/// The step queue and the state of the step interrupt. No reset and no start of the program fills
/// this memory, so that the black box reads the last steps of the program before:
/// [`StepPlayer::restart`] comes before all else.
#[unsafe(link_section = ".uninit.steps")]
pub static STEPS: StepPlayer<StepSignals, MOTOR_PORTS, STEP_QUEUE_SLOTS> = StepPlayer::new();

/// The step interrupt of this board.
pub type BoardStepTimer = StepTimer<StepSignals, MOTOR_PORTS, STEP_QUEUE_SLOTS>;

/// The core's highest priority: RTIC's 16.
const HIGHEST: u8 = 0;

/// The step timer, which both handlers use. They have the same priority, so that neither
/// interrupts the other.
struct Place(UnsafeCell<MaybeUninit<BoardStepTimer>>);

// SAFETY: `start` writes it before the handlers may run, and from then on they alone use it, never
// at the same time.
unsafe impl Sync for Place {}

static TIMER: Place = Place(UnsafeCell::new(MaybeUninit::uninit()));

/// Gives the handlers their timer, which [`StepTimer::start`] has started, and lets the core call
/// them. To be called once, while the application is initialised.
pub fn start(timer: BoardStepTimer, controller: &mut NVIC) {
    // SAFETY: neither handler can run yet: the core does not call them before the unmasking below.
    unsafe { &mut *TIMER.0.get() }.write(timer);
    for interrupt in [Interrupt::TIM1_BRK_TIM9, Interrupt::TIM2] {
        // SAFETY: no critical section keeps these handlers out, nor do they share anything
        // that one guards.
        unsafe {
            controller.set_priority(interrupt, HIGHEST);
            NVIC::unmask(interrupt);
        }
    }
}

/// Takes slots, sets pins. A late event delays an edge, never the next one.
///
/// # Safety
/// For the vector table, and for the handler that replaces it there to measure it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn TIM2() {
    // SAFETY: called after `start` only, and not at the same time as the other handler.
    unsafe { (*TIMER.0.get()).assume_init_mut() }.update();
    complete_stores();
}

/// The start and the end of a motion, and an event that is owed.
///
/// # Safety
/// For the vector table.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn TIM1_BRK_TIM9() {
    // SAFETY: as for `TIM2`.
    unsafe { (*TIMER.0.get()).assume_init_mut() }.start_or_end();
    complete_stores();
}
