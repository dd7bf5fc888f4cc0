//! The board that this crate is built for: its file (`config/boards/`) as constants and as register
//! stores.

use ferrostep_step_player::{MotorPins, Pin, PinMap, StepLink};
use ferrostep_stm32f4::sensor_lines::{SensorLines, SensorPin};
use ferrostep_stm32f4::{ChipFamily, I2cPins, SpiPins, ThermalPins};

use crate::handlers::complete_stores;
use crate::motor_ports::{MotorPort, MotorPorts, Motors};
use crate::motor_stop::stop_at_sensor;
use crate::pac::{GPIOA, GPIOB, GPIOC, GPIOD, GPIOE, GPIOF, GPIOG};
use crate::stores;
pub use crate::stores::Store;
use crate::volatile::Volatile;

include!(concat!(env!("OUT_DIR"), "/board.rs"));

/// The motors' step and direction pins. A port's index is its place in [`MOTOR_PORT_INDICES`].
pub const PIN_MAP: PinMap<MOTOR_PORTS> = {
    let mut map = PinMap::new(MOTORS);
    let mut index = 0;
    while index < FURTHER_Z.len() {
        let (pins, is_inverted) = FURTHER_Z[index];
        map = match map {
            Some(map) => map.with_further(Z, pins, is_inverted),
            None => None,
        };
        index += 1;
    }
    index = 0;
    while index < FURTHER_E.len() {
        let (pins, is_inverted) = FURTHER_E[index];
        map = match map {
            Some(map) => map.with_further(E, pins, is_inverted),
            None => None,
        };
        index += 1;
    }
    match map {
        Some(map) => map,
        None => panic!("a port has 16 pins"),
    }
};

/// Index of Z's motor.
const Z: usize = 2;

/// Index of the extruder's motor.
const E: usize = 3;

/// The axis that a motor drives: further motors lift Z, the last ones are extruders.
const fn axis_of(motor: usize) -> usize {
    if motor < MOTORS.len() {
        motor
    } else if motor < MOTORS.len() + FURTHER_Z.len() {
        Z
    } else {
        E
    }
}

/// The step pin of one of Z's motors; the first is the axis's own.
fn z_step_pin(motor: usize) -> Option<Pin> {
    let further = motor.checked_sub(1).map(|further| FURTHER_Z.get(further).map(|(pins, _)| pins.step));
    further.unwrap_or_else(|| MOTORS.get(Z).map(|pins| pins.step))
}

/// The step pin of a tool's extruder.
fn extruder_step_pin(tool: usize) -> Option<Pin> {
    let further = tool.checked_sub(1).map(|further| FURTHER_E.get(further).map(|(pins, _)| pins.step));
    further.unwrap_or_else(|| MOTORS.get(E).map(|pins| pins.step))
}

/// Shift to the upper half of BSRR, which resets the pins that the lower half sets.
const RESET_SHIFT: u32 = 16;

/// All ports on which a board may have pins.
pub type Ports = (GPIOA, GPIOB, GPIOC, GPIOD, GPIOE, GPIOF, GPIOG);

/// The board's signals. A copy refers to the same pins.
#[derive(Clone, Copy)]
pub struct BoardPins {
    sensors: SensorLines,
}

impl BoardPins {
    /// Sets up the pins: heaters and fans off, drivers off, thermistors and the serial line
    /// connected, homing sensors as inputs (by the stores of [`SensorLines::start`]).
    pub fn new(_ports: Ports, sensors: [Option<SensorPin>; 3], set_up: &[Store]) -> Self {
        // SAFETY: stores to ports that are this module's from now on, and of pins that the board's
        // file gives to motors, fans, thermistors and the serial line;
        // `config/boards/src/registers.rs` makes and tests them.
        unsafe { stores::apply(&PINS) };
        // SAFETY: pins that the board's file gives to sensors, and the EXTI, which no other code
        // has; `hal-shim/stm32f4/src/sensor_lines.rs` makes the stores and tests them.
        unsafe { stores::apply(set_up) };
        Self { sensors: SensorLines::started(sensors) }
    }

    /// The interrupt of a sensor's line: motion stops if the sensor that an axis
    /// seeks has triggered.
    // Seven interrupts call it.
    #[inline(never)]
    pub fn sensed(&self, link: &StepLink) {
        // SAFETY: opening and closing lines stores whole registers.
        let mut registers = unsafe { Volatile::new() };
        if self.sensors.interrupt(&mut registers) {
            stop_at_sensor(link);
        }
        complete_stores();
    }
}

/// Returns true if a sensor that no axis homes with is triggered. [`BoardPins::new`] has set up its
/// pin.
pub fn is_triggered(pin: SensorPin) -> bool {
    // SAFETY: a port is only read.
    pin.is_triggered(&mut unsafe { Volatile::new() })
}

impl Motors<MOTOR_PORTS> for BoardPins {
    const FOLLOWS_FILAMENT: bool = cfg!(follows_filament);
    const HAS_FILAMENT_SWITCH: bool = cfg!(filament_switch);

    const Z_MOTORS: usize = FURTHER_Z.len() + 1;

    fn z_step_pin(motor: usize) -> Option<Pin> {
        z_step_pin(motor)
    }

    const EXTRUDERS: usize = FURTHER_E.len() + 1;

    fn extruder_step_pin(tool: usize) -> Option<Pin> {
        extruder_step_pin(tool)
    }

    fn is_sensor_triggered(&self, axis: usize) -> bool {
        // SAFETY: a port is only read.
        self.sensors.is_triggered(axis, &mut unsafe { Volatile::new() })
    }

    fn watch_sensor(&self, axis: Option<usize>) {
        // SAFETY: whole registers of the EXTI, which only the lines' interrupt writes besides.
        let mut registers = unsafe { Volatile::new() };
        match axis {
            Some(axis) => self.sensors.open(axis, &mut registers),
            None => self.sensors.close(&mut registers),
        }
    }

    fn ports(&self) -> MotorPorts<MOTOR_PORTS> {
        // SAFETY: the ports that the motors are on, which no other code has.
        MotorPorts(MOTOR_PORT_INDICES.map(|port| unsafe { MotorPort::of(port) }))
    }

    fn enable(&self, on: u8) {
        for (motor, &pin) in ENABLE.iter().enumerate() {
            let shares = |other: &usize| ENABLE.get(*other) == Some(&pin);
            // Motors that share a pin are switched with the first of them.
            if (0..motor).any(|other| shares(&other)) {
                continue;
            }
            let is_on = (motor..ENABLE.len()).filter(shares).any(|other| on >> axis_of(other) & 1 == 1);
            let (port, number) = pin;
            let bit = 1 << number;
            // SAFETY: an enable pin's port.
            unsafe { MotorPort::of(port) }.write(if is_on { bit << RESET_SHIFT } else { bit });
        }
    }
}

/// Switches everything off, for the panic and fault handlers: heaters off, then motors off, then
/// fans full on and the USB port off the bus.
pub(crate) fn all_off() {
    // SAFETY: pins of heaters, motors and fans, and the USB controller: all states are allowed; no
    // other code runs any more.
    unsafe { stores::apply(&ALL_OFF) };
}
