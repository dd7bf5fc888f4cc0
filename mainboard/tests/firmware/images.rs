//! The images, as `cargo xtask firmware` leaves them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Mutex, PoisonError};

/// Variables that a toolchain sets for its programs; the image needs the main workspace's own toolchain.
const OF_THIS_TOOLCHAIN: [&str; 5] = ["CARGO", "RUSTC", "RUSTDOC", "RUSTUP_TOOLCHAIN", "RUSTFLAGS"];

/// The path of a board's image, which is built if it is missing. Its other files are in the same folder.
pub fn image_of(board: &str) -> PathBuf {
    static KNOWN: Mutex<BTreeMap<String, PathBuf>> = Mutex::new(BTreeMap::new());
    // One test builds while the others wait.
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    known.entry(board.to_owned()).or_insert_with(|| found(board)).clone()
}

fn found(board: &str) -> PathBuf {
    let root = root();
    let folder = std::env::var_os("FERROSTEP_IMAGES").map_or_else(|| root.join("target/images"), PathBuf::from);
    let image = folder.join(board).join("ferrostep.elf");
    if !image.exists() {
        build(board, &root);
    }
    assert!(image.exists(), "{} is missing: build it with `cargo xtask firmware --board {board}`", image.display());
    image
}

fn build(board: &str, root: &Path) {
    let mut cargo = Command::new("cargo");
    for name in OF_THIS_TOOLCHAIN {
        cargo.env_remove(name);
    }
    let output = cargo.args(["xtask", "firmware", "--board", board]).current_dir(root).output().unwrap();
    let messages = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "cargo xtask firmware --board {board}: {messages}");
}

/// The project's folder.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_owned()
}
