//! Watches an encoder that the filament turns.

use crate::motion::machine::pushed::{Pushed, PushedFilament};
use crate::signals::Signals;

/// Two changes of the level are one to and fro if less than this part of M412 D's length has been
/// pushed in between.
const TO_AND_FRO: u32 = 8;

/// Watches an encoder in the filament's path: each change of its level is a sign that the filament
/// moves. If the extruder pushes more new filament without a sign than M412 D allows, the filament
/// counts as missing.
///
/// A change counts when it has lasted for the profile's time, and while new filament is being
/// pushed: a change at standstill counts only if it is still there when pushing continues. If the
/// level changes back with next to no new filament in between, neither change was a sign: a piece
/// was drawn back past an edge and pushed again, with which a nozzle that is clogged would look
/// like one that prints, or the edge trembles.
#[derive(Clone, Copy, Debug, Default)]
pub struct EncoderWatch {
    /// The level that counts.
    level: bool,
    /// Time when the encoder's level began to differ from it, ms.
    since_ms: Option<u32>,
    /// Filament pushed, at most, at the last change that counted.
    changed: Pushed,
    /// The same at the last sign, and at the sign before, which is the last one if the
    /// level changes back.
    seen: [Pushed; 2],
}

impl EncoderWatch {
    /// The watch before the first sign, with no filament pushed.
    pub const fn new() -> Self {
        Self { level: false, since_ms: None, changed: Pushed::NONE, seen: [Pushed::NONE; 2] }
    }

    /// Looks at the encoder; to be called every few milliseconds with its level, the pushed
    /// filament, the extruder's steps a millimetre, the time that a level must last, and a clock of
    /// milliseconds that may wrap.
    pub fn look(
        &mut self,
        now_ms: u32,
        level: bool,
        pushed: PushedFilament,
        steps_per_mm: f32,
        debounce_ms: u16,
        signals: &Signals,
    ) {
        let PushedFilament { at_least, at_most } = pushed;
        let detection_steps = (signals.filament_detection_10nm() as f32 * (steps_per_mm / 1e5)) as u32;
        let to_and_fro_steps = detection_steps / TO_AND_FRO;
        if signals.take_filament_counts_anew() {
            // Filament that was freed may have moved on without the extruder: then its next two
            // edges can be near each other.
            self.seen = [at_most.plus(to_and_fro_steps); 2];
            self.changed = at_most.plus(to_and_fro_steps.wrapping_neg());
        }
        if level == self.level {
            self.since_ms = None;
        } else if now_ms.wrapping_sub(*self.since_ms.get_or_insert(now_ms)) >= u32::from(debounce_ms)
            && at_least != at_most
        {
            let [last, before] = self.seen;
            let is_back = at_most.steps_since(self.changed) < to_and_fro_steps;
            self.seen = if is_back { [before, last] } else { [at_most, last] };
            self.changed = at_most;
            self.level = level;
            self.since_ms = None;
        }
        let [last, _] = self.seen;
        let unseen_steps = at_least.steps_since(last);
        let is_settled = at_least.steps_since(self.changed) >= to_and_fro_steps;
        if unseen_steps < detection_steps {
            signals.set_filament_missing(false);
        } else if is_settled || unseen_steps / 2 >= detection_steps {
            signals.set_filament_missing(true);
        }
    }
}

#[cfg(test)]
mod tests;
