//! Marlin's settings of a second extruder.

use super::Reading;
use super::sensor::NO_SENSOR;

/// The board's sockets for extruders; Z may use some of them.
const SOCKETS: [&str; 3] = ["e1", "e2", "e3"];

impl Reading<'_> {
    /// The second extruder. To be read after the motors of Z and the heaters.
    pub(super) fn tools(&mut self) {
        let count = self.number("EXTRUDERS").unwrap_or(1.0);
        if !(2.0..3.0).contains(&count) {
            return;
        }
        let is_free = |socket: &&str| !self.draft.says(&format!("z_motors.motors.{socket}.inverted"));
        let Some(socket) = SOCKETS.into_iter().find(is_free) else { return };
        let why = format!("a socket of the board: plug the motor into {socket}, or change the name");
        self.draft.put("tools.t1.motor", socket);
        self.keep("EXTRUDERS", "tools.t1.motor", socket, &why);
        for axis in ["x", "y", "z"] {
            let name = format!("HOTEND_OFFSET_{}", axis.to_ascii_uppercase());
            let path = format!("tools.t1.offset_mm.{axis}");
            self.draft.put(&path, 0.0);
            if let Some(offset) = self.list(&name).and_then(|list| list.get(1).copied().flatten()) {
                self.keep(&name, &path, offset, "");
            }
        }
        let inverted = self.flag("INVERT_E1_DIR").unwrap_or(false);
        self.keep("INVERT_E1_DIR", "tools.t1.inverted", inverted, "check the direction of its motor");
        self.keep_number("TOOLCHANGE_ZRAISE", "tools.lift_mm", |lift| lift);
        if self.get("TOOLCHANGE_FILAMENT_SWAP").is_some() {
            self.lose("TOOLCHANGE_FILAMENT_SWAP", "by tools.retract_mm and tools.prime_mm");
            self.keep_number("TOOLCHANGE_FS_LENGTH", "tools.retract_mm", |length| length);
            self.keep_number("TOOLCHANGE_FS_EXTRA_PRIME", "tools.prime_mm", |length| length);
            self.keep_number("TOOLCHANGE_FS_RETRACT_SPEED", "tools.retract_mm_per_s", |speed| speed / 60.0);
            self.keep_number("TOOLCHANGE_FS_UNRETRACT_SPEED", "tools.prime_mm_per_s", |speed| speed / 60.0);
        }
        if self.get("SINGLENOZZLE").is_some() {
            return self.lose("SINGLENOZZLE", "by leaving out tools.t1.heater");
        }
        let Some(number) = self.number("TEMP_SENSOR_1").filter(|number| *number != 0.0) else { return };
        self.draft.put("tools.t1.heater", "nozzle1");
        match self.sensor_of(number, "HOTEND1", "tools.t1.nozzle") {
            Some(value) => self.keep("TEMP_SENSOR_1", "tools.t1.nozzle.sensor", value, "at the board's nozzle1"),
            None => {
                let row = self.get("TEMP_SENSOR_1").map(|definition| self.row(definition, NO_SENSOR));
                self.draft.gap("tools.t1.nozzle.sensor", row, NO_SENSOR);
            }
        }
        self.keep_number("HEATER_1_MINTEMP", "tools.t1.nozzle.min_celsius", |limit| limit);
        self.keep_number("HEATER_1_MAXTEMP", "tools.t1.nozzle.max_celsius", |limit| limit);
    }
}
