//! Thermistors and platinum resistors: from the converter's readings to degrees Celsius, and back
//! for the virtual board.
//!
//! The circuit is the one that printer boards have: a pull-up resistor to the converter's
//! reference, the sensor to ground. The f32 arithmetic and libm's logarithm, exponential and cube
//! root are the same code on every processor, so that a reading is the same temperature, bit for
//! bit, on the desk and on the board.
#![cfg_attr(not(test), no_std)]

use ferrostep_hal_shim::SensorError;

/// Conversions that a reading is the sum of.
pub const CONVERSIONS_A_READING: u16 = 16;

/// Reading at the reference voltage: 16 conversions of 4096 steps.
const FULL_SCALE: f32 = 65_536.0;

/// A reading as near to an end of the range as this has no temperature: 12 steps of the converter,
/// more than twice the STM32F405's largest total error of 5 (data sheet DS8626, ADC accuracy).
const BLIND_END: u16 = 12 * CONVERSIONS_A_READING;

/// Lowest reading of an open circuit.
const OPEN: u16 = u16::MAX - BLIND_END;

/// 0 degrees Celsius, K.
const ZERO_CELSIUS_K: f32 = 273.15;

/// 25 degrees Celsius, K: where data sheets name the resistance.
const NOMINAL_K: f32 = 298.15;

/// Highest temperature of glass beads, degrees Celsius; those of an unknown maker are assumed to
/// have the same limit.
const GLASS_CELSIUS: f32 = 300.0;

/// Highest temperature of a platinum resistor's conversion, degrees Celsius: no hot end is hotter,
/// and class B of IEC 60751 goes to 600.
const PLATINUM_CELSIUS: f32 = 500.0;

/// A and B of R = R0 (1 + A T + B T^2), T in degrees Celsius (IEC 60751, 4.2). The standard's third
/// term, for T below 0, is 0.02 degrees at -50.
const PLATINUM: [f32; 2] = [3.9083e-3, -5.775e-7];

/// R0 of a PT1000, ohms.
const PT1000_OHM: f32 = 1000.0;

/// Coefficients of the Steinhart-Hart equation, 1/T = a + b ln(R) + c ln(R)^3, with T in
/// K and R in ohms.
#[derive(Clone, Copy, Debug)]
struct SteinhartHart {
    a: f32,
    b: f32,
    c: f32,
}

/// Through 20, 150 and 300 degrees of the maker's table for 104GT (Semitec, GT thermistors): 126.8
/// k, 1.360 k and 80.65 ohms. Nowhere in the table from -50 to 300 degrees is it 0.1 degrees off.
const SEMITEC_104GT_2: SteinhartHart = SteinhartHart { a: 8.096_510_5e-4, b: 2.116_360_3e-4, c: 7.074_209e-8 };

/// Through 25, 150 and 250 degrees as EPCOS names them for B57560G104F: 100 k, 1641.9 and 226.15
/// ohms. B25/100 comes out at 4091 K; the data sheet says 4092 K, +-1 %.
const EPCOS_100K: SteinhartHart = SteinhartHart { a: 7.221_363e-4, b: 2.167_665_7e-4, c: 8.929_358e-8 };

/// A type of sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ThermistorType {
    /// Semitec 104GT-2: most hot ends since E3D's V6. 100 kilohms at 25 degrees, up to 300 degrees.
    Semitec104Gt2,
    /// EPCOS (TDK) B57560G104F: beds, older hot ends. 100 kilohms at 25 degrees, up to 300 degrees.
    Epcos100k,
    /// Any other thermistor, by two numbers of its data sheet: R = r25 exp(beta (1/T - 1/298.15
    /// K)). Good near the two temperatures that its beta is for (25 and 50, 85 or 100 degrees),
    /// some degrees off far from them.
    Beta {
        /// Resistance at 25 degrees Celsius, ohms.
        r25_ohm: f32,
        /// Beta, K.
        beta_k: f32,
    },
    /// Any other thermistor, by three points of its data sheet: see [`ThermistorType::through`].
    ThreePoints {
        /// a, b and c of the Steinhart-Hart equation; b and c are above 0.
        steinhart_hart: [f32; 3],
        /// Highest temperature, degrees Celsius.
        highest_celsius: f32,
    },
    /// A platinum resistor of 1000 ohms at 0 degrees (IEC 60751), without an amplifier.
    Pt1000,
}

impl ThermistorType {
    /// A thermistor through three points of its data sheet, degrees Celsius and ohms, the
    /// temperatures rising; `None` if no thermistor's curve goes through them. It is made for 300
    /// degrees, or for the highest of the points.
    pub fn through(celsius: [f64; 3], ohm: [f64; 3]) -> Option<Self> {
        let log = ohm.map(libm::log);
        let inverse_k = celsius.map(|celsius| 1.0 / (celsius + f64::from(ZERO_CELSIUS_K)));
        let slope = |index: usize| (inverse_k[index] - inverse_k[0]) / (log[index] - log[0]);
        let c = (slope(2) - slope(1)) / ((log[2] - log[1]) * (log[0] + log[1] + log[2]));
        let b = slope(1) - c * (log[0] * log[0] + log[0] * log[1] + log[1] * log[1]);
        let a = inverse_k[0] - log[0] * (b + c * log[0] * log[0]);
        let steinhart_hart = [a, b, c].map(|coefficient| coefficient as f32);
        let highest_celsius = (celsius[2] as f32).max(GLASS_CELSIUS);
        let is_curve = ohm[0] > ohm[1] && ohm[1] > ohm[2] && steinhart_hart.iter().all(|number| number.is_finite());
        // A smaller c is lost in f32, and the curve's inverse with it.
        (is_curve && b > 0.0 && c > 1e-10).then_some(Self::ThreePoints { steinhart_hart, highest_celsius })
    }

    /// Highest temperature that it is made for, degrees Celsius; readings beyond it
    /// are meaningless.
    pub const fn highest_celsius(self) -> f32 {
        match self {
            Self::Semitec104Gt2 | Self::Epcos100k | Self::Beta { .. } => GLASS_CELSIUS,
            Self::ThreePoints { highest_celsius, .. } => highest_celsius,
            Self::Pt1000 => PLATINUM_CELSIUS,
        }
    }

    /// Temperature at a resistance in ohms, degrees Celsius.
    fn celsius(self, ohm: f32) -> f32 {
        let inverse_k = match self {
            Self::Semitec104Gt2 => SEMITEC_104GT_2.inverse_k(ohm),
            Self::Epcos100k => EPCOS_100K.inverse_k(ohm),
            Self::Beta { r25_ohm, beta_k } => libm::logf(ohm / r25_ohm) / beta_k + 1.0 / NOMINAL_K,
            Self::ThreePoints { steinhart_hart: [a, b, c], .. } => SteinhartHart { a, b, c }.inverse_k(ohm),
            Self::Pt1000 => return platinum_celsius(ohm / PT1000_OHM),
        };
        1.0 / inverse_k - ZERO_CELSIUS_K
    }

    /// Resistance at a temperature, ohms.
    fn ohm(self, celsius: f32) -> f32 {
        let inverse_k = 1.0 / (celsius + ZERO_CELSIUS_K);
        match self {
            Self::Semitec104Gt2 => SEMITEC_104GT_2.ohm(inverse_k),
            Self::Epcos100k => EPCOS_100K.ohm(inverse_k),
            Self::Beta { r25_ohm, beta_k } => r25_ohm * libm::expf(beta_k * (inverse_k - 1.0 / NOMINAL_K)),
            Self::ThreePoints { steinhart_hart: [a, b, c], .. } => SteinhartHart { a, b, c }.ohm(inverse_k),
            Self::Pt1000 => {
                let [a, b] = PLATINUM;
                PT1000_OHM * (1.0 + celsius * (a + b * celsius))
            }
        }
    }
}

/// Temperature of a platinum resistor, degrees Celsius, from its resistance as a share of that at 0
/// degrees. The radicand is negative only beyond 3000 degrees; it is then taken as 0.
fn platinum_celsius(share: f32) -> f32 {
    let [a, b] = PLATINUM;
    let root = libm::sqrtf((a * a - 4.0 * b * (1.0 - share)).max(0.0));
    (root - a) / (2.0 * b)
}

impl SteinhartHart {
    fn inverse_k(&self, ohm: f32) -> f32 {
        let log = libm::logf(ohm);
        self.a + self.b * log + self.c * log * log * log
    }

    /// The cubic's one real root by Cardano's formula; b and c are above 0.
    fn ohm(&self, inverse_k: f32) -> f32 {
        let half = (inverse_k - self.a) / (2.0 * self.c);
        let third = self.b / (3.0 * self.c);
        let root = libm::sqrtf(third * third * third + half * half);
        libm::expf(libm::cbrtf(root + half) - libm::cbrtf(root - half))
    }
}

/// A sensor on its pull-up resistor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thermistor {
    /// The thermistor's type.
    pub kind: ThermistorType,
    /// The resistor from the sensor to the reference voltage, ohms.
    pub pull_up_ohm: f32,
}

impl Thermistor {
    /// The pull-up resistor of nearly every printer board, ohms.
    pub const USUAL_PULL_UP_OHM: f32 = 4700.0;

    /// Temperature of a reading, degrees Celsius. A reading is the sum of 16 conversions of 12 bits
    /// ([`CONVERSIONS_A_READING`]).
    ///
    /// # Errors
    /// The reading is so near an end of the range that the circuit must be open or shorted.
    pub fn celsius(&self, reading: u16) -> Result<f32, SensorError> {
        if reading >= OPEN {
            return Err(SensorError::Open);
        }
        if reading <= BLIND_END {
            return Err(SensorError::Shorted);
        }
        let reading = f32::from(reading);
        Ok(self.kind.celsius(self.pull_up_ohm * reading / (FULL_SCALE - reading)))
    }

    /// The reading at a temperature above absolute zero, degrees Celsius.
    pub fn reading(&self, celsius: f32) -> u16 {
        let ohm = self.kind.ohm(celsius);
        // The cast keeps to the type's range.
        (FULL_SCALE * (ohm / (ohm + self.pull_up_ohm)) + 0.5) as u16
    }

    /// Returns true if it can measure a temperature: within its limit, with a reading unlike those
    /// of an open or a shorted circuit.
    pub fn can_tell(&self, celsius: f32) -> bool {
        let apart = BLIND_END + 1..OPEN;
        celsius <= self.kind.highest_celsius() && apart.contains(&self.reading(celsius))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
