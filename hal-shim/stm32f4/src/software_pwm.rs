//! Power by switching a pin in the tick of the heaters' control, where no timer reaches it.

/// Ticks of a period: at 10 ms a tick ten periods a second, as those of timers
/// ([`HEATER_HZ`](super::HEATER_HZ)).
pub const SOFTWARE_PERIOD_TICKS: u8 = 10;

/// Power by switching: on for the first ticks of each period. The rest, less than a tick, is
/// carried to the next ones: over ten periods the power is right to a hundredth.
#[derive(Clone, Copy, Debug)]
pub struct SoftwarePwm {
    power: f32,
    /// Tick of the present period.
    tick: u8,
    on_ticks: u8,
    /// Owed to the next period, ticks.
    owed: f32,
}

impl SoftwarePwm {
    /// Off.
    pub const fn new() -> Self {
        Self { power: 0.0, tick: 0, on_ticks: 0, owed: 0.0 }
    }

    /// Sets the power, 0 to 1: from the next period on. Off is off from the next tick on.
    pub fn set(&mut self, power: f32) {
        self.power = power;
        if power <= 0.0 {
            *self = Self { tick: self.tick, ..Self::new() };
        }
    }

    /// A tick begins: whether the pin is high in it.
    pub fn tick(&mut self) -> bool {
        if self.tick == 0 {
            let ticks = self.power * f32::from(SOFTWARE_PERIOD_TICKS) + self.owed;
            // Cut, not rounded; the cast keeps to the type's range.
            self.on_ticks = (ticks as u8).min(SOFTWARE_PERIOD_TICKS);
            self.owed = ticks - f32::from(self.on_ticks);
        }
        let is_on = self.tick < self.on_ticks;
        self.tick = if self.tick + 1 >= SOFTWARE_PERIOD_TICKS { 0 } else { self.tick + 1 };
        is_on
    }
}

impl Default for SoftwarePwm {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn on_ticks(pwm: &mut SoftwarePwm, ticks: usize) -> usize {
        (0..ticks).filter(|_| pwm.tick()).count()
    }

    #[test]
    fn a_period_is_ten_ticks_and_begins_with_the_pulse() {
        let mut pwm = SoftwarePwm::new();
        pwm.set(0.4);
        let seen: Vec<bool> = (0..20).map(|_| pwm.tick()).collect();
        let period = [true, true, true, true, false, false, false, false, false, false];
        assert_eq!(seen, [period, period].concat());
        pwm.set(1.0);
        assert_eq!(on_ticks(&mut pwm, 1000), 1000);
    }

    #[test]
    fn off_is_off_in_the_midst_of_a_pulse() {
        let mut pwm = SoftwarePwm::new();
        pwm.set(1.0);
        assert!(pwm.tick());
        pwm.set(0.0);
        assert_eq!(on_ticks(&mut pwm, 1000), 0);
    }

    proptest! {
        #[test]
        fn the_mean_is_the_power(percent in 0_u8..=100) {
            let mut pwm = SoftwarePwm::new();
            pwm.set(f32::from(percent) / 100.0);
            let on = on_ticks(&mut pwm, 1000);
            prop_assert!(on.abs_diff(usize::from(percent) * 10) <= 1, "{on} of 1000");
        }

        /// The output stays off after off, whatever was set before and when.
        #[test]
        fn nothing_is_owed_after_off(powers in prop::collection::vec((0.0_f32..=1.0, 0_usize..25), 0..20)) {
            let mut pwm = SoftwarePwm::new();
            for (power, ticks) in powers {
                pwm.set(power);
                on_ticks(&mut pwm, ticks);
            }
            pwm.set(0.0);
            prop_assert_eq!(on_ticks(&mut pwm, 100), 0);
        }
    }
}
