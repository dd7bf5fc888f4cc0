//! A run that continues from a snapshot repeats the original run.
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};

use ferrostep_mainboard::host::{Heard, Options as StreamOptions, Stream};
use ferrostep_mainboard::machine::{HOST_PORT, Machine};
use ferrostep_mainboard::run::{self, Operator, Options, Turn};
use ferrostep_mainboard::wiring::{Board, Printer};
use rigless::emulator::Host;
use rigless::image::Image;
use rigless::snapshot::{Error, Snapshot, Taken};

const SECOND: u64 = 1_000_000_000;
const TAKEN_AT_NS: u64 = 3 * SECOND;
const END_NS: u64 = 5 * SECOND;

/// Heats and homes, and takes a snapshot meanwhile.
#[derive(Clone)]
struct Homing {
    stream: Stream,
    snapshot: Option<(Vec<u8>, Stream)>,
    wants: bool,
}

impl Operator for Homing {
    fn turn(&mut self, machine: &mut Machine, now_ns: u64, _: &mut dyn Host) -> Turn {
        let mailbox = machine.mailbox(HOST_PORT).unwrap();
        let bytes: Vec<u8> = mailbox.take().map(|(_, word)| word as u8).collect();
        self.stream.received(now_ns, &bytes);
        while let Some(line) = self.stream.to_send(now_ns) {
            line.into_iter().for_each(|byte| mailbox.send(now_ns, u16::from(byte)));
        }
        self.wants |= self.snapshot.is_none() && now_ns >= TAKEN_AT_NS;
        if now_ns >= END_NS { Turn::Stop } else { Turn::Continue }
    }

    fn wants_snapshot(&mut self) -> bool {
        std::mem::take(&mut self.wants)
    }

    fn snapshot_taken(&mut self, snapshot: Result<Taken, Error>) {
        self.snapshot = Some((snapshot.unwrap().file, self.stream.clone()));
    }
}

/// The visible end of a run.
fn seen(finished: &run::Finished<Homing>) -> (Vec<Heard>, String, String) {
    let (machine, report) = (finished.machine(), &finished.report);
    let state = format!("{:?} {:?}", machine.plant, machine.decoder);
    let counts = format!("{} {} {}", report.virtual_ns, report.instructions, report.accesses);
    (finished.operator.stream.heard().to_vec(), state, counts)
}

#[test]
fn a_run_from_a_snapshot_repeats_the_original() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let file = |path: &str| -> PathBuf { root.join(path) };
    let image_path = file("target/images/prusa-buddy/ferrostep.elf");
    assert!(
        image_path.exists(),
        "{} is missing: build it with `cargo xtask firmware --board prusa-buddy`",
        image_path.display()
    );
    let board = Board::read(&file("config/boards/prusa-buddy.toml")).unwrap();
    let printer = Printer::read(&file("config/profiles/prusa-mini.toml")).unwrap();
    let images = [Image::read(&image_path, None).unwrap()];
    let boot = Some(0x0800_0000 + u64::from(board.boot_offset));
    let machine = || Machine::new(&board, &printer, 7).unwrap();
    let options = StreamOptions { numbered: true, wait_for_start: true, ..StreamOptions::default() };
    let lines = ["M155 S1", "M140 S50", "M104 S120", "G28", "M114"];
    let homing = Homing { stream: Stream::new(lines, options), snapshot: None, wants: false };

    let whole = run::run(machine(), &images, &Options { boot, ..Options::default() }, homing).unwrap();
    let (snapshot, stream) = whole.operator.snapshot.clone().unwrap();
    let path = std::env::temp_dir().join(format!("ferrostep-snapshot-{}", std::process::id()));
    std::fs::write(&path, snapshot).unwrap();
    let snapshot = Snapshot::read(&path).unwrap();
    std::fs::remove_file(&path).unwrap();

    let second = Homing { stream, snapshot: Some((Vec::new(), Stream::new([""], options))), wants: false };
    let resumed = run::run_from(&snapshot, machine(), &images, boot, second).unwrap();
    let (whole, resumed) = (seen(&whole), seen(&resumed));
    assert!(whole.0.len() > 5, "{:?}", whole.0);
    assert_eq!(whole.0, resumed.0);
    assert_eq!(whole.2, resumed.2);
    assert!(whole.1 == resumed.1, "the machines differ");
}
