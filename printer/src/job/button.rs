//! The button of a board, such as the one in a display's knob: it resumes a print that
//! waits for a person.

use crate::job::debounce::Debounce;
use crate::signals::Signals;

/// A contact bounces for no longer than this, ms.
const BOUNCE_MS: u32 = 20;

/// Watches a button, freed of bounces.
#[derive(Clone, Copy, Debug, Default)]
pub struct ButtonWatch {
    is_pressed: bool,
    debounce: Debounce,
}

impl ButtonWatch {
    /// The button is not pressed.
    pub const fn new() -> Self {
        Self { is_pressed: false, debounce: Debounce::new() }
    }

    /// Looks at the contact; to be called every few milliseconds with its present state and a clock
    /// of milliseconds that may wrap. A press answers as a prompt's first button does (M876 S0);
    /// while nothing waits for a person it has no effect.
    pub fn look(&mut self, now_ms: u32, is_pressed: bool, signals: &Signals) {
        if self.debounce.has_settled(now_ms, is_pressed, self.is_pressed, BOUNCE_MS) {
            self.is_pressed = is_pressed;
            if is_pressed {
                signals.answer_prompt(0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::job::paused::PauseAnswer;

    #[test]
    fn a_press_answers_once_whatever_bounces() {
        let signals = Signals::new();
        let mut watch = ButtonWatch::new();
        let mut answers = 0;
        // From 50 ms to 250 ms, with bounces of a few milliseconds at both ends, and a spike later.
        let is_pressed = |ms: u32| match ms {
            50..60 | 250..260 => ms % 4 < 2,
            60..250 => true,
            400..410 => true,
            _ => false,
        };
        for ms in (0..600).step_by(2) {
            watch.look(u32::MAX.wrapping_sub(100).wrapping_add(ms), is_pressed(ms), &signals);
            answers += usize::from(signals.take_answer() == Some(PauseAnswer::Continue));
        }
        assert_eq!(answers, 1);
    }
}
