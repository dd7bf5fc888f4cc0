//! Every way to interpolate with every way to accelerate: the image's steps are the desk's.

use crate::image::Bench;
use crate::job::Job;
use crate::same_steps::{assert_printed_as_rehearsed, stream};

/// Lines of the cube before its first layer: modes, homing, the line that primes the nozzle.
const BEFORE: usize = 30;

/// Moves of the first layer that every choice makes.
const MOVES: usize = 14;

#[test]
fn every_choice_makes_the_steps_that_the_desk_rehearsed() {
    let job = Job::cube_in_every_way(BEFORE, MOVES).without_heating();
    let mut bench = Bench::boot();
    stream(&mut bench.host, &job);
    let choice = bench.host.ask("M796", "echo:motion ").unwrap();
    assert_eq!(choice, "echo:motion interpolation:dual-rate acceleration:s-curve-table");
    assert_printed_as_rehearsed(bench, &job);
}
