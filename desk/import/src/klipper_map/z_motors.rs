//! Klipper's settings of several motors that lift Z, and of their alignment.

use super::Reading;
use super::axes::two_numbers;

/// The board's names for sockets, in the order in which Klipper's further motors take them.
const SOCKETS: [(&str, &str); 3] = [("stepper_z1", "z2"), ("stepper_z2", "e1"), ("stepper_z3", "e2")];

const TILT: &str = "z_tilt";
const GANTRY: &str = "quad_gantry_level";

impl Reading<'_> {
    /// The motors of Z. To be read after the probe: Klipper's points are the nozzle's.
    pub(super) fn z_motors(&mut self) {
        let further: Vec<_> = SOCKETS.into_iter().take_while(|(section, _)| self.section(section).is_some()).collect();
        if further.is_empty() {
            return;
        }
        self.draft.put("z_motors.motors.z", toml::Table::new());
        for (section, socket) in &further {
            let is_inverted = self.entry(section, "dir_pin").is_some_and(|pin| pin.value.contains('!'));
            let why = format!("its pins are the board's: plug it into the socket {socket}, or change the name");
            let path = format!("z_motors.motors.{socket}.inverted");
            self.draft.put(&path, is_inverted);
            self.keep(section, "dir_pin", &[&path], is_inverted, &why);
            for key in ["rotation_distance", "microsteps", "full_steps_per_rotation", "gear_ratio"] {
                self.lose(section, key, "as that of stepper_z: all motors of Z make the same steps");
            }
        }
        let mut names = vec!["z"];
        names.extend(further.iter().map(|(_, socket)| *socket));
        if self.draft.word("homing.z.sensor") == Some("probe") {
            self.alignment(&names);
        }
    }

    fn alignment(&mut self, names: &[&str]) {
        let (section, key, places) = if self.section(GANTRY).is_some() {
            // Clockwise from the front left one, as Klipper numbers them: front left, back left,
            // back right, front right.
            let corners = self.places(GANTRY, "gantry_corners");
            let [[left, front], [right, back]] = *corners.as_slice() else { return };
            (GANTRY, "gantry_corners", vec![[left, front], [left, back], [right, back], [right, front]])
        } else {
            (TILT, "z_positions", self.places(TILT, "z_positions"))
        };
        let points = self.places(section, "points");
        if places.len() != names.len() || points.is_empty() {
            return;
        }
        for (name, place) in names.iter().zip(places) {
            for (axis, place) in ["x", "y"].into_iter().zip(place) {
                self.keep(section, key, &[&format!("z_motors.motors.{name}.{axis}")], place, "");
            }
        }
        let offset = ["x", "y"].map(|axis| self.draft.number(&format!("homing.probe_offset_mm.{axis}")).unwrap_or(0.0));
        for (number, point) in (1..).zip(points) {
            for ((axis, place), offset) in ["x", "y"].into_iter().zip(point).zip(offset) {
                let path = format!("z_motors.points.point{number}.{axis}");
                self.keep(section, "points", &[&path], place + offset, "where the probe is, not the nozzle");
            }
        }
        self.keep_number(section, "max_adjust", &["z_motors.max_correction_mm"], |most| most);
        for key in ["retries", "retry_tolerance"] {
            self.lose(section, key, "words of the command: RETRIES and RETRY_TOLERANCE, or G34 I and T");
        }
        for key in ["speed", "horizontal_move_z"] {
            self.lose(section, key, "as on the way to the points of the mesh");
        }
    }

    /// The places of a setting, a line each.
    fn places(&self, section: &str, key: &str) -> Vec<[f64; 2]> {
        let lines = self.entry(section, key).map_or("", |entry| entry.value.as_str()).lines();
        lines.filter(|line| !line.trim().is_empty()).map_while(two_numbers).collect()
    }
}
