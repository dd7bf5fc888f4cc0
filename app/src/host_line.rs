//! Both directions of the hosts' lines, serial and USB, between their interrupts and the tasks.

use core::fmt::{self, Write};
use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, Ordering};

use ferrostep_gcode::Emergency;
use ferrostep_gcode::meatpack;
use ferrostep_planner::TICKS_PER_SECOND;
use ferrostep_printer::machine::Silence;
use ferrostep_stm32f4::clock_tree::ClockSource;
use ferrostep_stm32f4_board::motion_clock::MotionClock;
use ferrostep_stm32f4_board::pac::Interrupt;
use ferrostep_stm32f4_usb::Served;
use ferrostep_usb::{Buffers, Incoming, LineWriter};
use heapless::spsc::{Consumer, Producer};
use rtic_monotonics::systick::prelude::*;
use rtic_sync::signal::{Signal, SignalReader};

use crate::clock::Mono;

/// Size of the receive buffer, bytes. A host that does not wait for each `ok` may keep this much in
/// flight.
pub const RECEIVE_BYTES: usize = 2048;

/// Size of the USB send buffer, bytes: the longest reply (M115) and a margin, because text that
/// does not fit is dropped.
pub const USB_SEND_BYTES: usize = 1536;

/// Size of the serial send buffer, bytes: two lines of an `ok` with temperatures. [`Writer`] waits
/// for room.
pub const SERIAL_SEND_BYTES: usize = 256;

/// Longest wait of [`Reader::read_in_time`], ms. It must exceed the silence after which
/// [`Patience`] releases the moves in the ring; otherwise the planner task would have to look at
/// just the right moment.
const WAIT_MS: u32 = 150;

/// Longest wait of [`Reader::wait`], ms.
const CARD_WAIT_MS: u32 = 20;

/// True if the USB port has left the bus for good.
static USB_HAS_FAILED: AtomicBool = AtomicBool::new(false);
/// Number of bytes lost because they were not read in time.
static LOST_BYTES: AtomicU32 = AtomicU32::new(0);
/// Packing reports that the serial and USB hosts are waiting for: 0 for none, or the number of one
/// of [`PACKING_REPORTS`], from 1.
static PACKING: [AtomicU8; 2] = [AtomicU8::new(0), AtomicU8::new(0)];
/// True while the printer task waits for bytes.
static IS_AWAITED: AtomicBool = AtomicBool::new(false);
/// Start of that wait, or time of the last byte; ticks of the motion clock.
static QUIET_SINCE: AtomicU32 = AtomicU32::new(0);
/// Signal that bytes have arrived.
static RECEIVED: Signal<()> = Signal::new();

/// All packing reports.
const PACKING_REPORTS: [meatpack::Settings; 4] = [
    meatpack::Settings { packing: false, no_spaces: false },
    meatpack::Settings { packing: false, no_spaces: true },
    meatpack::Settings { packing: true, no_spaces: false },
    meatpack::Settings { packing: true, no_spaces: true },
];

/// A host's port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Port {
    /// USART1.
    Serial,
    /// The USB port.
    Usb,
}

/// The serial interrupt's end: puts complete lines into the ring or drops them, and acts on the
/// commands that do not wait their turn.
pub struct SerialInput {
    incoming: Incoming,
    ring: SerialRing,
}

/// Destination of the serial line's bytes.
struct SerialRing {
    bytes: Producer<'static, u8>,
    act: fn(Emergency),
    note_line: fn(),
}

impl Buffers for SerialRing {
    fn put(&mut self, byte: u8) -> bool {
        self.bytes.enqueue(byte).is_ok()
    }

    fn take(&mut self) -> Option<u8> {
        None
    }

    fn emergency(&mut self, emergency: Emergency) {
        (self.act)(emergency);
    }

    fn note_line(&mut self) {
        (self.note_line)();
    }

    fn report_packing(&mut self, settings: meatpack::Settings) {
        note_packing(Port::Serial, settings);
    }
}

impl SerialInput {
    /// Creates the input to this ring; `act` handles M112 and similar commands, `note_line` is
    /// called when a line has arrived.
    pub const fn new(bytes: Producer<'static, u8>, act: fn(Emergency), note_line: fn()) -> Self {
        Self { incoming: Incoming::new(), ring: SerialRing { bytes, act, note_line } }
    }

    /// Takes a byte. If the ring is full its line is dropped, and the host is told how many bytes
    /// were lost.
    pub fn receive(&mut self, byte: u8) {
        arrived(self.incoming.take_in(&[byte], &mut self.ring));
    }
}

/// Notes that bytes are waiting to be read, and that `lost` others were dropped.
pub fn arrived(lost: u32) {
    LOST_BYTES.fetch_add(lost, Ordering::Relaxed);
    RECEIVED.writer().write(());
}

/// Notes the result of a USB interrupt.
pub fn usb_served(served: Served) {
    USB_HAS_FAILED.fetch_or(served.has_failed, Ordering::Relaxed);
    arrived(served.dropped);
}

/// Stores a packing report for a port's host, replacing an older one.
pub fn note_packing(port: Port, settings: meatpack::Settings) {
    let number = (1..).zip(PACKING_REPORTS).find(|(_, report)| *report == settings).map_or(0, |(number, _)| number);
    place_of(port).store(number, Ordering::Relaxed);
}

/// Takes the packing report that a port's host is waiting for.
pub fn take_packing(port: Port) -> Option<meatpack::Settings> {
    let number = place_of(port).swap(0, Ordering::Relaxed);
    PACKING_REPORTS.get(usize::from(number).checked_sub(1)?).copied()
}

fn place_of(port: Port) -> &'static AtomicU8 {
    let [serial, usb] = &PACKING;
    match port {
        Port::Serial => serial,
        Port::Usb => usb,
    }
}

/// Problems on the hosts' lines, for a report.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineTroubles {
    /// Number of bytes that came too fast.
    pub lost_bytes: u32,
    /// True if the USB port has left the bus.
    pub usb_has_failed: bool,
}

/// Takes the problems since the last call.
pub fn take_troubles() -> LineTroubles {
    LineTroubles {
        lost_bytes: LOST_BYTES.swap(0, Ordering::Relaxed),
        usb_has_failed: USB_HAS_FAILED.swap(false, Ordering::Relaxed),
    }
}

/// Time allowed for the host's next line, ticks of the motion clock.
#[derive(Clone, Copy, Debug)]
pub struct Patience {
    /// Time before blocks leave the look-ahead ring early because the step queue runs low.
    release_ticks: u32,
    /// Time before the moves in the ring are executed to standstill.
    flush_ticks: u32,
}

impl Patience {
    /// Chooses the times for a clock source: 100 ms before moves in the ring are executed, and no
    /// delay before blocks leave it early. On the bare internal oscillator both are 10 s: an
    /// emulator starts that way, and its time may run many times faster than its host's. There a
    /// gap between steps is better than a different plan.
    pub const fn new(source: ClockSource) -> Self {
        match source {
            ClockSource::Crystal | ClockSource::InternalWithPll => {
                Self { release_ticks: 0, flush_ticks: TICKS_PER_SECOND / 10 }
            }
            ClockSource::Internal => Self { release_ticks: 10 * TICKS_PER_SECOND, flush_ticks: 10 * TICKS_PER_SECOND },
        }
    }

    /// Returns the work that the planner task may do at tick `now_ticks`.
    pub fn silence(&self, now_ticks: u32) -> Silence {
        let is_awaited = IS_AWAITED.load(Ordering::Acquire);
        let quiet_ticks = now_ticks.wrapping_sub(QUIET_SINCE.load(Ordering::Acquire));
        Silence {
            // On its regular clock a board releases blocks when steps run out, even if the host is
            // not the cause.
            may_release: self.release_ticks == 0 || is_awaited && quiet_ticks >= self.release_ticks,
            may_flush: is_awaited && quiet_ticks >= self.flush_ticks,
        }
    }
}

/// The printer task's end: supplies bytes as they arrive.
pub struct Reader {
    serial: Consumer<'static, u8>,
    usb: Consumer<'static, u8>,
    /// Port that was read last. The other one has precedence, so that a host that never stops
    /// sending does not block it.
    last: Port,
    signal: SignalReader<'static, ()>,
    clock: MotionClock,
}

impl Reader {
    /// Creates the reader; there can be only one.
    pub fn new([serial, usb]: [Consumer<'static, u8>; 2], clock: MotionClock) -> Option<Self> {
        Some(Self { serial, usb, last: Port::Usb, signal: RECEIVED.try_take_reader()?, clock })
    }

    /// Clock that times the waits.
    #[cfg(accelerometer)]
    pub const fn clock(&self) -> MotionClock {
        self.clock
    }

    fn is_ready(&self) -> bool {
        self.serial.ready() || self.usb.ready()
    }

    /// Waits for bytes, takes as many from one port as have arrived and fit, and returns them.
    pub async fn read<'a>(&mut self, buffer: &'a mut [u8]) -> (Port, &'a [u8]) {
        if !self.is_ready() {
            QUIET_SINCE.store(self.clock.now_ticks(), Ordering::Release);
            IS_AWAITED.store(true, Ordering::Release);
            // The USB interrupt also signals its other work, so a signal may come without bytes.
            while !self.is_ready() {
                self.signal.wait().await;
            }
            IS_AWAITED.store(false, Ordering::Release);
        }
        self.take(buffer)
    }

    /// Variant of [`Self::read`] that waits 150 ms at most and then returns no bytes. `idle`: the
    /// reader has nothing else to do.
    pub async fn read_in_time<'a>(&mut self, buffer: &'a mut [u8], idle: bool) -> (Port, &'a [u8]) {
        if !self.is_ready() {
            if idle {
                QUIET_SINCE.store(self.clock.now_ticks(), Ordering::Release);
                IS_AWAITED.store(true, Ordering::Release);
            }
            let _ = Mono::timeout_after(WAIT_MS.millis(), self.signal.wait()).await;
            if idle {
                IS_AWAITED.store(false, Ordering::Release);
            }
        }
        self.take(buffer)
    }

    /// Waits for a host's bytes or the card's task, 20 ms at most.
    pub async fn wait(&mut self, idle: bool) {
        if self.is_ready() {
            return;
        }
        if idle && !IS_AWAITED.load(Ordering::Acquire) {
            QUIET_SINCE.store(self.clock.now_ticks(), Ordering::Release);
            IS_AWAITED.store(true, Ordering::Release);
        }
        let _ = Mono::timeout_after(CARD_WAIT_MS.millis(), self.signal.wait()).await;
    }

    /// Takes as many bytes from one port as have arrived and fit.
    pub fn take<'a>(&mut self, buffer: &'a mut [u8]) -> (Port, &'a [u8]) {
        self.last = match self.last {
            Port::Usb if self.serial.ready() => Port::Serial,
            Port::Serial if !self.usb.ready() => Port::Serial,
            Port::Usb | Port::Serial => Port::Usb,
        };
        let bytes = match self.last {
            Port::Serial => &mut self.serial,
            Port::Usb => &mut self.usb,
        };
        let mut length = 0;
        for place in buffer.iter_mut() {
            let Some(byte) = bytes.dequeue() else { break };
            *place = byte;
            length += 1;
        }
        (self.last, buffer.get(..length).unwrap_or_default())
    }
}

/// Receiver of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum To {
    /// The host whose command is answered.
    Host(Port),
    /// Every host, unasked.
    All,
}

/// The sending ends, shared by the tasks that reply.
pub struct Writers {
    /// Writer of the serial line.
    pub serial: Writer,
    /// Writer of the USB port; `None` if USB does not work.
    pub usb: Option<LineWriter<'static>>,
}

impl Writers {
    /// Sends a text and a line end.
    pub fn line(&mut self, to: To, text: impl fmt::Display) {
        if to != To::Host(Port::Usb) {
            self.serial.line(&text);
        }
        if to != To::Host(Port::Serial)
            && let Some(usb) = &mut self.usb
        {
            match to {
                To::Host(_) => usb.reply(format_args!("{text}")),
                To::All => usb.report(format_args!("{text}")),
            }
            rtic::pend(Interrupt::OTG_FS);
        }
    }
}

impl Writers {
    /// Returns true if a record's line fits without a wait and half of each ring stays free for
    /// replies.
    pub fn have_room(&self, to: To) -> bool {
        let serial = || self.serial.0.len() <= SERIAL_SEND_BYTES / 2;
        let usb = || self.usb.as_ref().is_none_or(LineWriter::is_half_free);
        match to {
            To::Host(Port::Serial) => serial(),
            To::Host(Port::Usb) => usb(),
            To::All => serial() && usb(),
        }
    }
}

/// Sending end of the serial line.
pub struct Writer(pub Producer<'static, u8>);

impl Writer {
    /// Sends a text and a line end. Waits while the buffer is full; the interrupt, whose priority
    /// is above that of all callers, empties it.
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
