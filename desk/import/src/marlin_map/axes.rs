//! Marlin's settings of an axis: its travel, and how it homes.

use super::Reading;
use crate::draft::Draft;

impl Reading<'_> {
    pub(super) fn axis(&mut self, index: usize, axis: &str) {
        let upper = axis.to_ascii_uppercase();
        let low_name = format!("{upper}_MIN_POS");
        if self.keep_number(&low_name, &format!("lower_end_mm.{axis}"), |low| low.min(0.0)).is_some_and(|low| low > 0.0)
        {
            self.lose(&low_name, "a profile's travel begins at 0 or below");
        }
        let end = self.keep_number(&format!("{upper}_MAX_POS"), &format!("size_mm.{axis}"), |high| high);
        let homing = |key: &str| format!("homing.{axis}.{key}");
        let direction = format!("{upper}_HOME_DIR");
        let is_high = self.number(&direction).is_some_and(|direction| direction > 0.0);
        if self.number(&direction).is_some() {
            self.keep(&direction, &homing("end"), if is_high { "max" } else { "min" }, "");
        }
        self.draft.put(&homing("sensor"), "end-stop");
        let own = format!("MANUAL_{upper}_HOME_POS");
        if self.keep_number(&own, &homing("position_mm"), |place| place).is_none() {
            let low = self.number(&format!("{upper}_MIN_POS")).unwrap_or(0.0);
            let place = if is_high { end.unwrap_or(low) } else { low };
            self.draft.put(&homing("position_mm"), place);
        }
        self.reach_end_stop(axis, &own);
        let nth = |list: Option<Vec<Option<f64>>>| list.and_then(|list| list.get(index).copied().flatten());
        // Newer and the oldest files have one list in mm/min, those between two numbers.
        let older = if axis == "z" { "HOMING_FEEDRATE_Z" } else { "HOMING_FEEDRATE_XY" };
        let lists = ["HOMING_FEEDRATE_MM_M", "HOMING_FEEDRATE"];
        let fast = match lists.into_iter().find_map(|name| Some((name, nth(self.list(name))?))) {
            Some((name, feed)) => {
                self.keep(name, &homing("fast_mm_per_s"), feed / 60.0, "");
                Some(feed / 60.0)
            }
            None => self.keep_number(older, &homing("fast_mm_per_s"), |feed| feed / 60.0).map(|feed| feed / 60.0),
        };
        let stall = format!("{upper}_STALL_SENSITIVITY");
        let by_stall = self.get("SENSORLESS_HOMING").is_some() && axis != "z" && self.get(&stall).is_some();
        let back = nth(self.list("HOMING_BUMP_MM"));
        if let Some(fast) = fast.filter(|_| by_stall && back == Some(0.0)) {
            // Marlin homes once then, at the full speed.
            self.draft.put(&homing("slow_mm_per_s"), fast);
        } else if let Some(fast) = fast {
            let divisor = nth(self.list("HOMING_BUMP_DIVISOR")).filter(|divisor| *divisor >= 1.0);
            self.draft.put(&homing("slow_mm_per_s"), fast / divisor.unwrap_or(4.0));
            if divisor.is_some() {
                self.keep("HOMING_BUMP_DIVISOR", &homing("slow_mm_per_s"), fast / divisor.unwrap_or(4.0), "");
            }
        }
        match back {
            Some(0.0) => {
                if let Some(definition) = self.get("HOMING_BUMP_MM") {
                    let why = "a profile homes twice: the distance is above 0, and where it is 0 here the built-in one";
                    let row = self.row(definition, why);
                    self.draft.note(row);
                }
            }
            Some(back) => self.keep("HOMING_BUMP_MM", &homing("back_off_mm"), back, ""),
            None => {}
        }
        let side = if is_high { "MAX" } else { "MIN" };
        let path = homing("triggers_low");
        let state = format!("{upper}_{side}_ENDSTOP_HIT_STATE");
        if let Some(is_low) = self.is_low(&state, &path) {
            self.keep(&state, &path, is_low, "");
        }
        let inverting = format!("{upper}_{side}_ENDSTOP_INVERTING");
        if let Some(is_low) = self.is_low(&inverting, &path).map(|is_false| !is_false) {
            self.keep(&inverting, &path, is_low, "");
        }
        if by_stall {
            self.keep("SENSORLESS_HOMING", &homing("sensor"), "stall", "");
            // The signal of a driver is high, whatever the file says of a switch.
            self.draft.put(&path, false);
        } else if self.get("SENSORLESS_HOMING").is_some() && self.get(&stall).is_some() {
            let row = self.get("SENSORLESS_HOMING").map(|definition| self.row(definition, ""));
            self.draft.gap(&homing("sensor"), row, "Z would push the nozzle into the bed: give it a switch or a probe");
        }
    }

    /// The travel goes as far as the end stop is: an end stop beyond it would be at another
    /// machine's place.
    fn reach_end_stop(&mut self, axis: &str, name: &str) {
        let number = |draft: &Draft, path: String| draft.number(&path);
        let Some(place) =
            number(&self.draft, format!("homing.{axis}.position_mm")).filter(|_| self.get(name).is_some())
        else {
            return;
        };
        let why = "the travel goes as far as the end stop is";
        let (low, high) = (format!("lower_end_mm.{axis}"), format!("size_mm.{axis}"));
        if number(&self.draft, low.clone()).is_some_and(|low| place < low) {
            self.keep(name, &low, place, why);
        } else if number(&self.draft, high.clone()).is_some_and(|high| place > high) {
            self.keep(name, &high, place, why);
        }
    }
}
