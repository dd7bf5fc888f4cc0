//! The open port: bulk transactions in both directions, and polls of notifications.

use super::bus::{Answer, Bus, Kind, Token};
use super::control::ATTEMPTS;
use super::pipe::{Pipe, duration_ns};
use super::step::Step;
use super::{FRAME_NS, UsbHost};

/// Bytes of a NAK to an IN token: token, handshake and turnarounds.
const REFUSAL_BYTES: u64 = 7;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Which {
    Input,
    Output,
    Notification,
}

impl UsbHost {
    /// The instants at which pipes with work may use the bus.
    fn candidates(&self) -> impl Iterator<Item = (u64, Which)> + '_ {
        let output = (self.unsent() > 0).then_some((self.output, Which::Output));
        let notification = self.notification.map(|pipe| (pipe, Which::Notification));
        let input = Some((self.input, Which::Input));
        // At equal instants the pipe that used the bus last comes last.
        let pipes = if self.last_was_input { [notification, output, input] } else { [notification, input, output] };
        pipes.into_iter().flatten().map(|(pipe, which)| (self.slot_ns(pipe.ready_ns, pipe.size.into()), which))
    }

    /// The instant of the next transaction.
    pub(super) fn stream_ns(&self) -> u64 {
        self.candidates().map(|(at_ns, _)| at_ns).min().unwrap_or(u64::MAX)
    }

    /// Runs the due transaction.
    pub(super) fn try_stream(&mut self, bus: &mut impl Bus) {
        let Some((_, which)) = self.candidates().min_by_key(|(at_ns, _)| *at_ns) else { return };
        match which {
            Which::Output => self.send(bus),
            Which::Input | Which::Notification => self.poll(which, bus),
        }
    }

    fn take_handshake_loss(&mut self) -> bool {
        let lose = self.lose_handshakes > 0;
        self.lose_handshakes -= u32::from(lose);
        lose
    }

    fn send(&mut self, bus: &mut impl Bus) {
        self.last_was_input = false;
        let max = usize::from(self.output.size).min(self.outgoing.len());
        let data = match self.packet.take() {
            Some(packet) => packet,
            None => self.outgoing.drain(..max).collect(),
        };
        let kind = Kind::Out { toggle: self.output.toggle, data: &data };
        let mut answer = bus.transact(&Token { address: self.address, endpoint: self.output.endpoint, kind });
        self.free_ns = self.now_ns + duration_ns(data.len() as u64);
        self.output.ready_ns = self.free_ns;
        if answer == Answer::Ack && self.take_handshake_loss() {
            answer = Answer::Silence;
        }
        if answer == Answer::Ack {
            self.output.toggle = !self.output.toggle;
            self.output.attempts = 0;
            return;
        }
        self.packet = Some(data);
        self.retry(Which::Output, answer, bus);
    }

    fn poll(&mut self, which: Which, bus: &mut impl Bus) {
        let input = which == Which::Input;
        let pipe = if input { self.input } else { self.notification.unwrap_or_default() };
        // Only a packet has a handshake to lose, and the answer is not known yet.
        let lose = input && self.lose_handshakes > 0;
        let kind = Kind::In { acknowledged: !lose };
        let answer = bus.transact(&Token { address: self.address, endpoint: pipe.endpoint, kind });
        if input {
            self.last_was_input = true;
        }
        let Answer::Data { toggle, bytes } = answer else {
            self.free_ns = self.now_ns + REFUSAL_BYTES * 2_000 / 3;
            self.retry(which, answer, bus);
            return;
        };
        self.lose_handshakes -= u32::from(lose);
        self.free_ns = self.now_ns + duration_ns(bytes.len() as u64);
        let free_ns = self.free_ns;
        let expected = pipe.toggle == toggle;
        if bytes.len() > usize::from(pipe.size) {
            self.errors.broken += 1;
        } else if !expected {
            self.errors.repeated_packets += 1;
        } else if input {
            self.incoming.extend_from_slice(&bytes);
        }
        if let Some(pipe) = self.pipe(which) {
            pipe.ready_ns = free_ns + u64::from(pipe.interval) * FRAME_NS;
            pipe.attempts = 0;
            if expected {
                pipe.toggle = !toggle;
            }
        }
    }

    /// Sets the endpoint of this address back to DATA0.
    pub(super) fn restart(&mut self, address: u8) {
        for which in [Which::Input, Which::Output, Which::Notification] {
            let direction = if which == Which::Output { 0 } else { 0x80 };
            if let Some(pipe) = self.pipe(which)
                && pipe.endpoint | direction == address
            {
                pipe.toggle = false;
            }
        }
    }

    fn pipe(&mut self, which: Which) -> Option<&mut Pipe> {
        match which {
            Which::Input => Some(&mut self.input),
            Which::Output => Some(&mut self.output),
            Which::Notification => self.notification.as_mut(),
        }
    }

    /// Schedules another attempt after a transaction that failed, clears a halt, or
    /// gives the device up.
    fn retry(&mut self, which: Which, answer: Answer, bus: &mut impl Bus) {
        let (now_ns, nak_retry_ns) = (self.now_ns, self.timing.nak_retry_ns);
        let Some(pipe) = self.pipe(which) else { return };
        pipe.ready_ns = now_ns + (u64::from(pipe.interval) * FRAME_NS).max(nak_retry_ns);
        let endpoint = pipe.endpoint;
        pipe.attempts = if answer == Answer::Silence { pipe.attempts + 1 } else { 0 };
        let gone = pipe.attempts >= ATTEMPTS;
        match answer {
            Answer::Nak => self.errors.naks += 1,
            Answer::Silence => self.errors.timeouts += 1,
            Answer::Stall => {
                self.errors.stalls += 1;
                let to_host = which != Which::Output;
                self.request(Step::ClearHalt(endpoint | if to_host { 0x80 } else { 0 }));
            }
            Answer::Ack | Answer::Data { .. } => self.errors.broken += 1,
        }
        if gone {
            self.fail(&format!("no answer to three attempts at endpoint {endpoint}"), bus);
        }
    }
}
