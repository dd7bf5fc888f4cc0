//! The images' files.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Mutex, OnceLock, PoisonError};

use ferrostep_testkit::program::repository;

/// Path of the bench board's image, which is built if necessary.
pub fn image() -> &'static Path {
    static IMAGE: OnceLock<PathBuf> = OnceLock::new();
    IMAGE.get_or_init(|| match std::env::var_os("FERROSTEP_FIRMWARE") {
        Some(path) => PathBuf::from(path),
        None => built_image("bench"),
    })
}

/// Path of a board's image, which is built if necessary. Its other files lie next to it.
pub fn image_of(board: &str) -> PathBuf {
    static BUILT: Mutex<BTreeMap<String, PathBuf>> = Mutex::new(BTreeMap::new());
    match std::env::var_os("FERROSTEP_IMAGES") {
        Some(folder) => Path::new(&folder).join(board).join("ferrostep.elf"),
        None => {
            let mut built = BUILT.lock().unwrap_or_else(PoisonError::into_inner);
            built.entry(board.to_owned()).or_insert_with(|| built_image(board)).clone()
        }
    }
}

fn built_image(board: &str) -> PathBuf {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let output =
        Command::new(cargo).args(["xtask", "firmware", "--board", board]).current_dir(repository()).output().unwrap();
    let messages = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "cargo xtask firmware --board {board}: {messages}");
    // Its first line is the path, the size table follows.
    let text = String::from_utf8(output.stdout).unwrap();
    PathBuf::from(text.lines().next().unwrap())
}
