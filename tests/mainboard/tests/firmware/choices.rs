//! Every interpolation with every acceleration: the image makes the desk's steps.

use std::collections::BTreeSet;
use std::num::NonZeroU64;

use ferrostep_planner::AccelerationProfile;
use ferrostep_session::desk::{LOOK_AHEAD_BLOCKS, MotionState};
use ferrostep_session::job::{self, JobProgress};
use ferrostep_session::{JobReplies, Session};
use ferrostep_testkit::boards::BOARDS;

use crate::firmware::bench::Bench;
use crate::firmware::job::{Job, METHODS};
use crate::firmware::rehearsal::Rehearsal;
use crate::firmware::same_steps::{assert_printed_as_rehearsed, stream};

/// Lines of the cube before its first layer: modes, homing, the line that primes the nozzle.
const BEFORE: usize = 30;

/// Moves of the first layer that every method makes.
const MOVES: usize = 14;

/// Instructions per second of a processor that is fast enough for every method: a slower one slows
/// moves down, at places that the desk cannot know (docs/src/overload.md). A faster one would not
/// await the converter's first readings.
const QUICK: NonZeroU64 = NonZeroU64::new(500_000_000).unwrap();

/// Layers of the gyroid whose infill every method makes: its curves turn from along Y to along X
/// and back with height.
const GYROID_HEIGHTS_MM: [&str; 3] = ["5", "15.2", "25"];

/// Printing moves of each method, of 0.2 to 1 mm, besides the moves between curves.
const GYROID_MOVES: usize = 24;

#[track_caller]
fn assert_every_method_is_printed_as_rehearsed(job: &Job) {
    let mut bench = Bench::switch_on(&BOARDS[0], |machine| machine.set_instructions_per_second(QUICK));
    bench.host.connect().unwrap();
    stream(&mut bench.host, job);
    let choice = bench.host.ask("M796", "echo:motion ").unwrap();
    assert_eq!(choice, "echo:motion interpolation:dual-rate acceleration:s-curve-five-segments");
    assert_printed_as_rehearsed(bench, job);
}

#[test]
fn every_method_makes_the_rehearsed_steps() {
    assert_every_method_is_printed_as_rehearsed(
        &Job::cube_with_every_method(BEFORE, MOVES).without_heating().without_homing(),
    );
}

/// The gyroid's infill with these methods.
fn gyroid(methods: &[&str]) -> Job {
    Job::gyroid_with(methods, &GYROID_HEIGHTS_MM, GYROID_MOVES).without_heating().without_homing()
}

#[test]
fn every_method_makes_the_rehearsed_steps_of_the_gyroid() {
    assert_every_method_is_printed_as_rehearsed(&gyroid(&METHODS));
}

#[test]
fn every_method_makes_different_steps_of_the_gyroid() {
    let different: BTreeSet<_> = METHODS.map(|method| Rehearsal::of(&gyroid(&[method])).figures.digests.step).into();
    assert_eq!(different.len(), METHODS.len());
}

/// The duration of the gyroid's infill, s.
fn motion_time_s(acceleration: AccelerationProfile, block_by_block: bool) -> f64 {
    let mut profile = ferrostep_profiles::load("cartesian").unwrap();
    profile.motion.acceleration = acceleration;
    let session = Session::estimate(profile, LOOK_AHEAD_BLOCKS, JobReplies::new(|_: &str| {}));
    assert!(!block_by_block || session.desk().plan_block_by_block());
    let mut printer = session.printer();
    // M796 without a choice only reports.
    let text = gyroid(&["M796"]).text();
    session.run(job::run(&mut text.as_bytes(), &mut printer, &mut JobProgress::default(), |_| {})).unwrap();
    session.figures().motion_time_s
}

#[test]
fn s_curves_of_the_gyroid_span_several_moves() {
    let trapezoid = motion_time_s(AccelerationProfile::Trapezoid, false);
    let [runs, alone] = [false, true].map(|alone| motion_time_s(AccelerationProfile::SCurve, alone));
    eprintln!("trapezoid {trapezoid:.3} s, s-curve in runs {runs:.3} s, block by block {alone:.3} s");
    assert!(trapezoid < runs && runs < 0.95 * alone, "{trapezoid} s, {runs} s, {alone} s");
}
