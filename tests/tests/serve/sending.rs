//! `ferrostep send` at the served printer.

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use ferrostep_testkit::program::{program, repository, send_signal};
use ferrostep_testkit::served::printer::Printer;
use ferrostep_testkit::served::{part, print_of_cube, print_of_lines};
use tempfile::TempDir;

const CUBE: &str = "examples/cube.gcode";

fn folder() -> TempDir {
    tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap()
}

fn file(folder: &TempDir, text: &str) -> PathBuf {
    let path = folder.path().join("job.gcode");
    std::fs::write(&path, text).unwrap();
    path
}

fn send(file: &Path, port: &str) -> Output {
    let mut command = Command::new(program());
    command
        .current_dir(repository())
        .arg("send")
        .arg(file)
        .args(["--port", port])
        .stdin(Stdio::null())
        .output()
        .unwrap()
}

#[track_caller]
fn says(output: &Output, status: i32, expected: &str) {
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(status), "{said}");
    assert!(said.contains(expected), "{said}");
    assert!(output.stdout.is_empty());
}

#[test]
fn gcode_is_sent_and_printed_over_a_bad_line() {
    let printer = Printer::at_pty(&["--speed", "max", "--fault", "flip-line:5%@1"]);
    let output = send(Path::new(CUBE), printer.port().to_str().unwrap());
    says(&output, 0, "printed: 6683 lines sent, ");
    assert!(!String::from_utf8_lossy(&output.stderr).contains(" 0 of them again"));
    let done = printer.end();
    for key in ["step_digest", "order_digest", "motor_steps", "position_mm", "underruns"] {
        assert_eq!(done[key], print_of_cube()[key], "{key}");
    }
}

/// A prepared job comes in frames (M790), over a good line and over a bad one.
#[test]
fn a_prepared_job_is_sent_and_makes_the_steps_of_print() {
    let folder = folder();
    let lines = part();
    let expected = print_of_lines(&lines);
    let (gcode, job) = (file(&folder, &lines.join("\n")), folder.path().join("job.gpre"));
    let prepared = Command::new(program()).arg("preprocess").arg(gcode).arg("-o").arg(&job).output().unwrap();
    assert!(prepared.status.success(), "{prepared:?}");
    for faults in [&[][..], &["--fault", "flip:0.2%@1", "--fault", "drop:0.1%@1"]] {
        let printer = Printer::at_pty(&[&["--speed", "max"], faults].concat());
        let mut host = printer.connect();
        host.say("G4 S2");
        says(&send(&job, printer.port().to_str().unwrap()), 0, "printed");
        // A frame without a job is answered by the end of the last job, and its text is not a line.
        host.send("~M112\n");
        let said = host.hear_until(|line| line.starts_with("gpre:done "));
        assert!(!said.iter().any(|line| line.contains("halted")), "{said:?}");
        let done = printer.end();
        for key in ["order_digest", "motor_steps", "position_mm", "filament_mm", "underruns"] {
            assert_eq!(done[key], expected[key], "{key} with {faults:?}");
        }
    }
}

/// A file comes over a bad line, with every line's checksum: the file on the card then prints as
/// the original does.
#[test]
fn gcode_is_written_to_the_card() {
    let folder = folder();
    let lines = part();
    let expected = print_of_lines(&lines);
    let gcode = file(&folder, &lines.join("\n"));
    let image = crate::serve::card::image(&folder);
    let card = image.to_str().unwrap();
    let to_card = |printer: &Printer, file: &Path, name: &str| {
        let mut send = Command::new(program());
        send.arg("send").arg(file).args(["--to-card", name, "--port"]).arg(printer.port());
        send.stdin(Stdio::null()).output().unwrap()
    };
    let printer = Printer::at_pty(&["--speed", "max", "--card", card, "--fault", "flip-line:3%"]);
    let output = to_card(&printer, &gcode, "PART.GCO");
    says(&output, 0, &format!("written to the card as PART.GCO: {} lines sent, ", lines.len()));
    assert!(!String::from_utf8_lossy(&output.stderr).contains(" 0 of them again"));
    assert_eq!(printer.end()["moves"], 0);

    let printer = Printer::at_pty(&["--speed", "max", "--card", card]);
    says(&to_card(&printer, &gcode, "a name that is long.gcode"), 2, "--to-card: write a name of 8 characters");
    says(&to_card(&printer, &gcode, "longername.gcode"), 1, "the printer refuses M28 longername.gcode: open failed");
    let bad = file(&folder, "G28\nM112\nG1 X5\n");
    let output = to_card(&printer, &bad, "BAD.GCO");
    says(&output, 1, "after line 1 of the file: the next command is M112");
    says(&output, 1, "BAD.GCO was not complete and has been deleted from the card");
    let mut host = printer.connect();
    let listed = host.say("M20");
    assert!(!listed.iter().any(|line| line.starts_with("BAD.GCO")), "{listed:?}");
    host.say("M32 !PART.GCO#");
    host.hear_until(|line| line == "Done printing file");
    assert_eq!(host.figure("step_digest"), expected["step_digest"]);
    printer.end();
}

#[test]
fn gcode_is_sent_over_tcp() {
    let folder = folder();
    let printer = Printer::at_tcp(&["--speed", "max"]);
    let output =
        send(&file(&folder, "G28\nG1 X50 F6000 ; there\nM9999\nG1 X\n"), &format!("tcp:{}", printer.address()));
    says(&output, 0, "echo:Unknown command: \"M9999\"");
    assert_eq!(printer.end()["position_mm"]["x"], 50.0);
}

/// Line ends, numbers and M110 of a file are read as `print` reads them, and never by the
/// printer's protocol.
#[test]
fn a_file_is_sent_as_it_is_printed() {
    let folder = folder();
    for text in [
        "M302 S0\nG28\nM110 N0\nG1 X20 Y20 F3000\nG1 X30\nG1 X40\n",
        "M110 N1000\nG28\nM110 N4\nG1 X20 Y20 F3000\nG1 X30\n",
        "G28\rG1 X20 Y20 F3000\rG1 X30\rG1 X40\r",
        "G28\r\n G1 X20 Y20 F3000\r G1 X30\n",
        "N10 G28\nN20 G1 X20 F3000\nN30 G1 X30\n",
    ] {
        let printed = print_of_lines(&[text.to_owned()]);
        let printer = Printer::at_tcp(&["--speed", "max"]);
        let output = send(&file(&folder, text), &format!("tcp:{}", printer.address()));
        says(&output, 0, ", 0 of them again");
        let done = printer.end();
        for key in ["order_digest", "motor_steps", "position_mm"] {
            assert_eq!(done[key], printed[key], "{key} of {text:?}");
        }
    }
}

/// The rest of the file is not sent after a thermistor breaks, or the file itself stops everything.
#[test]
fn a_printer_that_halts_ends_the_job() {
    let folder = folder();
    let halted = "error: the board has halted: Error:Printer halted. kill() called!";
    let reported = "error: after line 1 of the file: the printer reports: Error:";
    for (text, fault, expected, then) in [
        ("G28\nM112\nG1 X50 F6000\n", "bed-open@9999", halted, ""),
        (
            "M104 S200\nG4 S60\nG1 X50 F6000\n",
            "nozzle-open@20",
            reported,
            "the printer has halted, which switches motors and heaters off",
        ),
    ] {
        let printer = Printer::at_pty(&["--speed", "max", "--fault", fault]);
        let output = send(&file(&folder, text), printer.port().to_str().unwrap());
        says(&output, 1, expected);
        says(&output, 1, then);
        assert_eq!(printer.end()["position_mm"]["x"], 0.0);
    }
}

/// Starts the command and sends it Ctrl-C's signal as soon as its messages have this text.
fn interrupted(command: &mut Command, text: &str) -> Output {
    let mut sender = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut messages = BufReader::new(sender.stderr.take().unwrap());
    let mut said = String::new();
    while !said.contains(text) {
        assert!(messages.read_line(&mut said).unwrap() > 0, "{said}");
    }
    send_signal("INT", sender.id());
    let mut output = sender.wait_with_output().unwrap();
    messages.read_to_end(&mut output.stderr).unwrap();
    output
}

/// The heaters are off, and the long move has ended.
fn is_cold_and_still(printer: Printer) {
    let mut host = printer.connect();
    let heat = host.say("M105").join(" ");
    assert!(heat.contains("/0.00 B:") && heat.contains("/0.00 @"), "{heat}");
    // The wait would be longer than this host's patience if the move continued.
    host.say("M400");
    let pushed = printer.end()["position_mm"]["e"].as_f64().unwrap();
    assert!(pushed < 500.0, "{pushed}");
}

/// The program cannot ask without a terminal.
#[test]
fn ctrl_c_ends_waits_motion_and_heat() {
    let folder = folder();
    let printer = Printer::at_pty(&[]);
    let job = file(&folder, "M302 P1\nM140 S60\nG1 E900 F300\nM109 S200 Q1\nG1 X1 F600\n");
    let mut command = Command::new(program());
    command.arg("send").arg(job).args(["--port", printer.port().to_str().unwrap()]);
    // A word without effect is reported as its line begins: the printer waits for heat, after a
    // move of three minutes.
    let output = interrupted(&mut command, "M109 S200 Q1");
    says(&output, 1, "error: after line 3 of the file: stopped by Ctrl-C");
    says(
        &output,
        1,
        "the printer has ended: waits (M108), motion (M410), the nozzle's heater (M104 S0), the bed's heater (M140 S0)",
    );
    is_cold_and_still(printer);
}

/// The same for a prepared job: the transfer is aborted, and then the heaters are switched off.
#[test]
fn ctrl_c_ends_a_prepared_job() {
    let folder = folder();
    let text = "M302 P1\nM140 S60\nM118 begun\nG1 E900 F300\nG1 E1000 F300\nG1 X1 F600\n";
    let (gcode, job) = (file(&folder, text), folder.path().join("job.gpre"));
    let prepared = Command::new(program()).arg("preprocess").arg(&gcode).arg("-o").arg(&job).output().unwrap();
    assert!(prepared.status.success(), "{prepared:?}");
    let printer = Printer::at_pty(&[]);
    let mut command = Command::new(program());
    command.arg("send").arg(job).args(["--port", printer.port().to_str().unwrap()]);
    // The message comes as the job begins, before the long move.
    let output = interrupted(&mut command, "begun");
    says(&output, 1, "error: stopped by Ctrl-C");
    says(&output, 1, "the bed's heater (M140 S0)");
    is_cold_and_still(printer);
}

#[test]
fn what_is_no_printer_is_refused_and_left_as_it_is() {
    let folder = folder();
    let job = file(&folder, "G28\n");
    let letter = folder.path().join("letter.txt");
    std::fs::write(&letter, "Dear printer").unwrap();
    for (port, expected) in [
        (letter.to_str().unwrap(), "this is an ordinary file, not a serial port: `ferrostep ports` lists the ports"),
        (folder.path().to_str().unwrap(), "this is a folder"),
        ("/dev/no-such-port", "/dev/no-such-port: there is no such port: `ferrostep ports` lists the ports"),
        ("/dev/null", "/dev/null: this device is not a serial port: `ferrostep ports` lists the ports"),
        ("tcp:localhost", "expected tcp:HOST:PORT"),
        ("tcp:127.0.0.1:1", "no connection: "),
    ] {
        says(&send(&job, port), 2, expected);
    }
    assert_eq!(std::fs::read_to_string(letter).unwrap(), "Dear printer");
}

#[test]
fn ports_are_listed() {
    let output = Command::new(program()).arg("ports").output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let listed = String::from_utf8(output.stdout).unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(listed.is_empty(), said.contains("no serial port"), "{listed}{said}");
}
