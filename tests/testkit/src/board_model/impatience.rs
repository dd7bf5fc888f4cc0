//! A host with limited patience: M108, M410 and M112 act while their bytes arrive.

use std::pin::pin;
use std::task::{Context, Poll, Waker};

use ferrostep_gcode::{Emergency, Line, LineError};
use ferrostep_printer::Host;
use ferrostep_step_player::Stepping;

use super::time::{CYCLES_A_MS, from_ns};
use super::{Board, BoardPrinter};

/// Time after each of these until the next one is tried, ms: longer than a command takes to see it.
const PATIENCE_MS: u64 = 300;

/// The means that ended a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// The command ended by itself, or by an earlier command.
    ByItself,
    /// M108, M410 or M112: the last that acted.
    By(Emergency),
}

impl<'a, M: Stepping> Board<'a, M> {
    /// Acts now, as when its bytes arrive.
    pub fn act(&self, emergency: Emergency) {
        self.interrupts.act(emergency);
    }

    /// Answers a line of a host that waits for `patience_ms` and then says M108, then
    /// M410, then M112.
    ///
    /// # Panics
    /// A line has no answer after all of these.
    pub fn answer(
        &self,
        (printer, host): (&mut BoardPrinter<'_, 'a, M>, &mut Host),
        line: Result<Line<'_>, LineError>,
        patience_ms: u64,
    ) -> Ended {
        self.work_for(self.costs.line);
        let mut future = pin!(host.answer(printer, line));
        let mut context = Context::from_waker(Waker::noop());
        let mut tries = [Emergency::EndWait, Emergency::QuickStop, Emergency::Stop].into_iter();
        let mut ended = Ended::ByItself;
        let mut until = self.now() + patience_ms * CYCLES_A_MS;
        loop {
            if let Poll::Ready(()) = future.as_mut().poll(&mut context) {
                return ended;
            }
            if self.now() >= until {
                let emergency = tries.next().unwrap_or_else(|| panic!("no answer to {line:?}"));
                self.act(emergency);
                ended = Ended::By(emergency);
                until = self.now() + PATIENCE_MS * CYCLES_A_MS;
            }
            let wake = self.clock.take_wake_ns().map_or(self.now() + 1, from_ns);
            self.pass_to(wake.max(self.now()).min(until.max(self.now() + 1)));
        }
    }
}
