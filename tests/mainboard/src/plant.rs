//! The printer around the chip: every part on the pins that the board's file names.
//!
//! The run reports the chip's outputs ([`Plant::output`], [`Plant::serial_byte`]) and asks for its
//! inputs ([`Plant::take_inputs`], [`Plant::voltages`], [`Plant::take_replies`]).

mod accelerometer;
mod build;
mod eeprom;
mod inputs;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::parts::bltouch::BlTouch;
use crate::parts::encoder::FilamentEncoder;
use crate::parts::fan::Fan;
use crate::parts::heat::Heater;
use crate::parts::heat::thermistor::Thermistor;
use crate::parts::motion::{Effect, Motion};
use crate::parts::supply::Rail;
use crate::parts::tmc2209::Tmc2209;
use crate::parts::wire::{Bus, Wire};
use crate::pins::Pin;
use crate::wiring::{Adc, TimerChannel};
use accelerometer::BusWire;
pub use accelerometer::WiredAccelerometer;
use eeprom::EepromWire;
pub use eeprom::WiredEeprom;
use inputs::Source;

/// The part connected to an output pin of the chip.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
enum Role {
    /// STEP of a motor's driver.
    Step(usize),
    /// DIR of a motor's driver.
    Direction(usize),
    /// EN, of all motors in this mask.
    Enable(u32),
    /// A driver's own serial line.
    Wire(usize),
    /// The gate of a heater's transistor.
    Heater(usize),
    /// The gate of a fan's transistor.
    Fan(usize),
    /// A wire to the accelerometer.
    Accelerometer(BusWire),
    /// A wire to the EEPROM.
    Eeprom(EepromWire),
    /// The servo's wire of the BLTouch.
    Servo,
    /// The input of the supply of motors and heaters; whether a low level switches it on.
    Supply(bool),
}

/// The pin of a heater or fan, and the timer channel that may drive it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Switched {
    /// The pin itself.
    pub pin: Pin,
    /// The timer channel that can drive the pin.
    pub timer: Option<TimerChannel>,
}

/// A heater and its output pin.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct WiredHeater {
    /// "nozzle", "bed" ...
    pub name: String,
    /// The output.
    pub switched: Switched,
    /// The heated mass.
    pub heater: Heater,
    /// The share of the supply's power that it gets now, 0 to 1.
    pub power: f64,
    /// The instant at which it last had power, ns.
    pub last_on_ns: Option<u64>,
}

/// A fan and its output pin.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct WiredFan {
    /// "part", "hotend" ...
    pub name: String,
    /// The output.
    pub switched: Switched,
    /// The fan.
    pub fan: Fan,
    /// The tachometer input.
    pub tacho: Option<Pin>,
    /// Share of full power, 0 to 1.
    pub power: f64,
    /// Power not yet delivered when a duty cycle is played in slots of [`SLOW_NS`], in slots.
    owed: f64,
}

/// A thermistor at its converter.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct WiredThermistor {
    /// "nozzle", "bed", "board" ...
    pub name: String,
    /// The converter channel.
    pub adc: Adc,
    /// The thermistor.
    pub thermistor: Thermistor,
    /// The heater in whose block it is mounted.
    pub heater: Option<usize>,
}

/// The motor that feeds the filament.
const EXTRUDER: usize = 3;
/// Interval of analogue values and duty cycles, ns: converters do not sample more often.
const SLOW_NS: u64 = 500_000;

/// Time constant with which filament takes the heat on its way through the nozzle, s.
const MELTING_S: f64 = 0.5;

/// Filament on its way through the nozzle, for the heat that melting takes.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
struct Filament {
    pushed_mm: f64,
    mm_per_s: f64,
}

impl Filament {
    /// Follows the extruder, every [`SLOW_NS`].
    fn follow(&mut self, pushed_mm: f64) {
        let passed_s = SLOW_NS as f64 * 1e-9;
        let mm_per_s = (pushed_mm - self.pushed_mm) / passed_s;
        self.pushed_mm = pushed_mm;
        self.mm_per_s += (mm_per_s - self.mm_per_s) * passed_s / MELTING_S;
    }
}
/// The chip's supply and its converters' reference, mV.
const REFERENCE_MV: f64 = 3300.0;

/// Everything around the chip.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Plant {
    roles: BTreeMap<Pin, Role>,
    inputs: Vec<(Pin, Source)>,
    driven: Vec<Option<Option<bool>>>,
    /// Drivers in the order of the board's motors: x, y, z, e, then sockets that the
    /// firmware does not use.
    pub drivers: Vec<Tmc2209>,
    /// Motors, axes, switches, probe.
    pub motion: Motion,
    wires: Vec<Wire>,
    shared: Option<Bus>,
    replies: Vec<(u64, u8)>,
    /// Heaters.
    pub heaters: Vec<WiredHeater>,
    /// Fans.
    pub fans: Vec<WiredFan>,
    /// Thermistors.
    pub thermistors: Vec<WiredThermistor>,
    /// The accelerometer, on a board with a plug for one.
    pub accelerometer: Option<WiredAccelerometer>,
    /// The EEPROM, on a board that has one.
    pub eeprom: Option<WiredEeprom>,
    /// The probe with a pin, instead of the one that detects the sheet.
    pub bltouch: Option<BlTouch>,
    /// The sensor that sees filament move, on a printer that has one.
    pub filament_encoder: Option<FilamentEncoder>,
    /// True if filament is at the switch beside it.
    pub is_filament_at_switch: bool,
    /// A module says that the supply fails, and feeds the board.
    pub supply_fails: bool,
    /// A person presses the board's button.
    pub is_button_pressed: bool,
    /// True if a card is in the slot: see [`crate::machine::Machine::insert_card`].
    pub(crate) is_card_inserted: bool,
    /// Heat that the nozzle's filament takes, in joules per kelvin for each millimetre that its
    /// motor pushes; 0: none. A print of PLA of 1.75 mm takes 0.0054.
    pub filament_j_per_k_mm: f64,
    filament: Filament,
    /// The supply of motors and heaters.
    pub motor_rail: Rail,
    /// The chip's supply.
    pub chip_rail: Rail,
    ambient_celsius: f64,
    slow_ns: u64,
    lines_changed: bool,
    /// A part that has answered an output at once: the chip may look before time continues.
    answered: Option<Source>,
}

impl Plant {
    /// True if a part is connected to this output pin.
    #[must_use]
    pub fn listens_to(&self, pin: Pin) -> bool {
        self.roles.contains_key(&pin)
    }

    /// Follows an output pin; `None` when the chip stops driving it: then resistors switch drivers
    /// and heaters off.
    pub fn output(&mut self, now_ns: u64, pin: Pin, level: Option<bool>) {
        let Some(&role) = self.roles.get(&pin) else { return };
        match role {
            Role::Step(motor) => {
                let Some(driver) = self.drivers.get_mut(motor) else { return };
                let stalled = driver.diag();
                let Some(moved) = driver.set_step_pin(now_ns, level.unwrap_or(false)) else { return };
                self.lines_changed |= driver.diag() != stalled;
                let effect = self.motion.step(now_ns, motor, moved.delta);
                if let Some(probe) = self.bltouch.as_mut().filter(|probe| probe.is_out()) {
                    if motor < 2 {
                        probe.stepped_in_plane();
                    }
                    self.lines_changed |= probe.set_gap(now_ns, self.motion.probe_gap_mm());
                }
                self.pass_on(now_ns, effect);
                if motor == EXTRUDER
                    && let Some(encoder) = &mut self.filament_encoder
                {
                    self.lines_changed |= encoder.follow(self.motion.motor_mm(EXTRUDER));
                }
            }
            Role::Direction(motor) => {
                if let Some(driver) = self.drivers.get_mut(motor) {
                    driver.set_direction_pin(now_ns, level.unwrap_or(false));
                }
            }
            Role::Enable(motors) => {
                for motor in 0..self.drivers.len() {
                    if motors & 1 << motor != 0
                        && let Some(driver) = self.drivers.get_mut(motor)
                    {
                        // Boards pull EN high, which switches drivers off until the firmware
                        // switches them on.
                        driver.set_enable_pin(now_ns, level.unwrap_or(true));
                        self.energize(now_ns, motor);
                    }
                }
            }
            Role::Wire(wire) => {
                if let Some(wire) = self.wires.get_mut(wire) {
                    wire.set_master(&mut self.drivers, now_ns, level);
                    self.lines_changed = true;
                }
            }
            Role::Heater(heater) => self.power_heater(now_ns, heater, if level == Some(true) { 1.0 } else { 0.0 }),
            Role::Fan(fan) => self.power_fan(now_ns, fan, if level == Some(true) { 1.0 } else { 0.0 }),
            Role::Servo => {
                if let Some(probe) = &mut self.bltouch {
                    self.lines_changed |= probe.set_gap(now_ns, self.motion.probe_gap_mm());
                    self.lines_changed |= probe.set_control(now_ns, level.unwrap_or(false));
                }
            }
            Role::Supply(on_is_low) => {
                if level.is_some_and(|level| level != on_is_low) {
                    self.motor_rail.restore(now_ns);
                } else {
                    self.motor_rail.cut(now_ns);
                }
            }
            Role::Accelerometer(wire) => {
                if self.accelerometer.as_mut().is_some_and(|part| part.set_wire(now_ns, wire, level)) {
                    self.answered = Some(Source::Accelerometer);
                }
            }
            Role::Eeprom(wire) => {
                if self.eeprom.as_mut().is_some_and(|part| part.set_wire(now_ns, wire, level)) {
                    self.answered = Some(Source::Eeprom);
                }
            }
        }
    }

    fn energize(&mut self, now_ns: u64, motor: usize) {
        if let Some(driver) = self.drivers.get(motor) {
            let (on, mscnt) = (driver.energized(), driver.mscnt());
            let effect = self.motion.set_energized(now_ns, motor, on, mscnt);
            self.pass_on(now_ns, effect);
        }
    }

    fn pass_on(&mut self, now_ns: u64, effect: Effect) {
        if let Some(accelerometer) = &mut self.accelerometer {
            accelerometer.moved(now_ns, [0, 1].map(|axis| self.motion.position_mm(axis)));
        }
        if effect.loads {
            for (motor, driver) in self.drivers.iter_mut().enumerate() {
                driver.set_load(self.motion.load(motor));
            }
            self.lines_changed = true;
        }
        self.lines_changed |= effect.lines;
    }

    /// Gives a heater this share of the supply's power from now on.
    pub fn power_heater(&mut self, now_ns: u64, heater: usize, power: f64) {
        let scale = self.motor_rail.power_scale(now_ns);
        if let Some(place) = self.heaters.get_mut(heater) {
            place.power = power;
            if power > 0.0 {
                place.last_on_ns = Some(now_ns);
            }
            place.heater.set_on(now_ns, power > 0.0);
            // A transistor that is stuck on passes the whole supply.
            let share = if place.heater.is_stuck_on() { 1.0 } else { power };
            place.heater.set_power_scale(now_ns, share * scale);
        }
    }

    /// Stops driving the gates of heaters and fans.
    pub fn release_gates(&mut self, now_ns: u64) {
        for heater in 0..self.heaters.len() {
            self.power_heater(now_ns, heater, 0.0);
        }
        for fan in 0..self.fans.len() {
            self.power_fan(now_ns, fan, 0.0);
        }
    }

    /// Gives a fan this share of full power from now on.
    pub fn power_fan(&mut self, now_ns: u64, fan: usize, power: f64) {
        if let Some(place) = self.fans.get_mut(fan) {
            place.power = power;
            if power == 0.0 || power == 1.0 {
                place.fan.set_driven(now_ns, power == 1.0);
            }
        }
    }

    /// True if the chip switches any heater on, with or without supply.
    #[must_use]
    pub fn any_heater_on(&self) -> bool {
        self.heaters.iter().any(|heater| heater.power > 0.0)
    }

    /// Passes a byte from the chip to the drivers' shared line; its start bit began at `start_ns`.
    pub fn serial_byte(&mut self, start_ns: u64, bit_ns: u64, byte: u8) {
        let Some(bus) = &mut self.shared else { return };
        if let Some(reply) = bus.byte(&mut self.drivers, start_ns, bit_ns, byte) {
            for (index, byte) in reply.bytes.iter().enumerate() {
                self.replies.push((reply.start_ns + index as u64 * 10 * reply.bit_ns, *byte));
            }
        }
        for motor in 0..self.drivers.len() {
            self.energize(start_ns, motor);
        }
        self.lines_changed = true;
    }

    /// Takes the drivers' replies on the shared line: start of each byte, ns, and the byte.
    pub fn take_replies(&mut self) -> Vec<(u64, u8)> {
        std::mem::take(&mut self.replies)
    }

    /// The shared line of the drivers, to break or mend.
    pub fn shared_line(&mut self) -> Option<&mut Bus> {
        self.shared.as_mut()
    }

    /// The lines of single drivers, to break or mend.
    pub fn own_lines(&mut self) -> &mut [Wire] {
        &mut self.wires
    }

    /// Advances time. True if [`Plant::voltages`] is due.
    pub fn advance(&mut self, now_ns: u64) -> bool {
        if self.motor_rail.advance(now_ns) {
            let on = self.motor_rail.on();
            for driver in &mut self.drivers {
                driver.set_supply(now_ns, on);
            }
            for motor in 0..self.drivers.len() {
                self.energize(now_ns, motor);
            }
            self.lines_changed = true;
        }
        self.chip_rail.advance(now_ns);
        self.lines_changed |= self.motion.advance(now_ns);
        if let Some(probe) = &mut self.bltouch {
            self.lines_changed |= probe.set_gap(now_ns, self.motion.probe_gap_mm());
            self.lines_changed |= probe.advance(now_ns);
        }
        for wire in &mut self.wires {
            self.lines_changed |= wire.advance(&mut self.drivers, now_ns);
        }
        for driver in &mut self.drivers {
            if driver.next_event_ns().is_some_and(|at_ns| at_ns <= now_ns) {
                driver.advance(now_ns);
                self.lines_changed = true;
            }
        }
        if let Some(accelerometer) = &mut self.accelerometer {
            accelerometer.advance(now_ns);
        }
        if now_ns < self.slow_ns {
            return false;
        }
        self.slow_ns = now_ns + SLOW_NS;
        for fan in &mut self.fans {
            let before = fan.fan.tacho();
            if fan.power > 0.0 && fan.power < 1.0 {
                fan.owed += fan.power;
                let driven = fan.owed >= 1.0;
                fan.owed -= if driven { 1.0 } else { 0.0 };
                fan.fan.set_driven(now_ns, driven);
            } else {
                fan.fan.advance(now_ns);
            }
            self.lines_changed |= fan.fan.tacho() != before;
        }
        let airflow = self.fans.iter_mut().find(|fan| fan.name == "part").map_or(0.0, |fan| fan.fan.airflow(now_ns));
        let rail = self.motor_rail.power_scale(now_ns);
        self.filament.follow(self.motion.motor_mm(EXTRUDER));
        for place in &mut self.heaters {
            if place.name.starts_with("nozzle") {
                place.heater.set_fan(now_ns, airflow);
            }
            if place.name == "nozzle" && self.filament_j_per_k_mm > 0.0 {
                place.heater.set_filament(now_ns, self.filament.mm_per_s * self.filament_j_per_k_mm);
            }
            if place.power > 0.0 {
                place.last_on_ns = Some(now_ns);
                place.heater.set_power_scale(now_ns, place.power * rail);
            }
            if place.heater.is_stuck_on() {
                place.heater.set_power_scale(now_ns, rail);
            }
        }
        true
    }

    /// The next event that the chip may see, ns.
    #[must_use]
    pub fn next_event_ns(&self) -> Option<u64> {
        let drivers = self.drivers.iter().filter_map(Tmc2209::next_event_ns);
        let wires = self.wires.iter().filter_map(Wire::next_event_ns);
        let probe = self.bltouch.as_ref().and_then(BlTouch::next_event_ns);
        let rest =
            [self.motion.next_event_ns(), self.motor_rail.next_event_ns(), self.chip_rail.next_event_ns(), probe];
        drivers.chain(wires).chain(rest.into_iter().flatten()).min()
    }

    /// The voltages at the converters' pins now, mV.
    pub fn voltages(&mut self, now_ns: u64) -> Vec<(Adc, u32)> {
        let mut voltages = Vec::with_capacity(self.thermistors.len());
        // The pull-ups are connected to the converter's reference, so both sag together.
        let reference = self.chip_rail.millivolts(now_ns) / REFERENCE_MV;
        for place in &mut self.thermistors {
            let celsius = match place.heater.and_then(|heater| self.heaters.get_mut(heater)) {
                Some(heater) => heater.heater.sensor_celsius(now_ns),
                None => self.ambient_celsius,
            };
            let millivolts = place.thermistor.millivolts(now_ns, celsius, self.ambient_celsius);
            voltages.push((place.adc, (millivolts * reference).round() as u32));
        }
        voltages
    }

    /// Switches what the chip's supply feeds besides the chip.
    pub fn power_logic(&mut self, now_ns: u64, powered: bool) {
        if let Some(eeprom) = &mut self.eeprom {
            eeprom.chip.set_power(now_ns, powered);
            self.lines_changed = true;
        }
    }

    /// Breaks or mends a driver and passes the change of its outputs to the motor.
    pub fn disturb_driver(&mut self, now_ns: u64, motor: usize, change: impl FnOnce(&mut Tmc2209)) {
        if let Some(driver) = self.drivers.get_mut(motor) {
            change(driver);
            self.energize(now_ns, motor);
            self.lines_changed = true;
        }
    }

    /// The air's temperature, degrees Celsius.
    #[must_use]
    pub fn ambient_celsius(&self) -> f64 {
        self.ambient_celsius
    }
}
