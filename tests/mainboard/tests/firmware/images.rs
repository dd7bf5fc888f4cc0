//! The images, as `cargo xtask firmware` leaves them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Mutex, PoisonError};

/// Variables that a toolchain sets for its programs; the image needs the main
/// workspace's own toolchain.
const OF_THIS_TOOLCHAIN: [&str; 5] = ["CARGO", "RUSTC", "RUSTDOC", "RUSTUP_TOOLCHAIN", "RUSTFLAGS"];

/// The path of a board's image, which is built if it is missing. Its other files are in
/// the same folder.
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
        build(&["--board", board], &root);
    }
    assert!(image.exists(), "{} is missing: build it with `cargo xtask firmware --board {board}`", image.display());
    image
}

/// A variant of a board with another profile: the files of both, and the image.
#[derive(Debug, Clone)]
pub struct Variant {
    /// The board's file.
    pub board: PathBuf,
    /// The profile's file.
    pub profile: PathBuf,
    /// The image.
    pub image: PathBuf,
}

/// Builds the image of a board, under another name, with both files changed.
pub fn changed(
    board: &str,
    profile: &str,
    name: &str,
    change_board: impl FnOnce(String) -> String,
    change_profile: impl FnOnce(String) -> String,
) -> Variant {
    static BUILDS: Mutex<()> = Mutex::new(());
    let _one_at_a_time = BUILDS.lock().unwrap_or_else(PoisonError::into_inner);
    let root = root();
    let folder = root.join("target/variants").join(name);
    std::fs::create_dir_all(&folder).unwrap();
    let text = |path: String| std::fs::read_to_string(root.join(path)).unwrap();
    let variant = Variant {
        board: folder.join("board.toml"),
        profile: folder.join("profile.toml"),
        image: root.join("target/images").join(name).join("ferrostep.elf"),
    };
    let board_text = text(format!("config/boards/{board}.toml"));
    let own_name = format!("name = \"{board}\"");
    assert!(board_text.contains(&own_name));
    // A file that stays the same leaves the image as it is.
    for (path, text) in [
        (&variant.board, change_board(board_text.replace(&own_name, &format!("name = \"{name}\"")))),
        (&variant.profile, change_profile(text(format!("config/profiles/{profile}.toml")))),
    ] {
        if std::fs::read_to_string(path).ok().as_ref() != Some(&text) {
            std::fs::write(path, text).unwrap();
        }
    }
    let [board_path, profile_path] = [&variant.board, &variant.profile].map(|path| path.to_str().unwrap());
    build(&["--board", board_path, "--profile", profile_path], &root);
    variant
}

fn build(arguments: &[&str], root: &Path) {
    let mut cargo = Command::new("cargo");
    for name in OF_THIS_TOOLCHAIN {
        cargo.env_remove(name);
    }
    let output = cargo.args(["xtask", "firmware"]).args(arguments).current_dir(root).output().unwrap();
    let messages = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "cargo xtask firmware {}: {messages}", arguments.join(" "));
}

/// The project's folder.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).unwrap().to_owned()
}
