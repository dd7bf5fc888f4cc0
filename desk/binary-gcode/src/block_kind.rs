//! What a block contains.

/// What a block contains.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlockKind {
    /// What wrote the file, and when: [entries](crate::entries).
    FileMetadata,
    /// G-code.
    Gcode,
    /// The slicer's settings: [entries](crate::entries).
    SlicerMetadata,
    /// What a printer compares with itself, such as its model and nozzle: [entries](crate::entries).
    PrinterMetadata,
    /// Time and material: [entries](crate::entries).
    PrintMetadata,
    /// A picture, in a block of its own.
    Thumbnail {
        /// Its format.
        format: ThumbnailFormat,
        /// Width, pixels.
        width: u16,
        /// Height, pixels.
        height: u16,
    },
}

impl BlockKind {
    /// The word for it in error messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::FileMetadata => "file metadata",
            Self::Gcode => "G-code",
            Self::SlicerMetadata => "slicer metadata",
            Self::PrinterMetadata => "printer metadata",
            Self::PrintMetadata => "print metadata",
            Self::Thumbnail { .. } => "thumbnail",
        }
    }
}

/// The format of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ThumbnailFormat {
    /// PNG.
    Png,
    /// JPEG.
    Jpeg,
    /// QOI.
    Qoi,
}
