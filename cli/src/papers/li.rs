//! Li, Dang, Huang, Zhao: Implementation of S-curve acceleration and deceleration control for 3D printing, 2017.

use super::Chapter;

/// Its tables and figures.
pub fn chapter() -> Chapter {
    Chapter {
        name: "li",
        source: "Li, Dang, Huang, Zhao: Implementation of S-curve acceleration and deceleration control for 3D printing, 2017",
        tables: vec![],
        figures: vec![],
    }
}
