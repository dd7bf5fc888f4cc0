//! The desk's motor drivers: model chips, and the firmware's own code that sets them up
//! and watches them.

use std::cell::RefCell;
use std::collections::VecDeque;

use ferrostep_printer::MotorDrivers;
use ferrostep_tmc2209::{
    DriverBank, DriverEvent, DriverReport, DriverSettings, DriverState, LineTiming, MOTORS, SettingsError,
};
use ferrostep_virtual_board::{StallSignal, VIRTUAL_WIRING, VirtualDriverLines};

/// Ticks of the drivers' clock, and the speed of their line: a hardware one, as on the
/// Prusa MINI's board.
const TICKS_PER_SECOND: u32 = 1_000_000;
const BAUD: u32 = 115_200;
const NS_A_TICK: u64 = 1_000_000_000 / TICKS_PER_SECOND as u64;

/// Drivers, their line, and their time.
#[derive(Debug)]
struct Drivers {
    bank: DriverBank,
    lines: VirtualDriverLines,
    /// Events that have not been reported.
    events: VecDeque<DriverEvent>,
    now_tick: u64,
    next_tick: u64,
    /// True if drivers are also watched in service.
    watched: bool,
    polls: u64,
}

impl Drivers {
    /// Returns true if all drivers have confirmed their settings.
    fn are_in_service(&self) -> bool {
        (0..MOTORS).all(|motor| matches!(self.bank.state(motor), None | Some(DriverState::Confirmed)))
    }
}

/// The desk's motor drivers, if the machine's can be set.
#[derive(Debug)]
pub struct DeskDrivers(Option<RefCell<Drivers>>);

impl DeskDrivers {
    /// Drivers with these settings on the virtual board, just switched on; `watched`: they are also
    /// watched while they are in service. An estimate does not watch them: its model chips never
    /// fail, and its cost must not grow with the print's time.
    #[must_use]
    pub fn new(settings: &[Option<DriverSettings>; MOTORS], watched: bool) -> Self {
        if settings.iter().all(Option::is_none) {
            return Self(None);
        }
        let timing = LineTiming::new(TICKS_PER_SECOND, BAUD);
        let mut connected = [None; MOTORS];
        for ((connected, settings), wiring) in connected.iter_mut().zip(settings).zip(VIRTUAL_WIRING) {
            *connected = settings.map(|settings| (settings, wiring));
        }
        let wiring = connected.map(|connected| connected.map(|(_, wiring)| wiring));
        Self(Some(RefCell::new(Drivers {
            bank: DriverBank::new(connected, timing, 0),
            lines: VirtualDriverLines::new(wiring, timing.bit_ticks),
            events: VecDeque::new(),
            now_tick: 0,
            next_tick: 0,
            watched,
            polls: 0,
        })))
    }

    /// Returns true if the machine has drivers that are configured over a line.
    #[must_use]
    pub fn exist(&self) -> bool {
        self.0.is_some()
    }

    fn with<T>(&self, act: impl FnOnce(&mut Drivers) -> T) -> Option<T> {
        self.0.as_ref().map(|drivers| act(&mut drivers.borrow_mut()))
    }

    /// Looks at the chips, or makes them fail.
    pub fn with_lines<T>(&self, act: impl FnOnce(&mut VirtualDriverLines) -> T) -> Option<T> {
        self.with(|drivers| act(&mut drivers.lines))
    }

    /// Returns the threshold at which a motor's chip, as set now, signals a stall; `None`: never.
    #[must_use]
    pub fn stall_signal(&self, motor: usize) -> Option<StallSignal> {
        self.with(|drivers| drivers.lines.chip(motor).and_then(|chip| chip.stall_signal()))?
    }

    /// Number of times the drivers' code has run, a measure of its cost.
    #[must_use]
    pub fn polls(&self) -> u64 {
        self.with(|drivers| drivers.polls).unwrap_or(0)
    }

    /// Takes the next event, in order.
    #[must_use]
    pub fn take_event(&self) -> Option<DriverEvent> {
        self.with(|drivers| drivers.events.pop_front())?
    }

    /// Runs all that is due up to a moment.
    pub fn work_until(&self, now_ns: u64) {
        self.with(|drivers| {
            drivers.now_tick = now_ns / NS_A_TICK;
            while drivers.next_tick <= drivers.now_tick {
                if !drivers.watched && drivers.are_in_service() {
                    drivers.next_tick = drivers.now_tick + 1;
                    break;
                }
                drivers.polls += 1;
                // The drivers' clock wraps, as a timer does.
                let tick = drivers.next_tick as u32;
                match drivers.bank.poll(&mut drivers.lines, tick) {
                    Some(event) => drivers.events.push_back(event),
                    None => drivers.next_tick += u64::from(drivers.bank.idle_ticks(tick).max(1)),
                }
            }
        });
    }
}

impl MotorDrivers for DeskDrivers {
    fn state(&self, motor: usize) -> Option<DriverState> {
        self.with(|drivers| drivers.bank.state(motor))?
    }

    fn report(&self, motor: usize) -> Option<DriverReport> {
        self.with(|drivers| drivers.bank.report(motor))?
    }

    fn check(&self, motor: usize, settings: &DriverSettings) -> Result<(), SettingsError> {
        self.with(|drivers| drivers.bank.check(motor, settings)).unwrap_or(Ok(()))
    }

    fn set(&self, motor: usize, settings: DriverSettings) -> Result<(), SettingsError> {
        self.with(|drivers| {
            // Its turn is now, not when the next look at the others is due.
            drivers.next_tick = drivers.next_tick.min(drivers.now_tick + 1);
            drivers.bank.set(motor, settings)
        })
        .unwrap_or(Ok(()))
    }

    fn take_moved(&self) -> u8 {
        self.with(|drivers| drivers.bank.take_moved()).unwrap_or(0)
    }
}
