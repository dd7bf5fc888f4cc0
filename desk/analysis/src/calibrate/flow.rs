//! A tube with one wall: how much plastic comes out, and how much at most.

use std::fmt::Write;

use ferrostep_printer::Profile;

use super::pattern::{Bead, MARGIN_MM, PatternError, Temperatures, in_range, mm, nozzle_mm};

/// Side of the tube, mm.
const SIDE_MM: f64 = 60.0;

/// Layer height and wall for each mm of the nozzle's diameter: a wall thick enough to be measured,
/// and for much flow at little speed.
const HEIGHT_OF_NOZZLE: f64 = 0.6;
const WIDTH_OF_NOZZLE: f64 = 1.5;

/// Layers with the first flow, whose wall is measured, and layers with each of the flows above.
const EVEN_LAYERS: u32 = 30;
const BAND_LAYERS: u32 = 5;

/// Layers without the fan.
const LAYERS_WITHOUT_FAN: u32 = 3;

/// Speed of the first layer, mm/s.
const FIRST_LAYER_MM_PER_S: f64 = 20.0;

/// A caliper is read to this, mm.
const READING_MM: f64 = 0.02;

/// Student's t: half of an interval that holds 95 of 100, in standard deviations of a mean of
/// 2, 3 ... readings.
const STUDENT_95: [f64; 9] = [12.71, 4.30, 3.18, 2.78, 2.57, 2.45, 2.36, 2.31, 2.26];

/// A factor that is known worse than this is not worth a key.
const MAX_UNCERTAINTY: f64 = 0.1;

/// Flows of the tube.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlowSteps {
    /// Flow of the lowest part, mm^3/s.
    pub first_mm3_per_s: f64,
    /// Increase from band to band, mm^3/s.
    pub step_mm3_per_s: f64,
    /// Number of bands.
    pub bands: u16,
}

/// Parameters of the printed tube.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlowTube {
    /// The tube's flows.
    pub steps: FlowSteps,
    /// Temperatures of nozzle and bed.
    pub temperatures: Temperatures,
    /// Power of the fan above the first layers, %.
    pub fan_percent: f64,
}

impl FlowSteps {
    fn check(&self) -> Result<(), PatternError> {
        in_range("--from", self.first_mm3_per_s, 0.2..=50.0, "mm^3/s")?;
        in_range("--step", self.step_mm3_per_s, 0.05..=20.0, "mm^3/s")
    }

    /// Flow of a band, counted from 1; that of 0 is the even part below them.
    fn flow(&self, band: u32) -> f64 {
        self.first_mm3_per_s + f64::from(band) * self.step_mm3_per_s
    }

    fn layers(&self) -> u32 {
        EVEN_LAYERS + BAND_LAYERS * u32::from(self.bands)
    }

    /// The band of a layer, counted from 0.
    fn band(layer: u32) -> u32 {
        if layer < EVEN_LAYERS { 0 } else { (layer - EVEN_LAYERS) / BAND_LAYERS + 1 }
    }

    /// The keys of a profile for the walls that were measured on the lowest part, mm.
    ///
    /// # Errors
    /// [`PatternError`].
    pub fn keys_of_walls(walls_mm: &[f64], profile: &Profile) -> Result<String, PatternError> {
        let bead = bead(profile);
        for wall_mm in walls_mm {
            in_range("--walls", *wall_mm, 0.5 * bead.width_mm..=2.0 * bead.width_mm, "mm")?;
        }
        let count = walls_mm.len();
        let Some(student) = count.checked_sub(2).map(|index| STUDENT_95[index.min(STUDENT_95.len() - 1)]) else {
            return Err(PatternError::Nothing(
                "at least two walls (--walls 0.61,0.63,0.62,0.61), as they show how well they are known",
            ));
        };
        let mean_mm = walls_mm.iter().sum::<f64>() / count as f64;
        let squares: f64 = walls_mm.iter().map(|wall_mm| (wall_mm - mean_mm).powi(2)).sum();
        let deviation_mm = (squares / (count - 1) as f64 / count as f64).sqrt();
        let half_mm = (student * deviation_mm).hypot(READING_MM / 2.0);
        let measured = Bead { width_mm: mean_mm, ..bead };
        let factor = bead.area_mm2() / measured.area_mm2();
        let part = half_mm * bead.height_mm / measured.area_mm2();
        if part > MAX_UNCERTAINTY {
            let expected = format!(
                "walls that are more alike, or more of them: the mean of these is known to {half_mm:.2} mm only"
            );
            return Err(PatternError::Value("--walls", mean_mm, expected));
        }
        let [.., steps_per_mm] = profile.steps_per_mm.map(|steps| steps.to_f64());
        let mut out = format!(
            "the wall is {mean_mm:.3} mm +- {half_mm:.3} mm, {:.3} mm was meant: {:.1} % of the filament that was asked for came out, +- {:.1} %\n",
            bead.width_mm,
            100.0 / factor,
            100.0 * part / factor
        );
        if (factor - 1.0).abs() <= part {
            let _ = writeln!(out, "\nThat is as right as it is known: keep steps_per_mm.e = {steps_per_mm}.");
            return Ok(out);
        }
        let _ = writeln!(
            out,
            "\nFor all filaments, in the profile's steps_per_mm:\n\ne = {:.2}\n\nor for this filament alone, in its start G-code:\n\nM221 S{:.1}",
            factor * steps_per_mm,
            100.0 * factor
        );
        Ok(out)
    }

    /// The keys of a profile for the height up to which the wall is whole, mm.
    ///
    /// # Errors
    /// [`PatternError`].
    pub fn keys_of_height(&self, whole_mm: f64, profile: &Profile) -> Result<String, PatternError> {
        self.check()?;
        let height_mm = bead(profile).height_mm;
        let [low_mm, high_mm] = [EVEN_LAYERS, self.layers()].map(|layers| f64::from(layers) * height_mm);
        // Heights are read to half a layer.
        let expected = low_mm..=high_mm + 0.5 * height_mm;
        if !expected.contains(&whole_mm) {
            let expected = format!("{low_mm:.1} to {high_mm:.1} mm, where the flow rises");
            return Err(PatternError::Value("--whole-to-mm", whole_mm, expected));
        }
        let layers = (whole_mm / height_mm + 0.5).floor() as u32;
        // A band counts if all of it is whole.
        let band = (layers.min(self.layers()) - EVEN_LAYERS) / BAND_LAYERS;
        let flow = self.flow(band);
        let text = if band == u32::from(self.bands) {
            format!("the nozzle melts {flow:.2} mm^3/s, the most that was tried (--bands)")
        } else {
            let [middle, half] = [flow + 0.5 * self.step_mm3_per_s, 0.5 * self.step_mm3_per_s];
            format!("the nozzle melts {middle:.2} mm^3/s +- {half:.2} mm^3/s")
        };
        Ok(format!("{text}\n\nIn the profile, what it melts for sure:\n\nmax_volumetric_flow_mm3_per_s = {flow:.2}\n"))
    }
}

fn bead(profile: &Profile) -> Bead {
    Bead::of_nozzle(nozzle_mm(profile), HEIGHT_OF_NOZZLE, WIDTH_OF_NOZZLE)
}

impl FlowTube {
    /// The G-code: a tube with one wall, even at first, then with more flow from band to band.
    ///
    /// # Errors
    /// [`PatternError`].
    pub fn gcode(&self, profile: &Profile) -> Result<String, PatternError> {
        let Self { steps, temperatures, fan_percent } = self;
        steps.check()?;
        temperatures.check(profile)?;
        in_range("--fan", *fan_percent, 0.0..=100.0, "%")?;
        let bead = bead(profile);
        let [x_mm, y_mm, z_mm] = profile.size_10nm.map(mm);
        let needed_mm = SIDE_MM + 2.0 * MARGIN_MM;
        if x_mm < needed_mm || y_mm < needed_mm {
            return Err(PatternError::Narrow(needed_mm));
        }
        let [fast_x, fast_y, _, fast_e] = profile.limits.max_feed_mm_per_s;
        // The extruder has to push it as well.
        let fastest = fast_x.min(fast_y).min(fast_e / bead.filament_per_mm(profile));
        let most = fastest * bead.area_mm2();
        let highest = steps.flow(u32::from(steps.bands));
        if highest > most {
            let expected = format!(
                "few enough for {most:.1} mm^3/s, which is {fastest:.0} mm/s; up to {highest:.1} was asked for"
            );
            return Err(PatternError::Value("--bands", f64::from(steps.bands), expected));
        }
        let top_mm = bead.height_mm * f64::from(steps.layers());
        if top_mm + MARGIN_MM > z_mm {
            let expected = format!("fewer: the tube would be {top_mm:.0} mm high");
            return Err(PatternError::Value("--bands", f64::from(steps.bands), expected));
        }
        let low = [x_mm, y_mm].map(|size_mm| 0.5 * (size_mm - SIDE_MM));
        let even_mm = bead.height_mm * f64::from(EVEN_LAYERS);
        let mut out = format!(
            "; Flow on {}: a tube with one wall of {:.3} mm. Up to {even_mm:.2} mm with {} mm^3/s: measure the wall there with a caliper, in the\n\
             ; middle of all sides, and: ferrostep calibrate flow --walls MM,MM,MM,MM. Above it the flow rises to {highest} mm^3/s, by {} every\n\
             ; {:.2} mm: see up to which height the wall is whole, and: ferrostep calibrate flow --from {} --step {} --bands {} --whole-to-mm MM\n",
            profile.name,
            bead.width_mm,
            steps.first_mm3_per_s,
            steps.step_mm3_per_s,
            bead.height_mm * f64::from(BAND_LAYERS),
            steps.first_mm3_per_s,
            steps.step_mm3_per_s,
            steps.bands
        );
        temperatures.begin(&mut out);
        let corners = [[1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]];
        let filament_mm = bead.filament_per_mm(profile) * SIDE_MM;
        let _ = writeln!(out, "G1 X{:.3} Y{:.3} F6000", low[0], low[1] - 0.5 * MARGIN_MM);
        let first_z = bead.height_mm;
        // The first filament pushed out fills the nozzle, beside the tube.
        let prime = [low[0] + SIDE_MM, low[1] - 0.5 * MARGIN_MM];
        let slow = 60.0 * FIRST_LAYER_MM_PER_S;
        let _ = writeln!(out, "G1 Z{first_z:.3} F600\nG1 X{:.3} Y{:.3} E{filament_mm:.5} F{slow}", prime[0], prime[1]);
        let _ = writeln!(out, "G1 X{:.3} Y{:.3} F6000", low[0], low[1]);
        for layer in 0..steps.layers() {
            let band = FlowSteps::band(layer);
            if layer == LAYERS_WITHOUT_FAN {
                let _ = writeln!(out, "M106 S{:.0}", 2.55 * fan_percent);
            }
            if layer == EVEN_LAYERS || (layer > EVEN_LAYERS && band != FlowSteps::band(layer - 1)) {
                let _ = writeln!(out, "; {:.2} mm^3/s", steps.flow(band));
            }
            let speed = steps.flow(band) / bead.area_mm2();
            let speed = if layer == 0 { speed.min(FIRST_LAYER_MM_PER_S) } else { speed };
            let _ = writeln!(out, "G1 Z{:.3} F600", bead.height_mm * f64::from(layer + 1));
            for [x, y] in corners {
                let _ = writeln!(
                    out,
                    "G1 X{:.3} Y{:.3} E{filament_mm:.5} F{:.0}",
                    low[0] + SIDE_MM * x,
                    low[1] + SIDE_MM * y,
                    60.0 * speed
                );
            }
        }
        super::pattern::end(&mut out, top_mm + MARGIN_MM);
        Ok(out)
    }
}
