//! The person at the keyboard: Ctrl-C, and the commands that it sends to the printer.

use std::io::{BufRead, IsTerminal};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use ferrostep_host::printer_line::PrinterLine;
use ferrostep_host::send::{self, Port};
use signal_hook::consts::{SIGINT, SIGTERM};

use crate::terminal::tell;

/// Longest time of the answers to the commands that end an upload: a printer that is in order needs
/// less than a second, a busy computer that serves a virtual one a few.
const ANSWERS: Duration = Duration::from_secs(10);

/// The answer to the question whether the print is to end.
const UNDECIDED: u8 = 0;
const YES: u8 = 1;
const NO: u8 = 2;

/// Watches for Ctrl-C.
pub struct Person {
    /// Ctrl-C was pressed since the last look.
    pressed: Arc<AtomicBool>,
    answer: Arc<AtomicU8>,
    is_asked: bool,
}

impl Person {
    /// Takes over Ctrl-C, which from now on no longer ends the program.
    ///
    /// # Errors
    /// The operating system refuses.
    pub fn new() -> Result<Self, String> {
        let pressed = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM] {
            signal_hook::flag::register(signal, Arc::clone(&pressed)).map_err(|error| error.to_string())?;
        }
        Ok(Self { pressed, answer: Arc::new(AtomicU8::new(UNDECIDED)), is_asked: false })
    }

    /// Returns true if the job is to end. On a terminal the first Ctrl-C asks, and the print
    /// continues meanwhile.
    pub fn wants_end(&mut self, ask: impl FnOnce(&str)) -> bool {
        if !self.pressed.swap(false, Ordering::Relaxed) {
            match self.answer.load(Ordering::Relaxed) {
                YES => return true,
                NO => {
                    self.is_asked = false;
                    self.answer.store(UNDECIDED, Ordering::Relaxed);
                }
                _ => {}
            }
            return false;
        }
        let has_terminal = std::io::stdin().is_terminal() && std::io::stderr().is_terminal();
        if self.is_asked || !has_terminal {
            return true;
        }
        self.is_asked = true;
        ask("end the print? y and Enter ends it, Enter continues it, Ctrl-C ends it at once");
        let answer = Arc::clone(&self.answer);
        thread::spawn(move || {
            let mut line = String::new();
            let is_yes = std::io::stdin().lock().read_line(&mut line).is_ok() && line.trim().eq_ignore_ascii_case("y");
            answer.store(if is_yes { YES } else { NO }, Ordering::Relaxed);
        });
        false
    }
}

/// Ends an upload that has not begun as it should; hears all answers, which the next host must not.
pub fn end_upload(line: &mut PrinterLine) {
    // M29 has no effect if the printer was not writing.
    hear_to_the_end(line, "M29\n");
}

/// Ends an upload and deletes the incomplete file; reports whether the printer has confirmed it.
pub fn delete_upload(line: &mut PrinterLine, name: &str) {
    if hear_to_the_end(line, &format!("M29\nM30 {name}\n")).iter().any(|said| said.starts_with("File deleted")) {
        tell(format_args!("{name} was not complete and has been deleted from the card"));
    } else {
        tell(format_args!(
            "the printer has not confirmed that {name} is deleted: if it is on the card it is not complete"
        ));
    }
}

/// Sends commands and M105, and returns the lines heard up to its answer.
fn hear_to_the_end(line: &mut PrinterLine, commands: &str) -> Vec<String> {
    let end = Instant::now() + ANSWERS;
    let mut said = Vec::new();
    let mut is_over = line.send(format!("{commands}M105\n").as_bytes()).is_err();
    while let (false, Ok(Some(answer))) = (is_over, line.receive(end)) {
        is_over = answer.starts_with("ok T:");
        said.push(answer);
    }
    said
}

/// Ends waits, motion and heat, and reports what the printer has confirmed.
pub fn cool_down(line: &mut PrinterLine) {
    tell(send::cool_down(line, |_| {}).describe());
}
