//! M31 and M75 to M78: the duration of a print, and the totals of all prints.

use ferrostep_gcode::{PrintClockCommand, Reply};
use ferrostep_hal_shim::{Clock, Heater};

use crate::job::card::Job;
use crate::job::print_clock::{Duration, State, Statistics};
use crate::ports::{Heating, Ports, Replies};
use crate::printer::Printer;

impl<P: Ports> Printer<'_, P> {
    /// Executes M75 to M78 except for their waits.
    // In a future the compiler would keep every value in memory.
    #[inline(never)]
    pub(crate) fn print_clock(&mut self, command: PrintClockCommand) {
        match command {
            PrintClockCommand::Start => self.start_print_clock(),
            PrintClockCommand::Pause => self.print.clock.pause(self.clock.now_ms()),
            PrintClockCommand::Stop => self.stop_print_clock(true),
            PrintClockCommand::Report => self.report_statistics(),
            PrintClockCommand::Clear => {
                self.see_heat();
                (self.print.clock.statistics, self.print.clock.is_unsaved) = (Statistics::default(), true);
                self.replies.send(Reply::Text("echo:print statistics are cleared"));
            }
        }
    }

    pub(crate) fn start_print_clock(&mut self) {
        self.print.clock.start(self.clock.now_ms(), self.interpreter.tally.filament_100pm);
    }

    /// Resumes the clock of a paused print.
    pub(crate) fn resume_print_clock(&mut self) {
        if self.print.clock.state == State::Paused {
            self.start_print_clock();
        }
    }

    pub(crate) fn pause_print_clock(&mut self) {
        self.print.clock.pause(self.clock.now_ms());
    }

    pub(crate) fn stop_print_clock(&mut self, is_complete: bool) {
        self.print.clock.stop(self.clock.now_ms(), self.interpreter.tally.filament_100pm, is_complete);
    }

    /// Starts the clock of a host's print at a wait for heat, as in Marlin.
    pub(crate) fn print_heats(&mut self) {
        if self.print.clock.state == State::Stopped && self.modes.targets_celsius.iter().any(|celsius| *celsius > 0.0) {
            self.start_print_clock();
        }
    }

    /// Ends a host's print when the last heater is switched off, as in Marlin. The card knows the
    /// end of the print it holds.
    fn print_cools(&mut self) {
        let is_cold = self.modes.targets_celsius.iter().all(|celsius| *celsius <= 0.0);
        if is_cold && self.print.card.job == Job::None && !self.is_paused() {
            self.stop_print_clock(true);
        }
    }

    /// Notes which heaters have a target, before and after one is set.
    pub(crate) fn see_heat(&mut self) {
        let are_on = [self.is_a_nozzle_on(), self.heating.status(Heater::Bed).target_celsius > 0.0];
        self.print.clock.see_heat(self.clock.now_ms(), are_on);
    }

    /// Updates the clock and statistics after a target was set.
    pub(crate) fn target_is_set(&mut self) {
        self.see_heat();
        self.print_cools();
    }

    /// Reports M31.
    pub(crate) fn report_print_time(&self) {
        let elapsed = Duration(self.print.clock.elapsed_s(self.clock.now_ms()));
        self.replies.say(format_args!("echo:Print time: {elapsed}"));
    }

    /// Reports M78, in Marlin's words except for the last line.
    fn report_statistics(&mut self) {
        self.see_heat();
        let Statistics { prints, finished, printed_s, longest_s, filament_10mm, heated_s } =
            self.print.clock.statistics;
        let at_work = u32::from(self.print.clock.state != State::Stopped);
        let failed = prints.saturating_sub(finished).saturating_sub(at_work);
        let [total, longest] = [printed_s, longest_s].map(Duration);
        let [nozzle, bed] = heated_s.map(Duration);
        let (metres, rest) = (filament_10mm / 100, filament_10mm % 100);
        self.replies.say(format_args!(
            "Stats: Prints: {prints}, Finished: {finished}, Failed: {failed}\n\
             Stats: Total time: {total}, Longest job: {longest}\n\
             Stats: Filament used: {metres}.{rest:02}m\n\
             Stats: Heating time: nozzle {nozzle}, bed {bed}"
        ));
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
