//! The printer that a job was sliced for, as the slicer's comments describe it.
//!
//! PrusaSlicer, SuperSlicer and Slic3r write `bed_shape` and `max_print_height` at the file's end,
//! OrcaSlicer and Bambu Studio `printable_area` and `printable_height` at either end; Simplify3D
//! writes the strokes of its machine at the beginning. ideaMaker writes the sides of its machine as
//! `Dimension`, and after them the nozzles' diameters. Cura says only how far the part reaches.
//!
//! Prusa's family writes the limits of speed as `machine_max_feedrate_x`, OrcaSlicer and Bambu
//! Studio as `machine_max_speed_x`; all of them write `machine_max_acceleration_x`.

use std::fmt;

/// The travel of the printer that a job was sliced for, mm, where the slicer gives it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SlicedFor {
    /// Lower and upper end of X and of Y.
    bed_mm: [Option<[f64; 2]>; 2],
    height_mm: Option<f64>,
    /// Simplify3D's place of the origin on the bed, X and Y.
    origin_mm: [f64; 2],
    /// True after ideaMaker's first line: only then are its keys, which are plain words, read.
    is_ideamaker: bool,
    /// True if ideaMaker's origin is the middle of the bed, not its corner.
    is_origin_centred: bool,
    /// Lower and upper end of the printed part, X, Y and Z.
    part_mm: [[Option<f64>; 2]; 3],
    /// The first comment whose value is no travel.
    unreadable: Option<String>,
    /// The printer's model.
    model: Option<String>,
    /// Limits by their key in a profile, one each of [`LIMITS`].
    limits: [Option<f64>; LIMITS.len()],
    /// Acceleration of travel moves, mm/s^2: not every slicer has one.
    travel_mm_per_s2: Option<f64>,
    /// True if the job sets these limits by commands.
    emits_limits: bool,
}

const PRINT_KEY: &str = "acceleration_mm_per_s2.print";

/// The limits, each by its keys in a slicer's comments, and by its key in a profile.
const LIMITS: [(&[&str], &str); 10] = [
    (&["machine_max_feedrate_x", "machine_max_speed_x"], "max_feed_mm_per_s.x"),
    (&["machine_max_feedrate_y", "machine_max_speed_y"], "max_feed_mm_per_s.y"),
    (&["machine_max_feedrate_z", "machine_max_speed_z"], "max_feed_mm_per_s.z"),
    (&["machine_max_feedrate_e", "machine_max_speed_e"], "max_feed_mm_per_s.e"),
    (&["machine_max_acceleration_x"], "max_acceleration_mm_per_s2.x"),
    (&["machine_max_acceleration_y"], "max_acceleration_mm_per_s2.y"),
    (&["machine_max_acceleration_z"], "max_acceleration_mm_per_s2.z"),
    (&["machine_max_acceleration_e"], "max_acceleration_mm_per_s2.e"),
    (&["machine_max_acceleration_extruding"], PRINT_KEY),
    (&["machine_max_acceleration_retracting"], "acceleration_mm_per_s2.retract"),
];

impl SlicedFor {
    /// Takes in the comments of a text. The first of two equal keys counts.
    pub(super) fn read(&mut self, text: &[u8]) {
        for line in text.split(|byte| *byte == b'\n') {
            let Some(comment) = line.trim_ascii().strip_prefix(b";") else { continue };
            let Ok(comment) = std::str::from_utf8(comment) else { continue };
            self.take(comment.trim());
        }
    }

    /// Takes in one setting.
    pub(super) fn take(&mut self, setting: &str) {
        self.is_ideamaker |= setting.starts_with("Sliced by ideaMaker");
        let Some(at) = setting.find(['=', ':', ',']) else { return };
        let (key, value) = (setting[..at].trim_end(), setting[at + 1..].trim());
        let is_read = match key {
            "bed_shape" | "printable_area" => self.take_bed(value),
            "max_print_height" | "printable_height" => take(&mut self.height_mm, travel(value)),
            "strokeXoverride" => take_stroke(&mut self.bed_mm[0], travel(value)),
            "strokeYoverride" => take_stroke(&mut self.bed_mm[1], travel(value)),
            "strokeZoverride" => take(&mut self.height_mm, travel(value)),
            "originOffsetXoverride" => origin(&mut self.origin_mm[0], value),
            "originOffsetYoverride" => origin(&mut self.origin_mm[1], value),
            "Dimension" if self.is_ideamaker => self.take_sides(value),
            "Origin Center" if self.is_ideamaker => {
                self.is_origin_centred = value == "1";
                matches!(value, "0" | "1")
            }
            "MINX" => reach(&mut self.part_mm[0][0], value),
            "MINY" => reach(&mut self.part_mm[1][0], value),
            "MAXX" => reach(&mut self.part_mm[0][1], value),
            "MAXY" => reach(&mut self.part_mm[1][1], value),
            "MAXZ" => reach(&mut self.part_mm[2][1], value),
            "printer_model" => self.take_model(value),
            "Printer Type" if self.is_ideamaker => self.take_model(value),
            "machine_limits_usage" => {
                self.emits_limits |= value == "emit_to_gcode";
                true
            }
            "machine_max_acceleration_travel" => {
                self.travel_mm_per_s2 = self.travel_mm_per_s2.or(normal_mode(value));
                true
            }
            "emit_machine_limits_to_gcode" => {
                self.emits_limits |= value == "1";
                true
            }
            _ => {
                let known = LIMITS.iter().zip(&mut self.limits).find(|((keys, _), _)| keys.contains(&key));
                if let Some((_, own)) = known {
                    *own = own.or(normal_mode(value));
                }
                true
            }
        };
        if !is_read && self.unreadable.is_none() {
            self.unreadable = Some(setting.chars().take(60).collect());
        }
    }

    /// The corners of the bed, `0x0,250x0,250x210,0x210`; a round one has many.
    fn take_bed(&mut self, corners: &str) -> bool {
        let mut ends = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for corner in corners.split(',') {
            let Some((x, y)) = corner.trim().split_once('x') else { return false };
            for (ends, place) in ends.iter_mut().zip([x, y]) {
                let Some(place) = finite(place) else { return false };
                *ends = [ends[0].min(place), ends[1].max(place)];
            }
        }
        if ends.iter().any(|[lower, upper]| upper <= lower) {
            return false;
        }
        for (own, ends) in self.bed_mm.iter_mut().zip(ends) {
            own.get_or_insert(ends);
        }
        true
    }

    /// The sides of ideaMaker's machine, `305.000 305.000 605.000 0.400`, X, Y, Z and nozzles.
    fn take_sides(&mut self, sides: &str) -> bool {
        let mut sides = sides.split_ascii_whitespace().map(travel);
        let (Some(Some(x)), Some(Some(y)), Some(Some(z))) = (sides.next(), sides.next(), sides.next()) else {
            return false;
        };
        for (own, side) in self.bed_mm.iter_mut().zip([x, y]) {
            own.get_or_insert([0.0, side]);
        }
        self.height_mm.get_or_insert(z);
        true
    }

    fn take_model(&mut self, model: &str) -> bool {
        self.model.get_or_insert_with(|| model.chars().filter(|each| !each.is_control()).take(60).collect());
        true
    }

    /// The first setting that is no travel.
    pub fn unreadable(&self) -> Option<&str> {
        self.unreadable.as_deref()
    }

    /// The printer's model, if the slicer names it.
    pub fn model(&self) -> Option<&str> {
        self.model.as_deref().filter(|model| !model.is_empty())
    }

    /// The printer's limits as a profile has them, key and value; `None` where one is missing, or
    /// where the job sets them by commands. Travel moves have the acceleration of printing if the
    /// slicer names no other.
    pub fn limits(&self) -> Option<Vec<(&'static str, f64)>> {
        let own = LIMITS.iter().zip(self.limits).map(|((_, key), limit)| Some((*key, limit?)));
        let mut limits: Vec<_> = own.collect::<Option<_>>()?;
        let print = limits.iter().find(|(key, _)| *key == PRINT_KEY).map(|(_, limit)| *limit);
        limits.extend(self.travel_mm_per_s2.or(print).map(|limit| ("acceleration_mm_per_s2.travel", limit)));
        (!self.emits_limits).then_some(limits)
    }

    /// The travel of the printer instead of another one, mm: lower and upper ends of X, Y and Z. A
    /// bed that is not given is the other's, made larger if the part reaches beyond it.
    pub fn travel_mm(&self, other_mm: [[f64; 2]; 3]) -> [[f64; 2]; 3] {
        let [bed_x, bed_y] = [0, 1].map(|axis: usize| {
            let [lower, upper] = self.bed_mm[axis]?;
            let origin = if self.is_origin_centred { 0.5 * (lower + upper) } else { self.origin_mm[axis] };
            Some([lower - origin, upper - origin])
        });
        let said = [bed_x, bed_y, self.height_mm.map(|height| [other_mm[2][0], height])];
        std::array::from_fn(|axis| {
            said[axis].unwrap_or_else(|| {
                let ([lower, upper], [least, most]) = (other_mm[axis], self.part_mm[axis]);
                [least.map_or(lower, |least| lower.min(least)), most.map_or(upper, |most| upper.max(most))]
            })
        })
    }
}

fn finite(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|number: &f64| number.is_finite())
}

/// The first of two values, which is that of the printer's normal mode.
fn normal_mode(values: &str) -> Option<f64> {
    travel(values.split(',').next().unwrap_or_default())
}

/// A length that a machine can travel.
fn travel(text: &str) -> Option<f64> {
    finite(text).filter(|length| *length > 0.0)
}

fn take(own: &mut Option<f64>, length: Option<f64>) -> bool {
    let is_read = length.is_some();
    *own = own.or(length);
    is_read
}

fn take_stroke(own: &mut Option<[f64; 2]>, length: Option<f64>) -> bool {
    let is_read = length.is_some();
    *own = own.or(length.map(|length| [0.0, length]));
    is_read
}

fn origin(own: &mut f64, text: &str) -> bool {
    finite(text).map(|place| *own = place).is_some()
}

/// The end of a part. Cura writes numbers beyond any machine before it knows them.
fn reach(own: &mut Option<f64>, text: &str) -> bool {
    let place = finite(text);
    *own = own.or(place.filter(|place| place.abs() < 100_000.0));
    place.is_some()
}

/// A travel: `250 x 210 x 210 mm`, and where it begins if that is not 0.
pub struct Shown(pub [[f64; 2]; 3]);

impl fmt::Display for Shown {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.0.map(|[lower, upper]| upper - lower);
        write!(out, "{x} x {y} x {z} mm")?;
        let [x, y, _] = self.0.map(|[lower, _]| lower);
        if x != 0.0 || y != 0.0 { write!(out, " from X{x} Y{y}") } else { Ok(()) }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const OTHER_MM: [[f64; 2]; 3] = [[0.0, 200.0]; 3];

    fn of(text: &str) -> SlicedFor {
        let mut said = SlicedFor::default();
        said.read(text.as_bytes());
        said
    }

    #[test]
    fn each_slicer_says_it_in_its_way() {
        let cases = [
            (
                "; bed_shape = 0x0,250x0,250x210,0x210\n; max_print_height = 220\n",
                [[0.0, 250.0], [0.0, 210.0], [0.0, 220.0]],
            ),
            (
                "; printable_area = 0x0,256x0,256x256,0x256\r\n; printable_height = 250\r\n",
                [[0.0, 256.0], [0.0, 256.0], [0.0, 250.0]],
            ),
            ("; bed_shape = 0x-90,90x0,0x90,-90x0", [[-90.0, 90.0], [-90.0, 90.0], [0.0, 200.0]]),
            (
                ";   strokeXoverride,300\n;   strokeYoverride,310\n;   strokeZoverride,400\n;   originOffsetXoverride,150\n",
                [[-150.0, 150.0], [0.0, 310.0], [0.0, 400.0]],
            ),
            (";MINX:10.5\n;MINY:-4\n;MAXX:280.2\n;MAXY:40\n;MAXZ:20", [[0.0, 280.2], [-4.0, 200.0], [0.0, 200.0]]),
            (";MINX:2.14748e+06\n;MAXX:-2.14748e+06", OTHER_MM),
            ("G1 X1 ; bed_shape = 0x0,10x10", OTHER_MM),
            (
                ";Sliced by ideaMaker 5.4.2.8790, 2026-03-01 10:00:00 UTC+0000\n;Dimension: 305.000 300.000 605.000 0.400 0.400\n\
                 ;Plate Shape: 0\n;Origin Center: 0\n",
                [[0.0, 305.0], [0.0, 300.0], [0.0, 605.0]],
            ),
            (
                ";Sliced by ideaMaker 4.1.0\r\n;Dimension: 260 240 350 0.4\r\n;Origin Center: 1\r\n",
                [[-130.0, 130.0], [-120.0, 120.0], [0.0, 350.0]],
            ),
            // The same words of another program.
            (";Dimension: 20 x 20 x 20\n;Origin Center: yes", OTHER_MM),
        ];
        for (text, travel_mm) in cases {
            let said = of(text);
            assert_eq!((said.travel_mm(OTHER_MM), said.unreadable()), (travel_mm, None), "{text}");
        }
    }

    #[test]
    fn limits_are_all_or_none() {
        let line = |(keys, _): &(&[&str], &str)| format!("; {} = 120,60\n", keys.last().unwrap());
        let all: String = LIMITS.iter().map(line).collect();
        let limits = of(&all).limits().unwrap();
        assert_eq!((limits[0], limits[9]), (("max_feed_mm_per_s.x", 120.0), ("acceleration_mm_per_s2.retract", 120.0)));
        for other in [
            all.replace("speed_z = 120", "speed_z = fast"),
            all.replace("acceleration_e = 120", "acceleration_e = 0"),
            format!("{all}; machine_limits_usage = emit_to_gcode\n"),
            format!("{all}; emit_machine_limits_to_gcode = 1\n"),
        ] {
            assert_eq!(of(&other).limits(), None, "{other}");
        }
        assert_eq!(of("; printer_model = Voron 2.4\n").model(), Some("Voron 2.4"));
        assert_eq!(of("; printer_model = \n").model(), None);
        let idea = ";Sliced by ideaMaker 5.4.2.8790\n;Printer Type: RAISE3D Pro2 Plus\n";
        assert_eq!(of(idea).model(), Some("RAISE3D Pro2 Plus"));
    }

    #[test]
    fn what_is_no_travel_is_named_and_replaced_by_nothing() {
        for setting in [
            "bed_shape = 0x0,250x0,250x210,0xy",
            "bed_shape =",
            "bed_shape = 5x5",
            "printable_area = 0x0,infx0,1x1",
            "max_print_height = tall",
            "printable_height = -250",
            "strokeXoverride,0",
            "MAXX:nan",
        ] {
            let said = of(&format!("; {setting}\n"));
            assert_eq!((said.travel_mm(OTHER_MM), said.unreadable()), (OTHER_MM, Some(setting)));
        }
        for setting in ["Dimension: 305 305", "Dimension: 305 305 -1 0.4", "Dimension: wide", "Origin Center: here"] {
            let said = of(&format!(";Sliced by ideaMaker 5.4.2\n;{setting}\n"));
            assert_eq!((said.travel_mm(OTHER_MM), said.unreadable()), (OTHER_MM, Some(setting)));
        }
    }
}
