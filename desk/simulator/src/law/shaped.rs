//! Laws of motion with a shaper applied.

use crate::law::pieces::Law;
use crate::motion::Motion;
use crate::shapers::Impulse;

/// Law with a shaper applied: the weighted sum of the law at several delays.
#[derive(Clone, Copy, Debug)]
pub struct ShapedLaw<'a> {
    /// Law before shaping.
    pub law: &'a Law,
    /// Weights and delays of the shaper.
    pub impulses: &'a [Impulse],
}

impl ShapedLaw<'_> {
    /// Returns the motion at a time, s.
    pub fn at(&self, time_s: f64) -> Motion {
        self.impulses.iter().fold(Motion::default(), |sum, one| sum.plus(one.weight, self.law.at(time_s - one.delay_s)))
    }

    /// Returns every time at which the acceleration may change, s, in order.
    pub fn breakpoints_s(&self) -> Vec<f64> {
        let mut times: Vec<f64> = Vec::with_capacity((self.law.pieces().len() + 1) * self.impulses.len());
        for one in self.impulses {
            times.extend(self.law.pieces().iter().map(|piece| piece.start_s + one.delay_s));
            times.extend(self.law.pieces().last().map(|piece| piece.end_s() + one.delay_s));
        }
        times.sort_by(f64::total_cmp);
        times
    }
}
