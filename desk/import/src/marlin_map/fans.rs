//! Marlin's fans.

use super::Reading;

impl Reading<'_> {
    pub(super) fn fans(&mut self) {
        self.keep_number("FAN_KICKSTART_TIME", "fans.part.kick_start_s", |milliseconds| milliseconds / 1000.0);
        self.keep_number("FAN_MIN_PWM", "fans.part.least_power", |byte| byte / 255.0);
        if self.get("USE_CONTROLLER_FAN").is_none() {
            return;
        }
        let path = |key: &str| format!("fans.controller.{key}");
        self.draft.put(&path("output"), "fan2");
        let why = "name the board's output that it hangs at: fans.controller.output";
        self.keep("USE_CONTROLLER_FAN", &path("turns"), "controller", why);
        for (name, key, share) in [
            ("CONTROLLERFAN_SPEED_ACTIVE", "power", 255.0),
            ("CONTROLLERFAN_SPEED", "power", 255.0),
            ("CONTROLLERFAN_IDLE_TIME", "idle_s", 1.0),
            ("CONTROLLERFAN_SECS", "idle_s", 1.0),
        ] {
            self.keep_number(name, &path(key), |number| number / share);
        }
    }
}
