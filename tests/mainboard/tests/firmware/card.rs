//! The Octopus's image with a card in its slot: lists, prints, cards that are pulled out, slow or
//! damaged, and power cuts.
//!
//! The card's volume is made and read by fatfs.

use std::io::{Cursor, Read, Write};

use ferrostep_mainboard::parts::sd_card::{Config, Kind, SdCard};

use crate::firmware::bench::Bench;
use crate::firmware::equipped;
use crate::firmware::equipped::octopus;
use crate::firmware::job::Job;
use crate::firmware::pins::PinEvent;
use crate::firmware::rehearsal::Rehearsal;

mod power_loss;

/// A volume of FAT16 with as few clusters as one may have, about.
const VOLUME_BYTES: usize = 16 << 20;
const CLUSTER_BYTES: u32 = 2048;

const MS: u64 = 1_000_000;

/// Lines before each print here: moves without heat, and a place from which the file continues.
const BEFORE: &str = "M302 P1\nG92 X285 Y285 Z2\n";

/// Layers of a small square, each longer than the five seconds between two places that are kept.
fn program(layers: u32) -> String {
    let mut text = String::from("M302 P1\nG90\nM82\nG92 E0\n");
    let mut e_mm = 0.0;
    for layer in 0..layers {
        text += &format!("G1 Z{:.1} F600\n", 0.2 + 0.2 * f64::from(layer));
        for (x_mm, y_mm) in [(295, 285), (295, 295), (285, 295), (285, 285)] {
            e_mm += 0.5;
            text += &format!("G1 X{x_mm}.{layer} Y{y_mm} E{e_mm:.3} F420\n");
        }
    }
    text + "G0 Z2 F600\n"
}

/// A volume with these files.
fn volume(files: &[(&str, &str)]) -> Vec<u8> {
    let mut image = Cursor::new(vec![0; VOLUME_BYTES]);
    let options = fatfs::FormatVolumeOptions::new().fat_type(fatfs::FatType::Fat16).bytes_per_cluster(CLUSTER_BYTES);
    fatfs::format_volume(&mut image, options).unwrap();
    image.set_position(0);
    let system = fatfs::FileSystem::new(&mut image, fatfs::FsOptions::new()).unwrap();
    for (name, text) in files {
        system.root_dir().create_file(name).unwrap().write_all(text.as_bytes()).unwrap();
    }
    drop(system);
    image.into_inner()
}

/// A card of high capacity with these files.
fn card(files: &[(&str, &str)]) -> SdCard {
    SdCard::new(Config::high((VOLUME_BYTES / 512) as u32), &volume(files))
}

/// An Octopus with a card in its slot.
fn boot(card: SdCard) -> Bench {
    let mut bench = Bench::switch_on(octopus(), |machine| {
        machine.insert_card(0, card);
    });
    bench.host.connect().unwrap();
    bench
}

fn insert(bench: &mut Bench, card: SdCard) {
    let now_ns = bench.now_ns();
    bench.with(move |machine, _| {
        machine.insert_card(now_ns, card);
    });
}

fn pull(bench: &mut Bench) -> SdCard {
    let now_ns = bench.now_ns();
    bench.with(move |machine, _| machine.pull_card(now_ns)).unwrap()
}

/// Everything that is answered to a line, up to its `ok`.
fn say(bench: &mut Bench, line: &str) -> Vec<String> {
    bench.host.send_raw(format!("{line}\n").as_bytes()).unwrap();
    heard_until(bench, |line| line.starts_with("ok"))
}

/// Everything up to a line.
fn heard_until(bench: &mut Bench, is_last: impl Fn(&str) -> bool) -> Vec<String> {
    let mut heard = Vec::new();
    loop {
        let line = bench.host.wait_for("the end of an answer", |_| true).unwrap();
        heard.push(line);
        if heard.last().is_some_and(|line| is_last(line)) {
            return heard;
        }
    }
}

fn send(bench: &mut Bench, lines: &str) {
    lines.lines().for_each(|line| bench.host.send(line).unwrap());
}

/// Begins the print of a file.
fn start(bench: &mut Bench, name: &str) {
    assert!(say(bench, &format!("M23 {name}")).contains(&"File selected".to_owned()));
    bench.host.send_raw(b"M24\n").unwrap();
}

fn done(bench: &mut Bench) {
    let heard = heard_until(bench, |line| line == "Done printing file");
    let is_fault = |line: &&String| line.starts_with("Error") || line.starts_with("echo:card");
    assert_eq!(heard.iter().find(is_fault), None, "{heard:?}");
    bench.host.send("M400").unwrap();
}

/// The steps of X, Y and Z alone, whichever others leave with them.
fn of_axes(events: &[PinEvent]) -> Vec<(u8, u8)> {
    let masked = events.iter().map(|event| (event.axes & 0b111, event.directions & 0b111));
    masked.filter(|(axes, _)| *axes != 0).collect()
}

/// The desk's steps of a program, after these lines.
fn rehearsed(before: &str, program: &str) -> Rehearsal {
    Rehearsal::on("corexy", &Job::made_up(&format!("{before}{program}")))
}

fn count(lines: &str) -> u32 {
    lines.lines().count() as u32
}

#[test]
fn a_file_is_listed_and_printed_with_the_desk_s_steps() {
    let program = program(1);
    let mut bench = boot(card(&[("cube.gcode", &program), ("OTHER.GCO", "G28\n")]));
    let heard = say(&mut bench, "M20 L");
    let listed: Vec<&str> =
        heard.iter().map(String::as_str).skip_while(|line| *line != "Begin file list").skip(1).collect();
    let size = program.len();
    assert_eq!(
        listed,
        [&format!("CUBE~1.GCO {size} cube.gcode"), "OTHER.GCO 4 OTHER.GCO", "End file list", "ok"],
        "{heard:?}"
    );
    send(&mut bench, BEFORE);
    bench.host.send("M400").unwrap();
    let before = bench.pins().events().len();
    start(&mut bench, "cube.gcode");
    done(&mut bench);
    let pins = bench.pins();
    let from_card = &pins.events()[before..];
    let rehearsal = rehearsed(BEFORE, &program);
    assert!(from_card == rehearsal.events_after(count(BEFORE)), "not the desk's steps");
    // The same lines from a host.
    send(&mut bench, "G1 X285 Y285 F6000\nM400");
    let before = bench.pins().events().len();
    send(&mut bench, &program);
    bench.host.send("M400").unwrap();
    assert!(bench.pins().events()[before..] == *from_card, "a host's lines make other steps");
    let finished = bench.end();
    assert_eq!(finished.report.unmodelled, Vec::<String>::new());
}

#[test]
fn cards_of_all_kinds_are_mounted_and_an_empty_slot_is_reported() {
    let mut bench = Bench::boot_board(octopus());
    assert_eq!(say(&mut bench, "M21"), ["echo:No SD card", "ok"]);
    let volume = volume(&[("A.GCO", "G28\n")]);
    for kind in [Kind::Version1, Kind::Standard, Kind::High] {
        let config = Config { kind, ..Config::high((VOLUME_BYTES / 512) as u32) };
        insert(&mut bench, SdCard::new(config, &volume));
        assert_eq!(say(&mut bench, "M21"), ["echo:SD card ok", "ok"], "{kind:?}");
        assert_eq!(say(&mut bench, "M20"), ["Begin file list", "A.GCO 4", "End file list", "ok"], "{kind:?}");
        pull(&mut bench);
        bench.host.listen(20).unwrap();
        assert_eq!(say(&mut bench, "M21"), ["echo:No SD card", "ok"]);
    }
    // A card that answers nothing; one that starts slowly (4.2.3: within 1 s).
    let mut silent = card(&[]);
    silent.faults.is_silent = true;
    insert(&mut bench, silent);
    let heard = say(&mut bench, "M21");
    assert_eq!(heard, ["Warning:volume.init failed", "echo:card: the card does not answer", "ok"]);
    pull(&mut bench);
    let config = Config { start_ns: 100 * MS, ..Config::high((VOLUME_BYTES / 512) as u32) };
    insert(&mut bench, SdCard::new(config, &volume));
    assert_eq!(say(&mut bench, "M21"), ["echo:SD card ok", "ok"]);
}

#[test]
fn a_file_is_written_and_read_by_others() {
    let mut bench = boot(card(&[]));
    let text = program(3);
    assert!(say(&mut bench, "M28 NEW.GCO").contains(&"Writing to file: NEW.GCO".to_owned()));
    send(&mut bench, &text);
    bench.host.send("M29").unwrap();
    bench.host.send("M22").unwrap();
    let image = pull(&mut bench).image();
    let system = fatfs::FileSystem::new(Cursor::new(image), fatfs::FsOptions::new()).unwrap();
    let mut read = String::new();
    system.root_dir().open_file("NEW.GCO").unwrap().read_to_string(&mut read).unwrap();
    assert_eq!(read, text);
}

/// A card may be busy for 500 ms after a block (4.6.2.2), whether or not the SDIO waits for it; and
/// a contact may be bad for a moment.
#[test]
fn slow_cards_and_single_faults_stop_no_print() {
    let mut bench = boot(card(&[("A.GCO", &long_program())]));
    for (ends_before_busy, program_ms) in [(false, 280), (true, 20)] {
        bench.with(move |machine, _| machine.chip.card_slot().ends_before_busy = ends_before_busy);
        assert!(say(&mut bench, "M28 NEW.GCO").contains(&"Writing to file: NEW.GCO".to_owned()));
        let before = bench.with(move |machine, _| {
            let card = machine.card().unwrap();
            card.set_program_ns(program_ms * MS);
            card.written
        });
        // A block and a bit.
        let lines = "G1 X10.123 Y20.456 E0.789 F6000\n".repeat(20);
        send(&mut bench, &lines);
        // One block is slow, which is enough of the processor's polling.
        let is_written = (0..1000).any(|_| {
            bench.wait_us(1000);
            bench.with(move |machine, _| {
                let card = machine.card().unwrap();
                let is_written = card.written > before;
                if is_written {
                    card.set_program_ns(MS);
                }
                is_written
            })
        });
        assert!(is_written, "no block was written slowly");
        assert!(!say(&mut bench, "M29").iter().any(|line| line.starts_with("Error")));
        assert!(say(&mut bench, "M20").contains(&format!("NEW.GCO {}", lines.len())));
    }
    send(&mut bench, BEFORE);
    start(&mut bench, "A.GCO");
    bench.host.listen(1500).unwrap();
    // Two of three attempts fail.
    bench.with(|machine, _| machine.card().unwrap().faults.garbled_reads = 2);
    done(&mut bench);
    assert_eq!(bench.with(|machine, _| machine.card().unwrap().faults.garbled_reads), 0);
}

#[test]
fn a_card_that_is_pulled_out_pauses_the_print_and_m24_goes_on() {
    let program = long_program();
    let mut bench = boot(card(&[("A.GCO", &program)]));
    send(&mut bench, BEFORE);
    bench.host.send("M400").unwrap();
    let before = bench.pins().events().len();
    start(&mut bench, "A.GCO");
    bench.host.listen(1500).unwrap();
    let pulled = pull(&mut bench);
    let heard = heard_until(&mut bench, |line| line == "//action:paused");
    let told = "echo:card: no card is in the slot; the print is paused, put the card back and send M24";
    assert!(heard.iter().any(|line| line == told), "{heard:?}");
    bench.host.listen(1000).unwrap();
    assert!(say(&mut bench, "M24").iter().any(|line| line.contains("no card is in the slot")));
    insert(&mut bench, pulled);
    bench.host.listen(1000).unwrap();
    bench.host.send_raw(b"M24\n").unwrap();
    done(&mut bench);
    // The way aside and back adds nothing.
    let made = net(&bench.pins().events()[before..]);
    assert_eq!(made, net(rehearsed(BEFORE, &program).events_after(count(BEFORE))));
}

/// Longer than the blocks that are read ahead: lines of half a second with long comments.
fn long_program() -> String {
    let mut text = String::from("M302 P1\nG90\nM83\n");
    for index in 0..20 {
        let comment = "as slicers write them, ".repeat(8);
        text += &format!("G1 X{}.5 Y{}.25 E0.05 F600 ; {comment}\n", 285 + index % 2 * 4, 285 + index / 4);
    }
    text
}

/// Steps of each motor, forwards less backwards.
fn net(events: &[PinEvent]) -> [i64; 4] {
    std::array::from_fn(|motor| {
        let of_motor = events.iter().filter(|event| event.axes >> motor & 1 == 1);
        of_motor.map(|event| 1 - 2 * i64::from(event.directions >> motor & 1)).sum()
    })
}
