//! Faults on purpose: `serve --fault`.

use std::str::FromStr;
use std::time::Duration;

use ferrostep_hal_shim::Heater;
use ferrostep_virtual_board::HeaterFailure;

/// The kinds of faults, for help and errors.
pub const KINDS: &str = "nozzle-HOW or bed-HOW with HOW open, shorted, fell-out, frozen, dead or stuck-on; drop:RATE, flip:RATE, \
                         drop-line:RATE or flip-line:RATE with RATE such as 1%; card-pull or card-back";

/// A fault and its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fault {
    /// The fault.
    pub kind: FaultKind,
    /// Its time, in virtual time since the printer was switched on.
    pub at: Duration,
}

/// A fault.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FaultKind {
    /// A heater, or its thermistor.
    Heater(Heater, HeaterFailure),
    /// Bytes on their way to the printer.
    Line(LineFault, f64),
    /// The memory card is pulled out of its slot.
    CardPulled,
    /// It is put back.
    CardPutBack,
}

impl FaultKind {
    /// Whether it needs a card in the slot.
    #[must_use]
    pub const fn is_of_card(self) -> bool {
        matches!(self, Self::CardPulled | Self::CardPutBack)
    }
}

/// Damage to bytes on their way to the printer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineFault {
    /// Some bytes are lost.
    DropBytes,
    /// In some bytes a bit changes.
    FlipBits,
    /// Some lines are lost, with their ends.
    DropLines,
    /// In some lines one bit changes. Of two, the checksum misses one pair in eight, as it adds the bytes bit by bit.
    FlipInLines,
}

impl FromStr for Fault {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (kind, seconds) = text.split_once('@').unwrap_or((text, "0"));
        let seconds = seconds.parse().ok().and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
        let at = seconds.ok_or("write the time after the @ in seconds, for example nozzle-open@90")?;
        Ok(Self { kind: kind.parse()?, at })
    }
}

impl FromStr for FaultKind {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Some((fault, rate)) = text.split_once(':') {
            let fault = match fault {
                "drop" => LineFault::DropBytes,
                "flip" => LineFault::FlipBits,
                "drop-line" => LineFault::DropLines,
                "flip-line" => LineFault::FlipInLines,
                _ => return Err(format!("unknown fault, expected {KINDS}")),
            };
            let percent = rate.strip_suffix('%').and_then(|percent| percent.parse::<f64>().ok());
            let share = percent.map(|percent| percent / 100.0).filter(|share| (0.0..=1.0).contains(share));
            return share
                .map(|share| Self::Line(fault, share))
                .ok_or_else(|| "write a rate from 0% to 100%".to_owned());
        }
        match text {
            "card-pull" => return Ok(Self::CardPulled),
            "card-back" => return Ok(Self::CardPutBack),
            _ => {}
        }
        let (heater, how) = text.split_once('-').unwrap_or((text, ""));
        let heater = match heater {
            "nozzle" => Heater::Nozzle,
            "bed" => Heater::Bed,
            _ => return Err(format!("unknown fault, expected {KINDS}")),
        };
        let failure = match how {
            "open" => HeaterFailure::ThermistorOpen,
            "shorted" => HeaterFailure::ThermistorShorted,
            "fell-out" => HeaterFailure::ThermistorFellOut,
            "frozen" => HeaterFailure::ThermistorFrozen,
            "dead" => HeaterFailure::Dead,
            "stuck-on" => HeaterFailure::StuckOn,
            _ => return Err(format!("unknown fault, expected {KINDS}")),
        };
        Ok(Self::Heater(heater, failure))
    }
}

/// A line that damages what it carries, the same way each time.
#[derive(Debug)]
pub struct DamagedLine {
    random: fastrand::Rng,
    faults: Vec<(LineFault, f64)>,
    /// At the start of a line.
    begins: bool,
    drops_line: bool,
    /// Bytes of this line up to the one in which a bit changes.
    flips_after: Option<u8>,
}

/// A bit of a line changes in one of its first bytes; a shorter line arrives as it is.
const FLIPPED_BYTES: u8 = 10;

impl Default for DamagedLine {
    /// A line in order.
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
    /// Damages a share of the bytes, or lines, from now on.
    pub fn add(&mut self, fault: LineFault, share: f64) {
        self.faults.push((fault, share));
    }

    /// Carries some bytes.
    pub fn carry(&mut self, bytes: &mut Vec<u8>) {
        if !self.faults.is_empty() {
            bytes.retain_mut(|byte| self.arrives(byte));
        }
    }

    /// Whether a byte arrives; it may have changed.
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
    fn faults_are_read() {
        let fault = |text: &str| text.parse::<Fault>();
        let open = FaultKind::Heater(Heater::Nozzle, HeaterFailure::ThermistorOpen);
        assert_eq!(fault("nozzle-open"), Ok(Fault { kind: open, at: Duration::ZERO }));
        assert_eq!(fault("nozzle-open@1.5"), Ok(Fault { kind: open, at: Duration::from_millis(1500) }));
        let flips = FaultKind::Line(LineFault::FlipBits, 0.01);
        assert_eq!(fault("flip:1%@9"), Ok(Fault { kind: flips, at: Duration::from_secs(9) }));
        let pulled = Fault { kind: FaultKind::CardPulled, at: Duration::from_secs(60) };
        assert_eq!(fault("card-pull@60"), Ok(pulled));
        for text in [
            "card",
            "card-pull:1%",
            "nozzle",
            "nozzle-open@",
            "nozzle-open@-1",
            "chamber-open",
            "flip:1",
            "flip:101%",
            "drop:x%",
            "lose:1%",
        ] {
            assert!(fault(text).is_err(), "{text}");
        }
    }

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
            // In portions, as a host sends.
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
