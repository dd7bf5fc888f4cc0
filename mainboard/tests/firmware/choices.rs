//! Every way to interpolate with every way to accelerate: the image's steps are the desk's.

use std::collections::BTreeSet;
use std::num::NonZeroU64;

use ferrostep::desk::{LOOK_AHEAD_BLOCKS, Mode};
use ferrostep::job::{self, JobProgress};
use ferrostep::session::{JobReplies, Session};
use ferrostep_planner::AccelerationProfile;

use crate::bench::Bench;
use crate::boards::BOARDS;
use crate::job::{Job, WAYS};
use crate::rehearsal::Rehearsal;
use crate::same_steps::{assert_printed_as_rehearsed, stream};

/// Lines of the cube before its first layer: modes, homing, the line that primes the nozzle.
const BEFORE: usize = 30;

/// Moves of the first layer that every choice makes.
const MOVES: usize = 14;

/// Instructions a second of a processor that is in time with every move in every way: one that is not makes moves slower, at
/// places that no desk knows (docs/src/overload.md).
const QUICK: NonZeroU64 = NonZeroU64::new(1_000_000_000).unwrap();

/// Layers of the gyroid whose infill every choice makes: its curves turn from along Y to along X and back with height.
const GYROID_HEIGHTS_MM: [&str; 3] = ["5", "15.2", "25"];

/// Printing moves of each, of 0.2 to 1 mm, besides what leads from a curve to the next.
const GYROID_MOVES: usize = 24;

#[track_caller]
fn assert_every_way_is_printed_as_rehearsed(job: &Job) {
    let mut bench = Bench::switch_on(&BOARDS[0], |machine| machine.set_instructions_per_second(QUICK));
    bench.host.connect().unwrap();
    stream(&mut bench.host, job);
    let choice = bench.host.ask("M796", "echo:motion ").unwrap();
    assert_eq!(choice, "echo:motion interpolation:dual-rate acceleration:s-curve-table");
    assert_printed_as_rehearsed(bench, job);
}

#[test]
fn every_method_makes_the_steps_of_the_desk() {
    assert_every_way_is_printed_as_rehearsed(&Job::cube_in_every_way(BEFORE, MOVES).without_heating());
}

/// The gyroid's infill in these ways.
fn gyroid(ways: &[&str]) -> Job {
    Job::gyroid_in(ways, &GYROID_HEIGHTS_MM, GYROID_MOVES).without_heating()
}

#[test]
fn every_method_makes_the_gyroids_steps_of_the_desk() {
    assert_every_way_is_printed_as_rehearsed(&gyroid(&WAYS));
}

#[test]
fn every_method_makes_different_steps_of_the_gyroid() {
    let different: BTreeSet<_> = WAYS.map(|way| Rehearsal::of(&gyroid(&[way])).figures.digests.step).into();
    assert_eq!(different.len(), WAYS.len());
}

/// How long the gyroid's infill takes, s.
fn motion_time_s(acceleration: AccelerationProfile, block_by_block: bool) -> f64 {
    let mut profile = ferrostep_profiles::load("cartesian").unwrap();
    profile.motion.acceleration = acceleration;
    let session = Session::new(profile, Mode::Estimate, LOOK_AHEAD_BLOCKS, (), JobReplies::new(|_: &str| {}));
    assert!(!block_by_block || session.desk().borrow_mut().plan_block_by_block());
    let mut printer = session.printer();
    // A report in the place of a choice.
    let text = gyroid(&["M796"]).text();
    session.run(job::run(&mut text.as_bytes(), &mut printer, &mut JobProgress::default(), |_| {})).unwrap();
    session.desk().borrow().figures().motion_time_s
}

#[test]
fn the_gyroids_s_curves_span_runs_of_moves() {
    let trapezoid = motion_time_s(AccelerationProfile::Trapezoid, false);
    let [runs, alone] = [false, true].map(|alone| motion_time_s(AccelerationProfile::SCurve, alone));
    eprintln!("trapezoid {trapezoid:.3} s, s-curve in runs {runs:.3} s, block by block {alone:.3} s");
    assert!(trapezoid < runs && runs < 0.95 * alone, "{trapezoid} s, {runs} s, {alone} s");
}
