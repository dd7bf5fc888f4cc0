//! The filtered path in f64, and how far it is from the programmed one.

use ferrostep_planner::{AxisShaper, Move, PlannedBlock, ShaperKind, TICKS_PER_SECOND, smooth_ticks};
use ferrostep_simulator::shapers::{Impulse, Shaper};

use crate::textbook::trapezoid;

/// X, Y, Z and the filament.
pub type Place = [f64; 4];

/// A part of the plan at a constant acceleration on one straight line.
#[derive(Clone, Copy, Debug)]
struct Piece {
    start_s: f64,
    from: Place,
    speed: Place,
    acceleration: Place,
    /// Integral of the place up to the start.
    sum: Place,
}

/// The plan as pieces in time, from rest to rest.
pub struct Plan {
    pieces: Vec<Piece>,
    end_s: f64,
    /// Ends of the moves, the start first, and when the plan passes them.
    pub corners: Vec<([f64; 3], f64)>,
}

fn place(one: &Move) -> [f64; 3] {
    one.target_10nm.map(|units| units as f64 * 1e-5)
}

fn distance(one: [f64; 3], other: [f64; 3]) -> f64 {
    one.iter().zip(other).map(|(one, other)| (one - other) * (one - other)).sum::<f64>().sqrt()
}

impl Plan {
    pub fn new(moves: &[Move], blocks: &[PlannedBlock]) -> Self {
        let mut plan = Self { pieces: Vec::new(), end_s: 0.0, corners: vec![([0.0; 3], 0.0)] };
        let (mut from, mut sum, mut next) = ([0.0; 4], [0.0; 4], 0);
        for planned in blocks {
            let parts = trapezoid(planned);
            // The moves of a block: its line is the last one's.
            let first = next;
            next = planned.block.line as usize;
            let lengths: Vec<f64> = (first..next)
                .map(|index| {
                    let start = if index == 0 { [0.0; 3] } else { place(&moves[index - 1]) };
                    let length = distance(start, place(&moves[index]));
                    if length == 0.0 { moves[index].filament_100pm.unsigned_abs() as f64 * 1e-7 } else { length }
                })
                .collect();
            let exact: f64 = lengths.iter().sum();
            let scale = exact / planned.block.length_mm();
            // Walks along the block, cut at the ends of parts and moves.
            let (mut index, mut left_mm) = (first, lengths[0]);
            let mut start_s = plan.end_s;
            for (number, [lasts, entry, acceleration]) in parts.iter().enumerate() {
                let (mut speed, acceleration) = (entry * scale, acceleration * scale);
                let mut left_s = *lasts;
                loop {
                    let is_last = number + 1 == parts.len() && index + 1 == next;
                    let goes = speed * left_s + 0.5 * acceleration * left_s * left_s;
                    let ends_move = goes > left_mm && index + 1 < next;
                    let time = if ends_move {
                        let root = (speed * speed + 2.0 * acceleration * left_mm).max(0.0).sqrt();
                        2.0 * left_mm / (speed + root)
                    } else {
                        left_s
                    };
                    let start = if index == 0 { [0.0; 3] } else { place(&moves[index - 1]) };
                    let target = place(&moves[index]);
                    let length = lengths[index - first];
                    let filament = moves[index].filament_100pm as f64 * 1e-7;
                    let share = [
                        (target[0] - start[0]) / length,
                        (target[1] - start[1]) / length,
                        (target[2] - start[2]) / length,
                        filament / length,
                    ];
                    let piece = Piece {
                        start_s,
                        from,
                        speed: share.map(|share| share * speed),
                        acceleration: share.map(|share| share * acceleration),
                        sum,
                    };
                    plan.pieces.push(piece);
                    (from, sum) = piece.end(time);
                    start_s += time;
                    left_s -= time;
                    left_mm -= speed * time + 0.5 * acceleration * time * time;
                    speed += acceleration * time;
                    if !ends_move {
                        if is_last {
                            plan.corners.push((target, start_s));
                        }
                        break;
                    }
                    plan.corners.push((target, start_s));
                    index += 1;
                    left_mm = lengths[index - first];
                }
            }
            plan.end_s = start_s;
        }
        assert_eq!(next, moves.len());
        let last = moves.last().map_or([0.0; 3], place);
        assert!(distance([from[0], from[1], from[2]], last) < 1e-3, "{from:?} {last:?}");
        plan.pieces.push(Piece { start_s: plan.end_s, from, speed: [0.0; 4], acceleration: [0.0; 4], sum });
        plan
    }

    pub fn end_s(&self) -> f64 {
        self.end_s
    }

    fn piece(&self, time_s: f64) -> &Piece {
        let after = self.pieces.partition_point(|piece| piece.start_s <= time_s);
        &self.pieces[after.max(1) - 1]
    }

    /// Place, integral of the place, and speed of an axis.
    fn at(&self, axis: usize, time_s: f64) -> [f64; 3] {
        let piece = self.piece(time_s);
        // Everything is at rest at 0 before the start.
        let time = if time_s < 0.0 { return [0.0; 3] } else { time_s - piece.start_s };
        let (from, speed, acceleration) = (piece.from[axis], piece.speed[axis], piece.acceleration[axis]);
        [
            from + time * (speed + 0.5 * acceleration * time),
            piece.sum[axis] + time * (from + time * (0.5 * speed + acceleration * time / 6.0)),
            speed + acceleration * time,
        ]
    }
}

impl Piece {
    fn end(&self, time: f64) -> (Place, Place) {
        let mut ends = (self.from, self.sum);
        for axis in 0..4 {
            let (from, speed, acceleration) = (self.from[axis], self.speed[axis], self.acceleration[axis]);
            ends.0[axis] = from + time * (speed + 0.5 * acceleration * time);
            ends.1[axis] = self.sum[axis] + time * (from + time * (0.5 * speed + acceleration * time / 6.0));
        }
        ends
    }
}

/// The filters: impulses around a mean of 0, and a moving average.
pub struct Filters {
    impulses: [Vec<Impulse>; 4],
    pub average_s: f64,
    /// Reach of the filters, s.
    pub reach_s: f64,
}

impl Filters {
    pub fn new(shapers: &[AxisShaper; 2], smooth_time_s: Option<f64>) -> Self {
        let second = f64::from(TICKS_PER_SECOND);
        let impulses = |axis: &AxisShaper| {
            let AxisShaper { kind, frequency_hz, damping } = *axis;
            let shaper = match kind {
                ShaperKind::None => Shaper::identity(),
                kind => Shaper::new(kind.to_string().parse().unwrap(), frequency_hz, damping).unwrap(),
            };
            shaper.centred().impulses().to_vec()
        };
        let alone = vec![Impulse { weight: 1.0, delay_s: 0.0 }];
        let impulses = [impulses(&shapers[0]), impulses(&shapers[1]), alone.clone(), alone];
        let average_s = smooth_ticks(smooth_time_s).unwrap() as f64 / second;
        let farthest = impulses.iter().flatten().map(|one| one.delay_s.abs()).fold(0.0, f64::max);
        Self { impulses, average_s, reach_s: farthest + 0.5 * average_s }
    }

    /// The filtered place of X, Y and Z.
    pub fn place(&self, plan: &Plan, time_s: f64) -> [f64; 3] {
        [0, 1, 2].map(|axis| {
            let at = |delay_s: f64| {
                let half = 0.5 * self.average_s;
                if half == 0.0 {
                    return plan.at(axis, time_s - delay_s)[0];
                }
                let [begin, end] = [-half, half].map(|by| plan.at(axis, time_s - delay_s + by)[1]);
                (end - begin) / self.average_s
            };
            self.impulses[axis].iter().map(|one| one.weight * at(one.delay_s)).sum()
        })
    }

    /// Delays after the plan at which the filtered path bends.
    pub fn delays_s(&self) -> Vec<f64> {
        let half = 0.5 * self.average_s;
        self.impulses[..3].iter().flatten().flat_map(|one| [one.delay_s - half, one.delay_s + half]).collect()
    }

    /// The filtered accelerations of X and Y, and of the filament; of a filter with
    /// a moving average.
    pub fn accelerations(&self, plan: &Plan, time_s: f64) -> ([f64; 2], f64) {
        let half = 0.5 * self.average_s;
        let of = |axis: usize| -> f64 {
            let change = |delay_s: f64| {
                let [begin, end] = [-half, half].map(|by| plan.at(axis, time_s - delay_s + by)[2]);
                (end - begin) / self.average_s
            };
            self.impulses[axis].iter().map(|one| one.weight * change(one.delay_s)).sum()
        };
        ([of(0).abs(), of(1).abs()], of(3).abs())
    }
}

/// Distance of a place from a line between two others.
pub fn from_line(place: [f64; 3], from: [f64; 3], to: [f64; 3]) -> f64 {
    let along = [to[0] - from[0], to[1] - from[1], to[2] - from[2]];
    let length_squared: f64 = along.iter().map(|one| one * one).sum();
    let into = [place[0] - from[0], place[1] - from[1], place[2] - from[2]];
    let share = if length_squared > 0.0 {
        (along.iter().zip(into).map(|(one, other)| one * other).sum::<f64>() / length_squared).clamp(0.0, 1.0)
    } else {
        0.0
    };
    distance(place, [from[0] + share * along[0], from[1] + share * along[1], from[2] + share * along[2]])
}
