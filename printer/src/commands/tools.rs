//! T, and the values that belong to a tool: M218, and M92, M221 and M572 for a tool that is not
//! selected.
//!
//! Machine coordinates are those of T0's nozzle, whichever tool is selected: limits, homing, the
//! probe and the bed use no others. The offset of the selected nozzle is part of the G-code's,
//! together with those of G92 and M206.
//!
//! A change makes the same steps as Marlin's (`Marlin/src/module/tool_change.cpp`), which clamps Z
//! to its travel and always raises by the same height.

use ferrostep_gcode::{AxisWords, Decimal, Real};
use ferrostep_hal_shim::{FanOutput, Heater};
use ferrostep_planner::{MotionChoice, Move, PressureAdvance, StepsPerMm, filament_100pm};

use crate::error::CommandError;
use crate::job::tool_box::{OfTool, ToolBox};
use crate::motion::axis_names::AXIS_NAMES;
use crate::motion::modal::Modal;
use crate::part::Part;
use crate::ports::{Heating, Motion, Ports, Replies, ToolsPart};
use crate::printer::Printer;
use crate::settings::bounds::{LARGEST_OFFSET_10NM, within};
use crate::settings::profile::tools::{FurtherTool, Tools};
use crate::settings::profile::z_motors::Kept;

/// Reasons to refuse a change.
const IN_A_PAUSE: &str = "T: a paused print resumes with the tool that it was paused with: resume or cancel it first";
const OFFSET_IN_A_PAUSE: &str = "M218: a paused print resumes where it was: resume or cancel it first";
const IN_A_JOB: &str = "T: a prepared job cannot change the tool: print the G-code itself";
const TOO_HIGH: &str = "T: the new nozzle is lower, and Z would have to rise above its travel: lower Z first, or change without a move (S1)";
const NO_SUCH_TOOL: &str = "T - Invalid extruder number !, this machine has T0 and T1";
const OTHER_TOOL: &str = "T: this command sets the selected tool: select the other one first (T0, T1)";
const OF_FIRST: &str = "M218: offsets are measured from T0's nozzle: set T1's";
const WITH_FIRST: &str = "a prepared job is for T0: send T0 first";

/// A change that has been found possible. Places are those of the carriage, as the G-code would
/// request them with T0.
#[derive(Clone, Copy, Debug)]
struct Change {
    /// Present place of the carriage.
    from_10nm: [i64; 3],
    /// The nozzle's place after the change.
    to_10nm: [i64; 3],
    /// Axes on which the new nozzle cannot reach the old one's place.
    clamped: [bool; 3],
}

impl<'a, P: Ports> Printer<'a, P> {
    /// The tools other than T0.
    pub(crate) fn further_tools(&self) -> Option<&'a Tools> {
        if !ToolsPart::<P>::PRESENT {
            return None;
        }
        let Kept(tools) = self.profile.tools?;
        Some(tools)
    }

    /// Returns true if the machine has several tools.
    pub fn has_tools(&self) -> bool {
        self.further_tools().is_some()
    }

    /// Number of tools.
    pub(crate) fn count_tools(&self) -> u8 {
        let further = self.further_tools().map_or(0, |tools| tools.further.iter().flatten().count());
        1 + further as u8
    }

    /// The selected tool.
    pub(crate) fn selected_tool(&self) -> u8 {
        ToolsPart::<P>::get(&self.modes.tools).map_or(0, |tools| tools.selected)
    }

    /// The selected tool, and its nozzle's offset from T0's, whose place is the machine's; units of
    /// 10 nm.
    pub fn tool_in_use(&self) -> (u8, [i64; 3]) {
        (self.selected_tool(), self.tool_offset_10nm())
    }

    /// The heater of the selected tool's nozzle.
    pub(crate) fn nozzle(&self) -> Heater {
        self.nozzle_of(None).unwrap_or(Heater::Nozzle)
    }

    /// The heater of the nozzle of a tool, or of the selected one.
    ///
    /// # Errors
    /// The machine has several tools, but none with this number. On a machine with one tool, a line
    /// for another gets a remark and has no effect.
    pub(crate) fn nozzle_of(&self, tool: Option<u8>) -> Result<Heater, CommandError> {
        let Some(tools) = self.further_tools() else { return Ok(Heater::Nozzle) };
        let tool = self.tool(tool)?;
        Ok(tools.heater_of(tool))
    }

    /// Returns true if a line is for a further tool and the machine has only one: the line then has
    /// no effect.
    pub(crate) fn is_for_no_tool(&self, tool: Option<u8>) -> bool {
        self.further_tools().is_none() && tool.is_some_and(|tool| tool > 0)
    }

    /// The tool that a line is for.
    ///
    /// # Errors
    /// The machine has no tool with this number.
    pub(crate) fn tool(&self, tool: Option<u8>) -> Result<u8, CommandError> {
        match tool {
            None => Ok(self.selected_tool()),
            Some(tool) if self.has_tool(tool.into()) => Ok(tool),
            Some(_) => Err(CommandError::Tool(NO_SUCH_TOOL)),
        }
    }

    fn has_tool(&self, tool: u32) -> bool {
        let is_further = |tools: &Tools| u8::try_from(tool).is_ok_and(|tool| tools.get(tool).is_some());
        tool == 0 || self.further_tools().is_some_and(is_further)
    }

    /// Values of the tool that a line names, if it is not the selected one.
    ///
    /// # Errors
    /// The machine has no tool with this number.
    pub(crate) fn resting_tool(&mut self, tool: Option<u8>) -> Result<Option<&mut OfTool>, CommandError> {
        if self.further_tools().is_none() {
            return Ok(None);
        }
        let tool = self.tool(tool)?;
        let Some(tools) = ToolsPart::<P>::get_mut(&mut self.modes.tools) else { return Ok(None) };
        Ok(if tool == tools.selected { None } else { tools.tools.get_mut(usize::from(tool)) })
    }

    /// Refuses a command for a tool other than the selected one.
    pub(crate) fn needs_selected(&self, tool: Option<u8>) -> Result<(), CommandError> {
        if self.further_tools().is_none() || self.tool(tool)? == self.selected_tool() {
            Ok(())
        } else {
            Err(CommandError::Tool(OTHER_TOOL))
        }
    }

    /// Refuses a command that only works with T0.
    pub(crate) fn needs_first_tool(&self) -> Result<(), CommandError> {
        if self.selected_tool() == 0 { Ok(()) } else { Err(CommandError::Tool(WITH_FIRST)) }
    }

    /// Offset from T0's nozzle to the selected one.
    pub(crate) fn tool_offset_10nm(&self) -> [i64; 3] {
        let tools = ToolsPart::<P>::get(&self.modes.tools);
        tools.map_or([0; 3], |tools| tools.offset_10nm(tools.selected))
    }

    /// Makes coordinates those of T0's nozzle, until [`Self::take_tool_offset`].
    pub(crate) fn leave_tool_offset(&mut self) {
        if ToolsPart::<P>::PRESENT {
            let offset_10nm = self.tool_offset_10nm();
            self.interpreter.modal.add_offset(offset_10nm.map(|length| -length));
        }
    }

    /// Makes coordinates those of the selected nozzle.
    pub(crate) fn take_tool_offset(&mut self) {
        if ToolsPart::<P>::PRESENT {
            let offset_10nm = self.tool_offset_10nm();
            self.interpreter.modal.add_offset(offset_10nm);
        }
    }

    /// The profile's extruder steps for a tool, or for the selected one.
    pub(crate) fn steps_of_profile(&self, tool: Option<u8>) -> StepsPerMm {
        let tool = tool.unwrap_or(self.selected_tool());
        let further = self.further_tools().and_then(|tools| tools.get(tool));
        let [.., first] = self.profile.steps_per_mm;
        further.map_or(first, |tool| tool.steps_per_mm)
    }

    /// The fan that M106 without P means.
    pub(crate) fn part_fan(&self) -> FanOutput {
        self.fan_of_tool(self.selected_tool())
    }

    fn fan_of_tool(&self, tool: u8) -> FanOutput {
        let further = self.further_tools().and_then(|tools| tools.get(tool));
        further.map_or(FanOutput::Part, FurtherTool::part_fan)
    }

    /// Reports the selected tool for T alone.
    pub(crate) fn report_tool(&self) {
        self.replies.say(format_args!("Active Extruder: {}", self.selected_tool()));
    }

    /// Executes T: at standstill the new tool's motor, heater, offset and values replace the old
    /// one's. With all axes homed its nozzle goes to the old one's place, unless it `stays`. The
    /// new tool's filament is pushed as far as the old one's was.
    ///
    /// # Errors
    /// The tool does not exist or cannot go there, and nothing has changed; or motion was stopped.
    pub(crate) async fn change_tool(&mut self, number: u32, stays: bool) -> Result<(), CommandError> {
        let Some(Tools { change: settings, .. }) = self.further_tools() else { return Ok(()) };
        let Ok(tool) = u8::try_from(number) else { return Err(CommandError::Tool(NO_SUCH_TOOL)) };
        self.may_change(tool)?;
        self.motion.finish().await?;
        let old = self.selected_tool();
        if tool == old {
            self.tell_tool(tool);
            return Ok(());
        }
        let change = self.planned_change(tool, stays)?;
        let swaps = settings.retract_10nm > 0 || settings.prime_10nm > 0;
        if swaps && self.can_swap(self.nozzle()) && settings.retract_10nm > 0 && !self.interpreter.modal.retracted {
            let drawn_100pm = filament_100pm(-settings.retract_10nm, 100);
            self.move_filament(drawn_100pm, settings.retract_10nm_per_s).await?;
            self.note_drawn_back(true);
        }
        let lift_10nm = self.lift_of(&change, settings.lift_10nm);
        if let Some(Change { from_10nm, .. }) = change {
            self.go_tool(self.interpreter.lifted(from_10nm, lift_10nm)).await?;
            self.interpreter.modal.lift_10nm = lift_10nm;
        }
        self.select_tool(tool);
        let (old_fan, new_fan) = (self.fan_of_tool(old), self.fan_of_tool(tool));
        if old_fan != new_fan {
            let power = self.print.power_loss.move_fan(old_fan, new_fan);
            self.motion.set_fan_power(old_fan, 0).await?;
            self.motion.set_fan_power(new_fan, power).await?;
        }
        if let Some(Change { from_10nm: [.., z], to_10nm: [to_x, to_y, to_z], clamped }) = change {
            let feed_10nm_per_s = settings.travel_10nm_per_s;
            let above = self.interpreter.lifted([to_x, to_y, z], lift_10nm);
            self.go_tool_at(above, feed_10nm_per_s).await?;
            self.go_tool(self.interpreter.lifted([to_x, to_y, to_z], 0)).await?;
            let modal = &mut self.interpreter.modal;
            modal.machine_10nm = [to_x, to_y, to_z];
            modal.lift_10nm = 0;
            if clamped.contains(&true) {
                self.say_clamped(clamped, None);
            }
        }
        let is_drawn_back = ToolsPart::<P>::get(&self.modes.tools)
            .and_then(|tools| tools.get(tool))
            .is_some_and(|tool| tool.drawn_back);
        if swaps && self.can_swap(self.nozzle()) && !self.interpreter.modal.retracted {
            let back_10nm = if is_drawn_back { settings.retract_10nm } else { 0 };
            self.move_filament(filament_100pm(back_10nm + settings.prime_10nm, 100), settings.prime_10nm_per_s).await?;
            self.note_drawn_back(false);
        }
        self.tell_tool(tool);
        Ok(())
    }

    /// Reports the selected tool in Marlin's words.
    fn tell_tool(&self, tool: u8) {
        self.replies.say(format_args!("echo:Active Extruder: {tool}"));
    }

    /// Refuses a change that cannot begin.
    pub(crate) fn may_change(&self, tool: u8) -> Result<(), CommandError> {
        if !self.has_tool(tool.into()) {
            return Err(CommandError::Tool(NO_SUCH_TOOL));
        }
        if tool == self.selected_tool() {
            return Ok(());
        }
        if self.is_paused() {
            return Err(CommandError::Tool(IN_A_PAUSE));
        }
        if self.interpreter.modal.in_prepared_job || self.print.card.prints_prepared() {
            return Err(CommandError::Tool(IN_A_JOB));
        }
        Ok(())
    }

    /// Returns true if filament moves during a change: the nozzle is warm enough.
    fn can_swap(&self, nozzle: Heater) -> bool {
        let modal = &self.interpreter.modal;
        modal.cold_extrusion_allowed || self.heating.status(nozzle).celsius >= modal.min_extrusion_celsius
    }

    fn note_drawn_back(&mut self, is_drawn_back: bool) {
        let Some(tools) = ToolsPart::<P>::get_mut(&mut self.modes.tools) else { return };
        if let Some(tool) = tools.tools.get_mut(usize::from(tools.selected)) {
            tool.drawn_back = is_drawn_back;
        }
    }

    /// Move of the carriage during a change; `None`: it stays.
    #[inline(never)]
    fn planned_change(&self, tool: u8, stays: bool) -> Result<Option<Change>, CommandError> {
        let modal = &self.interpreter.modal;
        if stays || modal.homed != [true; 3] {
            return Ok(None);
        }
        let Some(tools) = ToolsPart::<P>::get(&self.modes.tools) else { return Ok(None) };
        let (old_10nm, new_10nm) = (tools.offset_10nm(tools.selected), tools.offset_10nm(tool));
        let from_10nm = modal.machine_10nm;
        let asked_10nm: [i64; 3] = core::array::from_fn(|axis| from_10nm[axis] + old_10nm[axis] - new_10nm[axis]);
        let mut to_10nm = asked_10nm;
        let mut clamped = [false; 3];
        self.interpreter.clamp_into(&mut to_10nm, 0, &mut clamped);
        // At its lower end Z stays higher than the old nozzle was, which harms no part; at its
        // upper end it would stay lower.
        let [.., asked_z] = asked_10nm;
        let [.., z] = to_10nm;
        if z < asked_z { Err(CommandError::Tool(TOO_HIGH)) } else { Ok(Some(Change { from_10nm, to_10nm, clamped })) }
    }

    /// Rise of Z above the carriage's present place such that neither nozzle gets lower than the
    /// old one was.
    fn lift_of(&self, change: &Option<Change>, lift_10nm: i64) -> i64 {
        let Some(Change { from_10nm: [.., from_z], to_10nm: [.., to_z], .. }) = change else { return 0 };
        (to_z - from_z).max(0) + lift_10nm.max(self.interpreter.modal.lift_10nm)
    }

    /// Exchanges the tools, at standstill.
    #[inline(never)]
    fn select_tool(&mut self, tool: u8) {
        let live = self.live_of_tool();
        let Some(tools) = ToolsPart::<P>::get_mut(&mut self.modes.tools) else { return };
        let before_10nm = tools.offset_10nm(tools.selected);
        if let Some(old) = tools.tools.get_mut(usize::from(tools.selected)) {
            *old = OfTool { offset_10nm: old.offset_10nm, drawn_back: old.drawn_back, ..live };
        }
        tools.selected = tool;
        let Some(new) = tools.get(tool).copied() else { return };
        self.put_tool_in_force(&new);
        self.shift_to(before_10nm, new.offset_10nm);
        let heater = self.nozzle();
        self.heating.select_nozzle(heater);
    }

    /// Present values of a tool, on a machine with several; `None` without such a tool.
    pub(crate) fn values_of_tool(&self, tool: u8) -> Option<OfTool> {
        self.further_tools()?;
        let tools = ToolsPart::<P>::get(&self.modes.tools)?;
        let kept = *tools.get(tool)?;
        if tool == tools.selected {
            Some(OfTool { offset_10nm: kept.offset_10nm, drawn_back: kept.drawn_back, ..self.live_of_tool() })
        } else {
            Some(kept)
        }
    }

    /// Applies steps and advance of T0 and T1, and T1's offset, at standstill. Returns those of the
    /// selected tool, which the caller applies.
    #[inline(never)]
    pub(crate) fn put_tools_in_force(
        &mut self,
        first: (StepsPerMm, PressureAdvance),
        second: (StepsPerMm, PressureAdvance),
        offset_10nm: [i64; 3],
    ) -> (StepsPerMm, PressureAdvance) {
        let Some(tools) = ToolsPart::<P>::get_mut(&mut self.modes.tools) else { return first };
        let selected = tools.selected;
        let before_10nm = tools.offset_10nm(1);
        for (tool, (steps_per_mm, advance)) in tools.tools.iter_mut().zip([first, second]) {
            (tool.steps_per_mm, tool.advance) = (steps_per_mm, advance);
        }
        self.set_tool_offset(1, offset_10nm);
        if selected == 1 {
            self.shift_to(before_10nm, offset_10nm);
            second
        } else {
            first
        }
    }

    /// Takes over the tools of an interrupted print, at standstill, before anything moves. Returns
    /// true if the selected tool has a separate nozzle.
    #[inline(never)]
    pub(crate) fn take_tools(&mut self, kept: &<ToolsPart<P> as Part>::Of<ToolBox>) -> bool {
        let Some(kept) = ToolsPart::<P>::get(kept).copied() else { return false };
        let before_10nm = self.tool_offset_10nm();
        if let Some(tools) = ToolsPart::<P>::get_mut(&mut self.modes.tools) {
            *tools = kept;
        }
        self.shift_to(before_10nm, kept.offset_10nm(kept.selected));
        let heater = self.nozzle();
        self.heating.select_nozzle(heater);
        heater == Heater::Nozzle1
    }

    /// Gives a target to the nozzle that is not the selected tool's.
    pub(crate) fn heat_other_nozzle(&mut self, target: Decimal) {
        let other = if self.nozzle() == Heater::Nozzle { Heater::Nozzle1 } else { Heater::Nozzle };
        if self.heating.has_nozzles() {
            // The target was possible before the power cut.
            let _always_works = self.set_temperature(other, target.to_f64());
        }
    }

    /// Values in force for the selected tool.
    fn live_of_tool(&self) -> OfTool {
        let Modal { flow_percent, retracted, .. } = self.interpreter.modal;
        OfTool {
            offset_10nm: [0; 3],
            steps_per_mm: self.motion.extruder_steps_per_mm(),
            advance: self.motion.motion_choice().pressure_advance,
            flow_percent,
            retracted,
            drawn_back: false,
        }
    }

    /// Applies the values of a tool, at standstill.
    fn put_tool_in_force(&mut self, new: &OfTool) {
        // Neither can fail at standstill: both were checked where they were set.
        let _always_works = self.motion.set_extruder_steps_per_mm(new.steps_per_mm);
        let choice = self.motion.motion_choice();
        if choice.pressure_advance != new.advance {
            let _always_works =
                self.motion.set_motion_choice(&MotionChoice { pressure_advance: new.advance, ..choice });
        }
        self.interpreter.modal.flow_percent = new.flow_percent;
        self.interpreter.modal.retracted = new.retracted;
    }

    /// The selected nozzle has another offset: so have the G-code's coordinates, and
    /// the bed below it.
    fn shift_to(&mut self, before_10nm: [i64; 3], after_10nm: [i64; 3]) {
        self.interpreter.modal.add_offset(before_10nm.map(|length| -length));
        self.interpreter.modal.add_offset(after_10nm);
        let follows = P::Motion::HAS_BED && self.interpreter.modal.follows_bed;
        let machine_10nm = self.interpreter.modal.machine_10nm;
        if follows {
            let _off = self.switch_bed(false);
        }
        let [x, y, _] = after_10nm.map(|length| length as i32);
        self.motion.step_extruder(self.selected_tool(), [x, y]);
        if follows && self.switch_bed(true).is_err() {
            self.replies.say(format_args!("echo:Z follows the bed no more"));
        }
        let [x, y, _] = machine_10nm;
        let [at_x, at_y, _] = &mut self.interpreter.modal.machine_10nm;
        (*at_x, *at_y) = (x, y);
    }

    /// M218, at standstill.
    #[inline(never)]
    pub(crate) fn tool_offset(&mut self, tool: Option<u8>, words: &AxisWords) -> Result<(), CommandError> {
        if !ToolsPart::<P>::PRESENT {
            return Ok(());
        }
        if *words == AxisWords::default() {
            self.report_offsets();
            return Ok(());
        }
        let tool = self.tool(tool)?;
        if tool == 0 {
            return Err(CommandError::Tool(OF_FIRST));
        }
        if self.is_paused() {
            return Err(CommandError::Tool(OFFSET_IN_A_PAUSE));
        }
        let Some(tools) = ToolsPart::<P>::get(&self.modes.tools) else { return Ok(()) };
        let (selected, before_10nm) = (tools.selected, tools.offset_10nm(tool));
        let mut offset_10nm = before_10nm;
        for (axis, word) in [words.x, words.y, words.z].into_iter().enumerate() {
            let Some(value) = word else { continue };
            let length_10nm = self.interpreter.modal.length_10nm(value).ok_or(CommandError::TooFar)?;
            offset_10nm[axis] = within(AXIS_NAMES[axis], length_10nm, -LARGEST_OFFSET_10NM, LARGEST_OFFSET_10NM)?;
        }
        self.set_tool_offset(tool, offset_10nm);
        if tool == selected {
            self.shift_to(before_10nm, offset_10nm);
        }
        Ok(())
    }

    /// A tool has another offset, which comes into force elsewhere if it is the selected one.
    fn set_tool_offset(&mut self, tool: u8, offset_10nm: [i64; 3]) {
        if let Some(tools) = ToolsPart::<P>::get_mut(&mut self.modes.tools)
            && let Some(tool) = tools.tools.get_mut(usize::from(tool))
        {
            tool.offset_10nm = offset_10nm;
        }
    }

    fn report_offsets(&self) {
        let Some(tools) = ToolsPart::<P>::get(&self.modes.tools) else { return };
        for (tool, of_tool) in tools.tools.iter().enumerate().skip(1) {
            let [x, y, z] = of_tool.offset_10nm.map(|length| Real::short(length as f64 / 1e5, 3));
            self.replies.say(format_args!("echo:  M218 T{tool} X{x} Y{y} Z{z} ; (mm)"));
        }
    }

    async fn go_tool(&mut self, target_10nm: [i64; 3]) -> Result<(), CommandError> {
        let [.., feed_mm_per_s, _] = self.motion.limits().max_feed_mm_per_s;
        self.go_tool_at(target_10nm, (feed_mm_per_s * 1e5) as i64).await
    }

    /// Makes a move that is part of a change, to its end.
    async fn go_tool_at(&mut self, target_10nm: [i64; 3], feed_10nm_per_s: i64) -> Result<(), CommandError> {
        let feed_mm_per_s = feed_10nm_per_s as f32 / 1e5;
        let request = Move { target_10nm, filament_100pm: 0, feed_mm_per_s, line: self.lines.number, ends_move: false };
        self.motion.add(request).await?;
        Ok(self.motion.finish().await?)
    }
}
