//! Pausing a print: the nozzle is parked, waits for a person, and returns to its place.
//!
//! A reader of jobs uses only [`Printer::pause`], [`Printer::resume`] and [`Printer::cancel`].
//! Commands that pause a host's print (M0, M600, ...) do all of it before their `ok`, because a
//! host sends no more of its print until then; a reader that can wait by itself checks
//! [`Printer::is_paused`].

use core::pin::pin;

use ferrostep_gcode::{AxisWords, Decimal, Real, Reply};
use ferrostep_hal_shim::{Clock, Heater};
use ferrostep_planner::{Move, filament_100pm};

use crate::error::{CommandError, Failure};
use crate::job::lines::Source;
use crate::job::paused::{PauseAnswer, PauseReason, PauseWords, Paused};
use crate::ports::{Heating, Motion, Ports, Replies};
use crate::printer::Printer;
use crate::settings::profile::filament::PauseSettings;

/// Units of 10 nm in a millimetre.
const MM: i64 = 100_000;

/// Feed to the parking place and back, mm/s; the axes' own limits apply as well.
const PARK_FEED_MM_PER_S: f32 = 100.0;

impl<P: Ports> Printer<'_, P> {
    /// Returns true if a print is paused.
    pub fn is_paused(&self) -> bool {
        self.print.paused.is_some()
    }

    /// Takes a person's answer to a paused print: continue (M108, a button, or the end of its
    /// time), or push more filament.
    pub(crate) fn take_answer(&self) -> Option<PauseAnswer> {
        let paused = self.print.paused.as_ref()?;
        let is_over = paused.until_ms.is_some_and(|until_ms| self.clock.now_ms() >= until_ms);
        if is_over { Some(PauseAnswer::Continue) } else { self.signals.take_answer() }
    }

    /// Pauses after the moves accepted so far: retracts, parks the nozzle as far as the axes are
    /// homed, and tells the host. Heaters keep their targets, as long as the [heater
    /// timeout](crate::HeaterTimeout) lets them. A print that is already paused stays paused.
    ///
    /// # Errors
    /// Motion was stopped; the print is then not paused.
    pub async fn pause(&mut self, reason: PauseReason) -> Result<(), CommandError> {
        self.pause_at(reason, &PauseWords::default()).await
    }

    async fn pause_at(&mut self, reason: PauseReason, words: &PauseWords<'_>) -> Result<(), CommandError> {
        if self.is_paused() {
            return Ok(());
        }
        let park_10nm = self.park_place_10nm(&words.park)?;
        let [unload_100pm, load_100pm] = match reason {
            PauseReason::FilamentChange => self.filament_to_change_100pm(words)?,
            PauseReason::Stop | PauseReason::Pause => [0; 2],
        };
        if unload_100pm != 0 {
            self.check_extrusion_temperature()?;
        }
        self.motion.finish().await?;
        let mut paused = Paused {
            modal: self.interpreter.modal,
            place_10nm: self.motion.position_10nm(),
            targets_celsius: Heater::ALL.map(|heater| self.heating.status(heater).target_celsius),
            drawn_100pm: 0,
            load_100pm,
            pushes_more: reason == PauseReason::FilamentChange && self.profile.pause.more_10nm > 0,
            until_ms: words.longest_ms.map(|longest| self.clock.now_ms().saturating_add(longest)),
        };
        if reason != PauseReason::Stop {
            self.draw_back(&mut paused).await?;
            self.park(park_10nm).await?;
        }
        if self.is_hot_end_fan_stalled() {
            self.heating.set_target(Heater::Nozzle, 0.0);
            if self.heating.has_nozzles() {
                self.heating.set_target(Heater::Nozzle1, 0.0);
            }
        }
        if reason == PauseReason::FilamentChange {
            self.move_filament(-unload_100pm, self.profile.pause.filament_10nm_per_s).await?;
            self.motion.set_motors_enabled(1 << 3, false);
        }
        self.print.paused = Some(paused);
        self.pause_print_clock();
        // An earlier answer is not meant for this pause.
        self.signals.take_answer();
        if !self.is_returning() {
            self.tell_paused(if words.text.is_empty() { reason.text() } else { words.text });
        }
        Ok(())
    }

    /// Executes the second button of a filament change: pushes the new filament in, and more each
    /// time. Then the extruder's motor releases the filament again, and the person is asked again.
    /// Other pauses have no such button.
    ///
    /// # Errors
    /// The nozzle is too cold, or motion was stopped.
    pub(crate) async fn push_more(&mut self) -> Result<(), CommandError> {
        let Some(Paused { pushes_more: true, load_100pm, .. }) = self.print.paused else { return Ok(()) };
        self.check_extrusion_temperature()?;
        if let Some(paused) = &mut self.print.paused {
            paused.load_100pm = 0;
        }
        let more_100pm = filament_100pm(self.profile.pause.more_10nm, 100);
        self.move_filament(load_100pm.saturating_add(more_100pm), self.profile.pause.filament_10nm_per_s).await?;
        self.motion.set_motors_enabled(1 << 3, false);
        self.show_prompt(PauseReason::FilamentChange.text());
        Ok(())
    }

    /// Resumes a paused print. Heaters that are off get their targets back; when these are
    /// reached, the nozzle returns and pushes the filament back to its place. Without effect if no
    /// print is paused.
    ///
    /// # Errors
    /// Motion was stopped, an axis is no longer homed, or the nozzle is too cold because M108 ended
    /// the wait for heat. The print then stays paused, except after a halt.
    pub async fn resume(&mut self) -> Result<(), CommandError> {
        let Some(mut paused) = self.print.paused else { return Ok(()) };
        self.tell_host("//action:prompt_end");
        // Pinned in place: otherwise it would be copied, and the copy would take up stack during
        // the wait.
        pin!(self.heat_again(paused.targets_celsius)).await?;
        self.motion.finish().await?;
        let is_lost = |axis: &usize| paused.modal.homed[*axis] && !self.interpreter.modal.homed[*axis];
        if let Some(axis) = (0..3).find(is_lost) {
            return Err(CommandError::PausedUnhomed { axis });
        }
        paused.stay_where_homed(&self.interpreter.modal, self.motion.position_10nm());
        if paused.drawn_100pm != 0 || paused.load_100pm != 0 {
            self.check_extrusion_temperature()?;
        }
        self.move_filament(paused.load_100pm, self.profile.pause.filament_10nm_per_s).await?;
        if let Some(paused) = &mut self.print.paused {
            // If the return is stopped, the next try must not push a second time.
            paused.load_100pm = 0;
        }
        // A person may have moved the nozzle, even if it was not parked (M0).
        let [x, y, z] = paused.place_10nm;
        let [.., from_z] = self.motion.position_10nm();
        // Above the print first, then down.
        self.go([x, y, from_z.max(z)]).await?;
        self.go([x, y, z]).await?;
        self.push_back(&paused).await?;
        self.interpreter.modal.go_on_as(&paused.modal);
        // The skew may have changed meanwhile.
        self.interpreter.follow_plane(paused.place_10nm);
        self.print.paused = None;
        // A person has handled the filament.
        self.print.lays_lines = false;
        self.resume_print_clock();
        self.tell_host("//action:resumed");
        Ok(())
    }

    /// Discards a paused print: the nozzle stays where it is, and the filament stays retracted.
    pub fn cancel(&mut self) {
        if self.print.paused.take().is_some() {
            self.stop_print_clock(false);
            self.tell_host("//action:prompt_end");
        }
    }

    /// Executes M0, M1, M125, M226, M600 and M601. A host waits for the `ok` until a person
    /// continues. A file on the desk has no person to ask and continues at once. A card is read on
    /// when [`Self::is_paused`] returns `false`.
    pub(crate) async fn pause_command(
        &mut self,
        reason: PauseReason,
        words: &PauseWords<'_>,
    ) -> Result<(), CommandError> {
        self.pause_at(reason, words).await?;
        match self.lines.source {
            // A macro has no reader that can wait.
            Source::Card if !self.lines.is_in_macro => return Ok(()),
            Source::File => self.tell_long_pause(words.longest_ms),
            Source::Host { .. } | Source::Card => {
                self.signals.set_paused_for_user(true);
                let waited = self.answer_pause().await;
                self.signals.set_paused_for_user(false);
                if let Err(error) = waited {
                    self.cancel();
                    return Err(error);
                }
            }
        }
        self.resume().await
    }

    /// Reports that a printer would switch its heaters off in a pause of this length; reading of a
    /// file continues at once.
    fn tell_long_pause(&self, longest_ms: Option<u64>) {
        let timeout_s = self.signals.heater_timeout_s();
        let is_longer = longest_ms.is_some_and(|longest_ms| longest_ms / 1000 >= timeout_s.into());
        if is_longer && timeout_s > 0 && self.modes.targets_celsius.iter().any(|celsius| *celsius > 0.0) {
            let line = self.lines.number;
            self.replies.say(format_args!(
                "echo:line {line}: a printer switches its heaters off after {timeout_s} s of this pause (M86), and heats up \
                 again when it ends"
            ));
        }
    }

    /// Waits until a person continues the print.
    async fn answer_pause(&mut self) -> Result<(), CommandError> {
        loop {
            let until_ms = self.print.paused.as_ref().and_then(|paused| paused.until_ms);
            match self.waits().for_person(until_ms).await? {
                PauseAnswer::Continue => return Ok(()),
                PauseAnswer::PushMore => {
                    if let Err(error) = self.push_more().await {
                        self.replies.refuse(self.lines.number, &Failure::Command(error));
                    }
                }
            }
        }
    }

    fn tell_host(&self, text: &str) {
        if self.has_host() {
            self.replies.send(Reply::Text(text));
        }
    }

    fn tell_paused(&self, text: &str) {
        let line = self.lines.number;
        if !self.has_host() {
            return self
                .replies
                .say(format_args!("echo:line {line}: {text} (without a pause: a file has no one to ask)"));
        }
        self.tell_host("//action:paused");
        self.show_prompt(text);
        self.replies.say(format_args!("echo:{text}. M108 resumes"));
    }

    /// Shows the question to the person, through a host that supports prompts.
    fn show_prompt(&self, text: &str) {
        self.replies
            .say(format_args!("//action:prompt_end\n//action:prompt_begin {text}\n//action:prompt_button Continue"));
        if self.print.paused.as_ref().is_some_and(|paused| paused.pushes_more) {
            let more_mm = Real::short(self.profile.pause.more_10nm as f64 / MM as f64, 2);
            self.replies.say(format_args!("//action:prompt_button Push {more_mm} mm"));
        }
        self.tell_host("//action:prompt_show");
    }

    /// Parking place of the nozzle: X and Y from the line's words or the profile, and the height by
    /// which it rises (Z).
    fn park_place_10nm(&self, park: &AxisWords) -> Result<[i64; 3], CommandError> {
        let PauseSettings { place_10nm: [x, y], rise_10nm, .. } = self.profile.pause;
        let travel_10nm = |axis| self.interpreter.travel_10nm(axis);
        Ok([
            self.length_within_10nm('X', park.x, travel_10nm(0))?.unwrap_or(x),
            self.length_within_10nm('Y', park.y, travel_10nm(1))?.unwrap_or(y),
            self.length_within_10nm('Z', park.z, [0, PauseSettings::MAX_RISE_10NM])?.unwrap_or(rise_10nm),
        ])
    }

    /// Lengths of filament to draw out and to push in, units of 0.1 nm.
    fn filament_to_change_100pm(&self, words: &PauseWords<'_>) -> Result<[i64; 2], CommandError> {
        let [unload_10nm, load_10nm] = self.filament_lengths_10nm(words.unload, words.load)?;
        let length_100pm = |length_10nm| {
            let length_100pm = filament_100pm(length_10nm, 100);
            self.interpreter.check_filament(length_100pm).map(|()| length_100pm)
        };
        Ok([length_100pm(unload_10nm)?, length_100pm(load_10nm)?])
    }

    /// The words U and L, whose signs are ignored, or the values of M603 and the profile, units of
    /// 10 nm.
    fn filament_lengths_10nm(&self, unload: Option<Decimal>, load: Option<Decimal>) -> Result<[i64; 2], CommandError> {
        let length_10nm = |letter, word: Option<Decimal>| {
            let word = word.map(|value| Decimal::from_nanos(value.nanos().saturating_abs()));
            self.length_within_10nm(letter, word, [0, PauseSettings::MAX_FILAMENT_10NM])
        };
        let [unload_10nm, load_10nm] = self.modes.filament_10nm;
        Ok([length_10nm('U', unload)?.unwrap_or(unload_10nm), length_10nm('L', load)?.unwrap_or(load_10nm)])
    }

    /// Executes M603; without words, a query.
    pub(crate) fn filament_lengths(
        &mut self,
        unload: Option<Decimal>,
        load: Option<Decimal>,
    ) -> Result<(), CommandError> {
        if unload.is_none() && load.is_none() {
            let [unload_mm, load_mm] = self.modes.filament_10nm.map(|length| Real::short(length as f64 / MM as f64, 5));
            self.replies.say(format_args!("echo:M603 U{unload_mm} L{load_mm}"));
            return Ok(());
        }
        self.modes.filament_10nm = self.filament_lengths_10nm(unload, load)?;
        Ok(())
    }

    /// Executes M701 and M702: loads or unloads filament at the nozzle's present place, or `rise`
    /// above it.
    pub(crate) async fn load_filament(
        &mut self,
        loads: bool,
        length: Option<Decimal>,
        rise: Option<Decimal>,
    ) -> Result<(), CommandError> {
        let words = if loads {
            PauseWords { load: length, ..PauseWords::default() }
        } else {
            PauseWords { unload: length, ..PauseWords::default() }
        };
        let [unload_100pm, load_100pm] = self.filament_to_change_100pm(&words)?;
        let rise_10nm = self.length_within_10nm('Z', rise, [0, PauseSettings::MAX_RISE_10NM])?.unwrap_or(0);
        let filament_100pm = if loads { load_100pm } else { -unload_100pm };
        if filament_100pm == 0 {
            let letter = if loads { 'L' } else { 'U' };
            self.replies.say(format_args!("echo:no filament moves: give a length ({letter}, or M603 {letter})"));
            return Ok(());
        }
        self.check_extrusion_temperature()?;
        self.motion.finish().await?;
        let [x, y, z] = self.motion.position_10nm();
        if self.interpreter.modal.homed[2] && rise_10nm > 0 {
            self.go([x, y, (z + rise_10nm).min(self.profile.size_10nm[2]).max(z)]).await?;
        }
        self.move_filament(filament_100pm, self.profile.pause.filament_10nm_per_s).await?;
        self.go([x, y, z]).await
    }

    /// A word's length, units of 10 nm, which must lie within bounds.
    pub(crate) fn length_within_10nm(
        &self,
        letter: char,
        word: Option<Decimal>,
        [lower, upper]: [i64; 2],
    ) -> Result<Option<i64>, CommandError> {
        let Some(word) = word else { return Ok(None) };
        let length_10nm = self.interpreter.modal.length_10nm(word).ok_or(CommandError::TooFar)?;
        if (lower..=upper).contains(&length_10nm) {
            return Ok(Some(length_10nm));
        }
        let [value, minimum, maximum] = [length_10nm, lower, upper].map(|length| length as f64 / MM as f64);
        Err(CommandError::OutOfRange { word: letter, value, minimum, maximum })
    }

    /// Retracts the filament as G10 does, if the nozzle is hot and the filament is not retracted
    /// yet.
    async fn draw_back(&mut self, paused: &mut Paused) -> Result<(), CommandError> {
        let modal = &self.interpreter.modal;
        if modal.retracted || self.check_extrusion_temperature().is_err() {
            return Ok(());
        }
        let settings = modal.retraction;
        let filament_100pm = filament_100pm(-settings.length_10nm, 100);
        self.move_filament(filament_100pm, settings.retract_10nm_per_s).await?;
        paused.drawn_100pm = -filament_100pm;
        Ok(())
    }

    async fn push_back(&mut self, paused: &Paused) -> Result<(), CommandError> {
        let rate = self.interpreter.modal.retraction.recover_10nm_per_s;
        self.move_filament(paused.drawn_100pm, rate).await
    }

    /// Moves filament without changing E.
    pub(crate) async fn move_filament(
        &mut self,
        filament_100pm: i64,
        rate_10nm_per_s: i64,
    ) -> Result<(), CommandError> {
        if filament_100pm == 0 {
            return Ok(());
        }
        let target_10nm = self.motion.position_10nm();
        let feed_mm_per_s = rate_10nm_per_s as f32 / MM as f32;
        let request = Move { target_10nm, filament_100pm, feed_mm_per_s, line: self.lines.number, ends_move: false };
        self.motion.add(request).await?;
        self.interpreter.take_retraction(filament_100pm, target_10nm);
        Ok(self.motion.finish().await?)
    }

    /// Parks the nozzle along the homed axes: up, then aside.
    async fn park(&mut self, [park_x, park_y, lift]: [i64; 3]) -> Result<(), CommandError> {
        let homed = self.interpreter.modal.homed;
        let [x, y, z] = self.motion.position_10nm();
        let raised = if homed[2] { (z + lift).min(self.profile.size_10nm[2]).max(z) } else { z };
        self.go([x, y, raised]).await?;
        if homed[0] && homed[1] {
            self.go([park_x, park_y, raised]).await?;
        }
        Ok(())
    }

    /// Makes a move that does not belong to the print, to its end. A person's next commands start
    /// there.
    pub(crate) async fn go(&mut self, target_10nm: [i64; 3]) -> Result<(), CommandError> {
        let feed_mm_per_s = PARK_FEED_MM_PER_S;
        let request = Move { target_10nm, filament_100pm: 0, feed_mm_per_s, line: self.lines.number, ends_move: false };
        self.motion.add(request).await?;
        self.motion.finish().await?;
        self.interpreter.follow(target_10nm);
        Ok(())
    }
}
