//! `ferrostep blackbox` at printers without one, and on files.

use std::process::{Command, Output, Stdio};

use ferrostep_testkit::program::{program, repository};
use ferrostep_testkit::served::printer::Printer;

fn black_box(arguments: &[&str]) -> Output {
    let mut command = Command::new(program());
    command.current_dir(repository()).arg("blackbox").args(arguments).stdin(Stdio::null()).output().unwrap()
}

#[track_caller]
fn refuses(arguments: &[&str], status: i32, expected: &str) {
    let output = black_box(arguments);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(status), "{said}");
    assert!(said.contains(expected), "{said}");
    assert!(output.stdout.is_empty());
}

#[test]
fn the_virtual_printer_has_none_and_says_so() {
    let printer = Printer::at_tcp(&["--speed", "max"]);
    let port = format!("tcp:{}", printer.address());
    refuses(&[&port], 1, "error: the printer does not send its black box: echo:line ");
    refuses(&[&port, "--json"], 1, ": this board has no black box");
    printer.end();
}

#[test]
fn a_file_that_is_none_is_refused() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let path = folder.path().join("box");
    let name = path.to_str().unwrap();
    for (bytes, status, expected) in [
        (&b"G28\n"[..], 2, "box: not a black box: expected a file that `ferrostep blackbox -o` has written"),
        (b"Recv: blackbox:0:RkJY\n", 2, "box: the black box breaks off: fetch it again"),
        (b"Recv: blackbox:1:RkJY\n", 2, "box: line 0 of the black box is missing: fetch it again"),
        (b"FBX1", 1, "box: the black box is cut short: fetch it again"),
        (b"FBX1abcdefgh", 1, "box: the black box is damaged: its checksum is "),
    ] {
        std::fs::write(&path, bytes).unwrap();
        refuses(&[name], status, expected);
    }
    refuses(&[name, "-o", name], 2, "this is the black box to be read: choose another name for the output");
    refuses(&["/nowhere"], 2, "/nowhere: ");
    refuses(&["tcp:localhost"], 2, "expected tcp:HOST:PORT");
}
