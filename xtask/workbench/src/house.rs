//! The book's drawing of the packages and their dependencies, from the manifests.
//!
//! A package is drawn below all that depend on it. An arrow leads from a package to one that it
//! needs itself; the arrow is left out if another of its dependencies needs that one as well. Tests
//! and tools use what they need and are in the last row.

mod layout;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::steps::Failure;
use crate::system;
use layout::{Layout, ROOM};

/// Path of the drawing, from the root.
const PICTURE: &str = "docs/src/images/packages.svg";

/// Manifests of the workspaces, from the root.
const WORKSPACES: [&str; 2] = ["Cargo.toml", "tests/fuzz/Cargo.toml"];

/// Height of the line that explains the colours, pixels.
const LEGEND: f64 = 40.0;

/// Processors for which a package is built.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// A package that only a board's processor can build.
    Board,
    /// A package for desk and board: without the standard library.
    Both,
    /// A package for the desk.
    Desk,
    /// A tool, which no user gets.
    Tool,
}

/// Folders of tests and tools, from the root.
const TOOLS: [&str; 9] = [
    "tests",
    "tests/fuzz",
    "tests/image-code",
    "tests/mainboard/log",
    "tests/outside",
    "tests/random-cases",
    "tests/testkit",
    "xtask",
    "xtask/workbench",
];

impl Kind {
    const ALL: [Self; 4] = [Self::Both, Self::Board, Self::Desk, Self::Tool];

    fn colour(self) -> &'static str {
        match self {
            Self::Both => "#28568c",
            Self::Board => "#9c4a1e",
            Self::Desk => "#2f6b47",
            Self::Tool => "#55585e",
        }
    }

    fn legend(self) -> &'static str {
        match self {
            Self::Both => "desk and board (no_std)",
            Self::Board => "board only",
            Self::Desk => "desk only",
            Self::Tool => "tests and tools, which use any",
        }
    }
}

/// A package.
#[derive(Clone, Debug)]
struct Package {
    /// Folder, from the root.
    folder: String,
    kind: Kind,
    /// Indices of the packages that it depends on, tests left out.
    needs: BTreeSet<usize>,
}

/// Draws the packages anew.
///
/// # Errors
/// Cargo does not answer, or the picture cannot be written.
pub fn draw() -> Result<(), Failure> {
    let path = picture_path();
    std::fs::write(&path, picture()?).map_err(|error| format!("{}: {error}", path.display()))
}

fn picture_path() -> PathBuf {
    system::root().join(PICTURE)
}

fn picture() -> Result<String, Failure> {
    let mut all = Vec::new();
    for manifest in WORKSPACES {
        let mut cargo = system::cargo();
        cargo.args(["metadata", "--no-deps", "--offline", "--format-version", "1", "--manifest-path", manifest]);
        let metadata = system::run_for_output(&mut cargo)?;
        let metadata: Value =
            serde_json::from_str(&metadata).map_err(|error| format!("cargo metadata of {manifest}: {error}"))?;
        all.extend(metadata["packages"].as_array().cloned().unwrap_or_default());
    }
    Ok(svg(&packages(&all)?))
}

/// The packages, in the order of their folders, from cargo's descriptions.
fn packages(described: &[Value]) -> Result<Vec<Package>, Failure> {
    let root = system::root();
    let mut by_folder = BTreeMap::new();
    for package in described {
        let (Some(name), Some(manifest)) = (package["name"].as_str(), package["manifest_path"].as_str()) else {
            return Err("cargo metadata: a package without name or path".to_owned());
        };
        let folder = Path::new(manifest).parent().and_then(|folder| folder.strip_prefix(&root).ok());
        let folder = folder.ok_or_else(|| format!("{manifest} lies outside {}", root.display()))?;
        by_folder.insert(folder.to_string_lossy().replace('\\', "/"), (name, package));
    }
    let index: BTreeMap<&str, usize> =
        by_folder.values().enumerate().map(|(index, (name, _))| (*name, index)).collect();
    let described = by_folder.into_iter().map(|(folder, (name, package))| {
        let needed = package["dependencies"].as_array().into_iter().flatten();
        let needed = needed.filter(|needed| !needed["path"].is_null() && needed["kind"] != "dev");
        Package {
            kind: kind(name, &root, &folder),
            folder,
            needs: needed.filter_map(|needed| index.get(needed["name"].as_str()?).copied()).collect(),
        }
    });
    Ok(described.collect())
}

/// Tells a package's kind by its place, and by whether its library does without the
/// standard library.
fn kind(name: &str, root: &Path, folder: &str) -> Kind {
    let library = std::fs::read_to_string(root.join(folder).join("src/lib.rs")).unwrap_or_default();
    match () {
        () if TOOLS.contains(&folder) => Kind::Tool,
        () if crate::DESK.contains(&name) => Kind::Board,
        () if library.lines().any(|line| line.starts_with("#![") && line.contains("no_std")) => Kind::Both,
        () => Kind::Desk,
    }
}

/// Direct needs of each package: those that no other of its needs already includes; empty for
/// tests and tools.
fn arrows(packages: &[Package]) -> Vec<BTreeSet<usize>> {
    let below = |from: usize| {
        let (mut found, mut open) = (BTreeSet::new(), vec![from]);
        while let Some(package) = open.pop() {
            open.extend(packages[package].needs.iter().filter(|needed| found.insert(**needed)));
        }
        found
    };
    let below: Vec<BTreeSet<usize>> = (0..packages.len()).map(below).collect();
    let direct = |needs: &BTreeSet<usize>| {
        let is_direct = |needed: &&usize| !needs.iter().any(|other| below[*other].contains(needed));
        needs.iter().filter(is_direct).copied().collect()
    };
    let is_shown = |package: &Package| package.kind != Kind::Tool;
    packages.iter().map(|package| if is_shown(package) { direct(&package.needs) } else { BTreeSet::new() }).collect()
}

fn svg(packages: &[Package]) -> String {
    let is_last = |package: &Package| package.kind == Kind::Tool;
    let layout = Layout::new(&arrows(packages), &packages.iter().map(is_last).collect::<Vec<_>>());
    let mut out = String::new();
    // Writing to a string does not fail.
    let _ = write_legend(&mut out);
    let _ = write_house(&mut out, packages, &layout);
    let title = "The packages of Ferrostep: an arrow leads from a package to one that it uses";
    ferrostep_svg::page(title, [layout::WIDTH, LEGEND + layout.height()], 13, out)
}

fn write_legend(out: &mut String) -> std::fmt::Result {
    let mut x = 14.0;
    for kind in Kind::ALL {
        writeln!(out, "<rect x=\"{x}\" y=\"12\" width=\"16\" height=\"16\" rx=\"4\" fill=\"{}\"/>", kind.colour())?;
        writeln!(out, "<text x=\"{}\" y=\"25\">{}</text>", x + 22.0, kind.legend())?;
        x += 22.0 + 6.7 * kind.legend().len() as f64 + 14.0;
    }
    writeln!(out, "<text x=\"{x}\" y=\"25\">arrow: uses</text>")
}

fn write_house(out: &mut String, packages: &[Package], layout: &Layout) -> std::fmt::Result {
    for path in layout.arrows() {
        writeln!(out, "<path d=\"{}\" fill=\"none\" stroke=\"#6e7781\" stroke-width=\"1.4\"/>", line(&path))?;
        if let Some([x, y]) = path.last() {
            let y = y + LEGEND;
            writeln!(out, "<path d=\"M{x:.1} {y:.1}l-4 -7h8z\" fill=\"#6e7781\"/>")?;
        }
    }
    for (package, [x, y]) in packages.iter().zip(layout.rooms()) {
        let (left, top, [width, height]) = (x - ROOM[0] / 2.0, y + LEGEND, ROOM);
        writeln!(
            out,
            "<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{width}\" height=\"{height}\" rx=\"6\" fill=\"{}\"/>",
            package.kind.colour()
        )?;
        // A long path has two lines.
        let (outer, name) =
            package.folder.rsplit_once('/').map_or(("", package.folder.as_str()), |(outer, name)| (outer, name));
        let middle = top + height / 2.0;
        let mut text = |y: f64, how: &str, text: &str| {
            writeln!(
                out,
                "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"middle\" fill=\"#ffffff\" {how}>{text}/</text>"
            )
        };
        if outer.is_empty() {
            text(middle + 4.5, "font-weight=\"600\"", name)?;
        } else {
            text(middle - 4.0, "font-size=\"11\"", outer)?;
            text(middle + 11.0, "font-weight=\"600\"", name)?;
        }
    }
    Ok(())
}

/// A curve through points, vertical at each.
fn line(points: &[[f64; 2]]) -> String {
    let mut path = String::new();
    for (index, [x, y]) in points.iter().map(|[x, y]| [*x, y + LEGEND]).enumerate() {
        let _ = match index.checked_sub(1).map(|before| points[before]) {
            None => write!(path, "M{x:.1} {y:.1}"),
            Some([before_x, before_y]) => {
                let middle = (before_y + LEGEND + y) / 2.0;
                write!(path, "C{before_x:.1} {middle:.1} {x:.1} {middle:.1} {x:.1} {y:.1}")
            }
        };
    }
    path
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_drawing_has_every_package_and_is_current() {
        let kept = std::fs::read_to_string(picture_path()).unwrap();
        assert!(kept == picture().unwrap(), "{PICTURE} is not current: `cargo xtask refresh` draws it anew");
        for folder in ["gcode", "show", "web", "calibration", "mainboard", "fuzz", "stm32f4-usb", "xtask"] {
            assert!(kept.contains(&format!(">{folder}/</text>")), "{folder}");
        }
    }

    #[test]
    fn an_arrow_that_follows_from_others_is_left_out() {
        let package = |needs: &[usize]| Package {
            folder: String::new(),
            kind: Kind::Desk,
            needs: needs.iter().copied().collect(),
        };
        let arrows = arrows(&[package(&[1, 2, 3]), package(&[2]), package(&[]), package(&[])]);
        let expected: [&[usize]; 4] = [&[1, 3], &[2], &[], &[]];
        assert_eq!(arrows, expected.map(|needs| needs.iter().copied().collect::<BTreeSet<_>>()));
    }
}
