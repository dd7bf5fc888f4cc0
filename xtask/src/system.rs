//! Programs on this machine: running them, finding them, installing them.

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};

use crate::cost;
use crate::steps::Failure;

/// The workspace's root folder.
pub fn root() -> PathBuf {
    // Cargo sets the variable for programs it runs, to the folder of their package; the built-in
    // path is for a program run by hand.
    let own =
        std::env::var_os("CARGO_MANIFEST_DIR").map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")), PathBuf::from);
    own.ancestors().find(|folder| folder.join("Cargo.lock").is_file()).unwrap_or(&own).to_path_buf()
}

/// The folder cargo builds into.
pub fn target_directory() -> PathBuf {
    // A relative CARGO_TARGET_DIR is relative to where cargo runs, which is the root for
    // every command here.
    std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root().join("target"), |folder| root().join(folder))
}

/// The folder in which cargo keeps its downloads; `None` if it is unknown.
pub fn cargo_home() -> Option<PathBuf> {
    std::env::var_os("CARGO_HOME").map(PathBuf::from).or_else(|| Some(std::env::home_dir()?.join(".cargo")))
}

/// The cargo that runs this program, at the workspace's root.
pub fn cargo() -> Command {
    let program = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new(program);
    command.current_dir(root());
    command
}

/// Runs a command with its output shown, and returns its exit status.
pub fn exit_status(command: &mut Command) -> Result<ExitStatus, Failure> {
    let shown = show(command);
    eprintln!("    {shown}");
    command.spawn().and_then(cost::wait).map_err(|error| format!("cannot run `{shown}`: {error}"))
}

/// Runs a command with its output shown; fails without success.
pub fn run(command: &mut Command) -> Result<(), Failure> {
    let shown = show(command);
    let status = exit_status(command)?;
    if status.success() { Ok(()) } else { Err(format!("`{shown}`: {status}")) }
}

/// Maximum number of lines of failed tests that a failure repeats.
const FAILED_TEST_LINES: usize = 60;

/// Runs a command that tests, with its output shown; its failure repeats the output of the failed
/// tests, which is far above the end of the whole output.
pub fn run_tests(command: &mut Command) -> Result<(), Failure> {
    let shown = show(command);
    eprintln!("    {shown}");
    let cannot_run = |error: std::io::Error| format!("cannot run `{shown}`: {error}");
    let mut child = command.stdout(Stdio::piped()).spawn().map_err(cannot_run)?;
    let mut said = FailedTests::default();
    if let Some(output) = child.stdout.take() {
        for line in BufReader::new(output).split(b'\n') {
            let line = line.map_err(cannot_run)?;
            let line = String::from_utf8_lossy(&line);
            println!("{line}");
            said.hear(&line);
        }
    }
    let status = cost::wait(child).map_err(cannot_run)?;
    if status.success() { Ok(()) } else { Err(format!("`{shown}`: {status}\n{}", said.lines.join("\n"))) }
}

/// The output of the failed tests, taken from the whole output.
#[derive(Default)]
struct FailedTests {
    lines: Vec<String>,
    speaking: bool,
}

impl FailedTests {
    fn hear(&mut self, line: &str) {
        if line == "failures:" {
            self.speaking = true;
        } else if line.starts_with("test result:") {
            self.speaking = false;
        } else if self.speaking && !line.is_empty() && self.lines.len() < FAILED_TEST_LINES {
            self.lines.push(line.to_owned());
        }
    }
}

/// Runs a command with its standard error shown and returns its standard output; fails
/// without success.
pub fn run_for_output(command: &mut Command) -> Result<String, Failure> {
    let shown = show(command);
    eprintln!("    {shown}");
    let mut read = || {
        let mut child = command.stderr(Stdio::inherit()).stdout(Stdio::piped()).spawn()?;
        let mut said = String::new();
        if let Some(mut output) = child.stdout.take() {
            output.read_to_string(&mut said)?;
        }
        Ok((cost::wait(child)?, said))
    };
    let (status, said) = read().map_err(|error: std::io::Error| format!("cannot run `{shown}`: {error}"))?;
    if status.success() { Ok(said) } else { Err(format!("`{shown}`: {status}")) }
}

/// Standard output of a command, trimmed; `None` if it fails.
pub fn output(command: &mut Command) -> Option<String> {
    let output = command.stderr(Stdio::null()).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_owned())
}

/// Makes a rustup component available whose command is `cargo SUBCOMMAND`.
pub fn rustup_component(component: &str, subcommand: &str) -> Result<(), Failure> {
    let present = || output(cargo().args([subcommand, "--version"])).is_some();
    if present() {
        return Ok(());
    }
    // Asked again, the missing command says more than rustup's own failure.
    let added = run(Command::new("rustup").args(["component", "add", component]));
    if present() {
        return Ok(());
    }
    let reason = added.err().unwrap_or_else(|| "rustup reported no error".to_owned());
    Err(format!("`cargo {subcommand}` is missing and could not be added: {reason}"))
}

/// Makes a program of crates.io available as `cargo SUBCOMMAND`, at the version in use or newer.
/// `features` are those that its program needs beyond the package's default.
pub fn cargo_program(package: &str, subcommand: &str, features: &[&str]) -> Result<(), Failure> {
    let version = || output(cargo().args([subcommand, "--version"]));
    if version().is_none() {
        run(cargo().args(["install", package, "--locked", "--features", &features.join(",")]))?;
    }
    let version = version()
        .ok_or_else(|| format!("{package} is installed, but `cargo {subcommand} --version` does not start"))?;
    eprintln!("    {version}");
    Ok(())
}

/// Text of a command as one would type it, with the variables it sets.
fn show(command: &Command) -> String {
    let variables = command.get_envs().filter_map(|(key, value)| {
        let value = value?.to_string_lossy();
        let quote = if value.contains(' ') { "'" } else { "" };
        Some(format!("{}={quote}{value}{quote}", key.to_string_lossy()))
    });
    let program = Path::new(command.get_program());
    let program = program.file_name().unwrap_or(program.as_os_str()).to_string_lossy();
    let arguments = command.get_args().map(|argument| argument.to_string_lossy().into_owned());
    variables.chain([program.into_owned()]).chain(arguments).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_failing_command_is_named_with_its_variables() {
        let error = run(Command::new("false").arg("now").env("FLAGS", "-D warnings")).unwrap_err();
        assert!(error.starts_with("`FLAGS='-D warnings' false now`: "), "{error}");
        assert_eq!(run(&mut Command::new("true")), Ok(()));
    }

    #[test]
    fn a_command_that_does_not_exist_is_a_failure() {
        let error = run(&mut Command::new("ferrostep-no-such-program")).unwrap_err();
        assert!(error.starts_with("cannot run `ferrostep-no-such-program`: "), "{error}");
        assert_eq!(output(&mut Command::new("ferrostep-no-such-program")), None);
    }

    #[test]
    fn failed_tests_are_listed_at_the_end() {
        let output =
            "test a ... FAILED\n\nfailures:\n\n---- a stdout ----\nleft: 1\n\ntest result: FAILED. 0 passed\nmore";
        let error = run_tests(Command::new("sh").args(["-c", "printf \"$1\"; exit 1", "sh", output])).unwrap_err();
        assert!(error.ends_with("\n---- a stdout ----\nleft: 1"), "{error}");
        assert_eq!(run_tests(Command::new("echo").arg("test result: ok")), Ok(()));
    }

    #[test]
    fn output_is_returned_of_a_success_only() {
        assert_eq!(run_for_output(Command::new("echo").arg("two words")), Ok("two words\n".to_owned()));
        assert!(run_for_output(&mut Command::new("false")).is_err());
    }

    #[test]
    fn the_root_holds_the_workspace() {
        assert!(root().join("xtask/src/main.rs").is_file());
    }
}
