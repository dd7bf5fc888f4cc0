//! A paused print, and its reason.

use ferrostep_gcode::{AxisWords, Decimal};
use ferrostep_hal_shim::Heater;

use crate::motion::modal::Modal;

/// Reason why a print pauses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PauseReason {
    /// M0, M1: the print waits where it is.
    Stop,
    /// M25, M125, M226, M601: the nozzle goes aside.
    Pause,
    /// M600: the nozzle goes aside, and the extruder's motor lets the filament go.
    FilamentChange,
}

impl PauseReason {
    /// The text for a person.
    pub(crate) fn text(self) -> &'static str {
        match self {
            Self::Stop => "The print waits for you",
            Self::Pause => "The print is paused",
            Self::FilamentChange => {
                "Change the filament: its motor is off, pull the old one out and push the new one in"
            }
        }
    }
}

/// Words of a line for its pause. The profile replaces missing ones.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct PauseWords<'a> {
    /// X and Y: where the nozzle waits; Z: the rise.
    pub(crate) park: AxisWords,
    /// Filament that is drawn out; the sign has no meaning.
    pub(crate) unload: Option<Decimal>,
    /// Filament that is pushed in before the print continues; the sign has no meaning.
    pub(crate) load: Option<Decimal>,
    /// The longest wait, ms.
    pub(crate) longest_ms: Option<u64>,
    /// Text for the person; if it is empty, the reason's text.
    pub(crate) text: &'a str,
}

/// A person's answer to a pause.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PauseAnswer {
    /// *Continue*, M108, or the pause's time is over.
    Continue,
    /// The second button: more filament, if the pause has it.
    PushMore,
}

/// A paused print: the place and the state with which it resumes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Paused {
    /// The G-code's state. On resuming, the position and the way of reading words are taken from
    /// it; settings that a person has changed meanwhile (feed, limits) stay.
    pub(crate) modal: Modal,
    /// Place of the motors, units of 10 nm.
    pub(crate) place_10nm: [i64; 3],
    /// The heaters' targets, degrees Celsius.
    pub(crate) targets_celsius: [f32; Heater::COUNT],
    /// Filament drawn back, units of 0.1 nm.
    pub(crate) drawn_100pm: i64,
    /// New filament to push in before the nozzle goes back, units of 0.1 nm.
    pub(crate) load_100pm: i64,
    /// M600: the second button of its prompt pushes more filament.
    pub(crate) pushes_more: bool,
    /// Time at which it resumes by itself, ms; `None`: never.
    pub(crate) until_ms: Option<u64>,
}

impl Paused {
    /// An axis that was not homed when the print paused, and has been homed since, has other
    /// coordinates now: it stays where a person has left it.
    pub(crate) fn stay_where_homed(&mut self, now: &Modal, position_10nm: [i64; 3]) {
        for (axis, position_10nm) in position_10nm.into_iter().enumerate() {
            if now.homed[axis] && !self.modal.homed[axis] {
                self.place_10nm[axis] = position_10nm;
                self.modal.machine_10nm[axis] = now.machine_10nm[axis];
                self.modal.offset_10nm[axis] = now.offset_10nm[axis];
            }
        }
    }
}
