//! The interrupts of the tests: RTIC has its own start-up, and so has the test harness, so these
//! are plain handlers.

use core::cell::UnsafeCell;

use cortex_m::peripheral::NVIC;
use ferrostep_bench::queue::SHORT_QUEUE_SLOTS;
use ferrostep_profile_constant::StepSignals;
use ferrostep_step_player::{BothEdges, Pulses};
use ferrostep_stm32f4_board::board::MOTOR_PORTS;
use ferrostep_stm32f4_board::pac::Interrupt;
use ferrostep_stm32f4_board::step_timer::StepTimer;
use ferrostep_stm32f4_usb::Usb;

/// Slots of the queue of the steps whose time is taken: 10 ms of them at 100,000 a second.
pub const TIMED_QUEUE_SLOTS: usize = 256;

/// Urgency of the step interrupts, in the NVIC's sense: above all that BASEPRI masks.
const STEPS_PRIORITY: u8 = 0;

/// Urgency of the USB port's interrupt, as RTIC's 10 in the firmware.
const USB_PRIORITY: u8 = (16 - 10) << 4;

/// Data of an interrupt's handler.
pub struct Handler<T>(UnsafeCell<Option<T>>);

// SAFETY: it is written before its interrupt is unmasked, and from then on only that
// interrupt uses it.
unsafe impl<T: Send> Sync for Handler<T> {}

impl<T> Handler<T> {
    const fn new() -> Self {
        Self(UnsafeCell::new(None))
    }

    /// Hands over the handler's data to its interrupt, and unmasks it.
    ///
    /// # Safety
    /// The interrupt is the one whose handler uses this, is masked, and its priority is not below
    /// that of critical sections that rely on it.
    unsafe fn begin(&self, value: T, interrupt: Interrupt, priority: u8, controller: &mut NVIC) {
        // SAFETY: no other reference exists while the interrupt is masked.
        unsafe { *self.0.get() = Some(value) };
        // SAFETY: by the contract above.
        unsafe {
            controller.set_priority(interrupt, priority);
            NVIC::unmask(interrupt);
        }
    }

    /// # Safety
    /// For the interrupt alone.
    unsafe fn with(&self, work: impl FnOnce(&mut T)) {
        // SAFETY: the interrupt does not interrupt itself, and no other code comes here.
        if let Some(value) = unsafe { &mut *self.0.get() } {
            work(value);
        }
    }
}

/// The step interrupt as the tests call it, of drivers that step at both edges.
static EDGES: Handler<StepTimer<BothEdges, 1, SHORT_QUEUE_SLOTS>> = Handler::new();
/// The step interrupt that the timer calls.
static STEPS: Handler<StepTimer<StepSignals, MOTOR_PORTS, TIMED_QUEUE_SLOTS>> = Handler::new();
/// The same in pulses, whatever the profile's drivers ask for.
static PULSES: Handler<StepTimer<Pulses, MOTOR_PORTS, TIMED_QUEUE_SLOTS>> = Handler::new();
static USB: Handler<&'static mut Usb> = Handler::new();

/// Lets [`Interrupt::SPI2`] play a queue, which is called when it is counted.
pub fn play_when_called(timer: StepTimer<BothEdges, 1, SHORT_QUEUE_SLOTS>, controller: &mut NVIC) {
    // SAFETY: reset has left it masked; no critical section is for it.
    unsafe { EDGES.begin(timer, Interrupt::SPI2, STEPS_PRIORITY, controller) };
}

/// Makes the step timer play a queue.
pub fn play(timer: StepTimer<StepSignals, MOTOR_PORTS, TIMED_QUEUE_SLOTS>, controller: &mut NVIC) {
    // SAFETY: as above. The second one is called by the first, of the same priority,
    // and uses the same.
    unsafe {
        STEPS.begin(timer, Interrupt::TIM2, STEPS_PRIORITY, controller);
        controller.set_priority(Interrupt::TIM1_BRK_TIM9, STEPS_PRIORITY);
        NVIC::unmask(Interrupt::TIM1_BRK_TIM9);
    }
}

/// Makes the step timer play a queue in pulses.
pub fn play_pulses(timer: StepTimer<Pulses, MOTOR_PORTS, TIMED_QUEUE_SLOTS>, controller: &mut NVIC) {
    // SAFETY: as for `play`; a test has one of the two.
    unsafe {
        PULSES.begin(timer, Interrupt::TIM2, STEPS_PRIORITY, controller);
        controller.set_priority(Interrupt::TIM1_BRK_TIM9, STEPS_PRIORITY);
        NVIC::unmask(Interrupt::TIM1_BRK_TIM9);
    }
}

/// Serves the USB port.
pub fn serve(usb: &'static mut Usb, controller: &mut NVIC) {
    // SAFETY: as above; it has nothing that a critical section is for.
    unsafe { USB.begin(usb, Interrupt::OTG_FS, USB_PRIORITY, controller) };
}

// SAFETY: the name of a vector; this is its handler.
#[unsafe(no_mangle)]
extern "C" fn SPI2() {
    // SAFETY: this is the interrupt.
    unsafe { EDGES.with(|timer| timer.update()) };
}

// SAFETY: as above.
#[unsafe(no_mangle)]
extern "C" fn TIM2() {
    // SAFETY: this is the interrupt.
    unsafe {
        STEPS.with(|timer| timer.update());
        PULSES.with(|timer| timer.update());
    }
}

// SAFETY: as above.
#[unsafe(no_mangle)]
extern "C" fn TIM1_BRK_TIM9() {
    // SAFETY: of the same priority as those whose timers these are, so that neither interrupts the
    // other. Only one is there.
    unsafe {
        STEPS.with(|timer| timer.start_or_end());
        PULSES.with(|timer| timer.start_or_end());
        EDGES.with(|timer| timer.start_or_end());
    }
}

// SAFETY: as above.
#[unsafe(no_mangle)]
extern "C" fn OTG_FS() {
    // SAFETY: this is the interrupt.
    unsafe {
        USB.with(|usb| {
            usb.serve();
        })
    };
}
