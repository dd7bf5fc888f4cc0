//! A heater, what it heats, and the air around.

/// One lump of heat capacity with a heater and a loss to the air.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThermalModel {
    celsius: f32,
    /// Heater power at full, W.
    heater_w: f32,
    /// Heat capacity, J/K.
    capacity_j_per_k: f32,
    /// Loss to the air, W/K.
    loss_w_per_k: f32,
    /// Further loss with the fan at full power, W/K.
    fan_loss_w_per_k: f32,
}

/// Temperature of the air, degrees Celsius.
pub const AMBIENT_CELSIUS: f32 = 22.0;

impl ThermalModel {
    /// A 40 W hot end: 210 C in about 70 s, half power holds it.
    pub const fn nozzle() -> Self {
        Self {
            celsius: AMBIENT_CELSIUS,
            heater_w: 40.0,
            capacity_j_per_k: 12.0,
            loss_w_per_k: 0.11,
            fan_loss_w_per_k: 0.02,
        }
    }

    /// A 250 W bed: 60 C in about 80 s.
    pub const fn bed() -> Self {
        Self {
            celsius: AMBIENT_CELSIUS,
            heater_w: 250.0,
            capacity_j_per_k: 500.0,
            loss_w_per_k: 1.8,
            fan_loss_w_per_k: 0.0,
        }
    }

    /// Temperature now.
    pub const fn celsius(&self) -> f32 {
        self.celsius
    }

    /// Runs the model for `seconds`, at most a second or so at a time, with the heater at `power` (0 to 1) and the
    /// fan at `fan_power` (0 to 255).
    pub fn advance(&mut self, power: f32, fan_power: u8, seconds: f32) {
        let loss = self.loss_w_per_k + self.fan_loss_w_per_k * f32::from(fan_power) / 255.0;
        let watts = self.heater_w * power - loss * (self.celsius - AMBIENT_CELSIUS);
        self.celsius += watts / self.capacity_j_per_k * seconds;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn full_power_heats_and_no_power_cools_to_the_air() {
        let mut nozzle = ThermalModel::nozzle();
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
}
