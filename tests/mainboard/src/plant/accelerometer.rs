//! The accelerometer at the nozzle: the frame between motors and nozzle, and the
//! chip that feels it.

use serde::{Deserialize, Serialize};

use crate::parts::adxl345::Adxl345;
use crate::parts::frame::Mode;

/// Standard gravity, mm/s^2.
const GRAVITY_MM_PER_S2: f64 = 9806.65;

/// A wire to the chip.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum BusWire {
    Select,
    Clock,
    Data,
}

/// The accelerometer and its frame.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct WiredAccelerometer {
    /// The chip: its x, y and z are the machine's.
    pub chip: Adxl345,
    /// The frame along X and Y; `None` for one that does not give way.
    frame: [Option<Mode>; 2],
    now_ns: u64,
}

impl WiredAccelerometer {
    /// At rest.
    pub(super) fn new(chip: Adxl345, frame: [Option<Mode>; 2]) -> Self {
        Self { chip, frame, now_ns: 0 }
    }

    fn pass_to(&mut self, now_ns: u64) {
        let time_s = now_ns.saturating_sub(self.now_ns) as f64 / 1e9;
        self.frame.iter_mut().flatten().for_each(|mode| mode.advance(time_s));
        self.now_ns = self.now_ns.max(now_ns);
    }

    /// Advances time, with the samples that are due.
    pub(super) fn advance(&mut self, now_ns: u64) {
        while let Some(due_ns) = self.chip.next_sample_ns().filter(|due_ns| *due_ns <= now_ns) {
            self.pass_to(due_ns);
            let [x, y] = self.frame.map(|mode| mode.map_or(0.0, |mode| mode.acceleration_mm_per_s2()));
            self.chip.sample([x / GRAVITY_MM_PER_S2, y / GRAVITY_MM_PER_S2, 1.0]);
        }
        self.pass_to(now_ns);
    }

    /// The motors have moved X and Y to this place.
    pub(super) fn moved(&mut self, now_ns: u64, position_mm: [f64; 2]) {
        if self.frame == [None; 2] {
            return;
        }
        self.advance(now_ns);
        for (mode, position_mm) in self.frame.iter_mut().zip(position_mm) {
            if let Some(mode) = mode {
                mode.command(position_mm);
            }
        }
    }

    /// A wire's level, as the chip sees it; true if the chip's output changed.
    pub(super) fn set_wire(&mut self, now_ns: u64, wire: BusWire, level: Option<bool>) -> bool {
        self.advance(now_ns);
        let before = self.chip.output();
        match wire {
            // A module's resistors hold both high.
            BusWire::Select => self.chip.set_select(now_ns, level.unwrap_or(true)),
            BusWire::Clock => self.chip.set_clock(now_ns, level.unwrap_or(true)),
            BusWire::Data => self.chip.set_data(level.unwrap_or(false)),
        }
        self.chip.output() != before
    }
}
