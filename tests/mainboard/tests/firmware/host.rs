//! A host on the serial line: line numbers, checksums, one line at a time, resends on request.

use std::fmt;

use super::noise::Noise;

/// Number of received lines kept for error messages.
const REMEMBERED_LINES: usize = 12;

/// A serial line with a printer at its other end.
pub trait Port {
    /// Sends bytes.
    ///
    /// # Errors
    /// The printer has ended.
    fn send(&mut self, bytes: &[u8]) -> Result<(), String>;

    /// The next line from the printer, without its end; `None` if none has arrived at this instant
    /// of the printer's time, ns.
    ///
    /// # Errors
    /// The printer has ended.
    fn receive(&mut self, until_ns: u64) -> Result<Option<String>, String>;

    /// The printer's time, ns.
    fn now_ns(&self) -> u64;
}

/// The reason why the conversation ended.
#[derive(Debug)]
pub enum HostError {
    /// The printer has ended.
    Port(String),
    /// The expected line did not arrive within the time limit.
    Silent {
        /// The expected line.
        awaited: String,
        /// The last lines received.
        heard: Vec<String>,
    },
    /// An `Error:` other than for a garbled line.
    Fatal(String),
    /// A resend request for a line that was never sent.
    NeverSent(i64),
}

impl fmt::Display for HostError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Port(error) => write!(out, "the serial line broke: {error}"),
            Self::Silent { awaited, heard } => {
                write!(out, "timeout while waiting for {awaited}; the last lines were:")?;
                heard.iter().try_for_each(|line| write!(out, "\n  {line}"))
            }
            Self::Fatal(line) => write!(out, "the printer says {line:?}"),
            Self::NeverSent(number) => write!(out, "the printer asks for line {number}, which was never sent"),
        }
    }
}

impl std::error::Error for HostError {}

impl From<String> for HostError {
    fn from(error: String) -> Self {
        Self::Port(error)
    }
}

/// `text` with the checksum of the serial protocol and a line end.
pub fn with_checksum(text: &str) -> String {
    let checksum = text.bytes().fold(0, |sum, byte| sum ^ byte);
    format!("{text}*{checksum}\n")
}

/// The host.
#[derive(Debug)]
pub struct Host<P> {
    port: P,
    noise: Option<Noise>,
    limit_ns: u64,
    /// All numbered lines; the first has number 1.
    history: Vec<String>,
    /// Index in `history` of the line to send next.
    next: usize,
    heard: Vec<String>,
    acknowledged: u64,
    resends: u32,
}

impl<P: Port> Host<P> {
    /// A host that fails after a silence of `limit_ns`.
    pub fn new(port: P, limit_ns: u64) -> Self {
        Self {
            port,
            noise: None,
            limit_ns,
            history: Vec::new(),
            next: 0,
            heard: Vec::new(),
            acknowledged: 0,
            resends: 0,
        }
    }

    /// Adds noise to numbered lines from now on.
    pub fn set_noise(&mut self, noise: Noise) {
        self.noise = Some(noise);
    }

    /// The noise, with its counters.
    pub fn noise(&self) -> Option<&Noise> {
        self.noise.as_ref()
    }

    /// The number of resends that the printer requested.
    pub fn resends(&self) -> u32 {
        self.resends
    }

    /// The number of `ok`s received.
    pub fn acknowledged(&self) -> u64 {
        self.acknowledged
    }

    /// Returns the serial line and drops the host.
    pub fn into_port(self) -> P {
        self.port
    }

    /// The serial line.
    pub fn port(&mut self) -> &mut P {
        &mut self.port
    }

    /// Waits for the printer's `start` and sets the line number, like hosts do.
    ///
    /// # Errors
    /// The printer does not start, or does not answer.
    pub fn connect(&mut self) -> Result<(), HostError> {
        self.wait_for("start", |line| line == "start")?;
        self.port.send(with_checksum("N0 M110 N0").as_bytes())?;
        self.wait_for_ok()
    }

    /// Restarts the line numbers, after other users of the line.
    ///
    /// # Errors
    /// The printer does not answer.
    pub fn connect_again(&mut self) -> Result<(), HostError> {
        (self.history, self.next) = (Vec::new(), 0);
        self.port.send(with_checksum("N0 M110 N0").as_bytes())?;
        self.wait_for_ok()
    }

    /// Sends a command as the next numbered line and waits for its acknowledgement, with
    /// resends on request.
    ///
    /// # Errors
    /// See [`HostError`].
    pub fn send(&mut self, command: &str) -> Result<(), HostError> {
        self.history.push(command.to_owned());
        self.settle()
    }

    /// Sends a command as the next numbered line, and does not wait for its acknowledgement.
    ///
    /// # Errors
    /// The printer has ended.
    pub fn begin(&mut self, command: &str) -> Result<(), HostError> {
        self.history.push(command.to_owned());
        self.transmit()
    }

    /// Sends a command and returns the first line of its answer that begins with `prefix`.
    ///
    /// # Errors
    /// See [`HostError`].
    pub fn ask(&mut self, command: &str, prefix: &str) -> Result<String, HostError> {
        self.history.push(command.to_owned());
        loop {
            // The answer precedes the last `ok`; after a garbled line an additional
            // `ok` may precede it.
            let mut answer = None;
            while self.next < self.history.len() {
                self.transmit()?;
                loop {
                    let line = self.hear(prefix)?;
                    if line.starts_with(prefix) {
                        answer = Some(line);
                    } else if self.digest_line(&line)? {
                        break;
                    }
                }
            }
            if let Some(answer) = answer {
                return Ok(answer);
            }
            let line = self.hear(prefix)?;
            if line.starts_with(prefix) {
                return Ok(line);
            }
            self.digest_line(&line)?;
        }
    }

    /// Sends bytes unchanged: no number, no checksum, no waiting.
    ///
    /// # Errors
    /// The printer has ended.
    pub fn send_raw(&mut self, bytes: &[u8]) -> Result<(), HostError> {
        Ok(self.port.send(bytes)?)
    }

    /// Waits for a line; earlier lines are only remembered.
    ///
    /// # Errors
    /// The line does not arrive in time, or the printer has ended.
    pub fn wait_for(&mut self, awaited: &str, is_it: impl Fn(&str) -> bool) -> Result<String, HostError> {
        loop {
            let line = self.hear(awaited)?;
            if line.starts_with("ok") {
                self.acknowledged += 1;
            }
            if is_it(&line) {
                return Ok(line);
            }
        }
    }

    /// The lines that arrive within a time, ms.
    ///
    /// # Errors
    /// The printer has ended.
    pub fn listen(&mut self, time_ms: u64) -> Result<Vec<String>, HostError> {
        let until_ns = self.port.now_ns() + time_ms * 1_000_000;
        let mut lines = Vec::new();
        while let Some(line) = self.port.receive(until_ns)? {
            lines.push(line);
        }
        Ok(lines)
    }

    fn settle(&mut self) -> Result<(), HostError> {
        while self.next < self.history.len() {
            self.transmit()?;
            self.wait_for_ok()?;
        }
        Ok(())
    }

    /// Sends the next line of the history.
    fn transmit(&mut self) -> Result<(), HostError> {
        let Some(command) = self.history.get(self.next) else { return Ok(()) };
        self.next += 1;
        let mut line = with_checksum(&format!("N{} {command}", self.next)).into_bytes();
        if let Some(noise) = &mut self.noise {
            noise.pass(&mut line);
        }
        Ok(self.port.send(&line)?)
    }

    fn wait_for_ok(&mut self) -> Result<(), HostError> {
        loop {
            let line = self.hear("ok")?;
            if self.digest_line(&line)? {
                return Ok(());
            }
        }
    }

    /// Processes a line from the printer; `true` for an `ok`.
    fn digest_line(&mut self, line: &str) -> Result<bool, HostError> {
        if line.starts_with("ok") {
            self.acknowledged += 1;
            return Ok(true);
        }
        if let Some(number) = line.strip_prefix("Resend:") {
            let number: i64 = number.trim().parse().map_err(|_| HostError::Fatal(line.to_owned()))?;
            // Number 1 is index 0; the number after the last one means that no line is missing.
            match usize::try_from(number - 1) {
                Ok(index) if index <= self.history.len() => self.next = index,
                _ => return Err(HostError::NeverSent(number)),
            }
            self.resends += 1;
        } else if let Some(reason) = line.strip_prefix("Error:") {
            // The words that hosts use to distinguish errors with a resend from others.
            let reason = reason.to_ascii_lowercase();
            if !reason.contains("line number") && !reason.contains("checksum") {
                return Err(HostError::Fatal(line.to_owned()));
            }
        } else if line == "start" {
            return Err(HostError::Fatal("start (it was reset)".to_owned()));
        }
        Ok(false)
    }

    /// The next line of any kind.
    fn hear(&mut self, awaited: &str) -> Result<String, HostError> {
        let until_ns = self.port.now_ns() + self.limit_ns;
        match self.port.receive(until_ns)? {
            Some(line) => {
                if self.heard.len() == REMEMBERED_LINES {
                    self.heard.remove(0);
                }
                self.heard.push(line.clone());
                Ok(line)
            }
            None => Err(HostError::Silent { awaited: awaited.to_owned(), heard: self.heard.clone() }),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use std::collections::VecDeque;

    /// A printer that follows the written protocol, line by line.
    #[derive(Default)]
    struct Fake {
        last: i64,
        executed: Vec<String>,
        replies: VecDeque<String>,
        mute: bool,
    }

    impl Fake {
        fn reply(&mut self, lines: &[&str]) {
            self.replies.extend(lines.iter().map(|&line| line.to_owned()));
        }

        fn refuse(&mut self, reason: &str) {
            let (error, resend) =
                (format!("Error:{reason}, Last Line: {}", self.last), format!("Resend: {}", self.last + 1));
            self.reply(&[&error, &resend, "ok"]);
        }

        fn line(&mut self, line: &str) {
            let Some(rest) = line.strip_prefix('N') else {
                self.reply(&["echo:Unknown command", "ok"]);
                return;
            };
            let Some((content, checksum)) = line.rsplit_once('*') else {
                return self.refuse("No Checksum with line number");
            };
            let (number, command) = rest.split_once(' ').unwrap_or((rest, ""));
            let command = command.split('*').next().unwrap();
            let number: i64 = number.parse().unwrap_or(-99);
            let right = content.bytes().fold(0, |sum, byte| sum ^ byte).to_string() == checksum;
            if command == "M110 N0" && right {
                self.last = 0;
                return self.reply(&["ok"]);
            }
            if number != self.last + 1 && number != self.last {
                return self.refuse("Line Number is not Last Line Number+1");
            }
            if !right {
                return self.refuse("checksum mismatch");
            }
            if number == self.last + 1 {
                self.last = number;
                self.executed.push(command.to_owned());
                match command {
                    "M112" => return self.reply(&["Error:Printer halted. kill() called!"]),
                    "M114" => self.reply(&["X:1.00 Y:0.00"]),
                    _ => self.reply(&["echo:busy: processing"]),
                }
            }
            self.reply(&["ok"]);
        }
    }

    impl Port for Fake {
        fn send(&mut self, bytes: &[u8]) -> Result<(), String> {
            if !self.mute {
                for line in String::from_utf8_lossy(bytes).split(['\n', '\r']).filter(|line| !line.is_empty()) {
                    self.line(line);
                }
            }
            Ok(())
        }

        fn receive(&mut self, _until_ns: u64) -> Result<Option<String>, String> {
            Ok(self.replies.pop_front())
        }

        fn now_ns(&self) -> u64 {
            0
        }
    }

    fn host() -> Host<Fake> {
        let mut fake = Fake::default();
        fake.reply(&["", "start", "echo:clock"]);
        let mut host = Host::new(fake, 1_000_000_000);
        host.connect().unwrap();
        host
    }

    #[test]
    fn checksums_as_documented() {
        assert_eq!(with_checksum("N3 T0"), "N3 T0*57\n");
        assert_eq!(with_checksum("N0 M110 N0"), "N0 M110 N0*125\n");
    }

    #[test]
    fn lines_are_executed_in_order_and_answers_found() {
        let mut host = host();
        host.send("G28").unwrap();
        assert_eq!(host.ask("M114", "X:").unwrap(), "X:1.00 Y:0.00");
        host.send("G1 X5").unwrap();
        assert_eq!(host.port().executed, ["G28", "M114", "G1 X5"]);
        assert_eq!((host.resends(), host.acknowledged()), (0, 4));
    }

    #[test]
    fn with_noise_every_line_is_executed_once() {
        let commands: Vec<String> = (0..300).map(|index| format!("G1 X{index}.5 E-0.25")).collect();
        let mut resends = 0;
        for seed in 0..50 {
            let mut host = host();
            host.set_noise(Noise::new(seed));
            for command in &commands {
                host.send(command).unwrap();
            }
            assert_eq!(host.ask("M114", "X:").unwrap(), "X:1.00 Y:0.00");
            let executed = &host.port().executed;
            assert_eq!(executed.len(), 301, "seed {seed}");
            assert_eq!(executed[..300], commands, "seed {seed}");
            resends += host.resends();
        }
        assert!(resends > 100, "{resends}");
    }

    #[test]
    fn a_printer_that_stops_or_falls_silent_ends_the_wait() {
        assert!(matches!(host().send("M112"), Err(HostError::Fatal(line)) if line.contains("kill")));
        let mut host = host();
        host.port().mute = true;
        let error = host.send("G28").unwrap_err();
        assert!(error.to_string().contains("waiting for ok"), "{error}");
    }

    #[test]
    fn a_resend_of_an_unsent_line_is_an_error() {
        for number in ["7", "0", "-1"] {
            let mut host = host();
            host.port().reply(&[&format!("Resend: {number}"), "ok"]);
            assert!(matches!(host.send("G28"), Err(HostError::NeverSent(_))), "{number}");
        }
    }
}
