//! Items that wait to be written, and their effect on the machine.

use std::string::String;

use crate::item::{ModalState, PreparedMove};

/// An item that waits to be written.
#[derive(Clone, Debug)]
pub enum Waiting {
    Move(PreparedMove),
    Fan {
        line: u32,
        power: u8,
    },
    Command {
        line: u32,
        text: String,
    },
    /// Settings in force have changed.
    Modal(ModalState),
}

/// State of the machine between two items.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    pub position_10nm: [i64; 3],
    pub line: u32,
    pub feed_mm_per_s: f32,
    pub fan_power: u8,
    pub modal: ModalState,
    /// Pushed filament that E does not include yet, units of 0.1 nm times percent.
    pub rest_100pm: i64,
}

impl Place {
    pub fn pass(&mut self, item: &Waiting) {
        match item {
            Waiting::Move(next) => {
                if !next.counts {
                    self.modal.lift_10nm += i64::from(next.target[2].units()) - self.position_10nm[2];
                }
                self.position_10nm = next.target_10nm().map(i64::from);
                self.line = next.line;
                self.feed_mm_per_s = next.feed_mm_per_s;
                if next.counts {
                    let pushed = self.rest_100pm + next.filament_100pm;
                    let flow = i64::from(self.modal.flow_percent.max(1));
                    self.modal.extruder_10nm += pushed / flow;
                    self.rest_100pm = pushed % flow;
                }
            }
            Waiting::Fan { line, power } => (self.line, self.fan_power) = (*line, *power),
            Waiting::Command { line, .. } => self.line = *line,
            Waiting::Modal(modal) => self.modal = *modal,
        }
    }
}
