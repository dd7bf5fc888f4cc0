//! Marlin's settings of the bed's mesh.

use toml::Value;

use super::Reading;

/// Marlin's names of the margin around the mesh, from the newest on.
const MARGINS: [&str; 3] = ["PROBING_MARGIN", "MIN_PROBE_EDGE", "MESH_INSET"];

impl Reading<'_> {
    /// The mesh. To be read after the probe: without one a profile has none.
    pub(super) fn mesh(&mut self) {
        if self.draft.word("homing.z.sensor") != Some("probe") {
            return;
        }
        let mut is_said = false;
        for axis in ["x", "y"] {
            let own = format!("GRID_MAX_POINTS_{}", axis.to_ascii_uppercase());
            for name in ["GRID_MAX_POINTS", &own, "ABL_GRID_POINTS"] {
                if let Some(points) = self.number(name) {
                    is_said = true;
                    self.keep(name, &format!("mesh.points.{axis}"), points as i64, "");
                }
            }
        }
        if !is_said {
            return;
        }
        if let Some((name, margin)) = MARGINS.into_iter().find_map(|name| Some((name, self.number(name)?))) {
            for axis in ["x", "y"] {
                // The margin is from the bed's edge, as far as the probe comes.
                let number = |path: String| self.draft.number(&path);
                let offset = number(format!("homing.probe_offset_mm.{axis}")).unwrap_or_default();
                let lower = number(format!("lower_end_mm.{axis}")).unwrap_or_default();
                let upper = number(format!("size_mm.{axis}")).unwrap_or_default();
                let bed = self.number(&format!("{}_BED_SIZE", axis.to_ascii_uppercase())).unwrap_or(upper);
                let ends = [margin.max(lower + offset), (bed - margin).min(upper + offset)];
                let why = "from the bed's edge, where the probe comes there";
                self.keep(name, &format!("mesh.area_mm.{axis}"), Value::from(ends.to_vec()), why);
            }
        }
        if self.get("ABL_BILINEAR_SUBDIVISION").is_some() {
            self.keep("ABL_BILINEAR_SUBDIVISION", "mesh.interpolation", "bicubic", "");
        }
        let fades = self.get("ENABLE_LEVELING_FADE_HEIGHT").is_some();
        let height = if fades { self.number("DEFAULT_LEVELING_FADE_HEIGHT") } else { Some(0.0) };
        self.draft.put("mesh.fade_mm", height.unwrap_or(10.0));
        for name in ["ENABLE_LEVELING_FADE_HEIGHT", "DEFAULT_LEVELING_FADE_HEIGHT"] {
            if fades {
                self.keep(name, "mesh.fade_mm", height.unwrap_or(10.0), "");
            }
        }
        self.keep_number("Z_CLEARANCE_BETWEEN_PROBES", "mesh.lift_mm", |height| height);
        self.keep_number("MULTIPLE_PROBING", "mesh.samples", |samples| samples);
    }
}
