//! Keeps the place of a print on its card.
//!
//! Two rules make a place fit for resuming. **Its lines have been executed**: a place that is noted
//! when its line is read is written only after a later move has ended. **Its height is not above
//! the true one**, so that the nozzle never returns deeper than the print: where motion goes below
//! it, the lower height is written as the line is read.

use ferrostep_card::Request;
use ferrostep_gcode::Reply;
use ferrostep_hal_shim::{Clock, Heater};
use ferrostep_settings::hash_of;

use crate::job::card::Job;
use crate::job::paused::Paused;
use crate::job::power_loss::place::{Place, set_stands};
use crate::ports::{Heating, Motion, Ports, Replies};
use crate::printer::Printer;

/// A layer that begins sooner after the last place is noted later, ms: cards wear out.
const LAYER_MS: u64 = 5_000;
/// Interval between places within a layer, ms.
const LINE_MS: u64 = 30_000;

impl<P: Ports> Printer<'_, P> {
    /// Returns true if lines are being read from the card.
    pub(super) fn prints_now(&self) -> bool {
        self.print.card.job == Job::Printing
    }

    /// Prepares the card to keep the place of the print that begins (`fresh`) or continues. The
    /// print runs even if this fails.
    pub(crate) async fn begin_keeping(&mut self, fresh: bool) {
        let forgets = fresh && core::mem::take(&mut self.print.power_loss.is_offered);
        if forgets {
            self.replies.say(format_args!("echo:power loss: the print that was interrupted before is forgotten"));
        }
        let keeps = self.print.power_loss.is_on && !self.print.card.prints_prepared();
        (self.print.power_loss.is_pending, self.print.power_loss.noted_ms) = (false, None);
        self.print.power_loss.is_keeping = false;
        if self.watches_supply() && keeps && self.signals.is_supply_failing() {
            self.replies.send(Reply::Text(
                "echo:power loss: by its signal the supply fails already, so it is not watched: see power_loss in the profile",
            ));
        }
        if !keeps && !forgets {
            return;
        }
        match self.ask_card(Request::BeginKeeping { fresh }).await {
            Ok(_) => self.print.power_loss.is_keeping = keeps,
            Err(failure) => {
                self.replies.say(format_args!("echo:power loss: the place of this print is not kept: {failure}"));
            }
        }
        // The nozzle of a paused print descends to its place next.
        if let Some(paused) = &self.print.paused {
            let [.., z_10nm] = paused.place_10nm;
            self.lower_kept_height(z_10nm);
        }
    }

    /// Writes the place that waited for the motors, before a line of the card, and notes this
    /// line's place if it is due.
    // In a future the compiler would keep every value in memory.
    #[inline(never)]
    pub(crate) fn keep_place(&mut self, line: u32, offset: u32, lays: bool) {
        self.print.power_loss.line = line;
        if !self.print.power_loss.is_keeping {
            return;
        }
        if self.print.power_loss.is_pending {
            if !self.motion.has_passed_line() {
                return;
            }
            self.print.power_loss.is_pending = false;
            if self.print.power_loss.is_due {
                self.write_place();
            }
        }
        let modal = &self.interpreter.modal;
        if !lays || modal.homed != [true; 3] || modal.extrusion.settings().adaptive {
            return;
        }
        let now_ms = self.clock.now_ms();
        let is_layer = modal.machine_10nm[2] != self.print.power_loss.layer_10nm;
        let least_ms = if is_layer { LAYER_MS } else { LINE_MS };
        let is_due = self.print.power_loss.noted_ms.is_none_or(|noted_ms| now_ms.saturating_sub(noted_ms) >= least_ms);
        // With a supply signal, the newest place must be at hand when the supply fails.
        if !is_due && !self.watches_supply() {
            return;
        }
        let place_10nm = self.motion.position_10nm();
        let paused = Paused {
            modal: *modal,
            place_10nm,
            targets_celsius: Heater::ALL.map(|heater| self.heating.status(heater).target_celsius),
            drawn_100pm: 0,
            load_100pm: 0,
            pushes_more: false,
            until_ms: None,
        };
        let [.., z_10nm] = place_10nm;
        if !self.note_place(z_10nm, offset, line.saturating_sub(1), paused) {
            return;
        }
        if is_due {
            self.print.power_loss.layer_10nm = self.interpreter.modal.machine_10nm[2];
            self.print.power_loss.noted_ms = Some(now_ms);
        }
        (self.print.power_loss.is_pending, self.print.power_loss.is_due) = (true, is_due);
        self.motion.watch_line(line);
    }

    /// Lowers the kept height to that of the motors, after a line of the card.
    pub(crate) fn follow_height(&mut self) {
        if self.print.power_loss.is_keeping && self.print.power_loss.stands_10nm.is_some() {
            let [.., z_10nm] = self.motion.position_10nm();
            self.lower_kept_height(z_10nm);
        }
    }

    /// Keeps the place of a paused print: the position to which it returns, and the present height
    /// of the motors.
    #[inline(never)]
    pub(super) fn keep_pause(&mut self) {
        let Some(paused) = self.print.paused.filter(|_| self.print.power_loss.is_keeping) else { return };
        if paused.modal.homed != [true; 3] {
            return;
        }
        let [.., z_10nm] = self.motion.position_10nm();
        let (offset, lines) = self.print.card.place(self.print.power_loss.line);
        // Where the place before is still being written, the next look tries again.
        self.print.power_loss.is_pending = !self.note_place(z_10nm, offset, lines, paused);
        if !self.print.power_loss.is_pending {
            self.write_place();
        }
    }

    /// Keeps the place while the print is paused, with the height to which a person moves the
    /// nozzle.
    pub(crate) fn keep_while_paused(&mut self) {
        if !self.print.power_loss.is_keeping || self.print.card.job != Job::Paused {
            return;
        }
        let [.., z_10nm] = self.motion.position_10nm();
        if self.print.power_loss.is_pending
            || self.print.power_loss.stands_10nm.is_some_and(|stands_10nm| stands_10nm != z_10nm)
        {
            self.keep_pause();
        }
    }

    /// Ends keeping together with the print. After a halt the place stays: the print can be
    /// resumed.
    pub(crate) fn end_keeping(&mut self) {
        let is_resumable = self.signals.is_halted() || core::mem::take(&mut self.print.power_loss.is_resuming);
        if self.print.power_loss.is_keeping && !is_resumable {
            self.forget_place();
        }
        (self.print.power_loss.is_keeping, self.print.power_loss.is_pending) = (false, false);
    }

    /// Notes that the card no longer keeps a place.
    pub(super) fn forget_place(&mut self) {
        (self.print.power_loss.is_keeping, self.print.power_loss.is_pending, self.print.power_loss.stands_10nm) =
            (false, false, None);
        if let Some(port) = self.print.card.port() {
            port.with(&mut |mailbox| mailbox.kept_mut().clear());
        }
        self.write_place();
    }

    /// Notes a place, to be written later; `false` if the previous one is still being written.
    fn note_place(&mut self, stands_10nm: i64, offset: u32, lines: u32, paused: Paused) -> bool {
        let mut place = Place::<<P::Motion as Motion>::Tools> {
            stands_10nm,
            offset,
            lines,
            profile: hash_of(self.profile.name),
            paused,
            fans: self.print.power_loss.fans,
            limits: self.motion.limits(),
            advance: self.motion.motion_choice().pressure_advance,
            extruder_steps: self.motion.extruder_steps_per_mm().hundred_thousandths(),
            skew: self.interpreter.skew,
            tools: self.modes.tools,
        };
        let mut is_noted = false;
        let mut failure = None;
        let has_another = self.watches_supply() && self.print.power_loss.noted_ms.is_some();
        if let Some(port) = self.print.card.port() {
            port.with(&mut |mailbox| {
                failure = mailbox.take_keep_failure();
                is_noted = failure.is_none() && !mailbox.is_keeping();
                if is_noted {
                    if has_another {
                        mailbox.set_aside();
                    }
                    place.write(mailbox.kept_mut());
                }
            });
        }
        if let Some(failure) = failure {
            self.print.power_loss.is_keeping = false;
            self.replies.say(format_args!("echo:power loss: the place of this print cannot be kept: {failure}"));
        }
        if is_noted {
            self.print.power_loss.stands_10nm = Some(stands_10nm);
        }
        is_noted
    }

    fn write_place(&self) {
        if let Some(port) = self.print.card.port() {
            port.with(&mut |mailbox| mailbox.keep());
        }
    }

    /// Prepares for the Z motors to go to this height: if it is below the kept one, the kept one is
    /// lowered before they arrive.
    fn lower_kept_height(&mut self, z_10nm: i64) {
        if self.print.power_loss.stands_10nm.is_none_or(|stands_10nm| z_10nm >= stands_10nm) {
            return;
        }
        self.print.power_loss.stands_10nm = Some(z_10nm);
        if let Some(port) = self.print.card.port() {
            let writes = !self.print.power_loss.is_pending;
            port.with(&mut |mailbox| {
                set_stands(mailbox.kept_mut(), z_10nm);
                if writes {
                    mailbox.keep();
                }
            });
        }
    }
}
