//! The emulator that runs the firmware's images.

use std::io::Read;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::steps::Failure;
use crate::system;

/// The program, and Debian's package that holds it.
pub const PROGRAM: &str = "qemu-system-arm";

/// Finds the emulator, or installs it on Debian.
pub fn find() -> Result<(), Failure> {
    if let Some(version) = version() {
        eprintln!("    {version}");
        return Ok(());
    }
    if !system::can_install_debian_packages() {
        return Err(format!(
            "{PROGRAM} is missing, which runs the firmware's image. As root on Debian it would be installed; install \
             it by hand (version 7.2 is known to work)"
        ));
    }
    system::install_debian_packages(&[PROGRAM])?;
    let version = version().ok_or_else(|| format!("{PROGRAM} is installed, but does not start"))?;
    eprintln!("    {version}");
    Ok(())
}

/// The first line of what it says about itself.
fn version() -> Option<String> {
    let text = system::output(Command::new(PROGRAM).arg("--version"))?;
    text.lines().next().map(str::to_owned)
}

/// The emulator with a clock of one nanosecond an instruction and timers at 1 GHz: they count instructions. The image, and
/// what semihosting is to do, are still to be named.
pub fn counting() -> Command {
    let mut command = Command::new(PROGRAM);
    command.args(["-machine", "netduinoplus2", "-icount", "shift=0", "-display", "none", "-monitor", "none"]);
    command.args(["-serial", "none"]);
    command
}

/// Standard output of a command that must end by itself within a time, and in success.
pub fn output_of(command: &mut Command, longest: Duration) -> Result<String, Failure> {
    let mut child = command
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()
        .map_err(|error| format!("cannot run {:?}: {error}", command.get_program()))?;
    let reader = child.stdout.take().map(|mut output| {
        std::thread::spawn(move || {
            let mut text = String::new();
            output.read_to_string(&mut text).map(|_| text)
        })
    });
    let ended = wait(&mut child, longest);
    if ended.is_err() {
        // It may have ended just now; either way it is gone afterwards.
        let _ = child.kill();
        let _ = child.wait();
    }
    let text = match reader.map(std::thread::JoinHandle::join) {
        Some(Ok(Ok(text))) => text,
        _ => return Err("the output of the image cannot be read".to_owned()),
    };
    ended.map(|()| text.clone()).map_err(|reason| format!("the image {reason}; its output was: {text}"))
}

fn wait(child: &mut Child, longest: Duration) -> Result<(), Failure> {
    let start = Instant::now();
    loop {
        match child.try_wait() {
            Ok(Some(status)) if status.success() => return Ok(()),
            Ok(Some(status)) => return Err(format!("failed: {status}")),
            Ok(None) if start.elapsed() < longest => std::thread::sleep(Duration::from_millis(10)),
            Ok(None) => return Err(format!("did not end within {} s", longest.as_secs())),
            Err(error) => return Err(error.to_string()),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn an_image_must_end_by_itself_and_in_success() {
        assert_eq!(output_of(Command::new("echo").arg("{}"), Duration::from_secs(10)).unwrap(), "{}\n");
        assert!(output_of(&mut Command::new("false"), Duration::from_secs(10)).unwrap_err().contains("failed"));
        let error = output_of(Command::new("sleep").arg("60"), Duration::from_millis(50)).unwrap_err();
        assert!(error.contains("did not end"), "{error}");
    }
}
