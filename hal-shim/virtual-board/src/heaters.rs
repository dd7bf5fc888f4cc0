//! The heaters of the virtual board, their thermistors and the fan that cools them.

use super::heater_failure::HeaterFailure;
use super::thermal_model::AMBIENT_CELSIUS;
use super::{HeatedMass, ThermalModel};
use ferrostep_hal_shim::{FanOutput, Fans, Heater, ThermalBoard};
use ferrostep_thermistor::Thermistor;

/// Speed of a fan at full power, turns a minute.
const FULL_RPM: f32 = 5_000.0;

/// A thermistor that has fallen out takes the air's temperature with this time constant, s.
const FALLEN_OUT_S: f32 = 3.0;

/// A heater, the part that it heats, and its thermistor.
#[derive(Clone, Copy, Debug)]
struct VirtualHeater {
    model: ThermalModel,
    power: f32,
    thermistor: Thermistor,
    /// Temperature of the thermistor, degrees Celsius.
    thermistor_celsius: f32,
    failure: Option<HeaterFailure>,
}

impl VirtualHeater {
    const fn new((mass, thermistor): (HeatedMass, Thermistor)) -> Self {
        let model = ThermalModel::new(mass);
        Self { model, power: 0.0, thermistor, thermistor_celsius: model.celsius(), failure: None }
    }

    fn advance(&mut self, has_supply: bool, fan_power: u8, seconds: f32) {
        let power = match self.failure {
            _ if !has_supply => 0.0,
            Some(HeaterFailure::Dead) => 0.0,
            Some(HeaterFailure::StuckOn) => 1.0,
            _ => self.power,
        };
        self.model.advance(power, fan_power, seconds);
        match self.failure {
            Some(HeaterFailure::ThermistorFrozen) => {}
            Some(HeaterFailure::ThermistorFellOut) => {
                let share = (seconds / FALLEN_OUT_S).min(1.0);
                self.thermistor_celsius += (AMBIENT_CELSIUS - self.thermistor_celsius) * share;
            }
            _ => {
                let (celsius, lag_s) = (self.model.celsius(), self.model.sensor_lag_s());
                let share = if lag_s > seconds { seconds / lag_s } else { 1.0 };
                // Without a lag exactly the temperature.
                self.thermistor_celsius = if share < 1.0 {
                    self.thermistor_celsius + (celsius - self.thermistor_celsius) * share
                } else {
                    celsius
                };
            }
        }
    }

    fn reading(&self) -> u16 {
        match self.failure {
            Some(HeaterFailure::ThermistorOpen) => u16::MAX,
            Some(HeaterFailure::ThermistorShorted) => 0,
            _ => self.thermistor.reading(self.thermistor_celsius),
        }
    }
}

/// Heaters with a thermal model each, and the fans. The hot end's own fan cools none. What the bed
/// loses warms the chamber.
#[derive(Clone, Debug)]
pub struct VirtualHeaters {
    heaters: [VirtualHeater; 2],
    chamber: Option<VirtualHeater>,
    nozzle1: Option<VirtualHeater>,
    fan_powers: [u8; FanOutput::COUNT],
    /// Half turns of the fans so far.
    fan_pulses: [f32; FanOutput::COUNT],
    stuck_fans: [bool; FanOutput::COUNT],
    /// Heaters and fans have power.
    has_supply: bool,
}

impl VirtualHeaters {
    /// Heaters that are off and cold: what the nozzle's, the bed's, the chamber's and a second
    /// nozzle's heat, and their thermistors.
    pub const fn new(
        nozzle: (HeatedMass, Thermistor),
        bed: (HeatedMass, Thermistor),
        chamber: Option<(HeatedMass, Thermistor)>,
        nozzle1: Option<(HeatedMass, Thermistor)>,
    ) -> Self {
        let heaters = [VirtualHeater::new(nozzle), VirtualHeater::new(bed)];
        Self {
            heaters,
            chamber: match chamber {
                Some(chamber) => Some(VirtualHeater::new(chamber)),
                None => None,
            },
            nozzle1: match nozzle1 {
                Some(nozzle) => Some(VirtualHeater::new(nozzle)),
                None => None,
            },
            fan_powers: [0; FanOutput::COUNT],
            fan_pulses: [0.0; FanOutput::COUNT],
            stuck_fans: [false; FanOutput::COUNT],
            has_supply: true,
        }
    }

    /// Runs the heaters and the heated parts for a while, at most a second or so at a time.
    pub fn advance(&mut self, seconds: f32) {
        let has_supply = self.has_supply;
        let part_power = if has_supply { self.fan_powers[FanOutput::Part.index()] } else { 0 };
        for heater in self.heaters.iter_mut().chain(&mut self.nozzle1) {
            heater.advance(has_supply, part_power, seconds);
        }
        if let Some(chamber) = &mut self.chamber {
            let [_, bed] = &self.heaters;
            chamber.model.warm(bed.model.loss_w(), seconds);
            chamber.advance(has_supply, 0, seconds);
        }
        for ((pulses, power), is_stuck) in self.fan_pulses.iter_mut().zip(self.fan_powers).zip(self.stuck_fans) {
            if has_supply && !is_stuck {
                let turns = f32::from(power) / 255.0 * FULL_RPM / 60.0 * seconds;
                // As the count of a chip, and so that no turn is lost in a long print.
                *pulses = (*pulses + 2.0 * turns) % 65_536.0;
            }
        }
    }

    /// Makes a heater fail, or mends it. A thermistor that was mended reads right from
    /// the next moment on.
    pub fn set_failure(&mut self, heater: Heater, failure: Option<HeaterFailure>) {
        if let Some(heater) = self.heater_mut(heater) {
            heater.failure = failure;
        }
    }

    /// A heater; `None` for one that the machine does not have.
    const fn heater(&self, heater: Heater) -> Option<&VirtualHeater> {
        let [nozzle, bed] = &self.heaters;
        match heater {
            Heater::Nozzle => Some(nozzle),
            Heater::Bed => Some(bed),
            Heater::Chamber => self.chamber.as_ref(),
            Heater::Nozzle1 => self.nozzle1.as_ref(),
        }
    }

    const fn heater_mut(&mut self, heater: Heater) -> Option<&mut VirtualHeater> {
        let [nozzle, bed] = &mut self.heaters;
        match heater {
            Heater::Nozzle => Some(nozzle),
            Heater::Bed => Some(bed),
            Heater::Chamber => self.chamber.as_mut(),
            Heater::Nozzle1 => self.nozzle1.as_mut(),
        }
    }

    /// True temperature of the heated part, whatever its thermistor says, degrees Celsius; the
    /// air's without such a heater.
    pub fn true_celsius(&self, heater: Heater) -> f32 {
        self.heater(heater).map_or(AMBIENT_CELSIUS, |heater| heater.model.celsius())
    }

    /// Temperature of a heater's thermistor, degrees Celsius: what an exact converter would read.
    pub fn thermistor_celsius(&self, heater: Heater) -> f32 {
        self.heater(heater).map_or(AMBIENT_CELSIUS, |heater| heater.thermistor_celsius)
    }

    /// Adds heat from elsewhere to a heated body, W, for `seconds`; negative for heat that
    /// melting filament takes.
    pub fn warm(&mut self, heater: Heater, watts: f32, seconds: f32) {
        if let Some(heater) = self.heater_mut(heater) {
            heater.model.warm(watts, seconds);
        }
    }

    /// Last power set for a heater, 0 to 1.
    pub fn power(&self, heater: Heater) -> f32 {
        self.heater(heater).map_or(0.0, |heater| heater.power)
    }

    /// Stops a fan whatever its power, or repairs it.
    pub fn set_fan_stuck(&mut self, fan: FanOutput, is_stuck: bool) {
        self.stuck_fans[fan.index()] = is_stuck;
    }

    /// True if the power supply is on: without it no heater heats, even one whose transistor has
    /// failed closed, and no fan turns.
    pub const fn has_supply(&self) -> bool {
        self.has_supply
    }

    /// Power of a fan, 0 to 255.
    pub const fn fan_power(&self, fan: FanOutput) -> u8 {
        self.fan_powers[fan.index()]
    }
}

impl ThermalBoard for VirtualHeaters {
    fn reading(&mut self, heater: Heater) -> u16 {
        self.heater(heater).map_or(0, VirtualHeater::reading)
    }

    fn set_power(&mut self, heater: Heater, power: f32) {
        if let Some(heater) = self.heater_mut(heater) {
            heater.power = power.clamp(0.0, 1.0);
        }
    }

    fn set_supply(&mut self, on: bool) {
        self.has_supply = on;
    }
}

impl Fans for VirtualHeaters {
    fn set_fan_power(&mut self, fan: FanOutput, power: u8) {
        self.fan_powers[fan.index()] = power;
    }

    fn tachometer(&self, fan: FanOutput) -> Option<u16> {
        // Below 2^16.
        Some(self.fan_pulses[fan.index()] as u16)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use ferrostep_thermistor::ThermistorType;

    const THERMISTOR: Thermistor = Thermistor { kind: ThermistorType::Semitec104Gt2, pull_up_ohm: 4700.0 };

    fn new() -> VirtualHeaters {
        VirtualHeaters::new((HeatedMass::NOZZLE, THERMISTOR), (HeatedMass::BED, THERMISTOR), None, None)
    }

    fn read(heaters: &mut VirtualHeaters, heater: Heater) -> f32 {
        THERMISTOR.celsius(heaters.reading(heater)).unwrap()
    }

    #[test]
    fn a_heater_heats_itself_only_and_the_fan_cools_the_nozzle() {
        let mut heaters = new();
        let cold = read(&mut heaters, Heater::Bed);
        assert!((cold - AMBIENT_CELSIUS).abs() < 0.1);
        heaters.set_power(Heater::Nozzle, 7.0);
        heaters.advance(1.0);
        assert!(read(&mut heaters, Heater::Nozzle) > cold + 3.0);
        assert_eq!(read(&mut heaters, Heater::Bed), cold);
        heaters.set_power(Heater::Nozzle, 0.0);
        let mut fanned = heaters.clone();
        fanned.set_fan_power(FanOutput::Part, 255);
        assert_eq!(FanOutput::ALL.map(|fan| fanned.fan_power(fan)), [255, 0, 0, 0, 0, 0]);
        heaters.advance(1.0);
        fanned.advance(1.0);
        assert!(fanned.true_celsius(Heater::Nozzle) < heaters.true_celsius(Heater::Nozzle));
    }

    #[test]
    fn failures_do_what_they_say() {
        let warm = |failure| {
            let mut heaters = new();
            heaters.set_power(Heater::Nozzle, 1.0);
            (0..10).for_each(|_| heaters.advance(1.0));
            heaters.set_power(Heater::Nozzle, if failure == HeaterFailure::StuckOn { 0.0 } else { 1.0 });
            heaters.set_failure(Heater::Nozzle, Some(failure));
            let before = read(&mut heaters.clone(), Heater::Bed);
            let start = heaters.true_celsius(Heater::Nozzle);
            (0..10).for_each(|_| heaters.advance(1.0));
            assert_eq!(read(&mut heaters, Heater::Bed), before, "the other heater is none of its business");
            (start, heaters)
        };
        let (start, heaters) = warm(HeaterFailure::Dead);
        assert!(heaters.true_celsius(Heater::Nozzle) < start);
        let (start, heaters) = warm(HeaterFailure::StuckOn);
        assert!(heaters.true_celsius(Heater::Nozzle) > start + 20.0);
        let mut without_supply = heaters.clone();
        without_supply.set_supply(false);
        (0..10).for_each(|_| without_supply.advance(1.0));
        assert!(without_supply.true_celsius(Heater::Nozzle) < heaters.true_celsius(Heater::Nozzle));
        let (start, mut heaters) = warm(HeaterFailure::ThermistorFrozen);
        assert!((read(&mut heaters, Heater::Nozzle) - start).abs() < 0.1);
        assert!(heaters.true_celsius(Heater::Nozzle) > start + 20.0);
        let (_, mut heaters) = warm(HeaterFailure::ThermistorFellOut);
        assert!((read(&mut heaters, Heater::Nozzle) - AMBIENT_CELSIUS).abs() < 2.0);
        let (_, mut heaters) = warm(HeaterFailure::ThermistorOpen);
        assert!(THERMISTOR.celsius(heaters.reading(Heater::Nozzle)).is_err());
        heaters.set_failure(Heater::Nozzle, None);
        assert!(THERMISTOR.celsius(heaters.reading(Heater::Nozzle)).is_ok());
        let (_, mut heaters) = warm(HeaterFailure::ThermistorShorted);
        assert_eq!(heaters.reading(Heater::Nozzle), 0);
    }
}
