//! Ends a printer's waits, motion and heat.

use std::time::Duration;

use super::port::{HALTED, Port};

/// Longest time of the answers: a printer that is in order needs less than a second, a busy
/// computer that serves a virtual one a few.
const ANSWERS: Duration = Duration::from_secs(10);

/// The commands, and what they end. The first two act at once if the printer reads
/// ahead of its queue.
const END: [(&str, &str); 4] =
    [("M108", "waits"), ("M410", "motion"), ("M104 S0", "the nozzle's heater"), ("M140 S0", "the bed's heater")];

/// Printer's response to the commands that end a print.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CooledDown {
    /// The printer has confirmed everything.
    Confirmed,
    /// The printer has halted, which switches motors and heaters off.
    Halted,
    /// The printer has not confirmed every command.
    Unconfirmed,
}

impl CooledDown {
    /// Describes the response for a person.
    #[must_use]
    pub fn describe(self) -> String {
        match self {
            Self::Confirmed => {
                let commands: Vec<String> = END.iter().map(|(command, what)| format!("{what} ({command})")).collect();
                format!("the printer has ended: {}", commands.join(", "))
            }
            Self::Halted => "the printer has halted, which switches motors and heaters off".to_owned(),
            Self::Unconfirmed => {
                "the printer has NOT confirmed that motion and heaters are off: look at it, and switch it off if need be".to_owned()
            }
        }
    }
}

/// Ends waits, motion and heat. Lines of the printer go to `hear`.
pub fn cool_down(port: &mut impl Port, mut hear: impl FnMut(&str)) -> CooledDown {
    let end = port.now() + ANSWERS;
    // The printer may still owe the answer to the line that was under way: M105's has a
    // temperature, and is the last.
    let commands: String = END.iter().map(|(command, _)| format!("{command}\n")).collect();
    let sent = port.send(format!("{commands}M105\n").as_bytes());
    while let (true, Ok(Some(said))) = (sent.is_ok(), port.receive(end)) {
        hear(&said);
        if said.starts_with(HALTED) {
            return CooledDown::Halted;
        }
        if said.starts_with("ok T:") {
            return CooledDown::Confirmed;
        }
    }
    CooledDown::Unconfirmed
}
