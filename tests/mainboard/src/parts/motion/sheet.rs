//! The steel sheet on the bed, the inductive probe that detects it, and the nozzle that should
//! not press into it.

use crate::parts::random::Random;

/// The sheet: a plane over a rectangle, in mm.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct SheetConfig {
    /// Edges of the sheet in X, low and high.
    pub x_mm: (f64, f64),
    /// Edges of the sheet in Y, low and high.
    pub y_mm: (f64, f64),
    /// Z of the nozzle when it touches the sheet's plane at X0 Y0.
    pub height_mm: f64,
    /// Rise of the sheet per mm in X, and in Y.
    pub tilt: (f64, f64),
    /// Depth up to which the sheet gives way, in mm; beyond it the nozzle crashes.
    pub allowed_press_mm: f64,
}

/// A nozzle pressed into the sheet.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Crash {
    /// The instant at which it first exceeded the allowed depth.
    pub first_ns: u64,
    /// The deepest point since then, in mm.
    pub deepest_mm: f64,
    /// X and Y of that point, in mm.
    pub deepest_at_mm: (f64, f64),
}

/// The sheet and its crash.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Sheet {
    config: SheetConfig,
    /// The height of its highest corner.
    highest_mm: f64,
    crash: Option<Crash>,
}

impl Sheet {
    pub(super) fn new(config: SheetConfig) -> Self {
        let mut sheet = Self { highest_mm: 0.0, config, crash: None };
        let SheetConfig { x_mm, y_mm, .. } = sheet.config;
        let corners = [(x_mm.0, y_mm.0), (x_mm.0, y_mm.1), (x_mm.1, y_mm.0), (x_mm.1, y_mm.1)];
        sheet.highest_mm =
            corners.map(|(x_mm, y_mm)| sheet.plane_mm(x_mm, y_mm)).into_iter().fold(f64::NEG_INFINITY, f64::max);
        sheet
    }

    fn plane_mm(&self, x_mm: f64, y_mm: f64) -> f64 {
        self.config.height_mm + self.config.tilt.0 * x_mm + self.config.tilt.1 * y_mm
    }

    /// The sheet's height at a point; `None` beside the sheet.
    pub fn height_mm(&self, x_mm: f64, y_mm: f64) -> Option<f64> {
        let SheetConfig { x_mm: x_edges, y_mm: y_edges, .. } = &self.config;
        let over = x_mm >= x_edges.0 && x_mm <= x_edges.1 && y_mm >= y_edges.0 && y_mm <= y_edges.1;
        over.then(|| self.plane_mm(x_mm, y_mm))
    }

    /// True if a nozzle at this height could crash anywhere.
    pub(super) fn may_touch(&self, z_mm: f64) -> bool {
        z_mm < self.highest_mm - self.config.allowed_press_mm
    }

    /// Records how deep a nozzle at this point is in the sheet.
    pub(super) fn press(&mut self, now_ns: u64, x_mm: f64, y_mm: f64, z_mm: f64) {
        let Some(height_mm) = self.height_mm(x_mm, y_mm) else { return };
        let depth_mm = height_mm - z_mm;
        if depth_mm <= self.config.allowed_press_mm {
            return;
        }
        let crash =
            self.crash.get_or_insert(Crash { first_ns: now_ns, deepest_mm: depth_mm, deepest_at_mm: (x_mm, y_mm) });
        if depth_mm > crash.deepest_mm {
            (crash.deepest_mm, crash.deepest_at_mm) = (depth_mm, (x_mm, y_mm));
        }
    }

    /// The crash, if there was one.
    pub fn crash(&self) -> Option<Crash> {
        self.crash
    }
}

/// An inductive probe beside the nozzle.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ProbeConfig {
    /// The probe's offset from the nozzle in X and Y, in mm.
    pub offset_mm: (f64, f64),
    /// The nozzle's height above the sheet when it triggers, in mm.
    pub trigger_mm: f64,
    /// Rise until it releases, in mm.
    pub hysteresis_mm: f64,
    /// Standard deviation of the trigger height from one approach to the next, in mm (some 0.002).
    pub noise_mm: f64,
    /// The level when it detects the sheet.
    pub high_when_triggered: bool,
    /// Seed of its noise.
    pub seed: u64,
}

/// A fault of a probe.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum ProbeFault {
    /// Never triggers.
    Dead,
    /// Always triggered.
    AlwaysOn,
}

/// The probe.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Probe {
    config: ProbeConfig,
    random: Random,
    /// The noise of this approach.
    error_mm: f64,
    triggered: bool,
    fault: Option<ProbeFault>,
}

impl Probe {
    pub(super) fn new(config: ProbeConfig) -> Self {
        let mut random = Random::new(config.seed);
        let error_mm = random.normal() * config.noise_mm;
        Self { config, random, error_mm, triggered: false, fault: None }
    }

    /// True if its level could change with the nozzle at this height.
    pub(super) fn may_change(&self, sheet: &Sheet, z_mm: f64) -> bool {
        self.triggered || z_mm <= sheet.highest_mm + self.config.trigger_mm + self.error_mm
    }

    /// Follows the nozzle to this point; true if the level changed.
    pub(super) fn update(&mut self, sheet: &Sheet, x_mm: f64, y_mm: f64, z_mm: f64) -> bool {
        let height_mm = sheet.height_mm(x_mm + self.config.offset_mm.0, y_mm + self.config.offset_mm.1);
        let back_mm = if self.triggered { self.config.hysteresis_mm } else { 0.0 };
        let reach_mm = self.config.trigger_mm + self.error_mm + back_mm;
        let triggered = height_mm.is_some_and(|height_mm| z_mm <= height_mm + reach_mm);
        if triggered == self.triggered {
            return false;
        }
        let before = self.level();
        self.triggered = triggered;
        if !triggered {
            self.error_mm = self.random.normal() * self.config.noise_mm;
        }
        self.level() != before
    }

    /// The probe's offset from the nozzle in X and Y, in mm.
    pub fn offset_mm(&self) -> (f64, f64) {
        self.config.offset_mm
    }

    /// The level on its wire.
    pub fn level(&self) -> bool {
        let on = match self.fault {
            None => self.triggered,
            Some(ProbeFault::Dead) => false,
            Some(ProbeFault::AlwaysOn) => true,
        };
        on == self.config.high_when_triggered
    }

    /// Breaks or mends the probe. The level may change at once: read it again.
    pub fn set_fault(&mut self, fault: Option<ProbeFault>) {
        self.fault = fault;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sheet(tilt: (f64, f64)) -> Sheet {
        Sheet::new(SheetConfig { x_mm: (0.0, 180.0), y_mm: (0.0, 180.0), height_mm: 0.0, tilt, allowed_press_mm: 0.05 })
    }

    fn probe(noise_mm: f64) -> Probe {
        Probe::new(ProbeConfig {
            offset_mm: (-29.0, -3.0),
            trigger_mm: 1.0,
            hysteresis_mm: 0.05,
            noise_mm,
            high_when_triggered: true,
            seed: 1,
        })
    }

    #[test]
    fn the_probe_detects_the_sheet_only() {
        let (sheet, mut probe) = (sheet((0.0, 0.0)), probe(0.0));
        assert!(!probe.update(&sheet, 90.0, -3.0, 0.0), "in front of the sheet");
        assert!(!probe.update(&sheet, 90.0, 90.0, 1.001));
        assert!(probe.update(&sheet, 90.0, 90.0, 1.0) && probe.level());
        assert!(!probe.update(&sheet, 90.0, 90.0, 1.05));
        assert!(probe.update(&sheet, 90.0, 90.0, 1.051) && !probe.level());
        probe.update(&sheet, 90.0, 90.0, 0.5);
        assert!(probe.update(&sheet, 20.0, 90.0, 0.5) && !probe.level(), "left of the sheet");
    }

    #[test]
    fn faults_hold_the_level() {
        let (sheet, mut probe) = (sheet((0.0, 0.0)), probe(0.0));
        probe.set_fault(Some(ProbeFault::Dead));
        assert!(!probe.update(&sheet, 90.0, 90.0, 0.0) && !probe.level());
        probe.set_fault(Some(ProbeFault::AlwaysOn));
        assert!(!probe.update(&sheet, 90.0, 90.0, 9.0) && probe.level());
    }

    #[test]
    fn noise_differs_by_approach_within_its_deviation() {
        let (sheet, mut probe) = (sheet((0.0, 0.0)), probe(0.002));
        let mut heights = Vec::new();
        for _ in 0..50 {
            let mut z_mm = 1.1;
            while !probe.level() {
                z_mm -= 0.0005;
                probe.update(&sheet, 90.0, 90.0, z_mm);
            }
            heights.push(z_mm);
            probe.update(&sheet, 90.0, 90.0, 2.0);
        }
        let mean = heights.iter().sum::<f64>() / 50.0;
        let spread = (heights.iter().map(|height| (height - mean).powi(2)).sum::<f64>() / 50.0).sqrt();
        assert!((mean - 1.0).abs() < 0.002 && (0.001..0.004).contains(&spread), "{mean} {spread}");
    }

    #[test]
    fn a_tilted_sheet_is_pressed_at_its_high_side() {
        let mut sheet = sheet((0.001, 0.0));
        sheet.press(5, 10.0, 10.0, 0.0);
        assert_eq!(sheet.crash(), None);
        sheet.press(6, 170.0, 10.0, 0.0);
        sheet.press(7, 180.0, 10.0, 0.1);
        sheet.press(8, 190.0, 10.0, -5.0);
        let crash = sheet.crash().unwrap_or(Crash { first_ns: 0, deepest_mm: 0.0, deepest_at_mm: (0.0, 0.0) });
        assert!(crash.first_ns == 6 && (crash.deepest_mm - 0.17).abs() < 1e-9, "{crash:?}");
    }
}
