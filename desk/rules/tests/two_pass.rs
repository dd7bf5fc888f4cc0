//! Computes speeds from their definition: the fastest that corners, braking and accelerating allow.
//! Keeps no state from one move to the next; a plan with fewer moves known is made anew.

/// Move with known limits.
#[derive(Clone, Copy, Debug)]
pub struct Limited {
    pub length: f64,
    pub nominal: f64,
    pub acceleration: f64,
    /// Maximum speed at the start.
    pub corner: f64,
    /// Speed at a start from rest and at an end at rest.
    pub slowest: f64,
}

/// Speeds and duration of a move.
#[derive(Clone, Copy, Debug)]
pub struct Speeds {
    pub start: f64,
    pub cruise: f64,
    pub end: f64,
    pub duration_s: f64,
}

/// Returns the speed after accelerating over a distance.
fn after(speed: f64, acceleration: f64, distance: f64) -> f64 {
    (speed * speed + 2.0 * acceleration * distance).sqrt()
}

/// Returns the speeds at the starts of moves, given that of the first, and at the end of the last.
fn starts(moves: &[Limited], first: f64) -> Vec<f64> {
    let last = moves.last().unwrap();
    let mut starts: Vec<f64> = moves.iter().map(|one| one.corner.min(one.nominal)).collect();
    starts.push(last.slowest.min(last.nominal));
    for index in (1..moves.len()).rev() {
        starts[index] = starts[index].min(after(starts[index + 1], moves[index].acceleration, moves[index].length));
    }
    starts[0] = first;
    for index in 0..moves.len() {
        starts[index + 1] = starts[index + 1].min(after(starts[index], moves[index].acceleration, moves[index].length));
    }
    starts
}

/// Finds the law between two speeds by bisection: the maximum speed whose ramps fit into the
/// length.
pub fn law(one: &Limited, start: f64, end: f64) -> Speeds {
    let needed = |cruise: f64| (2.0 * cruise * cruise - start * start - end * end) / (2.0 * one.acceleration);
    let (mut low, mut high) = (start.max(end), one.nominal.max(start).max(end));
    if needed(high) <= one.length {
        low = high;
    }
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        *(if needed(middle) <= one.length { &mut low } else { &mut high }) = middle;
    }
    let ramps = (2.0 * low - start - end) / one.acceleration;
    let rest = (one.length - needed(low)).max(0.0) / low;
    Speeds { start, cruise: low, end, duration_s: ramps + rest }
}

/// Plans moves between two rests, each with `known` moves known, including itself.
pub fn plan(moves: &[Limited], known: usize) -> Vec<Speeds> {
    let mut start = moves.first().map_or(0.0, |first| first.slowest.min(first.nominal));
    let mut speeds = Vec::new();
    for index in 0..moves.len() {
        let seen = &moves[index..moves.len().min(index.saturating_add(known))];
        let end = starts(seen, start)[1];
        speeds.push(law(&moves[index], start, end));
        start = end;
    }
    speeds
}
