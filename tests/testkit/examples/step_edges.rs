//! Measures how close the edges of a trace's steps come to each other on a board whose step interrupt is as late as its image
//! allows.
//!
//! `step_edges TRACE PROFILE IMAGE.elf`: a trace of `ferrostep print --trace`, the profile that it was made with, and the
//! image of `cargo xtask firmware`.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::path::Path;
use std::{env, fs};

use ferrostep_image_code::code::Code;
use ferrostep_image_code::interrupt_time;
use ferrostep_oracle::trace::{Record, TraceReader};
use ferrostep_planner::TICKS_PER_SECOND;
use ferrostep_step_player::{BothEdges, MIN_GAP_TICKS, Pulses};
use ferrostep_testkit::step_edges::{FIRST_ENTRY_CYCLES, Lateness, play};
use ferrostep_virtual_board::CYCLES_A_TICK;

fn main() {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [trace, profile, image] = arguments.as_slice() else { panic!("arguments: TRACE PROFILE IMAGE.elf") };
    let driver = ferrostep_profiles::load(profile).expect("the profile").driver;
    let code = Code::of(Path::new(image)).expect("the image");
    let [time, _] = interrupt_time::check(&code, MIN_GAP_TICKS * CYCLES_A_TICK as u32).expect("the step interrupt");
    println!("step interrupt: {time}");
    let lateness = Lateness {
        reload_cycles: time.to_reload.uncached.into(),
        handler_cycles: u64::from(time.to_reload.cached) - FIRST_ENTRY_CYCLES,
    };
    let events = TraceReader::new(fs::File::open(trace).expect("the trace")).expect("the trace");
    let events = events.filter_map(|record| match record.expect("a record") {
        Record::Step(event) => Some(event),
        _ => None,
    });
    let pulse_ticks = (u64::from(driver.pulse_width_ns) * u64::from(TICKS_PER_SECOND)).div_ceil(1_000_000_000) as u32;
    let edges = if driver.both_edges {
        play::<BothEdges>(events, pulse_ticks, lateness)
    } else {
        play::<Pulses>(events, pulse_ticks, lateness)
    };
    let edges = edges.expect("events as far apart as the step interrupt needs them");
    let us = |cycles: u64| cycles as f64 / (f64::from(TICKS_PER_SECOND) * CYCLES_A_TICK as f64) * 1e6;
    println!(
        "{} step events, {} edges: smallest pulse {:.3} us, smallest gap {:.3} us, largest lateness {:.3} us, missed updates {}",
        edges.events,
        edges.edges,
        us(edges.smallest_pulse_cycles),
        us(edges.smallest_gap_cycles),
        us(edges.largest_lateness_cycles),
        edges.missed_updates,
    );
}
