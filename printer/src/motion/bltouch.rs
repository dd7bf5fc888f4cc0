//! The pin of a probe while Z seeks the bed.
//!
//! The width of a servo's pulses is a BLTouch's command. Klipper and Marlin know the widths from
//! its maker's manual, and make the same checks (`klippy/extras/bltouch.py`,
//! `Marlin/src/feature/bltouch.cpp`). Its signal is high
//!
//! - for about 10 ms when the pin that is out is pushed in: the probe draws it in then;
//! - in touch mode, as long as the pin is in;
//! - in alarm, which comes when the pin does not follow its command, or stays on the bed, and which
//!   the release ends.
//!
//! While X and Y move for homing or probing the pin is in, and was seen to be.

use ferrostep_gcode::PinCommand;
use ferrostep_hal_shim::ServoPulses;

use crate::error::CommandError;
use crate::motion::homing::Homing;
use crate::part::Part;
use crate::ports::Motion;
use crate::settings::profile::homing::{BlTouch, HomeSensor};

/// The axis that the probe homes.
const Z: usize = 2;

/// Attempts before a pin counts as failed; the second begins with a release of the alarm.
const ATTEMPTS: u32 = 2;

/// The signal lasts for this in touch mode, and to release the alarm, ms: Klipper's times.
const TOUCH_MODE_MS: u16 = 100;
const RELEASE_MS: u16 = 1_000;

/// Text for a person on a pin with the wrong signal after pulses of this width.
const fn failure(width_us: u16) -> &'static str {
    match width_us {
        PinCommand::TOUCH_MODE_US => {
            "the probe does not trigger in touch mode (M119): are both its plugs in? If it has no such mode, set bltouch.test_signal = false"
        }
        PinCommand::OUT_US => "the probe's pin does not go out (M119): is it stuck or bent, is the nozzle too low?",
        _ => "the probe's pin does not go in, it is triggered (M119): is it stuck or bent, is its sensor's plug in?",
    }
}

impl BlTouch {
    /// Pulses that draw the pin in.
    pub const fn pulses_in(&self) -> ServoPulses {
        ServoPulses::lasting_ms(PinCommand::IN_US, self.move_ms)
    }
}

impl<M: Motion> Homing<'_, '_, M> {
    /// The pin of the probe that an axis homes with, if it has one.
    pub(crate) fn pin(&self, axis: usize) -> Option<BlTouch> {
        let is_probe = axis == Z && self.interpreter.profile.homing[Z].sensor == HomeSensor::Probe;
        self.interpreter.profile.bltouch.filter(|_| M::Servo::PRESENT && is_probe)
    }

    /// The pin, if it may be out.
    pub(crate) fn pin_out(&self) -> Option<BlTouch> {
        self.pin(Z).filter(|_| !self.interpreter.modal.z.pin_is_in)
    }

    /// Sends a command to the pin, and checks its signal. If the signal is wrong the
    /// pin is called in.
    ///
    /// The pin must be in before it goes out, and the signal must follow it.
    pub(crate) async fn tell_pin(&mut self, pin: BlTouch, command: PinCommand) -> Result<(), CommandError> {
        let goes_out = command == PinCommand::Out;
        let other_us = if let PinCommand::Pulses { width_us } = command { width_us } else { 0 };
        self.interpreter.modal.z.pin_is_in &= goes_out;
        let mut why = "";
        'attempts: for attempt in 0..ATTEMPTS {
            let widths_us =
                [PinCommand::RELEASE_US, PinCommand::IN_US, PinCommand::TOUCH_MODE_US, PinCommand::OUT_US, other_us];
            for (step, width_us) in widths_us.into_iter().enumerate() {
                let is_in = self.interpreter.modal.z.pin_is_in;
                let is_wanted = match step {
                    0 => attempt > 0,
                    1 => !is_in && other_us == 0,
                    2 => goes_out && pin.tests_signal,
                    3 => goes_out,
                    _ => other_us > 0,
                };
                if !is_wanted {
                    continue;
                }
                self.interpreter.modal.z.pin_is_in = is_in && step == 2;
                let lasting_ms = match step {
                    0 => RELEASE_MS,
                    2 => TOUCH_MODE_MS,
                    _ => pin.move_ms,
                };
                self.motion.send_servo_pulses(ServoPulses::lasting_ms(width_us, lasting_ms));
                if let Err(stopped) = self.motion.servo_pulses_sent().await {
                    // A pin that a stop has interrupted goes in by itself.
                    self.motion.send_servo_pulses(pin.pulses_in());
                    return Err(stopped.into());
                }
                let is_checked = (1..=3).contains(&step);
                if is_checked && self.motion.is_end_stop_triggered(Z) != (step == 2) {
                    self.interpreter.modal.z.pin_is_in = false;
                    why = failure(width_us);
                    continue 'attempts;
                }
                self.interpreter.modal.z.pin_is_in |= step == 1;
            }
            return Ok(());
        }
        self.motion.send_servo_pulses(pin.pulses_in());
        Err(CommandError::ProbePin(why))
    }
}
