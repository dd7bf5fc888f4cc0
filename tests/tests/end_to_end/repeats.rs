//! The same job gives the same steps, however its bytes arrive.

use std::io::{self, Read};
use std::path::Path;

use ferrostep_session::desk::LOOK_AHEAD_BLOCKS;

use crate::end_to_end::command::{directory, example, ferrostep, file, gzip};
use crate::end_to_end::desk::{Ended, profile, rehearse};

/// Numbers that look random and are the same in every run (xorshift).
pub struct Seeded(u64);

impl Seeded {
    /// Starts from a seed other than 0.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// A number below `end`.
    pub fn below(&mut self, end: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % end as u64) as usize
    }
}

/// Hands bytes out in portions of random size.
struct Portions<'a> {
    rest: &'a [u8],
    largest: usize,
    random: Seeded,
}

impl Read for Portions<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let size = (1 + self.random.below(self.largest)).min(buffer.len()).min(self.rest.len());
        let (portion, rest) = self.rest.split_at(size);
        buffer[..size].copy_from_slice(portion);
        self.rest = rest;
        Ok(size)
    }
}

#[track_caller]
fn same(one: &Ended, other: &Ended) {
    assert!(one.outcome.is_ok() && other.outcome.is_ok(), "{:?}, {:?}", one.outcome, other.outcome);
    assert_eq!(one.figures.digests, other.figures.digests);
    assert_eq!(one.figures.motor_steps, other.figures.motor_steps);
    assert_eq!(one.figures.motion_time_s, other.figures.motion_time_s);
    assert_eq!((one.lines, one.tally, one.logical_10nm), (other.lines, other.tally, other.logical_10nm));
}

#[test]
fn input_in_portions_of_any_size_gives_the_same_steps() {
    for (name, machine, sizes) in [
        ("cube.gcode", "cartesian", [1, 3, 50]),
        ("supports.gcode.gz", "cartesian", [7, 300, 70_000]),
        ("arcs-corexy.gcode.gz", "corexy", [20, 2_000, 100_000]),
    ] {
        let (text, profile) = (example(name), profile(machine));
        let whole = rehearse(&profile, LOOK_AHEAD_BLOCKS, &mut text.as_slice());
        same(&whole, &rehearse(&profile, LOOK_AHEAD_BLOCKS, &mut text.as_slice()));
        for (seed, largest) in (1..).zip(sizes) {
            let mut portions = Portions { rest: &text, largest, random: Seeded::new(seed) };
            same(&whole, &rehearse(&profile, LOOK_AHEAD_BLOCKS, &mut portions));
        }
    }
}

#[track_caller]
fn step_digest(path: &Path) -> String {
    let outcome = ferrostep(["print".as_ref(), path.as_os_str(), "--json".as_ref()]);
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    outcome.json()["step_digest"].as_str().unwrap().to_owned()
}

#[test]
fn equivalent_files_give_the_same_steps() {
    let directory = directory();
    let text = example("cube.gcode");
    let plain = step_digest(&file(&directory, "plain.gcode", &text));
    assert_eq!(step_digest(&file(&directory, "again.gcode", &text)), plain);
    assert_eq!(step_digest(&file(&directory, "packed.gcode.gz", gzip(&text))), plain);
    // The digests depend on the content, not on the name.
    assert_eq!(step_digest(&file(&directory, "packed.gcode", gzip(&text))), plain);
    let (start, end) = text.split_at(text.len() / 3);
    assert_eq!(step_digest(&file(&directory, "members.gz", [gzip(start), gzip(end)].concat())), plain);
    let lines = String::from_utf8(text).unwrap();
    assert_eq!(step_digest(&file(&directory, "windows.gcode", lines.replace('\n', "\r\n"))), plain);
    assert_eq!(step_digest(&file(&directory, "mark.gcode", format!("\u{feff}{lines}"))), plain);
    assert_eq!(step_digest(&file(&directory, "open.gcode", lines.trim_end())), plain);
    // The digests of different jobs differ.
    assert_ne!(step_digest(&file(&directory, "other.gcode", lines.replacen("X87.153", "X87.253", 1))), plain);
}

/// The path does not depend on the look-ahead; only the speed does.
#[test]
fn rings_of_any_size_give_the_same_path() {
    let (text, profile) = (example("cube.gcode"), profile("cartesian"));
    let most = rehearse(&profile, 10_000, &mut text.as_slice());
    let mut slower = f64::INFINITY;
    for look_ahead in [2, 3, 4, 8, 31, LOOK_AHEAD_BLOCKS, 1000] {
        let ended = rehearse(&profile, look_ahead, &mut text.as_slice());
        assert!(ended.outcome.is_ok());
        assert_eq!(ended.figures.motor_steps, most.figures.motor_steps, "{look_ahead}");
        assert_eq!((ended.tally, ended.logical_10nm), (most.tally, most.logical_10nm), "{look_ahead}");
        assert_eq!((ended.figures.underruns, ended.figures.starvation_flushes), (0, 0), "{look_ahead}");
        assert!(ended.figures.motion_time_s <= slower, "{look_ahead} is slower than the smaller ring");
        slower = ended.figures.motion_time_s;
    }
    assert!((most.figures.motion_time_s / slower - 1.0).abs() < 1e-6);
}

/// Twice the job makes twice the steps, apart from the way back to its start.
#[test]
fn a_job_can_be_printed_twice_in_a_row() {
    let (text, profile) = (example("cube-cura.gcode.gz"), profile("cartesian"));
    let once = rehearse(&profile, LOOK_AHEAD_BLOCKS, &mut text.as_slice());
    let twice = rehearse(&profile, LOOK_AHEAD_BLOCKS, &mut text.as_slice().chain(text.as_slice()));
    assert!(once.outcome.is_ok() && twice.outcome.is_ok(), "{:?}", twice.outcome);
    assert_eq!(twice.tally.filament_100pm, 2 * once.tally.filament_100pm);
    assert_eq!(twice.tally.moves, 2 * once.tally.moves);
    assert_eq!(twice.logical_10nm, once.logical_10nm);
}
