//! Kinds of blocks.

/// Kind of a block's contents.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlockKind {
    /// Producer and time of the file: [entries](crate::entries).
    FileMetadata,
    /// G-code.
    Gcode,
    /// The slicer's settings: [entries](crate::entries).
    SlicerMetadata,
    /// Values that a printer compares with its own, such as model and nozzle:
    /// [entries](crate::entries).
    PrinterMetadata,
    /// Time and material: [entries](crate::entries).
    PrintMetadata,
    /// A picture.
    Thumbnail {
        /// Format of the picture.
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
