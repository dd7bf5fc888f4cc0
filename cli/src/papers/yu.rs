//! Yu: G code preprocessing optimization algorithm for 3D printers, 2019.

use super::Chapter;

/// Its tables and figures.
pub fn chapter() -> Chapter {
    Chapter {
        name: "yu",
        source: "Yu: G code preprocessing optimization algorithm for 3D printers, 2019",
        tables: vec![],
        figures: vec![],
    }
}
