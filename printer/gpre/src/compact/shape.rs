//! Encoding of a move: its shape, and the prediction of its filament.

/// The longest text of a command.
pub const MAX_TEXT_BYTES: usize = 255;

/// Places for feeds, lambdas and commands.
pub const PLACES: usize = 8;

/// Parts of a move that are encoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape(pub u8);

/// Components of the path that are encoded.
pub const PATH_XY: u8 = 0;
pub const PATH_XYZ: u8 = 1;
pub const PATH_Z: u8 = 2;
#[cfg(feature = "write")]
pub const PATH_NONE: u8 = 3;

/// Encodings of the filament.
pub const FILAMENT_NONE: u8 = 0;
pub const FILAMENT_PREDICTED: u8 = 1;
pub const FILAMENT_ALL: u8 = 2;

impl Shape {
    /// First shape: along X and Y with predicted filament, a source line each.
    pub const FIRST: Self = Self(PATH_XY << 5 | FILAMENT_PREDICTED << 3 | 0b011);
    /// Bits of a shape.
    pub const BITS: u32 = 7;

    /// True if a move is encoded by X, Y and the difference of its filament from the prediction.
    #[inline]
    pub fn is_plain(self) -> bool {
        self.0 >> 3 == PATH_XY << 2 | FILAMENT_PREDICTED
    }

    #[inline]
    pub fn path(self) -> u8 {
        self.0 >> 5
    }

    #[inline]
    pub fn filament(self) -> u8 {
        self.0 >> 3 & 3
    }

    #[inline]
    pub fn same_line(self) -> bool {
        self.0 & 4 != 0
    }

    #[inline]
    pub fn ends_move(self) -> bool {
        self.0 & 2 != 0
    }

    #[inline]
    pub fn counts(self) -> bool {
        self.0 & 1 != 0
    }
}

/// Filament that lambda predicts for a path, all in steps of their units.
#[inline(always)]
pub fn prediction(path: [i32; 3], lambda: f32) -> i32 {
    let [x, y, z] = path.map(|steps| steps as f32);
    (ferrostep_square_root::square_root(x * x + y * y + z * z) * lambda) as i32
}
