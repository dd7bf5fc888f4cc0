//! Damages a host's bytes on the line, to test hosts and the printers that answer them.

/// Kind of damage to bytes on their way to the printer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineFault {
    /// Some bytes are lost.
    DropBytes,
    /// One bit changes in some bytes.
    FlipBits,
    /// Some lines are lost, including their line ends.
    DropLines,
    /// One bit changes in some lines. If two bits changed, the checksum would miss one pair in
    /// eight, because it XORs the bytes.
    FlipInLines,
}

impl LineFault {
    /// Returns the fault with this name; `None` for any other word.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Some(match name {
            "drop" => Self::DropBytes,
            "flip" => Self::FlipBits,
            "drop-line" => Self::DropLines,
            "flip-line" => Self::FlipInLines,
            _ => return None,
        })
    }
}

/// Parses a share of the bytes or lines, such as `1%`.
///
/// # Errors
/// The share is not from 0% to 100%.
pub fn share(text: &str) -> Result<f64, String> {
    let percent = text.strip_suffix('%').and_then(|percent| percent.parse::<f64>().ok());
    let share = percent.map(|percent| percent / 100.0).filter(|share| (0.0..=1.0).contains(share));
    share.ok_or_else(|| "write a rate from 0% to 100%".to_owned())
}

/// Line that damages the bytes it carries, in the same way in every run.
#[derive(Debug)]
pub struct DamagedLine {
    random: fastrand::Rng,
    faults: Vec<(LineFault, f64)>,
    /// True at the start of a line.
    begins: bool,
    drops_line: bool,
    /// Number of bytes before the one in which a bit changes.
    flips_after: Option<u8>,
}

/// Number of bytes at the start of a line among which one is damaged; a shorter line may arrive
/// unchanged.
const FLIPPED_BYTES: u8 = 10;

impl Default for DamagedLine {
    /// Returns a line without faults.
    fn default() -> Self {
        Self {
            random: fastrand::Rng::with_seed(1),
            faults: Vec::new(),
            begins: true,
            drops_line: false,
            flips_after: None,
        }
    }
}

impl DamagedLine {
    /// Damages a share of the bytes or lines from now on.
    pub fn add(&mut self, fault: LineFault, share: f64) {
        self.faults.push((fault, share));
    }

    /// Applies the faults to bytes on their way to the printer.
    pub fn carry(&mut self, bytes: &mut Vec<u8>) {
        if !self.faults.is_empty() {
            bytes.retain_mut(|byte| self.arrives(byte));
        }
    }

    /// Returns true if a byte arrives; the byte may have changed.
    fn arrives(&mut self, byte: &mut u8) -> bool {
        let ends = matches!(*byte, b'\n' | b'\r');
        if std::mem::replace(&mut self.begins, ends) {
            self.drops_line = self.hits(LineFault::DropLines);
            let flips = self.hits(LineFault::FlipInLines);
            self.flips_after = flips.then(|| self.random.u8(..FLIPPED_BYTES));
        }
        if self.drops_line || self.hits(LineFault::DropBytes) {
            return false;
        }
        let flips_here = self.flips_after == Some(0) && !ends;
        self.flips_after = self.flips_after.filter(|_| !ends).and_then(|after| after.checked_sub(1));
        if flips_here || self.hits(LineFault::FlipBits) {
            *byte ^= 1 << self.random.u8(..8);
        }
        true
    }

    fn hits(&mut self, fault: LineFault) -> bool {
        let share: f64 = self.faults.iter().filter(|(kind, _)| *kind == fault).map(|(_, share)| share).sum();
        share > 0.0 && self.random.f64() < share
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_damaged_at_its_rate_and_the_same_way_each_time() {
        let text = "N12 G1 X10.5 Y20 E0.4*77\n".repeat(4000);
        let carried = |fault, share| {
            let mut line = DamagedLine::default();
            line.add(fault, share);
            let mut bytes = text.clone().into_bytes();
            line.carry(&mut bytes);
            let mut again = DamagedLine::default();
            again.add(fault, share);
            // The text arrives in portions, as a host sends it.
            let portions = text.as_bytes().chunks(7).flat_map(|portion| {
                let mut portion = portion.to_vec();
                again.carry(&mut portion);
                portion
            });
            assert_eq!(portions.collect::<Vec<_>>(), bytes);
            bytes
        };
        let bytes = text.len() as f64;
        let dropped = bytes - carried(LineFault::DropBytes, 0.01).len() as f64;
        assert!((dropped / bytes - 0.01).abs() < 0.002, "{dropped}");
        let flipped = carried(LineFault::FlipBits, 0.01);
        let differ = flipped.iter().zip(text.as_bytes()).filter(|(a, b)| (*a ^ *b).count_ones() == 1).count();
        assert!((differ as f64 / bytes - 0.01).abs() < 0.002, "{differ}");
        assert_eq!(flipped.len(), text.len());
        let kept = carried(LineFault::DropLines, 0.1);
        let lines = kept.split(|byte| *byte == b'\n').filter(|line| *line == b"N12 G1 X10.5 Y20 E0.4*77").count();
        assert_eq!(lines * 25, kept.len(), "whole lines are lost");
        assert!((3500..3700).contains(&lines), "{lines}");
        assert_eq!(carried(LineFault::FlipBits, 0.0), text.as_bytes());
        let flipped = carried(LineFault::FlipInLines, 0.1);
        let pairs = flipped.chunks(25).zip(text.as_bytes().chunks(25));
        let bits =
            pairs.map(|(a, b)| a.iter().zip(b).map(|(a, b)| (a ^ b).count_ones()).sum::<u32>()).collect::<Vec<_>>();
        assert!(bits.iter().all(|bits| *bits <= 1));
        assert!((300..500).contains(&bits.iter().sum::<u32>()), "{bits:?}");
    }
}
