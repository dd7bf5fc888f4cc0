//! A sensor that sees filament move: a wheel on the filament, and a fork that its slots pass.
//!
//! By BIGTREETECH's description of its smart filament sensors, whose signal changes its level each
//! time when so much filament has passed (their readme's "detection accuracy": 2.88 mm of the
//! second, for which a firmware is to be set to 3 mm, and 7 mm of the first).
//!
//! | what | test |
//! |---|---|
//! | the level changes with each length of filament, forwards and backwards | `the_level_*` |
//! | the wheel follows the filament with a play | `a_small_way_back_*` |
//! | faults: filament that does not move while the extruder turns, filament that slips | `jammed_*`, `filament_that_slips_*` |
//!
//! Left out: chatter at an edge of a slot, a wheel that slips on the filament.

/// The properties of a sensor.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Config {
    /// Filament from one change of the level to the next, mm.
    pub edge_mm: f64,
    /// Play between filament and wheel, mm.
    pub play_mm: f64,
    /// Position of the wheel at the start, in filament, mm.
    pub start_mm: f64,
}

/// A fault on the filament's way.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum FilamentFault {
    /// The filament does not move: the spool is tangled, or the nozzle clogged, and the
    /// extruder's gear grinds.
    Jammed,
    /// Share of the extruder's turns that does not reach the filament.
    Slips(f64),
}

/// The sensor, with the filament in it.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct FilamentEncoder {
    config: Config,
    fault: Option<FilamentFault>,
    /// The extruder at the last step, mm.
    extruder_mm: f64,
    filament_mm: f64,
    wheel_mm: f64,
    edges: u64,
}

impl FilamentEncoder {
    /// A sensor with filament.
    pub fn new(config: Config) -> Self {
        Self { config, fault: None, extruder_mm: 0.0, filament_mm: 0.0, wheel_mm: config.start_mm, edges: 0 }
    }

    /// Makes a fault, or mends it.
    pub fn set_fault(&mut self, fault: Option<FilamentFault>) {
        self.fault = fault;
    }

    /// Follows the extruder, which has fed this much so far, mm; true if the level has changed.
    pub fn follow(&mut self, extruder_mm: f64) -> bool {
        let fed_mm = extruder_mm - self.extruder_mm;
        self.extruder_mm = extruder_mm;
        self.filament_mm += match self.fault {
            None => fed_mm,
            Some(FilamentFault::Jammed) => 0.0,
            Some(FilamentFault::Slips(share)) => fed_mm * (1.0 - share),
        };
        let before = self.level();
        let (ahead_mm, behind_mm) = (self.filament_mm, self.filament_mm - self.config.play_mm);
        let at_mm = self.wheel_mm - self.config.start_mm;
        self.wheel_mm = at_mm.clamp(behind_mm.min(ahead_mm), ahead_mm) + self.config.start_mm;
        let has_changed = self.level() != before;
        self.edges += u64::from(has_changed);
        has_changed
    }

    /// The level of its signal.
    pub fn level(&self) -> bool {
        (self.wheel_mm / self.config.edge_mm).floor() as i64 & 1 != 0
    }

    /// Changes of the level so far.
    pub fn edges(&self) -> u64 {
        self.edges
    }

    /// The filament that has passed, mm.
    pub fn filament_mm(&self) -> f64 {
        self.filament_mm
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn encoder() -> FilamentEncoder {
        FilamentEncoder::new(Config { edge_mm: 2.88, play_mm: 0.1, start_mm: 1.0 })
    }

    /// The levels while the extruder goes to these places, in steps of a hundredth of a millimetre.
    fn edges(encoder: &mut FilamentEncoder, to_mm: &[f64]) -> u64 {
        let before = encoder.edges();
        let mut at = (encoder.extruder_mm * 100.0).round() as i64;
        for to_mm in to_mm {
            let to = (to_mm * 100.0).round() as i64;
            while at != to {
                at += (to - at).signum();
                encoder.follow(at as f64 / 100.0);
            }
        }
        encoder.edges() - before
    }

    #[test]
    fn the_level_changes_with_each_length_of_filament() {
        let mut encoder = encoder();
        assert_eq!(edges(&mut encoder, &[2.0]), 1);
        assert_eq!(edges(&mut encoder, &[2.0 + 28.8]), 10);
        assert_eq!(edges(&mut encoder, &[2.0]), 10);
    }

    #[test]
    fn a_small_way_back_turns_no_wheel() {
        let mut encoder = encoder();
        assert_eq!(edges(&mut encoder, &[2.0]), 1);
        assert_eq!(edges(&mut encoder, &[1.91, 2.0, 1.91, 2.0]), 0);
        assert_eq!(edges(&mut encoder, &[1.7, 2.0]), 2);
    }

    #[test]
    fn jammed_filament_gives_no_edge() {
        let mut encoder = encoder();
        encoder.set_fault(Some(FilamentFault::Jammed));
        assert_eq!(edges(&mut encoder, &[50.0]), 0);
        encoder.set_fault(None);
        assert_eq!(edges(&mut encoder, &[52.0]), 1);
    }

    #[test]
    fn filament_that_slips_gives_fewer() {
        let mut encoder = encoder();
        encoder.set_fault(Some(FilamentFault::Slips(0.25)));
        assert_eq!(edges(&mut encoder, &[4.0 * 28.8]), 30);
        assert!((encoder.filament_mm() - 3.0 * 28.8).abs() < 1e-6);
    }
}
