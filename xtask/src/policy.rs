//! Rules for every file and every dependency: spelling, licences, sources.

use crate::steps::{Failure, Run};
use crate::system::{self, cargo};

/// The workspaces, by their folders from the root.
const WORKSPACES: [&str; 2] = [".", "tests/fuzz"];

/// Checks spelling by `typos.toml`, and all dependencies by `deny.toml`. It leaves known
/// vulnerabilities out, since their list is on the network and changes daily; [`advisories`] reads
/// it for a release.
///
/// # Errors
/// A program cannot be installed, a word is misspelt, or a dependency breaks a rule.
pub fn check(run: &mut Run) -> Result<(), Failure> {
    run.step("spelling", || {
        // A separate program, not a subcommand of cargo.
        let typos = || std::process::Command::new("typos");
        if system::output(typos().arg("--version")).is_none() {
            system::run(cargo().args(["install", "typos-cli", "--locked"]))?;
        }
        system::run(typos().current_dir(system::root()))
    })?;
    run.step("licences and sources of dependencies", || deny(&["bans", "licenses", "sources"]))
}

/// Checks all dependencies against the list of known vulnerabilities, which is fetched.
///
/// # Errors
/// The list cannot be fetched, or a dependency is on it.
pub fn advisories(run: &mut Run) -> Result<(), Failure> {
    run.step("known vulnerabilities of dependencies", || deny(&["advisories"]))
}

fn deny(checks: &[&str]) -> Result<(), Failure> {
    system::cargo_program("cargo-deny", "deny", &[])?;
    let config = system::root().join("deny.toml");
    for workspace in WORKSPACES {
        let manifest = system::root().join(workspace).join("Cargo.toml");
        let mut deny = cargo();
        deny.arg("deny").arg("--manifest-path").arg(manifest).arg("--config").arg(&config);
        system::run(deny.args(["--all-features", "check", "--hide-inclusion-graph"]).args(checks))?;
    }
    Ok(())
}
