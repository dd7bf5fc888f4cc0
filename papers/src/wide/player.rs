//! Executes the packets of a job on a printer.

use ferrostep_planner::Geometry;
use ferrostep_planner::extruder::FILAMENT_UNITS_PER_MM;
use ferrostep_printer::{CommandError, OtherMotion, Ports, PreparedPlace, Printer, Profile};

use super::block::{BlockRequest, ExactPosition, PreparedBlock};
use super::step_limits::StepSizes;

/// E of the G-code as pushed by the blocks. The packets also state it from time to time; if the job
/// is refused, the motors count.
#[derive(Clone, Copy, Debug)]
struct PushedExtruder {
    extruder_10nm: i64,
    /// Filament not yet counted in E, units of 0.1 nm times percent.
    rest_100pm: i64,
}

impl PushedExtruder {
    fn push(&mut self, filament_100pm: i64, flow_percent: u16) {
        let pushed_100pm = self.rest_100pm.saturating_add(filament_100pm);
        let flow = i64::from(flow_percent.max(1));
        self.extruder_10nm = self.extruder_10nm.saturating_add(pushed_100pm / flow);
        self.rest_100pm = pushed_100pm % flow;
    }
}

/// Executes the packets of one job on a printer.
#[derive(Clone, Debug)]
pub struct PacketPlayer {
    geometry: Geometry,
    sizes: StepSizes,
    /// E of the G-code when the packets last changed it: a different value was set by a command.
    printers_extruder_10nm: i64,
    pushed: PushedExtruder,
}

impl PacketPlayer {
    /// Creates the player for a job that begins at this E of the G-code, units of 10 nm, on a
    /// machine of this profile.
    pub fn new(profile: &Profile, extruder_10nm: i64) -> Self {
        let geometry = profile.geometry();
        Self {
            geometry,
            sizes: StepSizes::new(&geometry),
            printers_extruder_10nm: extruder_10nm,
            pushed: PushedExtruder { extruder_10nm, rest_100pm: 0 },
        }
    }

    /// Executes a block in which this many moves end.
    ///
    /// # Errors
    /// As for a G-code move.
    pub async fn block<P: Ports>(
        &mut self,
        prepared: &PreparedBlock,
        moves: u32,
        printer: &mut Printer<'_, P>,
    ) -> Result<(), CommandError> {
        let block = &prepared.block;
        let filament_100pm = self.filament_100pm(block.extruder_256ths);
        let mut motor_steps = self.geometry.motor_steps(printer.machine_10nm()).map(i64::from);
        motor_steps.iter_mut().zip(block.steps).for_each(|(position, steps)| *position += i64::from(steps));
        let [x, y, z, _] = self.geometry.steps_per_mm;
        let request = BlockRequest { prepared, sizes: &self.sizes };
        let motion = OtherMotion {
            request,
            line: block.line,
            end_10nm: self.geometry.position_10nm(motor_steps),
            tolerance_10nm: [x, y, z].map(|steps| steps.step_10nm()),
            filament_100pm,
            moves,
        };
        printer.prepared_motion(motion).await?;
        self.follow_commands(printer);
        self.pushed.push(filament_100pm, printer.current_flow_percent());
        Ok(())
    }

    /// Takes over the machine's position after the blocks so far.
    ///
    /// # Errors
    /// See [`Printer::prepared_place`].
    pub async fn place<P: Ports>(
        &mut self,
        place: &PreparedPlace,
        printer: &mut Printer<'_, P>,
    ) -> Result<(), CommandError> {
        self.follow_commands(printer);
        printer.prepared_place(place, ExactPosition(place.position_10nm)).await?;
        self.printers_extruder_10nm = place.extruder_10nm;
        Ok(())
    }

    /// Sets E to the filament that the blocks have pushed, after the job was refused or stopped and
    /// before [`Printer::abandon_prepared`].
    pub fn settle_extruder<P: Ports>(mut self, printer: &mut Printer<'_, P>) {
        self.follow_commands(printer);
        printer.set_prepared_extruder(self.pushed.extruder_10nm);
    }

    /// Makes blocks push E from the value that a command has set since (G92).
    fn follow_commands<P: Ports>(&mut self, printer: &Printer<'_, P>) {
        let [.., extruder_10nm] = printer.logical_10nm();
        if extruder_10nm != self.printers_extruder_10nm {
            self.printers_extruder_10nm = extruder_10nm;
            self.pushed = PushedExtruder { extruder_10nm, rest_100pm: 0 };
        }
    }

    /// Filament for a travel of the extruder, to the nearest 0.1 nm.
    fn filament_100pm(&self, travel_256ths: i32) -> i64 {
        // 1/256 steps at 1e-5 steps/mm: 3,906,250,000, times 2^31 less than 2^63 by a tenth of it.
        const PER_256TH: i64 = FILAMENT_UNITS_PER_MM * 100_000 / 256;
        let [.., extruder] = self.geometry.steps_per_mm;
        let steps_per_mm = extruder.hundred_thousandths().max(1);
        let filament = i64::from(travel_256ths) * PER_256TH;
        let half = if filament < 0 { -steps_per_mm / 2 } else { steps_per_mm / 2 };
        (filament + half) / steps_per_mm
    }
}
