//! Draws feed against time for slow input and for a slow planner, from the step signals of the
//! model of the board.
//!
//! ```text
//! cargo xtask feed-plot
//! ```
//!
//! writes `docs/src/images/feed-slow-input.svg` and `feed-slow-planner.svg`, and prints its counts.

use std::error::Error;
use std::fs;

use ferrostep_printer::Profile;
use ferrostep_step_player::Pulses;
use ferrostep_testkit::board_model::{Costs, HostLine, LOOK_AHEAD_BLOCKS, with_board};
use ferrostep_testkit::feed_chart::{Axes, Panel, svg};
use ferrostep_testkit::stress_file::stress_file;

/// Pieces of the file: 0.3 m, one second at full feed.
const PIECES: u32 = 6_000;

const AXES: Axes = Axes { end_ms: 2_500, most_mm_per_s: 300.0, grid: (500, 100.0) };

/// Line rates, lines/s.
const RATES: [u64; 6] = [20_000, 10_000, 3_000, 1_000, 300, 100];

/// Factors by which the planner is made slower.
const SLOWNESS: [u64; 6] = [1, 4, 8, 16, 32, 64];

/// Line rate that is fast enough for everything, lines/s.
const AMPLE: u64 = 1_000_000;

/// Draws both pictures.
///
/// # Errors
/// A file stops, or a picture cannot be written.
pub fn run() -> Result<(), Box<dyn Error>> {
    let profile = ferrostep_profiles::load("corexy")?;
    let text = stress_file(PIECES, 5);
    let panel = |label: String, costs, host| panel(&profile, &text, label, costs, host);

    let mut input = Vec::new();
    for rate in RATES {
        input.push(panel(format!("{rate} lines/s"), Costs::BOARD, HostLine::steady(rate))?);
    }
    let silence = HostLine::steady(20_000).with_silence(3_000, 500);
    input.push(panel("silent for 0.5 s".to_owned(), Costs::BOARD, silence)?);

    let mut planner = Vec::new();
    for times in SLOWNESS {
        let label = if times == 1 { "planner as it is".to_owned() } else { format!("{times} times slower") };
        planner.push(panel(label, Costs::BOARD.with_slower_planner(times, 0), HostLine::steady(AMPLE))?);
    }

    let sudden = Costs::BOARD.with_slower_planner(16, 200);
    planner.push(panel("16 times at 0.2 s".to_owned(), sudden, HostLine::steady(AMPLE))?);

    let images = crate::system::root().join("docs/src/images");
    let title = "Pieces of 0.05 mm at 300 mm/s from a slow host";
    fs::write(images.join("feed-slow-input.svg"), svg(title, &AXES, &input))?;
    let title = "Pieces of 0.05 mm at 300 mm/s with a slow planner";
    fs::write(images.join("feed-slow-planner.svg"), svg(title, &AXES, &planner))?;
    Ok(())
}

/// Prints the file and describes the result.
fn panel(profile: &Profile, text: &str, label: String, costs: Costs, mut host: HostLine) -> Result<Panel, String> {
    with_board::<Pulses, _>(profile, LOOK_AHEAD_BLOCKS, costs, |board| {
        board.print(text, &mut host).map_err(|(line, failure)| format!("line {line}: {failure}"))?;
        let (figures, watch) = (board.figures(), board.watch());
        println!(
            "{label}: {:.2} s, starvation_flushes {}, idle_flushes {}, planning_slowdowns {}, underruns {}, \
             stops from speed {}",
            watch.seconds(),
            figures.starvation_flushes,
            figures.idle_flushes,
            figures.planning_slowdowns,
            figures.underruns,
            watch.all_stops_from_speed()
        );
        let note = format!(
            "{:.2} s, {} underruns\n{} starved, {} slowed",
            watch.seconds(),
            figures.underruns,
            figures.starvation_flushes,
            figures.planning_slowdowns
        );
        Ok(Panel { label, note, feeds: watch.feeds(&profile.geometry()) })
    })
}
