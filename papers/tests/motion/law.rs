//! The textbook time law.

use ferrostep_planner::PlannedBlock;

/// The textbook trapezoid in f64, independent of the planner's own: the share of the path after a
/// time.
pub struct Law {
    ramps: [(f64, f64, f64); 3],
    pub length: f64,
}

impl Law {
    pub fn new(planned: &PlannedBlock) -> Self {
        let (v1, v2) = (planned.entry.mm_per_s(), planned.exit.mm_per_s());
        let v = planned.block.nominal.mm_per_s().max(v1).max(v2);
        let (a, s) = (planned.block.acceleration.mm_per_s2(), planned.block.length_mm());
        let peak = ((2.0 * a * s + v1 * v1 + v2 * v2) / 2.0).sqrt().min(v).max(v1).max(v2);
        let up = ((peak * peak - v1 * v1) / (2.0 * a)).min(s);
        let down = ((peak * peak - v2 * v2) / (2.0 * a)).min(s - up);
        let cruise = s - up - down;
        let time = |length: f64, from: f64, to: f64| if length > 0.0 { 2.0 * length / (from + to) } else { 0.0 };
        let ramps =
            [(time(up, v1, peak), v1, peak), (time(cruise, peak, peak), peak, peak), (time(down, peak, v2), peak, v2)];
        Self { ramps, length: s }
    }

    pub fn share(&self, mut t: f64) -> f64 {
        let mut s = 0.0;
        for (duration, from, to) in self.ramps {
            let part = t.clamp(0.0, duration);
            if duration > 0.0 {
                s += from * part + (to - from) / duration * part * part / 2.0;
            }
            t -= part;
        }
        (s / self.length).clamp(0.0, 1.0)
    }

    pub fn duration(&self) -> f64 {
        self.ramps.iter().map(|ramp| ramp.0).sum()
    }
}
