//! Checks that a board has all that a profile needs.

use ferrostep_checked_toml::FileError;
use ferrostep_hal_shim::{FanOutput, SpareConnector};
use ferrostep_printer::{
    ChamberSettings, FanRule, FanSettings, FilamentSensor, FilamentSensorKind, HeaterSettings, HomeSensor, Profile,
    ToolHeater,
};
use ferrostep_profiles::refuse;
use ferrostep_thermistor::ThermistorType;
use ferrostep_tmc2209::{CurrentScale, DriverSettings, DriverWiring, SECOND_EXTRUDER};

use crate::board::{Board, Driver, DriverUart, Motor, Thermistor};
use crate::pin::Pin;

impl Driver {
    /// Shortest step pulse that it counts, ns, where its data sheet says (STEP high and low time;
    /// A4988 and TMC5160: timing tables; DRV8825: 7.6; TMC2130, 2208, 2209: STEP/DIR interface).
    const fn shortest_pulse_ns(self) -> u32 {
        match self {
            Self::None | Self::Socket => 0,
            Self::A4988 => 1_000,
            Self::Drv8825 => 1_900,
            Self::Tmc2130 | Self::Tmc2208 | Self::Tmc2209 | Self::Tmc5160 => 100,
        }
    }
}

/// Maximum number of ports that step and direction signals may be on: an event costs the step
/// interrupt a store for each.
const MOST_PORTS: usize = 4;

/// The axes that home.
const AXES: [&str; 3] = ["x", "y", "z"];

/// The pins of the sensors that a profile's axes home with, and whether they are low when they
/// trigger; `None` where the board has no such sensor.
pub fn sensor_pins(board: &Board, profile: &Profile) -> [Option<(Pin, bool)>; 3] {
    let input = |name: &str| board.inputs.iter().find(|(input, _)| *input == name).map(|(_, pin)| *pin);
    let mut sensors = AXES.into_iter().zip(profile.homing.iter().zip(&board.motors)).map(|(axis, (homing, motor))| {
        let pin = match homing.sensor {
            HomeSensor::Probe => input("probe"),
            HomeSensor::EndStop => input(axis),
            // A socket's stall signal is at its end stop's pin, by a jumper.
            HomeSensor::Stall => motor.diag.or_else(|| input(axis).filter(|_| motor.driver == Driver::Socket)),
        };
        pin.map(|pin| (pin, homing.triggers_low))
    });
    std::array::from_fn(|_| sensors.next().flatten())
}

/// The pin of the profile's filament sensor, and whether it is low while filament is missing (an
/// encoder has no such level); `None` without such a sensor or such an input.
pub fn filament_pin(board: &Board, profile: &Profile) -> Option<(Pin, bool)> {
    filament_input(board, "filament", profile.filament_sensor)
}

/// The same of the switch beside a sensor that sees filament move.
pub fn filament_switch_pin(board: &Board, profile: &Profile) -> Option<(Pin, bool)> {
    filament_input(board, "filament2", profile.filament_switch)
}

fn filament_input(board: &Board, name: &str, sensor: Option<FilamentSensor>) -> Option<(Pin, bool)> {
    let pin = board.inputs.iter().find(|(input, _)| *input == name).map(|(_, pin)| *pin);
    let is_low = |sensor: FilamentSensor| sensor.kind != FilamentSensorKind::Switch { missing_is_low: false };
    pin.zip(sensor.map(is_low))
}

/// The pin of the profile's signal that the supply fails, and whether it is low then; `None`
/// without such a signal or such an input.
pub fn power_loss_pin(board: &Board, profile: &Profile) -> Option<(Pin, bool)> {
    let pin = board.inputs.iter().find(|(input, _)| *input == "power_loss").map(|(_, pin)| *pin);
    pin.zip(profile.supply_signal.map(|signal| signal.failing_is_low))
}

/// The pin of the board's button, which connects it to ground.
pub fn button_pin(board: &Board) -> Option<(Pin, bool)> {
    board.inputs.iter().find(|(input, _)| *input == "button").map(|(_, pin)| (*pin, true))
}

/// Sense resistors of a driver that is plugged in, ohm: those of the usual TMC2209 modules.
const USUAL_SENSE_OHM: f64 = 0.11;

fn milliohm(ohm: f64) -> u16 {
    (ohm * 1000.0).round() as u16
}

/// Returns true if the board has a line to a driver that may be a TMC2209.
fn can_be_set(motor: &Motor) -> bool {
    matches!(motor.driver, Driver::Tmc2209 | Driver::Socket) && motor.uart.is_some()
}

/// The motors that move, each with the settings of its driver: of the further motors of Z those of
/// Z. The motor of a second extruder has a fixed place, before which there may be none.
pub(crate) fn driven<'a>(board: &'a Board, profile: &Profile) -> Vec<Option<(&'a Motor, Option<DriverSettings>)>> {
    let [.., of_z, _] = profile.drivers;
    let further = board.further_motors(profile).into_iter().map(|(motor, _)| (motor, of_z));
    let mut driven: Vec<_> = board.motors.iter().zip(profile.drivers).chain(further).map(Some).collect();
    let of_tool = profile.tools.and_then(|tools| tools.0.get(1)?.driver);
    for (motor, _) in board.further_extruders(profile) {
        driven.resize(SECOND_EXTRUDER, None);
        driven.push(Some((motor, of_tool)));
    }
    driven
}

/// Wiring of the drivers that a profile sets: X, Y, Z, E and the further ones of Z; `None` for a
/// driver that the profile does not set or the board cannot.
pub fn wiring(board: &Board, profile: &Profile) -> Vec<Option<DriverWiring>> {
    let wired = |(index, driven): (usize, Option<(&Motor, Option<DriverSettings>)>)| {
        let (motor, settings) = driven?;
        settings?;
        let (line, address) = match motor.uart.filter(|_| can_be_set(motor))? {
            DriverUart::Address(address) => (0, address),
            // A socket's pins for the address are grounded.
            DriverUart::Pin(_) => (index as u8, 0),
        };
        let sense_milliohm = milliohm(motor.sense_resistor_ohm.unwrap_or(USUAL_SENSE_OHM));
        Some(DriverWiring { line, address, sense_milliohm })
    };
    driven(board, profile).into_iter().enumerate().map(wired).collect()
}

/// The further motors of the profile's Z are the board's, and the step interrupt reaches
/// all pins in time.
fn check_z_motors(board: &Board, profile: &Profile, profile_name: &str) -> Result<(), FileError> {
    for motor in profile.z_motors.into_iter().flat_map(|motors| motors.0.further).flatten() {
        if !board.spare_motors.iter().any(|spare| spare.name == motor.socket) {
            let there: Vec<&str> = board.spare_motors.iter().map(|motor| motor.name).collect();
            let expected = match there.is_empty() {
                true => format!("no table [z_motors]: the board {} has no motors to spare", board.name),
                false => format!("motors of the board {}: z, {}", board.name, there.join(", ")),
            };
            return Err(refuse(profile_name, &format!("z_motors.motors.{}", motor.socket), "a table", &expected));
        }
    }
    let ports = board.clone().for_machine(profile).motor_ports();
    if ports.len() > MOST_PORTS {
        let letters: Vec<String> = ports.iter().map(|port| char::from(b'A' + port).to_string()).collect();
        let expected = format!(
            "motors of the board {} whose step and direction signals are on {MOST_PORTS} ports at most, not on {}",
            board.name,
            letters.join(", ")
        );
        let key = if profile.z_motors.is_some() { "z_motors.motors" } else { "tools.t1.motor" };
        return Err(refuse(profile_name, key, "a table", &expected));
    }
    Ok(())
}

/// The motors of further extruders are the board's.
fn check_extruders(board: &Board, profile: &Profile, profile_name: &str) -> Result<(), FileError> {
    for tool in profile.tools.into_iter().flat_map(|tools| tools.0.further).flatten() {
        if !board.spare_motors.iter().any(|spare| spare.name == tool.socket) {
            let there: Vec<&str> = board.spare_motors.iter().map(|motor| motor.name).collect();
            let expected = match there.is_empty() {
                true => format!("no table [tools]: the board {} has no motors to spare", board.name),
                false => format!("a motor of the board {}: {}", board.name, there.join(", ")),
            };
            return Err(refuse(profile_name, "tools.t1.motor", tool.socket, &expected));
        }
    }
    Ok(())
}

/// The table of a motor's settings.
fn settings_of(board: &Board, profile: &Profile, motor: &Motor) -> String {
    let is_extruder = board.further_extruders(profile).iter().any(|(extruder, _)| *extruder == motor);
    let of_z = if is_extruder { "tools.t1.driver" } else { "drivers.z" };
    if board.motors.contains(motor) { format!("drivers.{}", motor.name) } else { of_z.to_owned() }
}

/// Compares a profile with the board.
///
/// # Errors
/// The board lacks something that the profile needs; the error names the profile's key and line.
pub fn check(board: &Board, profile: &Profile, profile_name: &str) -> Result<(), FileError> {
    check_z_motors(board, profile, profile_name)?;
    check_extruders(board, profile, profile_name)?;
    for (motor, settings) in driven(board, profile).into_iter().flatten() {
        let driver = format!("{:?}", motor.driver).to_lowercase();
        // A driver steps at both edges only if its bit `dedge` is set over its serial line.
        let is_told = settings.is_some() && can_be_set(motor);
        if profile.driver.both_edges && motor.driver != Driver::None && !is_told {
            let expected = format!(
                "false: motors.{} of the board {} is driven by a {driver}, which steps at rising edges unless it is a \
                 tmc2209 with a line and a table [{}]",
                motor.name,
                board.name,
                settings_of(board, profile, motor)
            );
            return Err(refuse(profile_name, "driver.both_edges", "true", &expected));
        }
        let shortest_ns = motor.driver.shortest_pulse_ns();
        if profile.driver.pulse_width_ns < shortest_ns {
            let [shortest_us, us] = [shortest_ns, profile.driver.pulse_width_ns].map(|ns| f64::from(ns) / 1e3);
            let expected = format!("at least {shortest_us} us for the {driver} of the board {}", board.name);
            return Err(refuse(profile_name, "driver.pulse_width_us", &us.to_string(), &expected));
        }
        // A driver's current is measured at the board's resistors.
        let ohm = motor.sense_resistor_ohm.unwrap_or(USUAL_SENSE_OHM);
        if let Some(settings) = settings
            && can_be_set(motor)
            && let Err(error) = CurrentScale::from_ma(settings.current_ma, milliohm(ohm))
        {
            let key = format!("{}.current_ma", settings_of(board, profile, motor));
            let (least, most) = (error.least_ma, error.most_ma);
            let expected = format!("{least} to {most} mA at the {ohm} ohm of the board {}", board.name);
            return Err(refuse(profile_name, &key, &settings.current_ma.to_string(), &expected));
        }
    }
    if !board.heaters.is_empty() {
        for (name, settings) in [("nozzle", &profile.nozzle), ("bed", &profile.bed)] {
            check_heater(board, name, settings, profile_name)?;
        }
    }
    check_chamber(board, profile, profile_name)?;
    check_nozzle(board, profile, profile_name)?;
    check_fans(board, profile, profile_name)?;
    if profile.power_supply.is_some() && board.power_supply.is_none() {
        let expected = format!("no such table: the board {} has no output `power_supply`", board.name);
        return Err(refuse(profile_name, "power_supply", "a table", &expected));
    }
    if profile.bltouch.is_some() && board.servo.is_none() {
        let expected = format!("no such table: the board {} has no output `servo`", board.name);
        return Err(refuse(profile_name, "bltouch", "a table", &expected));
    }
    if profile.filament_sensor.is_some() && filament_pin(board, profile).is_none() {
        let expected = format!("no such table: the board {} has no input `filament`", board.name);
        return Err(refuse(profile_name, "filament_sensor", "a table", &expected));
    }
    if profile.filament_switch.is_some() && filament_switch_pin(board, profile).is_none() {
        let expected = format!("no such table: the board {} has no input `filament2`", board.name);
        return Err(refuse(profile_name, "filament_switch", "a table", &expected));
    }
    if profile.supply_signal.is_some() && power_loss_pin(board, profile).is_none() {
        let expected = format!("no such table: the board {} has no input `power_loss`", board.name);
        return Err(refuse(profile_name, "power_loss", "a table", &expected));
    }
    let pins = sensor_pins(board, profile);
    for (axis, (homing, pin)) in AXES.into_iter().zip(profile.homing.iter().zip(pins)) {
        if pin.is_none() {
            let word = match homing.sensor {
                HomeSensor::Probe => "\"probe\"",
                HomeSensor::EndStop => "\"end-stop\"",
                HomeSensor::Stall => "\"stall\"",
            };
            let inputs: Vec<&str> = board.inputs.iter().map(|(input, _)| *input).collect();
            let expected = format!("a sensor of the board {}, whose inputs are {}", board.name, inputs.join(", "));
            return Err(refuse(profile_name, &format!("homing.{axis}.sensor"), word, &expected));
        }
    }
    Ok(())
}

/// Each fan of the profile has its output, and its tachometer if it is to be looked at. The two
/// usual ones may be missing: M106 is refused then.
fn check_fans(board: &Board, profile: &Profile, profile_name: &str) -> Result<(), FileError> {
    for (output, (fan, usual)) in FanOutput::ALL.into_iter().zip(profile.fans.iter().zip(FanSettings::USUAL)) {
        let Some(settings) = fan.as_ref().filter(|_| *fan != usual) else { continue };
        let table = if matches!(settings.rule, FanRule::Output { .. }) { "outputs" } else { "fans" };
        let key = |key| format!("{table}.{}.{key}", settings.name);
        let Some(wired) = board.fans.iter().find(|wired| wired.name == output.name()) else {
            let outputs: Vec<&str> = board.fans.iter().map(|fan| fan.name).collect();
            let expected = format!("an output of the board {}: {}", board.name, outputs.join(", "));
            return Err(refuse(profile_name, &key("output"), output.name(), &expected));
        };
        if settings.least_rpm > 0 && wired.tacho.is_none() {
            let expected = format!("no such key: the board {} has no tachometer for {}", board.name, output.name());
            return Err(refuse(profile_name, &key("least_rpm"), &settings.least_rpm.to_string(), &expected));
        }
    }
    Ok(())
}

/// The word of boards and profiles for a type.
const fn type_name(kind: &ThermistorType) -> &'static str {
    match kind {
        ThermistorType::Semitec104Gt2 => "semitec-104gt-2",
        ThermistorType::Epcos100k => "epcos-100k",
        ThermistorType::Beta { .. } => "a beta",
        ThermistorType::ThreePoints { .. } => "three points",
        ThermistorType::Pt1000 => "pt1000",
    }
}

/// The chamber's thermistor and heater are the board's.
fn check_chamber(board: &Board, profile: &Profile, profile_name: &str) -> Result<(), FileError> {
    let Some(ChamberSettings { thermistor, heater, settings }) = &profile.chamber else { return Ok(()) };
    let refuse = |key: &str, value: &str, what: &str, names: Vec<&str>| {
        let there = names.iter().filter(|name| SpareConnector::THERMISTORS.iter().any(|spare| spare.name() == **name));
        let there: Vec<&str> = there.copied().collect();
        let expected = match there.is_empty() {
            true => format!("no table [chamber]: the board {} has no {what} to spare", board.name),
            false => format!("{what} of the board {}: {}", board.name, there.join(", ")),
        };
        Err(refuse(profile_name, &format!("chamber.{key}"), value, &expected))
    };
    let Some(input) = board.thermistors.iter().find(|input| input.name == thermistor.name()) else {
        let names = board.thermistors.iter().map(|input| input.name).collect();
        return refuse("thermistor", thermistor.name(), "input for a thermistor", names);
    };
    if let Some(heater) = heater
        && !board.heaters.iter().any(|output| output.name == heater.name())
    {
        let names = board.heaters.iter().map(|output| output.name).collect();
        return refuse("heater", heater.name(), "output for a heater", names);
    }
    check_thermistor(board, "chamber", input, settings, profile_name)
}

/// The thermistor and the heater of a further tool are the board's.
fn check_nozzle(board: &Board, profile: &Profile, profile_name: &str) -> Result<(), FileError> {
    let Some(ToolHeater { thermistor, heater, settings, .. }) = profile.tool_heater() else { return Ok(()) };
    let refuse = |key: &str, value: &str, what: &str, names: Vec<&str>| {
        let expected = format!("{what} of the board {}: {}", board.name, names.join(", "));
        Err(refuse(profile_name, &format!("tools.t1.{key}"), value, &expected))
    };
    let Some(input) = board.thermistors.iter().find(|input| input.name == thermistor.name()) else {
        let names = board.thermistors.iter().map(|input| input.name).collect();
        return refuse("thermistor", thermistor.name(), "an input for a thermistor", names);
    };
    if !board.heaters.iter().any(|output| output.name == heater.name()) {
        let names = board.heaters.iter().map(|output| output.name).collect();
        return refuse("heater", heater.name(), "an output for a heater", names);
    }
    check_thermistor(board, "tools.t1.nozzle", input, settings, profile_name)
}

/// A heater and its thermistor are the board's.
fn check_heater(board: &Board, name: &str, settings: &HeaterSettings, profile_name: &str) -> Result<(), FileError> {
    let refuse = |key: &str, value: &str, expected: String| {
        Err(refuse(profile_name, &format!("{name}.{key}"), value, &format!("{expected} of the board {}", board.name)))
    };
    let kind = format!("{:?}", type_name(&settings.thermistor.kind));
    let heater = board.heaters.iter().find(|heater| heater.name == name);
    let thermistor =
        heater.and_then(|heater| board.thermistors.iter().find(|thermistor| thermistor.name == heater.sensor));
    let Some(thermistor) = thermistor else {
        let heaters: Vec<&str> = board.heaters.iter().map(|heater| heater.name).collect();
        return refuse("sensor", &kind, format!("one of the heaters {}", heaters.join(", ")));
    };
    check_thermistor(board, name, thermistor, settings, profile_name)
}

/// A thermistor is of the kind that the board's input is for.
fn check_thermistor(
    board: &Board,
    name: &str,
    thermistor: &Thermistor,
    settings: &HeaterSettings,
    profile_name: &str,
) -> Result<(), FileError> {
    let refuse = |key: &str, value: &str, expected: String| {
        Err(refuse(profile_name, &format!("{name}.{key}"), value, &format!("{expected} of the board {}", board.name)))
    };
    let kind = format!("{:?}", type_name(&settings.thermistor.kind));
    if let Some(of_board) = &thermistor.kind
        && *of_board != type_name(&settings.thermistor.kind)
    {
        return refuse("sensor", &kind, format!("\"{of_board}\", the thermistor at the input {}", thermistor.name));
    }
    // The pull-up resistor is the board's; a profile for many boards may assume another.
    if f64::from(settings.thermistor.pull_up_ohm) != thermistor.pull_up_ohm {
        let ohm = settings.thermistor.pull_up_ohm.to_string();
        return refuse("pull_up_ohm", &ohm, format!("{} ohm, the resistor", thermistor.pull_up_ohm));
    }
    Ok(())
}
