//! The recorder of the board's accelerometer, as seen by commands and by the task that takes its
//! samples.

use core::cell::RefCell;
use core::fmt::{self, Write};

use ferrostep_adxl345::Adxl345;
use ferrostep_printer::{Accelerometer, AccelerometerSettings, CommandError, Recorder};
use ferrostep_stm32f4_board::accelerometer::{self, Bus};
use ferrostep_stm32f4_board::board::ACCELEROMETER;
use ferrostep_stm32f4_board::motion_clock::MotionClock;
use rtic::Mutex;

use crate::host_line::{Port, To, Writers};
use crate::ports::BoardReplies;

/// Maximum number of lines that the task sends without a pause, so that other tasks of its priority
/// have their turn: a full memory, and both ends of a record.
pub const MAX_LINES: u32 = 36;

/// Longest line of a record, bytes.
const MAX_LINE: usize = 160;

/// The recorder, and the host that receives the record.
pub struct BoardRecorder {
    recorder: Recorder<Adxl345<Bus>>,
    to: To,
    /// Motor positions when the task last ran, steps.
    motor_steps: [i64; 4],
}

impl BoardRecorder {
    /// Updates the motor positions, steps: a record that waits for a move begins when X, Y or Z
    /// moves.
    pub fn follow(&mut self, motor_steps: [i64; 4], now_ticks: u32) {
        let before = core::mem::replace(&mut self.motor_steps, motor_steps);
        if before.iter().zip(&motor_steps).take(3).any(|(before, now)| before != now) {
            self.recorder.move_began(now_ticks);
        }
    }
}

/// Recorder of the chip at the board's connector, which has not been accessed yet.
pub fn recorder() -> BoardRecorder {
    let Some(pins) = ACCELEROMETER else { unreachable!("the build looks at the board's table") };
    let recorder = Recorder::new(Adxl345::new(accelerometer::start(pins)));
    BoardRecorder { recorder, to: To::Host(Port::Serial), motor_steps: [0; 4] }
}

/// Sends the next line of a record; `false` if there is no line, or no room for it.
pub fn send_line(
    recorder: &mut impl Mutex<T = BoardRecorder>,
    writers: &mut impl Mutex<T = Writers>,
    now_ticks: u32,
) -> bool {
    let to = recorder.lock(|shared| shared.to);
    if !writers.lock(|writers| writers.have_room(to)) {
        recorder.lock(|shared| shared.recorder.wait_for_room(now_ticks));
        return false;
    }
    let Some(event) = recorder.lock(|shared| shared.recorder.next(now_ticks)) else { return false };
    // Formatted once, into a buffer, instead of a second time to find its length. The longest line,
    // with the reason for an end, fits.
    let mut line = heapless::String::<MAX_LINE>::new();
    let _cut = write!(line, "{event}");
    writers.lock(|writers| writers.line(to, line.as_str()));
    true
}

/// The accelerometer, as shared with the task that executes commands.
pub struct BoardAccelerometer<'a, A, W> {
    shared: RefCell<A>,
    replies: &'a BoardReplies<W>,
    clock: MotionClock,
}

impl<'a, A, W> BoardAccelerometer<'a, A, W> {
    /// Creates the view. Records go to the host that is being answered when they are requested.
    pub const fn new(shared: A, replies: &'a BoardReplies<W>, clock: MotionClock) -> Self {
        Self { shared: RefCell::new(shared), replies, clock }
    }
}

impl<A, W> fmt::Debug for BoardAccelerometer<'_, A, W> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("BoardAccelerometer")
    }
}

impl<A: Mutex<T = BoardRecorder>, W: Mutex<T = Writers>> Accelerometer for BoardAccelerometer<'_, A, W> {
    fn set(&self, rate_hz: Option<u16>, resolution_bits: Option<u8>) -> Result<AccelerometerSettings, CommandError> {
        self.shared.borrow_mut().lock(|shared| shared.recorder.set(rate_hz, resolution_bits))
    }

    fn record(&self, samples: u16, at_next_move: bool) -> Result<(), CommandError> {
        let (to, now_ticks) = (self.replies.to(), self.clock.now_ticks());
        self.shared.borrow_mut().lock(|shared| {
            shared.to = to;
            shared.recorder.record(samples, at_next_move, now_ticks)
        })
    }
}
