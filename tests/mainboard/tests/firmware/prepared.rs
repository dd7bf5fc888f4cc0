//! Prepared jobs over the serial line: the same steps despite lost bytes, and no forbidden move.

use std::io::{self, Cursor};
use std::time::{Duration, Instant};

use ferrostep_gpre::transfer::{Kind, Report, Sender, Word, to_wire};
use ferrostep_gpre::{Encoding, EntrySpeed};
use ferrostep_host::send::{self, Patience};
use ferrostep_printer::Profile;
use ferrostep_session::JobReplies;
use ferrostep_session::gpre::{self, Target};
use ferrostep_testkit::hand_made::{self, given};

use crate::firmware::bench::{self, Bench};
use crate::firmware::host::{Host, Port};
use crate::firmware::job::Job;
use crate::firmware::same_steps::{LINES, assert_printed_far_ahead};

pub const PATIENCE: Patience = Patience { give_up: Duration::from_secs(60), board_s: 3600, ..Patience::DEFAULT };

fn profile() -> Profile {
    ferrostep_profiles::load("cartesian").unwrap()
}

/// Prepares a job.
fn prepared(job: &Job) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    let target = Target { out: &mut out, encoding: Encoding::Compact };
    let replies = JobReplies::new(|_: &str| {});
    gpre::prepare(&mut job.text().as_bytes(), None, profile(), replies, target, |_, _| {}).unwrap();
    out.into_inner()
}

/// The board's line, on which one frame in a hundred has a damaged bit and one is lost.
pub struct Line<'a> {
    host: &'a mut Host<bench::Line>,
    /// This computer's clock when the board was switched on.
    start: Instant,
    dice: Option<u64>,
    frames: u32,
    changed: u32,
    lost: u32,
}

impl<'a> Line<'a> {
    pub fn new(host: &'a mut Host<bench::Line>, seed: Option<u64>) -> Self {
        Self { host, start: Instant::now(), dice: seed, frames: 0, changed: 0, lost: 0 }
    }

    /// SplitMix64 (Steele, Lea, Flood 2014).
    fn next(state: &mut u64) -> u64 {
        *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = *state;
        mixed = (mixed ^ mixed >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ mixed >> 31
    }
}

impl send::Port for Line<'_> {
    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        let mut bytes = bytes.to_vec();
        self.frames += 1;
        if let Some(state) = &mut self.dice {
            if Self::next(state).is_multiple_of(100) {
                self.lost += 1;
                return Ok(());
            }
            if Self::next(state).is_multiple_of(100) {
                let (place, bit) = (Self::next(state) as usize % bytes.len(), Self::next(state) % 8);
                bytes[place] ^= 1 << bit;
                self.changed += 1;
            }
        }
        self.host.port().send(&bytes).map_err(io::Error::other)
    }

    fn receive(&mut self, until: Instant) -> io::Result<Option<String>> {
        let until_ns = until.saturating_duration_since(self.start).as_nanos() as u64;
        self.host.port().receive(until_ns).map_err(io::Error::other)
    }

    /// The board's time: the speed of this computer does not affect the transfer.
    fn now(&mut self) -> Instant {
        self.start + Duration::from_nanos(self.host.port().now_ns())
    }
}

/// Sends a job to an image; returns the final report and the board's other messages.
fn send(line: &mut Line<'_>, job: Vec<u8>) -> (Report, Vec<String>) {
    let mut sender = Sender::new(job);
    // Small frames, so that one in a hundred is several.
    sender.set_frame_bytes(16);
    let mut heard = Vec::new();
    let end = send::send(line, &mut sender, PATIENCE, |_| {}, |line: &str| heard.push(line.to_owned())).unwrap();
    (end, heard)
}

#[test]
fn a_prepared_job_makes_the_rehearsed_steps() {
    let job = Job::cube(LINES);
    let bytes = prepared(&job);
    let mut bench = Bench::boot();
    let (end, heard) = send(&mut Line::new(&mut bench.host, None), bytes.clone());
    assert_eq!((end.word, end.numbers[0]), (Word::Done, bytes.len() as u32), "{heard:?}");
    bench.host.connect_again().unwrap();
    assert_printed_far_ahead(bench, &job);
}

#[test]
fn damaged_and_lost_frames_change_no_step() {
    let job = Job::cube(LINES).without_heating().without_homing();
    let bytes = prepared(&job);
    let mut bench = Bench::boot();
    let mut line = Line::new(&mut bench.host, Some(34));
    let (end, heard) = send(&mut line, bytes.clone());
    assert_eq!((end.word, end.numbers[0]), (Word::Done, bytes.len() as u32), "{heard:?}");
    let Line { frames, changed, lost, .. } = line;
    eprintln!("{} bytes in {frames} frames, {changed} changed, {lost} lost", bytes.len());
    assert!(changed >= 2 && lost >= 2, "{changed} of {frames} frames were changed and {lost} lost");
    bench.host.connect_again().unwrap();
    assert_printed_far_ahead(bench, &job);
}

#[test]
fn forbidden_moves_stop_on_the_path() {
    let mut bench = Bench::boot();
    let hash = profile().plan_hash;
    let mut stops = |job: Vec<u8>, word: Word, frame: u32, expected: &str| {
        let (end, heard) = send(&mut Line::new(&mut bench.host, None), job);
        assert_eq!((end.word, end.numbers[1]), (word, frame), "{heard:?}");
        assert!(heard.iter().any(|line| line.contains(expected)), "{expected:?} is not in {heard:?}");
        // The port accepts G-code again, and the machine knows its position.
        bench.host.connect_again().unwrap();
        bench.host.ask("M114", "X:").unwrap()
    };
    // From 100 mm/s within 1 mm to 1 mm/s: the fourth frame.
    let moves = [(40, EntrySpeed::Bound), (1, EntrySpeed::Bound), (40, given(1.0)), (20, EntrySpeed::Bound)];
    let place = stops(hand_made::job(hash, &moves), Word::Stopped, 4, "line 5: the planned speed is too low");
    assert!(place.starts_with("X:41.00 Y:0.00"), "{place}");
    let moves = [(40, EntrySpeed::Bound), (40, given(100.1)), (20, EntrySpeed::Bound)];
    stops(hand_made::job(hash, &moves), Word::Stopped, 3, "the planned speed is too high");
    let moves = [(40, EntrySpeed::Bound), (400, EntrySpeed::Bound)];
    let place = stops(hand_made::job(hash, &moves), Word::Stopped, 2, "frame 2 at byte ");
    assert!(place.starts_with("X:40.00 Y:0.00"), "{place}");
    stops(hand_made::job(hash ^ 1, &moves), Word::Refused, 0, "at byte 16: prepared for another machine");
    let mut broken = hand_made::job(hash, &moves);
    broken[8] = 2;
    stops(broken, Word::Refused, 0, "written in version 2 of the format");
    let mut broken = hand_made::job(hash, &moves);
    let last = broken.len() - 1;
    broken[last] ^= 1;
    stops(broken, Word::Stopped, 2, "damaged: its checksum");
    let mut cut = hand_made::job(hash, &moves);
    cut.truncate(cut.len() - 3);
    stops(cut, Word::Stopped, 2, "the file is cut short");
    stops(b"G28\nG1 X10 F3000\n".repeat(9), Word::Refused, 0, "not a prepared job");
}

#[test]
fn commands_between_frames_are_executed() {
    let mut bench = Bench::boot();
    let moves: Vec<_> = (0..40).map(|_| (4, EntrySpeed::Bound)).collect();
    let job = hand_made::job(profile().plan_hash, &moves);
    bench.host.send(&format!("M790 S{} T3600", job.len())).unwrap();
    bench.host.send_raw(&to_wire(Kind::Data, 0, &job[..250])).unwrap();
    bench.host.wait_for("the received bytes", |line| line.starts_with("gpre:have 250 ")).unwrap();
    // A numbered line is executed; the rest of a frame is not.
    bench.host.send_raw(b"X12 G28\nG1 Y10 F3000\n").unwrap();
    let feed = bench.host.ask("M220", "FR:").unwrap();
    assert_eq!(feed, "FR:100%");
    // A restarted host learns its position in the job.
    bench.host.send(&format!("M790 S{}", job.len())).unwrap();
    bench.host.wait_for("the received bytes", |line| line.starts_with("gpre:have 250 ")).unwrap();
    // The emergency needs no number, and may come between any two frames.
    bench.host.send_raw(&to_wire(Kind::Data, 250, &job[250..400])).unwrap();
    bench.host.send_raw(b"M112\n").unwrap();
    bench.host.wait_for("the end", |line| line.starts_with("gpre:stopped ")).unwrap();
    bench.host.wait_for("the halt", |line| line.starts_with("Error:Printer halted")).unwrap();
}

#[test]
fn a_silent_host_ends_the_job() {
    let mut bench = Bench::boot();
    let job = hand_made::job(profile().plan_hash, &[(40, EntrySpeed::Bound), (20, EntrySpeed::Bound)]);
    bench.host.send(&format!("M790 S{} T15", job.len())).unwrap();
    bench.host.send_raw(&to_wire(Kind::Data, 0, &job[..job.len() - 10])).unwrap();
    bench.host.wait_for("the timeout", |line| line == "echo:gpre: nothing from the host for 15 s").unwrap();
    bench.host.wait_for("the end", |line| line.starts_with("gpre:stopped ")).unwrap();
    // A host that missed the report asks again.
    bench.host.send_raw(&to_wire(Kind::Question, 0, &[])).unwrap();
    bench.host.wait_for("the repeated end", |line| line.starts_with("gpre:stopped ")).unwrap();
    bench.host.connect_again().unwrap();
    let place = bench.host.ask("M114", "X:").unwrap();
    assert!(place.starts_with("X:40.00 Y:0.00"), "{place}");
}

#[test]
fn a_job_does_not_continue_after_a_stop() {
    let mut bench = Bench::boot();
    let moves: Vec<_> = (0..10).map(|_| (15, EntrySpeed::Bound)).collect();
    let job = hand_made::job(profile().plan_hash, &moves);
    let (first, rest) = job.split_at(job.len() / 2);
    bench.host.send(&format!("M790 S{} T3600", job.len())).unwrap();
    for (index, part) in first.chunks(200).enumerate() {
        bench.host.send_raw(&to_wire(Kind::Data, index as u32 * 200, part)).unwrap();
    }
    let come = format!("gpre:have {} ", first.len());
    bench.host.wait_for("the received bytes", |line| line.starts_with(&come)).unwrap();
    bench.host.send_raw(b"M410\n").unwrap();
    for (index, part) in rest.chunks(200).enumerate() {
        let place = first.len() + index * 200;
        bench.host.send_raw(&to_wire(Kind::Data, place as u32, part)).unwrap();
    }
    bench.host.wait_for("the end", |line| line.starts_with("gpre:stopped ")).unwrap();
    bench.host.connect_again().unwrap();
    let place = bench.host.ask("M114", "X:").unwrap();
    let x_mm: f64 = place[2..].split(' ').next().unwrap().parse().unwrap();
    assert!(x_mm < 150.0, "{place}");
}
