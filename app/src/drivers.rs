//! The motor drivers as the printer sees them, and their line as the driver code sees it: views of
//! state that tasks share.

#[cfg(drivers)]
use core::cell::RefCell;
#[cfg(drivers)]
use core::fmt;
use core::sync::atomic::Ordering;

use ferrostep_printer::Kept;
#[cfg(drivers)]
use ferrostep_printer::MotorDrivers;
use ferrostep_stm32f4::clock_tree::{Clock, ClockSource};
use ferrostep_stm32f4_board::driver_line::{DriverLine, FERROSTEP_DRIVERS};
use ferrostep_tmc2209::{DriverBank, DriverSettings, LineTiming, MOTORS, SECOND_EXTRUDER};
#[cfg(drivers)]
use ferrostep_tmc2209::{DriverReport, DriverState, LineBusy, SettingsError, SingleWireUart};
#[cfg(drivers)]
use rtic::Mutex;

use crate::profile::PROFILE;
use crate::wiring::{BoardDriverLine, DRIVER_WIRING, DRIVERS};

/// Baud rate assumed for timeouts on the bare internal oscillator. An emulator runs on that clock
/// too, and its time may run many times faster than that of the program that answers.
const PATIENT_BAUD: u32 = 200;

/// The drivers of all motors.
pub type BoardDriverBank = DriverBank<DRIVERS>;

/// Profile settings of a motor's driver. Further motors lift Z, except that of the second extruder.
fn settings_of(motor: usize) -> Option<DriverSettings> {
    match PROFILE.tools {
        Some(Kept(tools)) if motor == SECOND_EXTRUDER => tools.get(1).and_then(|tool| tool.driver),
        _ => PROFILE.drivers.get(if motor < MOTORS { motor } else { 2 }).copied().flatten(),
    }
}

/// Creates the profile's drivers, not set up yet. They use the motion clock.
pub fn bank(clock: &Clock, now_ticks: u32) -> BoardDriverBank {
    let present = FERROSTEP_DRIVERS.load(Ordering::Relaxed);
    let mut drivers = [None; DRIVERS];
    for (motor, driver) in drivers.iter_mut().enumerate().filter(|(motor, _)| present >> motor & 1 == 1) {
        let settings = settings_of(motor);
        *driver = settings.zip(DRIVER_WIRING.get(motor).copied().flatten());
    }
    let baud = if clock.source == ClockSource::Internal { PATIENT_BAUD } else { BoardDriverLine::BAUD };
    DriverBank::new(drivers, LineTiming::new(clock.slow_timers.raw(), baud), now_ticks)
}

#[cfg(drivers)]
/// The line; each call to it holds off its interrupt.
pub struct Line<'a, L>(pub &'a mut L);

#[cfg(drivers)]
impl<L: Mutex<T = BoardDriverLine>> SingleWireUart for Line<'_, L> {
    fn send(&mut self, line: u8, bytes: &[u8], now_ticks: u32) -> Result<(), LineBusy> {
        let sent = self.0.lock(|uart| uart.send(line, bytes, now_ticks));
        if let Some(interrupt) = BoardDriverLine::PENDED {
            rtic::pend(interrupt);
        }
        sent
    }

    fn receive(&mut self, now_ticks: u32) -> Option<u8> {
        self.0.lock(|uart| uart.receive(now_ticks))
    }
}

#[cfg(drivers)]
/// The drivers, as shared with the task that executes commands.
pub struct BoardDrivers<B>(pub RefCell<B>);

#[cfg(drivers)]
impl<B> fmt::Debug for BoardDrivers<B> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("BoardDrivers")
    }
}

#[cfg(drivers)]
impl<B: Mutex<T = BoardDriverBank>> MotorDrivers for BoardDrivers<B> {
    fn state(&self, motor: usize) -> Option<DriverState> {
        self.0.borrow_mut().lock(|bank| bank.state(motor))
    }

    fn report(&self, motor: usize) -> Option<DriverReport> {
        self.0.borrow_mut().lock(|bank| bank.report(motor))
    }

    fn check(&self, motor: usize, settings: &DriverSettings) -> Result<(), SettingsError> {
        self.0.borrow_mut().lock(|bank| bank.check(motor, settings))
    }

    fn set(&self, motor: usize, settings: DriverSettings) -> Result<(), SettingsError> {
        self.0.borrow_mut().lock(|bank| bank.set(motor, settings))
    }

    fn take_moved(&self) -> u8 {
        self.0.borrow_mut().lock(BoardDriverBank::take_moved)
    }
}
