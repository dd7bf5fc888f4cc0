//! Requests to the card's task.

use core::future::Future;

use embedded_hal_async::delay::DelayNs;
use ferrostep_card::{Answer, CardFailure, CardPort, Request};
use ferrostep_hal_shim::card::CardError;

use crate::job::card::Job;
use crate::ports::Ports;
use crate::printer::Printer;

/// Interval at which the printer looks for an answer of the card's task, ms.
pub(super) const LOOK_MS: u32 = 1;

impl<'a, P: Ports> Printer<'a, P> {
    /// Gives the printer a memory-card slot, served by the task behind `port`.
    pub fn set_card(&mut self, port: &'a dyn CardPort) {
        self.print.card.port = Some(port);
    }

    /// Hands a request to the card's task at once. The future returned waits for the answer and
    /// does not hold the request.
    pub(crate) fn ask_card(&mut self, request: Request) -> impl Future<Output = Result<Answer, CardFailure>> {
        let port = self.print.card.post(request);
        async move {
            let Some(port) = port else { return Err(CardFailure::Slot(CardError::Missing)) };
            loop {
                let mut answer = None;
                port.with(&mut |mailbox| answer = mailbox.take_answer());
                if let Some(answer) = answer {
                    return answer;
                }
                self.clock.delay_ms(LOOK_MS).await;
            }
        }
    }

    pub(crate) fn set_card_job(&mut self, job: Job) {
        match job {
            Job::Printing => self.start_print_clock(),
            Job::Paused => self.pause_print_clock(),
            // The end of the print has stopped the clock.
            Job::None => {}
        }
        self.print.card.job = job;
        if job == Job::Paused {
            self.print.power_loss.note_pause();
        }
        self.note_card_progress();
    }

    /// Notes the print's progress for the reports of M27 S.
    pub(super) fn note_card_progress(&self) {
        let size = self.print.card.selected.filter(|_| self.print.card.job != Job::None).map(|selected| selected.size);
        self.signals.set_card_progress(size.map(|size| (self.print.card.position, size)));
    }
}
