//! Marlin's sensors of filament.

use super::Reading;

impl Reading<'_> {
    /// The sensor that sees filament move, or the switch that reports its presence; the switch's
    /// state is the one without filament.
    pub(super) fn filament_sensor(&mut self) {
        let is_on = self.flag("FIL_RUNOUT_ENABLED_DEFAULT").unwrap_or(true);
        if self.get("FILAMENT_RUNOUT_SENSOR").is_none() || !is_on {
            return;
        }
        let both = self.get("FILAMENT_SWITCH_AND_MOTION").is_some();
        if both || self.get("FILAMENT_MOTION_SENSOR").is_some() {
            // The state is the switch's if both exist.
            let names: &[&str] = if both {
                &["FILAMENT_SWITCH_AND_MOTION"]
            } else {
                &["FILAMENT_RUNOUT_SENSOR", "FILAMENT_MOTION_SENSOR"]
            };
            for name in names {
                self.keep(name, "filament_sensor.kind", "motion", "its pin is the board's");
            }
            self.keep_number("FILAMENT_RUNOUT_DISTANCE_MM", "filament_sensor.detection_mm", |length| length);
            if !both {
                self.lose("FIL_RUNOUT_STATE", "neither level of a motion sensor says anything");
                return;
            }
        }
        let path = if both { "filament_switch.missing_is_low" } else { "filament_sensor.missing_is_low" };
        let missing_is_low = self.is_low("FIL_RUNOUT_STATE", path).unwrap_or(true);
        for name in ["FILAMENT_RUNOUT_SENSOR", "FIL_RUNOUT_STATE"] {
            self.keep(name, path, missing_is_low, "its pin is the board's");
        }
    }
}
