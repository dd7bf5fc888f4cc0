//! The folder of the boards' images.

use std::path::PathBuf;

use crate::system;

/// Environment variable with the folder of all boards' images, for the tests.
pub const IMAGES_VARIABLE: &str = "FERROSTEP_IMAGES";

/// The folder of all boards' images.
pub fn images() -> PathBuf {
    system::target_directory().join("images")
}
