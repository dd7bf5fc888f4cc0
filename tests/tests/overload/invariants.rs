//! Properties of every print, with any part slow.

use ferrostep_gcode::MotionFigures;
use ferrostep_printer::Profile;
use ferrostep_step_player::{BothEdges, Pulses, Stepping};
use ferrostep_testkit::board_model::{Board, Costs, HostLine, LOOK_AHEAD_BLOCKS, Watch, with_board};
use ferrostep_virtual_board::CYCLES_A_TICK;

/// The result of a print.
pub struct Print {
    pub figures: MotionFigures,
    pub counted_steps: [i64; 4],
    pub watch: Watch,
    pub feeds: Vec<f64>,
}

/// Speeds of the planner, the costs and the host.
#[derive(Clone)]
pub struct Speeds {
    pub look_ahead: usize,
    pub costs: Costs,
    pub host: HostLine,
}

impl Speeds {
    /// The board with a host that is never late.
    pub fn ample() -> Self {
        Self { look_ahead: LOOK_AHEAD_BLOCKS, costs: Costs::BOARD, host: HostLine::steady(1_000_000) }
    }

    pub fn with_host(host: HostLine) -> Self {
        Self { host, ..Self::ample() }
    }
}

pub fn profile() -> Profile {
    ferrostep_profiles::load("corexy").unwrap()
}

/// Prints a text with either kind of step signals and checks what no slowness may change.
#[track_caller]
pub fn print(profile: &Profile, text: &str, speeds: &Speeds) -> Print {
    let host = || speeds.host.clone();
    let edges = with_board::<BothEdges, _>(profile, speeds.look_ahead, speeds.costs, |board| {
        printed(board, profile, text, host())
    });
    let pulses = with_board::<Pulses, _>(profile, speeds.look_ahead, speeds.costs, |board| {
        printed(board, profile, text, host())
    });
    assert_eq!(edges.counted_steps, pulses.counted_steps);
    pulses
}

#[track_caller]
fn printed<M: Stepping>(board: &Board<'_, M>, profile: &Profile, text: &str, mut host: HostLine) -> Print {
    assert_eq!(board.print(text, &mut host), Ok(()));
    // A host waits for its turn, and hears that the board is busy.
    let replies = board.replies();
    assert!(replies.iter().all(|reply| reply == "echo:busy: processing"), "{replies:?}");
    let figures = board.figures();
    let [x, y, z, extruder] = board.counted_steps();
    assert_eq!(board.motor_steps(), [x, y, z, extruder]);
    let (end_10nm, filament_mm) = end_of(text);
    assert_eq!(board.position_10nm(), end_10nm);
    assert_eq!([x, y, z], profile.geometry().motor_steps(end_10nm).map(i64::from));
    let wanted = filament_mm * profile.steps_per_mm[3].to_f64();
    assert!((extruder as f64 - wanted).abs() <= 1.0, "{extruder} extruder steps for {wanted}");
    let least = u64::from(profile.minimum_event_interval_ticks) * CYCLES_A_TICK;
    assert!(board.shortest_interval() >= least, "{} cycles between steps", board.shortest_interval());
    assert_eq!((figures.refused_entries, figures.missed_updates), (0, 0));
    let watch = board.watch();
    Print { figures, counted_steps: [x, y, z, extruder], feeds: watch.feeds(&profile.geometry()), watch }
}

/// End of a text of absolute moves with relative filament, units of 10 nm, and all
/// its filament, mm.
fn end_of(text: &str) -> ([i64; 3], f64) {
    let mut end = [0; 3];
    let mut filament = 0.0;
    for word in text.lines().filter(|line| line.starts_with("G1")).flat_map(|line| line.split(' ')) {
        let Ok(value) = word[1..].parse::<f64>() else { continue };
        match &word[..1] {
            "X" => end[0] = (value * 100_000.0).round() as i64,
            "Y" => end[1] = (value * 100_000.0).round() as i64,
            "E" => filament += value,
            _ => {}
        }
    }
    (end, filament)
}

/// Checks that the motors never stopped from speed, and that the feed never changed faster than the
/// acceleration allows.
#[track_caller]
pub fn is_smooth(print: &Print, profile: &Profile) {
    assert_eq!((print.figures.underruns, print.watch.all_stops_from_speed()), (0, 0));
    // Feeds are means of 5 ms; each end of a way is known to a step of two motors.
    let [from, to] = [0, 5];
    let steps_off = 4.0 / profile.steps_per_mm[0].to_f64() / 0.005;
    let most = profile.limits.print_acceleration_mm_per_s2 * 0.005 + steps_off;
    for (at_ms, pair) in print.feeds.windows(to + 1).enumerate() {
        let change = (pair[to] - pair[from]).abs();
        assert!(change <= most, "{change} mm/s within 5 ms at {at_ms} ms, more than {most}");
    }
}
