//! Boards without a card slot: no file system and no mailbox.

use ferrostep_stm32f4::clock_tree::Clock;
use ferrostep_stm32f4_board::motion_clock::MotionClock;
use ferrostep_stm32f4_board::pac::SDIO;
use rtic::Mutex;

/// Stand-in for the card's task.
pub struct BoardCard;

/// Stand-in for the mailbox to the card's task.
pub struct BoardMailbox;

impl BoardMailbox {
    /// Returns the only value.
    pub const fn new() -> Self {
        Self
    }
}

/// Returns `None`: there is no slot to start.
pub fn start(_: SDIO, _: &Clock, _: MotionClock) -> Option<BoardCard> {
    None
}

/// Returns `false`: there is never a request.
pub fn serve(_: &mut Option<BoardCard>, _: &mut impl Mutex<T = BoardMailbox>) -> bool {
    false
}
