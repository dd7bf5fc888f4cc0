//! Both directions of the serial line between interrupt and tasks.

use core::fmt::{self, Write};
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use ferrostep_hal_shim::clock_tree::ClockSource;
use ferrostep_planner::TICKS_PER_SECOND;
use ferrostep_printer::machine::Silence;
use ferrostep_stm32f4::motion_clock::MotionClock;
use ferrostep_stm32f4::pac::Interrupt;
use heapless::spsc::{Consumer, Producer};
use rtic_sync::signal::{Signal, SignalReader};

/// Bytes that wait to be read. A host that does not wait for each `ok` may keep this much in flight.
pub const RECEIVE_BYTES: usize = 2048;

/// Bytes that wait to be sent: the longest reply (M115) and some.
pub const SEND_BYTES: usize = 2048;

/// Bytes that were lost because nobody read them in time.
static LOST_BYTES: AtomicU32 = AtomicU32::new(0);
/// Whether the printer task waits for bytes.
static IS_AWAITED: AtomicBool = AtomicBool::new(false);
/// Since when, or the last byte since then; ticks of the motion clock.
static QUIET_SINCE: AtomicU32 = AtomicU32::new(0);
/// Bytes have come.
static RECEIVED: Signal<()> = Signal::new();

/// The interrupt's end: what to do with a byte.
pub fn received(byte: u8, bytes: &mut Producer<'static, u8>) {
    if bytes.enqueue(byte).is_err() {
        // What is lost fails its line's checksum; the host is told how much it was.
        LOST_BYTES.fetch_add(1, Ordering::Relaxed);
    }
    RECEIVED.writer().write(());
}

/// Takes the count of bytes lost.
pub fn take_lost_bytes() -> u32 {
    LOST_BYTES.swap(0, Ordering::Relaxed)
}

/// How long the host may take for its next line, ticks of the motion clock.
#[derive(Clone, Copy, Debug)]
pub struct Patience {
    /// Before blocks leave the look-ahead ring early because the step queue runs low.
    release_ticks: u32,
    /// Before what waits in the ring is executed at standstill.
    flush_ticks: u32,
}

impl Patience {
    /// By the clock: 100 ms, and none when steps run out. On the bare internal oscillator 10 s for both. That is how
    /// an emulator starts, whose time may run many times faster than its host's; there a gap between steps is better
    /// than another plan.
    pub const fn new(source: ClockSource) -> Self {
        match source {
            ClockSource::Crystal | ClockSource::InternalWithPll => {
                Self { release_ticks: 0, flush_ticks: TICKS_PER_SECOND / 10 }
            }
            ClockSource::Internal => Self { release_ticks: 10 * TICKS_PER_SECOND, flush_ticks: 10 * TICKS_PER_SECOND },
        }
    }

    /// What the planner task may do at tick `now_ticks`.
    pub fn silence(&self, now_ticks: u32) -> Silence {
        let is_awaited = IS_AWAITED.load(Ordering::Acquire);
        let quiet_ticks = now_ticks.wrapping_sub(QUIET_SINCE.load(Ordering::Acquire));
        Silence {
            // With the clock right steps that run out are the board's own affair, whoever is late.
            may_release: self.release_ticks == 0 || is_awaited && quiet_ticks >= self.release_ticks,
            may_flush: is_awaited && quiet_ticks >= self.flush_ticks,
        }
    }
}

/// The printer task's end: bytes as they come.
pub struct Reader {
    bytes: Consumer<'static, u8>,
    signal: SignalReader<'static, ()>,
    clock: MotionClock,
}

impl Reader {
    /// The reader; there can be one.
    pub fn new(bytes: Consumer<'static, u8>, clock: MotionClock) -> Option<Self> {
        Some(Self { bytes, signal: RECEIVED.try_take_reader()?, clock })
    }

    /// Waits for bytes, takes as many as are there and fit, and returns them.
    pub async fn read<'a>(&mut self, buffer: &'a mut [u8]) -> &'a [u8] {
        while !self.bytes.ready() {
            QUIET_SINCE.store(self.clock.now_ticks(), Ordering::Release);
            IS_AWAITED.store(true, Ordering::Release);
            self.signal.wait().await;
            IS_AWAITED.store(false, Ordering::Release);
        }
        let mut length = 0;
        for place in buffer.iter_mut() {
            let Some(byte) = self.bytes.dequeue() else { break };
            *place = byte;
            length += 1;
        }
        buffer.get(..length).unwrap_or_default()
    }
}

/// The sending end, shared by those who reply.
pub struct Writer(pub Producer<'static, u8>);

impl Writer {
    /// Sends a text and a line end. Waits while the buffer is full; the interrupt, which is above all who call this,
    /// empties it.
    pub fn line(&mut self, text: impl fmt::Display) {
        // Writing to the buffer cannot fail.
        let _ = writeln!(self, "{text}");
        rtic::pend(Interrupt::USART1);
    }
}

impl Write for Writer {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for mut byte in text.bytes() {
            while let Err(back) = self.0.enqueue(byte) {
                byte = back;
                rtic::pend(Interrupt::USART1);
            }
        }
        Ok(())
    }
}
