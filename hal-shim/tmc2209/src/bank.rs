//! All drivers of a board, and whose turn it is on their line.

use super::driver::{Driver, DriverReport, DriverState};
use super::event::{DriverEvent, DriverEventKind, Failure};
use super::exchange::{Exchange, Request};
use super::motors::{MOTORS, SECOND_EXTRUDER, Z};
use super::settings::{DriverSettings, DriverWiring, RegisterImage, SettingsError};
use super::uart::SingleWireUart;

/// Rest of the line between datagrams: the chip wants 12 bit times after one that it did not
/// understand (section 4.1.1).
const REST_BITS: u32 = 16;

/// Times of the line, in ticks of the caller. No interval may reach 2^31 ticks: the clock
/// has at most 1 GHz.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineTiming {
    /// A bit, rounded up.
    pub bit_ticks: u32,
    /// Time from one look at a driver in service to the next.
    pub look_ticks: u32,
    /// Time from a failed set-up to the next attempt.
    pub retry_ticks: u32,
}

impl LineTiming {
    /// Each driver in service is looked at every half second, a failed one tried every two seconds.
    #[must_use]
    pub const fn new(ticks_per_second: u32, baud: u32) -> Self {
        let baud = if baud == 0 { 1 } else { baud };
        Self {
            bit_ticks: ticks_per_second.div_ceil(baud),
            look_ticks: ticks_per_second / 2,
            retry_ticks: ticks_per_second.saturating_mul(2),
        }
    }
}

/// The drivers of `N` motors, at most [`MOST_MOTORS`](super::MOST_MOTORS). [`Self::poll`] is called
/// from time to time and never waits.
#[derive(Clone, Debug)]
pub struct DriverBank<const N: usize = MOTORS> {
    drivers: [Option<Driver>; N],
    /// Time of the next look at each.
    looks_at: [u32; N],
    timing: LineTiming,
    /// The datagram under way, and whose it is.
    exchange: Option<(usize, Exchange)>,
    /// True if its answer is no longer needed, but the line is busy until it ends.
    is_stale: bool,
    /// End of the line's rest.
    rests_until: Option<u32>,
    /// The next driver to be set to reply late; none is asked before all have been.
    to_quieten: usize,
    /// Motor whose turn it is.
    turn: usize,
    /// Drivers whose impossible settings have not been reported yet.
    to_tell: u8,
    /// Motors that may not be where their steps say.
    moved: u8,
}

impl<const N: usize> DriverBank<N> {
    /// Drivers to set up; `None` for a motor without one.
    #[must_use]
    pub fn new(drivers: [Option<(DriverSettings, DriverWiring)>; N], timing: LineTiming, now_ticks: u32) -> Self {
        let drivers = drivers.map(|driver| driver.map(|(settings, wiring)| Driver::new(settings, wiring)));
        let mut to_tell = 0;
        for (motor, driver) in drivers.iter().enumerate() {
            if driver.is_some_and(|driver| matches!(driver.state(), DriverState::Failed(_))) {
                to_tell |= 1 << motor;
            }
        }
        Self {
            drivers,
            looks_at: [now_ticks; N],
            timing,
            exchange: None,
            is_stale: false,
            rests_until: None,
            to_quieten: 0,
            turn: 0,
            to_tell,
            moved: 0,
        }
    }

    /// Returns the state of a motor's driver, whether it can be relied on; `None` for a
    /// motor without one.
    #[must_use]
    pub fn state(&self, motor: usize) -> Option<DriverState> {
        self.driver(motor).map(Driver::state)
    }

    /// The state for M122; `None` for a motor without a driver.
    #[must_use]
    pub fn report(&self, motor: usize) -> Option<DriverReport> {
        self.driver(motor).map(Driver::report)
    }

    /// A driver's settings.
    #[must_use]
    pub fn settings(&self, motor: usize) -> Option<DriverSettings> {
        self.driver(motor).map(Driver::settings)
    }

    /// Checks other settings for a driver; of Z's for those of all its motors.
    ///
    /// # Errors
    /// The chip cannot do that with this board's sense resistors.
    pub fn check(&self, motor: usize, settings: &DriverSettings) -> Result<(), SettingsError> {
        self.set_with(motor).filter_map(|motor| self.driver(motor)).try_for_each(|driver| {
            RegisterImage::new(settings, &driver.wiring)?;
            Ok(())
        })
    }

    /// Changes a driver's settings, for Z those of all its motors; it is then unconfirmed until it
    /// is set up anew. Without effect for a motor without a driver.
    ///
    /// # Errors
    /// The chip cannot do that with this board's sense resistors; nothing has changed.
    pub fn set(&mut self, motor: usize, settings: DriverSettings) -> Result<(), SettingsError> {
        if N > MOTORS {
            // An error leaves all drivers unchanged.
            self.check(motor, &settings)?;
        }
        for motor in self.set_with(motor) {
            let Some(driver) = self.drivers.get_mut(motor).and_then(Option::as_mut) else { continue };
            driver.set(settings)?;
            // The datagram under way was for the old registers.
            self.is_stale |= self.exchange.is_some_and(|(whose, _)| whose == motor);
        }
        Ok(())
    }

    /// The motors that have the same settings: all of Z's.
    fn set_with(&self, motor: usize) -> impl Iterator<Item = usize> + use<N> {
        let further = if N > MOTORS && motor == Z { MOTORS..N.min(SECOND_EXTRUDER) } else { 0..0 };
        [motor].into_iter().chain(further)
    }

    /// Mask of the motors (Z's as one) that may have moved since this was last asked, because their
    /// drivers were reset or off.
    pub fn take_moved(&mut self) -> u8 {
        core::mem::take(&mut self.moved)
    }

    fn driver(&self, motor: usize) -> Option<&Driver> {
        self.drivers.get(motor).and_then(Option::as_ref)
    }

    /// Executes due work, and returns an event of a driver; call again until it returns `None`.
    pub fn poll(&mut self, uart: &mut impl SingleWireUart, now_ticks: u32) -> Option<DriverEvent> {
        if self.to_tell != 0 {
            let motor = self.to_tell.trailing_zeros() as usize;
            self.to_tell &= self.to_tell.wrapping_sub(1);
            if let Some(DriverState::Failed(failure)) = self.state(motor) {
                return self.happened(motor, DriverEventKind::Failed(failure));
            }
        }
        if let Some((motor, exchange)) = &mut self.exchange {
            let motor = *motor;
            let outcome = exchange.poll(uart, self.timing.bit_ticks, now_ticks)?;
            self.exchange = None;
            self.rests_until = Some(now_ticks.wrapping_add(REST_BITS.saturating_mul(self.timing.bit_ticks)));
            let is_stale = core::mem::take(&mut self.is_stale);
            if self.to_quieten < N {
                self.to_quieten += 1;
                return None;
            }
            if is_stale {
                return None;
            }
            return self.answered(motor, outcome, now_ticks);
        }
        if self.rests_until.is_some_and(|until| !is_past(until, now_ticks)) {
            return None;
        }
        self.rests_until = None;
        let (motor, request) = self.next_request(now_ticks)?;
        let wiring = self.driver(motor)?.wiring;
        let mut exchange = Exchange::new(request, &wiring);
        // It begins to send; it cannot have ended.
        let _ = exchange.poll(uart, self.timing.bit_ticks, now_ticks);
        self.exchange = Some((motor, exchange));
        None
    }

    /// Ticks until a call of [`Self::poll`] may be of use, less than 2^31.
    #[must_use]
    pub fn idle_ticks(&self, now_ticks: u32) -> u32 {
        if self.to_tell != 0 {
            return 0;
        }
        if self.exchange.is_some() {
            // A byte.
            return self.timing.bit_ticks.saturating_mul(10);
        }
        if let Some(until) = self.rests_until
            && !is_past(until, now_ticks)
        {
            return until.wrapping_sub(now_ticks);
        }
        let mut least = self.timing.look_ticks;
        for (driver, at) in self.drivers.iter().zip(self.looks_at) {
            let Some(driver) = driver else { continue };
            if matches!(driver.state(), DriverState::Failed(Failure::Settings(_))) {
                continue;
            }
            if driver.is_busy() || is_past(at, now_ticks) {
                return 0;
            }
            least = least.min(at.wrapping_sub(now_ticks));
        }
        least
    }

    fn next_request(&mut self, now_ticks: u32) -> Option<(usize, Request)> {
        while self.to_quieten < N {
            if self.driver(self.to_quieten).is_some() {
                let (register, value) = RegisterImage::NODE_CONF;
                return Some((self.to_quieten, Request::Write(register, value)));
            }
            self.to_quieten += 1;
        }
        for _ in 0..N {
            let motor = self.turn;
            if let Some(driver) = self.drivers.get_mut(motor).and_then(Option::as_mut) {
                if !driver.is_busy() && self.looks_at.get(motor).is_some_and(|at| is_past(*at, now_ticks)) {
                    driver.look();
                    if let Some(at) = self.looks_at.get_mut(motor) {
                        *at = now_ticks.wrapping_add(self.timing.look_ticks);
                    }
                }
                if let Some(request) = driver.request() {
                    return Some((motor, request));
                }
            }
            self.turn = (motor + 1) % N;
        }
        None
    }

    fn answered(
        &mut self,
        motor: usize,
        outcome: Result<u32, super::ExchangeError>,
        now_ticks: u32,
    ) -> Option<DriverEvent> {
        let driver = self.drivers.get_mut(motor).and_then(Option::as_mut)?;
        let kind = driver.answered(outcome);
        if !driver.is_busy() {
            let wait = match driver.state() {
                DriverState::Failed(_) => self.timing.retry_ticks,
                _ => self.timing.look_ticks,
            };
            if let Some(at) = self.looks_at.get_mut(motor) {
                *at = now_ticks.wrapping_add(wait);
            }
        }
        self.happened(motor, kind?)
    }

    fn happened(&mut self, motor: usize, kind: DriverEventKind) -> Option<DriverEvent> {
        let event = DriverEvent { motor, kind };
        if event.stops_motion() {
            self.moved |= 1 << event.axis();
        }
        Some(event)
    }
}

/// Returns true if a moment has come, on a clock that wraps.
const fn is_past(moment: u32, now_ticks: u32) -> bool {
    now_ticks.wrapping_sub(moment) as i32 >= 0
}
