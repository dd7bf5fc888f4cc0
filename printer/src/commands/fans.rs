//! M106, M107, M42, M150, M123, SET_FAN_SPEED, and the pause when a fan stalls.

use ferrostep_gcode::{AxisWords, Command};
use ferrostep_hal_shim::FanOutput;

use crate::error::CommandError;
use crate::heat::fans;
use crate::heat::fans::{FanRule, FanSettings, FanTable, LightColor};
use crate::heat::report::FanStatus;
use crate::ports::{Heating, Motion, Ports, Replies};
use crate::printer::Printer;
use crate::signals::Signals;

/// Command that pauses a print whose fan stalls: M125.
pub(crate) static PAUSE: Command<'static> = Command::Pause(AxisWords { x: None, y: None, z: None, e: None });

/// Reports a stalled fan and makes the next line of a print pause it. Call it several times a
/// second; `told` is the fan that was reported last.
pub fn tell_stalled_fan(
    told: &mut Option<FanOutput>,
    table: &FanTable,
    heating: &impl Heating,
    signals: &Signals,
    replies: &(impl Replies + ?Sized),
) {
    let stalled = heating.stalled_fan();
    if stalled == *told {
        return;
    }
    *told = stalled;
    let Some(output) = stalled else { return };
    if let Some(Some(fan)) = table.get(output.index()) {
        let rpm = heating.fan(output).rpm.unwrap_or(0);
        replies.say(format_args!(
            "echo:fan {}: {rpm} turns a minute at full power, at least {} are expected; a print pauses",
            fan.name, fan.least_rpm
        ));
        signals.note_stalled_fan();
    }
}

impl<P: Ports> Printer<'_, P> {
    /// The output of the fan that M106 calls by this P.
    pub(crate) fn numbered_fan(&self, number: u8) -> Option<FanOutput> {
        fans::find(&self.profile.fans, |fan| fan.rule == FanRule::Commanded { number: Some(number) })
    }

    /// The output of the fan with this name that commands may set.
    pub(crate) fn named_fan(&self, name: &str) -> Option<FanOutput> {
        fans::find(&self.profile.fans, |fan| fan.rule.is_named() && fan.name.eq_ignore_ascii_case(name))
    }

    /// Returns true if the machine has outputs for M42.
    pub(crate) fn has_outputs(&self) -> bool {
        P::Heating::HAS_OUTPUTS
            && fans::find(&self.profile.fans, |fan| matches!(fan.rule, FanRule::Output { .. })).is_some()
    }

    /// The output that M42 calls by this P; `None` on a machine without outputs.
    ///
    /// # Errors
    /// [`CommandError::OtherOutput`]: another has the number, or none.
    pub(crate) fn numbered_output(&self, wanted: Option<u8>) -> Result<Option<FanOutput>, CommandError> {
        if !P::Heating::HAS_OUTPUTS {
            return Ok(None);
        }
        let has_number = |fan: &FanSettings| matches!(fan.rule, FanRule::Output { number: Some(number), .. } if Some(number) == wanted);
        match fans::find(&self.profile.fans, has_number) {
            None if self.has_outputs() => Err(CommandError::OtherOutput),
            output => Ok(output),
        }
    }

    /// Returns true if an output is a colour of a light.
    pub(crate) fn has_light(&self) -> bool {
        let is_colored = |fan: &FanSettings| matches!(fan.rule, FanRule::Output { color: Some(_), .. });
        P::Heating::HAS_OUTPUTS && fans::find(&self.profile.fans, is_colored).is_some()
    }

    /// Executes M150: sets the light's outputs to their colours' powers, in step with the motion
    /// around the command.
    pub(crate) async fn set_light(&mut self, colors: [u8; 4]) -> Result<(), CommandError> {
        for (output, fan) in FanOutput::ALL.into_iter().zip(&self.profile.fans) {
            let Some(FanSettings { rule: FanRule::Output { color: Some(color), .. }, .. }) = fan else { continue };
            let power = LightColor::ALL.iter().zip(colors).find(|(of, _)| *of == color).map_or(0, |(_, power)| power);
            self.print.power_loss.set_fan(output, power);
            self.motion.set_fan_power(output, power).await?;
        }
        Ok(())
    }

    /// Executes M123: reports every fan's power, 0 to 255, and its speed if it has a tachometer, in
    /// the format of Prusa's firmware.
    pub(crate) fn report_fans(&self) {
        for (output, fan) in FanOutput::ALL.into_iter().zip(&self.profile.fans) {
            let Some(FanSettings { name, .. }) = fan else { continue };
            let FanStatus { power, rpm } = self.heating.fan(output);
            match rpm {
                Some(rpm) => self.replies.say(format_args!("{name}:{rpm} RPM {name}@:{power}")),
                None => self.replies.say(format_args!("{name}@:{power}")),
            }
        }
    }

    /// Switches off all fans that commands set, after the motion so far.
    pub(crate) async fn commanded_fans_off(&mut self) {
        for (output, fan) in FanOutput::ALL.into_iter().zip(&self.profile.fans) {
            if matches!(fan, Some(FanSettings { rule: FanRule::Commanded { .. }, .. })) {
                // A stop has not switched on any fan.
                let _ = self.motion.set_fan_power(output, 0).await;
            }
        }
    }

    /// Returns true if a print must pause because of a stalled fan. It pauses once for each
    /// failure: the person who resumes it has read the message.
    #[inline(never)]
    pub(crate) fn has_stalled_fan(&self) -> bool {
        self.is_a_nozzle_on() && self.signals.take_stalled_fan()
    }

    /// Returns true if the hot end's own fan has stalled: the nozzle must not stay hot unattended.
    pub(crate) fn is_hot_end_fan_stalled(&self) -> bool {
        let Some(output) = self.heating.stalled_fan() else { return false };
        matches!(self.profile.fans.get(output.index()), Some(Some(FanSettings { rule: FanRule::HotEnd, .. })))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
