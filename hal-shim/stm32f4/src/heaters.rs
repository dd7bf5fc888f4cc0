//! A printer board's heaters, thermistors and fans.

use core::sync::atomic::{AtomicU16, Ordering};

use super::converter::{Converter, ConverterNumber};
use super::pwm::{FAN_HZ, HEATER_HZ, OutputPin, PwmClocks, PwmOutput};
use crate::gpio;
use crate::registers::Registers;
use crate::tachometers::PulseCounts;
use ferrostep_hal_shim::{FanOutput, Fans, Heater, ThermalBoard};

/// A board's heaters, fans and thermistors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ThermalPins {
    /// The converter of all thermistors.
    pub converter: ConverterNumber,
    /// The converter's channels in their turn.
    pub channels: &'static [u8],
    /// Place of each heater's sensor among the channels; `None` for a heater that the
    /// machine does not have.
    pub sensors: [Option<u8>; Heater::COUNT],
    /// The heaters' outputs; a chamber may have a thermometer and no heater.
    pub heaters: [Option<OutputPin>; Heater::COUNT],
    /// The fans by their outputs.
    pub fans: [Option<FanPins>; FanOutput::COUNT],
    /// The pin that switches the power supply of all these, if the machine's can be switched.
    pub supply: Option<SupplyPin>,
}

/// The output that switches the power supply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SupplyPin {
    /// The port; 0 is A.
    pub port: u8,
    /// The pin's number.
    pub number: u8,
    /// The supply is on while the pin is low.
    pub on_is_low: bool,
}

/// A fan's pins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FanPins {
    /// The output that switches it.
    pub power: OutputPin,
    /// Port and number of its tachometer's input.
    pub tachometer: Option<(u8, u8)>,
}

/// The board's heaters, thermistors and fans, at work.
#[derive(Debug)]
pub struct BoardHeaters<R> {
    registers: R,
    converter: Converter,
    sensors: [Option<u8>; Heater::COUNT],
    heaters: [Option<PwmOutput>; Heater::COUNT],
    fans: [Option<PwmOutput>; FanOutput::COUNT],
    /// The fans' last powers; heaters are set in each sample.
    fan_powers: [u8; FanOutput::COUNT],
    /// True for a fan with a tachometer, whose edges `pulses` counts.
    has_tachometer: [bool; FanOutput::COUNT],
    pulses: &'static PulseCounts,
    supply: Option<SupplyPin>,
}

impl<R: Registers> BoardHeaters<R> {
    /// All off. The pins are low outputs and analogue inputs already; `memory`, at
    /// `memory_address`, is as [`Converter::start`] wants it.
    pub fn start(
        pins: &ThermalPins,
        memory: &'static [AtomicU16],
        memory_address: u32,
        pulses: &'static PulseCounts,
        clocks: PwmClocks,
        mut registers: R,
    ) -> Self {
        let mut output = |pin, hz| PwmOutput::start(pin, hz, clocks, &mut registers);
        let heaters = pins.heaters.map(|pin| pin.map(|pin| output(pin, HEATER_HZ)));
        let fans = pins.fans.map(|fan| fan.map(|fan| output(fan.power, FAN_HZ)));
        let has_tachometer = pins.fans.map(|fan| fan.is_some_and(|fan| fan.tachometer.is_some()));
        let converter = Converter::start(pins.converter, pins.channels, memory, memory_address, &mut registers);
        let sensors = pins.sensors;
        let fan_powers = [0; FanOutput::COUNT];
        let supply = pins.supply;
        Self { registers, converter, sensors, heaters, fans, fan_powers, has_tachometer, pulses, supply }
    }

    /// Sets the pins without a timer. To be called every 10 ms.
    pub fn tick(&mut self) {
        self.heaters
            .iter_mut()
            .chain(self.fans.iter_mut())
            .flatten()
            .for_each(|output| output.tick(&mut self.registers));
    }
}

impl<R: Registers> ThermalBoard for BoardHeaters<R> {
    fn reading(&mut self, heater: Heater) -> u16 {
        let place = heater.index();
        self.sensors[place].map_or(0, |sensor| self.converter.reading_of_sensor(place, sensor, &mut self.registers))
    }

    fn set_power(&mut self, heater: Heater, power: f32) {
        if let Some(output) = &mut self.heaters[heater.index()] {
            output.set(power, &mut self.registers);
        }
    }

    fn set_supply(&mut self, on: bool) {
        if let Some(SupplyPin { port, number, on_is_low }) = self.supply {
            // The upper half of BSRR makes pins low.
            let place = u32::from(number) + if on == on_is_low { 16 } else { 0 };
            self.registers.write(gpio::port(port) + gpio::BSRR, 1 << place);
        }
    }
}

impl<R: Registers> Fans for BoardHeaters<R> {
    fn set_fan_power(&mut self, fan: FanOutput, power: u8) {
        if let Some(output) = &mut self.fans[fan.index()]
            && core::mem::replace(&mut self.fan_powers[fan.index()], power) != power
        {
            output.set(f32::from(power) / 255.0, &mut self.registers);
        }
    }

    fn tachometer(&self, fan: FanOutput) -> Option<u16> {
        self.has_tachometer[fan.index()].then(|| self.pulses[fan.index()].load(Ordering::Relaxed))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::registers::recorder::Recorder;
    use crate::{CONVERSIONS, TimerChannel};

    const CLOCKS: PwmClocks = PwmClocks { slow_hz: 84_000_000, fast_hz: 168_000_000 };

    /// The Octopus: heaters PA2 and PA1, fans PA8 (TIM1, channel 1) and PE5.
    fn octopus() -> (BoardHeaters<Recorder>, &'static [AtomicU16]) {
        let pin = |port, number| OutputPin { port, number, channel: None };
        let fan = |power| FanPins { power, tachometer: None };
        let pins = ThermalPins {
            converter: ConverterNumber::Three,
            channels: &[14, 9],
            sensors: [Some(0), Some(1), None, None],
            heaters: [Some(pin(0, 2)), Some(pin(0, 1)), None, None],
            fans: [
                Some(fan(OutputPin { channel: TimerChannel::named("TIM1_CH1"), ..pin(0, 8) })),
                Some(fan(pin(4, 5))),
                None,
                None,
                None,
                None,
            ],
            supply: Some(SupplyPin { port: 4, number: 11, on_is_low: true }),
        };
        let memory: &'static [AtomicU16] = (0..2 * CONVERSIONS).map(|_| AtomicU16::new(0)).collect::<Vec<_>>().leak();
        static PULSES: PulseCounts = [const { AtomicU16::new(0) }; FanOutput::COUNT];
        (BoardHeaters::start(&pins, memory, 0x2000_8000, &PULSES, CLOCKS, Recorder::default()), memory)
    }

    fn levels(board: &BoardHeaters<Recorder>, bsrr: u32) -> Vec<u32> {
        board.registers.stored(bsrr)
    }

    #[test]
    fn each_heater_has_its_own_sensor_and_pin() {
        let (mut board, memory) = octopus();
        for (place, conversion) in memory.iter().enumerate() {
            conversion.store(if place % 2 == 0 { 100 } else { 200 }, Ordering::Relaxed);
        }
        assert_eq!(Heater::ALL.map(|heater| board.reading(heater)), [1600, 3200, 0, 0]);
        board.set_power(Heater::Bed, 1.0);
        board.set_power(Heater::Nozzle, 0.0);
        board.registers.stores.clear();
        board.tick();
        let gpioa = 0x4002_0018;
        assert_eq!(levels(&board, gpioa), [1 << 1]);
        board.set_power(Heater::Bed, 0.0);
        assert_eq!(levels(&board, gpioa).last(), Some(&(1 << 17)));
    }

    #[test]
    fn the_supply_has_its_level() {
        let (mut board, _) = octopus();
        board.registers.stores.clear();
        board.set_supply(true);
        board.set_supply(false);
        board.supply = board.supply.map(|pin| SupplyPin { on_is_low: false, ..pin });
        board.set_supply(true);
        board.set_supply(false);
        let (low, high) = (1 << 27, 1 << 11);
        assert_eq!(board.registers.stores, [low, high, high, low].map(|word| (0x4002_1018, word)));
    }

    #[test]
    fn fans_are_their_own() {
        let (mut board, _) = octopus();
        board.registers.stores.clear();
        board.set_fan_power(FanOutput::Part, 255);
        assert_eq!(board.registers.stores, [(0x4001_0034, 1000)]);
        board.set_fan_power(FanOutput::Part, 51);
        assert_eq!(board.registers.value(0x4001_0034), 200);
        board.set_fan_power(FanOutput::HotEnd, 255);
        (0..20).for_each(|_| board.tick());
        assert_eq!(levels(&board, 0x4002_1018), [1 << 5]);
        board.set_fan_power(FanOutput::HotEnd, 0);
        board.set_fan_power(FanOutput::Fan2, 255);
        assert_eq!(levels(&board, 0x4002_1018).last(), Some(&(1 << 21)));
    }
}
