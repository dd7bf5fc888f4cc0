//! The answers to a host, and the commands that act before their turn.

use std::process::Command;
use std::time::Instant;

use ferrostep_testkit::host_side::numbered;
use ferrostep_testkit::program::{program, repository};
use ferrostep_testkit::served::printer::{Host, Printer};
use ferrostep_testkit::served::{part, print_of_lines};

fn print(host: &mut Host, lines: &[String]) {
    host.say_numbered("M110 N0");
    for line in lines {
        let said = host.say_numbered(line);
        assert!(!said.iter().any(|said| said.starts_with("Resend") || said.starts_with("Error")), "{line}: {said:?}");
    }
    host.say_numbered("M400");
}

#[test]
fn a_print_makes_the_steps_of_print_each_at_its_time() {
    let lines = part();
    let expected = print_of_lines(&lines);
    for speed in ["max", "1000"] {
        let printer = Printer::at_pty(&["--speed", speed]);
        let mut host = printer.connect();
        print(&mut host, &lines);
        assert_eq!(host.figure("step_digest"), expected["step_digest"], "{speed}");
        let done = printer.end();
        for key in [
            "step_digest",
            "order_digest",
            "motor_steps",
            "moves",
            "filament_mm",
            "position_mm",
            "merged_moves",
            "motion_time_s",
            "underruns",
            "starvation_flushes",
            "clamped_moves",
            "unknown_commands",
        ] {
            assert_eq!(done[key], expected[key], "{key} at speed {speed}");
        }
        // The first line sets the number; two more follow the print.
        assert_eq!(done["lines"], lines.len() + 3);
    }
}

#[test]
fn the_next_host_finds_the_printer_as_it_was_left() {
    for (printer, is_terminal) in
        [(Printer::at_tcp(&["--speed", "max"]), false), (Printer::at_pty(&["--speed", "max"]), true)]
    {
        let mut first = printer.connect();
        // A terminal keeps the lines from before it is opened; over TCP a host hears them that
        // is there in time.
        let said = first.say("G28");
        assert!(said.contains(&"start".to_owned()) || !is_terminal, "{said:?}");
        first.say("M140 S60");
        first.say("G1 X55 F6000");
        // Half a line is not the beginning of the next host's. A terminal that is opened again at
        // once cannot know.
        if !is_terminal {
            first.send("G1 X12");
        }
        drop(first);
        let mut next = printer.connect();
        let said = next.say("M114");
        assert!(said.iter().any(|line| line.starts_with("X:55.00 ")), "{said:?}");
        assert!(!said.iter().any(|line| line == "start"), "a printer that keeps its power does not start again");
        assert!(next.say("M105")[0].contains("/60.00"));
        drop(next);
        assert_eq!(printer.end()["position_mm"]["x"], 55.0);
    }
}

/// An emergency stop in real time ends a wait for heat that takes minutes, longer than the host's
/// patience, and the heaters are off.
#[test]
fn commands_that_do_not_wait_their_turn_act_at_once() {
    let printer = Printer::at_pty(&[]);
    let mut host = printer.connect();
    host.say("M302 P1");
    host.send("M109 S200\n");
    // It waits now.
    host.hear_until(|line| line.starts_with(" T:"));
    host.send("M108\n");
    host.hear_until(|line| line == "ok");
    host.hear_until(|line| line == "ok");
    host.send("M109 S200\n");
    host.hear_until(|line| line.starts_with(" T:"));
    host.send("M112\n");
    host.hear_until(|line| line == "Error:Printer halted. kill() called!");
    host.hear_until(|line| line == "ok");
    host.hear_until(|line| line == "ok");
    host.say("M999");
    assert!(host.say("M105")[0].contains("/0.00 B"));
    // A minute and a half of motion, and a report every second.
    host.say("M155 S1");
    host.send("G1 E900 F600\nG1 X1\n");
    host.hear_until(|line| line == "ok");
    host.hear_until(|line| line.starts_with(" T:"));
    host.hear_until(|line| line.starts_with(" T:"));
    host.send("M410\n");
    host.hear_until(|line| line == "ok");
    host.hear_until(|line| line == "ok");
    let pushed: f64 = printer.end()["position_mm"]["e"].as_f64().unwrap();
    assert!(pushed > 0.5 && pushed < 800.0, "{pushed} mm");
}

#[test]
fn a_thermistor_that_breaks_halts_the_printer() {
    let printer = Printer::at_pty(&["--speed", "max", "--fault", "nozzle-open@30"]);
    let mut host = printer.connect();
    host.send("M104 S200\nG4 S20\n");
    host.hear_until(|line| line == "ok");
    host.hear_until(|line| line == "ok");
    host.send("G4 S3600\n");
    let said = host.hear_until(|line| line == "Error:Printer halted. kill() called!");
    assert!(said.iter().any(|line| line.starts_with("Error:") && line.contains("Heater_ID: E0")), "{said:#?}");
    host.hear_until(|line| line == "ok");
    assert_eq!(printer.end()["lines"], 3);
}

/// Time leaps at `--speed max` while a print works, but not while a person is asked to act:
/// between two signs of life pass the two seconds of a clock on the wall, and heaters that rest
/// after a minute stay on.
#[test]
fn time_does_not_leap_while_a_person_is_waited_for() {
    let printer = Printer::at_pty(&["--speed", "max"]);
    let mut host = printer.connect();
    host.say("G28");
    host.say("M190 S50");
    host.say("M86 S60");
    for pause in ["M0", "M600"] {
        host.send(&format!("{pause}\n"));
        host.hear_until(|line| line == "//action:prompt_show");
        let is_sign = |line: &str| line == "echo:busy: paused for user";
        let mut said = host.hear_until(is_sign);
        let first_sign = Instant::now();
        said.extend(host.hear_until(is_sign));
        // A busy computer may be slower.
        assert!(first_sign.elapsed().as_secs_f64() > 1.5, "{pause}: {said:?}");
        host.send("M108\n");
        said.extend(host.hear_until(|line| line == "ok"));
        said.extend(host.hear_until(|line| line == "ok"));
        assert!(said.iter().any(|line| line == "//action:resumed"), "{pause}: {said:?}");
        assert!(!said.iter().any(|line| line.contains("(M86)")), "{pause}: {said:?}");
        assert!(host.say("M105")[0].contains("/50.00 @"), "{pause}");
    }
    printer.end();
}

/// The virtual time that passed is the wall clock's times the factor.
#[test]
fn time_passes_at_its_speed() {
    let printer = Printer::at_pty(&["--speed", "50"]);
    let mut host = printer.connect();
    let begun = Instant::now();
    host.say("G4 S100");
    let took_s = begun.elapsed().as_secs_f64();
    // Never faster; a busy computer may be slower, but not so slow that the host
    // loses its patience.
    assert!(took_s > 1.9, "{took_s}");
}

/// M114 counts the steps that a motor has made, even in the middle of a move of ten seconds.
#[test]
fn motors_are_counted_where_they_are() {
    let printer = Printer::at_pty(&["--speed", "1"]);
    let mut host = printer.connect();
    host.say("M155 S1");
    host.say("G28");
    host.say("G1 X100 F600");
    let mut steps = [0; 3];
    for (at, steps) in steps.iter_mut().enumerate() {
        if at > 0 {
            host.hear_until(|line| line.starts_with(" T:"));
            host.hear_until(|line| line.starts_with(" T:"));
        }
        let said = host.say("M114");
        let said = said.iter().find(|line| line.starts_with("X:100.00 ")).unwrap_or_else(|| panic!("{said:?}"));
        let (_, count) = said.split_once(" Count X:").unwrap();
        *steps = count.split(' ').next().unwrap().parse::<i64>().unwrap();
    }
    // 80 steps a mm at 10 mm/s; between the reports passes a second at least.
    assert!(steps.is_sorted() && steps[2] < 8_000 && steps[2] - steps[0] > 1_000, "{steps:?}");
    host.say("M410");
    printer.end();
}

#[test]
fn damaged_lines_are_asked_for_again() {
    let lines = part();
    let printer = Printer::at_pty(&["--speed", "max", "--fault", "flip-line:10%@1"]);
    let mut host = printer.connect();
    host.say("G4 S2");
    let sent: Vec<String> = std::iter::once(&"M110 N0".to_owned())
        .chain(&lines)
        .chain([&"M400".to_owned()])
        .enumerate()
        .map(|(number, text)| numbered(number as i64, text))
        .collect();
    let (mut next, mut resends) = (0, 0);
    while next < sent.len() {
        let said = host.say(&sent[next]);
        let resend = said.iter().find_map(|line| line.strip_prefix("Resend: ")?.parse::<usize>().ok());
        resends += usize::from(resend.is_some());
        next = resend.unwrap_or(next + 1);
    }
    assert!(resends > sent.len() / 20, "{resends}");
    let done = printer.end();
    let expected = print_of_lines(&lines);
    assert_eq!(done["step_digest"], expected["step_digest"]);
    assert_eq!(done["motor_steps"], expected["motor_steps"]);
}

#[test]
fn what_cannot_be_served_is_refused() {
    let printer = Printer::at_pty(&[]);
    let taken = printer.port().to_str().unwrap();
    for (arguments, expected) in [
        (vec!["--pty", taken], "is in use"),
        (vec!["--pty", "/no/such/folder/port"], "/no/such/folder/port cannot be created"),
        (vec![], "--pty"),
        (vec!["--tcp", "0", "--profile", "none"], "none"),
        (vec!["--tcp", "0", "--speed", "0"], "write a number above 0, or max"),
        (vec!["--tcp", "0", "--fault", "nozzle-gone"], "unknown fault, expected nozzle-HOW"),
        (vec!["--tcp", "0", "--fault", "flip:2"], "write a rate from 0% to 100%"),
        (vec!["--tcp", "0", "--board", "bench", "--profile", "corexy"], "cannot be used with"),
        (vec!["--web", "127.0.0.1:0", "--board", "bench"], "(`ferrostep serve --web --port tcp:127.0.0.1:5000`)"),
        (vec!["--web", "127.0.0.1:0", "--board", "bench", "--port", "tcp:localhost:1"], "cannot be used with"),
    ] {
        let output = Command::new(program()).current_dir(repository()).arg("serve").args(&arguments).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(said.contains(expected), "{arguments:?}: {said}");
        assert!(output.stdout.is_empty());
    }
}
