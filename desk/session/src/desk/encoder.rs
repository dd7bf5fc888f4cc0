//! An encoder in the filament's path, of a machine in virtual time.

/// Filament between two changes of the signal's level, as a share of the detection length that the
/// user sets: 2.88 of 3 mm (BIGTREETECH, smart filament sensor 2.0).
const EDGE_OF_DETECTION: f64 = 0.96;

/// The encoder, and the filament in it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Encoder {
    /// The extruder at the last look, and the filament, steps.
    extruder: i64,
    filament: i64,
    /// True while the extruder grinds on filament that does not move, or has no filament.
    is_stuck: bool,
}

impl Encoder {
    /// Sets whether the filament no longer follows the extruder.
    pub fn set_stuck(&mut self, is_stuck: bool) {
        self.is_stuck = is_stuck;
    }

    /// Follows the extruder to this position, steps.
    pub fn follow(&mut self, extruder: i64) {
        if !self.is_stuck {
            self.filament += extruder - self.extruder;
        }
        self.extruder = extruder;
    }

    /// Returns the level of its signal. `detection_mm` is the extrusion without a change that
    /// counts as a standstill.
    pub fn level(&self, steps_per_mm: f64, detection_mm: f64) -> bool {
        let edges = self.filament as f64 / (steps_per_mm * detection_mm * EDGE_OF_DETECTION);
        edges.floor() as i64 & 1 != 0
    }
}
