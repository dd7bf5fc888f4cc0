//! Detection of a stalled fan by its tachometer.

use crate::heat::sample_time::SAMPLE_MS;

/// Window in which pulses are counted, samples: 2 s, so that 30 turns a minute make two.
const WINDOW: u16 = (2_000 / SAMPLE_MS) as u16;
/// Time that a fan at full power may take to reach its speed, samples: 3 s.
const SPIN_UP: u16 = (3_000 / SAMPLE_MS) as u16;
/// Turns a minute per pulse in a window: two pulses a turn.
const RPM_A_PULSE: u32 = 60_000 / (WINDOW as u32 * SAMPLE_MS) / 2;

/// Counts a fan's pulses, and judges the fan once it has had full power for long enough. With less
/// power, a fan that is switched at its ground has no supply for its tachometer between the power
/// pulses.
#[derive(Clone, Copy, Debug)]
pub(super) struct TurnWatch {
    /// Pulse count at the beginning of the window.
    pulses: u16,
    /// Samples since then.
    samples: u16,
    /// Samples at full power, up to [`SPIN_UP`].
    full_samples: u16,
    rpm: Option<u16>,
    is_stalled: bool,
}

impl TurnWatch {
    pub const fn new() -> Self {
        Self { pulses: 0, samples: 0, full_samples: 0, rpm: None, is_stalled: false }
    }

    /// Takes a sample of the tachometer's count, modulo 2^16. A speed below `least_rpm` at full
    /// power is a fault; 0 means no bound.
    pub fn look(&mut self, least_rpm: u16, has_full_power: bool, pulses: Option<u16>) {
        let Some(pulses) = pulses else { return };
        if !has_full_power {
            self.full_samples = 0;
        }
        if self.samples == 0 {
            self.pulses = pulses;
        }
        self.samples += 1;
        if self.samples <= WINDOW {
            return;
        }
        self.samples = 0;
        let turned = u32::from(pulses.wrapping_sub(self.pulses)) * RPM_A_PULSE;
        let rpm = u16::try_from(turned).unwrap_or(u16::MAX);
        self.rpm = Some(rpm);
        if has_full_power && self.full_samples >= SPIN_UP {
            self.is_stalled = rpm < least_rpm;
        }
        if has_full_power {
            self.full_samples = self.full_samples.saturating_add(WINDOW);
        }
    }

    pub const fn rpm(&self) -> Option<u16> {
        self.rpm
    }

    /// Returns true if the fan was too slow when last judged.
    pub const fn is_stalled(&self) -> bool {
        self.is_stalled
    }
}
