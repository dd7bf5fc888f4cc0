//! A release: a folder with all files that users get and need to check them.
//!
//! Images of all boards, the `ferrostep` command for this machine with its completions and
//! manual pages, an archive of these, a parts list (SBOM, CycloneDX) and the notices of others
//! for each, the licence texts, this version's part of the changelog, and the SHA-256 of every
//! file. On request the command for other systems, as wheels and archives, and the recipes of
//! package managers.

mod recipes;
mod systems;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use sha2::{Digest, Sha256};

use crate::core_library;
use crate::firmware::{self, Shown};
use crate::image;
use crate::policy;
use crate::steps::{Failure, Run};
use crate::system::{self, cargo};

/// Checks to leave out.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Options {
    /// Writes a trial release although sources differ from the last commit, the commit has no tag
    /// `vVERSION`, or the list of known vulnerabilities cannot be read
    #[arg(long)]
    trial: bool,
    /// Builds the command for Linux on x86-64 and ARM and for Windows, as wheels for
    /// pip and as archives
    #[arg(long)]
    wheels: bool,
    /// The public address below which the release will be, for the recipes of Homebrew and the AUR;
    /// Cargo.toml's `repository` by default, without which none are written
    #[arg(long, value_name = "URL", requires = "wheels", default_value = env!("CARGO_PKG_REPOSITORY"))]
    repository: String,
}

/// Files of the sources that are copied unchanged.
const TEXTS: [&str; 3] = ["LICENSE-APACHE", "LICENSE-MIT", "SECURITY.md"];

/// The list of checksums, as `sha256sum --check` reads it.
const CHECKSUMS: &str = "SHA256SUMS";

/// Writes the release of this version into `target/release-VERSION`.
///
/// # Errors
/// The sources are not those of a tagged version (but for a trial), the changelog has no part for
/// it, something does not build, or a file cannot be written.
pub fn write(run: &mut Run, options: &Options) -> Result<(), Failure> {
    let version = env!("CARGO_PKG_VERSION");
    let changes = run.step("version", || {
        let checked = check_sources(version);
        if !options.trial {
            checked?;
        } else if let Err(failure) = checked {
            eprintln!("    trial: {failure}");
        }
        changes_of(version, &read(&system::root().join("CHANGELOG.md"))?)
    })?;
    let known = policy::advisories(run);
    if !options.trial {
        known?;
    }
    let folder = system::target_directory().join(format!("release-{version}"));
    if folder.exists() {
        fs::remove_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    }
    fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    write_file(&folder.join("CHANGES.md"), &changes)?;
    for text in TEXTS {
        copy(&system::root().join(text), &folder.join(text))?;
    }

    firmware::build_images(run, &firmware::Options::default(), Shown::Output)?;
    run.step("images", || collect_images(&folder, version))?;
    run.step("command", || {
        let mut build = cargo();
        build.args(["build", "--profile", "dist", "--locked", "--package", "ferrostep"]);
        build.arg("--config").arg(firmware::renamed_folders("build", &core_library::folders()?)?);
        system::run(&mut build)?;
        let name = format!("ferrostep{}", std::env::consts::EXE_SUFFIX);
        let program = system::target_directory().join("dist").join(&name);
        copy(&program, &folder.join(name))?;
        write_manual(&program, &folder)
    })?;
    run.step("parts lists", || parts_lists(&folder))?;
    run.step("notices", || notices(&folder))?;
    if options.wheels {
        systems::write_wheels(run, &folder)?;
        run.step("archives", || {
            systems::SYSTEMS.iter().try_for_each(|one| write_archive(&folder, version, one.triple, &one.path()))
        })?;
        run.step("recipes", || write_recipes(&folder, version, &options.repository))?;
    } else {
        run.step("archive", || {
            let triple = format!("{}-unknown-linux-gnu", std::env::consts::ARCH);
            write_archive(&folder, version, &triple, &folder.join("ferrostep"))
        })?;
    }
    run.step("checksums", || write_file(&folder.join(CHECKSUMS), &checksums(&folder)?))?;
    println!("{}", folder.display());
    Ok(())
}

/// Shells for which a release has completions, with the names by which they look for them.
const SHELLS: [(&str, &str); 4] =
    [("bash", "ferrostep.bash"), ("zsh", "_ferrostep"), ("fish", "ferrostep.fish"), ("powershell", "_ferrostep.ps1")];

/// Writes the completions and the manual pages that the command makes of itself.
fn write_manual(program: &Path, folder: &Path) -> Result<(), Failure> {
    let make_folder = |name: &str| {
        let folder = folder.join(name);
        fs::create_dir_all(&folder).map(|()| folder.clone()).map_err(|error| format!("{}: {error}", folder.display()))
    };
    let completions = make_folder("completions")?;
    for (shell, name) in SHELLS {
        let script = system::run_for_output(Command::new(program).args(["completions", shell]))?;
        write_file(&completions.join(name), &script)?;
    }
    system::run(Command::new(program).args(["man", "-o"]).arg(make_folder("man")?))
}

/// Files of a release that go into an archive beside the command.
const BESIDE_THE_COMMAND: [&str; 7] =
    ["completions", "man", "LICENSE-APACHE", "LICENSE-MIT", "NOTICES-cli.md", "CHANGES.md", "ferrostep-cli.cdx.json"];

/// Packs a system's command with the completions, pages, licences and notices, the same bytes each
/// time: by tar and gzip, if they are GNU's.
fn write_archive(folder: &Path, version: &str, triple: &str, program: &Path) -> Result<(), Failure> {
    if !cfg!(target_os = "linux") {
        eprintln!("    an archive is made on Linux only");
        return Ok(());
    }
    let archive = recipes::archive(version, triple);
    let name = archive.strip_suffix(".tar.gz").unwrap_or(&archive);
    let (Some(from), Some(file)) = (program.parent(), program.file_name()) else {
        return Err(format!("{}: not the path of a program", program.display()));
    };
    let mut tar = Command::new("tar");
    tar.args([
        "--sort=name",
        "--owner=0",
        "--group=0",
        "--numeric-owner",
        "--mtime=@0",
        "--use-compress-program=gzip -n -9",
    ]);
    tar.arg(format!("--transform=s,^,{name}/,")).arg("-cf").arg(folder.join(&archive));
    system::run(tar.arg("-C").arg(from).arg(file).arg("-C").arg(folder).args(BESIDE_THE_COMMAND))
}

/// Writes the recipes of package managers, if the release has a public address.
fn write_recipes(folder: &Path, version: &str, repository: &str) -> Result<(), Failure> {
    if repository.is_empty() {
        eprintln!("    none: Cargo.toml has no `repository` yet, and --repository URL is not given");
        return Ok(());
    }
    recipes::write(folder, version, repository)
}

/// Checks that the sources are those of the commit that is tagged as this version.
fn check_sources(version: &str) -> Result<(), Failure> {
    let git = |arguments: &[&str]| {
        let mut git = Command::new("git");
        system::output(git.args(arguments).current_dir(system::root()))
            .ok_or("git does not answer: is this a repository?")
    };
    if !git(&["status", "--porcelain"])?.is_empty() {
        return Err("there are uncommitted changes: commit them, or pass --trial".to_owned());
    }
    let tag = format!("v{version}");
    if git(&["tag", "--points-at", "HEAD"])?.lines().any(|line| line == tag) {
        return Ok(());
    }
    Err(format!("the last commit is not tagged {tag}: `git tag -a {tag}`, or pass --trial"))
}

/// The part of the changelog for a version, without its heading.
///
/// # Errors
/// The part is missing or empty.
fn changes_of(version: &str, changelog: &str) -> Result<String, Failure> {
    let heading = format!("## [{version}]");
    let part: Vec<&str> = changelog
        .lines()
        .skip_while(|line| !line.starts_with(&heading))
        .skip(1)
        .take_while(|line| !line.starts_with("## ") && !line.starts_with('['))
        .collect();
    let part = part.join("\n");
    match part.trim() {
        "" => Err(format!("CHANGELOG.md has nothing under \"{heading} - DATE\": write what changed for users")),
        part => Ok(format!("{part}\n")),
    }
}

/// Copies every board's files into a folder named after version and board. The files keep their
/// names, by which boot loaders look for some of them.
fn collect_images(folder: &Path, version: &str) -> Result<(), Failure> {
    for board in ferrostep_boards::builtin_names() {
        let to = folder.join(format!("ferrostep-{version}-{board}"));
        fs::create_dir_all(&to).map_err(|error| format!("{}: {error}", to.display()))?;
        for from in files(&image::images().join(board))? {
            copy(&from, &to.join(from.file_name().unwrap_or_default()))?;
        }
    }
    Ok(())
}

/// Packages with a program in a release, with the target that they are built for.
fn packages() -> [(&'static str, Option<&'static str>); 2] {
    [("desk/cli", None), ("app", Some(crate::core_library::TARGET))]
}

/// A package's own folder, after which its files are named.
fn name_of(package: &str) -> &str {
    package.rsplit('/').next().unwrap_or(package)
}

/// Writes a CycloneDX parts list for the command and the firmware.
fn parts_lists(folder: &Path) -> Result<(), Failure> {
    system::cargo_program("cargo-cyclonedx", "cyclonedx", &[])?;
    for (package, target) in packages() {
        let manifest = system::root().join(package).join("Cargo.toml");
        let name = format!("ferrostep-{}.cdx", name_of(package));
        let mut list = cargo();
        list.args(["cyclonedx", "--format", "json", "--spec-version", "1.5", "--override-filename", &name]);
        list.arg("--manifest-path").arg(&manifest);
        if let Some(target) = target {
            list.args(["--target", target]);
        }
        system::run(&mut list)?;
        // It writes a list beside every manifest of the workspace.
        for found in written_lists(&format!("{name}.json"))? {
            if found.parent() == manifest.parent() {
                copy(&found, &folder.join(format!("{name}.json")))?;
            }
            fs::remove_file(&found).map_err(|error| format!("{}: {error}", found.display()))?;
        }
        if !folder.join(format!("{name}.json")).is_file() {
            return Err(format!("cargo-cyclonedx has written no parts list for {package}"));
        }
    }
    Ok(())
}

/// The parts lists of this name beside the workspace's manifests.
fn written_lists(name: &str) -> Result<Vec<PathBuf>, Failure> {
    let metadata = system::run_for_output(cargo().args(["metadata", "--no-deps", "--format-version", "1"]))?;
    let metadata: serde_json::Value =
        serde_json::from_str(&metadata).map_err(|error| format!("cargo metadata: {error}"))?;
    let manifests =
        metadata["packages"].as_array().into_iter().flatten().filter_map(|package| package["manifest_path"].as_str());
    let lists = manifests.filter_map(|manifest| Path::new(manifest).parent()).map(|folder| folder.join(name));
    Ok(lists.filter(|list| list.is_file()).collect())
}

/// Writes the notices of others whose code is in the command and the firmware.
fn notices(folder: &Path) -> Result<(), Failure> {
    system::cargo_program("cargo-about", "about", &["cli"])?;
    for (package, target) in packages() {
        let mut about = cargo();
        about.args(["about", "generate", "--offline", "--locked", "--fail", "--config", "about.toml"]);
        about.arg("--manifest-path").arg(system::root().join(package).join("Cargo.toml"));
        if let Some(target) = target {
            about.args(["--target", target]);
        }
        about.arg("docs/notices.hbs").arg("--output-file").arg(folder.join(format!("NOTICES-{}.md", name_of(package))));
        system::run(&mut about)?;
    }
    Ok(())
}

/// SHA-256 of every file in a folder and its subfolders, a line each.
fn checksums(folder: &Path) -> Result<String, Failure> {
    let mut lines = Vec::new();
    for file in files(folder)? {
        let digest = digest_of(&file)?;
        let name = file.strip_prefix(folder).unwrap_or(&file).display().to_string().replace('\\', "/");
        lines.push(format!("{digest}  {name}\n"));
    }
    Ok(lines.concat())
}

/// SHA-256 of a file.
fn digest_of(file: &Path) -> Result<String, Failure> {
    let bytes = fs::read(file).map_err(|error| format!("{}: {error}", file.display()))?;
    Ok(Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect())
}

/// All files in a folder and its subfolders, in the order of their paths.
pub fn files(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let shown = |error: std::io::Error| format!("{}: {error}", folder.display());
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).map_err(shown)? {
        let path = entry.map_err(shown)?.path();
        if path.is_dir() {
            found.extend(files(&path)?);
        } else {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

fn read(path: &Path) -> Result<String, Failure> {
    fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))
}

fn write_file(path: &Path, text: &str) -> Result<(), Failure> {
    fs::write(path, text).map_err(|error| format!("{}: {error}", path.display()))
}

fn copy(from: &Path, to: &Path) -> Result<(), Failure> {
    fs::copy(from, to).map(|_| ()).map_err(|error| format!("{} to {}: {error}", from.display(), to.display()))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const CHANGELOG: &str = "# Changelog\n\n## [Unreleased]\n\n## [0.2.0] - 2026-11-22\n\n### Added\n\n- A thing.\n\n\
        ## [0.1.0] - 2026-01-01\n\n- The first.\n\n[0.2.0]: https://example.org\n";

    #[test]
    fn takes_the_changes_of_one_version() {
        assert_eq!(changes_of("0.2.0", CHANGELOG).unwrap(), "### Added\n\n- A thing.\n");
        assert_eq!(changes_of("0.1.0", CHANGELOG).unwrap(), "- The first.\n");
    }

    #[test]
    fn refuses_a_version_without_changes() {
        for version in ["Unreleased", "0.3.0"] {
            let failure = changes_of(version, CHANGELOG).unwrap_err();
            assert!(failure.starts_with(&format!("CHANGELOG.md has nothing under \"## [{version}]")), "{failure}");
        }
    }

    #[test]
    fn this_version_has_its_part_of_the_changelog() {
        let changelog = read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../CHANGELOG.md")).unwrap();
        assert!(!changes_of(env!("CARGO_PKG_VERSION"), &changelog).unwrap().is_empty());
    }

    /// The plug-in is given on by itself, and its manifest knows no workspace.
    #[test]
    fn the_plug_in_has_this_version() {
        let project = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../desk/plugins/octoprint/pyproject.toml");
        let project: toml::Table = read(&project).unwrap().parse().unwrap();
        assert_eq!(project["project"]["version"].as_str(), Some(env!("CARGO_PKG_VERSION")));
    }

    #[test]
    fn sums_up_every_file_with_its_path() {
        let folder = std::env::temp_dir().join(format!("ferrostep-release-{}", std::process::id()));
        fs::create_dir_all(folder.join("board")).unwrap();
        write_file(&folder.join("b"), "").unwrap();
        write_file(&folder.join("board/a"), "abc").unwrap();
        let lines = checksums(&folder).unwrap();
        fs::remove_dir_all(&folder).unwrap();
        // FIPS 180-4's example, and the digest of nothing.
        assert_eq!(
            lines,
            "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855  b\n\
             ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad  board/a\n"
        );
    }
}
