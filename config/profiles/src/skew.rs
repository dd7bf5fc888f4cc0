//! Axes that are not at right angles.

use ferrostep_checked_toml::{Range, Section, range};
use ferrostep_printer::Skew;

use crate::axes::units_10nm;

const FACTOR: Range = range(-0.05, 0.05, "");
const _: () = assert!(Skew::MAX_FACTOR == 0.05);
const LENGTH: Range = range(10.0, 3_000.0, "mm");

/// Description of the factor of each plane, for the table of keys.
const PLANES: [(&str, &str); 3] = [
    ("xy", "skew of X and Y, from a printed square"),
    ("xz", "skew of X and Z, from an upright printed square"),
    ("yz", "skew of Y and Z, from an upright printed square"),
];

/// The skew of the axes, by measured lengths or by Marlin's and Klipper's factors; none
/// without the table.
pub(crate) fn skew(keys: &Section<'_>) -> Skew {
    let about = "deviation of the axes from [right angles](skew.md) (M852, SET_SKEW)";
    let Some(table) = keys.optional_section("skew", "axes at right angles", about) else { return Skew::NONE };
    Skew::of_factors(PLANES.map(|(name, about)| {
        let Some(plane) = table.optional_section(name, "at right angles", about) else { return 0.0 };
        let factor = plane.number("factor", FACTOR).optional(
            "from the three lengths",
            "tangent of the angle by which the second axis leans in the first one's direction, as Marlin and Klipper have it",
        );
        let lengths = [
            ("ac_mm", "diagonal from corner A, where both coordinates are smallest, to the opposite corner, C"),
            ("bd_mm", "other diagonal, from B, the corner next to A along the second axis, to D"),
            ("ad_mm", "side A to D, along the first axis"),
        ]
        .map(|(key, about)| plane.number(key, LENGTH).optional("from `factor`", about));
        match (factor, lengths) {
            (Some(factor), [None, None, None]) => factor,
            (None, [Some(ac), Some(bd), Some(ad)]) => match Skew::factor_of_diagonals([ac, bd, ad].map(|length| units_10nm(length) as u32)) {
                Some(factor) if factor.abs() <= Skew::MAX_FACTOR => f64::from(factor),
                Some(factor) => {
                    let most = Skew::MAX_FACTOR * 100.0;
                    let expected = format!(
                        "lengths of axes that are at most {most} % out of square, not {:.1} %: measure again, or mend the frame",
                        factor * 100.0
                    );
                    plane.refuse("ac_mm", expected);
                    0.0
                }
                None => {
                    plane.refuse("ac_mm", "the diagonals and the side of one parallelogram, in mm");
                    0.0
                }
            },
            _ => {
                table.refuse(name, "either factor, or ac_mm, bd_mm and ad_mm");
                0.0
            }
        }
    }))
}
