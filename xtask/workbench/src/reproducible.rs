//! Check that an image is the same wherever it is built: two clones of the last commit, in folders
//! of different names and depths, with cargo's downloads in different ones.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use sha2::{Digest, Sha256};

use crate::steps::{Failure, Run};
use crate::system;

/// Image to build.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// The board: bench, prusa-buddy, btt-octopus-1.1 or the path of a TOML file
    /// within the repository
    #[arg(long, default_value = "bench")]
    board: String,
}

/// Folders of the clones, within one for temporary files, and the name of each one's step.
const FOLDERS: [(&str, &str); 2] =
    [("a", "image in one folder"), ("another-folder/that-lies-deeper", "image in another folder")];

/// Builds a board's image in both clones and compares all its files; prints the digests.
///
/// # Errors
/// A build fails, or a file differs.
pub fn check(run: &mut Run, options: &Options) -> Result<(), Failure> {
    // A folder outside the repository, whose `.cargo/config.toml` would apply there beside
    // the clone's own.
    let folder = std::env::temp_dir().join(format!("ferrostep-reproducible-{}", std::process::id()));
    let outcome = build_and_compare(run, options, &folder);
    let removed = fs::remove_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()));
    outcome.and(removed)
}

fn build_and_compare(run: &mut Run, options: &Options, folder: &Path) -> Result<(), Failure> {
    // Both clones are made before a build, which takes minutes: a commit in between would
    // give another image.
    run.step("two clones of the last commit", || {
        FOLDERS.into_iter().try_for_each(|(name, _)| {
            let mut git = Command::new("git");
            system::run(git.args(["clone", "--quiet", "--no-hardlinks"]).arg(system::root()).arg(folder.join(name)))
        })
    })?;
    let mut images = Vec::new();
    for (name, step) in FOLDERS {
        let clone = folder.join(name);
        run.step(step, || {
            let mut build = Command::new(env!("CARGO"));
            build.current_dir(&clone).env("CARGO_TARGET_DIR", clone.join("target"));
            build.env("CARGO_HOME", another_home(&folder.join("cargo-of").join(name))?);
            system::run(build.args(["xtask", "firmware", "--board", &options.board]))
        })?;
        images.push(files(&clone.join("target/images"))?);
    }
    run.step("comparison", || {
        let [first, second] = &images[..] else { return Err("there are not two images".to_owned()) };
        same(first, second)
    })?;
    for (name, bytes) in images.first().into_iter().flatten() {
        let digest: String = Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect();
        println!("{digest}  {}", name.display());
    }
    Ok(())
}

/// A file's path and bytes.
type NamedBytes = (PathBuf, Vec<u8>);

/// Names the first file that only one of both has, or that differs.
fn same(first: &[NamedBytes], second: &[NamedBytes]) -> Result<(), Failure> {
    if first.is_empty() {
        return Err("the build has left no image".to_owned());
    }
    let names = |files: &[NamedBytes]| files.iter().map(|(name, _)| name.clone()).collect::<Vec<_>>();
    if names(first) != names(second) {
        return Err(format!("the files differ: {:?} and {:?}", names(first), names(second)));
    }
    for ((name, one), (_, other)) in first.iter().zip(second) {
        if one != other {
            let at = one.iter().zip(other).position(|(one, other)| one != other).unwrap_or(one.len().min(other.len()));
            return Err(format!("{} differs from byte {at} on", name.display()));
        }
    }
    Ok(())
}

/// A folder for cargo's downloads, made here, with the contents of the present one.
#[cfg(unix)]
fn another_home(folder: &Path) -> Result<PathBuf, Failure> {
    let shown = |error: std::io::Error| format!("{}: {error}", folder.display());
    fs::create_dir_all(folder).map_err(shown)?;
    let present = system::cargo_home().ok_or("cargo's folder is unknown: set CARGO_HOME")?;
    for entry in fs::read_dir(&present).map_err(|error| format!("{}: {error}", present.display()))? {
        let path = entry.map_err(shown)?.path();
        std::os::unix::fs::symlink(&path, folder.join(path.file_name().unwrap_or_default())).map_err(shown)?;
    }
    Ok(folder.to_path_buf())
}

/// The present folder of cargo's downloads: both builds share it, since links cannot be made here.
#[cfg(not(unix))]
fn another_home(_folder: &Path) -> Result<PathBuf, Failure> {
    system::cargo_home().ok_or_else(|| "cargo's folder is unknown: set CARGO_HOME".to_owned())
}

/// An image's files below a folder, with their bytes, in the order of their names.
fn files(folder: &Path) -> Result<Vec<NamedBytes>, Failure> {
    let mut found = Vec::new();
    for path in crate::release::files(folder)? {
        let bytes = fs::read(&path).map_err(|error| format!("{}: {error}", path.display()))?;
        found.push((path.strip_prefix(folder).unwrap_or(&path).to_path_buf(), bytes));
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_difference_is_named() {
        let file = |name: &str, bytes: &[u8]| (PathBuf::from(name), bytes.to_vec());
        let images = [file("a.bin", b"1234"), file("a.hex", b"56")];
        assert_eq!(same(&images, &images), Ok(()));
        let changed = [file("a.bin", b"1294"), file("a.hex", b"56")];
        assert_eq!(same(&images, &changed), Err("a.bin differs from byte 2 on".to_owned()));
        let longer = [file("a.bin", b"12345"), file("a.hex", b"56")];
        assert_eq!(same(&images, &longer), Err("a.bin differs from byte 4 on".to_owned()));
        assert!(same(&images, &images[..1]).is_err_and(|failure| failure.starts_with("the files differ")));
        assert_eq!(same(&[], &[]), Err("the build has left no image".to_owned()));
    }
}
