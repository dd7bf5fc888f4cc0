//! The virtual board's probe with a pin, which a servo's pulses move in no time (BLTouch). It
//! triggers as long as it touches: that its signal is a short one is for the model of the
//! virtual mainboard.

use super::EndStopFailure;

/// Half of the smallest distance between two widths, microseconds: any other width is ignored.
const TOLERANCE_US: u16 = 100;

/// State of the pin and of its signal. It begins as the probe is switched on: pin in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct VirtualPin {
    is_out: bool,
    in_touch_mode: bool,
    /// It did not go where it was told to. The signal is high until touch mode or the release ends
    /// that; while it lasts, nothing else is obeyed.
    in_alarm: bool,
}

impl VirtualPin {
    /// Pulses of this width, for a pin with this failure. Source of the widths: Klipper's
    /// `bltouch.py`; of the alarm: the virtual mainboard's model.
    pub(crate) fn tell(&mut self, width_us: u16, failure: Option<EndStopFailure>) {
        let is = |known: u16| width_us.abs_diff(known) <= TOLERANCE_US;
        let is_release = is(2_190);
        // A self-test ends with the pin in.
        let goes_in = is(1_475) || is(1_780) || is_release;
        match () {
            () if is(1_165) => (self.in_touch_mode, self.in_alarm) = (true, false),
            () if self.in_alarm && !is_release => {}
            () if is(650) || goes_in => {
                let stays = match failure {
                    Some(EndStopFailure::PinStaysIn) => !goes_in && !self.is_out,
                    Some(EndStopFailure::PinStaysOut) => goes_in && self.is_out,
                    _ => false,
                };
                // The release draws in what it can, and does not look.
                *self = Self { is_out: stays != !goes_in, in_touch_mode: false, in_alarm: stays && !is_release };
            }
            () => {}
        }
    }

    /// True if its signal is high; `touches` says that a pin that is out would touch the sheet.
    pub(crate) const fn is_triggered(self, touches: bool) -> bool {
        self.in_alarm || if self.in_touch_mode { !self.is_out || touches } else { self.is_out && touches }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pin_triggers_out_and_in_touch_mode() {
        let mut pin = VirtualPin::default();
        let mut tell = |width_us| {
            pin.tell(width_us, None);
            pin
        };
        assert!(!VirtualPin::default().is_triggered(true), "it is in");
        assert!(tell(1_165).is_triggered(false));
        let out = tell(650);
        assert_eq!([false, true].map(|touches| out.is_triggered(touches)), [false, true]);
        assert!(tell(3_000).is_triggered(true), "nothing that it knows");
        assert!(!tell(1_475).is_triggered(true));
    }

    #[test]
    fn a_pin_that_does_not_move_raises_the_alarm() {
        for (failure, moves_us, fails_us) in
            [(EndStopFailure::PinStaysIn, 1_475, 650), (EndStopFailure::PinStaysOut, 650, 1_475)]
        {
            let mut pin = VirtualPin::default();
            pin.tell(moves_us, Some(failure));
            assert!(!pin.is_triggered(false), "{failure:?}");
            pin.tell(fails_us, Some(failure));
            assert!(pin.is_triggered(false), "{failure:?}");
            pin.tell(moves_us, Some(failure));
            assert!(pin.is_triggered(false), "{failure:?}: an alarm lasts");
            pin.tell(2_190, Some(failure));
            assert!(!pin.is_triggered(false), "{failure:?}: the release ends it");
            pin.tell(fails_us, Some(failure));
            assert!(pin.is_triggered(false), "{failure:?}: and the next command raises it again");
            pin.tell(2_190, None);
            pin.tell(fails_us, None);
            assert!(!pin.is_triggered(false), "{failure:?}: mended");
        }
    }
}
