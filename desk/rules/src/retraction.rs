//! Firmware retraction: G10 and G11 as the moves that each firmware makes of them.

use crate::change::Words;

/// Settings of the moves of G10 and G11. The lift of Z is a separate move, which the caller makes
/// from [`Self::lift_mm`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FirmwareRetraction {
    /// Length of filament drawn back, mm.
    pub length_mm: f64,
    /// Extra length of filament that G11 feeds, mm; negative feeds less.
    pub extra_recover_mm: f64,
    /// Speed of G10, mm/s.
    pub retract_mm_per_s: f64,
    /// Speed of G11, mm/s.
    pub recover_mm_per_s: f64,
    /// Lift of Z while the filament is drawn back, mm; Klipper has no lift.
    pub lift_mm: f64,
}

impl FirmwareRetraction {
    /// Applies RepRapFirmware's M207: S length, R extra, F and T speeds in mm/min (T defaults to
    /// F), Z lift.
    ///
    /// Source: Duet's *GCode dictionary*, M207; `Tool::SetFirmwareRetraction` in
    /// `src/Tools/Tool.cpp`.
    pub fn set_by_rrf_m207(&mut self, words: &Words<'_>) {
        if let Some(length) = words.get('S') {
            self.length_mm = length.max(0.0);
        }
        if let Some(extra) = words.get('R') {
            self.extra_recover_mm = extra.max(-self.length_mm);
        }
        if let Some(speed) = words.positive('F') {
            self.retract_mm_per_s = speed / 60.0;
            self.recover_mm_per_s = self.retract_mm_per_s;
        }
        if let Some(speed) = words.positive('T') {
            self.recover_mm_per_s = speed / 60.0;
        }
        if let Some(lift) = words.get('Z') {
            self.lift_mm = lift.max(0.0);
        }
    }

    /// Applies Marlin's M207: S length, F speed in mm/min, Z lift.
    ///
    /// Source: Marlin's documentation of M207.
    pub fn set_by_marlin_m207(&mut self, words: &Words<'_>) {
        if let Some(length) = words.get('S') {
            self.length_mm = length;
        }
        if let Some(speed) = words.positive('F') {
            self.retract_mm_per_s = speed / 60.0;
        }
        if let Some(lift) = words.get('Z') {
            self.lift_mm = lift;
        }
    }

    /// Applies Marlin's M208: S extra length, F speed in mm/min.
    ///
    /// Source: Marlin's documentation of M208.
    pub fn set_by_marlin_m208(&mut self, words: &Words<'_>) {
        if let Some(extra) = words.get('S') {
            self.extra_recover_mm = extra;
        }
        if let Some(speed) = words.positive('F') {
            self.recover_mm_per_s = speed / 60.0;
        }
    }

    /// Returns the filament, mm, and the speed, mm/s, of G10.
    pub fn retract(&self) -> (f64, f64) {
        (-self.length_mm, self.retract_mm_per_s)
    }

    /// Returns the filament, mm, and the speed, mm/s, of G11.
    pub fn recover(&self) -> (f64, f64) {
        (self.length_mm + self.extra_recover_mm, self.recover_mm_per_s)
    }
}
