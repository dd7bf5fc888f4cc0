//! A law after impulses and a moving average, in f64: the law summed over time, at both
//! ends of the average.

use ferrostep_simulator::law::{Law, Piece, ShapedLaw};
use ferrostep_simulator::motion::Motion;
use ferrostep_simulator::shapers::Impulse;

/// A law after impulses, each of which is averaged over the time after it.
pub struct Averaged<'a> {
    shaped: ShapedLaw<'a>,
    /// Ticks; 0: not averaged.
    ticks: f64,
    /// The position summed over time up to the start of each piece.
    sums: Vec<f64>,
}

impl<'a> Averaged<'a> {
    pub fn new(law: &'a Law, impulses: &'a [Impulse], ticks: f64) -> Self {
        let mut sums = vec![0.0];
        for piece in law.pieces() {
            sums.push(sums.last().unwrap() + summed(piece, piece.duration_s));
        }
        Self { shaped: ShapedLaw { law, impulses }, ticks, sums }
    }

    /// The position summed over time since the law's start.
    fn sum(&self, tick: f64) -> f64 {
        let pieces = self.shaped.law.pieces();
        let index = pieces.partition_point(|piece| piece.start_s <= tick);
        let Some(piece) = index.checked_sub(1).and_then(|index| pieces.get(index)) else {
            let [start, _] = self.shaped.law.ends_s();
            return self.shaped.law.at(start).position_mm * (tick - start);
        };
        let into = tick - piece.start_s;
        let within = into.min(piece.duration_s);
        let after = (into - within) * piece.at(piece.end_s()).position_mm;
        self.sums[index - 1] + summed(piece, within) + after
    }

    /// The motion at a tick.
    pub fn at(&self, tick: f64) -> Motion {
        if self.ticks == 0.0 {
            return self.shaped.at(tick);
        }
        self.shaped.impulses.iter().fold(Motion::default(), |sum, one| {
            let late = tick - one.delay_s;
            let (now, before) = (self.shaped.law.at(late), self.shaped.law.at(late - self.ticks));
            let average = Motion {
                position_mm: self.sum(late) - self.sum(late - self.ticks),
                speed_mm_per_s: now.position_mm - before.position_mm,
                acceleration_mm_per_s2: now.speed_mm_per_s - before.speed_mm_per_s,
            };
            sum.plus(one.weight / self.ticks, average)
        })
    }

    /// Every tick at which the acceleration, or without an average its jump, may change.
    pub fn breakpoints(&self) -> Vec<f64> {
        let mut ticks = self.shaped.breakpoints_s();
        if self.ticks > 0.0 {
            ticks.extend(ticks.clone().iter().map(|tick| tick + self.ticks));
        }
        ticks
    }
}

/// A piece's position summed over its first ticks.
fn summed(piece: &Piece, ticks: f64) -> f64 {
    let Motion { position_mm, speed_mm_per_s, acceleration_mm_per_s2 } = piece.motion;
    ticks * (position_mm + ticks * (0.5 * speed_mm_per_s + ticks * acceleration_mm_per_s2 / 6.0))
}
