//! Version and commit of the package that is being built, for build scripts:
//! `0.1.0 (commit abcdef0)`.
//!
//! The text depends on the sources alone: no date, no machine. `-dirty` follows the commit where a
//! source differs from it, and sources without a repository (an archive) have `commit unknown`.
#![forbid(unsafe_code)]

mod sources;

use std::io;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Letters of a commit's name, at least.
const COMMIT_LETTERS: &str = "--short=7";

/// Variables that point git to another repository than the one around the sources.
const FOREIGN_VARIABLES: [&str; 3] = ["GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE"];

/// The version of the package that is being built.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Version {
    /// `0.1.0 (commit abcdef0)`, `0.1.0 (commit abcdef0-dirty)` or `0.1.0 (commit unknown)`.
    pub text: String,
    /// Files and folders with which it may change.
    pub depends_on: Vec<PathBuf>,
}

impl Version {
    /// The version of a package that is being built, with the commit of the repository at `root`;
    /// `package` is its folder there. What goes into it follows from the packages' manifests.
    ///
    /// # Errors
    /// A manifest cannot be read.
    pub fn of_package(number: &str, root: &Path, package: &str) -> io::Result<Self> {
        let sources = sources::of_package(root, package)?;
        Ok(Self::of(number, root, &sources.iter().map(String::as_str).collect::<Vec<_>>()))
    }

    /// Describes the package with this number and these sources: files and folders
    /// relative to `root`.
    fn of(number: &str, root: &Path, sources: &[&str]) -> Self {
        let mut depends_on: Vec<PathBuf> = sources.iter().map(|source| root.join(source)).collect();
        let commit = Repository::at(root).map(|repository| {
            depends_on.extend(repository.says_when_it_moves());
            repository.commit(sources)
        });
        let commit = commit.flatten().unwrap_or_else(|| "unknown".to_owned());
        Self { text: format!("{number} (commit {commit})"), depends_on }
    }

    /// Declares to cargo the files that the text depends on; for build scripts.
    pub fn watch(&self) {
        for path in self.depends_on.iter().filter(|path| path.exists()) {
            println!("cargo:rerun-if-changed={}", path.display());
        }
    }
}

/// A repository whose root is this folder.
struct Repository<'a> {
    root: &'a Path,
}

impl<'a> Repository<'a> {
    /// `None` without a repository here: one of a folder further up belongs to other sources.
    fn at(root: &'a Path) -> Option<Self> {
        let repository = Self { root };
        let top = PathBuf::from(repository.git(&["rev-parse", "--show-toplevel"])?);
        (top.canonicalize().ok()? == root.canonicalize().ok()?).then_some(repository)
    }

    /// Returns the output of git without the blanks around it; `None` if git fails.
    fn git(&self, arguments: &[&str]) -> Option<String> {
        let mut command = Command::new("git");
        command.arg("-C").arg(self.root).arg("--no-optional-locks").args(arguments);
        for name in FOREIGN_VARIABLES {
            command.env_remove(name);
        }
        let output = command.output().ok().filter(|output| output.status.success())?;
        Some(String::from_utf8(output.stdout).ok()?.trim().to_owned())
    }

    fn commit(&self, sources: &[&str]) -> Option<String> {
        let commit = self.git(&["rev-parse", COMMIT_LETTERS, "HEAD"])?;
        let changes = self.git(&[&["status", "--porcelain", "--"], sources].concat())?;
        Some(if changes.is_empty() { commit } else { format!("{commit}-dirty") })
    }

    /// The log of where HEAD has been, or HEAD itself.
    fn says_when_it_moves(&self) -> Option<PathBuf> {
        let path = |name: &str| Some(self.root.join(self.git(&["rev-parse", "--git-path", name])?));
        [path("logs/HEAD"), path("HEAD")].into_iter().flatten().find(|path| path.exists())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::fs;

    use super::*;

    fn git(folder: &Path, arguments: &[&str]) {
        let identity = ["-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false"];
        let output = Command::new("git").arg("-C").arg(folder).args(identity).args(arguments).output().unwrap();
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    }

    /// True if git is installed: sources can be built without it, and then there is no
    /// repository to test with.
    fn has_git() -> bool {
        Command::new("git").arg("--version").output().is_ok_and(|output| output.status.success())
    }

    /// A repository with a source and a page, committed.
    fn repository() -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("src")).unwrap();
        fs::write(folder.path().join("src/main.rs"), "fn main() {}").unwrap();
        fs::write(folder.path().join("page.md"), "A page.").unwrap();
        git(folder.path(), &["init", "--quiet"]);
        git(folder.path(), &["add", "."]);
        git(folder.path(), &["commit", "--quiet", "-m", "first"]);
        folder
    }

    fn text(root: &Path) -> String {
        Version::of("1.2.3", root, &["src"]).text
    }

    #[test]
    fn the_commit_is_named_and_whether_a_source_differs_from_it() {
        if !has_git() {
            return;
        }
        let folder = repository();
        let clean = text(folder.path());
        let commit = clean.strip_prefix("1.2.3 (commit ").unwrap().strip_suffix(')').unwrap();
        assert!(commit.len() >= 7 && commit.bytes().all(|byte| byte.is_ascii_hexdigit()), "{clean}");
        // A file that is not a source changes nothing.
        fs::write(folder.path().join("page.md"), "Another.").unwrap();
        assert_eq!(text(folder.path()), clean);
        for (file, content) in [("src/main.rs", "fn main() { }"), ("src/new.rs", "")] {
            fs::write(folder.path().join(file), content).unwrap();
            assert_eq!(text(folder.path()), format!("1.2.3 (commit {commit}-dirty)"), "{file}");
            git(folder.path(), &["stash", "--quiet", "--include-untracked"]);
        }
        git(folder.path(), &["commit", "--quiet", "--allow-empty", "-m", "second"]);
        let second = text(folder.path());
        assert!(second != clean && !second.contains("dirty"), "{second}");
    }

    #[test]
    fn cargo_looks_again_when_a_source_or_the_commit_changes() {
        if !has_git() {
            return;
        }
        let folder = repository();
        let version = Version::of("1.2.3", folder.path(), &["src"]);
        let [source, log] = version.depends_on.as_slice() else { panic!("{version:?}") };
        assert_eq!(*source, folder.path().join("src"));
        let before = fs::read(log).unwrap();
        git(folder.path(), &["commit", "--quiet", "--allow-empty", "-m", "second"]);
        assert_ne!(fs::read(log).unwrap(), before);
    }

    #[test]
    fn sources_without_a_repository_of_their_own_have_no_commit() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("src")).unwrap();
        assert_eq!(text(folder.path()), "1.2.3 (commit unknown)");
        if !has_git() {
            return;
        }
        // Unpacked within a repository of something else.
        let other = repository();
        let inside = other.path().join("src");
        assert_eq!(text(&inside), "1.2.3 (commit unknown)");
        // A repository without a commit.
        git(folder.path(), &["init", "--quiet"]);
        assert_eq!(text(folder.path()), "1.2.3 (commit unknown)");
    }
}
