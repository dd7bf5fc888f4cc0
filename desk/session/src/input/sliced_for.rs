//! The printer that a job was sliced for, as the slicer's comments describe it.
//!
//! PrusaSlicer, SuperSlicer and Slic3r write `bed_shape` and `max_print_height` at the file's end,
//! OrcaSlicer and Bambu Studio `printable_area` and `printable_height` at either end; Simplify3D
//! writes the strokes of its machine at the beginning. Cura says only how far the part reaches.

use std::fmt;

/// The travel of the printer that a job was sliced for, mm, as far as the slicer says it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SlicedFor {
    /// Lower and upper end of X and of Y.
    bed_mm: [Option<[f64; 2]>; 2],
    height_mm: Option<f64>,
    /// Simplify3D's place of the origin on the bed, X and Y.
    origin_mm: [f64; 2],
    /// Lower and upper end of what is printed, X, Y and Z.
    part_mm: [[Option<f64>; 2]; 3],
    /// The first comment whose value is no travel.
    unreadable: Option<String>,
}

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
            "MINX" => reach(&mut self.part_mm[0][0], value),
            "MINY" => reach(&mut self.part_mm[1][0], value),
            "MAXX" => reach(&mut self.part_mm[0][1], value),
            "MAXY" => reach(&mut self.part_mm[1][1], value),
            "MAXZ" => reach(&mut self.part_mm[2][1], value),
            _ => true,
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

    /// The first setting that is no travel.
    pub fn unreadable(&self) -> Option<&str> {
        self.unreadable.as_deref()
    }

    /// The travel of the printer instead of another one, mm: lower and upper ends of X, Y and Z. A
    /// bed that is not said is the other's, made larger if the part reaches beyond it.
    pub fn travel_mm(&self, other_mm: [[f64; 2]; 3]) -> [[f64; 2]; 3] {
        let [bed_x, bed_y] =
            [0, 1].map(|axis: usize| self.bed_mm[axis].map(|ends| ends.map(|end| end - self.origin_mm[axis])));
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
        ];
        for (text, travel_mm) in cases {
            let said = of(text);
            assert_eq!((said.travel_mm(OTHER_MM), said.unreadable()), (travel_mm, None), "{text}");
        }
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
    }
}
