//! Start of both host lines: their ports, and the rings between interrupts and tasks.

use ferrostep_gcode::Emergency;
use ferrostep_stm32f4::clock_tree::Clock;
use ferrostep_stm32f4_board::pac::{RCC, USART1};
use ferrostep_stm32f4_board::serial::Serial;
use ferrostep_stm32f4_usb::{self as usb, NoUsb, Rings, Usb};
use ferrostep_usb::LineWriter;
use heapless::spsc::{Consumer, Queue};

use crate::host_line::{self, Port, RECEIVE_BYTES, SERIAL_SEND_BYTES, SerialInput, USB_SEND_BYTES, Writer, Writers};

/// Baud rate of the serial line.
const BAUD: u32 = 115_200;

/// The rings of both lines.
pub struct LineRings {
    receive: Queue<u8, RECEIVE_BYTES>,
    send: Queue<u8, SERIAL_SEND_BYTES>,
    usb_receive: Queue<u8, RECEIVE_BYTES>,
    usb_send: Queue<u8, USB_SEND_BYTES>,
}

impl LineRings {
    /// Creates empty rings.
    pub const fn new() -> Self {
        Self { receive: Queue::new(), send: Queue::new(), usb_receive: Queue::new(), usb_send: Queue::new() }
    }
}

/// Actions that the interrupts take on a line before it is read.
#[derive(Clone, Copy)]
pub struct Actions {
    /// Action for M112 and similar commands, which do not wait their turn.
    pub act: fn(Emergency),
    /// Action for any line.
    pub note_line: fn(),
}

/// Both host lines, split into the parts used by interrupts and tasks.
pub struct HostLines {
    /// The serial port, and its interrupt's ends of the rings.
    pub port: Serial,
    /// See [`Self::port`].
    pub input: SerialInput,
    /// See [`Self::port`].
    pub to_send: Consumer<'static, u8>,
    /// The USB port, or the reason for which it does not work.
    pub usb: Result<&'static mut Usb, NoUsb>,
    /// Sending ends for the tasks that reply.
    pub writers: Writers,
    /// Receiving ends for the reader: serial and USB.
    pub to_read: [Consumer<'static, u8>; 2],
}

impl HostLines {
    /// Starts both ports. Call in `init`.
    pub fn start(
        rings: &'static mut LineRings,
        usb_memory: &'static mut usb::Memory,
        (serial, usb): (USART1, usb::Registers),
        rcc: &RCC,
        clock: &Clock,
        actions: Actions,
    ) -> Self {
        let Actions { act, note_line } = actions;
        let port = Serial::start(serial, rcc, clock.fast_bus, BAUD);
        let (received, to_read) = rings.receive.split();
        let (to_write, to_send) = rings.send.split();
        let (usb_received, usb_to_read) = rings.usb_receive.split();
        let (usb_to_write, usb_to_send) = rings.usb_send.split();
        let rings = Rings {
            received: usb_received,
            to_send: usb_to_send,
            act,
            note_line,
            report_packing: |settings| host_line::note_packing(Port::Usb, settings),
        };
        let usb = Usb::start(usb_memory, usb, rcc, clock, rings);
        let writers = Writers { serial: Writer(to_write), usb: usb.is_ok().then(|| LineWriter::new(usb_to_write)) };
        let input = SerialInput::new(received, act, note_line);
        Self { port, input, to_send, usb, writers, to_read: [to_read, usb_to_read] }
    }
}
