//! The SDIO: RM0090 rev 22 chapter 31, RM0390 rev 6 chapter 29, with a slot for a card.
//!
//! rigless has a model too. In that one commands take no time, a block must be at hand as the data
//! path is switched on, and the data path knows no busy card. Those are where a driver waits, so
//! here they are modelled.
//!
//! | Register or section | Behaviour | Source | Test |
//! |---|---|---|---|
//! | `POWER`, `CLKCR` | without power or clock nothing moves; `SDIO_CK` is `SDIOCLK` / (`CLKDIV` + 2), or `SDIOCLK` | 31.9.1, 31.9.2 | `a_command_takes_the_time_of_its_bits` |
//! | `CMD`, `ARG` | 48 bits, an answer of 48 or 136 eight clocks later; `CMDACT` meanwhile, then `CMDSENT` or `CMDREND` | 31.3.1, 31.9.3, 31.9.4 | `a_command_takes_the_time_of_its_bits` |
//! | `CTIMEOUT` | 64 clocks without an answer | 31.3.1 | `an_empty_slot_times_out` |
//! | `CCRCFAIL` | an answer without a CRC (R3), or of another length | 31.9.11, ES0206 2.4.2 | `an_answer_without_crc_fails_its_check` |
//! | `RESPCMD`, `RESP1` to `4` | the answer; of a long one `RESPCMD` is 0x3F | 31.9.5, 31.9.6 | `a_command_takes_the_time_of_its_bits` |
//! | `DCTRL`, `DLEN`, `DCOUNT`, `DTIMER` | waits for the start bit for `DTIMER` clocks, then a word each 32 or 8 clocks | 31.3.1, 31.9.7 to 31.9.10 | `a_block_comes_when_the_card_has_it` |
//! | a start bit before the data path is on | is missed: the block is lost, `DTIMEOUT` | 31.3.1 | `a_data_path_that_is_late_misses_the_block` |
//! | `DCRCFAIL` | the CRC of a block, or a negative CRC status; the data path ends | 31.9.11 | `faults_of_blocks_are_flagged` |
//! | `Busy` | after a block to the card, while it is busy, for `DTIMER` clocks at most; then `DBCKEND`, `DATAEND` | 31.3.1 | `a_busy_card_holds_the_end_of_a_block`, `a_card_that_is_busy_for_longer_than_the_timer` |
//! | `RXOVERR`, `TXUNDERR` | a full FIFO as a word comes, an empty one as a word is due | 31.9.11 | `a_fifo_that_nobody_serves` |
//! | FIFO, its flags, `FIFOCNT` | 32 words | 31.9.11, 31.9.14, 31.9.15 | `a_block_comes_when_the_card_has_it` |
//! | `DMAEN` | a request while the FIFO is half full or half empty, and for the rest at the end; the last-data signal | 31.3.2, 10.3.15 | `a_stream_moves_a_block_each_way` |
//! | `ICR`, `MASK` | each flag by its bit; one interrupt line | 31.9.12, 31.9.13 | `a_command_takes_the_time_of_its_bits` |
//! | pins | without clock, command and D0 at alternate function 12 the card hears nothing; four lines need all | DS8626 table 9 | `a_card_needs_its_pins` |
//! | lines | a card and a host that disagree about their number: the CRC is wrong | | `faults_of_blocks_are_flagged` |
//!
//! **Left out**
//!
//! | What | Why |
//! |---|---|
//! | SD I/O, CE-ATA, stream mode, eight lines, read wait, `PWRSAV`, `HWFC_EN`, `NEGEDGE`, `STBITERR` | no driver here uses them |
//! | the waits between two writes to `POWER`, `CLKCR`, `CMD`, `DCTRL` | 31.9.1 to 31.9.9 name no flag for them |
//! | a clock that changes during a transfer | the transfer keeps its rate |
//! | whether `DATAEND` of a written block waits for the card's busy line | 31.3.1 has it wait in `Busy`; [`Sdio::ends_before_busy`] is the
//! other reading, which drivers must bear too |

use std::collections::VecDeque;

use rigless::device::{Device, DeviceContext, Level, RegisterFile};
use rigless::soc::FieldSpec;
use rigless::soc::stm32f427::generated::sdio::{Register, clkcr, cmd, dctrl, power, sta};
use rigless::soc::stm32f427::peripherals::sdio::{LAST_DATA_REQUEST, TRANSFER_REQUEST};
use rigless::time::{EventId, VirtualNanos};

use crate::parts::sd_card::{Answer, Bus, SdCard};

mod data;
#[cfg(test)]
mod tests;

use data::Data;

/// The only interrupt.
const GLOBAL: usize = 0;
/// Words of the FIFO (31.9.15), and what its "half" flags mean (31.9.11).
const FIFO_WORDS: usize = 32;
const HALF: usize = 8;
/// Clocks: of a command or a short answer, of a long answer, from a command to its answer (SD
/// specification 4.12.4), until `CTIMEOUT`.
const COMMAND_CLOCKS: u64 = 48;
const LONG_CLOCKS: u64 = 136;
const ANSWER_CLOCKS: u64 = 8;
const TIMEOUT_CLOCKS: u64 = 64;
/// `RESPCMD` of an answer without an index (31.9.5).
const NO_INDEX: u64 = 0x3F;
/// The flags that `ICR` clears (31.9.12).
const CLEARABLE: u64 = 0x00C0_07FF;

/// End of a command.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
enum Ending {
    Sent,
    Silent,
    Answered(Answer),
}

/// A command on its way.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
struct Command {
    index: u8,
    waits_long: bool,
    ends_ns: u64,
    ending: Ending,
}

/// The SDIO and its slot.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
pub struct Sdio {
    clock_hz: u64,
    /// Data lines between the port's pins and the slot: 0, 1 or 4.
    lines: u8,
    card: Option<SdCard>,
    /// The other reading of the manual: `DBCKEND` and `DATAEND` come with the CRC status, while the
    /// card is still busy.
    pub ends_before_busy: bool,
    /// Since when the card has had a clock, ns.
    clock_since_ns: Option<u64>,
    command: Option<Command>,
    data: Option<Data>,
    fifo: VecDeque<u32>,
    /// The last transfer came from the card.
    received: bool,
    request: Level,
    last_data: Level,
    interrupt: Level,
    wakeup: Option<(u64, EventId)>,
}

impl Sdio {
    /// An SDIO without a clock, with an empty slot.
    #[must_use]
    pub fn new() -> Self {
        Self {
            clock_hz: 0,
            lines: 0,
            card: None,
            ends_before_busy: false,
            clock_since_ns: None,
            command: None,
            data: None,
            fifo: VecDeque::new(),
            received: false,
            request: Level::Low,
            last_data: Level::Low,
            interrupt: Level::Low,
            wakeup: None,
        }
    }

    /// Puts a card into the slot, or takes it out; the one that was in it is
    /// returned, without power.
    pub fn exchange(&mut self, now_ns: u64, mut card: Option<SdCard>, is_powered: bool) -> Option<SdCard> {
        if let Some(card) = &mut card {
            card.set_power(now_ns, is_powered);
        }
        let mut before = std::mem::replace(&mut self.card, card);
        if let Some(before) = &mut before {
            before.set_power(now_ns, false);
            self.lose_card();
        }
        before
    }

    /// The lines float: an answer does not come, and a block on its way is spoilt.
    fn lose_card(&mut self) {
        if let Some(command) = &mut self.command
            && matches!(command.ending, Ending::Answered(_))
        {
            command.ending = Ending::Silent;
        }
        if let Some(data) = &mut self.data {
            data.spoil();
        }
    }

    /// The card in the slot.
    pub fn card_mut(&mut self) -> Option<&mut SdCard> {
        self.card.as_mut()
    }

    /// Takes over the slot of another instance: the chip's reset does not reach the card.
    pub fn inherit(&mut self, from: &mut Self) {
        self.card = from.card.take();
        self.ends_before_busy = from.ends_before_busy;
    }

    /// Sets how many data lines the ports connect to the slot: 0 without clock, command line or D0.
    pub(super) fn set_lines(&mut self, lines: u8) {
        self.lines = lines;
    }

    /// `SDIO_CK`, Hz; 0 without clock or power (31.9.1, 31.9.2).
    fn bus_hz(&self, registers: &RegisterFile) -> u64 {
        const POWER_ON: u64 = 0b11;
        let control = registers.get(Register::Clkcr);
        let is_on = power::PWRCTRL.get(registers.get(Register::Power)) == POWER_ON;
        if !is_on || !clkcr::CLKEN.is_set(control) {
            return 0;
        }
        if clkcr::BYPASS.is_set(control) { self.clock_hz } else { self.clock_hz / (clkcr::CLKDIV.get(control) + 2) }
    }

    /// Lines that the host uses (31.9.2).
    fn host_lines(registers: &RegisterFile) -> u8 {
        if clkcr::WIDBUS.get(registers.get(Register::Clkcr)) == 0b01 { 4 } else { 1 }
    }

    /// The card, where the lines reach it.
    fn reached(&mut self) -> Option<&mut SdCard> {
        self.card.as_mut().filter(|_| self.lines > 0)
    }

    fn send(&mut self, written: u64, registers: &mut RegisterFile, now_ns: u64) {
        let hz = self.bus_hz(registers);
        if !cmd::CPSMEN.is_set(written) || hz == 0 {
            return;
        }
        let (index, wait) = (cmd::CMDINDEX.get(written) as u8, cmd::WAITRESP.get(written));
        let clocks = |count: u64| clocks_ns(count, hz);
        let at_ns = now_ns + clocks(COMMAND_CLOCKS);
        let since_ns = self.clock_since_ns.unwrap_or(now_ns);
        let bus = Bus { at_ns, hz, clocks: (u128::from(now_ns - since_ns) * u128::from(hz) / 1_000_000_000) as u64 };
        let argument = registers.get(Register::Arg) as u32;
        let answer = self.reached().and_then(|card| card.command(bus, index, argument));
        let (ending, more) = match (wait, answer) {
            (0b00 | 0b10, _) => (Ending::Sent, 0),
            (_, None) => (Ending::Silent, TIMEOUT_CLOCKS),
            (_, Some(answer @ Answer::Long(_))) => (Ending::Answered(answer), ANSWER_CLOCKS + LONG_CLOCKS),
            (_, Some(answer)) => (Ending::Answered(answer), ANSWER_CLOCKS + COMMAND_CLOCKS),
        };
        self.command = Some(Command { index, waits_long: wait == 0b11, ends_ns: at_ns + clocks(more), ending });
        flag(registers, sta::CMDACT, true);
    }

    fn end_command(&mut self, registers: &mut RegisterFile, now_ns: u64) {
        let Some(command) = self.command.take_if(|command| command.ends_ns <= now_ns) else { return };
        flag(registers, sta::CMDACT, false);
        let outcome = match command.ending {
            Ending::Sent => sta::CMDSENT,
            Ending::Silent => sta::CTIMEOUT,
            Ending::Answered(answer) => {
                let (words, index, has_crc) = match answer {
                    Answer::Short(word) => ([word, 0, 0, 0], u64::from(command.index), true),
                    Answer::WithoutCrc(word) => ([word, 0, 0, 0], NO_INDEX, false),
                    Answer::Long(words) => (words, NO_INDEX, true),
                };
                registers.set(Register::Respcmd, index);
                let all = [Register::Resp1, Register::Resp2, Register::Resp3, Register::Resp4];
                let is_long = matches!(answer, Answer::Long(_));
                for (register, word) in all.into_iter().zip(words).take(if is_long { 4 } else { 1 }) {
                    registers.set(register, u64::from(word));
                }
                if has_crc && is_long == command.waits_long { sta::CMDREND } else { sta::CCRCFAIL }
            }
        };
        flag(registers, outcome, true);
    }

    /// Does everything that is due.
    fn settle(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let now_ns = context.now().0;
        self.end_command(registers, now_ns);
        let data_ns = self.advance_data(registers, now_ns);
        self.show_fifo(registers);
        self.drive(registers, context);
        let next_ns = [self.command.map(|command| command.ends_ns), data_ns].into_iter().flatten().min();
        if next_ns != self.wakeup.map(|(at_ns, _)| at_ns) {
            self.wakeup = next_ns.map(|at_ns| (at_ns, context.schedule(VirtualNanos(at_ns))));
        }
    }

    /// The FIFO's flags (31.9.11) and `FIFOCNT` (31.9.14).
    fn show_fifo(&mut self, registers: &mut RegisterFile) {
        let (held, room) = (self.fifo.len(), FIFO_WORDS - self.fifo.len());
        let receives = self.data.as_ref().map_or(self.received, Data::is_from_card);
        for (field, is_set) in [
            (sta::RXFIFOE, !receives || held == 0),
            (sta::RXFIFOF, receives && room == 0),
            (sta::RXFIFOHF, receives && held >= HALF),
            (sta::RXDAVL, receives && held > 0),
            (sta::TXFIFOE, receives || held == 0),
            (sta::TXFIFOF, !receives && room == 0),
            (sta::TXFIFOHE, receives || room >= HALF),
            (sta::TXDAVL, !receives && held > 0),
        ] {
            flag(registers, field, is_set);
        }
        let remaining = self.data.as_ref().map_or(0, Data::remaining);
        registers.set(Register::Dcount, remaining);
        registers.set(Register::Fifocnt, remaining.div_ceil(4));
    }

    /// The interrupt, and what a stream follows.
    fn drive(&mut self, registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        let status = registers.get(Register::Sta);
        let uses_dma = dctrl::DMAEN.is_set(registers.get(Register::Dctrl));
        let asks = match &self.data {
            Some(data) if data.is_from_card() => self.fifo.len() >= HALF,
            // The SDIO is the stream's flow controller, and asks for no more than it sends.
            Some(data) => FIFO_WORDS - self.fifo.len() >= HALF && (self.fifo.len() as u64) * 4 < data.to_fill(),
            None => self.received && sta::DATAEND.is_set(status) && !self.fifo.is_empty(),
        };
        let request = Level::from(uses_dma && asks);
        if std::mem::replace(&mut self.request, request) != request {
            context.request(TRANSFER_REQUEST, request);
        }
        let last_data = Level::from(sta::DATAEND.is_set(status));
        if std::mem::replace(&mut self.last_data, last_data) != last_data {
            context.request(LAST_DATA_REQUEST, last_data);
        }
        let interrupt = Level::from(status & registers.get(Register::Mask) != 0);
        if std::mem::replace(&mut self.interrupt, interrupt) != interrupt {
            context.interrupt(GLOBAL, interrupt);
        }
    }
}

impl Default for Sdio {
    fn default() -> Self {
        Self::new()
    }
}

/// The duration of clocks, ns.
fn clocks_ns(clocks: u64, hz: u64) -> u64 {
    u64::try_from(u128::from(clocks) * 1_000_000_000 / u128::from(hz.max(1))).unwrap_or(u64::MAX)
}

fn flag(registers: &mut RegisterFile, field: &FieldSpec, is_set: bool) {
    let status = registers.get(Register::Sta);
    registers.set(Register::Sta, field.set(status, u64::from(is_set)));
}

impl Device for Sdio {
    type Register = Register;

    fn on_clock(&mut self, hz: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.clock_hz = hz;
        if hz == 0 {
            (self.command, self.data) = (None, None);
        }
        self.settle(registers, context);
    }

    fn read(
        &mut self,
        register: Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        self.settle(registers, context);
        if register != Register::Fifo {
            return None;
        }
        let word = if sta::RXDAVL.is_set(registers.get(Register::Sta)) { self.fifo.pop_front() } else { None };
        self.settle(registers, context);
        Some(word.map_or(0, u64::from))
    }

    fn peek(&self, register: Register, _: &RegisterFile, _: VirtualNanos) -> Option<u64> {
        (register == Register::Fifo).then(|| self.fifo.front().map_or(0, |word| u64::from(*word)))
    }

    fn write(
        &mut self,
        register: Register,
        written: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let now_ns = context.now().0;
        self.settle(registers, context);
        match register {
            Register::Power | Register::Clkcr => {
                if self.bus_hz(registers) == 0 {
                    (self.clock_since_ns, self.command, self.data) = (None, None, None);
                } else {
                    self.clock_since_ns.get_or_insert(now_ns);
                }
            }
            Register::Cmd => self.send(written, registers, now_ns),
            Register::Dctrl => self.control_data(written, registers, now_ns),
            Register::Fifo => {
                let sends = self.data.as_ref().is_some_and(|data| !data.is_from_card());
                if sends && self.fifo.len() < FIFO_WORDS {
                    self.fifo.push_back(written as u32);
                }
            }
            Register::Icr => {
                let status = registers.get(Register::Sta);
                registers.set(Register::Sta, status & !(written & CLEARABLE));
            }
            _ => {}
        }
        self.settle(registers, context);
    }

    fn on_event(&mut self, event: EventId, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if self.wakeup.is_some_and(|(_, expected)| expected == event) {
            self.wakeup = None;
        }
        self.settle(registers, context);
    }

    fn reset(&mut self) {
        let mut fresh = Self { clock_hz: self.clock_hz, lines: self.lines, ..Self::new() };
        fresh.inherit(self);
        *self = fresh;
    }

    fn reset_line(&mut self, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        context.lower_requests(&[self.request, self.last_data]);
        self.reset();
    }
}
