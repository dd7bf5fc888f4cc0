//! The papers, as arguments name them.

use ferrostep_papers::tables::Paper;

/// The papers by their short names.
#[derive(Clone, Copy, clap::ValueEnum)]
pub enum PaperName {
    /// Wu 2024: step Bresenham, velocity-adaptive extrusion.
    Wu,
    /// Yu 2019: planning on the computer, look-ahead.
    Yu,
    /// Three ways to lead CoreXY motors.
    Corexy,
    /// Li 2017: S-curve acceleration.
    Li,
}

impl From<PaperName> for Paper {
    fn from(name: PaperName) -> Self {
        match name {
            PaperName::Wu => Self::Wu,
            PaperName::Yu => Self::Yu,
            PaperName::Corexy => Self::CoreXy,
            PaperName::Li => Self::Li,
        }
    }
}
