//! The trapezoid of a planned block, as textbooks have it, in f64.

use ferrostep_planner::PlannedBlock;

/// The parts of a block at a constant acceleration: duration, s, speed at the start, mm/s, and
/// acceleration, mm/s^2.
pub fn trapezoid(planned: &PlannedBlock) -> Vec<[f64; 3]> {
    let [entry, nominal, exit] = [planned.entry, planned.block.nominal, planned.exit].map(|speed| speed.mm_per_s());
    let length = planned.block.length_mm();
    let mut a = planned.block.acceleration.mm_per_s2();
    if (entry * entry - exit * exit).abs() >= 2.0 * a * length {
        a = (entry * entry - exit * exit).abs() / (2.0 * length);
    }
    let meet = (a * length + 0.5 * (entry * entry + exit * exit)).sqrt();
    let peak = nominal.max(entry).max(exit).min(meet.max(entry).max(exit));
    let (up, down) = ((peak - entry) / a, (peak - exit) / a);
    let ramps = 0.5 * (entry + peak) * up + 0.5 * (peak + exit) * down;
    let cruise = ((length - ramps) / peak).max(0.0);
    [[up, entry, a], [cruise, peak, 0.0], [down, peak, -a]].into_iter().filter(|[time, ..]| *time > 0.0).collect()
}
