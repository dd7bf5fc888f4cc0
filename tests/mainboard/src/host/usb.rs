//! The host at the other end of the USB cable: enumerates a serial port and transfers bytes,
//! in virtual time.
//!
//! The run asks [`UsbHost::next_event_ns`] when the host next needs the bus, advances to that
//! instant, and calls [`UsbHost::advance`]. One transaction, start of frame or change of the bus
//! happens at a time, so the chip runs between them as it does on a desk.
//!
//! | Behaviour | Source | Test |
//! |---|---|---|
//! | Attach, 100 ms of debounce, suspend after 3 ms of idle bus | USB 2.0 7.1.7.3, 7.1.7.6 | `a_device_is_debounced_and_reset_first` |
//! | Reset 50 ms (a root port's), recovery 10 ms | USB 2.0 7.1.7.5 | `a_device_is_debounced_and_reset_first` |
//! | First eight bytes, second reset, address, short and whole descriptors, strings, configuration, CDC requests | USB
//! 2.0 9.1.2, CDC PSTN 6.3 | `enumeration_follows_the_order_of_a_real_host` |
//! | Frames of 1 ms; at most 19 packets of 64 bytes in each | USB 2.0 5.8.4, table 5-9 | `a_frame_holds_nineteen_packets` |
//! | Data toggles, three attempts, stall and clear halt | USB 2.0 8.6, 8.7, 9.4.5 | `lost_handshakes_neither_lose_nor_repeat_bytes`, `a_halted_endpoint_is_cleared` |
//! | Cable out, suspend, reset in mid-transfer | USB 2.0 7.1.7 | `the_cable_may_be_unplugged_and_plugged_again`, `suspend_stops_the_frames`, `a_reset_enumerates_again` |
//! | Four attempts at a device that fails, then its name and the reason | Linux `hub.c` | `a_device_that_keeps_failing_is_refused`, `another_class_is_refused_by_name` |
//!
//! Left out: hubs, other speeds, isochronous and bulk transfers of other classes, the meaning of
//! CDC notifications (they are polled, counted and dropped), bandwidth of other devices, bit errors
//! other than lost handshakes, remote wakeup.

use std::collections::VecDeque;

pub mod bus;
pub mod control;
pub mod descriptors;
mod enumeration;
mod pipe;
mod step;
mod stream;

use bus::Bus;
use control::Control;
use descriptors::{Device, Serial};
use pipe::{Pipe, duration_ns};
use step::Step;

/// A frame, USB 2.0 section 5.3.
pub const FRAME_NS: u64 = 1_000_000;
/// The part of a frame that its start takes.
const START_OF_FRAME_NS: u64 = 3_000;
/// Maximum attempts to enumerate a device.
const MAX_ENUMERATIONS: u8 = 4;

/// The host's times, in nanoseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Timing {
    /// Time from the pull-up to the first reset, at least 100 ms.
    pub debounce_ns: u64,
    /// Duration of a reset, at least 10 ms; 50 ms at a root port.
    pub reset_ns: u64,
    /// Time from a reset or a resume to the first transaction, at least 10 ms.
    pub recovery_ns: u64,
    /// Time from SET_ADDRESS to the next request, 2 ms or more.
    pub address_ns: u64,
    /// Time from a NAK to the next attempt. Real hosts poll more often, but each attempt
    /// interrupts the run.
    pub nak_retry_ns: u64,
    /// Time limit of a request that the device NAKs.
    pub request_ns: u64,
}

impl Default for Timing {
    fn default() -> Self {
        Self {
            debounce_ns: 100_000_000,
            reset_ns: 50_000_000,
            recovery_ns: 10_000_000,
            address_ns: 2_000_000,
            nak_retry_ns: 50_000,
            request_ns: 5_000_000_000,
        }
    }
}

/// The host's state.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum State {
    /// The cable is out.
    Unplugged,
    /// The cable is in, and no device has a pull-up.
    Waiting,
    /// The host resets a device and reads its descriptors.
    Enumerating,
    /// The serial port is open.
    Open,
    /// The bus is suspended.
    Suspended,
    /// The host gave the device up; the text says why.
    Refused(String),
}

/// Counters of errors.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Errors {
    /// Transactions without an answer.
    pub timeouts: u64,
    /// Transactions answered with NAK. Not an error by itself.
    pub naks: u64,
    /// Requests and packets answered with STALL.
    pub stalls: u64,
    /// Packets that arrived twice and were dropped.
    pub repeated_packets: u64,
    /// Packets or answers that break the protocol.
    pub broken: u64,
    /// Requests that failed.
    pub failed_requests: u64,
    /// Devices that disconnected while the cable was in.
    pub disconnects: u64,
    /// Bytes from [`UsbHost::write`] that were lost with the connection.
    pub dropped_bytes: u64,
}

/// A request of the caller to the host or its cable.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
enum Command {
    Plug,
    Unplug,
    Suspend,
    Resume,
    Reset,
}

#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
enum Phase {
    Unplugged,
    /// Checks for a pull-up at the next poll.
    Waiting {
        poll_ns: u64,
    },
    Debouncing {
        idle_ns: Option<u64>,
        until_ns: u64,
    },
    Resetting {
        until_ns: u64,
    },
    /// Before the first request of `next_step`.
    Recovering {
        until_ns: u64,
    },
    /// A request, and the instant of its next attempt.
    Requesting {
        step: Step,
        control: Control,
        ready_ns: u64,
        give_up_ns: u64,
    },
    Open,
    Suspended {
        idle_ns: Option<u64>,
        poll_ns: u64,
    },
    Resuming {
        until_ns: u64,
    },
    Refused(String),
}

/// The host.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct UsbHost {
    /// The host's times.
    pub timing: Timing,
    /// Errors so far.
    pub errors: Errors,
    now_ns: u64,
    phase: Phase,
    commands: VecDeque<Command>,
    /// The next start of frame, while the bus is awake.
    frame_ns: Option<u64>,
    frame: u16,
    /// The end of the previous transaction.
    free_ns: u64,
    address: u8,
    control_packet: u8,
    next_step: Step,
    attempts: u8,
    device: Option<Device>,
    configuration: Vec<u8>,
    serial: Option<Serial>,
    language: u16,
    strings: [String; 3],
    outgoing: VecDeque<u8>,
    /// The current OUT packet, which must not change until it is acknowledged.
    packet: Option<Vec<u8>>,
    incoming: Vec<u8>,
    input: Pipe,
    output: Pipe,
    notification: Option<Pipe>,
    last_was_input: bool,
    lose_handshakes: u32,
}

impl Default for UsbHost {
    fn default() -> Self {
        Self::new()
    }
}

impl UsbHost {
    /// A host with its cable unplugged.
    #[must_use]
    pub fn new() -> Self {
        Self {
            timing: Timing::default(),
            errors: Errors::default(),
            now_ns: 0,
            phase: Phase::Unplugged,
            commands: VecDeque::new(),
            frame_ns: None,
            frame: 0,
            free_ns: 0,
            address: 0,
            control_packet: 8,
            next_step: Step::DescriptorHead,
            attempts: 0,
            device: None,
            configuration: Vec::new(),
            serial: None,
            language: 0,
            strings: Default::default(),
            outgoing: VecDeque::new(),
            packet: None,
            incoming: Vec::new(),
            input: Pipe::default(),
            output: Pipe::default(),
            notification: None,
            last_was_input: false,
            lose_handshakes: 0,
        }
    }

    /// Plugs the cable in at the next [`UsbHost::advance`], which also executes the
    /// other requests below.
    pub fn plug(&mut self) {
        self.commands.push_back(Command::Plug);
    }

    /// Unplugs the cable.
    pub fn unplug(&mut self) {
        self.commands.push_back(Command::Unplug);
    }

    /// Suspends the bus. No effect unless the port is open.
    pub fn suspend(&mut self) {
        self.commands.push_back(Command::Suspend);
    }

    /// Resumes the bus. No effect unless it is suspended.
    pub fn resume(&mut self) {
        self.commands.push_back(Command::Resume);
    }

    /// Resets the device and enumerates it again, in any state. No effect without a device.
    pub fn reset_bus(&mut self) {
        self.commands.push_back(Command::Reset);
    }

    /// Loses the handshake of this many of the next bulk transactions, so that their
    /// packets are sent twice.
    pub fn lose_handshakes(&mut self, count: u32) {
        self.lose_handshakes += count;
    }

    /// Queues bytes for the device until the port is open.
    pub fn write(&mut self, bytes: &[u8]) {
        self.outgoing.extend(bytes);
    }

    /// The number of bytes waiting to be sent, the current packet included.
    #[must_use]
    pub fn unsent(&self) -> usize {
        self.outgoing.len() + self.packet.as_ref().map_or(0, Vec::len)
    }

    /// Takes the bytes that the device has sent.
    pub fn read(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.incoming)
    }

    /// The host's state.
    #[must_use]
    pub fn state(&self) -> State {
        match &self.phase {
            Phase::Unplugged => State::Unplugged,
            Phase::Waiting { .. } => State::Waiting,
            Phase::Requesting { step: Step::ClearHalt(_), .. } | Phase::Open => State::Open,
            Phase::Debouncing { .. }
            | Phase::Resetting { .. }
            | Phase::Recovering { .. }
            | Phase::Requesting { .. } => State::Enumerating,
            Phase::Suspended { .. } | Phase::Resuming { .. } => State::Suspended,
            Phase::Refused(why) => State::Refused(why.clone()),
        }
    }

    /// The device descriptor, after it was read.
    #[must_use]
    pub fn device(&self) -> Option<Device> {
        self.device
    }

    /// The serial port of the descriptors, after they were read.
    #[must_use]
    pub fn serial(&self) -> Option<Serial> {
        self.serial
    }

    /// The device's maker, product and serial number; empty if it has none.
    #[must_use]
    pub fn strings(&self) -> &[String; 3] {
        &self.strings
    }

    /// The next instant at which the run should call [`UsbHost::advance`], ns: never before the
    /// last call, and `u64::MAX` while the cable is out.
    #[must_use]
    pub fn next_event_ns(&self) -> u64 {
        if !self.commands.is_empty() {
            return self.now_ns;
        }
        self.frame_ns.unwrap_or(u64::MAX).min(self.phase_ns()).max(self.now_ns)
    }

    /// The instant at which the phase continues.
    fn phase_ns(&self) -> u64 {
        match &self.phase {
            Phase::Unplugged | Phase::Refused(_) => u64::MAX,
            Phase::Waiting { poll_ns } => *poll_ns,
            Phase::Debouncing { idle_ns, until_ns } => idle_ns.unwrap_or(*until_ns),
            Phase::Resetting { until_ns } | Phase::Recovering { until_ns } | Phase::Resuming { until_ns } => *until_ns,
            Phase::Requesting { ready_ns, .. } => self.slot_ns(*ready_ns, u64::from(self.control_packet)),
            Phase::Open => self.stream_ns(),
            Phase::Suspended { idle_ns, poll_ns } => idle_ns.unwrap_or(*poll_ns),
        }
    }

    /// The first instant from `ready_ns` on at which a transaction with this many bytes
    /// fits into a frame.
    fn slot_ns(&self, ready_ns: u64, bytes: u64) -> u64 {
        let start = ready_ns.max(self.free_ns);
        match self.frame_ns {
            Some(frame_ns) if start + duration_ns(bytes) > frame_ns => frame_ns + START_OF_FRAME_NS,
            _ => start,
        }
    }

    /// Does everything that is due by `now_ns`, in order. `bus` acts at the run's current instant,
    /// so a run that goes from one [`UsbHost::next_event_ns`] to the next keeps exact times.
    pub fn advance(&mut self, now_ns: u64, bus: &mut impl Bus) {
        while let Some(command) = self.commands.pop_front() {
            self.now_ns = now_ns;
            self.execute(command, bus);
        }
        while self.next_event_ns() <= now_ns {
            self.now_ns = self.next_event_ns();
            if self.frame_ns.is_some_and(|frame_ns| frame_ns <= self.now_ns) {
                self.start_frame(bus);
            } else {
                self.continue_phase(bus);
            }
        }
        self.now_ns = now_ns;
    }

    fn execute(&mut self, command: Command, bus: &mut impl Bus) {
        match command {
            Command::Plug if self.phase == Phase::Unplugged => {
                self.phase = Phase::Waiting { poll_ns: self.now_ns };
            }
            Command::Unplug => {
                bus.set_vbus(false);
                self.clear_device();
                self.phase = Phase::Unplugged;
            }
            Command::Suspend if self.phase == Phase::Open => {
                self.frame_ns = None;
                let idle_ns = Some(self.now_ns + 3 * FRAME_NS);
                self.phase = Phase::Suspended { idle_ns, poll_ns: self.now_ns };
            }
            Command::Resume if matches!(self.phase, Phase::Suspended { .. }) => {
                bus.resume();
                // 20 ms of resume, USB 2.0 section 7.1.7.7, then frames again.
                self.phase = Phase::Resuming { until_ns: self.now_ns + 20 * FRAME_NS };
            }
            Command::Reset if !matches!(self.phase, Phase::Unplugged | Phase::Waiting { .. }) => {
                self.attempts = 0;
                self.begin_reset(Step::DescriptorHead, bus);
            }
            Command::Plug | Command::Suspend | Command::Resume | Command::Reset => {}
        }
    }

    fn start_frame(&mut self, bus: &mut impl Bus) {
        self.frame = (self.frame + 1) & 0x7FF;
        self.frame_ns = Some(self.now_ns + FRAME_NS);
        self.free_ns = self.free_ns.max(self.now_ns + START_OF_FRAME_NS);
        if bus.connected() {
            bus.start_of_frame(self.frame);
        } else {
            self.lose_device();
        }
    }

    /// Follows a device that has switched its pull-up off.
    fn lose_device(&mut self) {
        self.errors.disconnects += 1;
        self.clear_device();
        self.phase = Phase::Waiting { poll_ns: self.now_ns + FRAME_NS };
    }

    /// Clears the state of the device, and the bytes to be sent to it.
    fn clear_device(&mut self) {
        self.errors.dropped_bytes += self.unsent() as u64;
        self.outgoing.clear();
        self.packet = None;
        self.frame_ns = None;
        self.attempts = 0;
        self.device = None;
        self.serial = None;
        self.strings = Default::default();
    }

    fn begin_reset(&mut self, next_step: Step, bus: &mut impl Bus) {
        bus.set_reset(true);
        self.frame_ns = None;
        self.address = 0;
        self.next_step = next_step;
        self.phase = Phase::Resetting { until_ns: self.now_ns + self.timing.reset_ns };
    }

    fn continue_phase(&mut self, bus: &mut impl Bus) {
        let now_ns = self.now_ns;
        match &self.phase {
            Phase::Unplugged | Phase::Refused(_) => {}
            Phase::Waiting { .. } => {
                // VBUS is a level, set at every poll: a chip that its reset has rebuilt
                // must find it again.
                bus.set_vbus(true);
                self.phase = if bus.connected() {
                    let until_ns = now_ns + self.timing.debounce_ns;
                    Phase::Debouncing { idle_ns: Some(now_ns + 3 * FRAME_NS), until_ns }
                } else {
                    Phase::Waiting { poll_ns: now_ns + FRAME_NS }
                };
            }
            Phase::Debouncing { idle_ns, until_ns } => {
                let (idle, until_ns) = (idle_ns.is_some(), *until_ns);
                if !bus.connected() {
                    self.lose_device();
                } else if idle {
                    bus.suspend();
                    self.phase = Phase::Debouncing { idle_ns: None, until_ns };
                } else {
                    self.begin_reset(Step::DescriptorHead, bus);
                }
            }
            Phase::Resetting { .. } => {
                bus.set_reset(false);
                if !bus.connected() {
                    self.lose_device();
                    return;
                }
                self.frame_ns = Some(now_ns + FRAME_NS);
                self.phase = Phase::Recovering { until_ns: now_ns + self.timing.recovery_ns };
            }
            Phase::Recovering { .. } => self.request(self.next_step),
            Phase::Requesting { .. } => self.try_request(bus),
            Phase::Open => self.try_stream(bus),
            Phase::Suspended { idle_ns, .. } => {
                let idle = idle_ns.is_some();
                if !bus.connected() {
                    self.lose_device();
                    return;
                }
                if idle {
                    bus.suspend();
                }
                self.phase = Phase::Suspended { idle_ns: None, poll_ns: now_ns + FRAME_NS };
            }
            Phase::Resuming { .. } => {
                self.frame_ns = Some(now_ns + FRAME_NS);
                self.free_ns = now_ns + self.timing.recovery_ns;
                self.phase = Phase::Open;
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
