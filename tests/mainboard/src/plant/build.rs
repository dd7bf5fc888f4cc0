//! Builds the parts on their pins from the board's file and the printer's profile.

use super::accelerometer::{BusWire, WiredAccelerometer};
use super::eeprom::{EepromWire, WiredEeprom};
use super::inputs::Source;
use super::{Plant, REFERENCE_MV, Role, Switched, WiredFan, WiredHeater, WiredThermistor};
use crate::parts::adxl345::{self, Adxl345};
use crate::parts::at24c32::At24c32;
use crate::parts::bltouch::BlTouch;
use crate::parts::encoder::{self, FilamentEncoder};
use crate::parts::fan::{self, Fan};
use crate::parts::frame::Mode;
use crate::parts::heat::thermistor::{Curve, SensorFault, Thermistor, ThermistorConfig};
use crate::parts::heat::{self, Heater};
use crate::parts::motion::end_stop::{EndStopConfig, Side};
use crate::parts::motion::lift::Lift;
use crate::parts::motion::sheet::{ProbeConfig, SheetConfig};
use crate::parts::motion::{self, AxisConfig, Kinematics, Motion, MotorConfig};
use crate::parts::supply::{self, Rail};
use crate::parts::tmc2209::{self, Tmc2209};
use crate::parts::wire::{BitTime, Bus, Wire};
use crate::wiring::{self, Board, DriverLine, End, HomingSensor, NamedThermistor, Printer, ThermistorKind};

/// Temperature of the room, degrees Celsius.
const AMBIENT_CELSIUS: f64 = 22.0;
/// Sense resistors of common driver modules, milliohm.
const MODULE_SENSE_MILLIOHM: u32 = 110;
/// Distance of the frame beyond an end without a sensor, and beyond a switch, mm.
const FRAME_MM: f64 = 3.0;
/// Nozzle height above the sheet at which the inductive probe of a well adjusted
/// machine triggers, mm.
const PROBE_TRIGGER_MM: f64 = 1.0;
/// The same of a probe with a pin, mm.
const BLTOUCH_TRIGGER_MM: f64 = 2.0;
/// A smart filament sensor of BIGTREETECH's, the second: filament from edge to edge, mm, and the
/// play of its wheel.
const FILAMENT_EDGE_MM: f64 = 2.88;
const FILAMENT_PLAY_MM: f64 = 0.05;
/// Depth by which the sheet gives way, mm.
const ALLOWED_PRESS_MM: f64 = 0.5;

impl Plant {
    /// Builds the printer of a board and a profile; the seed determines everything random.
    ///
    /// # Errors
    /// The two files contradict each other.
    pub fn new(board: &Board, printer: &Printer, seed: u64) -> Result<Self, String> {
        let mut plant = Self {
            roles: Default::default(),
            inputs: Vec::new(),
            driven: Vec::new(),
            drivers: Vec::new(),
            motion: mechanics(board, printer, seed)?,
            wires: Vec::new(),
            shared: None,
            replies: Vec::new(),
            heaters: Vec::new(),
            fans: Vec::new(),
            thermistors: Vec::new(),
            accelerometer: None,
            eeprom: None,
            bltouch: None,
            filament_encoder: None,
            is_filament_at_switch: true,
            supply_fails: false,
            is_button_pressed: false,
            is_card_inserted: false,
            filament_j_per_k_mm: 0.0,
            filament: super::Filament::default(),
            motor_rail: Rail::new(supply::Config::motors_24_v()),
            chip_rail: Rail::new(supply::Config::chip_3_3_v()),
            ambient_celsius: AMBIENT_CELSIUS,
            slow_ns: 0,
            lines_changed: true,
            answered: None,
        };
        plant.connect_drivers(board, seed);
        plant.connect_switches(board, printer);
        plant.connect_heat(board, printer, seed)?;
        plant.connect_accelerometer(board, printer, seed);
        plant.connect_eeprom(board, seed);
        if let (Some(pin), Some(supply)) = (board.power_supply, printer.power_supply) {
            plant.roles.insert(pin, Role::Supply(supply.on_is_low));
            plant.motor_rail = Rail::off(supply::Config::motors_24_v());
        }
        for driver in &mut plant.drivers {
            driver.set_supply(0, plant.motor_rail.on());
        }
        plant.driven = vec![None; plant.inputs.len()];
        Ok(plant)
    }

    fn connect_drivers(&mut self, board: &Board, seed: u64) {
        let mut sharing = Vec::new();
        for (index, motor) in board.motors.iter().enumerate() {
            // Bare pins get a module that is strapped for the usual 16 microsteps.
            let strapped = motor.driver == wiring::Driver::None;
            let address = if let DriverLine::Shared(address) = motor.line { address } else { 0 };
            let sense_milliohm =
                motor.sense_resistor_ohm.map_or(MODULE_SENSE_MILLIOHM, |ohm| (ohm * 1000.0).round() as u32);
            self.drivers.push(Tmc2209::new(tmc2209::Config {
                ms1: strapped || address & 1 != 0,
                ms2: strapped || address & 2 != 0,
                sense_milliohm,
                ..tmc2209::Config::default()
            }));
            self.roles.insert(motor.step, Role::Step(index));
            self.roles.insert(motor.direction, Role::Direction(index));
            let mask = match self.roles.get(&motor.enable) {
                Some(Role::Enable(others)) => others | 1 << index,
                _ => 1 << index,
            };
            self.roles.insert(motor.enable, Role::Enable(mask));
            if let Some(diag) = motor.diag {
                self.inputs.push((diag, Source::Diag(index)));
            }
            match motor.line {
                DriverLine::None => {}
                DriverLine::Shared(_) => sharing.push(index),
                DriverLine::Own(pin) => {
                    let bus = Bus::new(vec![index], seed ^ index as u64);
                    self.roles.insert(pin, Role::Wire(self.wires.len()));
                    self.inputs.push((pin, Source::Wire(self.wires.len())));
                    self.wires.push(Wire::new(bus, BitTime::Measured));
                }
            }
        }
        if !sharing.is_empty() {
            self.shared = Some(Bus::new(sharing, seed ^ 0x5EA1));
        }
    }

    fn connect_switches(&mut self, board: &Board, printer: &Printer) {
        let mut stop = 0;
        for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
            if printer.homing.axes[axis].is_some_and(|home| home.sensor == HomingSensor::EndStop) {
                if let Some(input) = board.input(name) {
                    self.inputs.push((input.pin, Source::EndStop(stop)));
                }
                stop += 1;
            }
        }
        if let (Some(input), true) = (board.input("probe"), self.motion.probe().is_some()) {
            match board.servo.filter(|_| printer.has_bltouch) {
                Some(servo) => {
                    self.bltouch = Some(BlTouch::new(BLTOUCH_TRIGGER_MM));
                    self.roles.insert(servo, Role::Servo);
                    self.inputs.push((input.pin, Source::BlTouch));
                }
                None => self.inputs.push((input.pin, Source::Probe)),
            }
        }
        if let Some(input) = board.input("button") {
            self.inputs.push((input.pin, Source::Button));
        }
        if let Some(input) = board.input("power_loss") {
            self.inputs.push((input.pin, Source::SupplyFails));
        }
        if let Some(input) = board.input("filament") {
            // Filament is loaded: its switch connects the pin to the supply.
            let source = if printer.sees_filament_move { Source::FilamentEncoder } else { Source::Held(true) };
            self.inputs.push((input.pin, source));
            self.filament_encoder = printer.sees_filament_move.then(|| {
                let start_mm = 0.41 * FILAMENT_EDGE_MM;
                FilamentEncoder::new(encoder::Config { edge_mm: FILAMENT_EDGE_MM, play_mm: FILAMENT_PLAY_MM, start_mm })
            });
        }
        self.connect_filament_switch(board);
        if let Some(detect) = board.card.and_then(|slot| slot.detect) {
            self.inputs.push((detect, Source::CardDetect));
        }
    }

    fn connect_filament_switch(&mut self, board: &Board) {
        if let Some(input) = board.input("filament2") {
            self.inputs.push((input.pin, Source::FilamentSwitch));
        }
    }

    fn connect_accelerometer(&mut self, board: &Board, printer: &Printer, seed: u64) {
        let Some(plug) = &board.accelerometer else { return };
        let frame = [0, 1].map(|axis: usize| {
            printer.frame[axis].map(|mode| Mode::new(mode.frequency_hz, mode.damping, self.motion.position_mm(axis)))
        });
        let chip = Adxl345::new(adxl345::Config { seed: seed ^ 0xADE5, ..adxl345::Config::default() });
        self.accelerometer = Some(WiredAccelerometer::new(chip, frame));
        for (pin, wire) in [(plug.cs, BusWire::Select), (plug.sck, BusWire::Clock), (plug.mosi, BusWire::Data)] {
            self.roles.insert(pin, Role::Accelerometer(wire));
        }
        self.inputs.push((plug.miso, Source::Accelerometer));
    }

    fn connect_eeprom(&mut self, board: &Board, seed: u64) {
        let Some(eeprom) = &board.eeprom else { return };
        self.eeprom = Some(WiredEeprom::new(At24c32::new(eeprom.address, seed ^ 0xEE24)));
        for (pin, wire) in [(eeprom.scl, EepromWire::Clock), (eeprom.sda, EepromWire::Data)] {
            self.roles.insert(pin, Role::Eeprom(wire));
        }
        self.inputs.push((eeprom.sda, Source::Eeprom));
    }

    fn connect_heat(&mut self, board: &Board, printer: &Printer, seed: u64) -> Result<(), String> {
        let chamber = printer.chamber.as_ref();
        let of_chamber = chamber.and_then(|chamber| chamber.heater.as_deref());
        for heater in &board.heaters {
            // Default values for a heater without a model in the profile.
            let (settings, (power_w, capacity_j_per_k, loss_w_per_k)) = match heater.name.as_str() {
                "bed" => (printer.bed.as_ref(), (250.0, 500.0, 2.0)),
                name if of_chamber == Some(name) => (chamber.map(|chamber| &chamber.settings), (200.0, 4000.0, 4.0)),
                _ => (Some(&printer.nozzle), (40.0, 12.0, 0.074)),
            };
            let mut config = heat::Config {
                power_w,
                capacity_j_per_k,
                loss_w_per_k,
                fan_loss_w_per_k: 0.0,
                sensor_lag_s: 0.5,
                dead_time_ns: 0,
                ambient_celsius: AMBIENT_CELSIUS,
            };
            if let Some(model) = settings.and_then(|settings| settings.model) {
                config.power_w = model.power_w;
                config.capacity_j_per_k = model.capacity_j_per_k;
                config.loss_w_per_k = model.loss_w_per_k;
                config.fan_loss_w_per_k = model.fan_loss_w_per_k;
                config.dead_time_ns = (model.dead_time_s * 1e9) as u64;
            }
            self.roles.insert(heater.pin, Role::Heater(self.heaters.len()));
            self.heaters.push(WiredHeater {
                name: heater.name.clone(),
                switched: Switched { pin: heater.pin, timer: heater.timer },
                heater: Heater::new(config).map_err(|error| format!("heater {}: {error}", heater.name))?,
                power: 0.0,
                last_on_ns: None,
            });
        }
        for fan in &board.fans {
            self.roles.insert(fan.pin, Role::Fan(self.fans.len()));
            if let Some(tacho) = fan.tacho {
                self.inputs.push((tacho, Source::Tacho(self.fans.len())));
            }
            self.fans.push(WiredFan {
                name: fan.name.clone(),
                switched: Switched { pin: fan.pin, timer: fan.timer },
                fan: Fan::new(fan::Config { full_rpm: 6000.0, spin_up_ns: 500_000_000, run_down_ns: 1_000_000_000 }),
                tacho: fan.tacho,
                power: 0.0,
                owed: 0.0,
            });
        }
        for (index, place) in board.thermistors.iter().enumerate() {
            let chamber = chamber.filter(|chamber| chamber.thermistor == place.name);
            let heater = match chamber {
                Some(chamber) => board.heaters.iter().position(|heater| Some(&heater.name) == chamber.heater.as_ref()),
                None => board.heaters.iter().position(|heater| heater.sensor == place.name),
            };
            let of_tool =
                printer.tool_thermistor.as_ref().filter(|(name, _)| *name == place.name).map(|(_, kind)| *kind);
            let kind = place.kind.or(match place.name.as_str() {
                "nozzle" => Some(printer.nozzle.sensor),
                "bed" => printer.bed.as_ref().map(|bed| bed.sensor),
                _ => chamber.map(|chamber| chamber.settings.sensor).or(of_tool),
            });
            let mut thermistor = Thermistor::new(ThermistorConfig {
                curve: kind.map_or_else(Curve::epcos_b57560g104f, curve),
                pull_up_ohm: place.pull_up_ohm,
                reference_mv: REFERENCE_MV,
                noise_mv: 0.8,
                seed: seed ^ (0x7E40 + index as u64),
            });
            if kind.is_none() {
                // No thermistor is plugged in.
                thermistor.set_fault(Some(SensorFault::Open));
            }
            self.thermistors.push(WiredThermistor { name: place.name.clone(), adc: place.adc, thermistor, heater });
        }
        Ok(())
    }
}

fn curve(kind: ThermistorKind) -> Curve {
    match kind {
        ThermistorKind::Named(NamedThermistor::Semitec104Gt2) => Curve::semitec_104gt_2(),
        ThermistorKind::Named(NamedThermistor::Epcos100k) => Curve::epcos_b57560g104f(),
        ThermistorKind::Named(NamedThermistor::Pt1000) => Curve::pt1000(),
        ThermistorKind::Beta { r25_ohm, beta_k } => Curve::Beta { r25_ohm, beta_k },
        ThermistorKind::Points { celsius: [t1, t2, t3], ohm: [r1, r2, r3] } => {
            Curve::three_points([(t1, r1), (t2, r2), (t3, r3)])
        }
    }
}

/// Motors, axes between their ends, switches, sheet and probe.
fn mechanics(board: &Board, printer: &Printer, seed: u64) -> Result<Motion, String> {
    let homing = &printer.homing;
    let mut end_stops = Vec::new();
    let axes = std::array::from_fn(|axis| {
        let (minimum_mm, maximum_mm) = (printer.lower_end_mm[axis], printer.size_mm[axis]);
        let home = homing.axes[axis];
        let high = home.is_some_and(|home| home.end == End::Max);
        if let Some(home) = home.filter(|home| home.sensor == HomingSensor::EndStop) {
            end_stops.push(EndStopConfig {
                axis,
                side: if high { Side::High } else { Side::Low },
                at_mm: home.position_mm,
                hysteresis_mm: 0.2,
                bounce_ns: 3_000_000,
                high_when_triggered: !home.triggers_low,
                seed: seed ^ (0xE570 + axis as u64),
            });
        }
        // An axis that homes by a stall ends at the frame; with another sensor the
        // frame is beyond it.
        let stalls = home.is_some_and(|home| home.sensor == HomingSensor::Stall);
        let beyond = |end: bool| if stalls && high == end { 0.0 } else { FRAME_MM };
        AxisConfig {
            minimum_mm,
            maximum_mm,
            frame_below_mm: if axis == 2 { 2.0 * FRAME_MM } else { beyond(false) },
            frame_above_mm: beyond(true),
            // A start that the firmware cannot know.
            start_mm: minimum_mm + (maximum_mm - minimum_mm) * [0.41, 0.53, 0.08][axis],
        }
    });
    let motor = |motor: usize, inverted: bool| {
        let microsteps = printer.drivers[motor].map_or(16, |driver| driver.microsteps);
        MotorConfig { full_steps_per_mm: printer.steps_per_mm[motor] / f64::from(microsteps), inverted }
    };
    // Of those after the first four only further motors of Z are plugged in.
    let plugged_in = |index: usize| {
        let name = &board.motors.get(index)?.name;
        printer.z_motors.get(name).filter(|_| index > 3)
    };
    let motors = (0..board.motors.len().max(4))
        .map(|index| match plugged_in(index) {
            Some(further) => motor(2, further.inverted),
            None => motor(index.min(3), index < 4 && printer.signals.inverted[index]),
        })
        .collect();
    let lift = match printer.z_motors.get("z") {
        Some(own) if printer.z_motors.values().all(|motor| motor.place_mm.is_some()) => {
            let further = (4..board.motors.len()).filter_map(|index| Some((index, plugged_in(index)?.place_mm?)));
            Some(Lift::new([(2, own.place_mm.unwrap_or_default())].into_iter().chain(further).collect())?)
        }
        _ => None,
    };
    let bed = homing.bed_mm;
    let by_probe = homing.axes[2].filter(|home| home.sensor == HomingSensor::Probe && board.input("probe").is_some());
    let probe = by_probe.map(|home| {
        let offset = homing.probe_offset_mm.unwrap_or_default();
        ProbeConfig {
            offset_mm: (offset[0], offset[1]),
            trigger_mm: PROBE_TRIGGER_MM,
            hysteresis_mm: 0.1,
            noise_mm: 0.002,
            high_when_triggered: !home.triggers_low,
            seed: seed ^ 0x940B,
        }
    });
    Motion::new(motion::Config {
        kinematics: match printer.kinematics {
            wiring::Kinematics::Cartesian => Kinematics::Cartesian,
            wiring::Kinematics::CoreXy => Kinematics::CoreXy,
        },
        axes,
        motors,
        lift,
        end_stops,
        sheet: SheetConfig {
            x_mm: (bed[0][0], bed[0][1]),
            y_mm: (bed[1][0], bed[1][1]),
            height_mm: 0.0,
            tilt: (0.0, 0.0),
            allowed_press_mm: ALLOWED_PRESS_MM,
        },
        probe,
    })
}
