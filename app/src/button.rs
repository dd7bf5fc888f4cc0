//! The board's button, for the planner task, which looks every 2 ms.

use ferrostep_printer::{ButtonWatch, Signals};
use ferrostep_stm32f4_board::board::is_triggered;

use crate::wiring::BUTTON;

/// Reads the button, on a board that has one.
pub struct Button(ButtonWatch);

impl Button {
    /// The button at the start: not pressed.
    pub const fn new() -> Self {
        Self(ButtonWatch::new())
    }

    /// Looks at the button. The clock of milliseconds may wrap.
    pub fn look(&mut self, now_ms: u32, signals: &Signals) {
        if let Some(pin) = BUTTON {
            self.0.look(now_ms, is_triggered(pin), signals);
        }
    }
}
