//! A conversation with a running board: time passes only while the test waits for something.
//!
//! For tests and other programs that say one thing, look, and say the next. The run has a thread of its own, which stands
//! still between two questions: nothing depends on how fast this computer is, and whoever asks the same gets the same.

use std::collections::VecDeque;
use std::fmt;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

use rigless::emulator::{self, Host};
use rigless::image::Image;

use crate::machine::{HOST_PORT, Machine};
use crate::run::{self, Finished, Operator, Options, Turn};

/// A line that the board has said.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Line {
    /// When its last byte came, ns.
    pub at_ns: u64,
    /// Its text, without the line's end.
    pub text: String,
}

/// Something to do between two slices of the run.
type Action = Box<dyn FnOnce(&mut Machine, u64, &mut dyn Host) + Send>;

enum Command {
    Do(Action),
    Listen { until_ns: u64 },
    Wait { until_ns: u64 },
    Reset,
    End,
}

enum Answer {
    Heard(Line),
    Silence { now_ns: u64 },
}

/// Who does what the other thread says.
pub struct Puppet {
    commands: Receiver<Command>,
    answers: Sender<Answer>,
    partial: Vec<u8>,
    lines: VecDeque<Line>,
    listening_until_ns: Option<u64>,
    waiting_until_ns: Option<u64>,
}

impl fmt::Debug for Puppet {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.debug_struct("Puppet").field("partial", &self.partial).field("lines", &self.lines).finish_non_exhaustive()
    }
}

impl Puppet {
    fn hear(&mut self, machine: &mut Machine) {
        let Some(mailbox) = machine.mailbox(HOST_PORT) else { return };
        for (at_ns, word) in mailbox.take() {
            match word as u8 {
                b'\n' => {
                    let bytes = std::mem::take(&mut self.partial);
                    let text = String::from_utf8_lossy(&bytes).trim_end_matches('\r').to_owned();
                    self.lines.push_back(Line { at_ns, text });
                }
                byte => self.partial.push(byte),
            }
        }
    }
}

impl Operator for Puppet {
    fn turn(&mut self, machine: &mut Machine, now_ns: u64, host: &mut dyn Host) -> Turn {
        self.hear(machine);
        loop {
            if let Some(until_ns) = self.waiting_until_ns {
                if now_ns < until_ns {
                    return Turn::GoOn;
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
                    None => return Turn::GoOn,
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
    commands: Sender<Command>,
    answers: Receiver<Answer>,
    run: Option<JoinHandle<Result<Finished<Puppet>, emulator::Error>>>,
    now_ns: u64,
}

impl Conversation {
    /// Switches a machine on with these images in its memories; `boot` is where the core's table of handlers is.
    ///
    /// # Errors
    /// This computer gives no thread.
    pub fn start(machine: Machine, images: Vec<Image>, boot: u64) -> Result<Self, String> {
        let (commands, incoming) = channel();
        let (outgoing, answers) = channel();
        let puppet = Puppet {
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
            .map_err(|error| format!("there is no thread for the run: {error}"))?;
        Ok(Self { commands, answers, run: Some(run), now_ns: 0 })
    }

    /// The board's time when it last said or was asked something, ns.
    #[must_use]
    pub const fn now_ns(&self) -> u64 {
        self.now_ns
    }

    /// Does something with the machine, and with the chip's memory, while it stands still. What is broken or mended by hand
    /// in [`Machine::plant`] is seen by the chip after [`crate::plant::Plant::look_again`].
    ///
    /// # Errors
    /// The run has ended, and why.
    pub fn with<T: Send + 'static>(
        &mut self,
        action: impl FnOnce(&mut Machine, &mut dyn Host) -> T + Send + 'static,
    ) -> Result<T, String> {
        let (give, take) = channel();
        let action: Action = Box::new(move |machine, now_ns, host| {
            // Whoever asked waits for it.
            let _ = give.send((now_ns, action(machine, host)));
        });
        self.say(Command::Do(action))?;
        let (now_ns, result) = take.recv().map_err(|_| self.why_it_ended())?;
        self.now_ns = now_ns;
        Ok(result)
    }

    /// Sends bytes down the host's line, as fast as it takes them.
    ///
    /// # Errors
    /// The run has ended, and why.
    pub fn send(&mut self, bytes: &[u8]) -> Result<(), String> {
        let bytes = bytes.to_vec();
        self.with(|machine, _| {
            if let Some(mailbox) = machine.mailbox(HOST_PORT) {
                bytes.into_iter().for_each(|byte| mailbox.send(0, u16::from(byte)));
            }
        })
    }

    /// The next line that the board says; none if none has come at this instant of its time.
    ///
    /// # Errors
    /// The run has ended, and why.
    pub fn next_line(&mut self, until_ns: u64) -> Result<Option<Line>, String> {
        self.say(Command::Listen { until_ns })?;
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

    /// Lets time pass until this instant of the board's; what it says meanwhile is not lost.
    ///
    /// # Errors
    /// The run has ended, and why.
    pub fn wait(&mut self, until_ns: u64) -> Result<(), String> {
        self.say(Command::Wait { until_ns })?;
        match self.answers.recv().map_err(|_| self.why_it_ended())? {
            Answer::Silence { now_ns } => self.now_ns = now_ns,
            // Nobody listened.
            Answer::Heard(line) => self.now_ns = line.at_ns,
        }
        Ok(())
    }

    /// Presses the reset button.
    ///
    /// # Errors
    /// The run has ended, and why.
    pub fn press_reset(&mut self) -> Result<(), String> {
        self.say(Command::Reset)
    }

    /// Ends the run.
    ///
    /// # Errors
    /// It had ended before, and why.
    pub fn end(mut self) -> Result<Finished<Puppet>, String> {
        // Whether it hears that or has ended already, the answer is what the thread says.
        let _ = self.commands.send(Command::End);
        match self.run.take().map(JoinHandle::join) {
            Some(Ok(Ok(finished))) => Ok(finished),
            Some(Ok(Err(error))) => Err(error.to_string()),
            Some(Err(_)) => Err("the run panicked: its message is above".to_owned()),
            None => Err("the run had ended before".to_owned()),
        }
    }

    fn say(&mut self, command: Command) -> Result<(), String> {
        self.commands.send(command).map_err(|_| self.why_it_ended())
    }

    fn why_it_ended(&mut self) -> String {
        match self.run.take().map(JoinHandle::join) {
            Some(Ok(Ok(_))) => "the run has ended: the image asked for it".to_owned(),
            Some(Ok(Err(error))) => format!("the run has ended: {error}"),
            Some(Err(_)) => "the run panicked: its message is above".to_owned(),
            None => "the run had ended before".to_owned(),
        }
    }
}

impl Drop for Conversation {
    fn drop(&mut self) {
        let _ = self.commands.send(Command::End);
        if let Some(run) = self.run.take() {
            // Its failure was reported already, or does not matter.
            let _ = run.join();
        }
    }
}
