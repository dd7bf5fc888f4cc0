//! Weights and delays.

use crate::time_units::TICKS_PER_SECOND;

/// The longest filter, ticks: 100 ms. What the machine executes is later than planned by
/// no more than this.
pub const MAX_LENGTH_TICKS: u32 = TICKS_PER_SECOND / 10;

/// The most impulses of a shaper: those of three humps.
pub const MAX_IMPULSES: usize = 5;

/// An impulse of a shaper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Impulse {
    /// Share of the command; those of a kernel sum to 1.
    pub weight: f64,
    /// Delay against the command, ticks.
    pub delay_ticks: u32,
}

/// Impulses in the order of their delays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kernel {
    impulses: [Impulse; MAX_IMPULSES],
    count: usize,
}

impl Kernel {
    /// The command itself.
    pub const IDENTITY: Self = Self { impulses: [Impulse { weight: 1.0, delay_ticks: 0 }; MAX_IMPULSES], count: 1 };

    /// No impulses.
    pub(super) const EMPTY: Self = Self { count: 0, ..Self::IDENTITY };

    /// Adds an impulse, of a weight that [`Self::normalise`] puts right; at most [`MAX_IMPULSES`].
    #[cold]
    #[inline(never)]
    pub(super) fn push(&mut self, weight: f64, delay_ticks: f64) {
        if let Some(place) = self.impulses.get_mut(self.count) {
            *place = Impulse { weight, delay_ticks: (delay_ticks + 0.5) as u32 };
            self.count += 1;
        }
    }

    /// Divides the weights by their sum.
    #[cold]
    #[inline(never)]
    pub(super) fn normalise(&mut self) {
        let sum: f64 = self.impulses().iter().map(|one| one.weight).sum();
        for one in &mut self.impulses {
            one.weight /= sum;
        }
    }

    /// The impulses.
    pub fn impulses(&self) -> &[Impulse] {
        self.impulses.get(..self.count).unwrap_or_default()
    }

    /// The last delay, ticks.
    pub fn length_ticks(&self) -> u32 {
        self.impulses().last().map_or(0, |last| last.delay_ticks)
    }

    /// Mean delay, ticks: the lag at constant speed.
    pub fn centroid_ticks(&self) -> f64 {
        self.impulses().iter().map(|one| one.weight * f64::from(one.delay_ticks)).sum()
    }

    /// Variance of the delays, squared ticks: the kernel's spread of a signal.
    pub fn variance(&self) -> f64 {
        let centroid = self.centroid_ticks();
        let from_centroid = |one: &Impulse| f64::from(one.delay_ticks) - centroid;
        self.impulses().iter().map(|one| one.weight * from_centroid(one) * from_centroid(one)).sum()
    }

    /// The kernel later by `ticks`.
    pub fn delayed(mut self, ticks: u32) -> Self {
        for one in &mut self.impulses {
            one.delay_ticks = one.delay_ticks.saturating_add(ticks);
        }
        self
    }
}
