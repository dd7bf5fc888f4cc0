//! The faults, by name.

use serde::Serialize;

use crate::parts::heat::HeaterFault;
use crate::parts::motion::end_stop::EndStopFault;
use crate::parts::motion::sheet::ProbeFault;

/// A heated block.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub enum Block {
    /// The hot end.
    Nozzle,
    /// The bed.
    Bed,
}

impl Block {
    /// Name of its heater and its thermistor in the board's file.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Nozzle => "nozzle",
            Self::Bed => "bed",
        }
    }
}

/// The course of a supply's fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SupplyFault {
    /// The voltage sinks, stays low for a while and returns.
    Sags,
    /// The supply fails for milliseconds.
    Dips,
    /// The supply is cut and stays off.
    Cut,
    /// The supply is cut and returns after a while.
    Returns,
}

/// The fault of a thermistor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ThermistorFault {
    /// The wire is broken.
    Open,
    /// The wires touch.
    Short,
    /// The thermistor is out of its hole.
    SlippedOut,
    /// The plug is loose.
    Loose,
    /// The reading's error grows by 10 kelvin a minute.
    Drifts,
}

/// The fault of a motor's driver.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DriverFault {
    /// The driver's own supply fails for some ms, so it loses its registers.
    Resets,
    /// The driver is too hot and switches its motor off.
    Hot,
    /// A motor's phase touches ground.
    Short,
    /// The driver neither receives nor sends.
    Mute,
}

/// Memory of the chip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Memory {
    /// Static variables and the stack.
    Ram,
    /// Core coupled memory.
    Ccm,
    /// The image in flash.
    Flash,
}

/// A fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// No fault: a sound run must pass every check.
    Control,
    /// The crystal stops oscillating.
    CrystalStops,
    /// The 24 V of motors and heaters; USB keeps supplying the chip.
    MotorSupply(SupplyFault),
    /// The chip's 3.3 V.
    ChipSupply(SupplyFault),
    /// The host falls silent and stays so.
    HostVanishes,
    /// Some bits to the chip arrive wrong for a while.
    HostLineGarbles,
    /// A thermistor.
    Thermistor(Block, ThermistorFault),
    /// A heater or its transistor.
    Heater(Block, HeaterFault),
    /// The converters lose their clock for good.
    ConverterStands,
    /// The converters are switched off once.
    ConverterHiccup,
    /// The DMA stream from the converters is switched off, and again within 0.5 ms if the
    /// firmware switches it on.
    TransferStands,
    /// The DMA stream from the converters ends once.
    TransferHiccup,
    /// A motor's driver.
    Driver(DriverFault),
    /// A switch at an axis's end.
    EndStop(EndStopFault),
    /// The probe at the nozzle.
    Probe(ProbeFault),
    /// A fan is blocked.
    FanStuck,
    /// A random bit of memory flips.
    Flip(Memory),
    /// The first instruction of an interrupt handler becomes a branch to itself.
    TaskHangs,
    /// A debugger halts the core.
    CoreHalted,
    /// An input toggles every few microseconds for a while.
    InputStorm,
}

/// All faults: name, fault, and share of a campaign's runs.
///
/// The shares follow cost and interest: bit flips are frequent, faults that take minutes of the
/// printer's time are rare.
pub const ALL: [(&str, Fault, u32); 45] = [
    ("control", Fault::Control, 10),
    ("crystal-stops", Fault::CrystalStops, 20),
    ("24v-sags", Fault::MotorSupply(SupplyFault::Sags), 10),
    ("24v-dips", Fault::MotorSupply(SupplyFault::Dips), 20),
    ("24v-cut", Fault::MotorSupply(SupplyFault::Cut), 15),
    ("24v-returns", Fault::MotorSupply(SupplyFault::Returns), 20),
    ("3v3-sags", Fault::ChipSupply(SupplyFault::Sags), 20),
    ("3v3-dips", Fault::ChipSupply(SupplyFault::Dips), 20),
    ("3v3-cut", Fault::ChipSupply(SupplyFault::Cut), 10),
    ("3v3-returns", Fault::ChipSupply(SupplyFault::Returns), 20),
    ("host-vanishes", Fault::HostVanishes, 4),
    ("host-line-garbles", Fault::HostLineGarbles, 20),
    ("nozzle-thermistor-open", Fault::Thermistor(Block::Nozzle, ThermistorFault::Open), 15),
    ("nozzle-thermistor-short", Fault::Thermistor(Block::Nozzle, ThermistorFault::Short), 15),
    ("nozzle-thermistor-slipped-out", Fault::Thermistor(Block::Nozzle, ThermistorFault::SlippedOut), 8),
    ("nozzle-thermistor-loose", Fault::Thermistor(Block::Nozzle, ThermistorFault::Loose), 10),
    ("nozzle-thermistor-drifts", Fault::Thermistor(Block::Nozzle, ThermistorFault::Drifts), 4),
    ("bed-thermistor-open", Fault::Thermistor(Block::Bed, ThermistorFault::Open), 15),
    ("bed-thermistor-short", Fault::Thermistor(Block::Bed, ThermistorFault::Short), 15),
    ("bed-thermistor-slipped-out", Fault::Thermistor(Block::Bed, ThermistorFault::SlippedOut), 3),
    ("bed-thermistor-loose", Fault::Thermistor(Block::Bed, ThermistorFault::Loose), 10),
    ("bed-thermistor-drifts", Fault::Thermistor(Block::Bed, ThermistorFault::Drifts), 4),
    ("nozzle-heater-broken", Fault::Heater(Block::Nozzle, HeaterFault::Broken), 6),
    ("nozzle-heater-stuck-on", Fault::Heater(Block::Nozzle, HeaterFault::StuckOn), 6),
    ("bed-heater-broken", Fault::Heater(Block::Bed, HeaterFault::Broken), 2),
    ("bed-heater-stuck-on", Fault::Heater(Block::Bed, HeaterFault::StuckOn), 2),
    ("converter-stands", Fault::ConverterStands, 20),
    ("converter-hiccup", Fault::ConverterHiccup, 20),
    ("transfer-stands", Fault::TransferStands, 20),
    ("transfer-hiccup", Fault::TransferHiccup, 20),
    ("driver-resets", Fault::Driver(DriverFault::Resets), 30),
    ("driver-hot", Fault::Driver(DriverFault::Hot), 15),
    ("driver-short", Fault::Driver(DriverFault::Short), 15),
    ("driver-mute", Fault::Driver(DriverFault::Mute), 15),
    ("end-stop-stuck-open", Fault::EndStop(EndStopFault::StuckOpen), 6),
    ("end-stop-stuck-closed", Fault::EndStop(EndStopFault::StuckClosed), 6),
    ("probe-dead", Fault::Probe(ProbeFault::Dead), 8),
    ("probe-always-on", Fault::Probe(ProbeFault::AlwaysOn), 8),
    ("fan-stuck", Fault::FanStuck, 5),
    ("ram-bit-flips", Fault::Flip(Memory::Ram), 220),
    ("ccm-bit-flips", Fault::Flip(Memory::Ccm), 20),
    ("flash-bit-flips", Fault::Flip(Memory::Flash), 120),
    ("task-hangs", Fault::TaskHangs, 60),
    ("core-halted", Fault::CoreHalted, 30),
    ("input-storm", Fault::InputStorm, 20),
];

impl Fault {
    /// The name.
    #[must_use]
    pub fn name(self) -> &'static str {
        ALL.into_iter().find(|(_, fault, _)| *fault == self).map_or("", |(name, ..)| name)
    }

    /// The fault of that name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        ALL.into_iter().find(|(other, ..)| *other == name).map(|(_, fault, _)| fault)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn every_fault_has_a_unique_name() {
        for (name, fault, share) in ALL.into_iter() {
            assert!(share > 0);
            assert_eq!(Fault::named(name).unwrap(), fault);
            assert_eq!(fault.name(), name);
        }
        assert_eq!(Fault::named("flood"), None);
    }
}
