//! One datagram out, its echo, and its reply if it asks for one.

use core::fmt;

use super::datagram::{
    READ_REQUEST_BYTES, REPLY_BYTES, ReplyError, WRITE_BYTES, parse_reply, read_request, write_request,
};
use super::registers::Register;
use super::settings::DriverWiring;
use super::uart::SingleWireUart;

/// Bits of a byte on the line: start, eight, stop.
const BYTE_BITS: u32 = 10;

/// The chip waits 24 bit times before it replies; another chip on the line, at its defaults, or a
/// line at its slowest edges may take some more.
const REPLY_DELAY_BITS: u32 = 40;

/// Margin for a caller that polls only now and then.
const SLACK_BITS: u32 = 40;

/// A request to a driver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Request {
    Read(Register),
    Write(Register, u32),
}

/// Reason why a datagram failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExchangeError {
    /// The sent bytes did not come back: the line is held, or not connected to the receiver.
    NoEcho,
    /// The bytes that came back differ from those sent.
    GarbledEcho,
    /// The request was on the line, and no chip replied.
    NoReply,
    /// The reply is malformed.
    BadReply(ReplyError),
}

impl fmt::Display for ExchangeError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoEcho => out.write_str("its serial line is silent, even to its own bytes"),
            Self::GarbledEcho => out.write_str("what is sent is garbled on its serial line"),
            Self::NoReply => out.write_str("no reply on its serial line"),
            Self::BadReply(error) => write!(out, "a reply is wrong, {error}"),
        }
    }
}

/// A datagram under way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Exchange {
    request: Request,
    line: u8,
    sent: [u8; WRITE_BYTES],
    received: [u8; READ_REQUEST_BYTES + REPLY_BYTES],
    count: usize,
    /// End of the wait for the reply; `None` before it was sent.
    deadline: Option<u32>,
    /// Time from which on a busy line has failed.
    busy_until: Option<u32>,
}

impl Exchange {
    pub(super) fn new(request: Request, wiring: &DriverWiring) -> Self {
        let mut sent = [0; WRITE_BYTES];
        match request {
            Request::Read(register) => {
                for (to, from) in sent.iter_mut().zip(read_request(wiring.address, register)) {
                    *to = from;
                }
            }
            Request::Write(register, value) => sent = write_request(wiring.address, register, value),
        }
        Self { request, line: wiring.line, sent, received: [0; 12], count: 0, deadline: None, busy_until: None }
    }

    /// Bytes of the request.
    const fn request_bytes(&self) -> usize {
        match self.request {
            Request::Read(_) => READ_REQUEST_BYTES,
            Request::Write(..) => WRITE_BYTES,
        }
    }

    /// Continues as far as it can; the value that was read (0 for a write) when it has ended.
    pub(super) fn poll(
        &mut self,
        uart: &mut impl SingleWireUart,
        bit_ticks: u32,
        now_ticks: u32,
    ) -> Option<Result<u32, ExchangeError>> {
        let request_bytes = self.request_bytes();
        let Some(deadline) = self.deadline else {
            let request = self.sent.get(..request_bytes).unwrap_or_default();
            if uart.send(self.line, request, now_ticks).is_ok() {
                let mut bits = request_bytes as u32 * BYTE_BITS + SLACK_BITS;
                if matches!(self.request, Request::Read(_)) {
                    bits += REPLY_DELAY_BITS + REPLY_BYTES as u32 * BYTE_BITS;
                }
                self.deadline = Some(now_ticks.wrapping_add(bits.saturating_mul(bit_ticks)));
                return None;
            }
            // A datagram takes less than this on a line that works.
            let longest = (WRITE_BYTES as u32 * BYTE_BITS + SLACK_BITS).saturating_mul(bit_ticks);
            let until = *self.busy_until.get_or_insert(now_ticks.wrapping_add(longest));
            return (now_ticks.wrapping_sub(until) as i32 >= 0).then_some(Err(ExchangeError::NoEcho));
        };
        let expected = match self.request {
            Request::Read(_) => request_bytes + REPLY_BYTES,
            Request::Write(..) => request_bytes,
        };
        while self.count < expected {
            let (Some(byte), Some(place)) = (uart.receive(now_ticks), self.received.get_mut(self.count)) else { break };
            *place = byte;
            self.count += 1;
        }
        // Only when all bytes that may come have come is the line idle.
        let is_over = now_ticks.wrapping_sub(deadline) as i32 >= 0;
        (self.count == expected || is_over).then(|| self.outcome())
    }

    fn outcome(&self) -> Result<u32, ExchangeError> {
        let request = self.sent.get(..self.request_bytes()).unwrap_or_default();
        let (echo, reply) = self.received.get(..self.count).unwrap_or_default().split_at(request.len().min(self.count));
        if echo.is_empty() {
            return Err(ExchangeError::NoEcho);
        }
        if echo != request {
            return Err(ExchangeError::GarbledEcho);
        }
        match self.request {
            Request::Write(..) => Ok(0),
            Request::Read(_) if reply.is_empty() => Err(ExchangeError::NoReply),
            Request::Read(register) => parse_reply(reply, register).map_err(ExchangeError::BadReply),
        }
    }
}
