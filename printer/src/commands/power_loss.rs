//! M413 and M1000: a print from the card survives a power cut.
//!
//! While the card prints, its place is kept on it (`keep`): all that a print needs to continue
//! (`place`), from the beginning of a line that the motors have reached. After a reset, `resume`
//! continues from there.

mod at_failure;
mod keep;
mod resume;

use ferrostep_gcode::{CardCommand, InterruptedPrint, Reply};

use crate::ports::{Ports, Replies};
use crate::printer::Printer;

/// Commands of the prompt's buttons: resume the interrupted print, or discard it.
pub(crate) static RESUME: CardCommand<'static> = CardCommand::Interrupted(InterruptedPrint::Resume);

pub(crate) static FORGET: CardCommand<'static> = CardCommand::Interrupted(InterruptedPrint::Discard);

impl<P: Ports> Printer<'_, P> {
    /// M413.
    pub(crate) async fn keep_prints(&mut self, on: Option<bool>) {
        let Some(on) = on else {
            let state = if self.print.power_loss.is_on { "ON" } else { "OFF" };
            let supply = match self.signals.is_supply_failing() {
                _ if !self.watches_supply() => "",
                true => "; the supply fails by its signal",
                false => "; the supply is right by its signal",
            };
            return self.replies.say(format_args!("echo:Power-loss recovery {state}{supply}"));
        };
        self.print.power_loss.is_on = on;
        // A file on the desk cannot lose power.
        if !self.print.card.is_there() && on && self.has_host() {
            let text = "echo:power loss: the board has no slot for a card, and only prints from a card are kept";
            return self.replies.send(Reply::Text(text));
        }
        if self.print.power_loss.is_keeping && !on {
            self.forget_place();
        } else if self.prints_now() && on && !self.print.power_loss.is_keeping {
            self.begin_keeping(true).await;
        }
    }
}
