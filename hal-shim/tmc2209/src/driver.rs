//! One driver: its next datagram, and the meaning of its answers. Every course ends: a datagram is
//! tried at most [`TRIES`] times, a set-up [`ATTEMPTS`] times, and then the driver has failed.

use super::event::{DriverEventKind, Failure};
use super::exchange::{ExchangeError, Request};
use super::registers::{DriverStatus, GlobalStatus, Register, VERSION};
use super::settings::{DriverSettings, DriverWiring, RegisterImage, SettingsError};

/// Number of tries of a datagram. On a line that garbles one byte in a hundred, a read fails with a
/// chance of one in nine, and all of the tries in a row with one in 20 million.
pub(super) const TRIES: u8 = 8;

/// Number of set-ups that are begun before the driver has failed.
pub(super) const ATTEMPTS: u8 = 3;

/// Reliability of a driver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DriverState {
    /// The driver is being set up.
    Unconfirmed,
    /// The driver has confirmed all its registers.
    Confirmed,
    /// The set-up has failed. The bank tries again from time to time.
    Failed(Failure),
}

/// The stage of a driver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    Idle,
    /// NODECONF, on trust, before anything is read: it is written again as one of those that count.
    Quieten,
    /// IOIN's version.
    Identify,
    /// GSTAT to 0, as far as it may go.
    ClearStatus,
    /// IFCNT before the first write that counts.
    Count,
    /// A write, by its index.
    Write(usize),
    /// IFCNT after it.
    Counted(usize),
    /// A register that can be read, by the index of its write.
    ReadBack(usize),
    /// GSTAT at the end of the set-up.
    StillSet,
    /// GSTAT of a driver in service; its status and its load follow.
    ReadReset,
    ReadStatus,
    ReadLoad,
    /// GSTAT's flags to 0, after they were reported.
    ForgetStatus,
}

/// A driver's state in a report.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriverReport {
    /// Reliability of the driver.
    pub state: DriverState,
    /// Settings of the driver.
    pub settings: DriverSettings,
    /// Effective current in motion that this makes, mA.
    pub run_ma: u16,
    /// Effective current at standstill, mA.
    pub hold_ma: u16,
    /// Errors and warnings, as last read.
    pub status: DriverStatus,
    /// Measured load, 0 (much) to 510 (none), as last read.
    pub load: u16,
    /// Datagrams that had to be repeated.
    pub repeated: u32,
}

/// A driver.
#[derive(Clone, Copy, Debug)]
pub(super) struct Driver {
    pub(super) wiring: DriverWiring,
    settings: DriverSettings,
    image: Option<RegisterImage>,
    state: DriverState,
    step: Step,
    /// Tries of the present datagram; `attempts` counts those of the present set-up.
    tries: u8,
    attempts: u8,
    count: u8,
    /// The failure has been reported.
    told_failure: bool,
    /// GSTAT's flags that have been reported.
    told_status: GlobalStatus,
    /// DRV_STATUS' flags that have been reported.
    told: u32,
    status: DriverStatus,
    load: u16,
    repeated: u32,
}

impl Driver {
    /// A driver that still has to be set up.
    pub(super) fn new(settings: DriverSettings, wiring: DriverWiring) -> Self {
        let mut driver = Self {
            wiring,
            settings,
            image: None,
            state: DriverState::Unconfirmed,
            step: Step::Idle,
            tries: 0,
            attempts: 0,
            count: 0,
            told_failure: false,
            told_status: GlobalStatus::default(),
            told: 0,
            status: DriverStatus::default(),
            load: 0,
            repeated: 0,
        };
        match RegisterImage::new(&settings, &wiring) {
            Ok(image) => {
                driver.image = Some(image);
                driver.begin_set_up();
            }
            Err(error) => driver.state = DriverState::Failed(Failure::Settings(error)),
        }
        driver
    }

    pub(super) const fn state(&self) -> DriverState {
        self.state
    }

    pub(super) const fn settings(&self) -> DriverSettings {
        self.settings
    }

    /// Returns true if it wants the line now.
    pub(super) fn is_busy(&self) -> bool {
        self.step != Step::Idle
    }

    pub(super) fn report(&self) -> DriverReport {
        let (run_ma, hold_ma) = self.image.map_or((0, 0), |image| (image.run_ma, image.hold_ma));
        DriverReport {
            state: self.state,
            settings: self.settings,
            run_ma,
            hold_ma,
            status: self.status,
            load: self.load,
            repeated: self.repeated,
        }
    }

    /// Other settings, with which it is set up anew.
    pub(super) fn set(&mut self, settings: DriverSettings) -> Result<(), SettingsError> {
        self.image = Some(RegisterImage::new(&settings, &self.wiring)?);
        self.settings = settings;
        self.told_failure = false;
        self.begin_set_up();
        Ok(())
    }

    /// Reads the chip's state, or sets it up again. Call it when it is due.
    pub(super) fn look(&mut self) {
        match self.state {
            DriverState::Confirmed => self.go(Step::ReadReset),
            // Impossible settings stay impossible at the next attempt.
            DriverState::Failed(Failure::Settings(_)) => {}
            DriverState::Failed(_) | DriverState::Unconfirmed => {
                self.attempts = 0;
                self.go(Step::Quieten);
            }
        }
    }

    fn begin_set_up(&mut self) {
        self.state = DriverState::Unconfirmed;
        self.attempts = 0;
        self.go(Step::Quieten);
    }

    fn go(&mut self, step: Step) {
        self.step = step;
        self.tries = 0;
    }

    fn written(&self, index: usize) -> Option<(Register, u32)> {
        self.image.and_then(|image| image.writes.get(index).copied())
    }

    /// The driver's next datagram; `None` without one.
    pub(super) fn request(&self) -> Option<Request> {
        Some(match self.step {
            Step::Idle => return None,
            Step::Quieten => {
                let (register, value) = RegisterImage::NODE_CONF;
                Request::Write(register, value)
            }
            Step::Identify => Request::Read(Register::Ioin),
            Step::ClearStatus => Request::Write(Register::Gstat, GlobalStatus::CLEAR_ALL),
            // A reset since then is still to be noticed.
            Step::ForgetStatus => {
                Request::Write(Register::Gstat, GlobalStatus { reset: false, ..self.told_status }.bits())
            }
            Step::Count | Step::Counted(_) => Request::Read(Register::Ifcnt),
            Step::Write(index) => {
                let (register, value) = self.written(index)?;
                Request::Write(register, value)
            }
            Step::ReadBack(index) => Request::Read(self.written(index)?.0),
            Step::StillSet | Step::ReadReset => Request::Read(Register::Gstat),
            Step::ReadStatus => Request::Read(Register::DrvStatus),
            Step::ReadLoad => Request::Read(Register::SgResult),
        })
    }

    /// Handles the end of its datagram; returns an event, if there is one.
    pub(super) fn answered(&mut self, outcome: Result<u32, ExchangeError>) -> Option<DriverEventKind> {
        match (self.step, outcome) {
            (Step::Idle, _) => None,
            (Step::Quieten, _) => {
                self.go(Step::Identify);
                None
            }
            // The chip's count shows whether a write has arrived, even if its echo was garbled.
            (Step::Write(index), _) => {
                // The tries continue: they are of the write and its count together.
                self.step = Step::Counted(index);
                None
            }
            (Step::ClearStatus, _) => {
                self.go(Step::Count);
                None
            }
            // Clearing has failed; the flags are read again.
            (Step::ForgetStatus, _) => {
                self.go(Step::Idle);
                None
            }
            (_, Err(error)) => self.unanswered(error),
            (Step::Identify, Ok(pins)) => {
                let version = (pins >> 24) as u8;
                if version == VERSION {
                    self.go(Step::ClearStatus);
                    return None;
                }
                self.failed(Failure::Version(version))
            }
            (Step::Count, Ok(count)) => {
                self.count = count as u8;
                self.go(Step::Write(0));
                None
            }
            (Step::Counted(index), Ok(count)) => self.counted(index, count as u8),
            (Step::ReadBack(index), Ok(found)) => match self.written(index) {
                Some((register, written)) if found != written => {
                    self.failed(Failure::ReadBack { register, written, found })
                }
                _ => {
                    self.read_back_from(index + 1);
                    None
                }
            },
            (Step::StillSet, Ok(bits)) => {
                if GlobalStatus::from_bits(bits).reset {
                    return self.failed(Failure::Unsteady);
                }
                self.state = DriverState::Confirmed;
                self.told_failure = false;
                self.told_status = GlobalStatus::default();
                self.told = 0;
                self.go(Step::ReadReset);
                Some(DriverEventKind::Confirmed)
            }
            (Step::ReadReset, Ok(bits)) => self.global_status(GlobalStatus::from_bits(bits)),
            (Step::ReadStatus, Ok(bits)) => {
                self.go(Step::ReadLoad);
                self.driver_status(DriverStatus::from_bits(bits))
            }
            (Step::ReadLoad, Ok(load)) => {
                self.load = (load & 0x3ff) as u16;
                let latched = self.told_status.driver_error || self.told_status.charge_pump_low;
                self.go(if latched { Step::ForgetStatus } else { Step::Idle });
                None
            }
        }
    }

    /// Handles IFCNT after a write.
    fn counted(&mut self, index: usize, count: u8) -> Option<DriverEventKind> {
        if count == self.count.wrapping_add(1) {
            self.count = count;
            if self.written(index + 1).is_some() {
                self.go(Step::Write(index + 1));
            } else {
                self.read_back_from(0);
            }
            return None;
        }
        if count != self.count {
            // The chip has been reset, or another host writes.
            return self.failed(Failure::Unsteady);
        }
        self.repeated = self.repeated.wrapping_add(1);
        self.tries += 1;
        if self.tries < TRIES {
            self.step = Step::Write(index);
            return None;
        }
        let register = self.written(index).map_or(Register::Gconf, |(register, _)| register);
        self.failed(Failure::NotAccepted(register))
    }

    /// The first register from this one on that can be read back, or the end.
    fn read_back_from(&mut self, index: usize) {
        let mut index = index;
        while let Some((register, _)) = self.written(index) {
            if register.reads_back() {
                return self.go(Step::ReadBack(index));
            }
            index += 1;
        }
        self.go(Step::StillSet);
    }

    /// GSTAT in service.
    fn global_status(&mut self, status: GlobalStatus) -> Option<DriverEventKind> {
        if status.reset {
            self.begin_set_up();
            return Some(DriverEventKind::Reset);
        }
        self.go(Step::ReadStatus);
        let told = core::mem::replace(&mut self.told_status, status);
        (status.charge_pump_low && !told.charge_pump_low).then_some(DriverEventKind::ChargePumpLow)
    }

    /// DRV_STATUS in service.
    fn driver_status(&mut self, status: DriverStatus) -> Option<DriverEventKind> {
        self.status = status;
        let flags = status.bits() & (DriverStatus::FATAL | DriverStatus::WARNINGS);
        let new = flags & !self.told;
        // An open load shows only while a motor turns slowly: once is enough (section 5.5.3).
        const ONCE: u32 = 0b1100_0000;
        self.told = flags | self.told & ONCE;
        if new & DriverStatus::FATAL != 0 {
            return Some(DriverEventKind::SwitchedOff(status));
        }
        (new != 0).then_some(DriverEventKind::Warning(DriverStatus::from_bits(new)))
    }

    /// Handles a failed read.
    fn unanswered(&mut self, error: ExchangeError) -> Option<DriverEventKind> {
        self.repeated = self.repeated.wrapping_add(1);
        self.tries += 1;
        if self.tries < TRIES {
            return None;
        }
        if self.state == DriverState::Confirmed {
            self.begin_set_up();
            return Some(DriverEventKind::Lost(error));
        }
        self.failed(Failure::Line(error))
    }

    /// Handles a failed set-up: tries again, or gives up.
    fn failed(&mut self, failure: Failure) -> Option<DriverEventKind> {
        self.attempts += 1;
        if self.attempts < ATTEMPTS {
            self.go(Step::Quieten);
            return None;
        }
        self.go(Step::Idle);
        self.state = DriverState::Failed(failure);
        let told = core::mem::replace(&mut self.told_failure, true);
        (!told).then_some(DriverEventKind::Failed(failure))
    }
}
