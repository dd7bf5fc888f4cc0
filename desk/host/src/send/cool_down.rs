//! Stops a printer: ends its waits, stops motion and switches the heaters off.

use std::time::Duration;

use super::port::{HALTED, Port};

/// Maximum time until all answers have arrived: a healthy printer needs less than a second, a
/// virtual printer on a busy computer a few.
const ANSWERS: Duration = Duration::from_secs(10);

/// Commands and what each of them ends. The first two act at once if the printer reads ahead of its
/// queue.
const END: [(&str, &str); 4] =
    [("M108", "waits"), ("M410", "motion"), ("M104 S0", "the nozzle's heater"), ("M140 S0", "the bed's heater")];

/// Response of a printer to the commands that end a print.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CooledDown {
    /// The printer has confirmed every command.
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

/// Ends waits, stops motion and switches the heaters off. `hear` receives the printer's lines.
pub fn cool_down(port: &mut impl Port, mut hear: impl FnMut(&str)) -> CooledDown {
    let end = port.now() + ANSWERS;
    // The printer may still owe the answer to the line that was under way. M105 comes last because
    // its answer can be recognised: it contains a temperature.
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
