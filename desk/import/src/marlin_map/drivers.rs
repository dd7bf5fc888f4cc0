//! Marlin's settings of motor drivers.

use super::Reading;

impl Reading<'_> {
    pub(super) fn driver(&mut self, axis: &str) {
        let upper = if axis == "e" { "E0".to_owned() } else { axis.to_ascii_uppercase() };
        let kind = format!("{upper}_DRIVER_TYPE");
        if self.get(&kind).is_none_or(|definition| definition.value != "TMC2209") {
            return;
        }
        let (current, microsteps) = (format!("{upper}_CURRENT"), format!("{upper}_MICROSTEPS"));
        let (Some(current_ma), Some(steps)) = (self.number(&current), self.number(&microsteps)) else {
            let why = format!("without {current} and {microsteps} (of Configuration_adv.h) it runs as its pins say");
            return self.lose(&kind, &why);
        };
        let path = |key: &str| format!("drivers.{axis}.{key}");
        self.keep(&kind, &path("current_ma"), current_ma as i64, "");
        self.keep(&current, &path("current_ma"), current_ma as i64, "");
        self.keep(&microsteps, &path("microsteps"), steps as i64, "");
        self.draft.put(&path("hold_current_percent"), 50);
        if let Some(hold) = self.number("HOLD_MULTIPLIER") {
            self.keep("HOLD_MULTIPLIER", &path("hold_current_percent"), (hold * 100.0).round() as i64, "");
        }
        let interpolates = self.flag("INTERPOLATE").unwrap_or(true);
        self.draft.put(&path("interpolate"), interpolates);
        self.keep("INTERPOLATE", &path("interpolate"), interpolates, "");
        let quiet = match axis {
            "z" => "STEALTHCHOP_Z",
            "e" => "STEALTHCHOP_E",
            _ => "STEALTHCHOP_XY",
        };
        self.draft.put(&path("stealth_chop"), self.get(quiet).is_some());
        self.keep(quiet, &path("stealth_chop"), true, "");
        self.draft.put(&path("spread_cycle_above_mm_per_s"), 0);
        let hybrid = format!("{upper}_HYBRID_THRESHOLD");
        if self.get("HYBRID_THRESHOLD").is_some() && self.get(quiet).is_some() {
            self.keep_number(&hybrid, &path("spread_cycle_above_mm_per_s"), |speed| speed as i64);
            self.keep("HYBRID_THRESHOLD", &path("stealth_chop"), true, "");
        }
        let stall = format!("{upper}_STALL_SENSITIVITY");
        let threshold = self.number(&stall).unwrap_or(0.0);
        self.draft.put(&path("stall_threshold"), threshold as i64);
        self.keep(&stall, &path("stall_threshold"), threshold as i64, "");
    }
}
