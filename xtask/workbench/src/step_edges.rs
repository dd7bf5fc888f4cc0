//! Measures the distances of the edges of a trace's steps on a board whose step interrupt is as
//! late as its image allows.
//!
//! `cargo xtask step-edges TRACE PROFILE IMAGE.elf`: a trace of `ferrostep print --trace`, the
//! profile that it was made with, and the image of `cargo xtask firmware`.

use std::fs;
use std::path::PathBuf;

use ferrostep_image_code::code::Code;
use ferrostep_image_code::interrupt_time;
use ferrostep_oracle::trace::{Record, TraceReader};
use ferrostep_planner::TICKS_PER_SECOND;
use ferrostep_step_player::{BothEdges, MIN_GAP_TICKS, Pulses};
use ferrostep_testkit::step_edges::{FIRST_ENTRY_CYCLES, Lateness, play};
use ferrostep_virtual_board::CYCLES_A_TICK;

use crate::steps::Failure;

/// Arguments of `step-edges`.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// The trace, of `ferrostep print --trace`
    trace: PathBuf,
    /// The profile that it was printed with: cartesian, corexy, prusa-mini or the
    /// path of a TOML file
    profile: String,
    /// The board's image, of `cargo xtask firmware`
    image: PathBuf,
}

/// Prints the distances of the edges.
///
/// # Errors
/// A file cannot be read, or two step events are nearer to each other than the step
/// interrupt allows.
pub fn run(options: &Options) -> Result<(), Failure> {
    let driver = ferrostep_profiles::load(&options.profile).map_err(|error| error.to_string())?.driver;
    let code = Code::of(&options.image)?;
    let [time, _] = interrupt_time::check(&code, MIN_GAP_TICKS * CYCLES_A_TICK as u32)?;
    println!("step interrupt: {time}");
    let lateness = Lateness {
        reload_cycles: time.to_reload.uncached.into(),
        handler_cycles: u64::from(time.to_reload.cached) - FIRST_ENTRY_CYCLES,
    };
    let shown = |error: &dyn std::fmt::Display| format!("{}: {error}", options.trace.display());
    let trace = fs::File::open(&options.trace).map_err(|error| shown(&error))?;
    let trace = TraceReader::new(trace).map_err(|error| shown(&error))?;
    // A record that cannot be read ends the events, and is the result.
    let mut damage = None;
    let events = trace.map_while(|record| record.map_err(|error| damage = Some(shown(&error))).ok());
    let events = events.filter_map(|record| if let Record::Step(event) = record { Some(event) } else { None });
    let pulse_ticks = (u64::from(driver.pulse_width_ns) * u64::from(TICKS_PER_SECOND)).div_ceil(1_000_000_000) as u32;
    let edges = if driver.both_edges {
        play::<BothEdges>(events, pulse_ticks, lateness)
    } else {
        play::<Pulses>(events, pulse_ticks, lateness)
    };
    let edges = edges.map_err(|error| format!("{error:?}"))?;
    if let Some(damage) = damage {
        return Err(damage);
    }
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
    Ok(())
}
