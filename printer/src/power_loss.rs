//! A print from the card survives a power cut: M413 and M1000.
//!
//! While it prints, its place is kept on the card (`keep`): what a print needs to go on (`place`), from the beginning of a line
//! that the motors have reached. After a reset `resume` takes it there.

mod at_failure;
mod keep;
mod place;
mod resume;
mod signal;

use ferrostep_gcode::{CardCommand, InterruptedPrint, Reply};
use ferrostep_hal_shim::FanOutput;

use crate::ports::{Ports, Replies};
use crate::printer::Printer;
pub use signal::{SUPPLY_FAILS, SupplySignal, SupplyWatch};

/// The prompt's buttons go on with the interrupted print, or give it up.
pub(crate) static RESUME: CardCommand<'static> = CardCommand::Interrupted(InterruptedPrint::Resume);
pub(crate) static FORGET: CardCommand<'static> = CardCommand::Interrupted(InterruptedPrint::Discard);

/// What is known of an interrupted print, and of the place that is kept of the present one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PowerLoss {
    /// M413.
    is_on: bool,
    /// The card has an interrupted print.
    is_offered: bool,
    /// M1000 is to be done.
    is_resuming: bool,
    /// The card keeps the place of the present print.
    is_keeping: bool,
    /// The place that waits for the motors is to be written when they have passed it, and not only if the supply fails.
    is_due: bool,
    /// A place waits for the motors, or that of a pause for the next look at the hosts, before it is written.
    is_pending: bool,
    /// Where the newest place says that the motors of Z stand, units of 10 nm; `None`: no place is known for this machine as it stands.
    stands_10nm: Option<i64>,
    /// When the newest place that is due was noted, ms; `None`: none in this print.
    noted_ms: Option<u64>,
    /// Z of the line that began there, units of 10 nm.
    layer_10nm: i64,
    /// The line of the card that was read last.
    line: u32,
    /// What commands have set the fans to.
    fans: [u8; FanOutput::COUNT],
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

    /// The print is paused: its place is kept at the next look at the hosts, far from the deepest part of the stack.
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

impl<P: Ports> Printer<'_, P> {
    /// M413.
    pub(crate) async fn keep_prints(&mut self, on: Option<bool>) {
        let Some(on) = on else {
            let state = if self.power_loss.is_on { "ON" } else { "OFF" };
            let supply = match self.signals.is_supply_failing() {
                _ if !self.watches_supply() => "",
                true => "; the supply fails by its signal",
                false => "; the supply is right by its signal",
            };
            return self.replies.say(format_args!("echo:Power-loss recovery {state}{supply}"));
        };
        self.power_loss.is_on = on;
        // A file on the desk has no power to lose.
        if !self.card.is_there() && on && self.has_host() {
            let text = "echo:power loss: the board has no slot for a card, and only prints from a card are kept";
            return self.replies.send(Reply::Text(text));
        }
        if self.power_loss.is_keeping && !on {
            self.forget_place();
        } else if self.prints_now() && on && !self.power_loss.is_keeping {
            self.begin_keeping(true).await;
        }
    }
}
