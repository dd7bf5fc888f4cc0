//! A thermistor's readings, freed of single bad ones.

use ferrostep_hal_shim::SensorError;
use ferrostep_thermistor::Thermistor;

/// Readings in the median: two bad ones among them have no effect, the third is believed.
pub const MEDIAN_OF: usize = 5;

/// The last readings of a thermistor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thermometer {
    thermistor: Thermistor,
    readings: [u16; MEDIAN_OF],
    /// Place of the next reading, that of the oldest one.
    next: usize,
}

impl Thermometer {
    /// Takes as many readings as the median needs.
    pub fn new(thermistor: Thermistor, readings: [u16; MEDIAN_OF]) -> Self {
        Self { thermistor, readings, next: 0 }
    }

    /// Adds the newest reading.
    pub fn add(&mut self, reading: u16) {
        if let Some(oldest) = self.readings.get_mut(self.next) {
            *oldest = reading;
        }
        self.next = (self.next + 1) % MEDIAN_OF;
    }

    /// Temperature by the median of the last readings, degrees Celsius.
    ///
    /// An open circuit gives the highest reading and a shorted one the lowest; the median treats
    /// them like any other.
    ///
    /// # Errors
    /// The circuit is open or shorted.
    pub fn celsius(&self) -> Result<f32, SensorError> {
        let mut sorted = self.readings;
        sorted.sort_unstable();
        self.thermistor.celsius(sorted[MEDIAN_OF / 2])
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use ferrostep_thermistor::ThermistorType;
    use proptest::prelude::*;

    const THERMISTOR: Thermistor = Thermistor { kind: ThermistorType::Semitec104Gt2, pull_up_ohm: 4700.0 };

    #[test]
    fn the_third_bad_reading_is_believed() {
        let good = THERMISTOR.reading(200.0);
        for (bad, error) in [(u16::MAX, SensorError::Open), (0, SensorError::Shorted)] {
            let mut thermometer = Thermometer::new(THERMISTOR, [good; MEDIAN_OF]);
            for _ in 0..2 {
                thermometer.add(bad);
                assert_eq!(thermometer.celsius(), THERMISTOR.celsius(good));
            }
            thermometer.add(bad);
            assert_eq!(thermometer.celsius(), Err(error));
            (0..3).for_each(|_| thermometer.add(good));
            assert_eq!(thermometer.celsius(), THERMISTOR.celsius(good));
        }
    }

    proptest! {
        /// The result is within the range of the other three, whatever two of the last five are.
        #[test]
        fn two_of_five_decide_nothing(bad in any::<[u16; 2]>(), good in prop::array::uniform3(3000_u16..60_000), turn in 0_usize..5) {
            let mut readings = [good[0], bad[0], good[1], bad[1], good[2]];
            readings.rotate_left(turn);
            let mut thermometer = Thermometer::new(THERMISTOR, [0; MEDIAN_OF]);
            readings.into_iter().for_each(|reading| thermometer.add(reading));
            let ends = [good.iter().max(), good.iter().min()].map(|end| THERMISTOR.celsius(*end.unwrap()).unwrap());
            prop_assert!((ends[0]..=ends[1]).contains(&thermometer.celsius().unwrap()));
        }
    }
}
