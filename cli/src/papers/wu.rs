//! Wu, Wang, Li: Research and optimization of multi-axis linkage interpolation algorithm for 3D printer, 2024.

use super::Chapter;

/// Its tables and figures.
pub fn chapter() -> Chapter {
    Chapter {
        name: "wu",
        source: "Wu, Wang, Li: Research and optimization of multi-axis linkage interpolation algorithm for 3D printer, 2024",
        tables: vec![],
        figures: vec![],
    }
}
