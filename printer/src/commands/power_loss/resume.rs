//! Resuming an interrupted print.
//!
//! Z is not homed, because the nozzle is over the print: its height is the kept one. X and Y are
//! homed above the print.

use ferrostep_card::{CardFailure, OpenedFile, Request};
use ferrostep_gcode::{AxisFlags, AxisWords, CardCommand, Command, Decimal, InterruptedPrint, Real, Reply, WaitTarget};
use ferrostep_hal_shim::{FanOutput, Heater};
use ferrostep_planner::{MotionChoice, StepsPerMm};
use ferrostep_settings::hash_of;

use crate::error::{CommandError, Failure};
use crate::heat::fans::FanSettings;
use crate::job::card::{Job, Selected};
use crate::job::lines::Source;
use crate::job::paused::Paused;
use crate::job::power_loss::place::Place;
use crate::motion::skew::Skew;
use crate::ports::{Motion, Ports, Replies, Text};
use crate::printer::Printer;
use crate::settings::profile::filament::PauseSettings;

/// The place of a print on this machine.
type PlaceOf<P> = Place<<<P as Ports>::Motion as Motion>::Tools>;

/// Reason why an interrupted print cannot be resumed.
enum NoWay {
    Card(CardFailure),
    /// The print belongs to another machine, or to another version of the firmware.
    Foreign,
    /// The machine is not at the kept place.
    Moved,
    /// The place is outside the travel.
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
    /// Executes M1000.
    pub(crate) async fn interrupted_print(&mut self, command: InterruptedPrint) -> Result<(), CommandError> {
        if self.print.card.job != Job::None || self.is_paused() || self.print.card.is_written() {
            return Err(CommandError::CardInUse);
        }
        self.print.card.deselect();
        let opened = self.ask_card(Request::OpenKept).await.map(|_| ());
        if command == InterruptedPrint::Resume {
            self.needs(self.fitted.equipment.end_stops, "end stops")?;
            self.needs(self.fitted.equipment.heaters, "heaters")?;
        }
        self.settle(command, opened);
        Ok(())
    }

    /// Executes M1000 with the card's print, or reports why the card has no print.
    // In a future the compiler would keep every value in memory.
    #[inline(never)]
    fn settle(&mut self, command: InterruptedPrint, opened: Result<(), CardFailure>) {
        self.print.power_loss.is_offered = false;
        if let Err(failure @ (CardFailure::Slot(_) | CardFailure::NotMounted)) = opened {
            return self.replies.say(format_args!("echo:card: {failure}"));
        }
        if opened == Err(CardFailure::NothingKept) {
            return self.replies.send(Reply::Text("echo:power loss: no interrupted print is kept"));
        }
        if command == InterruptedPrint::Discard {
            self.forget_place();
            return self
                .replies
                .send(Reply::Text("echo:power loss: the interrupted print is forgotten\n//action:prompt_end"));
        }
        self.print.power_loss.is_offered = true;
        if let Err(why) = opened.map_err(NoWay::Card).and_then(|()| self.checked_place()) {
            let name = self.kept_name();
            self.replies.say(format_args!("echo:power loss: the print of {name} cannot resume: {why}"));
            return self.replies.send(Reply::Text("echo:power loss: M1000 C forgets it"));
        }
        if command == InterruptedPrint::Report {
            return self.offer();
        }
        if let Some(selected) = self.with_opened(|file: &OpenedFile| Selected::from(file)) {
            self.print.card.select(selected);
            self.replies.send(Reply::Text(
                "//action:prompt_end\necho:power loss: the print resumes: heating, then X and Y are homed",
            ));
            (self.print.power_loss.is_offered, self.print.power_loss.is_resuming) = (false, true);
            self.set_card_job(Job::Paused);
        }
    }

    /// Searches for an interrupted print after the card was mounted. If the motors have not moved
    /// since the start, the kept height becomes theirs.
    pub(crate) async fn find_interrupted_print(&mut self) {
        if self.print.card.job != Job::None || self.print.card.has_selected() {
            return;
        }
        let opened = self.ask_card(Request::OpenKept).await.map(|_| ());
        self.print.power_loss.is_offered = false;
        if opened != Err(CardFailure::NothingKept) {
            self.take_kept_height();
            self.settle(InterruptedPrint::Report, opened);
        }
    }

    /// Sets the motors' height to the kept one.
    #[inline(never)]
    fn take_kept_height(&mut self) {
        let Ok(Place { stands_10nm, .. }) = self.kept_place() else { return };
        if self.motion.position_10nm() == [0; 3] && self.interpreter.modal.homed == [false; 3] {
            self.motion.set_position([0, 0, stands_10nm]);
            self.interpreter.follow([0, 0, stands_10nm]);
            self.print.power_loss.stands_10nm = Some(stands_10nm);
        } else if self.print.power_loss.stands_10nm != Some(stands_10nm) {
            self.print.power_loss.stands_10nm = None;
        }
    }

    /// Reports which print was interrupted.
    #[inline(never)]
    fn offer(&self) {
        let Ok(Place { offset, lines, paused, .. }) = self.kept_place() else { return };
        let z_mm = Real::fixed(paused.modal.machine_10nm[2] as f64 / 100_000.0, 2);
        let size = self.with_opened(|file| file.size).unwrap_or(0);
        let name = self.kept_name();
        self.replies.say(format_args!(
            "echo:power loss: the print of {name} was interrupted at byte {offset} of {size}, after line {lines}, at Z{z_mm}"
        ));
        self.replies.send(Reply::Text(
            "echo:power loss: M1000 resumes it, M1000 C forgets it\n//action:prompt_end\n\
             //action:prompt_begin A print was interrupted. Continue heats, homes X and Y and \
             resumes; Forget drops it\n\
             //action:prompt_button Continue\n//action:prompt_button Forget\n//action:prompt_show",
        ));
    }

    /// Path of the interrupted print, as the card keeps it.
    fn kept_name(&self) -> Text {
        let mut name = Text::new();
        if let Some(port) = self.print.card.port() {
            port.with(&mut |mailbox| {
                name.clear();
                // The text has room for any path.
                let _ = name.push_str(mailbox.page());
            });
        }
        name
    }

    /// The place read from the card.
    #[inline(never)]
    fn kept_place(&self) -> Result<PlaceOf<P>, NoWay> {
        let mut place = PlaceOf::<P> {
            stands_10nm: 0,
            offset: 0,
            lines: 0,
            profile: 0,
            paused: Paused {
                modal: self.interpreter.modal,
                place_10nm: [0; 3],
                targets_celsius: [0.0; Heater::COUNT],
                drawn_100pm: 0,
                load_100pm: 0,
                pushes_more: false,
                until_ms: None,
            },
            fans: [0; FanOutput::COUNT],
            limits: self.motion.limits(),
            advance: self.motion.motion_choice().pressure_advance,
            extruder_steps: 0,
            skew: Skew::NONE,
            tools: self.modes.tools,
        };
        let mut is_read = false;
        if let Some(port) = self.print.card.port() {
            port.with(&mut |mailbox| is_read = place.read(mailbox.kept()));
        }
        if is_read && place.profile == hash_of(self.profile.name) { Ok(place) } else { Err(NoWay::Foreign) }
    }

    /// Checks the place read from the card.
    #[inline(never)]
    fn checked_place(&self) -> Result<(), NoWay> {
        let Place { paused, .. } = self.kept_place()?;
        if self.print.power_loss.stands_10nm.is_none() {
            return Err(NoWay::Moved);
        }
        let is_within = |axis: usize| {
            let [lower, upper] = [self.profile.lower_end_10nm[axis], self.profile.size_10nm[axis]];
            // Babysteps (M290) may have lowered it below the bed.
            let lower = if axis == 2 { lower.min(-PauseSettings::MAX_RISE_10NM) } else { lower };
            (lower..=upper).contains(&paused.place_10nm[axis])
        };
        if !paused.modal.soft_limits || (0..3).all(is_within) { Ok(()) } else { Err(NoWay::Outside) }
    }

    /// Returns true while the nozzle is returning to the interrupted print (M1000).
    pub(crate) fn is_returning(&self) -> bool {
        self.print.power_loss.is_resuming
    }

    /// Takes the nozzle back to the interrupted print, which then continues. `false` if that is
    /// impossible; the reason has been reported.
    pub(crate) async fn return_to_print(&mut self) -> bool {
        self.lines.begin(Source::Card, 0);
        self.signals.set_at_work(true);
        let mut step = 0;
        while let Some(command) = self.return_step(step) {
            if let Err(error) = self.command_with_signs_of_life(&command).await {
                self.replies.refuse(0, &Failure::Command(error));
                break;
            }
            step += 1;
        }
        self.signals.set_at_work(self.is_paused());
        let goes_on = self.print.card.job == Job::Printing;
        self.print.power_loss.is_resuming = !goes_on;
        if !goes_on {
            self.replies.send(Reply::Text("echo:power loss: the print cannot resume; M1000 retries"));
        }
        goes_on
    }

    /// Next command of the return. First the bed, then the nozzle: the plastic around the nozzle
    /// melts before it rises. The chamber warms up meanwhile.
    #[inline(never)]
    fn return_step(&mut self, step: usize) -> Option<Command<'static>> {
        let place = self.kept_place().ok()?;
        let targets = place.paused.targets_celsius;
        let [nozzle, bed, chamber, nozzle1] =
            targets.map(|celsius| Decimal::from_nanos((f64::from(celsius) * 1e9) as i64));
        Some(match step {
            0 => Command::SetChamber(Some(chamber)),
            1 => Command::WaitBed(WaitTarget::Heating(bed)),
            2 => {
                // The other nozzle heats up meanwhile.
                let (selected, other) =
                    if self.take_tools(&place.tools) { (nozzle1, nozzle) } else { (nozzle, nozzle1) };
                self.heat_other_nozzle(other);
                Command::WaitNozzle(None, WaitTarget::Heating(selected))
            }
            // Retracts and rises; X and Y do not move, because they are not homed.
            3 => {
                self.interpreter.modal.homed[2] = true;
                self.interpreter.modal.failed_home[2] = false;
                Command::Pause(AxisWords::default())
            }
            4 => Command::Home { axes: AxisFlags { x: true, y: true, z: false, e: false }, unless_homed: false },
            _ => match (self.profile.fans.get(step - 5), place.fans.get(step - 5)) {
                (Some(&Some(FanSettings { name, rule, .. })), Some(&power)) if rule.is_named() => {
                    Command::NamedFan { name, power }
                }
                (Some(_), _) => Command::Accepted,
                (None, _) if self.print.card.job == Job::Printing => return None,
                (None, _) => {
                    self.take_kept_state(&place);
                    Command::Card(CardCommand::Start { position: None })
                }
            },
        })
    }

    /// Restores the settings that last from line to line, at standstill.
    fn take_kept_state(&mut self, place: &PlaceOf<P>) {
        let Place { offset, lines, limits, advance, extruder_steps, skew, paused: print, .. } = place;
        self.motion.set_limits(*limits);
        // Cannot fail at standstill.
        let _always_works = self.motion.set_extruder_steps_per_mm(StepsPerMm::clamped(*extruder_steps));
        let choice = MotionChoice { pressure_advance: *advance, ..self.motion.motion_choice() };
        if advance.check().is_err() || self.motion.set_motion_choice(&choice).is_err() {
            self.replies.send(Reply::Text("echo:power loss: M900 cannot be restored"));
        }
        self.interpreter.modal.set_machine_as(&print.modal);
        self.set_skew(*skew);
        if print.modal.follows_bed {
            self.replies.send(Reply::Text("echo:power loss: the measured bed is lost: Z follows it no more"));
        }
        if let Some(paused) = &mut self.print.paused {
            // Retracted just now, and by the pause during which the power was cut.
            *paused = Paused { drawn_100pm: paused.drawn_100pm.saturating_add(print.drawn_100pm), ..*print };
        }
        self.print.card.wait_at((*offset, *lines));
    }
}
