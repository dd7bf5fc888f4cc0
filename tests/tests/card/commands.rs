//! M20 to M34, M524 and M928, as OctoPrint 1.11 and Pronterface send them and read the answers.

use ferrostep_testkit::host_side::numbered;
use ferrostep_virtual_board::VirtualCard;

use crate::card::setup::{Setup, image, nothing, profile};

fn setup() -> Setup {
    Setup::new(profile("cartesian"), image())
}

fn said(setup: &Setup, lines: &[&str]) -> Vec<String> {
    setup.say(lines, &mut nothing)
}

#[test]
fn without_a_card_every_command_says_so() {
    let setup = setup();
    setup.card.with_slot(|slot| slot.pull());
    assert_eq!(said(&setup, &["M21"]), ["echo:No SD card", "ok"]);
    assert_eq!(said(&setup, &["M20"]), ["echo:No media", "ok"]);
    assert_eq!(
        said(&setup, &["M23 A.GCO"]),
        ["open failed, File: A.GCO.", "echo:card: the card is not mounted: M21 mounts it", "ok"]
    );
    assert_eq!(said(&setup, &["M27"]), ["Not SD printing", "ok"]);
    assert_eq!(said(&setup, &["M24"]), ["echo:card: no file is selected: M23 selects one", "ok"]);
    assert_eq!(said(&setup, &["M29"]), ["ok"]);
    assert_eq!(said(&setup, &["M524"]), ["ok"]);
    assert_eq!(said(&setup, &["M34"]), ["ok"]);
    let blank = Setup::new(profile("cartesian"), vec![0; 1 << 20]);
    assert_eq!(
        said(&blank, &["M21"]),
        ["Warning:volume.init failed", "echo:card: no FAT16 or FAT32 volume is on it: format it with FAT32", "ok"]
    );
}

/// OctoPrint: `M21`, `M20` (with L where EXTENDED_M20 is reported), `M23`, `M24`, then
/// `M27` or its report.
#[test]
fn octoprint_lists_and_prints() {
    let setup = setup();
    let caps = said(&setup, &["M115"]);
    for cap in ["SDCARD:1", "SD_WRITE:1", "AUTOREPORT_SD_STATUS:1", "LONG_FILENAME:1", "EXTENDED_M20:1", "LFN_WRITE:0"]
    {
        assert!(caps.contains(&format!("Cap:{cap}")), "{cap}");
    }
    assert_eq!(said(&setup, &["N1 M21*17"]), ["echo:SD card ok", "ok"]);
    let list = said(&setup, &["M20 L T"]);
    assert_eq!(
        (list.first().unwrap().as_str(), &list[list.len() - 2..]),
        ("Begin file list", &["End file list".to_owned(), "ok".to_owned()][..])
    );
    // OctoPrint's fields of a line: name, size, time, long name.
    let entries: Vec<(&str, u32, &str, &str)> = list[1..list.len() - 2]
        .iter()
        .map(|line| {
            let mut parts = line.splitn(4, ' ');
            let mut next = || parts.next().unwrap();
            (next(), next().parse().unwrap(), next(), next())
        })
        .collect();
    assert_eq!(entries.len(), 49);
    assert!(entries.contains(&("ACUBEW~1.GCO", 7092, "0x585D645C", "A cube with a long name.gcode")));
    assert!(entries.iter().all(|(_, _, time, _)| time.len() == 10 && time.starts_with("0x")));
    let plain = said(&setup, &["M20"]);
    assert!(plain.contains(&"PARTSO~1/LEFTSI~1/BRACKE~1.GCO 7092".to_owned()), "{plain:?}");

    let selected = said(&setup, &["M23 PARTS/DEEP/TWO.GCO"]);
    assert_eq!(
        selected,
        ["echo:Now fresh file: PARTS/DEEP/TWO.GCO", "File opened: TWO.GCO Size: 1000", "File selected", "ok"]
    );
}

#[test]
fn a_print_is_reported_paused_and_ended() {
    let setup = setup();
    setup.put("P.GCO", b"G28\nG1 X10 F6000\nM105\nG1 X50\nG1 X90\nM104 S0\nG1 X50\nG1 X10\n");
    let mut turn = 0;
    let said = setup.say(&["M21", "M23 P.GCO", "M27", "M27 C", "M24"], &mut |_, _| {
        turn += 1;
        let lines: &[&str] = match turn {
            3 => &["M27", "M105", "G1 X5", "M23 A.GCO", "M30 P.GCO", "M28 X.GCO", "M790 S100", "M220 S90"],
            4 => &["M25", "M27"],
            8 => &["M24"],
            _ => &[],
        };
        lines.iter().map(|line| (*line).to_owned()).collect()
    });
    let refused = "the memory card is printing, and this line would disturb it: pause it first (M25)";
    let in_use = "the memory card is in use: M524 ends a print from it, M29 ends an upload";
    let expected = [
        "echo:SD card ok",
        "ok",
        "echo:Now fresh file: P.GCO",
        "File opened: P.GCO Size: 58",
        "File selected",
        "ok",
        "SD printing byte 0/58",
        "ok",
        "Current file: P.GCO P.GCO",
        "ok",
        "ok",
        // The print; G28 takes a while and prints the position.
        "echo:busy: processing",
        "echo:busy: processing",
        "X:0.00 Y:0.00 Z:0.00 E:0.00 Count X:0 Y:0 Z:0",
        "SD printing byte 17/58",
        "ok",
    ];
    assert_eq!(said[..expected.len()], expected, "{said:?}");
    let rest = &said[expected.len()..];
    assert!(rest[0].starts_with("ok T:"), "{rest:?}");
    assert!(rest.iter().filter(|line| line.ends_with(refused)).count() == 2, "{rest:?}");
    assert_eq!(rest.iter().filter(|line| line.ends_with(in_use)).count(), 3, "{rest:?}");
    let position = |text: &str| {
        rest.iter().position(|line| line.starts_with(text)).unwrap_or_else(|| panic!("{text} in {rest:?}"))
    };
    assert!(position("//action:paused") < position("//action:resumed"));
    assert!(position("//action:resumed") < position("Done printing file"));
    // The file's M105 has no `ok`: 7 + 2 + 1 lines of the host have one each.
    assert_eq!(rest.iter().filter(|line| line.starts_with("ok")).count(), 10, "{rest:?}");
    assert!(rest.iter().any(|line| line.starts_with(" T:")), "{rest:?}");
}

#[test]
fn binary_gcode_is_refused_by_name() {
    let setup = setup();
    setup.put("CUBE.BGC", b"GCDE");
    let said = setup.say(&["M21", "M32 !cube.bgc#"], &mut nothing);
    let expected = "echo:card: binary G-code is not printed from a card: let the slicer write text, or use ferrostep send or \
                    preprocess";
    assert_eq!(said[2..], ["open failed, File: cube.bgc.", expected, "ok"]);
}

#[test]
fn a_refused_line_pauses_and_is_tried_again() {
    let setup = setup();
    setup.put("P.GCO", b"G28\nM302 S170\nM302 P0\nG1 X10 F6000\nG1 X20 E1\nG1 X30\n");
    let mut turn = 0;
    let said = setup.say(&["M21", "M32 !P.GCO#"], &mut |_, _| {
        turn += 1;
        let lines: &[&str] = match turn {
            20 => &["M27", "M24"],
            40 => &["M302 P1", "M24"],
            _ => &[],
        };
        lines.iter().map(|line| (*line).to_owned()).collect()
    });
    let tries = said.iter().filter(|line| line.starts_with("echo:line 5: ")).count();
    assert_eq!(tries, 2, "{said:?}");
    assert!(said.contains(&"SD printing byte 35/52".to_owned()), "{said:?}");
    assert_eq!(said.last().unwrap(), "Done printing file", "{said:?}");
}

/// A print that stops, at a line that is refused or because the card is missing, pauses as by M25:
/// the nozzle goes aside, heaters keep their targets, and moves that a person makes by hand
/// meanwhile change nothing.
#[test]
fn a_print_that_stops_parks_the_head_and_keeps_the_heat() {
    let text = b"G28\nM140 S50\nG1 X20 Y30 Z5 F6000\nG1 X40 E1\nG1 Y50\n";
    for pulls in [false, true] {
        let setup = setup();
        let mut printer = setup.printer();
        // Long enough to be read in several parts.
        let filler = "; a comment of no concern\n".repeat(100);
        let file = [filler.as_bytes(), text, filler.as_bytes()].concat();
        setup.put("P.GCO", &file);
        if pulls {
            setup.converse(&mut printer, &["M302 P1"], &mut nothing);
        }
        let (mut turn, mut paused_at, mut is_pulled) = (0, None, false);
        let said = setup.converse(&mut printer, &["M21", "M32 !P.GCO#"], &mut |card, progress| {
            turn += 1;
            let is_moving = progress.is_some_and(|(position, _)| position as usize > filler.len() + text.len() - 20);
            if pulls && !is_pulled && is_moving {
                is_pulled = true;
                card.with_slot(VirtualCard::pull);
            }
            if paused_at.is_none() && setup.has_said("//action:paused") {
                paused_at = Some(turn);
            }
            let lines: &[&str] = match paused_at.map(|at| turn - at) {
                Some(3) => &["M114", "M105", "G91", "G1 X7 Z3 F600", "G90"],
                Some(6) => {
                    card.with_slot(VirtualCard::insert);
                    &["M302 P1", "M24"]
                }
                _ => &[],
            };
            lines.iter().map(|line| (*line).to_owned()).collect()
        });
        assert_eq!(said.last().unwrap(), "Done printing file", "{said:?}");
        // The first move belongs to homing.
        let place = said.iter().filter(|line| line.starts_with("X:")).nth(1).unwrap_or_else(|| panic!("{said:?}"));
        assert!(place.starts_with("X:10.00 Y:190.00 Z:25.00"), "{pulls}: {place}");
        let heat = said.iter().find(|line| line.starts_with("ok T:")).unwrap();
        assert!(heat.contains("/50.00 @"), "{pulls}: {heat}");
        assert!(said.contains(&"//action:resumed".to_owned()), "{pulls}: {said:?}");
        let end = setup.converse(&mut printer, &["M114"], &mut nothing);
        assert!(end[0].starts_with("X:40.00 Y:50.00 Z:5.00 E:1.00"), "{pulls}: {end:?}");
    }
}

#[test]
fn m524_ends_a_print_and_switches_off() {
    let setup = setup();
    setup.put("P.GCO", b"G28\nM140 S60\nG1 X10 F6000\nG1 X50\nG1 X90\nG1 X10\n");
    let mut turn = 0;
    let mut printer = setup.printer();
    let said = setup.converse(&mut printer, &["M21", "M23 P.GCO", "M24", "M105", "M27", "M31"], &mut |_, _| {
        turn += 1;
        if turn == 5 { vec!["M524".to_owned()] } else { Vec::new() }
    });
    assert!(said.contains(&"//action:cancel".to_owned()), "{said:?}");
    assert!(
        said.iter().any(|line| line.starts_with("ok T:") && line.contains("/0.00 B:") && line.contains(" /0.00 @")),
        "{said:?}"
    );
    assert!(said.contains(&"Not SD printing".to_owned()), "{said:?}");
    assert!(said.iter().any(|line| line.starts_with("echo:Print time: ") && line.ends_with('s')), "{said:?}");
    assert!(!said.contains(&"Done printing file".to_owned()), "{said:?}");
}

/// Pronterface: `M28 name`, the lines, `M29 name`; OctoPrint the same, with numbers.
#[test]
fn a_host_writes_a_file() {
    let setup = setup();
    let mut printer = setup.printer();
    let lines: Vec<String> =
        ["M110 N0", "M21", "M28 up.gco", "G28", "G1 X10 ; there", "M112x", "M108", "M105", "M29 up.gco"]
            .iter()
            .enumerate()
            .map(|(number, text)| numbered(number as i64, text))
            .collect();
    let lines: Vec<&str> = lines.iter().map(String::as_str).collect();
    let said = setup.converse(&mut printer, &lines, &mut nothing);
    assert_eq!(
        said,
        [
            "ok",
            "echo:SD card ok",
            "ok",
            "echo:Now fresh file: up.gco",
            "Writing to file: up.gco",
            "ok",
            "ok",
            "ok",
            "ok",
            "ok",
            "ok",
            "Done saving file.",
            "ok"
        ]
    );
    let said = setup.converse(
        &mut printer,
        &["M28 NONE/A.GCO", "M28 toolongname.gcode", "M30 up.gco", "M30 up.gco", "M30 LOCKED.GCO"],
        &mut nothing,
    );
    let failures: Vec<&str> =
        said.iter().map(String::as_str).filter(|line| !line.starts_with("echo:") && *line != "ok").collect();
    assert_eq!(
        failures,
        [
            "open failed, File: NONE/A.GCO.",
            "open failed, File: toolongname.gcode.",
            "File deleted:up.gco",
            "Deletion failed, File: up.gco.",
            "Deletion failed (read-only), File: LOCKED.GCO.",
        ]
    );
}

/// A line whose N was damaged is asked for again; in a file it would stay.
#[test]
fn a_line_without_its_number_is_not_written_by_a_host_that_numbers_its_lines() {
    let setup = setup();
    let mut printer = setup.printer();
    setup.converse(&mut printer, &["M21"], &mut nothing);
    let garbled = numbered(3, "G1 X5").replacen('N', "F", 1);
    let lines = [numbered(0, "M110 N0"), numbered(1, "M28 UP.GCO"), numbered(2, "G28"), garbled, numbered(3, "G1 X5")];
    let lines: Vec<&str> = lines.iter().map(String::as_str).collect();
    let said = setup.converse(&mut printer, &lines, &mut nothing);
    let asked: Vec<&str> = said.iter().map(String::as_str).filter(|line| !line.starts_with("ok")).skip(2).collect();
    assert_eq!(asked, ["Error:No Line Number with checksum, Last Line: 2", "Resend: 3"], "{said:?}");
    // A person may end the file.
    assert_eq!(setup.converse(&mut printer, &["M29"], &mut nothing), ["Done saving file.", "ok"]);
    assert_eq!(read(&setup, "UP.GCO"), "G28\nG1 X5\n");
    setup.converse(&mut printer, &["M28 UP.GCO", "G1 X7", "M29"], &mut nothing);
    assert_eq!(read(&setup, "UP.GCO"), "G1 X7\n");
}

#[test]
fn what_was_written_is_what_was_sent() {
    let setup = setup();
    let mut printer = setup.printer();
    let text: Vec<String> = (0..2000).map(|line| format!("G1 X{} Y{}", line % 100, line % 90)).collect();
    let mut lines = vec!["M21", "M28 UP.GCO"];
    lines.extend(text.iter().map(String::as_str));
    lines.push("M29");
    let said = setup.converse(&mut printer, &lines, &mut nothing);
    assert_eq!(said.iter().filter(|line| *line == "ok").count(), lines.len());
    assert_eq!(said[said.len() - 2], "Done saving file.");
    let written = read(&setup, "UP.GCO");
    assert_eq!(written, text.join("\n") + "\n");
}

fn read(setup: &Setup, name: &str) -> String {
    use ferrostep_card::{CardPort, Request, Taken};
    setup.card.with(&mut |mailbox| mailbox.ask(Request::Open(name.try_into().unwrap())));
    let mut bytes = Vec::new();
    let mut chunk = [0; 64];
    loop {
        let mut taken = Taken::Wait;
        setup.card.with(&mut |mailbox| taken = mailbox.take(&mut chunk));
        match taken {
            Taken::Bytes(length) => bytes.extend(&chunk[..length]),
            Taken::Wait => {}
            Taken::End => return String::from_utf8(bytes).unwrap(),
            Taken::Failed(failure) => panic!("{failure}"),
        }
    }
}

#[test]
fn lines_after_a_write_error_are_not_executed() {
    let setup = setup();
    let mut printer = setup.printer();
    setup.converse(&mut printer, &["M21", "M28 UP.GCO"], &mut nothing);
    setup.card.with_slot(|slot| slot.pull());
    let line = format!("G1 X10 ; {}", "x".repeat(200));
    let lines: Vec<&str> =
        std::iter::repeat_n("G1 X10 Y10 Z10 F6000 E10", 100).chain([line.as_str(), "M29", "M114"]).collect();
    let said = setup.converse(&mut printer, &lines, &mut nothing);
    assert!(said.contains(&"Error:error writing to file".to_owned()), "{said:?}");
    assert!(said.iter().any(|line| line.starts_with("X:0.00 Y:0.00 Z:0.00 E:0.00")), "nothing has moved: {said:?}");
}

#[test]
fn a_log_holds_the_lines_that_are_executed() {
    let setup = setup();
    let mut printer = setup.printer();
    let said = setup.converse(&mut printer, &["M21", "M928 LOG.TXT", "M105", "G28", "M29"], &mut nothing);
    assert!(said.iter().any(|line| line.starts_with("ok T:")), "{said:?}");
    assert_eq!(read(&setup, "LOG.TXT"), "M105\nG28\n");
}

#[test]
fn names_are_told() {
    let setup = setup();
    let lines = [
        "M21",
        "M33 PARTSO~1/LEFTSI~1/BRACKE~1.GCO",
        "M33 NONE.GCO",
        "M22",
        "M20",
        "M23 A cube with a long name.gcode",
    ];
    let said = said(&setup, &lines);
    assert_eq!(
        said,
        [
            "echo:SD card ok",
            "ok",
            "/Parts of the machine/Left side/Bracket, thick.gcode",
            "ok",
            "open failed, File: NONE.GCO.",
            "echo:card: file not found",
            "ok",
            "echo:SD card released",
            "ok",
            "echo:No media",
            "ok",
            "open failed, File: A cube with a long name.gcode.",
            "echo:card: the card is not mounted: M21 mounts it",
            "ok",
        ]
    );
}

/// A filament change in a file: reading the card stops until a person continues the print, by M24,
/// M602, M108 or the prompt's button; it continues where it was.
#[test]
fn a_file_that_pauses_waits_for_a_person() {
    for (pause, resume) in [("M600", "M24"), ("M601", "M602"), ("M25", "M108"), ("M0", "M876 S0"), ("M600", "M876 S0")]
    {
        let setup = setup();
        let mut printer = setup.printer();
        setup.put("P.GCO", format!("G28\nG1 X20 Y30 Z5 F6000\n{pause}\nM114\nG1 X40\n").as_bytes());
        let mut turn = 0;
        let mut paused_at = None;
        let said = setup.converse(&mut printer, &["M21", "M23 P.GCO", "M24"], &mut |_, _| {
            turn += 1;
            let is_paused = setup.has_said("//action:paused");
            if is_paused && paused_at.is_none() {
                paused_at = Some(turn);
            }
            match paused_at {
                // A person moves the head by hand meanwhile.
                Some(at) if turn == at + 3 => vec!["G91".to_owned(), "G1 X7 Y-3 F600".to_owned(), "G90".to_owned()],
                Some(at) if turn == at + 6 => vec!["M114".to_owned(), resume.to_owned()],
                _ => Vec::new(),
            }
        });
        let place =
            said.iter().filter(|line| line.starts_with("X:")).nth(1).unwrap_or_else(|| panic!("{pause}: {said:?}"));
        let expected = if pause == "M0" { "X:27.00 Y:27.00 Z:5.00" } else { "X:17.00 Y:187.00 Z:25.00" };
        assert!(place.starts_with(expected), "{pause}: {place}");
        let back = said.iter().rfind(|line| line.starts_with("X:")).unwrap();
        assert!(back.ends_with("Count X:1600 Y:2400 Z:2000"), "{pause}: {back}");
        let position =
            |text: &str| said.iter().position(|line| line == text).unwrap_or_else(|| panic!("{text} in {said:?}"));
        assert!(position("//action:paused") < position("//action:resumed"), "{pause}");
        assert!(position("//action:resumed") < position("Done printing file"), "{pause}");
        assert_eq!(
            setup.converse(&mut printer, &["M114"], &mut nothing)[0].split(" E:").next(),
            Some("X:40.00 Y:30.00 Z:5.00"),
            "{pause}"
        );
    }
}

/// The second button of a filament change pushes filament, and the person is asked again.
#[test]
fn more_filament_is_pushed_while_a_file_waits() {
    let setup = setup();
    let mut printer = setup.printer();
    setup.put("P.GCO", b"G28\nM302 P1\nG1 X20 Y30 Z5 F6000\nM600\nM114\n");
    let (mut turn, mut paused_at) = (0, None);
    let said = setup.converse(&mut printer, &["M21", "M23 P.GCO", "M24"], &mut |_, _| {
        turn += 1;
        if setup.has_said("//action:paused") {
            paused_at.get_or_insert(turn);
        }
        match paused_at {
            Some(at) if turn == at + 3 || turn == at + 6 => vec!["M876 S1".to_owned()],
            Some(at) if turn == at + 9 => vec!["M114".to_owned(), "M876 S0".to_owned()],
            _ => Vec::new(),
        }
    });
    let asked = said.iter().filter(|line| *line == "//action:prompt_button Push 50 mm").count();
    assert_eq!(asked, 3, "{said:?}");
    assert!(said.contains(&"Done printing file".to_owned()), "{said:?}");
    let places: Vec<&String> = said.iter().filter(|line| line.starts_with("X:")).collect();
    assert!(places[places.len() - 1].ends_with("Count X:1600 Y:2400 Z:2000"), "{places:?}");
}

/// M524 ends a print that is paused: the nozzle stays where it is.
#[test]
fn a_paused_print_can_be_ended() {
    let setup = setup();
    let mut printer = setup.printer();
    setup.put("P.GCO", b"G28\nG1 X20 Y30 Z5 F6000\nM600\nG1 X40\n");
    let mut is_ended = false;
    let said = setup.converse(&mut printer, &["M21", "M23 P.GCO", "M24"], &mut |_, _| {
        let ends = !is_ended && setup.has_said("//action:paused");
        is_ended |= ends;
        if ends { vec!["M524".to_owned()] } else { Vec::new() }
    });
    assert!(said.contains(&"//action:cancel".to_owned()), "{said:?}");
    assert!(!said.contains(&"//action:resumed".to_owned()), "{said:?}");
    assert!(setup.converse(&mut printer, &["M114"], &mut nothing)[0].starts_with("X:10.00 Y:190.00 Z:25.00"));
    assert!(setup.converse(&mut printer, &["M602"], &mut nothing)[0].contains("no print is paused"));
}

/// Commands for files within the file of a print, and M24 without a paused print.
#[test]
fn commands_for_files_in_a_print_do_not_pause_it() {
    let lines = [
        "M20",
        "M21",
        "M22",
        "M26 S0",
        "M27 S2",
        "M29",
        "M30 A.GCO",
        "M32 P.GCO",
        "M33 P.GCO",
        "M34",
        "M928 A.GCO",
        "M24",
        "M602",
        "RESUME",
    ];
    for line in lines {
        let setup = setup();
        setup.put("P.GCO", format!("G28\nG1 X20 F3000\n{line}\nG1 X30\nM400\n").as_bytes());
        let said = setup.say(&["M21", "M32 !P.GCO#"], &mut nothing);
        assert_eq!(said.last().unwrap(), "Done printing file", "{line}: {said:?}");
        assert_eq!(setup.motor_steps()[0], 30 * 80, "{line}");
    }
}

/// The next M24 continues after a line that nothing mends.
#[test]
fn a_line_that_nothing_mends_is_left_out() {
    for line in ["M28 A.GCO", "M790 S5", "G5 X1", "M104 S900"] {
        let setup = setup();
        setup.put("P.GCO", format!("G28\nG1 X20 F3000\n{line}\nG1 X30").as_bytes());
        let mut is_over = false;
        let said = setup.say(&["M21", "M32 !P.GCO#"], &mut |_, _| {
            let goes_on = setup.has_said("//action:paused") && !std::mem::replace(&mut is_over, true);
            if goes_on { vec!["M24".to_owned()] } else { Vec::new() }
        });
        assert!(said.iter().any(|said| said.contains("at line 3; M24 resumes after the line")), "{line}: {said:?}");
        assert_eq!(said.last().unwrap(), "Done printing file", "{line}: {said:?}");
        assert_eq!(setup.motor_steps()[0], 30 * 80, "{line}");
    }
}

#[test]
fn m410_in_a_file_drops_moves_and_the_file_goes_on() {
    let setup = setup();
    setup.put("P.GCO", b"G28\nG1 X20 F3000\nG1 X90\nM410\nG1 X30\n");
    let said = setup.say(&["M21", "M32 !P.GCO#"], &mut nothing);
    assert_eq!(said.last().unwrap(), "Done printing file", "{said:?}");
    assert_eq!(setup.motor_steps()[0], 30 * 80);
}

#[test]
fn a_log_does_not_contain_its_end() {
    let setup = setup();
    let said = setup.say(&["M21", "M928 A.GCO", "G28", "G1 X15 F3000", "M29", "M20", "M32 A.GCO"], &mut nothing);
    assert!(said.contains(&"A.GCO 17".to_owned()), "{said:?}");
    assert_eq!(said.last().unwrap(), "Done printing file", "{said:?}");
}
