//! The levelling screws of the bed.

use ferrostep_checked_toml::{Range, Section, range};
use ferrostep_printer::{BedScrew, BedScrews, SafeHoming};

use crate::axes::units_10nm;
use crate::names::check_name;

const PITCH: Range = range(0.1, 10.0, "mm");
const PLACE: Range = range(-1_000.0, 2_000.0, "mm");
/// Longest name, bytes.
const MAX_NAME: usize = 24;

/// The bed's screws, if the profile names some; `reach_mm` is the part of the bed that the probe
/// reaches along X and Y.
pub(crate) fn bed_screws(
    keys: &Section<'_>,
    reach_mm: &[[f64; 2]; 2],
    safe: &SafeHoming,
    is_measured: bool,
) -> Option<BedScrews> {
    let about = "with a probe: how far to [turn the screws](levelling.md#screws) of the bed (G35)";
    let table = keys.optional_section("bed_screws", "not known", about)?;
    if !is_measured {
        keys.refuse("bed_screws", "homing.z.sensor = \"probe\" with it, and a motor for Z alone");
    }
    let pitch = table.number("pitch_mm", PITCH).required("thread pitch: 0.5 for M3, 0.7 for M4, 0.8 for M5");
    let clockwise_lifts = table.flag("clockwise_lifts").or(true, "turning clockwise raises the bed to the nozzle");
    let places = table.named_sections(
        "places",
        "NAME",
        "",
        "2 to 8 screws; the first is the reference for the others",
        "a screw of this name",
    );
    let mut screws = [None; BedScrews::MAX];
    for (index, (name, section)) in places.iter().enumerate() {
        let place_mm = ["x", "y"]
            .map(|axis| section.number(axis, PLACE).required("screw position, within what the probe reaches"));
        for (axis, (place, [least, most])) in ["x", "y"].into_iter().zip(place_mm.into_iter().zip(*reach_mm)) {
            if is_measured && !(least..=most).contains(&place) {
                section.refuse(axis, format!("{least} to {most} mm: the probe does not reach it"));
            }
        }
        if is_measured && !safe.is_above_bed(place_mm.map(units_10nm)) {
            section.refuse("x", "a place on the round bed (homing.bed_mm)");
        }
        check_name(keys, &format!("bed_screws.places.{name}"), name, MAX_NAME);
        if let Some(screw) = screws.get_mut(index) {
            *screw = Some(BedScrew { name, place_10nm: place_mm.map(units_10nm) });
        }
    }
    if !(2..=BedScrews::MAX).contains(&places.len()) {
        table.refuse("places", format!("2 to {} screws", BedScrews::MAX));
    }
    Some(BedScrews { pitch_10nm: units_10nm(pitch), clockwise_lifts, screws })
}
