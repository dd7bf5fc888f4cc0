//! The requests between a reset and an open port, in the order of a real host.

use super::bus::{Answer, Bus, Token};
use super::control::{Control, Outcome};
use super::descriptors::{self, Device, Serial};
use super::pipe::{Pipe, duration_ns};
use super::step::Step;
use super::{MAX_ENUMERATIONS, Phase, UsbHost};

/// The address that the host assigns to the device.
const ADDRESS: u8 = 5;
/// 115200 baud, one stop bit, no parity, eight data bits: CDC PSTN 1.2, table 17.
const LINE_CODING: [u8; 7] = [0x00, 0xC2, 0x01, 0x00, 0, 0, 8];
/// Carrier and data terminal ready: CDC PSTN 1.2, table 18.
const DTR_AND_RTS: u8 = 3;

impl UsbHost {
    /// Starts a request.
    pub(super) fn request(&mut self, step: Step) {
        let [length_low, length_high] = (self.configuration.len() as u16).to_le_bytes();
        let [language_low, language_high] = self.language.to_le_bytes();
        let configuration = self.serial.map_or(1, |serial| serial.configuration);
        let interface = self.serial.map_or(0, |serial| serial.control_interface);
        let index = |which: u8| self.device.map_or(0, |device| device.strings[usize::from(which % 3)]);
        let (setup, data) = match step {
            Step::DescriptorHead => ([0x80, 6, 0, 1, 0, 0, 8, 0], &[][..]),
            Step::SetAddress => ([0x00, 5, ADDRESS, 0, 0, 0, 0, 0], &[][..]),
            Step::Device => ([0x80, 6, 0, 1, 0, 0, 18, 0], &[][..]),
            Step::ConfigurationHead => ([0x80, 6, 0, 2, 0, 0, 9, 0], &[][..]),
            Step::Configuration => ([0x80, 6, 0, 2, 0, 0, length_low, length_high], &[][..]),
            Step::Languages => ([0x80, 6, 0, 3, 0, 0, 255, 0], &[][..]),
            Step::Text(which) => ([0x80, 6, index(which), 3, language_low, language_high, 255, 0], &[][..]),
            Step::SetConfiguration => ([0x00, 9, configuration, 0, 0, 0, 0, 0], &[][..]),
            Step::LineCoding => ([0x21, 0x20, 0, 0, interface, 0, 7, 0], &LINE_CODING[..]),
            Step::LineState => ([0x21, 0x22, DTR_AND_RTS, 0, interface, 0, 0, 0], &[][..]),
            Step::ClearHalt(endpoint) => ([0x02, 1, 0, 0, endpoint, 0, 0, 0], &[][..]),
        };
        let size = if step == Step::DescriptorHead { 64 } else { self.control_packet };
        self.control_packet = size;
        self.phase = Phase::Requesting {
            step,
            control: Control::new(setup, data.to_vec(), size),
            ready_ns: self.now_ns,
            give_up_ns: self.now_ns + self.timing.request_ns,
        };
    }

    /// Runs the next transaction of the request.
    pub(super) fn try_request(&mut self, bus: &mut impl Bus) {
        let Phase::Requesting { step, control, ready_ns, give_up_ns } = &mut self.phase else { return };
        let (step, gone) = (*step, self.now_ns >= *give_up_ns);
        let answer = bus.transact(&Token { address: self.address, endpoint: 0, kind: control.next(true) });
        let bytes = match &answer {
            Answer::Data { bytes, .. } => bytes.len() as u64,
            _ => 8,
        };
        self.free_ns = self.now_ns + duration_ns(bytes);
        *ready_ns = self.free_ns;
        match answer {
            Answer::Nak => {
                self.errors.naks += 1;
                *ready_ns = self.now_ns + self.timing.nak_retry_ns;
            }
            Answer::Silence => self.errors.timeouts += 1,
            Answer::Stall => self.errors.stalls += 1,
            Answer::Ack | Answer::Data { .. } => {}
        }
        let outcome = control.take(answer);
        if std::mem::take(&mut control.repeated) {
            self.errors.repeated_packets += 1;
        }
        match outcome {
            Some(Outcome::Done(bytes)) => self.requested(step, bytes, bus),
            Some(Outcome::Stalled) => self.refused(step, bus),
            Some(Outcome::Unanswered) => self.fail(&format!("no answer to three attempts of {step:?}"), bus),
            Some(Outcome::Broken(how)) => {
                self.errors.broken += 1;
                self.fail(&format!("{step:?}: {how}"), bus);
            }
            None if gone => self.fail(&format!("{step:?} was NAKed until the host's time limit"), bus),
            None => {}
        }
    }

    /// Continues after a request that succeeded.
    fn requested(&mut self, step: Step, bytes: Vec<u8>, bus: &mut impl Bus) {
        match step {
            Step::DescriptorHead => match descriptors::control_packet(&bytes) {
                Ok(size) => {
                    self.control_packet = size;
                    self.begin_reset(Step::SetAddress, bus);
                }
                Err(why) => self.fail(&why, bus),
            },
            Step::SetAddress => {
                self.address = ADDRESS;
                self.next_step = Step::Device;
                self.phase = Phase::Recovering { until_ns: self.now_ns + self.timing.address_ns };
            }
            Step::Device => match Device::parse(&bytes) {
                Ok(device) => {
                    self.device = Some(device);
                    self.request(Step::ConfigurationHead);
                }
                Err(why) => self.fail(&why, bus),
            },
            Step::ConfigurationHead => match bytes[..] {
                [9, 2, low, high, ..] => {
                    self.configuration = vec![0; u16::from_le_bytes([low, high]).into()];
                    self.request(Step::Configuration);
                }
                _ => {
                    self.fail(&format!("the configuration descriptor begins with {bytes:02x?}, expected [09, 02]"), bus)
                }
            },
            Step::Configuration => {
                self.configuration = bytes;
                self.request(Step::Languages);
            }
            Step::Languages => {
                self.language = bytes.get(2..4).map_or(0, |pair| u16::from_le_bytes([pair[0], pair[1]]));
                self.next_text(0, bus);
            }
            Step::Text(which) => {
                self.strings[usize::from(which % 3)] = descriptors::text(&bytes);
                self.next_text(which + 1, bus);
            }
            Step::SetConfiguration => self.request(Step::LineCoding),
            Step::LineCoding => self.request(Step::LineState),
            Step::LineState => self.open(),
            Step::ClearHalt(endpoint) => {
                self.restart(endpoint);
                self.phase = Phase::Open;
            }
        }
    }

    /// Continues after a stalled request, which is harmless for strings and the serial
    /// port's settings.
    fn refused(&mut self, step: Step, bus: &mut impl Bus) {
        match step {
            Step::Languages => self.next_text(3, bus),
            Step::Text(which) => self.next_text(which + 1, bus),
            Step::LineCoding => self.request(Step::LineState),
            Step::LineState => self.open(),
            _ => self.fail(&format!("the device stalled {step:?}"), bus),
        }
    }

    /// Requests the next string of the device; after the last selects the configuration.
    fn next_text(&mut self, from: u8, bus: &mut impl Bus) {
        let strings = self.device.map_or([0; 3], |device| device.strings);
        match (from..3).find(|which| strings[usize::from(*which)] != 0) {
            Some(which) => self.request(Step::Text(which)),
            None => match Serial::parse(&self.configuration) {
                Ok(serial) => {
                    self.serial = Some(serial);
                    self.request(Step::SetConfiguration);
                }
                Err(why) => {
                    // Another attempt would read the same descriptors.
                    self.attempts = MAX_ENUMERATIONS;
                    self.fail(&why, bus);
                }
            },
        }
    }

    fn open(&mut self) {
        let Some(serial) = self.serial else { return };
        let now_ns = self.now_ns;
        let pipe = |(endpoint, size): (u8, u16)| Pipe { endpoint, size, ready_ns: now_ns, ..Pipe::default() };
        self.input = pipe(serial.input);
        self.output = pipe(serial.output);
        self.notification = serial.notification.map(|(endpoint, interval)| Pipe { interval, ..pipe((endpoint, 64)) });
        self.packet = None;
        self.attempts = 0;
        self.phase = Phase::Open;
    }

    /// Follows a failure of the device: starts again from a reset, or gives the device up after
    /// the last attempt.
    pub(super) fn fail(&mut self, why: &str, bus: &mut impl Bus) {
        self.errors.failed_requests += 1;
        if !bus.connected() {
            self.lose_device();
            return;
        }
        self.attempts += 1;
        if self.attempts < MAX_ENUMERATIONS {
            self.begin_reset(Step::DescriptorHead, bus);
            return;
        }
        let name = match self.device {
            Some(Device { vendor, product, .. }) => format!("{vendor:04x}:{product:04x} {:?}", self.strings[1]),
            None => "unknown device".into(),
        };
        self.phase = Phase::Refused(format!("{name}: {why}"));
    }
}
