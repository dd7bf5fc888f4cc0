//! An interrupted print, and the place of the present one that is kept.

pub(crate) mod place;
pub(crate) mod signal;

use ferrostep_hal_shim::FanOutput;

/// State of an interrupted print, and of the place that is kept of the present one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PowerLoss {
    /// M413.
    pub(crate) is_on: bool,
    /// The card has an interrupted print.
    pub(crate) is_offered: bool,
    /// M1000 is to be done.
    pub(crate) is_resuming: bool,
    /// The card keeps the place of the present print.
    pub(crate) is_keeping: bool,
    /// The place that waits for the motors is to be written when they have passed it, and not only
    /// if the supply fails.
    pub(crate) is_due: bool,
    /// A place waits for the motors, or that of a pause for the next look at the hosts,
    /// before it is written.
    pub(crate) is_pending: bool,
    /// Height of the motors of Z in the newest place, units of 10 nm; `None`: no place fits the
    /// machine's present position.
    pub(crate) stands_10nm: Option<i64>,
    /// Time when the newest due place was noted, ms; `None` without one in this print.
    pub(crate) noted_ms: Option<u64>,
    /// Z of the line that began there, units of 10 nm.
    pub(crate) layer_10nm: i64,
    /// The line of the card that was read last.
    pub(crate) line: u32,
    /// Powers that commands have set for the fans.
    pub(crate) fans: [u8; FanOutput::COUNT],
}

impl PowerLoss {
    pub const fn new() -> Self {
        Self {
            is_on: true,
            is_offered: false,
            is_resuming: false,
            is_keeping: false,
            is_due: false,
            is_pending: false,
            stands_10nm: None,
            noted_ms: None,
            layer_10nm: 0,
            line: 0,
            fans: [0; FanOutput::COUNT],
        }
    }

    /// The card has an interrupted print.
    pub const fn is_offered(&self) -> bool {
        self.is_offered
    }

    /// The print is paused: its place is kept at the next look at the hosts, far from the deepest
    /// part of the stack.
    pub fn note_pause(&mut self) {
        self.is_pending = true;
    }

    /// The power that commands have set for a fan is another one's now.
    pub fn move_fan(&mut self, from: FanOutput, to: FanOutput) -> u8 {
        let power = self.fans.get_mut(from.index()).map(core::mem::take).unwrap_or_default();
        self.set_fan(to, power);
        power
    }

    /// A command has set a fan.
    pub fn set_fan(&mut self, output: FanOutput, power: u8) {
        if let Some(fan) = self.fans.get_mut(output.index()) {
            *fan = power;
        }
    }
}
