//! A heater, the part that it heats, and the air around.

/// Parts that the dead time is divided into.
const DELAY_PARTS: usize = 32;

/// Thermal mass of a heater: one lump of heat capacity that loses heat to the air.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeatedMass {
    /// Heater power at full, W.
    pub heater_w: f32,
    /// Heat capacity, J/K.
    pub capacity_j_per_k: f32,
    /// Loss to the air, W/K.
    pub loss_w_per_k: f32,
    /// Further loss with the part-cooling fan at full power, W/K.
    pub fan_loss_w_per_k: f32,
    /// Dead time from a change of power until the temperature answers, s.
    pub dead_time_s: f32,
    /// Time constant with which the thermistor follows what is heated, s.
    pub sensor_lag_s: f32,
}

impl HeatedMass {
    /// A 40 W hot end: 210 C in about 70 s, half power holds it.
    pub const NOZZLE: Self = Self {
        heater_w: 40.0,
        capacity_j_per_k: 12.0,
        loss_w_per_k: 0.11,
        fan_loss_w_per_k: 0.02,
        dead_time_s: 0.0,
        sensor_lag_s: 0.0,
    };

    /// A 250 W bed: 60 C in about 80 s.
    pub const BED: Self = Self {
        heater_w: 250.0,
        capacity_j_per_k: 500.0,
        loss_w_per_k: 1.8,
        fan_loss_w_per_k: 0.0,
        dead_time_s: 0.0,
        sensor_lag_s: 0.0,
    };

    /// A closed chamber of half a metre with a heater of 200 W. A bed of 100 C alone warms it to 55
    /// C, in half an hour.
    pub const CHAMBER: Self = Self {
        heater_w: 200.0,
        capacity_j_per_k: 4_000.0,
        loss_w_per_k: 4.0,
        fan_loss_w_per_k: 0.0,
        dead_time_s: 0.0,
        sensor_lag_s: 0.0,
    };
}

/// Powers on their way from the heater to the thermistor: a ring of means, each over a part
/// of the dead time.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Delay {
    powers: [f32; DELAY_PARTS],
    oldest: usize,
    /// Duration of the newest part, s, and its power times that.
    seconds: f32,
    power_seconds: f32,
}

impl Delay {
    const EMPTY: Self = Self { powers: [0.0; DELAY_PARTS], oldest: 0, seconds: 0.0, power_seconds: 0.0 };

    /// Takes the power of the next `seconds`, and gives that of `dead_time_s` ago.
    fn pass(&mut self, power: f32, seconds: f32, dead_time_s: f32) -> f32 {
        if dead_time_s <= 0.0 {
            return power;
        }
        let part_s = dead_time_s / DELAY_PARTS as f32;
        let delayed = self.powers[self.oldest];
        self.seconds += seconds;
        self.power_seconds += power * seconds;
        while self.seconds >= part_s {
            let mean = self.power_seconds / self.seconds;
            self.powers[self.oldest] = mean;
            self.oldest = (self.oldest + 1) % DELAY_PARTS;
            self.seconds -= part_s;
            self.power_seconds = mean * self.seconds;
        }
        delayed
    }
}

/// A heated mass and how warm it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThermalModel {
    mass: HeatedMass,
    celsius: f32,
    delay: Delay,
}

/// Temperature of the air, degrees Celsius.
pub const AMBIENT_CELSIUS: f32 = 22.0;

impl ThermalModel {
    /// Model as cold as the air.
    pub const fn new(mass: HeatedMass) -> Self {
        Self { mass, celsius: AMBIENT_CELSIUS, delay: Delay::EMPTY }
    }

    /// Time constant of the thermistor, s.
    pub const fn sensor_lag_s(&self) -> f32 {
        self.mass.sensor_lag_s
    }

    /// Temperature now.
    pub const fn celsius(&self) -> f32 {
        self.celsius
    }

    /// Heat that it loses to the air without a fan, W.
    pub fn loss_w(&self) -> f32 {
        self.mass.loss_w_per_k * (self.celsius - AMBIENT_CELSIUS)
    }

    /// Takes heat from elsewhere, W, for `seconds`.
    pub fn warm(&mut self, watts: f32, seconds: f32) {
        self.celsius += watts / self.mass.capacity_j_per_k * seconds;
    }

    /// Runs the model for `seconds`, at most a second or so at a time, with the heater at `power`
    /// (0 to 1) and the fan at `fan_power` (0 to 255).
    pub fn advance(&mut self, power: f32, fan_power: u8, seconds: f32) {
        let HeatedMass { heater_w, capacity_j_per_k, loss_w_per_k, fan_loss_w_per_k, dead_time_s, .. } = self.mass;
        let power = self.delay.pass(power, seconds, dead_time_s);
        let loss = loss_w_per_k + fan_loss_w_per_k * f32::from(fan_power) / 255.0;
        let watts = heater_w * power - loss * (self.celsius - AMBIENT_CELSIUS);
        self.celsius += watts / capacity_j_per_k * seconds;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn full_power_heats_and_no_power_cools_to_the_air() {
        let mut nozzle = ThermalModel::new(HeatedMass::NOZZLE);
        let mut seconds = 0;
        while nozzle.celsius() < 210.0 {
            nozzle.advance(1.0, 0, 1.0);
            seconds += 1;
            assert!(seconds < 120);
        }
        assert!(seconds > 40);
        for _ in 0..10_000 {
            nozzle.advance(0.0, 0, 0.5);
        }
        assert!((nozzle.celsius() - AMBIENT_CELSIUS).abs() < 0.1);
    }

    /// The same curve, later by the dead time, whatever the steps.
    #[test]
    fn the_dead_time_delays_and_loses_nothing() {
        for (dead_time_s, step_s) in [(4.0, 0.01_f32), (5.6, 0.01), (4.0, 0.1), (3.0, 1.0)] {
            let delayed_mass = HeatedMass { dead_time_s, ..HeatedMass::NOZZLE };
            let (mut prompt, mut delayed) = (ThermalModel::new(HeatedMass::NOZZLE), ThermalModel::new(delayed_mass));
            let steps = |seconds: f32| (seconds / step_s).round() as u32;
            let power = |step: u32| if step < steps(30.0) { 0.8 } else { 0.1 };
            (0..steps(60.0)).for_each(|step| prompt.advance(power(step), 0, step_s));
            (0..steps(60.0 + dead_time_s)).for_each(|step| {
                let celsius = delayed.celsius();
                delayed.advance(power(step), 0, step_s);
                let is_dead = step < steps(dead_time_s * 0.9).saturating_sub(1);
                assert!(!is_dead || celsius == AMBIENT_CELSIUS, "{dead_time_s} s, step {step}: {celsius}");
            });
            let off = (delayed.celsius() - prompt.celsius()).abs();
            assert!(off < 0.05 + 4.0 * step_s, "{dead_time_s} s in steps of {step_s} s: {off}");
        }
    }
}
