//! A line to a board, and the time limits of its host.

use std::io;
use std::time::{Duration, Instant};

/// Start of a halted board's line. It has switched motors and heaters off.
pub const HALTED: &str = "Error:Printer halted";

/// A line with a board at its other end.
pub trait Port {
    /// Sends bytes.
    ///
    /// # Errors
    /// The board is gone.
    fn send(&mut self, bytes: &[u8]) -> io::Result<()>;

    /// The next line from the board, without its line end; `None` if none arrives in time.
    ///
    /// # Errors
    /// The board is gone.
    fn receive(&mut self, until: Instant) -> io::Result<Option<String>>;

    /// The time that [`Patience`] is measured in: this computer's clock, except for a board
    /// in virtual time.
    fn now(&mut self) -> Instant {
        Instant::now()
    }
}

/// Time limits of a transfer.
#[derive(Clone, Copy, Debug)]
pub struct Patience {
    /// Time without the expected answer after which the board is asked.
    pub ask: Duration,
    /// Time without any line after which the board counts as gone.
    pub give_up: Duration,
    /// Time that the board waits for this host, s.
    pub board_s: u16,
    /// Time without any line after which a line of G-code under way is sent again.
    pub repeat: Duration,
    /// Interval of the looks whether a person wants the end.
    pub look: Duration,
}

impl Patience {
    /// The limits for a board at a real line.
    pub const DEFAULT: Self = Self {
        ask: Duration::from_millis(250),
        give_up: Duration::from_secs(20),
        board_s: 30,
        repeat: Duration::from_secs(5),
        look: Duration::from_millis(100),
    };
}
