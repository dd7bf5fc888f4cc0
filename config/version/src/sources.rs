//! The sources of a package: its folder and those of all packages of the repository that
//! it is made from.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io;
use std::path::{Component, Path};

/// Files that decide how everything is built.
const OF_ALL: [&str; 4] = [".cargo/config.toml", "Cargo.lock", "Cargo.toml", "rust-toolchain.toml"];

/// Files and folders, relative to `root`, that go into the package in the folder `package`, without
/// those that only tests use.
///
/// # Errors
/// A manifest cannot be read.
pub fn of_package(root: &Path, package: &str) -> io::Result<Vec<String>> {
    let shared = paths(&fs::read_to_string(root.join("Cargo.toml"))?, "", &BTreeMap::new(), |section| {
        section == "workspace.dependencies"
    });
    let mut folders = BTreeSet::new();
    let mut open = vec![package.to_owned()];
    while let Some(folder) = open.pop() {
        if folders.contains(&folder) {
            continue;
        }
        let manifest = fs::read_to_string(root.join(&folder).join("Cargo.toml"))?;
        let is_built = |section: &str| section.ends_with("dependencies") && !section.ends_with("dev-dependencies");
        open.extend(paths(&manifest, &folder, &shared, is_built).into_values());
        folders.insert(folder);
    }
    Ok(OF_ALL.into_iter().map(str::to_owned).chain(folders).collect())
}

/// The packages of the repository, with their folders, that the chosen sections of a manifest in
/// `folder` name. A dependency is one line, as everywhere in the repository.
fn paths(
    manifest: &str,
    folder: &str,
    shared: &BTreeMap<String, String>,
    is_chosen: impl Fn(&str) -> bool,
) -> BTreeMap<String, String> {
    let mut section = "";
    let mut found = BTreeMap::new();
    for line in manifest.lines() {
        if let Some(name) = line.strip_prefix('[').and_then(|rest| rest.split(']').next()) {
            section = name;
        }
        let Some((name, value)) = line.split_once('=').filter(|_| is_chosen(section)) else { continue };
        let name = name.trim().to_owned();
        let path = value.split_once("path = \"").and_then(|(_, rest)| rest.split('"').next());
        if let Some(path) = path {
            found.insert(name, joined(folder, path));
        } else if let Some(path) = shared.get(&name) {
            found.insert(name, path.clone());
        }
    }
    found
}

/// The path from a folder, without `..`.
fn joined(folder: &str, path: &str) -> String {
    let mut parts: Vec<String> = Vec::new();
    for part in Path::new(folder).join(path).components() {
        match part {
            Component::ParentDir => {
                parts.pop();
            }
            Component::Normal(name) => parts.push(name.to_string_lossy().into_owned()),
            _ => {}
        }
    }
    parts.join("/")
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn packages_of_packages_count_and_those_of_tests_do_not() {
        let folder = tempfile::tempdir().unwrap();
        let write = |package: &str, manifest: &str| {
            fs::create_dir_all(folder.path().join(package)).unwrap();
            fs::write(folder.path().join(package).join("Cargo.toml"), manifest).unwrap();
        };
        write("", "[workspace.dependencies]\nb = { path = \"b\" }\nother = \"1\"\n");
        write(
            "a",
            "[dependencies]\nb = { workspace = true }\nother = { workspace = true }\n[dev-dependencies]\nd = { path = \"../d\" }\n",
        );
        write("b", "[target.'cfg(unix)'.dependencies]\nc = { path = \"inner\", optional = true }\n");
        write("b/inner", "[build-dependencies]\ne = { path = \"../../e\" }\n");
        write("e", "[features]\nd = []\n");
        let found = of_package(folder.path(), "a").unwrap();
        assert_eq!(found[OF_ALL.len()..], ["a", "b", "b/inner", "e"]);
    }

    #[test]
    fn what_the_tool_and_the_images_are_made_from_counts() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let tool = of_package(&root, "desk/cli").unwrap();
        for folder in [
            "desk/binary-gcode",
            "printer/card",
            "config/checked-toml",
            "desk/cli",
            "tests/oracle",
            "papers",
            "config/version",
        ] {
            assert!(tool.iter().any(|source| source == folder), "{folder}: {tool:?}");
        }
        let image = of_package(&root, "app").unwrap();
        for folder in [
            "app",
            "config/boards",
            "printer/card",
            "hal-shim/stm32f4-board",
            "papers",
            "planner/square-root",
            "printer/host-port",
        ] {
            assert!(image.iter().any(|source| source == folder), "{folder}: {image:?}");
        }
        // Nothing that is not there.
        assert!(tool.iter().chain(&image).all(|source| root.join(source).exists()), "{tool:?} {image:?}");
    }
}
