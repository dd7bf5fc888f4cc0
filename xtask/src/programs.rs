//! Test programs: built by cargo at once, then run, those that depend on a change first,
//! until one fails.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

use crate::steps::Failure;
use crate::system::{self, cargo};

/// A test program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Program {
    /// Name of its package.
    pub package: String,
    /// Folder of its package, in which it runs.
    folder: PathBuf,
    /// Name of the library, program or test that it tests.
    pub target: String,
    path: PathBuf,
}

/// Builds the test programs that cargo's arguments name.
///
/// # Errors
/// A program does not compile.
pub fn build(arguments: &[&str]) -> Result<Vec<Program>, Failure> {
    let mut build = cargo();
    build.args(["test", "--no-run", "--message-format", "json-render-diagnostics"]).args(arguments);
    let said = system::run_for_output(&mut build)?;
    Ok(said.lines().filter_map(|line| Program::of(&serde_json::from_str(line).ok()?)).collect())
}

impl Program {
    /// The program in one of cargo's messages, if it names one.
    fn of(message: &Value) -> Option<Self> {
        let is_test = message.pointer("/profile/test")?.as_bool()?;
        let path = PathBuf::from(message.get("executable")?.as_str()?);
        let folder = Path::new(message.get("manifest_path")?.as_str()?).parent()?.to_owned();
        // path+file:///the/folder#name@version, or without the name where the folder is
        // called the same.
        let (place, name) = message.get("package_id")?.as_str()?.rsplit_once('#')?;
        let package = match name.split_once('@') {
            Some((name, _)) => name.to_owned(),
            None => place.rsplit('/').next()?.to_owned(),
        };
        let target = message.pointer("/target/name")?.as_str()?.to_owned();
        is_test.then_some(Self { package, folder, target, path })
    }

    /// Names of its tests.
    ///
    /// # Errors
    /// The program does not list them.
    pub fn tests(&self) -> Result<BTreeSet<String>, Failure> {
        let said = system::run_for_output(Command::new(&self.path).args(["--list", "--format", "terse"]))?;
        Ok(said.lines().filter_map(|line| line.strip_suffix(": test")).map(str::to_owned).collect())
    }

    /// Runs it with arguments and variables.
    ///
    /// # Errors
    /// A test fails; its output is in the error.
    pub fn run(&self, arguments: &[String], variables: &[(&str, &std::ffi::OsStr)]) -> Result<(), Failure> {
        let mut command = Command::new(&self.path);
        // Runs it as cargo does.
        command.current_dir(&self.folder).env("CARGO_MANIFEST_DIR", &self.folder).env("CARGO_PKG_NAME", &self.package);
        command.args(arguments).envs(variables.iter().copied());
        system::run_tests(&mut command)
    }
}

/// Packages of the workspace that a change touches, and all that depend on them. Everything depends
/// on the manifests at the root.
///
/// # Errors
/// Git or cargo does not answer.
pub fn affected(since: &str) -> Result<BTreeSet<String>, Failure> {
    let mut git = Command::new("git");
    git.current_dir(system::root()).args(["diff", "--name-only", since]);
    let changed =
        system::output(&mut git).ok_or_else(|| format!("git knows no commit {since}: name another with --since"))?;
    let root = system::root();
    Ok(dependents(&packages(&metadata()?, &root), &changed.lines().map(PathBuf::from).collect::<Vec<_>>()))
}

/// Cargo's description of the workspace.
///
/// # Errors
/// Cargo does not answer.
pub fn metadata() -> Result<Value, Failure> {
    let said = system::output(cargo().args(["metadata", "--format-version", "1", "--no-deps"]));
    said.and_then(|text| serde_json::from_str(&text).ok()).ok_or_else(|| "`cargo metadata` fails".to_owned())
}

/// A package's folder from the root, and the packages that it names.
type Package = (PathBuf, BTreeSet<String>);

fn packages(metadata: &Value, root: &Path) -> BTreeMap<String, Package> {
    let list = |value: &Value, key: &str| value.get(key).and_then(Value::as_array).cloned().unwrap_or_default();
    let named = |value: &Value| value.get("name").and_then(Value::as_str).map(str::to_owned);
    let of = |package: &Value| {
        let manifest = Path::new(package.get("manifest_path")?.as_str()?);
        let folder = manifest.parent()?.strip_prefix(root).ok()?.to_owned();
        Some((named(package)?, (folder, list(package, "dependencies").iter().filter_map(named).collect())))
    };
    list(metadata, "packages").iter().filter_map(of).collect()
}

/// Packages with a changed file, and those that depend on them.
fn dependents(packages: &BTreeMap<String, Package>, changed: &[PathBuf]) -> BTreeSet<String> {
    let owner = |file: &PathBuf| {
        let holds = packages.iter().filter(|(_, (folder, _))| file.starts_with(folder));
        holds.max_by_key(|(_, (folder, _))| folder.components().count()).map(|(name, _)| name.clone())
    };
    if changed
        .iter()
        .any(|file| ["Cargo.toml", "Cargo.lock", "rust-toolchain.toml"].iter().any(|name| file == Path::new(name)))
    {
        return packages.keys().cloned().collect();
    }
    let mut affected: BTreeSet<String> = changed.iter().filter_map(owner).collect();
    loop {
        let more = packages.iter().filter(|(_, (_, uses))| !uses.is_disjoint(&affected)).map(|(name, _)| name.clone());
        let more: Vec<String> = more.filter(|name| !affected.contains(name)).collect();
        if more.is_empty() {
            return affected;
        }
        affected.extend(more);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    use serde_json::json;

    #[test]
    fn a_program_is_read_from_cargo_s_message() {
        let message = json!({
            "reason": "compiler-artifact", "package_id": "path+file:///r/tests#ferrostep-tests@0.2.0",
            "manifest_path": "/r/tests/Cargo.toml", "target": {"name": "main"}, "profile": {"test": true}, "executable": "/t/main-1",
        });
        let program = Program::of(&message).unwrap();
        assert_eq!((&*program.package, &*program.target), ("ferrostep-tests", "main"));
        assert_eq!((program.folder, program.path), ("/r/tests".into(), "/t/main-1".into()));
        let mut same_name = message.clone();
        same_name["package_id"] = json!("path+file:///r/xtask#0.2.0");
        assert_eq!(Program::of(&same_name).unwrap().package, "xtask");
        let mut library = message;
        library["profile"]["test"] = json!(false);
        assert_eq!(Program::of(&library), None);
    }

    #[test]
    fn a_change_reaches_what_depends_on_it() {
        let package =
            |folder: &str, uses: &[&str]| (folder.into(), uses.iter().map(|name| (*name).to_owned()).collect());
        let packages = BTreeMap::from([
            ("planner".to_owned(), package("planner", &["libm"])),
            ("printer".to_owned(), package("printer", &["planner"])),
            ("cli".to_owned(), package("cli", &["printer"])),
            ("gcode".to_owned(), package("printer/gcode", &[])),
            ("tests".to_owned(), package("tests", &["cli"])),
            ("testkit".to_owned(), package("tests/testkit", &[])),
        ]);
        let names = |files: &[&str]| {
            let files: Vec<PathBuf> = files.iter().map(PathBuf::from).collect();
            dependents(&packages, &files).into_iter().collect::<Vec<_>>().join(" ")
        };
        assert_eq!(names(&["printer/src/lib.rs"]), "cli printer tests");
        assert_eq!(names(&["tests/testkit/src/lib.rs"]), "testkit");
        assert_eq!(names(&["printer/gcode/src/lib.rs", "README.md"]), "gcode");
        assert_eq!(names(&["Cargo.lock"]).split(' ').count(), packages.len());
        assert_eq!(names(&[]), "");
    }

    #[test]
    fn packages_of_this_workspace_are_known() {
        assert!(affected("HEAD").is_ok());
        assert!(affected("no-such-commit").unwrap_err().contains("--since"));
    }
}
