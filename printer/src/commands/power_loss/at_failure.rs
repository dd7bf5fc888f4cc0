//! The supply fails while a module feeds the board for some seconds more: the place of the print
//! goes to the card at once.

use embedded_hal_async::delay::DelayNs;
use ferrostep_gcode::Reply;

use crate::job::power_loss::place::set_stands;
use crate::part::Part;
use crate::ports::{Heating, Motion, Ports, Replies};
use crate::printer::Printer;

/// Maximum time for the card to write the place, ms: a card takes up to 250 ms for a block.
const CARD_MS: u32 = 500;

/// Result of writing the place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Outcome {
    /// The place is on the card.
    Kept,
    /// The card may have an older place.
    Before,
    /// The card has failed.
    Failed,
}

impl<P: Ports> Printer<'_, P> {
    /// Returns true if a supply signal is watched.
    pub(super) fn watches_supply(&self) -> bool {
        <P::Motion as Motion>::SupplySignal::PRESENT && self.profile.supply_signal.is_some()
    }

    /// Returns true if the supply has failed since [`Self::keep_at_failure`]; motion was stopped,
    /// and heaters are off.
    pub(crate) fn has_supply_failed(&self) -> bool {
        self.watches_supply() && self.signals.has_supply_failed()
    }

    /// Saves the print's place when the supply fails while the card prints, and halts the machine.
    pub(crate) async fn keep_at_failure(&mut self) {
        if !self.has_supply_failed() {
            return;
        }
        self.signals.take_supply_failure();
        // Done first, before anything else takes time.
        self.heating.all_off();
        self.stop_motion();
        let mut outcome = self.begin_last_place();
        self.until_written(&mut outcome).await;
        if let Some(target_10nm) = self.place_above_10nm().filter(|_| outcome == Outcome::Kept) {
            // If the rise is cut short, the height reached is the one kept.
            let _risen = self.go(target_10nm).await;
            self.follow_rise();
            self.until_written(&mut outcome).await;
        }
        self.tell_supply_failure(outcome);
        self.heating.halt();
        self.signals.halt();
        self.replies.send(Reply::Killed);
    }

    /// Waits until the card's task is done with the place.
    async fn until_written(&mut self, outcome: &mut Outcome) {
        for _ in 0..CARD_MS {
            if *outcome != Outcome::Kept || self.is_place_written(outcome) {
                return;
            }
            self.clock.delay_ms(1).await;
        }
        *outcome = Outcome::Failed;
    }

    /// Position above the print to which the nozzle rises, units of 10 nm; `None`: it stays. A
    /// paused print's nozzle has already risen.
    fn place_above_10nm(&self) -> Option<[i64; 3]> {
        let rise_10nm = self.profile.supply_signal?.rise_10nm;
        let [x, y, z] = self.motion.position_10nm();
        let [.., highest] = self.profile.size_10nm;
        (rise_10nm > 0 && !self.is_paused() && z < highest).then(|| [x, y, (z + rise_10nm).min(highest)])
    }

    /// Puts the present height of the motors into the place, and writes it again.
    fn follow_rise(&mut self) {
        let [.., z_10nm] = self.motion.position_10nm();
        if let Some(port) = self.print.card.port() {
            port.with(&mut |mailbox| {
                set_stands(mailbox.kept_mut(), z_10nm);
                mailbox.keep();
            });
        }
        self.print.power_loss.stands_10nm = Some(z_10nm);
    }

    /// Asks the card's task to write the newest place that the motors have passed, with their
    /// present height.
    #[inline(never)]
    fn begin_last_place(&mut self) -> Outcome {
        if !self.print.power_loss.is_keeping {
            return Outcome::Before;
        }
        if self.is_paused() {
            self.keep_pause();
            return Outcome::Kept;
        }
        let Some(port) = self.print.card.port().filter(|_| self.print.power_loss.noted_ms.is_some()) else {
            return Outcome::Before;
        };
        let is_passed = !self.print.power_loss.is_pending || self.motion.has_passed_line();
        let [.., z_10nm] = self.motion.position_10nm();
        let mut outcome = Outcome::Before;
        port.with(&mut |mailbox| {
            if is_passed || mailbox.take_aside() {
                set_stands(mailbox.kept_mut(), z_10nm);
                mailbox.keep();
                outcome = Outcome::Kept;
            }
        });
        (self.print.power_loss.is_pending, self.print.power_loss.stands_10nm) = (false, Some(z_10nm));
        outcome
    }

    /// Returns true if the card's task has finished with the place.
    fn is_place_written(&self, outcome: &mut Outcome) -> bool {
        let mut is_done = true;
        if let Some(port) = self.print.card.port() {
            port.with(&mut |mailbox| {
                is_done = !mailbox.is_keeping();
                if mailbox.take_keep_failure().is_some() {
                    (is_done, *outcome) = (true, Outcome::Failed);
                }
            });
        }
        is_done
    }

    fn tell_supply_failure(&self, outcome: Outcome) {
        let place = match outcome {
            Outcome::Kept => "the place of the print is kept",
            Outcome::Before => "the print is kept as it was before, if it was",
            Outcome::Failed => "the card has failed, the place is not kept",
        };
        self.replies.say(format_args!("echo:power loss: the supply fails: {place}"));
    }
}
