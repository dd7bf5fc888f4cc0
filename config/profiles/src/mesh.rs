//! Measuring of the bed, and the range in which Z follows it.

use ferrostep_checked_toml::{Range, Section, range};
use ferrostep_planner::Kinematics;
use ferrostep_planner::surface::{MAX_MESH_POINTS, MeshInterpolation};
use ferrostep_printer::{MeshSettings, SafeHoming};
use ferrostep_virtual_board::SheetShape;

use crate::axes::{Travel, units_10nm};

const POINTS: Range = range(2.0, MAX_MESH_POINTS as f64, "points");
const AREA: Range = range(-2_000.0, 2_000.0, "mm");
const FADE: Range = range(0.0, 100.0, "mm");
const LIFT: Range = range(0.5, 50.0, "mm");
const DEPTH: Range = range(0.1, 3.0, "mm");
const SHEET: Range = range(-5.0, 5.0, "mm");
const SCATTER: Range = range(0.0, 1.0, "mm");
const SAMPLES: Range = range(1.0, 10.0, "approaches");

/// Distance of the first and last points from the bed's ends where no area is set: that of Prusa
/// (MIN_PROBE_EDGE). On the edge a probe may miss the sheet.
const DEFAULT_EDGE_MM: f64 = 5.0;
/// Prusa's number of points for a bed of 180 mm.
const DEFAULT_POINTS: [f64; 2] = [4.0, 4.0];
/// Height at which the correction has faded: a layer's height is no longer visible there,
/// and the top is far.
const DEFAULT_FADE_MM: f64 = 10.0;
/// Default depth: more than beds are bent, and little enough for a nozzle that presses on a sheet.
const DEFAULT_DEPTH_MM: f64 = 1.0;

/// Settings for measuring the bed; `None` without a probe, or without a motor that drives Z alone.
pub(crate) fn mesh(
    keys: &Section<'_>,
    travel: &Travel,
    safe: &SafeHoming,
    is_probe: bool,
    kinematics: Kinematics,
) -> Option<MeshSettings> {
    // Settings of a measurement that each machine repeats change no plan.
    let apart = keys.apart();
    let can_follow = is_probe && !kinematics.shares_motors(2);
    let reach_mm = reach_mm(travel, safe);
    let lift_mm = safe.raise_10nm as f64 / 100_000.0;
    let mut settings = MeshSettings {
        points: DEFAULT_POINTS.map(|points| points as u8),
        interpolation: MeshInterpolation::Bilinear,
        area_10nm: default_area_mm(reach_mm, safe).map(|ends| ends.map(units_10nm)),
        fade_10nm: units_10nm(DEFAULT_FADE_MM),
        lift_10nm: safe.raise_10nm,
        depth_10nm: units_10nm(DEFAULT_DEPTH_MM),
        samples: 1,
        sheet: SheetShape::FLAT,
    };
    let about = "with a probe: how [the bed is measured](levelling.md) (G29), and how far up Z follows it";
    if let Some(table) = apart.optional_section("mesh", "each key its default, with a probe", about) {
        if !is_probe {
            keys.refuse("mesh", "homing.z.sensor = \"probe\" with it: without a probe the bed cannot be measured");
        } else if !can_follow {
            let expected = "\"cartesian\" or \"corexy\" with the table [mesh]: on others Z shares its motor";
            keys.refuse("kinematics", expected);
        }
        let points = table.numbers("points", ["x", "y"], [POINTS; 2]).or(DEFAULT_POINTS, "number of points per axis");
        for (axis, number) in ["x", "y"].into_iter().zip(points) {
            if safe.is_round && number < 3.0 {
                table.refuse(
                    &format!("points.{axis}"),
                    "at least 3 points: the corners of the grid are outside the round bed",
                );
            }
            if number.fract() != 0.0 {
                table.refuse(&format!("points.{axis}"), "a whole number of points");
            }
        }
        settings.points = points.map(|points| points as u8);
        settings.interpolation = table
            .word("interpolation", [("bilinear", MeshInterpolation::Bilinear), ("bicubic", MeshInterpolation::Bicubic)])
            .or(MeshInterpolation::Bilinear, "surface [between the points](levelling.md#following-it)");
        let about = "probe positions of the first and last points";
        if let Some(area) =
            table.optional_section("area_mm", "what the probe reaches of the bed, less 5 mm at its ends", about)
        {
            for (index, axis) in ["x", "y"].into_iter().enumerate() {
                let ends = area.ends(axis, AREA).required("");
                let ([from, to], [least, most]) = (ends, reach_mm[index]);
                if can_follow && (from < least || to > most || to - from < 1.0) {
                    area.refuse(
                        axis,
                        format!(
                            "within {least} to {most} mm, and at least 1 mm wide: the probe does not reach more of \
                             the bed (homing.bed_mm, homing.probe_offset_mm and the travel)"
                        ),
                    );
                }
                settings.area_10nm[index] = ends.map(units_10nm);
            }
        }
        settings.fade_10nm = units_10nm(
            table
                .number("fade_mm", FADE)
                .or(DEFAULT_FADE_MM, "fade height: Z follows the bed up to it (M420 Z); 0 = to the top"),
        );
        settings.lift_10nm = units_10nm(
            table
                .number("lift_mm", LIFT.at_most(travel.upper_mm[2], "at most size_mm.z"))
                .optional("homing.raise_mm", "nozzle height between points")
                .unwrap_or(lift_mm),
        );
        settings.depth_10nm = units_10nm(table.number("depth_mm", DEPTH).or(
            DEFAULT_DEPTH_MM,
            "maximum depth of the bed below its height at home: the nozzle stops there if the probe does not trigger",
        ));
        settings.samples = table
            .whole("samples", SAMPLES)
            .or(1.0, "samples per point, each fast and then slow; their mean is used") as u8;
        if let Some(sheet) = table.optional_section(
            "sheet",
            "level and flat",
            "bed surface of the [virtual board](levelling.md#on-the-desk); a real one is measured",
        ) {
            let tilt = sheet.numbers("tilt_mm", ["x", "y"], [SHEET; 2]);
            settings.sheet = SheetShape {
                tilt_10nm: tilt
                    .or([0.0; 2], "rise of the surface from left to right and from front to back")
                    .map(units_10nm),
                bend_10nm: units_10nm(
                    sheet.number("bend_mm", SHEET).or(0.0, "height of the surface's middle above its corners"),
                ),
                scatter_10nm: units_10nm(
                    sheet.number("scatter_mm", SCATTER).or(0.0, "maximum error of the probe's trigger height"),
                ),
                ..SheetShape::FLAT
            };
        }
    }
    can_follow.then_some(settings)
}

/// Default area of the measurement: the part that the probe reaches, without the edges of the bed.
fn default_area_mm(reach_mm: [[f64; 2]; 2], safe: &SafeHoming) -> [[f64; 2]; 2] {
    [0, 1].map(|axis: usize| {
        let ([from, to], bed) = (reach_mm[axis], safe.bed_10nm[axis].map(|units| units as f64 / 100_000.0));
        // A small bed has a smaller edge.
        let edge_mm = DEFAULT_EDGE_MM.min((to - from).max(0.0) / 4.0);
        [from.max(bed[0] + edge_mm), to.min(bed[1] - edge_mm)]
    })
}

/// Part of the bed that the probe reaches, along X and along Y.
pub(crate) fn reach_mm(travel: &Travel, safe: &SafeHoming) -> [[f64; 2]; 2] {
    let mm = |units: i64| units as f64 / 100_000.0;
    [0, 1].map(|axis: usize| {
        let (offset, [from, to]) = (mm(safe.probe_offset_10nm[axis]), safe.bed_10nm[axis].map(mm));
        [from.max(travel.lower_mm[axis] + offset), to.min(travel.upper_mm[axis] + offset)]
    })
}
