//! Speeds from their definition: the fastest ones that corners, braking and accelerating allow.
//! Nothing is kept from one move to the next; a plan with fewer moves known is made anew.

/// A move whose limits are known.
#[derive(Clone, Copy, Debug)]
pub struct Limited {
    pub length: f64,
    pub nominal: f64,
    pub acceleration: f64,
    /// Maximum speed at the start.
    pub corner: f64,
    /// Speed at a start from rest, and at an end to rest.
    pub slowest: f64,
}

/// A move's speeds and its time.
#[derive(Clone, Copy, Debug)]
pub struct Speeds {
    pub start: f64,
    pub cruise: f64,
    pub end: f64,
    pub duration_s: f64,
}

/// The speed after a distance.
fn after(speed: f64, acceleration: f64, distance: f64) -> f64 {
    (speed * speed + 2.0 * acceleration * distance).sqrt()
}

/// The speeds at the starts of moves, the first one's given, and at the end of the last.
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

/// The law between two speeds, found by halving: the largest speed whose ramps fit into the length.
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

/// The plan of moves between two rests, each made with `known` moves known, itself included.
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
