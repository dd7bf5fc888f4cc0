//! A printer on the desk, and the loop that polls it and lets time pass.

use std::cell::{Cell, RefCell};
use std::collections::BTreeSet;
use std::future::Future;
use std::pin::pin;
use std::task::{Context, Poll, Waker};

use ferrostep_gcode::Reply;
use ferrostep_hal_shim::virtual_board::{VirtualClock, VirtualDelay};
use ferrostep_hal_shim::{Clock, Heater};
use ferrostep_printer::{
    Failure, HeaterRest, HeaterTimeout, Heating, Printer, Profile, Replies, Signals, tell_driver_event, temperatures,
};

use crate::desk::{Desk, DeskDrivers, DeskHeating, DeskMotion, Mode};
use crate::record::Observer;

/// Different unknown commands that are remembered; a broken file could name any number.
const MAX_UNKNOWN_COMMANDS: usize = 100;

/// A printer whose commands act on a [`Desk`].
pub type DeskPrinter<'a, O, R> = Printer<'a, (DeskMotion<'a, O>, DeskHeating<'a, O>, VirtualDelay<'a>, R)>;

/// The machine and all that is shared between its parts.
pub struct Session<O, R> {
    profile: Profile,
    clock: VirtualClock,
    desk: RefCell<Desk<O>>,
    drivers: DeskDrivers,
    signals: Signals,
    heater_timeout: Cell<HeaterTimeout>,
    replies: R,
}

impl<O: Observer, R: Replies> Session<O, R> {
    /// A machine that has just been switched on, its replies going to `replies`.
    pub fn new(profile: Profile, mode: Mode, look_ahead: usize, observer: O, replies: R) -> Self {
        Self {
            clock: VirtualClock::default(),
            desk: RefCell::new(Desk::new(&profile, mode, look_ahead, observer)),
            drivers: DeskDrivers::new(&profile.drivers, mode),
            signals: Signals::new(),
            heater_timeout: Cell::default(),
            replies,
            profile,
        }
    }

    /// The printer; one at a time makes sense.
    pub fn printer(&self) -> DeskPrinter<'_, O, R> {
        let mut printer = Printer::new(
            &self.profile,
            DeskMotion { desk: &self.desk, drivers: &self.drivers, signals: &self.signals },
            DeskHeating { desk: &self.desk },
            VirtualDelay(&self.clock),
            &self.replies,
            &self.signals,
        );
        printer.set_version(crate::VERSION);
        if self.drivers.exist() {
            printer.set_drivers(&self.drivers);
        }
        printer
    }

    /// The motors' drivers.
    pub fn drivers(&self) -> &DeskDrivers {
        &self.drivers
    }

    /// The machine.
    pub fn desk(&self) -> &RefCell<Desk<O>> {
        &self.desk
    }

    /// What watched the motors.
    pub fn into_observer(self) -> O {
        self.desk.into_inner().into_observer()
    }

    /// Flags for those who act on bytes as they arrive.
    pub fn signals(&self) -> &Signals {
        &self.signals
    }

    /// Where the replies go.
    pub fn replies(&self) -> &R {
        &self.replies
    }

    /// Virtual time.
    pub fn clock(&self) -> &VirtualClock {
        &self.clock
    }

    /// Polls a future to its end; whenever it waits, virtual time passes. `between` is called after each time.
    pub fn run_with<F: Future>(&self, future: F, mut between: impl FnMut(&Self)) -> F::Output {
        let mut future = pin!(future);
        let mut context = Context::from_waker(Waker::noop());
        let mut next_report_ms = 0;
        loop {
            if let Poll::Ready(output) = future.as_mut().poll(&mut context) {
                return output;
            }
            let outcome = self.desk.borrow_mut().pass_time(&self.clock);
            if let Err(fault) = outcome {
                // Two adjacent lines, as hosts expect of a thermal error.
                self.replies.send(Reply::Text(&fault.to_string()));
                self.replies.send(Reply::Killed);
                self.signals.halt();
            }
            self.drivers.work_until(self.clock.now_ns());
            self.tell_driver_events();
            self.rest_heaters();
            self.report_temperatures(&mut next_report_ms);
            between(self);
        }
    }

    /// Polls a future to its end; whenever it waits, virtual time passes.
    pub fn run<F: Future>(&self, future: F) -> F::Output {
        self.run_with(future, |_| {})
    }

    /// What has happened to the motors' drivers; one that leaves a motor alone in motion halts the machine.
    fn tell_driver_events(&self) {
        while let Some(event) = self.drivers.take_event() {
            let motors_on = self.desk.borrow().enabled_motors;
            if tell_driver_event(&event, motors_on, &self.replies) && !self.signals.is_halted() {
                self.desk.borrow_mut().halt();
                self.replies.send(Reply::Killed);
                self.signals.halt();
            }
        }
    }

    /// Switches unused heaters off, as a board does (M86).
    fn rest_heaters(&self) {
        // A clock of milliseconds that wraps.
        let now_ms = (&self.clock).now_ms() as u32;
        let is_used = self.signals.take_host_spoken() | self.desk.borrow_mut().take_moved();
        let mut heating = DeskHeating { desk: &self.desk };
        let has_target = Heater::ALL.into_iter().any(|heater| heating.status(heater).target_celsius > 0.0);
        let mut timeout = self.heater_timeout.get();
        let rest = timeout.look(now_ms, is_used, has_target, self.signals.heater_timeout_s());
        self.heater_timeout.set(timeout);
        let Some(rest) = rest else { return };
        if let HeaterRest::Over { .. } = rest {
            heating.all_off();
        }
        self.replies.send(Reply::Text(&rest.to_string()));
    }

    /// M155.
    fn report_temperatures(&self, next_report_ms: &mut u64) {
        let interval_ms = u64::from(self.signals.report_interval_s()) * 1000;
        let now_ms = (&self.clock).now_ms();
        if interval_ms == 0 {
            *next_report_ms = 0;
        } else if now_ms >= *next_report_ms {
            *next_report_ms = now_ms + interval_ms;
            self.replies.send(Reply::Temperatures(temperatures(&DeskHeating { desk: &self.desk })));
        }
    }
}

/// Replies of a job from a file: what a person should read, and what the summary lists.
pub struct JobReplies<F> {
    unknown: RefCell<BTreeSet<String>>,
    notice: F,
}

impl<F: Fn(&str)> JobReplies<F> {
    /// Sends each line that a person should read to `notice`.
    pub fn new(notice: F) -> Self {
        Self { unknown: RefCell::new(BTreeSet::new()), notice }
    }

    /// The different unknown commands so far, in alphabetical order.
    pub fn unknown_commands(&self) -> Vec<String> {
        self.unknown.borrow().iter().cloned().collect()
    }
}

impl<F: Fn(&str)> Replies for JobReplies<F> {
    fn send(&self, reply: Reply<'_>) {
        match reply {
            Reply::UnknownCommand(text) => {
                let mut unknown = self.unknown.borrow_mut();
                if unknown.len() < MAX_UNKNOWN_COMMANDS && !unknown.contains(text) {
                    unknown.insert(text.to_owned());
                    (self.notice)(&reply.to_string());
                }
            }
            Reply::Text(text) => (self.notice)(text),
            Reply::Killed => (self.notice)(&reply.to_string()),
            // Nobody has asked over a serial line.
            _ => {}
        }
    }

    /// The job stops there, and says so itself.
    fn refuse(&self, _line: u32, _failure: &Failure) {}
}
