//! Servo signal for a probe with a pin: the task's side, and TIM6's interrupt.

use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::NVIC;
use ferrostep_hal_shim::ServoPulses;
use ferrostep_stm32f4::clock_tree::Clock;
use ferrostep_stm32f4::{ServoLine, servo_line};

use crate::board::SERVO;
use crate::handlers::complete_stores;
use crate::pac::{Interrupt, TIM6};
use crate::volatile::Volatile;

/// Pulses left to send ([`ServoPulses::word`]).
static PULSES: AtomicU32 = AtomicU32::new(0);

/// Pulse width that retracts a probe's pin, microseconds: `ferrostep_gcode::PinCommand::IN_US`,
/// which this crate cannot name.
pub const PIN_IN_US: u16 = 1_475;

/// The signal, owned by the task of its interrupt.
pub struct Servo(ServoLine<Volatile>);

impl Servo {
    /// The signal at rest.
    pub const REST: Self = {
        let pin = match SERVO {
            Some(pin) => pin,
            // A board without a servo never enables the interrupt.
            None => (0, 0),
        };
        // SAFETY: TIM6 is given up to `start`; of the ports it sets the board's servo pin
        // alone, by one store.
        Self(ServoLine::at(unsafe { Volatile::new() }, pin))
    };

    /// Handles the interrupt. If it runs late by a few microseconds, the pulse is longer or shorter
    /// by as much.
    #[inline]
    pub fn interrupt(&mut self) {
        self.0.interrupt(&PULSES);
        complete_stores();
    }
}

/// Sets the timer up.
pub fn start(_: TIM6, clock: &Clock) {
    // SAFETY: TIM6 was given up to this, before its interrupt is unmasked.
    servo_line::start(&mut unsafe { Volatile::new() }, clock.slow_timers.raw());
}

/// Sends pulses, from any task below the interrupt.
pub fn send(pulses: ServoPulses) {
    PULSES.store(pulses.word(), Ordering::Relaxed);
    NVIC::pend(Interrupt::TIM6_DAC);
}

/// Sends one pulse that retracts a probe's pin and waits out the pause after it, for the panic and
/// fault handlers, which nothing interrupts any more. `false` without a servo.
pub(crate) fn pin_in_at_the_end() -> bool {
    let Some(pin) = SERVO else { return false };
    // SAFETY: no other code runs any more.
    servo_line::send_one(&mut unsafe { Volatile::new() }, pin, PIN_IN_US);
    true
}

/// Returns true if all pulses have been sent.
pub fn are_sent() -> bool {
    PULSES.load(Ordering::Relaxed) == 0
}
