//! Tests that need programs from outside, which cargo does not bring. `cargo xtask test` installs
//! them and runs all of these; a test whose program is missing fails and says how to get it.
//!
//! | module | needs |
//! |---|---|
//! | `firmware` | the boards' images, which `cargo xtask firmware` builds |
//! | `hosts` | Python with OctoPrint and printcore, which `cargo xtask hosts` installs |
//! | `wheel` | Python with maturin, which `cargo xtask hosts` installs, and cargo |
//! | `browser` | Chromium, and Python's driver for it |
//! | `slicers` | PrusaSlicer, CuraEngine, Cura's definitions |
//! | `scripts` | Node.js |
//! | `shells` | bash, groff |
//! | `mtools` | mtools, dosfstools |

mod browser;
mod firmware;
mod hosts;
mod mtools;
mod scripts;
mod shells;
mod slicers;
mod wheel;
