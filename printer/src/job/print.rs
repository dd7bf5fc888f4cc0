//! The print at hand: its file, its pause, its progress, and the parts that change or keep it.

use crate::job::card::Card;
use crate::job::paused::Paused;
use crate::job::power_loss::PowerLoss;
use crate::job::print_clock::PrintClock;
use crate::job::tower::Tower;

/// A host that wants to send a prepared job (M790).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct JobRequest {
    /// Length of the job, bytes.
    pub size: u32,
    /// Longest silence of the host, s.
    pub silence_s: u16,
}

/// The print at hand.
pub(crate) struct Print<'a> {
    /// The print's file, if it is one on a card.
    pub card: Card<'a>,
    /// The print's state while it is paused.
    pub paused: Option<Paused>,
    /// Progress by M73: percent, and minutes left.
    pub progress: (Option<u8>, Option<u16>),
    pub clock: PrintClock,
    /// Value that changes with the height (TUNING_TOWER).
    pub tower: Option<Tower>,
    /// State that survives a power cut.
    pub power_loss: PowerLoss,
    /// True while it lays lines whose filament an encoder watches.
    pub lays_lines: bool,
    /// A prepared job is to be received.
    pub job_request: Option<JobRequest>,
}

impl Print<'_> {
    /// No print.
    pub const fn none() -> Self {
        Self {
            card: Card::none(),
            paused: None,
            progress: (None, None),
            clock: PrintClock::new(),
            tower: None,
            power_loss: PowerLoss::new(),
            lays_lines: false,
            job_request: None,
        }
    }
}
