//! Kinds of shapers.

use crate::shapers::even_spacing::EvenSpacing;

/// Kind of a shaper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ShaperKind {
    /// No shaper: one impulse without a delay.
    None,
    /// Zero vibration: two impulses.
    Zv,
    /// Klipper's modified zero vibration: three impulses over three quarters of a period.
    Mzv,
    /// General form of MZV: impulses at equal distances, with their zeros placed around the
    /// frequency.
    EvenMzv(EvenSpacing),
    /// Zero vibration and derivative: three impulses.
    Zvd,
    /// Zero vibration and two derivatives: four impulses.
    Zvdd,
    /// Extra-insensitive, without fitted damping (Marlin, Prusa, Kalico, Klipper until 2025).
    EiOld,
    /// Extra-insensitive with fitted damping (Klipper since 2025).
    Ei,
    /// Two humps, without fitted damping.
    TwoHumpEiOld,
    /// Two humps with fitted damping.
    TwoHumpEi,
    /// Three humps, without fitted damping.
    ThreeHumpEiOld,
    /// Three humps with fitted damping.
    ThreeHumpEi,
}

impl ShaperKind {
    /// All kinds without parameters.
    pub const ALL: [Self; 11] = [
        Self::None,
        Self::Zv,
        Self::Mzv,
        Self::Zvd,
        Self::Zvdd,
        Self::EiOld,
        Self::Ei,
        Self::TwoHumpEiOld,
        Self::TwoHumpEi,
        Self::ThreeHumpEiOld,
        Self::ThreeHumpEi,
    ];

    /// Returns the maximum damping ratio for which the shaper is defined; for the fitted shapers,
    /// the end of the fitted range.
    pub const fn max_damping(self) -> f64 {
        match self {
            Self::Ei => 0.4,
            Self::TwoHumpEi => 0.3,
            Self::ThreeHumpEi => 0.2,
            _ => 0.99,
        }
    }
}
