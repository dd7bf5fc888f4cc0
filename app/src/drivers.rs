//! The motors' drivers as the printer sees them, and their line as the drivers' own code does: views of what tasks share.

use core::cell::RefCell;
use core::fmt;

use ferrostep_hal_shim::clock_tree::Clock;
use ferrostep_hal_shim::tmc2209::{
    DriverBank, DriverReport, DriverSettings, DriverState, LineBusy, LineTiming, SettingsError, SingleWireUart,
};
use ferrostep_printer::MotorDrivers;
use ferrostep_stm32f4::driver_line::DriverLine;
use rtic::Mutex;

use crate::profile::{BoardDriverLine, DRIVER_WIRING, PROFILE};

/// Whether there are drivers that can be set.
pub const EXIST: bool = BoardDriverLine::EXISTS;

/// The profile's drivers, not set up yet. Their clock is the motion clock's.
pub fn bank(clock: &Clock, now_ticks: u32) -> DriverBank {
    let mut drivers = [None; 4];
    for ((driver, settings), wiring) in drivers.iter_mut().zip(PROFILE.drivers).zip(DRIVER_WIRING) {
        *driver = settings.zip(wiring);
    }
    DriverBank::new(drivers, LineTiming::new(clock.timer_hz, BoardDriverLine::BAUD), now_ticks)
}

/// The line; each call into it keeps its interrupt out.
pub struct Line<'a, L>(pub &'a mut L);

impl<L: Mutex<T = BoardDriverLine>> SingleWireUart for Line<'_, L> {
    fn send(&mut self, line: u8, bytes: &[u8], now_ticks: u32) -> Result<(), LineBusy> {
        self.0.lock(|uart| uart.send(line, bytes, now_ticks))
    }

    fn receive(&mut self, now_ticks: u32) -> Option<u8> {
        self.0.lock(|uart| uart.receive(now_ticks))
    }
}

/// The drivers, as the task that executes commands shares them.
pub struct BoardDrivers<B>(pub RefCell<B>);

impl<B> fmt::Debug for BoardDrivers<B> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("BoardDrivers")
    }
}

impl<B: Mutex<T = DriverBank>> MotorDrivers for BoardDrivers<B> {
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
        self.0.borrow_mut().lock(DriverBank::take_moved)
    }
}
