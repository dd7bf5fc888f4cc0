//! A card in the served printer's slot: a host writes a file and has it printed, as
//! over a board's line.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::Command;

use ferrostep_testkit::program::{program, repository};
use ferrostep_testkit::served::printer::Printer;
use ferrostep_testkit::served::{part, print_of_lines};
use tempfile::TempDir;

/// The image of a card that mkfs.fat and mtools have made, as a file in a folder.
pub fn image(folder: &TempDir) -> PathBuf {
    let image = folder.path().join("card.img");
    let gz = std::fs::File::open(repository().join("printer/card/tests/images/fat16.img.gz")).unwrap();
    let mut bytes = Vec::new();
    flate2::read::GzDecoder::new(gz).read_to_end(&mut bytes).unwrap();
    std::fs::write(&image, &bytes).unwrap();
    image
}

#[test]
fn a_file_is_uploaded_printed_and_still_there_at_the_end() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let image = image(&folder);
    let bytes = std::fs::read(&image).unwrap();

    let lines = part();
    let expected = print_of_lines(&lines);
    let printer = Printer::at_pty(&["--speed", "max", "--card", image.to_str().unwrap()]);
    let mut host = printer.connect();
    host.say_numbered("M110 N0");
    assert!(host.say_numbered("M21").contains(&"echo:SD card ok".to_owned()));
    assert!(host.say_numbered("M28 PART.GCO").contains(&"Writing to file: PART.GCO".to_owned()));
    for line in &lines {
        assert_eq!(host.say_numbered(line), ["ok"], "{line}");
    }
    assert_eq!(host.say_numbered("M29"), ["Done saving file.", "ok"]);
    assert!(host.say_numbered("M20").iter().any(|line| line.starts_with("PART.GCO ")));
    host.say_numbered("M27 S1");
    // The host is answered while it prints: it has sent more lines than the printer takes
    // before it begins.
    host.send(&format!("M32 !PART.GCO#\n{}G1 X5\n", "M27\n".repeat(20)));
    let answers: Vec<String> = (0..22).map(|_| host.hear_until(|line| line.starts_with("ok")).concat()).collect();
    assert!(answers[20].contains("SD printing byte "), "{answers:?}");
    assert!(answers[21].contains("the memory card is printing"), "{answers:?}");
    let heard = host.hear_until(|line| line == "Done printing file");
    assert!(heard.iter().any(|line| line.starts_with("SD printing byte ")), "{heard:?}");
    assert_eq!(host.figure("order_digest"), expected["order_digest"]);
    printer.end();
    let after = std::fs::read(&image).unwrap();
    assert!(after != bytes && after.len() == bytes.len(), "the file is in the image");
    assert!(after.windows(11).any(|name| name == b"PART    GCO"));
}

/// A folder with the part's lines as a file, below another folder.
fn folder_with_part(lines: &[String]) -> TempDir {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    std::fs::create_dir(folder.path().join("My parts")).unwrap();
    std::fs::write(folder.path().join("My parts/First layers.gcode"), lines.join("\n")).unwrap();
    std::fs::write(folder.path().join(".hidden.gcode"), "G28").unwrap();
    folder
}

fn path(folder: &TempDir) -> &str {
    folder.path().to_str().unwrap()
}

#[test]
fn a_folder_is_put_on_a_card_and_stays_as_it_is() {
    let lines = part();
    let expected = print_of_lines(&lines);
    let folder = folder_with_part(&lines);
    let printer = Printer::at_pty(&["--speed", "max", "--card", path(&folder)]);
    let mut host = printer.connect();
    let listed = host.say("M20 L");
    let of_part = listed.iter().filter(|line| line.contains("First layers.gcode")).count();
    assert!(of_part == 1 && !listed.concat().contains("hidden"), "{listed:?}");
    host.say("M28 NEW.GCO");
    host.say("G28");
    host.say("M29");
    host.say("M32 !My parts/First layers.gcode#");
    host.hear_until(|line| line == "Done printing file");
    assert_eq!(host.figure("step_digest"), expected["step_digest"]);
    printer.end();
    assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 2);
}

#[test]
fn a_card_that_is_pulled_out_pauses_the_print_until_it_is_back() {
    let lines = part();
    let expected = print_of_lines(&lines);
    let folder = folder_with_part(&lines);
    let faults = ["--fault", "card-pull@200", "--fault", "card-back@202"];
    let printer = Printer::at_pty(&[&["--speed", "max", "--card", path(&folder)], &faults[..]].concat());
    let mut host = printer.connect();
    host.say("M32 !My parts/First layers.gcode#");
    let said = host.hear_until(|line| line == "//action:paused");
    // The message depends on whether a read was under way at that moment.
    let is_told = |line: &String| {
        line.starts_with("echo:card: ") && line.ends_with("the print is paused, put the card back and send M24")
    };
    assert!(said.iter().any(is_told), "{said:?}");
    // The printer's time stops for a host that sends again and again, but not for a dwell: then
    // the card is back.
    host.say("G4 S3");
    let said = host.say("M24");
    assert!(said.contains(&"//action:resumed".to_owned()), "{said:?}");
    host.hear_until(|line| line == "Done printing file");
    let done = printer.end();
    for key in ["position_mm", "filament_mm"] {
        assert_eq!(done[key], expected[key], "{key}");
    }
}

/// A print from a card with this filament sensor, which `faults` disturb: the sensor stops it with
/// `says`, and M412 reports `missing`. After `mended_s`, when `present` is reported if it is given,
/// the print continues to its end without another pause.
fn a_sensor_pauses_the_print(
    sensor: &str,
    faults: [&str; 2],
    says: &str,
    missing: &str,
    mended_s: u32,
    present: Option<&str>,
) {
    let lines = part();
    let expected = print_of_lines(&lines);
    let folder = folder_with_part(&lines);
    let profile = folder.path().with_extension("toml");
    let text = std::fs::read_to_string(repository().join("config/profiles/cartesian.toml")).unwrap();
    std::fs::write(&profile, format!("{text}\n[filament_sensor]\n{sensor}\n")).unwrap();
    let faults = faults.map(|fault| ["--fault", fault]).concat();
    let machine = ["--speed", "max", "--profile", profile.to_str().unwrap(), "--card", path(&folder)];
    let printer = Printer::at_pty(&[&machine[..], &faults[..]].concat());
    let mut host = printer.connect();
    host.say("M32 !My parts/First layers.gcode#");
    host.hear_until(|line| line.starts_with(says));
    host.hear_until(|line| line.starts_with("echo:Change the filament"));
    assert!(host.say("M412").contains(&missing.to_owned()));
    // The printer's time passes in a dwell: then the filament is right again.
    host.say(&format!("G4 S{mended_s}"));
    if let Some(present) = present {
        assert!(host.say("M412").contains(&present.to_owned()));
    }
    host.say("M108");
    host.hear_until(|line| line == "//action:resumed");
    let said = host.hear_until(|line| line == "Done printing file");
    assert!(!said.iter().any(|line| line == "//action:paused"), "{said:?}");
    let done = printer.end();
    for key in ["position_mm", "filament_mm"] {
        assert_eq!(done[key], expected[key], "{key}");
    }
    std::fs::remove_file(profile).unwrap();
}

#[test]
fn filament_that_runs_out_pauses_the_print_until_new_one_is_there() {
    a_sensor_pauses_the_print(
        "missing_is_low = true",
        ["filament-out@200", "filament-back@230"],
        "echo:The filament has run out",
        "echo:Filament runout ON; filament: missing",
        60,
        Some("echo:Filament runout ON; filament: present"),
    );
}

#[test]
fn filament_that_is_jammed_pauses_the_print_until_it_is_free() {
    a_sensor_pauses_the_print(
        "kind = \"motion\"\ndetection_mm = 3",
        ["filament-jam@200", "filament-free@260"],
        "echo:The filament does not move",
        "echo:Filament runout ON; distance: 3 mm; filament: missing",
        90,
        // It moves again only when the print continues.
        None,
    );
}

#[test]
fn what_is_no_card_is_refused() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let missing = folder.path().join("none.img");
    let mut deep = folder.path().to_owned();
    (0..10).for_each(|_| deep.push("d"));
    std::fs::create_dir_all(&deep).unwrap();
    for (arguments, expected) in [
        (vec!["--fault", "card-pull@1"], "--fault card-pull and card-back need a card: add --card IMAGE|FOLDER"),
        (vec!["--fault", "filament-out@1"], "--fault filament-out and filament-back need a sensor"),
        (vec!["--card", missing.to_str().unwrap()], "name a folder of files, or make an image with: mkfs.fat -C"),
        (vec!["--card", path(&folder)], "folders lie deeper than 8"),
    ] {
        let mut command = Command::new(program());
        let output = command.args(["serve", "--tcp", "0"]).args(&arguments).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(said.contains(expected), "{arguments:?}: {said}");
    }
    assert!(!Path::new(&missing).exists());
}
