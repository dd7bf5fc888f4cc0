//! A move in the units of its frame.

use crate::compact::shape::{FILAMENT_ALL, FILAMENT_NONE, FILAMENT_PREDICTED, PATH_NONE, prediction};

/// A move in the frame's units.
#[derive(Clone, Copy, Debug)]
pub struct Steps {
    pub path: [i32; 3],
    pub filament: i64,
    pub kind: u8,
}

impl Steps {
    /// The filament as a move encodes it: its kind, and the number.
    pub fn encoded_filament(&self, lambda: f32) -> (u8, i64) {
        if self.filament == 0 {
            return (FILAMENT_NONE, 0);
        }
        let difference = self.filament - i64::from(prediction(self.path, lambda));
        // Filament that is encoded whole has s(12); the difference must be in range of the
        // reader's 32 bits.
        if self.kind == PATH_NONE || lambda == 0.0 || difference.abs() > 1 << 16 {
            return (FILAMENT_ALL, self.filament);
        }
        (FILAMENT_PREDICTED, difference)
    }
}
