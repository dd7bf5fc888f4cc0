//! Modes: settings made by commands, beside those of moves.

use ferrostep_gcode::BedArea;
use ferrostep_hal_shim::Heater;

use crate::job::tool_box::ToolBox;
use crate::part::Part;
use crate::settings::profile::Profile;

/// Settings made by commands, beside those of moves. `T`: whether there may be several tools.
#[derive(Debug)]
pub(crate) struct Modes<T: Part> {
    /// The selected tool, of several.
    pub tools: T::Of<ToolBox>,
    /// Targets that commands have set, degrees Celsius. A heater that is off against them was
    /// switched off by its timeout.
    pub targets_celsius: [f32; Heater::COUNT],
    /// A print pauses when its filament has run out (M412).
    pub pauses_at_runout: bool,
    /// Filament that a change draws out and pushes in, units of 10 nm (M603).
    pub filament_10nm: [i64; 2],
    /// M555: which part of the bed is measured next.
    pub bed_area: Option<BedArea>,
}

impl<T: Part> Modes<T> {
    /// Modes of a machine that has just been switched on.
    pub fn new(profile: &Profile) -> Self {
        Self {
            tools: T::of(ToolBox::new(profile)),
            targets_celsius: [0.0; Heater::COUNT],
            pauses_at_runout: profile.filament_sensor.is_some(),
            filament_10nm: profile.pause.filament_10nm(),
            bed_area: None,
        }
    }

    /// No heater is to be hot any more.
    pub fn forget_targets(&mut self) {
        self.targets_celsius = [0.0; Heater::COUNT];
    }
}
