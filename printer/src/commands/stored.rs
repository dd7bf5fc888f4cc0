//! M500 to M504: settings that survive a power-off.
//!
//! A memory keeps the values that differ from the profile's
//! ([`crate::settings::stored::groups::Group::all`]): if a new image brings a better profile, its
//! values apply wherever no others were set.

mod in_force;
mod mesh;

use core::fmt;

use ferrostep_gcode::{Reply, SettingsCommand};
use ferrostep_hal_shim::Heater;
use ferrostep_planner::MotionChoice;
use ferrostep_settings::{Entry, Record, RecordWriter, SLOT_BYTES, id_of};
use ferrostep_tmc2209::{DriverSettings, SECOND_EXTRUDER};

use crate::job::print_clock::Statistics;
use crate::part::Part;
use crate::ports::{Heating, Motion, Ports, Replies, SettingsMemory, Text};
use crate::printer::{KeepsSettings, Printer};
use crate::settings::stored::groups::{Group, Setting, Shown};
use crate::settings::stored::values::{Parts, ToolValues, Values, advance_numbers};

/// Optional parts of a machine that have settings.
type PartsOf<P> = (
    <<P as Ports>::Heating as Heating>::Models,
    <<P as Ports>::Motion as Motion>::Tools,
    <<P as Ports>::Motion as Motion>::Backlash,
);

/// Contents of the settings memory.
struct Stored<M: Parts> {
    values: Values<M>,
    /// Stored values that this machine knows.
    known: usize,
    /// Values from another version or another machine.
    foreign: usize,
    /// Number of corrected values.
    faults: usize,
    /// Number of values that differ from the profile's; `None` if they are not counted.
    differ: Option<usize>,
    /// Points of the mesh along X and Y.
    mesh: Option<[u8; 2]>,
    /// Totals over the machine's life.
    statistics: Statistics,
}

impl<M: Parts> fmt::Display for Stored<M> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { known, foreign, faults, mesh, .. } = self;
        write!(out, "{known} values, {faults} faults")?;
        if let Some([columns, rows]) = mesh {
            write!(out, ", a mesh of {columns} x {rows} points")?;
        }
        if *foreign == 0 { Ok(()) } else { write!(out, ", {foreign} that this version does not know") }
    }
}

/// Name of [`Statistics`] in a memory, in which settings have the names of a profile's keys.
const STATISTICS: u16 = id_of("statistics");

/// Maximum number of stored values that are named because they differ from the profile's: more
/// would be too many lines at startup.
const MAX_NAMED: usize = 6;

/// The setting of an entry; `None` if this firmware does not know it or this machine does not have
/// it.
fn setting_of<M: Parts>(entry: Entry) -> Option<(&'static Group<M>, &'static Setting<M>)> {
    for group in Group::all() {
        for setting in group.settings {
            if id_of(setting.name) == entry.id {
                return Some((group, setting));
            }
        }
    }
    None
}

impl<P: Ports, M: SettingsMemory> KeepsSettings<P> for M {
    fn keep(&self, printer: &mut Printer<'_, P>, command: Option<SettingsCommand>) -> Option<MotionChoice> {
        match command {
            Some(SettingsCommand::Store) if printer.may_not_stall(self) => printer.replies.say(format_args!(
                "echo:M500: nothing is stored while heaters are on, because this chip halts as it writes: send M104 S0, M140 S0 and then M500"
            )),
            Some(SettingsCommand::Store) => printer.store_settings(self),
            Some(SettingsCommand::Validate) => {
                let stored = printer.read_settings(self, "M504", false)?;
                printer.replies.say(format_args!("echo:M504: stored are {stored}"));
            }
            _ => return printer.load_settings(self, command.is_none()),
        }
        None
    }

    fn keep_statistics(&self, printer: &mut Printer<'_, P>) {
        if !printer.may_not_stall(self) {
            printer.store_statistics(self);
        }
    }
}

impl<'a, P: Ports> Printer<'a, P> {
    /// True for commands that wait until all motion has ended: M500 to M502.
    pub(crate) const fn needs_standstill(command: SettingsCommand) -> bool {
        matches!(command, SettingsCommand::Store | SettingsCommand::Load | SettingsCommand::Reset)
    }

    /// Executes M500 to M502, at standstill.
    // Not inlined: it would enlarge the future of the waiting commands. The parts that need much
    // stack, the settings and the motion's methods, also do not nest.
    #[inline(never)]
    pub(crate) fn change_settings(&mut self, command: SettingsCommand) {
        let choice =
            if command == SettingsCommand::Reset { self.reset_settings() } else { self.keep_settings(command) };
        self.choose_stored_motion(choice);
    }

    /// Executes M503 and M504.
    #[inline(never)]
    pub(crate) fn show_settings(&mut self, command: SettingsCommand) {
        match command {
            SettingsCommand::Report { headings } => self.report_settings(headings),
            _ => {
                let _nothing_to_set = self.keep_settings(command);
            }
        }
    }

    /// Executes M502.
    #[inline(never)]
    fn reset_settings(&mut self) -> Option<MotionChoice> {
        let values = self.profile_values();
        self.reset_mesh();
        self.replies.send(Reply::Text("echo:Hardcoded Default Settings Loaded"));
        self.put_in_force(&values)
    }

    /// Executes M500, M501 and M504, if there is a memory.
    fn keep_settings(&mut self, command: SettingsCommand) -> Option<MotionChoice> {
        let Some(memory) = self.fitted.settings_memory else {
            let text = "echo:M500, M501, M504: this machine has no memory for settings: write them into the profile";
            self.replies.send(Reply::Text(text));
            return None;
        };
        memory.keep(self, Some(command))
    }

    /// Applies the stored filters and advance, at standstill.
    fn choose_stored_motion(&mut self, choice: Option<MotionChoice>) {
        if choice.is_some_and(|choice| self.motion.set_motion_choice(&choice).is_err()) {
            let text = "echo:settings: input_shaper and pressure_advance cannot be set on this machine";
            self.replies.send(Reply::Text(text));
        }
    }

    /// Gives the printer a memory in which settings survive a power-off (M500);
    /// [`Self::restore_settings`] applies the stored ones.
    pub fn set_settings_memory(&mut self, memory: &'a impl SettingsMemory) {
        self.fitted.settings_memory = Some(memory);
    }

    /// Returns true, and reports it, if M500, M501 or M502 has no effect now because a print is
    /// already planned.
    pub(crate) fn refuse_settings(&self, command: SettingsCommand) -> bool {
        let prints = self.interpreter.modal.in_prepared_job || self.prints_from_card() || self.is_paused();
        let refused = prints && Self::needs_standstill(command);
        if refused {
            self.replies.say(format_args!("echo:M500 to M502 have no effect during a print: send it after the print"));
        }
        refused
    }

    /// Applies the stored settings at power-on; no report if none are stored.
    pub fn restore_settings(&mut self) {
        if let Some(memory) = self.fitted.settings_memory {
            let choice = memory.keep(self, None);
            self.choose_stored_motion(choice);
        }
    }

    /// Stores the machine's statistics at standstill, except during a print, or while heaters are
    /// on if the memory needs them off. A later standstill then does it.
    // In a future the compiler would keep every value in memory.
    #[inline(never)]
    pub(crate) fn keep_statistics(&mut self) {
        let prints = self.interpreter.modal.in_prepared_job || self.prints_from_card() || self.is_paused();
        if let (Some(memory), true, false) = (self.fitted.settings_memory, self.print.clock.is_unsaved, prints) {
            memory.keep_statistics(self);
        }
    }

    /// Settings of the drivers that can be configured.
    fn live_drivers(&self) -> [Option<DriverSettings>; 4] {
        [0, 1, 2, 3].map(|motor| self.live_driver(motor))
    }

    /// Settings of a motor's driver, if it can be configured.
    fn live_driver(&self, motor: usize) -> Option<DriverSettings> {
        Some(self.fitted.drivers?.report(motor)?.settings)
    }

    /// The settings in force.
    fn live_values(&self) -> Values<PartsOf<P>> {
        let MotionChoice { shapers, mut pressure_advance, .. } = self.motion.motion_choice();
        let mut extruder_steps_per_mm = self.motion.extruder_steps_per_mm();
        if let Some(first) = self.values_of_tool(0) {
            (pressure_advance, extruder_steps_per_mm) = (first.advance, first.steps_per_mm);
        }
        let modal = &self.interpreter.modal;
        Values {
            extruder_steps_per_mm: extruder_steps_per_mm.to_f64(),
            limits: self.motion.limits(),
            retraction: modal.retraction,
            home_offset_10nm: modal.home_offset_10nm,
            skew_factors: self.interpreter.skew.factors(),
            backlash: <P::Motion as Motion>::Backlash::of(self.has_backlash().then(|| self.motion.backlash())),
            probe_offset_10nm: self.has_probe().then_some(modal.probe_offset_10nm),
            filament_10nm: self.modes.filament_10nm,
            shapers,
            advance: advance_numbers(&pressure_advance),
            drivers: self.live_drivers(),
            gains: self
                .fitted
                .equipment
                .heaters
                .then(|| [Heater::Nozzle, Heater::Bed].map(|heater| self.heating.gains(heater))),
            models: <P::Heating as Heating>::Models::of(
                [Heater::Nozzle, Heater::Bed].map(|heater| self.heating.model(heater)),
            ),
            tool: <P::Motion as Motion>::Tools::of(self.live_tool()),
        }
    }

    /// Settings of T1 in force.
    fn live_tool(&self) -> Option<ToolValues> {
        let of_tool = self.values_of_tool(1)?;
        Some(ToolValues {
            extruder_steps_per_mm: of_tool.steps_per_mm.to_f64(),
            offset_10nm: of_tool.offset_10nm,
            advance: advance_numbers(&of_tool.advance),
            gains: (self.fitted.equipment.heaters && self.heating.has_nozzles())
                .then(|| self.heating.gains(Heater::Nozzle1)),
            model: self.heating.model(Heater::Nozzle1),
            driver: self.live_driver(SECOND_EXTRUDER),
        })
    }

    fn profile_values(&self) -> Values<PartsOf<P>> {
        let mut values = Values::of_profile(self.profile, &self.live_drivers(), self.fitted.equipment.heaters);
        if let Some(tool) = values.tool()
            && self.live_driver(SECOND_EXTRUDER).is_none()
        {
            tool.driver = None;
        }
        values
    }

    /// Reports M503.
    fn report_settings(&mut self, headings: bool) {
        let mut values = self.live_values();
        if headings {
            self.replies.send(Reply::Text("echo:; Linear Units:"));
        }
        self.replies.send(Reply::Text("echo:  G21 ; (mm)"));
        for group in Group::all() {
            let mut headings = headings;
            for axis in 0..group.axes.map_or(1, str::len) {
                let mut text = Text::new();
                let _ = text.push_str("echo:  ");
                // Every command fits.
                if group.write_command(&mut values, axis, &mut text) != Ok(true) {
                    continue;
                }
                if core::mem::take(&mut headings) {
                    self.replies.send(Reply::Text(group.heading));
                }
                self.replies.send(Reply::Text(&text));
            }
        }
        self.report_stored_mesh();
    }

    /// Reports for M201 to M208 without words the corresponding line of M503.
    #[inline(never)]
    pub(crate) fn report_setting(&self, code: &str) {
        let mut values = self.live_values();
        for group in Group::all().filter(|group| group.code == code) {
            let mut text = Text::new();
            let _ = text.push_str("echo:  ");
            if group.write_command(&mut values, 0, &mut text) == Ok(true) {
                self.replies.send(Reply::Text(&text));
            }
        }
    }

    /// Executes M500.
    // Not inlined, like those below: each needs much stack, and they never nest.
    #[inline(never)]
    fn store_settings(&mut self, memory: &dyn SettingsMemory) {
        let (mut live, mut of_profile) = (self.live_values(), self.profile_values());
        let mut record = RecordWriter::new(self.profile.name);
        let (mut count, mut is_whole) = (0_usize, true);
        for group in Group::all() {
            for setting in group.settings {
                for index in 0..group.values_of(setting) {
                    let (Some(live), Some(of_profile)) =
                        ((setting.place)(&mut live, index), (setting.place)(&mut of_profile, index))
                    else {
                        continue;
                    };
                    let (value, of_profile) = (live.get(), of_profile.get());
                    if value != of_profile && !(value.is_nan() && of_profile.is_nan()) {
                        is_whole &= record.add(Entry { id: id_of(setting.name), index: index as u8, value });
                        count = count.saturating_add(1);
                    }
                }
            }
        }
        self.see_heat();
        is_whole &= self.add_statistics(&mut record);
        is_whole &= self.add_mesh(&mut record);
        let bytes = record.bytes();
        let saved = memory.save(bytes);
        self.print.clock.is_unsaved &= !is_whole || saved.is_err();
        match saved {
            Ok(()) if is_whole => self.replies.say(format_args!(
                "echo:Settings Stored ({} bytes: {count} values that differ from the profile's)",
                bytes.len()
            )),
            Ok(()) => {
                self.replies.say(format_args!("echo:M500: more values than the memory holds: the last are not stored"))
            }
            Err(error) => self.replies.say(format_args!("echo:M500: nothing is stored: {error}")),
        }
    }

    /// Adds the statistics' numbers that are not 0; `false` if the record is full.
    #[inline(never)]
    fn add_statistics(&mut self, record: &mut RecordWriter) -> bool {
        for (index, number) in (0..).zip(self.print.clock.statistics.numbers_mut()) {
            if *number > 0 && !record.add(Entry { id: STATISTICS, index, value: f64::from(*number) }) {
                return false;
            }
        }
        true
    }

    /// Copies the stored settings; `false` if the stored record cannot be read or does not fit.
    #[inline(never)]
    fn copy_settings(&self, memory: &dyn SettingsMemory, to: &mut RecordWriter) -> bool {
        let mut slot = [0; SLOT_BYTES];
        match memory.load(&mut slot) {
            Ok(None) => true,
            Ok(Some(bytes)) => Record::read(bytes, self.profile.name)
                .is_ok_and(|record| record.entries().filter(|entry| entry.id != STATISTICS).all(|entry| to.add(entry))),
            Err(_) => false,
        }
    }

    /// Returns true if heaters are on and writing the memory would stall the processor.
    // Generic over the memory: for one that never stalls, none of this is compiled.
    fn may_not_stall(&self, memory: &impl SettingsMemory) -> bool {
        memory.stalls() && Heater::ALL.into_iter().any(|heater| self.heating.status(heater).target_celsius > 0.0)
    }

    /// Rewrites the stored record with new statistics. An unreadable record stays as it is until
    /// M500.
    #[inline(never)]
    fn store_statistics(&mut self, memory: &dyn SettingsMemory) {
        let mut record = RecordWriter::new(self.profile.name);
        if !self.copy_settings(memory, &mut record) {
            return;
        }
        self.see_heat();
        if self.add_statistics(&mut record) {
            self.print.clock.is_unsaved = false;
            if let Err(error) = memory.save(record.bytes()) {
                self.replies.say(format_args!("echo:M78: the statistics are not stored: {error}"));
            }
        }
    }

    /// Executes M501. With `is_start`, an empty memory is not reported.
    #[inline(never)]
    fn load_settings(&mut self, memory: &dyn SettingsMemory, is_start: bool) -> Option<MotionChoice> {
        let stored = self.read_settings(memory, "M501", is_start)?;
        if is_start {
            self.print.clock.statistics = stored.statistics;
        }
        if stored.known > 0 || stored.foreign > 0 || stored.mesh.is_some() || !is_start {
            self.replies.say(format_args!("echo:stored settings retrieved ({stored})"));
        }
        self.load_mesh(memory, &stored);
        self.put_in_force(&stored.values)
    }

    /// The profile's values, replaced by the stored ones. Unusable stored values are named.
    #[inline(never)]
    fn read_settings(
        &self,
        memory: &dyn SettingsMemory,
        code: &str,
        names_differences: bool,
    ) -> Option<Stored<PartsOf<P>>> {
        let mut stored = Stored {
            values: self.profile_values(),
            known: 0,
            foreign: 0,
            faults: 0,
            differ: names_differences.then_some(0),
            mesh: None,
            statistics: Statistics::default(),
        };
        let mut slot = [0; SLOT_BYTES];
        let record = match memory.load(&mut slot) {
            Err(error) => {
                self.replies.say(format_args!("echo:{code}: {error}: the profile's settings are in force"));
                return None;
            }
            Ok(None) => return Some(stored),
            Ok(Some(bytes)) => match Record::read(bytes, self.profile.name) {
                Ok(record) => record,
                Err(error) => {
                    let rest = "the profile's are in force, M500 replaces them";
                    self.replies.say(format_args!("echo:{code}: the stored settings are not used, {error}: {rest}"));
                    return None;
                }
            },
        };
        for entry in record.entries() {
            self.take_entry(entry, &mut stored);
        }
        self.check(&mut stored);
        if let Some(differ @ 1..) = stored.differ {
            self.replies.say(format_args!(
                "echo:settings: what is stored is used in place of the profile's, values that differ: {differ} (M503); M502, \
                 then M500 takes the profile's"
            ));
        }
        Some(stored)
    }

    /// Applies a stored value that is known and within its range.
    fn take_entry(&self, entry: Entry, stored: &mut Stored<PartsOf<P>>) {
        let index = usize::from(entry.index);
        if entry.id == STATISTICS {
            // A number that does not fit the type counts as the nearest possible one.
            if let Some(number) = stored.statistics.numbers_mut().into_iter().nth(index) {
                *number = entry.value as u32;
            }
            return;
        }
        if entry.id == mesh::MESH && self.has_bed() {
            stored.mesh = stored.mesh.or(mesh::points(entry));
            return;
        }
        let known = setting_of(entry).filter(|(group, setting)| index < group.values_of(setting));
        let place =
            known.and_then(|(group, setting)| Some((group, setting, (setting.place)(&mut stored.values, index)?)));
        let Some((group, setting, mut place)) = place else {
            stored.foreign = stored.foreign.saturating_add(1);
            return;
        };
        stored.known = stored.known.saturating_add(1);
        let before = place.get();
        if !place.set(entry.value, setting.range) {
            stored.faults = stored.faults.saturating_add(1);
            let [least, most] = setting.range;
            self.replies.say(format_args!(
                "echo:settings: {} is stored as {}, expected {} to {}: the profile's {} is used",
                group.key(setting, index),
                Shown(entry.value),
                Shown(least),
                Shown(most),
                Shown(before),
            ));
        } else if let Some(differ) = &mut stored.differ
            && entry.value != before
        {
            // An image with a new profile has not changed this value; whoever flashed it should see
            // that.
            *differ = differ.saturating_add(1);
            if *differ <= MAX_NAMED {
                self.replies.say(format_args!(
                    "echo:settings: {} is stored as {}, the profile has {}",
                    group.key(setting, index),
                    Shown(entry.value),
                    Shown(before),
                ));
            }
        }
    }
}

/// Each value of each setting.
#[cfg(test)]
fn all_values() -> impl Iterator<Item = (&'static Setting<(crate::Present, crate::Present, crate::Present)>, usize)> {
    Group::all().flat_map(|group| {
        group.settings.iter().flat_map(|setting| (0..group.values_of(setting)).map(move |index| (setting, index)))
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
