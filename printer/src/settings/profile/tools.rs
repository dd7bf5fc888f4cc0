//! Several tools on one carriage, as a profile describes them: each with a motor for its filament,
//! and a nozzle or that of the first.

use ferrostep_hal_shim::{FanOutput, Heater, SpareConnector};
use ferrostep_planner::{PressureAdvance, StepsPerMm};
use ferrostep_tmc2209::DriverSettings;

use crate::heat::model::HeaterModel;
use crate::settings::profile::heaters::HeaterSettings;

/// The most tools that a machine may have. Each further one also needs its heater in [`Heater`].
pub const MAX_TOOLS: usize = 2;

/// The heater of a further tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolHeater {
    /// The board's output for the heater.
    pub heater: SpareConnector,
    /// The board's input for its thermometer.
    pub thermistor: SpareConnector,
    /// Range and control.
    pub settings: HeaterSettings,
    /// The model that controls it; `None`: a PID loop does.
    pub control_model: Option<HeaterModel>,
}

/// A further tool: T1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FurtherTool {
    /// The board's name for the motor of its extruder.
    pub socket: &'static str,
    /// True if that motor runs the other way round.
    pub is_inverted: bool,
    /// Offset from T0's nozzle to this one (M218), units of 10 nm.
    pub offset_10nm: [i64; 3],
    /// Steps of its motor in a millimetre of filament.
    pub steps_per_mm: StepsPerMm,
    /// Pressure advance of its extruder.
    pub advance: PressureAdvance,
    /// Settings of its motor's driver; `None` for a driver that cannot be set.
    pub driver: Option<DriverSettings>,
    /// The tool's own heater; `None`: it shares T0's nozzle.
    pub heater: Option<ToolHeater>,
    /// The index of the fan's output that M106 without P means while it is selected; `None`: the
    /// part-cooling fan's.
    pub fan: Option<u8>,
}

/// Actions of a change of the tool. Lengths are units of 10 nm, speeds of 10 nm a second.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ToolChange {
    /// Rise of the nozzle before it goes aside; the offset along Z is added where the new nozzle
    /// is the lower one.
    pub lift_10nm: i64,
    /// Speed of the new nozzle on its way to the old one's place.
    pub travel_10nm_per_s: i64,
    /// Filament that the old tool draws back.
    pub retract_10nm: i64,
    /// Speed of that.
    pub retract_10nm_per_s: i64,
    /// Filament that the new tool pushes beyond the length that it had drawn back when it was left.
    pub prime_10nm: i64,
    /// Speed at which it pushes both.
    pub prime_10nm_per_s: i64,
    /// The macro whose lines come before it. It and the next one are called with `FROM` and `TO`,
    /// the numbers of the tools.
    pub before: Option<&'static str>,
    /// The macro whose lines come after it.
    pub after: Option<&'static str>,
}

/// The tools beside T0, and how they are changed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tools {
    /// T1, and so on.
    pub further: [Option<FurtherTool>; MAX_TOOLS - 1],
    /// Settings of a change.
    pub change: ToolChange,
}

impl FurtherTool {
    /// The fan that M106 without P means while it is selected.
    pub fn part_fan(&self) -> FanOutput {
        let output = self.fan.and_then(|fan| FanOutput::ALL.get(usize::from(fan)));
        output.copied().unwrap_or(FanOutput::Part)
    }
}

impl Tools {
    /// A tool by its number; `None` for T0, which is in the profile itself, and for one
    /// that is not there.
    pub const fn get(&self, tool: u8) -> Option<&FurtherTool> {
        let further = tool as usize;
        if further == 0 || further >= MAX_TOOLS { None } else { self.further[further - 1].as_ref() }
    }

    /// The heater of a tool's nozzle.
    pub fn heater_of(&self, tool: u8) -> Heater {
        match self.get(tool) {
            Some(FurtherTool { heater: Some(_), .. }) => Heater::Nozzle1,
            _ => Heater::Nozzle,
        }
    }

    /// The own heater of the further tool, if it has one.
    pub const fn own_heater(&self) -> Option<&ToolHeater> {
        match self.get(1) {
            Some(FurtherTool { heater: Some(heater), .. }) => Some(heater),
            _ => None,
        }
    }
}

#[cfg(test)]
pub(crate) mod tests;
