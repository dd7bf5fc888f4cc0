//! Evaluates a shaped law in order of time, without searching.

use crate::law::shaped::ShapedLaw;
use crate::motion::Motion;

/// Position on a shaped law that only moves forward in time.
#[derive(Clone, Debug)]
pub struct ShapedCursor<'a> {
    shaped: ShapedLaw<'a>,
    /// Number of pieces that have begun, for each impulse.
    begun: Vec<usize>,
}

impl<'a> ShapedCursor<'a> {
    /// Creates a cursor before the law's start.
    pub fn new(shaped: ShapedLaw<'a>) -> Self {
        Self { begun: vec![0; shaped.impulses.len()], shaped }
    }

    /// Returns the next time after `time_s` at which the acceleration may change, s; infinite after
    /// the last one.
    pub fn next_breakpoint_s(&mut self, time_s: f64) -> f64 {
        self.move_to(time_s);
        let pieces = self.shaped.law.pieces();
        let mut next_s = f64::INFINITY;
        for (begun, one) in self.begun.iter().zip(self.shaped.impulses) {
            let own_s = match pieces.get(*begun) {
                Some(piece) => piece.start_s + one.delay_s,
                None => pieces.last().map_or(f64::INFINITY, |last| last.end_s() + one.delay_s),
            };
            if own_s > time_s {
                next_s = next_s.min(own_s);
            }
        }
        next_s
    }

    /// Returns the motion at a time, s, which must not be earlier than one asked for before.
    pub fn at(&mut self, time_s: f64) -> Motion {
        self.move_to(time_s);
        let mut sum = Motion::default();
        for (begun, one) in self.begun.iter().zip(self.shaped.impulses) {
            sum = sum.plus(one.weight, self.shaped.law.piece_motion(*begun, time_s - one.delay_s));
        }
        sum
    }

    fn move_to(&mut self, time_s: f64) {
        let pieces = self.shaped.law.pieces();
        for (begun, one) in self.begun.iter_mut().zip(self.shaped.impulses) {
            while pieces.get(*begun).is_some_and(|piece| piece.start_s + one.delay_s <= time_s) {
                *begun += 1;
            }
        }
    }
}
