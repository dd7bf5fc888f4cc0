//! The board's button, polled by the planner task every 2 ms.

use ferrostep_printer::{ButtonWatch, Signals};
use ferrostep_stm32f4_board::board::is_triggered;

use crate::wiring::BUTTON;

/// Reads the button, on a board that has one.
pub struct Button(ButtonWatch);

impl Button {
    /// The initial state: not pressed.
    pub const fn new() -> Self {
        Self(ButtonWatch::new())
    }

    /// Polls the button. The millisecond clock may wrap.
    pub fn look(&mut self, now_ms: u32, signals: &Signals) {
        if let Some(pin) = BUTTON {
            self.0.look(now_ms, is_triggered(pin), signals);
        }
    }
}
