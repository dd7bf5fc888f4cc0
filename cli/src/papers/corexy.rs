//! Hebei University of Technology: CoreXY plane control for FDM printers.

use super::Chapter;

/// Its tables and figures.
pub fn chapter() -> Chapter {
    Chapter {
        name: "corexy",
        source: "Hebei University of Technology: CoreXY plane control for FDM printers",
        tables: vec![],
        figures: vec![],
    }
}
