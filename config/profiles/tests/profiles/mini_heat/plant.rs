//! A MINI's hot end and bed, with all that makes control hard: dead time, draughts, fans, filament,
//! a weak or strong supply, and a converter's noise.
//!
//! The hot end is the one of the maker's own regulator (prusa3d/Prusa-Firmware-Buddy,
//! `model_based_hotend_regulator`, `steady_state_hotend`, Configuration_MINI.h): 40 W, 3.58 degrees
//! a second at full power without losses. The power that holds a temperature is, of 255, (0.422 d +
//! 0.00027 d^2 (1 - fan)) sqrt(1 + 4 fan), at d degrees above the room. The bed's figures are not
//! published: 80 W, and 350 J/K; at full power it does not quite reach 110 C.

use ferrostep_hal_shim::{FanOutput, Fans, Heater, ThermalBoard};
use ferrostep_thermistor::Thermistor;

/// Parts of the dead time; a sample is a part.
const MAX_DEAD_SAMPLES: usize = 1000;

/// Seconds of a sample.
pub const SAMPLE_S: f32 = 0.01;

/// Rise at full power without losses, degrees a second; 40 W.
const NOZZLE_DEGREES_PER_S: f32 = 3.58;
const NOZZLE_W: f32 = 40.0;

const BED_W: f32 = 80.0;
const BED_J_PER_K: f32 = 350.0;
const BED_W_PER_K: f32 = 0.95;
const BED_DEAD_S: f32 = 2.0;

/// Readings that a table of them is made for: every hundredth of a degree from -50 C on.
const TABLE_START_CELSIUS: f32 = -50.0;
const TABLE_A_DEGREE: f32 = 100.0;
const TABLE_LENGTH: usize = 37_000;

/// A small generator (xorshift64*): the test must be the same everywhere.
#[derive(Clone, Debug)]
pub struct Random(pub u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d)
    }

    /// A number from `low` up to `high`, evenly distributed.
    pub fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * ((self.next() >> 40) as f32 / (1_u64 << 24) as f32)
    }

    /// One of them.
    pub fn one_of(&mut self, values: &[f32]) -> f32 {
        values[(self.next() >> 33) as usize % values.len()]
    }

    /// About normal, with a standard deviation of 1.
    fn normal(&mut self) -> f32 {
        let bits = self.next();
        // Twelve numbers from 0 to 31: variance 12 (32^2 - 1) / 12.
        let sum: u64 = (0..12).map(|place| bits >> (place * 5) & 31).sum();
        (sum as f32 - 186.0) / 31.98
    }
}

/// Powers on their way.
#[derive(Clone, Debug)]
struct Delay {
    powers: Vec<f32>,
    at: usize,
}

impl Delay {
    fn new(seconds: f32) -> Self {
        let length = (seconds / SAMPLE_S).round().clamp(1.0, MAX_DEAD_SAMPLES as f32) as usize;
        Self { powers: vec![0.0; length], at: 0 }
    }

    fn pass(&mut self, power: f32) -> f32 {
        let delayed = std::mem::replace(&mut self.powers[self.at], power);
        self.at += 1;
        if self.at == self.powers.len() {
            self.at = 0;
        }
        delayed
    }
}

/// Changing surroundings of a heater.
#[derive(Clone, Copy, Debug)]
pub struct Weather {
    pub room_celsius: f32,
    /// Heater power as a share of the printed rating.
    pub supply: [f32; 2],
    /// Loss of nozzle and bed as a share of that in still air; the fan's comes on top.
    pub draught: [f32; 2],
    /// Power that filament takes from the nozzle, W.
    pub filament_w: f32,
    /// Standard deviation of a single conversion, of 4096.
    pub noise: f32,
    /// One reading in this many has any value at all.
    pub spark_in: f32,
}

impl Weather {
    pub const STILL: Self = Self {
        room_celsius: 22.0,
        supply: [1.0; 2],
        draught: [1.0; 2],
        filament_w: 0.0,
        noise: 0.0,
        spark_in: f32::INFINITY,
    };
}

/// Thermistor readings by temperature.
#[derive(Clone, Debug)]
struct Table(std::rc::Rc<Vec<u16>>);

impl Table {
    fn new(thermistor: &Thermistor) -> Self {
        let celsius = (0..TABLE_LENGTH).map(|index| TABLE_START_CELSIUS + index as f32 / TABLE_A_DEGREE);
        Self(std::rc::Rc::new(celsius.map(|celsius| thermistor.reading(celsius)).collect()))
    }

    fn reading(&self, celsius: f32) -> f32 {
        let place = ((celsius - TABLE_START_CELSIUS) * TABLE_A_DEGREE).clamp(0.0, (TABLE_LENGTH - 2) as f32);
        let (below, share) = (place as usize, place.fract());
        let [low, high] = [self.0[below], self.0[below + 1]].map(f32::from);
        low + (high - low) * share
    }
}

/// The machine's heaters, as its board sees them.
#[derive(Clone, Debug)]
pub struct Plant {
    pub weather: Weather,
    pub celsius: [f32; 2],
    pub powers: [f32; 2],
    pub fan: u8,
    pub random: Random,
    delays: [Delay; 2],
    tables: [Table; 2],
}

impl Plant {
    pub fn new(thermistors: [Thermistor; 2], nozzle_dead_s: f32, weather: Weather, seed: u64) -> Self {
        Self {
            celsius: [weather.room_celsius; 2],
            powers: [0.0; 2],
            fan: 0,
            random: Random(seed | 1),
            delays: [nozzle_dead_s, BED_DEAD_S].map(Delay::new),
            tables: thermistors.map(|thermistor| Table::new(&thermistor)),
            weather,
        }
    }

    /// A sample's time passes.
    pub fn advance(&mut self) {
        let Weather { room_celsius, supply, draught, filament_w, .. } = self.weather;
        let fan = f32::from(self.fan) / 255.0;
        let bed = self.celsius[1] - room_celsius;
        // The air over a hot bed is warm.
        let nozzle = self.celsius[0] - room_celsius - 0.2 * bed;
        let still = (0.422 * nozzle + 0.00027 * nozzle * nozzle.max(0.0) * (1.0 - fan)) / 255.0;
        let holds = still * ((1.0 + 4.0 * fan).sqrt() + draught[0] - 1.0);
        let power = self.delays[0].pass(self.powers[0]) * supply[0];
        let melts = if nozzle > 120.0 { filament_w / NOZZLE_W } else { 0.0 };
        self.celsius[0] += (power - holds - melts) * NOZZLE_DEGREES_PER_S * SAMPLE_S;
        let power_w = self.delays[1].pass(self.powers[1]) * supply[1] * BED_W;
        self.celsius[1] += (power_w - BED_W_PER_K * draught[1] * bed) / BED_J_PER_K * SAMPLE_S;
    }
}

impl ThermalBoard for Plant {
    fn reading(&mut self, heater: Heater) -> u16 {
        let Weather { noise, spark_in, .. } = self.weather;
        let exact = self.tables[heater.index()].reading(self.celsius[heater.index()]);
        if noise == 0.0 {
            return exact.round() as u16;
        }
        if self.random.between(0.0, spark_in) < 1.0 {
            return self.random.between(0.0, 65_535.0) as u16;
        }
        // The sum of 16 conversions has four times a single one's deviation.
        (exact + 4.0 * noise * self.random.normal()).round() as u16
    }

    fn set_power(&mut self, heater: Heater, power: f32) {
        self.powers[heater.index()] = power;
    }
}

impl Fans for Plant {
    fn set_fan_power(&mut self, fan: FanOutput, power: u8) {
        if fan == FanOutput::Part {
            self.fan = power;
        }
    }
}
