//! Marlin's settings of several motors that lift Z, and of their alignment.

use super::Reading;
use crate::expression::number;

/// The board's names for sockets, in the order in which Marlin's further drivers take them.
const SOCKETS: [(&str, &str); 3] = [("Z2", "z2"), ("Z3", "e1"), ("Z4", "e2")];

const POINTS: &str = "Z_STEPPER_ALIGN_XY";
const PLACES: &str = "Z_STEPPER_ALIGN_STEPPER_XY";

impl Reading<'_> {
    /// The motors of Z. To be read after the probe.
    pub(super) fn z_motors(&mut self) {
        // Marlin before 2.0.8 has a separate definition for their number.
        let said = ["NUM_Z_STEPPERS", "NUM_Z_STEPPER_DRIVERS"].into_iter().find(|name| self.get(name).is_some());
        let count = said.and_then(|name| self.number(name)).map_or(1, |count| count as usize);
        let is_there = |(index, (name, _)): &(usize, (&str, &str))| {
            index + 2 <= count || self.get(&format!("{name}_DRIVER_TYPE")).is_some()
        };
        let further: Vec<_> = SOCKETS.into_iter().enumerate().take_while(is_there).map(|(_, motor)| motor).collect();
        if further.is_empty() {
            return;
        }
        self.draft.put("z_motors.motors.z", toml::Table::new());
        let mut names = vec!["z"];
        for (name, socket) in further {
            let path = format!("z_motors.motors.{socket}.inverted");
            let inverts = format!("INVERT_{name}_VS_Z_DIR");
            let inverted = |name: &str| self.flag(name).unwrap_or(false);
            // Marlin's is the other way round than Z, the profile's than the board.
            let is_inverted = inverted(&inverts) != inverted("INVERT_Z_DIR");
            self.draft.put(&path, is_inverted);
            self.keep(&inverts, &path, is_inverted, "");
            let why = format!("a socket of the board: plug the motor into {socket}, or change the name");
            for name in [Some(format!("{name}_DRIVER_TYPE")), said.map(str::to_owned)].into_iter().flatten() {
                self.keep(&name, &path, is_inverted, &why);
            }
            for part in ["CURRENT", "MICROSTEPS", "RSENSE"] {
                self.lose(&format!("{name}_{part}"), "all motors of Z have the settings of its driver");
            }
            names.push(socket);
        }
        if self.get("Z_STEPPER_AUTO_ALIGN").is_some() && self.draft.word("homing.z.sensor") == Some("probe") {
            self.alignment(&names);
        }
    }

    fn alignment(&mut self, names: &[&str]) {
        let (points, known) = (self.places(POINTS), self.places(PLACES));
        if points.len() < names.len() {
            return;
        }
        self.lose("Z_STEPPER_AUTO_ALIGN", "by z_motors: G34");
        let (name, places, why) = if known.len() == names.len() {
            (PLACES, known, "")
        } else {
            (POINTS, points.clone(), "taken for the place of the motor: measure where it lifts the bed or the gantry")
        };
        for (motor, place) in names.iter().zip(places) {
            for (axis, place) in ["x", "y"].into_iter().zip(place) {
                self.keep(name, &format!("z_motors.motors.{motor}.{axis}"), place, why);
            }
        }
        for (number, point) in (1..).zip(points) {
            for (axis, place) in ["x", "y"].into_iter().zip(point) {
                self.keep(POINTS, &format!("z_motors.points.point{number}.{axis}"), place, "");
            }
        }
        for (name, word) in [("ITERATIONS", "I"), ("ACC", "T"), ("AMP", "A")] {
            self.lose(&format!("Z_STEPPER_ALIGN_{name}"), &format!("a word of the command: G34 {word}"));
        }
    }

    /// The places of a list of pairs.
    fn places(&self, name: &str) -> Vec<[f64; 2]> {
        let text = self.get(name).map_or("", |definition| definition.value.as_str());
        let numbers: Vec<f64> = text
            .split(['{', '}', ','])
            .filter(|part| !part.trim().is_empty())
            .filter_map(|part| number(part, &self.values))
            .collect();
        numbers.as_chunks().0.to_vec()
    }
}
