//! The trapezoidal time law (Wu 2024, eqs. 8, 9 and 12, the misprints mended).

/// Path position against time: accelerate, cruise, decelerate. Seconds and millimetres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trapezoid {
    /// Length of the path, mm.
    pub length_mm: f64,
    /// Speed at the start, mm/s.
    pub entry_mm_per_s: f64,
    /// Largest speed reached, mm/s.
    pub peak_mm_per_s: f64,
    /// Speed at the end, mm/s.
    pub exit_mm_per_s: f64,
    /// Acceleration and deceleration, mm/s^2.
    pub acceleration_mm_per_s2: f64,
    accelerate_s: f64,
    cruise_s: f64,
    decelerate_s: f64,
}

impl Trapezoid {
    /// The fastest law from `entry` to `exit` that keeps below `nominal` and to the acceleration.
    /// The acceleration is positive, and the ends can be reached from each other within the length.
    pub fn new(
        length_mm: f64,
        entry_mm_per_s: f64,
        nominal_mm_per_s: f64,
        exit_mm_per_s: f64,
        acceleration_mm_per_s2: f64,
    ) -> Self {
        let (entry_squared, exit_squared) = (entry_mm_per_s * entry_mm_per_s, exit_mm_per_s * exit_mm_per_s);
        // Without a cruise both ramps meet at the speed that 2*a*S = 2*v^2 - entry^2 - exit^2
        // gives. Rounding may put that a hair below the faster end.
        let meeting = ((2.0 * acceleration_mm_per_s2 * length_mm + entry_squared + exit_squared) / 2.0).sqrt();
        let peak = meeting.min(nominal_mm_per_s).max(entry_mm_per_s).max(exit_mm_per_s);
        let ramps_mm = (2.0 * peak * peak - entry_squared - exit_squared) / (2.0 * acceleration_mm_per_s2);
        let cruise_mm = (length_mm - ramps_mm).max(0.0);
        Self {
            length_mm,
            entry_mm_per_s,
            peak_mm_per_s: peak,
            exit_mm_per_s,
            acceleration_mm_per_s2,
            accelerate_s: (peak - entry_mm_per_s) / acceleration_mm_per_s2,
            cruise_s: if peak > 0.0 { cruise_mm / peak } else { 0.0 },
            decelerate_s: (peak - exit_mm_per_s) / acceleration_mm_per_s2,
        }
    }

    /// Duration of the whole path, s.
    pub fn duration_s(&self) -> f64 {
        self.accelerate_s + self.cruise_s + self.decelerate_s
    }

    /// Path position (mm) and speed (mm/s) at a time from the start; before and after,
    /// those of the ends.
    pub fn at(&self, time_s: f64) -> (f64, f64) {
        let acceleration = self.acceleration_mm_per_s2;
        if time_s <= 0.0 {
            (0.0, self.entry_mm_per_s)
        } else if time_s < self.accelerate_s {
            let speed = self.entry_mm_per_s + acceleration * time_s;
            ((self.entry_mm_per_s + speed) / 2.0 * time_s, speed)
        } else if time_s < self.accelerate_s + self.cruise_s {
            let ramp_mm = (self.entry_mm_per_s + self.peak_mm_per_s) / 2.0 * self.accelerate_s;
            (ramp_mm + self.peak_mm_per_s * (time_s - self.accelerate_s), self.peak_mm_per_s)
        } else {
            let left_s = (self.duration_s() - time_s).max(0.0);
            let speed = self.exit_mm_per_s + acceleration * left_s;
            (self.length_mm - (self.exit_mm_per_s + speed) / 2.0 * left_s, speed)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_long_move_accelerates_cruises_and_stops() {
        // 100 mm at 50 mm/s and 1000 mm/s^2: two ramps of 0.05 s and 1.25 mm, 97.5 mm of cruise.
        let law = Trapezoid::new(100.0, 0.0, 50.0, 0.0, 1000.0);
        assert!((law.duration_s() - (0.05 + 1.95 + 0.05)).abs() < 1e-12);
        assert_eq!(law.at(0.0), (0.0, 0.0));
        assert!((law.at(0.05).0 - 1.25).abs() < 1e-12);
        assert!((law.at(1.025).0 - 50.0).abs() < 1e-12);
        assert!((law.at(9.0).0 - 100.0).abs() < 1e-12);
    }

    #[test]
    fn a_short_move_never_reaches_its_nominal_speed() {
        let law = Trapezoid::new(1.0, 0.0, 200.0, 0.0, 1000.0);
        assert!((law.peak_mm_per_s - 1000f64.sqrt()).abs() < 1e-9);
        assert!((law.duration_s() - 2.0 * (1.0f64 / 1000.0).sqrt()).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn the_law_is_continuous_and_ends_where_it_should(
            length in 0.01f64..300.0, entry_part in 0.0f64..1.0, exit_part in 0.0f64..1.0,
            nominal in 1.0f64..500.0, acceleration in 50.0f64..10_000.0,
        ) {
            let entry = nominal * entry_part;
            let exit = (nominal * exit_part)
                .min((entry * entry + 2.0 * acceleration * length).sqrt())
                .max((entry * entry - 2.0 * acceleration * length).max(0.0).sqrt());
            let law = Trapezoid::new(length, entry, nominal, exit, acceleration);
            let duration = law.duration_s();
            prop_assert!((law.at(duration).0 - length).abs() < 1e-9 * length.max(1.0));
            let steps = 500;
            let (mut travelled, mut before) = (0.0, law.at(0.0).1);
            for index in 1..=steps {
                let (position, speed) = law.at(duration * f64::from(index) / f64::from(steps));
                travelled += (before + speed) / 2.0 * duration / f64::from(steps);
                // The rule of trapezoids errs only in the two slices that hold a bend of the speed.
                let slice = duration / f64::from(steps);
                prop_assert!((position - travelled).abs() <= acceleration * slice * slice + 1e-9);
                prop_assert!(speed <= nominal * (1.0 + 1e-12) + 1e-9);
                before = speed;
            }
        }
    }
}
