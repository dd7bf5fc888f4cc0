//! Times counted into buckets while a machine runs, for a few instructions each.
//!
//! One side adds, at a priority above the one that reads; so no value is lost, although the
//! additions are not atomic. Percentiles are read off the buckets: at most half as much again as
//! the truth, never less.

use core::sync::atomic::{AtomicU32, Ordering};

/// Two buckets to each power of two that 32 bits hold.
const BUCKETS: usize = 64;

/// A histogram of times in any unit, with half-octave buckets: 0 to 1, 2, 3, 4 to 5, 6 to 7, 8 to
/// 11, 12 to 15 and so on.
#[derive(Debug)]
pub struct Histogram {
    /// Number of values that fell into each; they stay at their greatest count instead of wrapping.
    buckets: [AtomicU32; BUCKETS],
    max: AtomicU32,
}

/// The summary of a histogram.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Summary {
    /// Number of values.
    pub count: u32,
    /// Upper limit of the bucket below or in which half of them are.
    pub p50: u32,
    /// The same for 99 %.
    pub p99: u32,
    /// The same for 99.9 %.
    pub p99_9: u32,
    /// The largest, exactly.
    pub max: u32,
}

impl Default for Histogram {
    fn default() -> Self {
        Self::new()
    }
}

impl Histogram {
    /// An empty one.
    pub const fn new() -> Self {
        Self { buckets: [const { AtomicU32::new(0) }; BUCKETS], max: AtomicU32::new(0) }
    }

    /// Counts a value. For one writer: two that interrupt each other would lose some.
    #[inline(always)]
    pub fn add(&self, value: u32) {
        // The mask has no effect but spares a branch that could panic.
        let bucket = &self.buckets[bucket_of(value) & (BUCKETS - 1)];
        bucket.store(bucket.load(Ordering::Relaxed).saturating_add(1), Ordering::Relaxed);
        if value > self.max.load(Ordering::Relaxed) {
            self.max.store(value, Ordering::Relaxed);
        }
    }

    /// Forgets all values. Those that are added meanwhile may survive or not.
    pub fn clear(&self) {
        for bucket in &self.buckets {
            bucket.store(0, Ordering::Relaxed);
        }
        self.max.store(0, Ordering::Relaxed);
    }

    /// Summary at present; all zero when empty.
    pub fn summary(&self) -> Summary {
        let counts = self.buckets.each_ref().map(|bucket| bucket.load(Ordering::Relaxed));
        let max = self.max.load(Ordering::Relaxed);
        let total: u64 = counts.iter().copied().map(u64::from).sum();
        let percentile = |per_mille: u64| {
            let rank = (total * per_mille).div_ceil(1000).max(1);
            let mut sum = 0;
            for (bucket, count) in counts.iter().copied().enumerate() {
                sum += u64::from(count);
                if sum >= rank {
                    return upper_limit(bucket).min(max);
                }
            }
            max
        };
        Summary {
            count: u32::try_from(total).unwrap_or(u32::MAX),
            p50: percentile(500),
            p99: percentile(990),
            p99_9: percentile(999),
            max,
        }
    }
}

/// Number of a value's bucket: twice the exponent of its highest bit, and the bit below.
#[inline(always)]
const fn bucket_of(value: u32) -> usize {
    let exponent = 31 - (value | 1).leading_zeros();
    let half = value.wrapping_shl(1).wrapping_shr(exponent) & 1;
    (2 * exponent + half) as usize
}

/// The largest value in a bucket.
const fn upper_limit(bucket: usize) -> u32 {
    let (exponent, half) = (bucket as u32 / 2, bucket as u32 % 2);
    // In halves of the power of two, so that the highest bucket does not overflow.
    let (power, halves) = (1u64 << exponent, if half == 0 { 3 } else { 4 });
    ((power * halves / 2).saturating_sub(1) | (exponent == 0) as u64) as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn small_values_have_buckets_of_their_own() {
        assert_eq!([0, 1, 2, 3, 4, 5, 6, 7, 8, 11, 12].map(bucket_of), [0, 0, 2, 3, 4, 4, 5, 5, 6, 6, 7]);
        assert_eq!([0, 2, 3, 4, 5, 6, 7].map(upper_limit), [1, 2, 3, 5, 7, 11, 15]);
        assert_eq!((bucket_of(u32::MAX), upper_limit(63)), (63, u32::MAX));
    }

    #[test]
    fn nothing_in_nothing_out() {
        assert_eq!(Histogram::new().summary(), Summary::default());
    }

    #[test]
    fn a_full_bucket_stays_full() {
        let histogram = Histogram::new();
        histogram.buckets[bucket_of(20)].store(u32::MAX, Ordering::Relaxed);
        histogram.add(20);
        histogram.add(3);
        let Summary { count, p50, max, .. } = histogram.summary();
        assert_eq!((count, p50, max), (u32::MAX, 20, 20));
    }

    proptest! {
        #[test]
        fn a_value_is_between_the_limits_of_its_bucket(value: u32) {
            let bucket = bucket_of(value);
            prop_assert!(bucket < BUCKETS && value <= upper_limit(bucket));
            // Bucket 1 stays empty, since 0 and 1 share the first.
            let below = if bucket == 2 { 0 } else { bucket.saturating_sub(1) };
            prop_assert!(bucket == 0 || value > upper_limit(below));
            // Half as much again is the most that a percentile exceeds the value by.
            prop_assert!(u64::from(upper_limit(bucket)) < u64::from(value.max(1)) * 3 / 2 + 1);
        }

        #[test]
        fn percentiles_are_those_of_the_sorted_values_rounded_up(
            mut values in proptest::collection::vec(prop_oneof![0u32..100, any::<u32>()], 1..2000),
        ) {
            let histogram = Histogram::new();
            values.iter().for_each(|&value| histogram.add(value));
            values.sort_unstable();
            let max = values[values.len() - 1];
            let exact = |per_mille: usize| values[(values.len() * per_mille).div_ceil(1000) - 1];
            let rounded = |value| upper_limit(bucket_of(value)).min(max);
            let expected = Summary {
                count: values.len() as u32,
                p50: rounded(exact(500)),
                p99: rounded(exact(990)),
                p99_9: rounded(exact(999)),
                max,
            };
            prop_assert_eq!(histogram.summary(), expected);
            histogram.clear();
            prop_assert_eq!(histogram.summary(), Summary::default());
        }
    }
}
