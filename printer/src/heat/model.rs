//! A heater by its model: it heats one mass that loses heat to the air, and the thermistor
//! follows with a lag.
//!
//! ```text
//! C dB/dt = P + U - G (B - room)        dS/dt = R (B - S)
//! ```
//!
//! B is the mass, S the thermistor, P the heater's power, G the loss by air, fan and filament. U is
//! the unmodelled power, W: it is found from the difference between the measured temperature and S,
//! and so the loop holds its target even with a wrong model.

use super::sample_time::SAMPLE_S;

/// The room's temperature as the model counts it, degrees Celsius. U takes the difference.
const ROOM_CELSIUS: f32 = 25.0;

/// Speed at which estimates follow the measured temperature: poles, all three, over the
/// sensor's response.
const OBSERVER: f32 = 1.2;
/// Time in which the loop means to reach its target, over the sensor's lag ...
const APPROACH: f32 = 0.8;
/// ... and at least, s.
const MIN_APPROACH_S: f32 = 1.0;

/// The constants of a heater: Marlin's (MPC), and Kalico's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeaterModel {
    /// Power of the heater at full, W.
    pub power_w: f32,
    /// Heat capacity of the heated mass, J/K.
    pub capacity_j_per_k: f32,
    /// Loss to still air, W/K.
    pub loss_w_per_k: f32,
    /// Loss with the part-cooling fan at full power, W/K; not below that to still air.
    pub fanned_loss_w_per_k: f32,
    /// Response of the thermistor, 1/s: one over its lag.
    pub sensor_per_s: f32,
    /// Heat capacity of filament, J/K for each millimetre.
    pub filament_j_per_k_mm: f32,
}

impl HeaterModel {
    /// Smallest and largest power, W.
    pub const POWER_W: [f64; 2] = [1.0, 3_000.0];
    /// Smallest and largest capacity, J/K.
    pub const CAPACITY_J_PER_K: [f64; 2] = [1.0, 20_000.0];
    /// Smallest and largest loss, W/K.
    pub const LOSS_W_PER_K: [f64; 2] = [0.001, 100.0];
    /// Smallest and largest response of the thermistor, 1/s: a lag of 0.2 to 100 s.
    pub const SENSOR_PER_S: [f64; 2] = [0.01, 5.0];
    /// Smallest and largest heat capacity of filament, J/K for each millimetre.
    pub const FILAMENT_J_PER_K_MM: [f64; 2] = [0.0, 0.1];
    /// Heat capacity of PLA of 1.75 mm: 1.8 J/(g K) times 1.24 g/cm^3 times 2.405 mm^2.
    pub const PLA_J_PER_K_MM: f64 = 0.005_4;

    /// Loss with the fan at this power, 0 to 255, and filament at this speed, W/K.
    fn loss(&self, cooling: &Cooling) -> f32 {
        let fan = (self.fanned_loss_w_per_k - self.loss_w_per_k) * (f32::from(cooling.fan_power) / 255.0);
        self.loss_w_per_k + fan + self.filament_j_per_k_mm * cooling.filament_mm_per_s
    }

    /// Returns true if every constant is within its range.
    pub fn is_possible(&self) -> bool {
        let within = |value: f32, [low, high]: [f64; 2]| (low as f32..=high as f32).contains(&value);
        within(self.power_w, Self::POWER_W)
            && within(self.capacity_j_per_k, Self::CAPACITY_J_PER_K)
            && within(self.loss_w_per_k, Self::LOSS_W_PER_K)
            && within(self.fanned_loss_w_per_k, Self::LOSS_W_PER_K)
            && self.fanned_loss_w_per_k >= self.loss_w_per_k
            && within(self.sensor_per_s, Self::SENSOR_PER_S)
            && within(self.filament_j_per_k_mm, Self::FILAMENT_J_PER_K_MM)
    }
}

/// Cooling of a nozzle beside that by the air.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cooling {
    /// Power of the part-cooling fan, 0 to 255.
    pub fan_power: u8,
    /// Speed of the filament that is melted, mm/s.
    pub filament_mm_per_s: f32,
}

/// The loop: its estimates of the unmeasured temperatures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModelLoop {
    /// Temperature of the mass, degrees Celsius.
    block: f32,
    /// Temperature of the thermistor, degrees Celsius; before the first sample not a number.
    sensor: f32,
    /// Power that the model does not know, W.
    unmodelled_w: f32,
}

impl ModelLoop {
    /// The first sample sets the temperatures.
    pub const fn new() -> Self {
        Self { block: f32::NAN, sensor: f32::NAN, unmodelled_w: 0.0 }
    }

    /// Power for the next sample, 0 to 1; 0 where the target is 0. `power` was that of the last.
    pub fn power(&mut self, model: &HeaterModel, celsius: f32, target: f32, power: f32, cooling: &Cooling) -> f32 {
        if self.sensor.is_nan() {
            (self.block, self.sensor) = (celsius, celsius);
        }
        let loss = model.loss(cooling);
        // Effect of the last sample's power, by the model.
        let flow_w = model.power_w * power + self.unmodelled_w - loss * (self.block - ROOM_CELSIUS);
        let response = model.sensor_per_s;
        let lag = self.block - self.sensor;
        self.block += flow_w / model.capacity_j_per_k * SAMPLE_S;
        self.sensor += response * lag * SAMPLE_S;
        // Correction by the thermistor. With these three shares all errors fade as exp(-pole t).
        let pole = OBSERVER * response;
        let off = (celsius - self.sensor) * SAMPLE_S;
        self.sensor += (3.0 * pole - response) * off;
        self.block += 3.0 * pole * pole / response * off;
        // At an end of its range the power does not hold the temperature, and on the way up a wrong
        // capacity would count as power.
        if power > 0.0 && power < 1.0 {
            let most_w = 0.5 * model.power_w;
            let unmodelled_w = self.unmodelled_w + model.capacity_j_per_k * pole * pole * pole / response * off;
            self.unmodelled_w = unmodelled_w.clamp(-most_w, most_w);
        }
        if target <= 0.0 {
            // Another model, or another place, may come before the next target.
            self.unmodelled_w = 0.0;
            return 0.0;
        }
        let approach_s = (APPROACH / response).max(MIN_APPROACH_S);
        let rise_w = model.capacity_j_per_k * (target - self.block) / approach_s;
        let wanted_w = rise_w + loss * (self.block - ROOM_CELSIUS) - self.unmodelled_w;
        let wanted = wanted_w / model.power_w;
        // NaN gives no power.
        if wanted > 0.0 { wanted.min(1.0) } else { 0.0 }
    }
}
