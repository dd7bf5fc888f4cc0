//! The control and its checks, on the virtual board and against boards that say anything.

mod chamber;
mod checks;
mod failures;
mod load;
mod modelled;
mod properties;
mod supply;
mod tuning;

use ferrostep_hal_shim::{FanOutput, Fans, Heater, ThermalBoard};
use ferrostep_thermistor::{Thermistor, ThermistorType};
use ferrostep_virtual_board::{HeatedMass, HeaterFailure, VirtualHeaters};

use super::control::HeatControl;
use super::safety::Trip;
use super::*;
use crate::heat::fans::{FanDemand, FanSettings, FanTable};
use crate::settings::profile::heaters::{HeaterSettings, HeaterWatch};

/// Samples a second.
const SAMPLES_A_S: u32 = 1000 / SAMPLE_MS;

/// The settings that all built-in profiles have in common.
fn settings(heater: Heater) -> HeaterSettings {
    let on_usual_board = |kind| Thermistor { kind, pull_up_ohm: Thermistor::USUAL_PULL_UP_OHM };
    match heater {
        Heater::Nozzle => HeaterSettings {
            thermistor: on_usual_board(ThermistorType::Semitec104Gt2),
            min_celsius: 5.0,
            max_celsius: 275.0,
            max_target_celsius: 275.0,
            watch: HeaterWatch::NOZZLE,
            gains: PidGains { proportional: 0.1, integral: 0.004, derivative: 0.1, fan: 0.0 },
            residency_window_celsius: 1.0,
            residency_ms: 10_000,
            mass: HeatedMass::NOZZLE,
            is_heated: true,
            is_warmed_by_others: false,
        },
        Heater::Bed => HeaterSettings {
            thermistor: on_usual_board(ThermistorType::Epcos100k),
            max_celsius: 125.0,
            max_target_celsius: 125.0,
            watch: HeaterWatch::BED,
            gains: PidGains { proportional: 0.2, integral: 0.004, derivative: 0.5, fan: 0.0 },
            mass: HeatedMass::BED,
            ..settings(Heater::Nozzle)
        },
        Heater::Nozzle1 => settings(Heater::Nozzle),
        Heater::Chamber => HeaterSettings {
            thermistor: on_usual_board(ThermistorType::Epcos100k),
            max_celsius: 90.0,
            max_target_celsius: 80.0,
            watch: HeaterWatch::CHAMBER,
            gains: PidGains { proportional: 0.5, integral: 0.001, derivative: 0.0, fan: 0.0 },
            residency_window_celsius: 2.0,
            mass: HeatedMass::CHAMBER,
            is_warmed_by_others: true,
            ..settings(Heater::Nozzle)
        },
    }
}

/// A target for each heater that its printer often has, degrees Celsius.
fn usual_target(heater: Heater) -> f32 {
    match heater {
        Heater::Nozzle | Heater::Nozzle1 => 215.0,
        Heater::Bed => 60.0,
        Heater::Chamber => 50.0,
    }
}

/// Heaters that no other warms. The chamber has separate tests.
const USUAL: [Heater; 2] = [Heater::Nozzle, Heater::Bed];

/// The same, and the nozzle of a second tool.
const ALONE: [Heater; 3] = [Heater::Nozzle, Heater::Bed, Heater::Nozzle1];

/// Nozzle and bed of these settings on the virtual board, a chamber, a second nozzle,
/// and their control.
fn control_of(
    [nozzle, bed]: [HeaterSettings; 2],
    [chamber, nozzle1]: [Option<HeaterSettings>; 2],
    fan_table: FanTable,
) -> (HeatControl, VirtualHeaters) {
    let heated = |settings: HeaterSettings| (settings.mass, settings.thermistor);
    let mut board = VirtualHeaters::new(heated(nozzle), heated(bed), chamber.map(heated), nozzle1.map(heated));
    (HeatControl::new([Some(nozzle), Some(bed), chamber, nozzle1], fan_table, &mut board), board)
}

/// Control and virtual board in virtual time.
#[derive(Clone)]
struct Rig {
    control: HeatControl,
    board: VirtualHeaters,
    samples: u32,
}

impl Rig {
    fn new() -> Self {
        let (control, board) = control_of(
            USUAL.map(settings),
            [Heater::Chamber, Heater::Nozzle1].map(settings).map(Some),
            FanSettings::USUAL,
        );
        Self { control, board, samples: 0 }
    }

    /// A heater that was at its usual target for a while.
    fn holding(heater: Heater) -> Self {
        let mut rig = Self::new();
        rig.control.set_target(heater, usual_target(heater));
        rig.run(240.0).unwrap();
        assert!((rig.board.true_celsius(heater) - usual_target(heater)).abs() < 0.5);
        rig
    }

    fn sample(&mut self) -> Result<(), HeatFault> {
        self.samples += 1;
        self.board.advance(SAMPLE_MS as f32 * 1e-3);
        self.control.update(&mut self.board)
    }

    fn run(&mut self, seconds: f32) -> Result<(), HeatFault> {
        (0..(seconds * SAMPLES_A_S as f32) as u32).try_for_each(|_| self.sample())
    }

    /// Runs until a fault. Returns it, and the seconds until then.
    fn fault_after(&mut self, at_most_s: f32) -> (HeatFault, f32) {
        let since = self.samples;
        let fault = self.run(at_most_s).unwrap_err();
        for heater in Heater::ALL {
            assert_eq!(self.board.power(heater), 0.0, "{heater:?} is on in the very sample of {fault}");
        }
        (fault, (self.samples - since) as f32 / SAMPLES_A_S as f32)
    }

    /// Makes a heater fail now.
    fn fail(&mut self, heater: Heater, failure: HeaterFailure) -> &mut Self {
        self.board.set_failure(heater, Some(failure));
        self
    }
}

#[test]
fn the_first_temperatures_are_there_from_the_start() {
    let rig = Rig::new();
    for heater in Heater::ALL {
        let HeaterStatus { celsius, target_celsius, power } = rig.control.status(heater);
        assert!((celsius - 22.0).abs() < 0.1, "{celsius}");
        assert_eq!((target_celsius, power), (0.0, 0.0));
    }
}

/// Both heaters at once, to their usual targets and a little further, with and without the fan.
#[test]
fn heating_up_overshoots_by_less_than_three_degrees_and_stays() {
    for further in [0.0, 10.0] {
        for fan_power in [0, 255] {
            let mut rig = Rig::new();
            rig.control.set_fan_demand(FanDemand::part(fan_power));
            let targets = ALONE.map(|heater| usual_target(heater) + further);
            for (heater, target) in ALONE.into_iter().zip(targets) {
                rig.control.set_target(heater, target);
            }
            let mut highest = [0.0_f32; 3];
            for second in 0..600 {
                rig.run(1.0).unwrap();
                for (index, heater) in ALONE.into_iter().enumerate() {
                    let off = rig.board.true_celsius(heater) - targets[index];
                    highest[index] = highest[index].max(off);
                    assert!(second < 240 || off.abs() < 0.5, "{heater:?} is off by {off} after {second} s");
                }
            }
            assert!(highest.iter().all(|beyond| *beyond < 3.0), "{highest:?} beyond {targets:?}");
        }
    }
}

#[test]
fn a_target_of_zero_is_off_whatever_the_number() {
    let mut rig = Rig::new();
    for off in [f32::NAN, -5.0, 0.0, f32::NEG_INFINITY] {
        rig.control.set_target(Heater::Nozzle, 200.0);
        rig.sample().unwrap();
        assert_eq!(rig.board.power(Heater::Nozzle), 1.0);
        rig.control.set_target(Heater::Nozzle, off);
        rig.sample().unwrap();
        assert_eq!(rig.board.power(Heater::Nozzle), 0.0, "{off}");
    }
}

/// Hosts match these words.
#[test]
fn faults_are_said_as_hosts_expect() {
    use ferrostep_hal_shim::SensorError::{Open, Shorted};
    for (heater, trip, line) in [
        (Heater::Nozzle, Trip::Sensor(Open), "Error:MINTEMP triggered, system stopped! Heater_ID: E0"),
        (Heater::Bed, Trip::Sensor(Shorted), "Error:MAXTEMP triggered, system stopped! Heater_ID: bed"),
        (Heater::Bed, Trip::TooHot(131.5), "Error:MAXTEMP triggered, system stopped! Heater_ID: bed (temp: 131.50)"),
        (Heater::Nozzle, Trip::TooCold(-3.0), "Error:MINTEMP triggered, system stopped! Heater_ID: E0 (temp: -3.00)"),
        (
            Heater::Nozzle,
            Trip::HeatingFailed(22.0),
            "Error:Heating failed, system stopped! Heater_ID: E0 (temp: 22.00)",
        ),
        (Heater::Bed, Trip::Runaway(40.0), "Error:Thermal Runaway, system stopped! Heater_ID: bed (temp: 40.00)"),
        (
            Heater::Nozzle,
            Trip::RisesUnpowered(70.0),
            "Error:Thermal Runaway, system stopped! Heater_ID: E0 (temp: 70.00)",
        ),
        (
            Heater::Bed,
            Trip::StaysHotUnpowered(104.5),
            "Error:Thermal Runaway, system stopped! Heater_ID: bed (temp: 104.50)",
        ),
        (
            Heater::Nozzle,
            Trip::Frozen(214.0),
            "Error:Thermal Malfunction, system stopped! Heater_ID: E0 (temp: 214.00)",
        ),
    ] {
        assert_eq!(HeatFault { heater, trip }.to_string(), line);
    }
}
