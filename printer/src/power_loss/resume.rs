//! An interrupted print goes on.
//!
//! Z is not homed: the nozzle stands over the print. Its height is the one that was kept; X and Y are homed above the print.

use ferrostep_card::{CardFailure, OpenedFile, Request};
use ferrostep_gcode::{AxisFlags, CardCommand, Command, InterruptedPrint, Real, Reply};
use ferrostep_hal_shim::FanOutput;

use super::place::{Place, profile_number};
use crate::card::{Job, Selected};
use crate::error::{CommandError, Failure};
use crate::fans::{FanRule, FanSettings};
use crate::paused::Paused;
use crate::ports::{Motion, Ports, Replies, Text};
use crate::printer::{Printer, Source};
use crate::profile::PauseSettings;

/// Why an interrupted print cannot go on.
enum NoWay {
    Card(CardFailure),
    /// It is not this machine's, or of another version of the firmware.
    Foreign,
    /// The machine does not stand where it stood.
    Moved,
    /// The place is not in the travel.
    Outside,
}

impl core::fmt::Display for NoWay {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Card(failure) => write!(out, "{failure}"),
            Self::Foreign => out.write_str("another machine or another version of the firmware has printed it"),
            Self::Moved => out.write_str(
                "the height of the nozzle is unknown, because the machine moved before the card was found: put the card in, then \
                 switch the printer off and on",
            ),
            Self::Outside => out.write_str("its place is outside the machine's travel"),
        }
    }
}

impl<P: Ports> Printer<'_, P> {
    /// M1000.
    pub(crate) async fn interrupted_print(&mut self, command: InterruptedPrint) -> Result<(), CommandError> {
        if self.card.job != Job::None || self.is_paused() || self.card.is_written() {
            return Err(CommandError::CardInUse);
        }
        self.card.deselect();
        let opened = self.ask_card(Request::OpenKept).await;
        match command {
            InterruptedPrint::Report => self.offer(opened.map(|_| ())),
            InterruptedPrint::Discard => {
                self.power_loss.is_offered = false;
                if opened == Err(CardFailure::NothingKept) {
                    self.replies.send(Reply::Text("echo:power loss: no interrupted print is kept"));
                } else {
                    self.forget_place();
                    self.replies.send(Reply::Text("echo:power loss: the interrupted print is forgotten"));
                    self.replies.send(Reply::Text("//action:prompt_end"));
                }
            }
            InterruptedPrint::Resume => {
                self.needs(self.equipment.end_stops, "end stops")?;
                self.needs(self.equipment.heaters, "heaters")?;
                match opened.map_err(NoWay::Card).and_then(|_| self.checked_place()) {
                    Ok(()) => return self.begin_return(),
                    Err(why) => self.refuse_return(&why),
                }
            }
        }
        let _ = self.ask_card(Request::Close).await;
        Ok(())
    }

    /// After the card was mounted: whether it has an interrupted print. Where the motors have not moved since the start, they stand as
    /// high as they did then.
    pub(crate) async fn find_interrupted_print(&mut self) {
        if self.card.job != Job::None || self.card.has_selected() {
            return;
        }
        let opened = self.ask_card(Request::OpenKept).await;
        self.power_loss.is_offered = false;
        if opened != Err(CardFailure::NothingKept) {
            self.take_kept_height();
            self.offer(opened.map(|_| ()));
            let _ = self.ask_card(Request::Close).await;
        }
    }

    /// The height of the motors is the one that was kept.
    #[inline(never)]
    fn take_kept_height(&mut self) {
        let Ok(Place { stands_10nm, .. }) = self.kept_place() else { return };
        if self.motion.position_10nm() == [0; 3] && self.interpreter.modal.homed == [false; 3] {
            self.motion.set_position([0, 0, stands_10nm]);
            self.interpreter.modal.machine_10nm[2] = self.interpreter.modal.machine_z_10nm(stands_10nm);
            self.power_loss.stands_10nm = Some(stands_10nm);
        } else if self.power_loss.stands_10nm != Some(stands_10nm) {
            self.power_loss.stands_10nm = None;
        }
    }

    /// Says which print was interrupted.
    #[inline(never)]
    fn offer(&mut self, opened: Result<(), CardFailure>) {
        if opened == Err(CardFailure::NothingKept) {
            return self.replies.send(Reply::Text("echo:power loss: no interrupted print is kept"));
        }
        self.power_loss.is_offered = true;
        match opened.map_err(NoWay::Card).and_then(|()| self.checked_place()) {
            Err(why) => self.refuse_return(&why),
            Ok(()) => {
                let Ok(Place { offset, lines, paused, .. }) = self.kept_place() else { return };
                let z_mm = Real::fixed(paused.modal.machine_10nm[2] as f64 / 100_000.0, 2);
                let size = self.with_opened(|file| file.size).unwrap_or(0);
                let name = self.kept_name();
                self.replies.say(format_args!(
                    "echo:power loss: the print of {name} was interrupted at byte {offset} of {size}, after line {lines}, at Z{z_mm}"
                ));
                self.replies.send(Reply::Text("echo:power loss: M1000 goes on with it, M1000 C forgets it"));
                self.replies.send(Reply::Text("//action:prompt_end"));
                self.replies.send(Reply::Text(
                    "//action:prompt_begin A print was interrupted. M1000 C forgets it, Continue (M1000) heats, homes X and Y and goes on",
                ));
                self.replies.send(Reply::Text("//action:prompt_button Continue"));
                self.replies.send(Reply::Text("//action:prompt_show"));
            }
        }
    }

    fn refuse_return(&self, why: &NoWay) {
        let name = self.kept_name();
        self.replies.say(format_args!("echo:power loss: the interrupted print of {name} cannot go on: {why}"));
        self.replies.send(Reply::Text("echo:power loss: M1000 C forgets it"));
    }

    /// The path of the interrupted print, as the card keeps it.
    fn kept_name(&self) -> Text {
        let mut name = Text::new();
        if let Some(port) = self.card.port() {
            port.with(&mut |mailbox| {
                name.clear();
                // Both hold any path.
                let _ = name.push_str(mailbox.page());
            });
        }
        name
    }

    /// The place that was read from the card.
    #[inline(never)]
    fn kept_place(&self) -> Result<Place, NoWay> {
        let mut place = Place {
            stands_10nm: 0,
            offset: 0,
            lines: 0,
            profile: 0,
            paused: Paused {
                modal: self.interpreter.modal,
                place_10nm: [0; 3],
                targets_celsius: [0.0; 2],
                drawn_100pm: 0,
                load_100pm: 0,
                until_ms: None,
            },
            fans: [0; FanOutput::COUNT],
            limits: self.motion.limits(),
            advance: self.motion.motion_choice().pressure_advance,
        };
        let mut is_read = false;
        if let Some(port) = self.card.port() {
            port.with(&mut |mailbox| is_read = place.read(mailbox.kept()));
        }
        if is_read && place.profile == profile_number(self.profile.name) { Ok(place) } else { Err(NoWay::Foreign) }
    }

    /// Checks the place that was read from the card.
    #[inline(never)]
    fn checked_place(&self) -> Result<(), NoWay> {
        let Place { paused, .. } = self.kept_place()?;
        if self.power_loss.stands_10nm.is_none() {
            return Err(NoWay::Moved);
        }
        let is_within = |axis: usize| {
            let [lower, upper] = [self.profile.lower_end_10nm[axis], self.profile.size_10nm[axis]];
            // A part below the bed is M290's.
            let lower = if axis == 2 { lower.min(-PauseSettings::MAX_RISE_10NM) } else { lower };
            (lower..=upper).contains(&paused.place_10nm[axis])
        };
        if !paused.modal.soft_limits || (0..3).all(is_within) { Ok(()) } else { Err(NoWay::Outside) }
    }

    fn begin_return(&mut self) -> Result<(), CommandError> {
        let Some(selected) = self.with_opened(|file: &OpenedFile| Selected::from(file)) else { return Ok(()) };
        self.card.select(selected);
        self.replies.send(Reply::Text("//action:prompt_end"));
        self.replies.send(Reply::Text("echo:power loss: the print goes on: heating, then X and Y are homed"));
        (self.power_loss.is_offered, self.power_loss.is_resuming) = (false, true);
        self.set_card_job(Job::Paused);
        Ok(())
    }

    /// Whether M1000 is to be done.
    pub(crate) fn is_returning(&self) -> bool {
        self.power_loss.is_resuming
    }

    /// Takes the nozzle back to the interrupted print, which goes on then. `false`: it cannot, and has said why.
    pub(crate) async fn return_to_print(&mut self) -> bool {
        (self.source, self.line) = (Source::Card, 0);
        self.motion.begin_command();
        self.signals.set_at_work(true);
        let lifted = self.lift_off_print().await;
        let mut outcome = lifted.map(|_| ());
        if outcome.is_ok() {
            let axes = AxisFlags { x: true, y: true, z: false, e: false };
            outcome = self.command_with_signs_of_life(&Command::Home(axes)).await.map(|_| ());
        }
        if let (Ok(()), Ok(drawn_100pm)) = (outcome, lifted) {
            outcome = self.restore_print(drawn_100pm).await;
        }
        if let Err(error) = outcome {
            self.follow_after(error);
        } else {
            let start = Command::Card(CardCommand::Start { position: None });
            outcome = self.command_with_signs_of_life(&start).await.map(|_| ());
        }
        self.signals.set_at_work(self.is_paused());
        if let Err(error) = outcome {
            self.replies.refuse(0, &Failure::Command(error));
            self.replies.send(Reply::Text("echo:power loss: the print cannot go on; M1000 tries again"));
            return false;
        }
        let goes_on = self.card.job == Job::Printing;
        self.power_loss.is_resuming = !goes_on;
        goes_on
    }

    /// Bed, then nozzle: the plastic around the nozzle melts before it rises. Returns how much filament was drawn back, units of 0.1 nm.
    async fn lift_off_print(&mut self) -> Result<i64, CommandError> {
        let Ok([nozzle_celsius, bed_celsius]) = self.kept_place().map(|place| place.paused.targets_celsius) else {
            return Ok(0);
        };
        self.heat_again([0.0, bed_celsius]).await?;
        self.heat_again([nozzle_celsius, bed_celsius]).await?;
        self.motion.finish().await?;
        self.interpreter.modal.homed[2] = true;
        let drawn_100pm = self.draw_back().await?;
        let [x, y, _] = self.motion.position_10nm();
        self.park([x, y, self.profile.pause.rise_10nm]).await?;
        Ok(drawn_100pm)
    }

    /// What lasts from line to line is as it was.
    async fn restore_print(&mut self, drawn_100pm: i64) -> Result<(), CommandError> {
        let Ok((fans, advance)) = self.kept_place().map(|place| (place.fans, place.advance)) else { return Ok(()) };
        for ((output, fan), power) in FanOutput::ALL.into_iter().zip(&self.profile.fans).zip(fans) {
            if matches!(fan, Some(FanSettings { rule: FanRule::Commanded { .. }, .. })) {
                self.power_loss.set_fan(output, power);
                self.motion.set_fan_power(output, power).await?;
            }
        }
        let mut choice = self.motion.motion_choice();
        if choice.pressure_advance != advance && advance.check().is_ok() {
            choice.pressure_advance = advance;
            self.set_motion_choice(&choice).await?.map_err(CommandError::Shaping)?;
        }
        self.take_kept_state(drawn_100pm);
        Ok(())
    }

    #[inline(never)]
    fn take_kept_state(&mut self, drawn_100pm: i64) {
        let Ok(Place { offset, lines, mut paused, limits, .. }) = self.kept_place() else { return };
        self.motion.set_limits(limits);
        let modal = &mut self.interpreter.modal;
        let kept = &paused.modal;
        (modal.feed_percent, modal.flow_percent) = (kept.feed_percent, kept.flow_percent);
        modal.kept_feed_percent = kept.kept_feed_percent;
        modal.home_offset_10nm = kept.home_offset_10nm;
        modal.soft_limits = kept.soft_limits;
        (modal.min_extrusion_celsius, modal.cold_extrusion_allowed) =
            (kept.min_extrusion_celsius, kept.cold_extrusion_allowed);
        modal.retraction = kept.retraction;
        modal.z.shift_10nm = kept.z.shift_10nm;
        if kept.follows_bed {
            self.replies.send(Reply::Text("echo:power loss: the measured bed is lost: Z follows it no more"));
        }
        paused.drawn_100pm = drawn_100pm;
        self.paused = Some(paused);
        self.card.wait_at((offset, lines));
    }
}
