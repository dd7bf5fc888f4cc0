//! Interface to a board's line, and the host's time limits.

use std::io;
use std::time::{Duration, Instant};

/// Start of the line that a halted board sends. Such a board has switched motors and heaters off.
pub const HALTED: &str = "Error:Printer halted";

/// Connection with a board at its other end.
pub trait Port {
    /// Sends bytes.
    ///
    /// # Errors
    /// The board is gone.
    fn send(&mut self, bytes: &[u8]) -> io::Result<()>;

    /// Receives the board's next line without its line end; `None` if no line arrives before
    /// `until`.
    ///
    /// # Errors
    /// The board is gone.
    fn receive(&mut self, until: Instant) -> io::Result<Option<String>>;

    /// Returns the time on the clock that [`Patience`] is measured by: this computer's clock,
    /// except for a board in virtual time.
    fn now(&mut self) -> Instant {
        Instant::now()
    }
}

/// Time limits of a transfer.
#[derive(Clone, Copy, Debug)]
pub struct Patience {
    /// Time without the expected answer after which the board is asked again.
    pub ask: Duration,
    /// Time without any line after which the board counts as gone.
    pub give_up: Duration,
    /// Time that the board waits for the host, s.
    pub board_s: u16,
    /// Time without any line after which the current line of G-code is sent again.
    pub repeat: Duration,
    /// Interval at which the host checks whether a person wants to end the job.
    pub look: Duration,
}

impl Patience {
    /// Limits for a board on a real line.
    pub const DEFAULT: Self = Self {
        ask: Duration::from_millis(250),
        give_up: Duration::from_secs(20),
        board_s: 30,
        repeat: Duration::from_secs(5),
        look: Duration::from_millis(100),
    };
}
