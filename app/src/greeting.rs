//! The first lines sent to hosts.

use ferrostep_gcode::Reply;
use ferrostep_stm32f4::clock_tree::Clock;
use ferrostep_stm32f4::{BrownOut, ResetCause};
use ferrostep_stm32f4_board::{board, supervision};
use ferrostep_stm32f4_usb::NoUsb;

use crate::black_box::Records;
use crate::host_line::{To, Writers};

/// The circumstances of the board's start.
pub struct Start<'a> {
    /// Source of the board's clock.
    pub clock: &'a Clock,
    /// Cause of the reset.
    pub reset_cause: ResetCause,
    /// State of the voltage below which the board resets itself: set before, or at this start.
    pub brown_out: BrownOut,
    /// Reason for which USB does not work; `None` if it works.
    pub no_usb: Option<&'a NoUsb>,
}

impl Start<'_> {
    /// Reports the start to every host, with the last words of a run that ended in a crash.
    pub fn tell(&self, writers: &mut Writers, records: &Records) {
        writers.line(To::All, Reply::Start);
        writers.line(To::All, format_args!("echo:board: {}", board::NAME));
        writers.line(To::All, format_args!("echo:clock: {}", self.clock));
        writers.line(To::All, format_args!("echo:reset: {}", self.reset_cause));
        if self.brown_out != BrownOut::WasSet {
            writers.line(To::All, format_args!("echo:brown-out level: {}", self.brown_out));
        }
        supervision::take_last_words(|text| {
            records.last_words(text);
            writers.line(To::All, format_args!("echo:last {text}"));
        });
        if let Some(why) = self.no_usb {
            writers.line(To::All, format_args!("echo:usb: {why}"));
        }
    }
}
