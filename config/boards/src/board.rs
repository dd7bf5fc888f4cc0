//! A board as its file describes it, every value checked.

use ferrostep_hal_shim::{FanOutput, SpareConnector};
use ferrostep_printer::{FanRule, PowerSupply, Profile};

use crate::chip::Chip;
use crate::clock::Clock;
use crate::pin::Pin;
use crate::signals::AnalogueChannel;

/// A motor driver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Driver {
    /// No driver.
    None,
    /// A socket for a driver module.
    Socket,
    /// Allegro A4988.
    A4988,
    /// Texas Instruments DRV8825.
    Drv8825,
    /// Trinamic TMC2130.
    Tmc2130,
    /// Trinamic TMC2208.
    Tmc2208,
    /// Trinamic TMC2209.
    Tmc2209,
    /// Trinamic TMC5160.
    Tmc5160,
}

impl Driver {
    /// All drivers by the words that a board's file has for them.
    pub const ALL: [(&'static str, Self); 8] = [
        ("none", Self::None),
        ("socket", Self::Socket),
        ("a4988", Self::A4988),
        ("drv8825", Self::Drv8825),
        ("tmc2130", Self::Tmc2130),
        ("tmc2208", Self::Tmc2208),
        ("tmc2209", Self::Tmc2209),
        ("tmc5160", Self::Tmc5160),
    ];
}

/// A board.
#[derive(Clone, Debug, PartialEq)]
pub struct Board {
    /// The board's name in commands and errors.
    pub name: String,
    /// Maker's name for the board.
    pub title: String,
    /// The board's chip.
    pub chip: Chip,
    /// Frequency of its crystal, Hz.
    pub crystal_hz: u32,
    /// The clock from the crystal.
    pub clock: Clock,
    /// The clock from the internal oscillator, for a crystal that does not start.
    pub internal_clock: Clock,
    /// Flash, KiB.
    pub flash_kib: u32,
    /// RAM that everything can reach, KiB.
    pub ram_kib: u32,
    /// Core-coupled memory, KiB.
    pub ccm_kib: u32,
    /// Start of the image, bytes from the start of flash.
    pub boot_offset: u32,
    /// File name that the boot loader expects: plain bytes (`.bin`), or Prusa's container (`.bbf`).
    pub boot_file: Option<String>,
    /// The profile of an image that is built without another.
    pub profile: String,
    /// X (A), Y (B), Z, E.
    pub motors: [Motor; 4],
    /// Sockets of the board that no axis uses.
    pub spare_motors: Vec<Motor>,
    /// The pin of the line that drivers share.
    pub driver_uart: Option<Pin>,
    /// Heaters.
    pub heaters: Vec<Heater>,
    /// Fans.
    pub fans: Vec<Fan>,
    /// Thermistors.
    pub thermistors: Vec<Thermistor>,
    /// End stops (`x`, `y`, `z`), `probe`, `filament`, `filament2`, `power_loss`, `button`.
    pub inputs: Vec<(&'static str, Pin)>,
    /// Transmitter and receiver of the host's line, USART1.
    pub serial: [Pin; 2],
    /// USB, minus and plus.
    pub usb: Option<[Pin; 2]>,
    /// The slot for a memory card.
    pub card: Option<CardSlot>,
    /// The plug for an accelerometer.
    pub accelerometer: Option<Accelerometer>,
    /// The EEPROM that settings are kept in.
    pub eeprom: Option<Eeprom>,
    /// The output that switches the power supply.
    pub power_supply: Option<Pin>,
    /// The output for a servo.
    pub servo: Option<Pin>,
    /// The same, if the machine's probe has a pin that it moves ([`Self::for_machine`]).
    pub used_servo: Option<Pin>,
    /// Fans and other outputs that the safe state sets, and whether they are on then.
    pub safe_outputs: Vec<(Pin, bool)>,
    /// The supply output with the settings of the machine's profile; `None` if the profile does not
    /// use it ([`Self::for_machine`]).
    pub used_supply: Option<SupplyOutput>,
    /// Connectors of the machine's chamber: its thermistor, and its heater if it has one.
    pub used_chamber: Option<(SpareConnector, Option<SpareConnector>)>,
    /// Further motors that lift the machine's Z, and whether each runs the other way round than the
    /// axis's own ([`Self::for_machine`]).
    pub further_z: Vec<(Motor, bool)>,
    /// The motors of the extruders of further tools, and whether each runs the other way round than
    /// E's own ([`Self::for_machine`]).
    pub further_e: Vec<(Motor, bool)>,
    /// Connectors of a further tool's nozzle: its thermistor and its heater.
    pub used_nozzle: Option<(SpareConnector, SpareConnector)>,
    /// Notes on the board for its users, one sentence each.
    pub notes: Vec<String>,
}

/// The output that switches the power supply of a machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SupplyOutput {
    /// The pin.
    pub pin: Pin,
    /// The profile's settings of it.
    pub settings: PowerSupply,
}

/// The slot for a memory card, at the SDIO.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CardSlot {
    /// Clock, command, four data lines.
    pub lines: [Pin; 6],
    /// Low while a card is in it.
    pub detect: Option<Pin>,
}

/// An accelerometer's type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AccelerometerChip {
    /// Analog Devices ADXL345.
    Adxl345,
}

impl AccelerometerChip {
    /// All types by the words that a board's file has for them.
    pub const ALL: [(&'static str, Self); 1] = [("adxl345", Self::Adxl345)];
}

/// An accelerometer on four wires (SPI).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Accelerometer {
    /// The accelerometer's type.
    pub chip: AccelerometerChip,
    /// The clock.
    pub sck: Pin,
    /// Data from the chip.
    pub miso: Pin,
    /// Data to the chip.
    pub mosi: Pin,
    /// Low while the chip is asked.
    pub cs: Pin,
}

/// An EEPROM's type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EepromChip {
    /// 24C32 of any maker: 4 KiB in pages of 32 bytes, two bytes of address.
    C24c32,
}

impl EepromChip {
    /// All types by the words that a board's file has for them.
    pub const ALL: [(&'static str, Self); 1] = [("24c32", Self::C24c32)];
}

/// An EEPROM on two wires (I2C).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Eeprom {
    /// The EEPROM's type.
    pub chip: EepromChip,
    /// The clock.
    pub scl: Pin,
    /// Data, both ways.
    pub sda: Pin,
    /// The EEPROM's address on the bus, 7 bits.
    pub address: u8,
}

/// A motor's pins.
#[derive(Clone, Debug, PartialEq)]
pub struct Motor {
    /// The motor's name in the file.
    pub name: &'static str,
    /// A step is its edge.
    pub step: Pin,
    /// High = backwards.
    pub direction: Pin,
    /// Low = on.
    pub enable: Pin,
    /// The driver's stall signal.
    pub diag: Option<Pin>,
    /// The driver.
    pub driver: Driver,
    /// The serial line to the driver.
    pub uart: Option<DriverUart>,
    /// Sense resistors, ohm.
    pub sense_resistor_ohm: Option<f64>,
}

/// The serial line to a driver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DriverUart {
    /// A line that only this driver uses (or the chip-select of that socket).
    Pin(Pin),
    /// The driver's address on the shared line, 0 to 3.
    Address(u8),
}

/// A heater's pins.
#[derive(Clone, Debug, PartialEq)]
pub struct Heater {
    /// Name of the heated part.
    pub name: &'static str,
    /// High = on.
    pub pin: Pin,
    /// The timer channel that can switch it.
    pub timer: Option<String>,
    /// Name of the thermistor that watches it.
    pub sensor: String,
}

/// A fan's pins.
#[derive(Clone, Debug, PartialEq)]
pub struct Fan {
    /// The fan's name in the file.
    pub name: &'static str,
    /// High = on.
    pub pin: Pin,
    /// The timer channel that can switch it.
    pub timer: Option<String>,
    /// The tachometer's pin: two pulses a turn.
    pub tacho: Option<Pin>,
}

/// A thermistor.
#[derive(Clone, Debug, PartialEq)]
pub struct Thermistor {
    /// Name of the measured part.
    pub name: &'static str,
    /// The thermistor's pin.
    pub pin: Pin,
    /// The converter's channel at that pin.
    pub channel: AnalogueChannel,
    /// The type, if the board has it soldered on or prescribes it.
    pub kind: Option<String>,
    /// Resistor to the converter's reference, ohm.
    pub pull_up_ohm: f64,
}

impl Board {
    /// The motors that move: X (A), Y (B), Z, E, the further ones of Z, and those of
    /// further extruders.
    pub fn moving_motors(&self) -> impl Iterator<Item = &Motor> {
        self.motors.iter().chain(self.further_z.iter().chain(&self.further_e).map(|(motor, _)| motor))
    }

    /// The motors of a profile's further extruders that the board has, and whether each runs the
    /// other way round than E's own.
    pub(crate) fn further_extruders(&self, profile: &Profile) -> Vec<(&Motor, bool)> {
        let further = profile.tools.into_iter().flat_map(|tools| tools.0.further).flatten();
        self.spare(profile, 3, further.map(|tool| (tool.socket, tool.is_inverted)))
    }

    /// The further motors of a profile's Z that the board has.
    pub(crate) fn further_motors(&self, profile: &Profile) -> Vec<(&Motor, bool)> {
        let further = profile.z_motors.into_iter().flat_map(|motors| motors.0.further).flatten();
        self.spare(profile, 2, further.map(|motor| (motor.socket, motor.is_inverted)))
    }

    /// Motors in these sockets that the board has, selected by the profile's settings, and whether
    /// each runs the other way round than motor `own`.
    fn spare(
        &self,
        profile: &Profile,
        own: usize,
        sockets: impl Iterator<Item = (&'static str, bool)>,
    ) -> Vec<(&Motor, bool)> {
        let own_is_inverted = profile.driver.inverted >> own & 1 == 1;
        let motor = |(socket, is_inverted): (&'static str, bool)| {
            let motor = self.spare_motors.iter().find(|motor| motor.name == socket)?;
            Some((motor, is_inverted != own_is_inverted))
        };
        sockets.filter_map(motor).collect()
    }

    /// All motors, those first that move.
    pub fn all_motors(&self) -> impl Iterator<Item = &Motor> {
        self.motors.iter().chain(&self.spare_motors)
    }

    /// The same board in the machine of this profile.
    pub fn for_machine(self, profile: &Profile) -> Self {
        let used = self.power_supply.zip(profile.power_supply);
        let of_profile = |fan: &Fan| {
            let output = FanOutput::ALL.into_iter().find(|output| output.name() == fan.name)?;
            match profile.fans.get(output.index()).copied().flatten()?.rule {
                // Half a power takes a timer.
                FanRule::Output { at_halt, .. } => Some((fan.pin, at_halt > u8::MAX / 2)),
                _ => None,
            }
        };
        let safe_outputs =
            self.fans.iter().filter_map(|fan| of_profile(fan).or_else(|| blows_when_safe(fan))).collect();
        let used_chamber = profile.chamber.map(|chamber| (chamber.thermistor, chamber.heater));
        let used_servo = self.servo.filter(|_| profile.bltouch.is_some());
        let used_supply = used.map(|(pin, settings)| SupplyOutput { pin, settings });
        let further = self.further_motors(profile).into_iter();
        let further_z = further.map(|(motor, is_inverted)| (motor.clone(), is_inverted)).collect();
        let further = self.further_extruders(profile).into_iter();
        let further_e = further.map(|(motor, is_inverted)| (motor.clone(), is_inverted)).collect();
        let used_nozzle = profile.tool_heater().map(|tool| (tool.thermistor, tool.heater));
        Self { used_supply, used_chamber, used_nozzle, used_servo, safe_outputs, further_z, further_e, ..self }
    }

    /// Ports that carry step and direction signals of the motors that move, in the order
    /// of the alphabet.
    pub fn motor_ports(&self) -> Vec<u8> {
        let mut ports: Vec<u8> =
            self.moving_motors().flat_map(|motor| [motor.step.port, motor.direction.port]).collect();
        ports.sort_unstable();
        ports.dedup();
        ports
    }

    /// The same board with its image at another place, without its boot loader, which would not
    /// find the image there.
    ///
    /// # Errors
    /// `offset`, bytes from the start of flash, is neither the board's own nor the beginning of a
    /// flash sector in the first half of the flash.
    pub fn at_boot_offset(self, offset: u32) -> Result<Self, String> {
        if offset == self.boot_offset {
            return Ok(self);
        }
        if !self.chip.is_sector_boundary(offset) || offset > self.flash_kib * 512 {
            return Err(format!(
                "--boot-offset {offset:#x}: expected {:#x}, the board's own, or {SECTORS} up to {:#x}, half of the flash",
                self.boot_offset,
                self.flash_kib * 512
            ));
        }
        Ok(Self { boot_offset: offset, boot_file: None, ..self })
    }

    /// Returns true if the boot loader takes Prusa's container (`.bbf`).
    pub fn takes_bbf(&self) -> bool {
        self.boot_file.as_deref().is_some_and(|name| name.ends_with(BBF_SUFFIX))
    }

    /// Flash at its end that the image leaves to settings (M500), bytes: the last two sectors
    /// of a chip of 1 MiB. Smaller ones have no two sectors to spare, and a board with an
    /// EEPROM needs none.
    pub fn settings_bytes(&self) -> u32 {
        if self.flash_kib >= 1024 && self.eeprom.is_none() { 2 * SECTOR_BYTES } else { 0 }
    }

    /// Flash that the image may take, bytes.
    pub fn image_room(&self) -> u32 {
        (self.flash_kib * 1024).saturating_sub(self.boot_offset).saturating_sub(self.settings_bytes())
    }

    /// Address of the image in flash.
    pub fn image_address(&self) -> u32 {
        FLASH_ADDRESS + self.boot_offset
    }
}

/// A fan that the safe state lets blow: those of part and nozzle, where the profile does not use
/// its output otherwise.
pub(crate) fn blows_when_safe(fan: &Fan) -> Option<(Pin, bool)> {
    ["part", "hotend"].contains(&fan.name).then_some((fan.pin, true))
}

/// Length of the sectors at the end of a flash, bytes (RM0090, table 5).
const SECTOR_BYTES: u32 = 128 * 1024;

/// Ending of the name of a file in Prusa's container.
pub const BBF_SUFFIX: &str = ".bbf";

/// Bytes of flash that the container's header takes before the image, from the
/// beginning of a sector on.
pub const BBF_HEADER_BYTES: u32 = 512;

/// The boundaries of flash sectors in words, for errors.
pub(crate) const SECTORS: &str =
    "the beginning of a flash sector (0, 0x4000, 0x8000, 0xc000, 0x10000 or a multiple of 0x20000)";

/// First address of flash.
pub const FLASH_ADDRESS: u32 = 0x0800_0000;

/// First address of RAM.
pub const RAM_ADDRESS: u32 = 0x2000_0000;

/// First address of core-coupled memory.
pub const CCM_ADDRESS: u32 = 0x1000_0000;
