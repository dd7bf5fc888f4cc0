//! The card's answers to commands.

use super::{Answer, BLOCK_BYTES, Bus, Kind, Reading, SdCard, State};

/// Maximum clock of the bus until the card has an address, and afterwards, Hz (4.2.1, 4.3).
const IDENTIFICATION_HZ: u64 = 400_000;
const TRANSFER_HZ: u64 = 25_000_000;
/// Clocks before the first command (6.4.1).
const FIRST_CLOCKS: u64 = 74;

// The card's status, 4.10.1.
const OUT_OF_RANGE: u32 = 1 << 31;
const ADDRESS_ERROR: u32 = 1 << 30;
const BLOCK_LEN_ERROR: u32 = 1 << 29;
const ILLEGAL_COMMAND: u32 = 1 << 22;
pub(super) const ERROR: u32 = 1 << 19;
const READY_FOR_DATA: u32 = 1 << 8;
const APP_CMD: u32 = 1 << 5;

/// The voltages of the OCR, 2.7 to 3.6 V (5.1).
const VOLTAGES: u32 = 0x00FF_8000;
/// The CID: a maker, a name, a number (5.2).
const IDENTIFICATION: [u32; 4] = [0x0046_5346, 0x4D4F_4445, 0x1000_0001, 0x0001_9A01];

impl SdCard {
    /// Takes a command; `None` without an answer.
    pub fn command(&mut self, bus: Bus, index: u8, argument: u32) -> Option<Answer> {
        self.follow(bus.at_ns);
        self.is_awake |= self.is_powered && bus.clocks >= FIRST_CLOCKS;
        let max_hz = if self.state as u32 <= State::Identification as u32 { IDENTIFICATION_HZ } else { TRANSFER_HZ };
        if !self.is_awake || bus.hz > max_hz || self.faults.is_silent {
            return None;
        }
        let answer = if std::mem::take(&mut self.is_application) {
            self.application_command(bus, index, argument)
        } else {
            self.standard_command(bus, index, argument)
        };
        answer.unwrap_or_else(|| {
            self.errors |= ILLEGAL_COMMAND;
            None
        })
    }

    /// `None`: the state forbids it.
    fn application_command(&mut self, bus: Bus, index: u8, argument: u32) -> Option<Option<Answer>> {
        match (index, self.state) {
            (41, State::Idle) => Some(Some(Answer::WithoutCrc(self.operating_conditions(bus.at_ns, argument)))),
            (6, State::Transfer) => {
                let answer = self.status(APP_CMD);
                self.is_wide = argument & 0b11 == 0b10;
                Some(Some(answer))
            }
            // 4.3.9.1: an index that is no application command is a standard one.
            _ => self.standard_command(bus, index, argument),
        }
    }

    fn standard_command(&mut self, bus: Bus, index: u8, argument: u32) -> Option<Option<Answer>> {
        let is_mine = (argument >> 16) as u16 == self.address;
        let answer = match (index, self.state) {
            (0, _) => {
                self.go_idle();
                return Some(None);
            }
            (8, State::Idle) if self.config.kind != Kind::Version1 => {
                // 4.3.13: another voltage is not answered.
                if argument >> 8 & 0xF != 1 {
                    return Some(None);
                }
                self.knows_voltage = true;
                Answer::Short(argument & 0xFFF)
            }
            (55, State::Idle) => self.expect_application(),
            (55, state) if state as u32 >= State::StandBy as u32 => {
                if !is_mine {
                    return Some(None);
                }
                self.expect_application()
            }
            (2, State::Ready) => {
                self.state = State::Identification;
                Answer::Long(IDENTIFICATION)
            }
            (3, State::Identification | State::StandBy) => {
                let Answer::Short(status) = self.status(0) else { return Some(None) };
                self.state = State::StandBy;
                self.address = self.random.between(1, 0xFFFF) as u16;
                // R6, 4.9.5: bits 23, 22, 19 and 12 to 0 of the status.
                let bits = (status >> 8 & 0xC000) | (status >> 6 & 0x2000) | status & 0x1FFF;
                Answer::Short(u32::from(self.address) << 16 | bits)
            }
            (9, State::StandBy) if is_mine => Answer::Long(self.specific_data()),
            (10, State::StandBy) if is_mine => Answer::Long(IDENTIFICATION),
            (9 | 10, State::StandBy) => return Some(None),
            (7, State::StandBy | State::Disconnect) => {
                if !is_mine {
                    return Some(None);
                }
                let answer = self.status(0);
                self.state = if self.state == State::StandBy { State::Transfer } else { State::Programming };
                answer
            }
            (7, State::Transfer | State::SendingData | State::Programming) if !is_mine => {
                let programs = self.state == State::Programming;
                self.state = if programs { State::Disconnect } else { State::StandBy };
                self.reading = None;
                return Some(None);
            }
            (13, state) if state as u32 >= State::StandBy as u32 => {
                if !is_mine {
                    return Some(None);
                }
                self.status(0)
            }
            (16, State::Transfer) => {
                // 4.3.2: of a card of high capacity it changes nothing.
                let fits = self.config.kind == Kind::High || argument == BLOCK_BYTES as u32;
                self.status(if fits { 0 } else { BLOCK_LEN_ERROR })
            }
            (12, State::SendingData) => {
                let answer = self.status(0);
                (self.reading, self.state) = (None, State::Transfer);
                answer
            }
            (12, State::ReceiveData) => {
                let answer = self.status(0);
                (self.writing, self.state) = (None, State::Transfer);
                answer
            }
            (17, State::Transfer) => match self.place(argument) {
                Err(error) => self.status(error),
                Ok(block) => {
                    let answer = self.status(0);
                    let comes = !self.faults.unreadable.as_ref().is_some_and(|range| range.contains(&block));
                    let starts_ns = comes.then_some(bus.at_ns + self.config.access_ns);
                    self.reading = Some(Reading { block, starts_ns, ends_ns: None });
                    self.state = State::SendingData;
                    answer
                }
            },
            (24, State::Transfer) => match self.place(argument) {
                Err(error) => self.status(error),
                Ok(block) => {
                    let answer = self.status(0);
                    (self.writing, self.state) = (Some(block), State::ReceiveData);
                    answer
                }
            },
            _ => return None,
        };
        Some(Some(answer))
    }

    fn expect_application(&mut self) -> Answer {
        self.is_application = true;
        self.status(APP_CMD)
    }

    /// R1, 4.9.1.
    fn status(&mut self, bits: u32) -> Answer {
        let ready = if self.programming.is_none() { READY_FOR_DATA } else { 0 };
        Answer::Short(std::mem::take(&mut self.errors) | bits | ready | (self.state as u32) << 9)
    }

    /// The OCR, 5.1, in answer to ACMD41.
    fn operating_conditions(&mut self, now_ns: u64, argument: u32) -> u32 {
        // 4.2.3.1: without voltages it is a question only.
        if argument & 0x00FF_FFFF == 0 {
            return VOLTAGES;
        }
        let started_ns = *self.started_ns.get_or_insert(now_ns + self.config.start_ns);
        let is_high = self.config.kind == Kind::High;
        let knows_high = self.knows_voltage && argument >> 30 & 1 == 1;
        if now_ns < started_ns || is_high && !knows_high {
            return VOLTAGES;
        }
        self.state = State::Ready;
        1 << 31 | u32::from(is_high) << 30 | VOLTAGES
    }

    /// The CSD, 5.3.
    fn specific_data(&self) -> [u32; 4] {
        let blocks = self.config.blocks;
        match self.config.kind {
            Kind::High => {
                let size = (blocks / 1024).saturating_sub(1);
                [0x400E_0032, 0x5B59_0000 | size >> 16, size << 16 | 0x7F80, 0x0A40_0001]
            }
            Kind::Version1 | Kind::Standard => {
                // C_SIZE_MULT is 7: units of 2^9 blocks.
                let size = (blocks / 512).saturating_sub(1);
                [0x002E_0032, 0x5B59_8000 | size >> 2 & 0x3FF, size << 30 | 7 << 15 | 0x7F80, 0x0A40_0001]
            }
        }
    }

    /// The block of an address, or the error in the status.
    fn place(&self, argument: u32) -> Result<u32, u32> {
        let bytes = BLOCK_BYTES as u32;
        let block = match self.config.kind {
            Kind::High => argument,
            Kind::Version1 | Kind::Standard if argument.is_multiple_of(bytes) => argument / bytes,
            Kind::Version1 | Kind::Standard => return Err(ADDRESS_ERROR),
        };
        if block < self.config.blocks { Ok(block) } else { Err(OUT_OF_RANGE) }
    }
}
