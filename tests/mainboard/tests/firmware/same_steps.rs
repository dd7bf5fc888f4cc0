//! A whole job streamed into the image.

use crate::firmware::bench::{Bench, Line};
use crate::firmware::host::Host;
use crate::firmware::job::Job;
use crate::firmware::noise::Noise;
use crate::firmware::pins::PinLog;
use crate::firmware::rehearsal::Rehearsal;

/// Lines of the cube: into the infill of the first layer.
pub const LINES: usize = 200;

/// The reply to M797.
#[derive(Debug)]
pub struct Motion {
    pub order_digest: u64,
    pub step_digest: u64,
    pub underruns: u64,
    pub starvation_flushes: u64,
    pub idle_flushes: u64,
    pub planning_slowdowns: u64,
    pub steps: [u64; 4],
}

impl Motion {
    /// Reads M797's line.
    pub fn parse(line: &str) -> Self {
        let word = |name: &str| {
            let rest = line.split_once(&format!(" {name}:")).unwrap_or_else(|| panic!("no {name} in {line:?}")).1;
            rest.split(' ').next().unwrap().to_owned()
        };
        let digest = |name| u64::from_str_radix(&word(name), 16).unwrap();
        let count = |name| word(name).parse().unwrap();
        Self {
            order_digest: digest("order_digest"),
            step_digest: digest("step_digest"),
            underruns: count("underruns"),
            starvation_flushes: count("starvation_flushes"),
            idle_flushes: count("idle_flushes"),
            planning_slowdowns: count("planning_slowdowns"),
            steps: ["X", "Y", "Z", "E"].map(count),
        }
    }
}

/// Waits for the end of motion, switches the machine off, and compares its report and its pins with
/// the desk's print of the same job: all steps and the digests of their order and times, or after
/// homing the pins' steps and times.
pub fn assert_printed_as_rehearsed(bench: Bench, job: &Job) {
    assert_printed_as(bench, job, Rehearsal::of);
}

/// The same comparison with the desk's largest look-ahead.
pub fn assert_printed_far_ahead(bench: Bench, job: &Job) {
    assert_printed_as(bench, job, Rehearsal::far_ahead);
}

fn assert_printed_as(mut bench: Bench, job: &Job, rehearse: impl FnOnce(&Job) -> Rehearsal) {
    bench.host.send("M400").unwrap();
    let reported = Motion::parse(&bench.host.ask("M797", "echo:motion ").unwrap());
    let resends = bench.host.resends();
    let pins = bench.switch_off();
    let rehearsal = rehearse(job);
    eprintln!("{} step events, {resends} resends; the image reports {reported:x?}", pins.events().len());

    let early = reported.starvation_flushes + reported.idle_flushes;
    assert_eq!(early, 0, "the line was too slow: blocks left the look-ahead ring early: {reported:?}");
    assert_eq!(reported.planning_slowdowns, 0, "planning was too slow: {reported:?}");
    assert!(!pins.motors_disabled(), "the motors stepped without current");
    if job.homes() {
        rehearsal.assert_same_events_after_homing(job, &pins);
        return;
    }
    rehearsal.assert_same_events(job, &pins);
    assert_same_figures(&reported, &pins, &rehearsal);
}

fn assert_same_figures(reported: &Motion, pins: &PinLog, rehearsal: &Rehearsal) {
    let figures = &rehearsal.figures;
    assert_eq!(pins.order_digest(), figures.digests.order);
    assert_eq!(reported.order_digest, figures.digests.order);
    assert_eq!(
        reported.step_digest, figures.digests.step,
        "the steps have the desk's order but other times ({} underruns)",
        reported.underruns
    );
    assert_eq!(pins.displacement(), rehearsal.displacement());
    assert_eq!(pins.issued(), figures.motor_steps);
    assert_eq!(reported.steps, figures.motor_steps);
}

/// Sends all lines.
pub fn stream(host: &mut Host<Line>, job: &Job) {
    for (index, line) in job.lines().enumerate() {
        host.send(line).unwrap_or_else(|error| panic!("{}: {error}", job.source(index + 1)));
    }
}

#[test]
fn the_image_makes_the_rehearsed_steps() {
    let job = Job::cube(LINES);
    let mut bench = Bench::boot();
    stream(&mut bench.host, &job);
    assert_eq!(bench.host.resends(), 0, "bytes were lost on a perfect serial line");
    assert_printed_as_rehearsed(bench, &job);
}

#[test]
fn corrupted_lines_are_sent_again_and_change_no_step() {
    let job = Job::cube(LINES).without_heating().without_homing();
    let mut bench = Bench::boot();
    bench.host.set_noise(Noise::new(8));
    stream(&mut bench.host, &job);
    let corrupted = bench.host.noise().unwrap().corrupted();
    assert!(corrupted >= 3, "only {corrupted} lines were corrupted");
    assert!(bench.host.resends() >= corrupted, "{} resends of {corrupted}", bench.host.resends());
    assert_printed_as_rehearsed(bench, &job);
}
