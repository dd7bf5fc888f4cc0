//! Refusals of the command and their texts.
#![allow(clippy::unwrap_used, missing_docs)]

use std::fs;
use std::net::TcpListener;
use std::path::PathBuf;
use std::process::{Command, Output};

const BUDDY: &str = "../../config/boards/prusa-buddy.toml";

fn run(words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_ferrostep-mainboard")).args(words).output().unwrap()
}

/// Checks that the command does not start and that its error contains all these texts.
fn refused(words: &[&str], said: &[&str]) {
    let output = run(words);
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{error}");
    for said in said {
        assert!(error.contains(said), "{said:?} is not in {error:?}");
    }
    assert!(!error.contains("panicked"), "{error}");
}

/// Writes a file of this test.
fn file(name: &str, text: &str) -> PathBuf {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    fs::write(&path, text).unwrap();
    path
}

#[test]
fn a_board_that_contradicts_its_chip_is_refused_with_its_key() {
    let text = fs::read_to_string(BUDDY).unwrap();
    let job = file("job.gcode", "M105\n");
    for (wrong, right, said) in [
        ("STM32F446ZE", "STM32F407VG", "package"),
        ("flash_kib = 2048", "flash_kib = 1024", "flash_kib"),
        ("adc = \"ADC1_IN11\"", "adc = \"ADC1_IN10\"", "thermistors.nozzle"),
        ("timer = \"TIM3_CH1\"", "timer = \"TIM3_CH4\"", "heaters.nozzle"),
    ] {
        let board = file(&format!("{said}.toml"), &text.replacen(right, wrong, 1));
        let board = board.to_str().unwrap();
        refused(
            &["print", "--board", board, "--profile", "../../config/profiles/prusa-mini.toml", job.to_str().unwrap()],
            &[board, said],
        );
    }
}

#[test]
fn a_missing_or_malformed_image_is_refused_by_name() {
    let job = file("image.gcode", "M105\n");
    let nothing = file("nothing.elf", "no image");
    let job = job.to_str().unwrap();
    refused(&["print", "--board", BUDDY, "--image", "/nowhere.elf", job], &["/nowhere.elf", "cargo xtask firmware"]);
    refused(&["print", "--board", BUDDY, "--image", nothing.to_str().unwrap(), job], &["nothing.elf"]);
    refused(&["print", "--board", "../boards/none.toml", job], &["none.toml"]);
}

#[test]
fn a_line_in_use_is_refused_by_name() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    refused(&["serve", "--board", BUDDY, "--tcp", &port], &[&port, "in use"]);
    let file = file("not-a-line", "");
    let file = file.to_str().unwrap();
    refused(&["serve", "--board", BUDDY, "--pty", file], &[file, "in use"]);
    refused(&["serve", "--board", BUDDY], &["--pty"]);
}

/// A signal that asks the program to end removes its link: the next terminal of that number would
/// be taken for a printer.
#[test]
fn a_signal_removes_the_line() {
    let link = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("printer");
    let Ok(images) = fs::canonicalize("../../target/images/prusa-buddy/ferrostep.elf") else {
        panic!("no image: build it with `cargo xtask firmware --board prusa-buddy`");
    };
    let mut serve = Command::new(env!("CARGO_BIN_EXE_ferrostep-mainboard"))
        .args(["serve", "--board", BUDDY, "--image", images.to_str().unwrap(), "--pty", link.to_str().unwrap()])
        .spawn()
        .unwrap();
    while !link.is_symlink() {
        assert!(serve.try_wait().unwrap().is_none(), "the program ended before its line existed");
        std::thread::yield_now();
    }
    let ended = Command::new("kill").arg(serve.id().to_string()).status().unwrap();
    assert!(ended.success());
    serve.wait().unwrap();
    assert!(!link.is_symlink());
}
