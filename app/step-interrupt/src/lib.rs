//! The step interrupt of an image: its queue, its timer, and the two handlers.
//!
//! A separate package, because a generic function is compiled as the package that names its types:
//! the rest of the application is optimised for flash size, this package for speed. RTIC has no
//! task here. Both handlers have the core's highest priority, which BASEPRI cannot mask, so RTIC
//! has nothing to guard.
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

/// Number of slots in the step queue: with one port about as many as the desktop tool has entries,
/// 32 KiB. Each further port adds two words to a slot; half as many slots still last for several of
/// the planner's intervals.
pub const STEP_QUEUE_SLOTS: usize = if MOTOR_PORTS == 1 { 2048 } else { 1024 };

/// The step queue and the state of the step interrupt. Neither a reset nor program start fills this
/// memory, so that the black box can read the last steps of the previous program; therefore
/// [`StepPlayer::restart`] must be called first.
#[unsafe(link_section = ".uninit.steps")]
pub static STEPS: StepPlayer<StepSignals, MOTOR_PORTS, STEP_QUEUE_SLOTS> = StepPlayer::new();

/// The step interrupt of this board.
pub type BoardStepTimer = StepTimer<StepSignals, MOTOR_PORTS, STEP_QUEUE_SLOTS>;

/// The core's highest priority: RTIC's 16.
const HIGHEST: u8 = 0;

/// Storage of the step timer, which both handlers use. They have the same priority, so that neither
/// interrupts the other.
struct Place(UnsafeCell<MaybeUninit<BoardStepTimer>>);

// SAFETY: `start` writes it before the handlers may run; from then on only the handlers use it,
// never at the same time.
unsafe impl Sync for Place {}

static TIMER: Place = Place(UnsafeCell::new(MaybeUninit::uninit()));

/// Gives the handlers their timer, which [`StepTimer::start`] has started, and unmasks their
/// interrupts. Call once, while the application is initialised.
pub fn start(timer: BoardStepTimer, controller: &mut NVIC) {
    // SAFETY: neither handler can run yet: the core does not call them before the unmasking below.
    unsafe { &mut *TIMER.0.get() }.write(timer);
    for interrupt in [Interrupt::TIM1_BRK_TIM9, Interrupt::TIM2] {
        // SAFETY: no critical section keeps these handlers out, and they share no guarded data.
        unsafe {
            controller.set_priority(interrupt, HIGHEST);
            NVIC::unmask(interrupt);
        }
    }
}

/// Takes slots and sets pins. A late event delays its own edge, never the next one.
///
/// # Safety
/// For the vector table, and for the handler that replaces it there to measure it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn TIM2() {
    // SAFETY: called after `start` only, and not at the same time as the other handler.
    unsafe { (*TIMER.0.get()).assume_init_mut() }.update();
    complete_stores();
}

/// Handles the start and the end of a motion, and an event that is still owed.
///
/// # Safety
/// For the vector table.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn TIM1_BRK_TIM9() {
    // SAFETY: as for `TIM2`.
    unsafe { (*TIMER.0.get()).assume_init_mut() }.start_or_end();
    complete_stores();
}
