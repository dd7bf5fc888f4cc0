//! A board without a slot: no file system and no mailbox.

use ferrostep_stm32f4::clock_tree::Clock;
use ferrostep_stm32f4_board::motion_clock::MotionClock;
use ferrostep_stm32f4_board::pac::SDIO;
use rtic::Mutex;

/// No card's task.
pub struct BoardCard;

/// No questions for it.
pub struct BoardMailbox;

impl BoardMailbox {
    /// Empty.
    pub const fn new() -> Self {
        Self
    }
}

/// Starts nothing.
pub fn start(_: SDIO, _: &Clock, _: MotionClock) -> Option<BoardCard> {
    None
}

/// Has nothing to do.
pub fn serve(_: &mut Option<BoardCard>, _: &mut impl Mutex<T = BoardMailbox>) -> bool {
    false
}
