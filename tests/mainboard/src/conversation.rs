//! A conversation with a running board: virtual time passes only while the caller
//! waits for an answer.
//!
//! For tests and other programs that send, check, and send again. The run has its own thread, which
//! stands still between two calls: the result does not depend on the speed of this computer, and
//! the same calls give the same answers.

use std::collections::VecDeque;
use std::fmt;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

use rigless::emulator::{self, Host};
use rigless::image::Image;

use crate::machine::{HOST_PORT, Machine};
use crate::run::{self, Finished, Operator, Options, Turn};

/// The line between host and board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Via {
    /// The serial line.
    Serial,
    /// The USB plug, which is plugged in at the start.
    Usb,
}

/// A line from the board.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BoardLine {
    /// Arrival of its last byte, ns.
    pub at_ns: u64,
    /// The text, without the line's end.
    pub text: String,
}

/// An action on the machine between two slices of the run.
type Action = Box<dyn FnOnce(&mut Machine, u64, &mut dyn Host) + Send>;

enum Command {
    Do(Action),
    Listen { until_ns: u64 },
    Wait { until_ns: u64 },
    Reset,
    End,
}

enum Answer {
    Heard(BoardLine),
    Silence { now_ns: u64 },
}

/// The operator that executes the commands of the other thread.
pub struct ConversationOperator {
    via: Via,
    commands: Receiver<Command>,
    answers: Sender<Answer>,
    partial: Vec<u8>,
    lines: VecDeque<BoardLine>,
    listening_until_ns: Option<u64>,
    waiting_until_ns: Option<u64>,
}

impl fmt::Debug for ConversationOperator {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.debug_struct("ConversationOperator")
            .field("partial", &self.partial)
            .field("lines", &self.lines)
            .finish_non_exhaustive()
    }
}

impl ConversationOperator {
    fn collect_lines(&mut self, machine: &mut Machine, now_ns: u64) {
        let bytes: Vec<(u64, u8)> = match self.via {
            Via::Usb => machine.usb_host.read().into_iter().map(|byte| (now_ns, byte)).collect(),
            Via::Serial => {
                let Some(mailbox) = machine.mailbox(HOST_PORT) else { return };
                mailbox.take().map(|(at_ns, word)| (at_ns, word as u8)).collect()
            }
        };
        for (at_ns, byte) in bytes {
            match byte {
                b'\n' => {
                    let bytes = std::mem::take(&mut self.partial);
                    let text = String::from_utf8_lossy(&bytes).trim_end_matches('\r').to_owned();
                    self.lines.push_back(BoardLine { at_ns, text });
                }
                byte => self.partial.push(byte),
            }
        }
    }
}

impl Operator for ConversationOperator {
    fn turn(&mut self, machine: &mut Machine, now_ns: u64, host: &mut dyn Host) -> Turn {
        self.collect_lines(machine, now_ns);
        loop {
            if let Some(until_ns) = self.waiting_until_ns {
                if now_ns < until_ns {
                    return Turn::Continue;
                }
                self.waiting_until_ns = None;
                if self.answers.send(Answer::Silence { now_ns }).is_err() {
                    return Turn::Stop;
                }
            }
            if let Some(until_ns) = self.listening_until_ns {
                let answer = match self.lines.pop_front() {
                    Some(line) => Answer::Heard(line),
                    None if now_ns >= until_ns => Answer::Silence { now_ns },
                    None => return Turn::Continue,
                };
                self.listening_until_ns = None;
                if self.answers.send(answer).is_err() {
                    return Turn::Stop;
                }
            }
            match self.commands.recv() {
                Ok(Command::Do(action)) => action(machine, now_ns, host),
                Ok(Command::Listen { until_ns }) => self.listening_until_ns = Some(until_ns),
                Ok(Command::Wait { until_ns }) => self.waiting_until_ns = Some(until_ns),
                Ok(Command::Reset) => return Turn::Reset,
                Ok(Command::End) | Err(_) => return Turn::Stop,
            }
        }
    }

    fn next_turn_ns(&self) -> Option<u64> {
        self.listening_until_ns.or(self.waiting_until_ns)
    }
}

/// A running board.
#[derive(Debug)]
pub struct Conversation {
    via: Via,
    commands: Sender<Command>,
    answers: Receiver<Answer>,
    run: Option<JoinHandle<Result<Finished<ConversationOperator>, emulator::Error>>>,
    now_ns: u64,
}

impl Conversation {
    /// Version of [`Self::start_via`] for the serial line.
    ///
    /// # Errors
    /// The operating system refuses a thread.
    pub fn start(machine: Machine, images: Vec<Image>, boot: u64) -> Result<Self, String> {
        Self::start_via(Via::Serial, machine, images, boot)
    }

    /// Switches a machine on with these images in its memories; `boot` is the address of
    /// the vector table.
    ///
    /// # Errors
    /// The operating system refuses a thread.
    pub fn start_via(via: Via, mut machine: Machine, images: Vec<Image>, boot: u64) -> Result<Self, String> {
        if via == Via::Usb {
            machine.usb_host.plug();
        }
        let (commands, incoming) = channel();
        let (outgoing, answers) = channel();
        let puppet = ConversationOperator {
            via,
            commands: incoming,
            answers: outgoing,
            partial: Vec::new(),
            lines: VecDeque::new(),
            listening_until_ns: None,
            waiting_until_ns: None,
        };
        let run = std::thread::Builder::new()
            .name("mainboard".to_owned())
            .spawn(move || {
                let options = Options { boot: Some(boot), ..Options::default() };
                run::run(machine, &images, &options, puppet)
            })
            .map_err(|error| format!("cannot start a thread for the run: {error}"))?;
        Ok(Self { via, commands, answers, run: Some(run), now_ns: 0 })
    }

    /// The board's time at the last answer, ns.
    #[must_use]
    pub const fn now_ns(&self) -> u64 {
        self.now_ns
    }

    /// Acts on the machine and the chip's memory while the run is paused. The chip sees changes
    /// to [`Machine::plant`] after [`crate::plant::Plant::refresh_inputs`].
    ///
    /// # Errors
    /// The run has ended; the text says why.
    pub fn with<T: Send + 'static>(
        &mut self,
        action: impl FnOnce(&mut Machine, &mut dyn Host) -> T + Send + 'static,
    ) -> Result<T, String> {
        let (give, take) = channel();
        let action: Action = Box::new(move |machine, now_ns, host| {
            // The caller waits below, so the channel is open.
            let _ = give.send((now_ns, action(machine, host)));
        });
        self.command(Command::Do(action))?;
        let (now_ns, result) = take.recv().map_err(|_| self.why_it_ended())?;
        self.now_ns = now_ns;
        Ok(result)
    }

    /// Sends bytes on the host's line, as fast as the board takes them.
    ///
    /// # Errors
    /// The run has ended; the text says why.
    pub fn send(&mut self, bytes: &[u8]) -> Result<(), String> {
        let (via, bytes) = (self.via, bytes.to_vec());
        self.with(move |machine, _| {
            if via == Via::Usb {
                machine.usb_host.write(&bytes);
            } else if let Some(mailbox) = machine.mailbox(HOST_PORT) {
                bytes.into_iter().for_each(|byte| mailbox.send(0, u16::from(byte)));
            }
        })
    }

    /// The next line from the board; `None` if no line has come at this instant of its time.
    ///
    /// # Errors
    /// The run has ended; the text says why.
    pub fn next_line(&mut self, until_ns: u64) -> Result<Option<BoardLine>, String> {
        self.command(Command::Listen { until_ns })?;
        match self.answers.recv().map_err(|_| self.why_it_ended())? {
            Answer::Heard(line) => {
                self.now_ns = self.now_ns.max(line.at_ns);
                Ok(Some(line))
            }
            Answer::Silence { now_ns } => {
                self.now_ns = now_ns;
                Ok(None)
            }
        }
    }

    /// Advances time to this instant; lines that arrive meanwhile are kept.
    ///
    /// # Errors
    /// The run has ended; the text says why.
    pub fn wait(&mut self, until_ns: u64) -> Result<(), String> {
        self.command(Command::Wait { until_ns })?;
        match self.answers.recv().map_err(|_| self.why_it_ended())? {
            Answer::Silence { now_ns } => self.now_ns = now_ns,
            // Unreachable while no listen command is open.
            Answer::Heard(line) => self.now_ns = line.at_ns,
        }
        Ok(())
    }

    /// Presses the reset button.
    ///
    /// # Errors
    /// The run has ended; the text says why.
    pub fn press_reset(&mut self) -> Result<(), String> {
        self.command(Command::Reset)
    }

    /// Ends the run.
    ///
    /// # Errors
    /// The run had ended before; the text says why.
    pub fn end(mut self) -> Result<Finished<ConversationOperator>, String> {
        // If the send fails the run has ended already, and the join below tells why.
        let _ = self.commands.send(Command::End);
        match self.run.take().map(JoinHandle::join) {
            Some(Ok(Ok(finished))) => Ok(finished),
            Some(Ok(Err(error))) => Err(error.to_string()),
            Some(Err(_)) => Err("the run panicked: see its message above".to_owned()),
            None => Err("the run had ended before".to_owned()),
        }
    }

    fn command(&mut self, command: Command) -> Result<(), String> {
        self.commands.send(command).map_err(|_| self.why_it_ended())
    }

    fn why_it_ended(&mut self) -> String {
        match self.run.take().map(JoinHandle::join) {
            Some(Ok(Ok(_))) => "the run has ended by itself: the image requested it".to_owned(),
            Some(Ok(Err(error))) => format!("the run has ended: {error}"),
            Some(Err(_)) => "the run panicked: see its message above".to_owned(),
            None => "the run had ended before".to_owned(),
        }
    }
}

impl Drop for Conversation {
    fn drop(&mut self) {
        let _ = self.commands.send(Command::End);
        if let Some(run) = self.run.take() {
            // `end` reports errors; a dropped conversation discards them.
            let _ = run.join();
        }
    }
}
