//! Counts values in bins, to estimate percentiles without keeping the values.

/// Distribution of a quantity.
#[derive(Clone, Debug)]
pub struct Histogram {
    bin: f64,
    counts: Vec<u64>,
    count: u64,
    square_sum: f64,
    max: f64,
}

impl Histogram {
    /// Creates a histogram of `bins` bins of this width; larger values share the last bin.
    pub fn new(bin: f64, bins: usize) -> Self {
        Self { bin, counts: vec![0; bins.max(1)], count: 0, square_sum: 0.0, max: 0.0 }
    }

    /// Counts a value that is not negative.
    pub fn add(&mut self, value: f64) {
        // The cast saturates.
        let bin = ((value / self.bin) as usize).min(self.counts.len() - 1);
        self.counts[bin] += 1;
        self.count += 1;
        self.square_sum += value * value;
        self.max = self.max.max(value);
    }

    /// Returns the number of values.
    pub const fn count(&self) -> u64 {
        self.count
    }

    /// Returns the maximum value; 0 without values.
    pub const fn max(&self) -> f64 {
        self.max
    }

    /// Returns the root mean square; 0 without values.
    pub fn rms(&self) -> f64 {
        if self.count == 0 { 0.0 } else { (self.square_sum / self.count as f64).sqrt() }
    }

    /// Returns the value that this part of all values does not exceed, to within a bin.
    pub fn percentile(&self, part: f64) -> f64 {
        let wanted = (part * self.count as f64).ceil() as u64;
        let mut sum = 0;
        for (bin, count) in self.counts.iter().enumerate() {
            sum += count;
            if sum >= wanted && sum > 0 {
                let upper = (bin + 1) as f64 * self.bin;
                return if bin + 1 == self.counts.len() { self.max } else { upper.min(self.max) };
            }
        }
        self.max
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_right_to_a_bin() {
        let mut histogram = Histogram::new(0.1, 1000);
        assert_eq!((histogram.percentile(0.99), histogram.rms()), (0.0, 0.0));
        (1..=1000).for_each(|value| histogram.add(f64::from(value) / 100.0));
        assert!((histogram.percentile(0.99) - 9.9).abs() <= 0.1 + 1e-9, "{}", histogram.percentile(0.99));
        assert!((histogram.percentile(0.5) - 5.0).abs() <= 0.1 + 1e-9);
        assert_eq!(histogram.max(), 10.0);
        assert!((histogram.rms() - (1001.0 * 2001.0 / 6.0 / 1e4f64).sqrt()).abs() < 1e-9);
        // Values beyond the last bin are reported as the maximum.
        histogram.add(5000.0);
        assert_eq!(histogram.percentile(1.0), 5000.0);
    }
}
