//! Checks whether a job is meant for this machine (M862.1, M862.3), and remarks on words that only
//! affect other machines.

use ferrostep_gcode::{AxisWords, BedCommand, Command, Decimal, DriverWords, Remark, Remarks, WaitTarget};

use crate::error::CommandError;
use crate::ports::{Motion, Ports};
use crate::printer::Printer;

/// Nozzles are drilled in steps of 0.05 mm; slicers write two decimals.
const SAME_NOZZLE_MM: f64 = 0.01;

/// Returns true if a command asks for an unheated chamber, which any chamber without a heater
/// provides.
fn asks_for_cold(command: &Command<'_>) -> bool {
    match command {
        Command::SetChamber(target) => target.is_none_or(|celsius| celsius <= Decimal::ZERO),
        Command::WaitChamber(
            WaitTarget::Heating(celsius) | WaitTarget::HeatingOrCooling(celsius) | WaitTarget::AtLeast(celsius),
        ) => *celsius <= Decimal::ZERO,
        _ => false,
    }
}

impl<P: Ports> Printer<'_, P> {
    /// Adds the remarks that depend on the machine to the parser's.
    pub(crate) fn add_remarks(&mut self, command: &Command<'_>, remarks: &mut Remarks) {
        match command {
            Command::Linear { axes, .. } | Command::Arc { axes, .. } => {
                let modal = &mut self.interpreter.modal;
                if modal.has_ended_m83 && !modal.relative_extruder && axes.e.is_some() {
                    modal.has_ended_m83 = false;
                    remarks.add(Remark::AbsoluteExtrusion);
                }
            }
            Command::ResumePrint if !self.is_paused() => remarks.add(Remark::NotPaused),
            Command::Card(card) => self.add_card_remarks(card, remarks),
            Command::Bed(BedCommand::Align { .. }) if !self.aligns_z() => remarks.add(Remark::OneZMotor),
            Command::Bed(bed) if !self.has_bed() && !bed.asks_for_none() => remarks.add(Remark::NoBed),
            Command::Junction { corner_velocity, .. } => self.add_unlimited_axes(corner_velocity, remarks),
            Command::Fan { number, .. } if *number > 0 && self.numbered_fan(*number).is_none() => {
                remarks.add(Remark::OtherFan);
            }
            Command::ProbePin(_) if self.pin().is_none() => remarks.add(Remark::NoServo),
            Command::FilamentSensor(words) if words.distance.is_some() && !self.has_encoder() => {
                remarks.add(Remark::NoEffect(b'D'));
            }
            Command::Backlash(_) if !self.has_backlash() => remarks.add(Remark::NoBacklash),
            Command::Supply(_) if !self.has_supply() => remarks.add(Remark::NoSupply),
            Command::ChamberGains(_) if !self.has_chamber() => remarks.add(Remark::NoChamber),
            Command::SetChamber(_) | Command::WaitChamber(_)
                if self.profile.chamber.is_none() && !asks_for_cold(command) =>
            {
                remarks.add(Remark::NoChamber);
            }
            Command::SetNozzle(tool, _) | Command::WaitNozzle(tool, _) | Command::NozzleGains(tool, _)
                if self.is_for_no_tool(*tool) =>
            {
                remarks.add(Remark::OtherTool);
            }
            Command::FlowPercent(tool, _) | Command::PressureAdvance(tool, _) if self.is_for_no_tool(*tool) => {
                remarks.add(Remark::OtherTool);
            }
            Command::StepsPerMm(tool, _)
            | Command::StealthChop { tool, .. }
            | Command::Driver(_, DriverWords { tool, .. })
                if self.is_for_no_tool(*tool) =>
            {
                remarks.add(Remark::OtherTool);
            }
            Command::ToolOffset { .. } if !self.profile.has_tools() => remarks.add(Remark::OtherTool),
            Command::SetOutput { .. } if !self.has_outputs() => remarks.add(Remark::NoOutputs),
            Command::SetLight { .. } if !self.has_light() => remarks.add(Remark::NoLight),
            Command::NamedFan { name, .. } if self.named_fan(name).is_none() => remarks.add(Remark::OtherFan),
            Command::CheckNozzle(_) if self.profile.nozzle_diameter_mm.is_none() => remarks.add(Remark::MachineUnknown),
            Command::CheckModel(_) if self.profile.model_names.is_empty() => remarks.add(Remark::MachineUnknown),
            _ => {}
        }
    }

    /// Adds a remark for an axis without a corner limit in the profile: only the junction deviation
    /// limits it, whatever M205 says.
    fn add_unlimited_axes(&self, corner_velocity: &AxisWords, remarks: &mut Remarks) {
        let AxisWords { x, y, z, e } = *corner_velocity;
        let limits = self.motion.limits().instantaneous_corner_velocity_mm_per_s;
        for ((letter, word), limit) in [(b'X', x), (b'Y', y), (b'Z', z), (b'E', e)].into_iter().zip(limits) {
            if word.is_some() && !limit.is_finite() {
                remarks.add(Remark::NoEffect(letter));
            }
        }
    }

    /// M862.1.
    pub(crate) fn check_nozzle(&self, diameter: Option<Decimal>) -> Result<(), CommandError> {
        let (Some(job), Some(machine_mm)) = (diameter, self.profile.nozzle_diameter_mm) else { return Ok(()) };
        let (job_mm, machine_mm) = (job.to_f64(), f64::from(machine_mm));
        if (job_mm - machine_mm).abs() <= SAME_NOZZLE_MM {
            Ok(())
        } else {
            Err(CommandError::OtherNozzle { job_mm, machine_mm })
        }
    }

    /// M862.3.
    pub(crate) fn check_model(&self, model: &str) -> Result<(), CommandError> {
        let names = self.profile.model_names;
        let is_one = |name: &str| name.trim_matches(' ').eq_ignore_ascii_case(model);
        if model.is_empty() || names.is_empty() || names.split(',').any(is_one) {
            return Ok(());
        }
        Err(CommandError::OtherModel(names))
    }
}
