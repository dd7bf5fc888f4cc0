//! The virtual board's probe with a pin, which a servo's pulses move in no time (BLTouch). It triggers as long as it touches: that its
//! signal is a short one is for the model of the virtual mainboard.

/// Half of the smallest distance between two widths, microseconds: any other width is ignored.
const TOLERANCE_US: u16 = 100;

/// Where the pin is, and what the signal says. It begins as it is switched on: in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct VirtualPin {
    is_out: bool,
    in_touch_mode: bool,
}

impl VirtualPin {
    /// Pulses of this width. Source of the widths: Klipper's `bltouch.py`.
    pub(crate) fn tell(&mut self, width_us: u16) {
        let is = |known: u16| width_us.abs_diff(known) <= TOLERANCE_US;
        match () {
            () if is(650) => *self = Self { is_out: true, in_touch_mode: false },
            () if is(1_165) => self.in_touch_mode = true,
            // In; a self-test ends with it, and so does an alarm.
            () if is(1_475) || is(1_780) || is(2_190) => *self = Self::default(),
            () => {}
        }
    }

    /// Whether its signal is high, where a pin that is out would touch the sheet.
    pub(crate) const fn is_triggered(self, touches: bool) -> bool {
        if self.in_touch_mode { !self.is_out || touches } else { self.is_out && touches }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pin_triggers_out_and_in_touch_mode() {
        let mut pin = VirtualPin::default();
        assert!(!pin.is_triggered(true), "it is in");
        pin.tell(1_165);
        assert!(pin.is_triggered(false));
        pin.tell(650);
        assert_eq!([false, true].map(|touches| pin.is_triggered(touches)), [false, true]);
        pin.tell(3_000);
        assert!(pin.is_triggered(true), "nothing that it knows");
        pin.tell(1_475);
        assert!(!pin.is_triggered(true));
    }
}
