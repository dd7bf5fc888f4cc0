//! Klipper's settings of a second extruder.

use super::Reading;

const SECTION: &str = "extruder1";
/// The board's sockets for extruders; Z may use some of them.
const SOCKETS: [&str; 3] = ["e1", "e2", "e3"];
const HEATER: &str = "nozzle1";

impl Reading<'_> {
    /// The second extruder. To be read after the motors of Z and the first one.
    pub(super) fn tools(&mut self) {
        if self.section(SECTION).is_none() {
            return;
        }
        let is_free = |socket: &&str| !self.draft.says(&format!("z_motors.motors.{socket}.inverted"));
        let Some(socket) = SOCKETS.into_iter().find(is_free) else { return };
        self.draft.put("tools.t1.motor", socket);
        for axis in ["x", "y", "z"] {
            self.draft.put(&format!("tools.t1.offset_mm.{axis}"), 0.0);
        }
        let why = format!(
            "its pins are the board's: plug the motor into {socket}, or change the name; and write tools.t1.offset_mm, which Klipper \
             has in macros only"
        );
        self.keep(SECTION, "step_pin", &["tools.t1.motor"], socket, &why);
        let is_inverted = self.entry(SECTION, "dir_pin").is_some_and(|pin| pin.value.contains('!'));
        self.keep(SECTION, "dir_pin", &["tools.t1.inverted"], is_inverted, "its pin is the board's");
        self.steps_as(SECTION, "tools.t1.steps_per_mm");
        if self.keep_number(SECTION, "pressure_advance", &["tools.t1.pressure_advance.seconds"], |k| k).is_some() {
            let path = "tools.t1.pressure_advance.smooth_time_s";
            self.keep_number(SECTION, "pressure_advance_smooth_time", &[path], |time| time);
        }
        if self.entry(SECTION, "heater_pin").is_some() {
            let why = "name the board's connector that it hangs at";
            self.keep(SECTION, "heater_pin", &["tools.t1.heater"], HEATER, why);
            self.keep(SECTION, "sensor_pin", &["tools.t1.thermistor"], HEATER, why);
            if self.entry(SECTION, "control").is_some_and(|entry| entry.value == "mpc") {
                self.lose(SECTION, "control", "a PID loop holds a second nozzle: set its gains by hand");
            } else {
                self.heater(SECTION, "tools.t1.nozzle");
            }
        } else {
            self.lose(SECTION, "shared_heater", "by leaving out tools.t1.heater");
        }
        for key in ["nozzle_diameter", "filament_diameter", "min_extrude_temp", "max_extrude_only_distance"] {
            self.lose(SECTION, key, "as that of the first extruder");
        }
        self.driver_as(SECTION, "tools.t1.driver", "tools.t1.steps_per_mm");
    }
}
