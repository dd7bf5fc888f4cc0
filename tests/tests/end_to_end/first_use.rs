//! A person who runs the command for the first time, without arguments.

use std::process::Command;

use super::command::{ferrostep, program};
use ferrostep_testkit::program::scratch;

#[test]
fn without_arguments_the_command_says_what_to_try() {
    let guide = ferrostep([""; 0]);
    assert_eq!((guide.status, guide.stderr.as_str()), (Some(0), ""));
    assert!(guide.stdout.contains("    ferrostep show FILE.gcode\n"), "{}", guide.stdout);

    let folder = scratch();
    for name in ["part.gcode", "printer.cfg"] {
        std::fs::write(folder.path().join(name), "").unwrap();
    }
    let output = Command::new(program()).current_dir(folder.path()).output().unwrap();
    let guide = String::from_utf8(output.stdout).unwrap();
    assert!(guide.contains("show part.gcode\n") && guide.contains("import printer.cfg -o my.toml\n"), "{guide}");
}
