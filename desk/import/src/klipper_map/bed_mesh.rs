//! Klipper's settings of the bed's mesh and of its screws.

use ferrostep_printer::BedScrews;
use toml::Value;

use super::axes::two_numbers;
use super::{Reading, profile_name};
use crate::imported::Row;

const SECTION: &str = "bed_mesh";

/// Travel of the bed for one turn of Klipper's threads, mm; `CW` before the name:
/// clockwise lifts it.
const PITCHES_MM: [(&str, f64); 4] = [("M3", 0.5), ("M4", 0.7), ("M5", 0.8), ("M6", 1.0)];
const USUAL_THREAD: &str = "CW-M3";

impl Reading<'_> {
    /// The mesh. To be read after the probe: without one a profile has none.
    pub(super) fn bed_mesh(&mut self) {
        if self.section(SECTION).is_none() || self.draft.word("homing.z.sensor") != Some("probe") {
            return;
        }
        let corner = |key: &str| self.entry(SECTION, key).and_then(|entry| two_numbers(&entry.value));
        if let (Some(from), Some(to)) = (corner("mesh_min"), corner("mesh_max")) {
            for ((axis, from), to) in ["x", "y"].into_iter().zip(from).zip(to) {
                let ends = Value::from(vec![from, to]);
                for key in ["mesh_min", "mesh_max"] {
                    self.keep(SECTION, key, &[&format!("mesh.area_mm.{axis}")], ends.clone(), "");
                }
            }
        }
        self.round_bed();
        // One number is for both axes.
        let count = self.entry(SECTION, "probe_count").map(|entry| entry.value.as_str());
        let count = count.and_then(|text| two_numbers(text).or_else(|| text.trim().parse().ok().map(|both| [both; 2])));
        for (axis, points) in ["x", "y"].into_iter().zip(count.into_iter().flatten()) {
            self.keep(SECTION, "probe_count", &[&format!("mesh.points.{axis}")], points as i64, "");
        }
        if let Some(entry) = self.entry(SECTION, "algorithm") {
            let why = if entry.value == "bicubic" { "" } else { "the curve between two points is of four of them" };
            self.keep(SECTION, "algorithm", &["mesh.interpolation"], "bicubic", why);
        }
        // Klipper's fade is complete at its end, and off without the key.
        if self.keep_number(SECTION, "fade_end", &["mesh.fade_mm"], |height| height).is_none() {
            self.draft.put("mesh.fade_mm", 0.0);
        }
        self.keep_number(SECTION, "horizontal_move_z", &["mesh.lift_mm"], |height| height);
        for section in ["probe", "bltouch"] {
            if let Some(samples) = self.number(section, "samples") {
                self.keep(section, "samples", &["mesh.samples"], samples as i64, "of the mesh; their mean counts");
            }
        }
    }

    /// A mesh with a radius is of a round bed, which is taken to be as large.
    fn round_bed(&mut self) {
        let Some(radius) = self.number(SECTION, "mesh_radius").map(f64::abs) else { return };
        let origin = self.entry(SECTION, "mesh_origin").and_then(|entry| two_numbers(&entry.value)).unwrap_or_default();
        for (axis, middle) in ["x", "y"].into_iter().zip(origin) {
            let ends = Value::from(vec![middle - radius, middle + radius]);
            for key in ["mesh_radius", "mesh_origin"] {
                let why = "the bed is taken to be as large as its mesh";
                self.keep(SECTION, key, &[&format!("homing.bed_mm.{axis}")], ends.clone(), why);
            }
        }
        self.draft.put("homing.bed_mm.round", true);
        if let Some(points) = self.number(SECTION, "round_probe_count") {
            for axis in ["x", "y"] {
                self.keep(SECTION, "round_probe_count", &[&format!("mesh.points.{axis}")], points as i64, "");
            }
        }
    }

    /// The screws under the bed. To be read after the probe: Klipper's places are the nozzle's.
    pub(super) fn bed_screws(&mut self) {
        const SCREWS: &str = "screws_tilt_adjust";
        if self.section(SCREWS).is_none() || self.draft.word("homing.z.sensor") != Some("probe") {
            return;
        }
        let thread = self.entry(SCREWS, "screw_thread").map_or(USUAL_THREAD, |entry| entry.value.as_str());
        let Some((pitch_mm, lifts)) = thread_of(thread) else { return };
        self.draft.put("bed_screws.pitch_mm", pitch_mm);
        self.keep(SCREWS, "screw_thread", &["bed_screws.pitch_mm"], pitch_mm, "");
        self.keep(SCREWS, "screw_thread", &["bed_screws.clockwise_lifts"], lifts, "");
        let offset = ["x", "y"].map(|axis| self.draft.number(&format!("homing.probe_offset_mm.{axis}")).unwrap_or(0.0));
        for number in 1..=BedScrews::MAX {
            let (key, name_key) = (format!("screw{number}"), format!("screw{number}_name"));
            let Some(place) = self.entry(SCREWS, &key).and_then(|entry| two_numbers(&entry.value)) else { continue };
            let name = self.entry(SCREWS, &name_key).map_or(key.clone(), |entry| profile_name(&entry.value));
            for ((axis, place), offset) in ["x", "y"].into_iter().zip(place).zip(offset) {
                let path = format!("bed_screws.places.{name}.{axis}");
                self.keep(SCREWS, &key, &[&path], place + offset, "where the screw is, not the nozzle");
            }
            if let Some(entry) = self.entry(SCREWS, &name_key) {
                let row = self.row(SCREWS, entry, "");
                self.draft.add(Row { kept: Some(format!("bed_screws.places.{name}")), why: String::new(), ..row });
            }
        }
    }
}

/// A screw's pitch, mm, and whether clockwise lifts the bed.
fn thread_of(text: &str) -> Option<(f64, bool)> {
    let (turn, thread) = text.split_once('-')?;
    let (_, pitch_mm) = PITCHES_MM.into_iter().find(|(name, _)| *name == thread)?;
    Some((pitch_mm, turn == "CW"))
}
