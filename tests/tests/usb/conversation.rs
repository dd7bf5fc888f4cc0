//! A job streamed through the port, beside the same over a serial line.

use std::cell::RefCell;

use ferrostep_gcode::{Emergency, LineReader, Reply};
use ferrostep_planner::StepDigests;
use ferrostep_printer::{Host as HostLine, Replies};
use ferrostep_session::desk::LOOK_AHEAD_BLOCKS;
use ferrostep_session::{DeskPrinter, PrintSession, Session};
use ferrostep_testkit::host_side;
use ferrostep_usb::{Heard, Lines};

use crate::usb::device::Device;
use crate::usb::host::Host;

/// Commands of the job: heating, homing, skirt, first perimeters.
const COMMANDS: usize = 400;

/// Replies as lines, for a line that is always read.
#[derive(Default)]
struct Serial(RefCell<Vec<String>>);

impl Replies for Serial {
    fn send(&self, reply: Reply<'_>) {
        self.0.borrow_mut().extend(reply.to_string().lines().map(str::to_owned));
    }
}

/// Replies to the port's ring.
pub struct Port<'a>(pub &'a Device);

impl Replies for Port<'_> {
    fn send(&self, reply: Reply<'_>) {
        self.0.reply(reply);
    }
}

/// A machine that has just been switched on.
pub fn machine<R: Replies>(replies: R) -> PrintSession<(), R> {
    Session::print(ferrostep_profiles::load("cartesian").unwrap(), LOOK_AHEAD_BLOCKS, (), replies)
}

/// A printer at the port, and a host that prints through it.
pub struct Conversation<'a> {
    machine: &'a PrintSession<(), Port<'a>>,
    printer: DeskPrinter<'a>,
    device: &'a Device,
    /// The host.
    pub host: Host<'a>,
    numbers: HostLine,
    lines: Lines,
    /// Beginnings of lines that were dropped.
    pub halves: u32,
}

impl<'a> Conversation<'a> {
    /// Plugs the device in.
    pub fn new(machine: &'a PrintSession<(), Port<'a>>) -> Self {
        let device = machine.replies().0;
        let mut host = device.host();
        host.plug_in();
        host.set_open(true);
        let printer = machine.printer();
        Self { machine, printer, device, host, numbers: HostLine::new(), lines: Lines::new(), halves: 0 }
    }

    /// Sends bytes, lets the printer answer all lines that end in them, and reads its
    /// lines meanwhile.
    pub fn say(&mut self, bytes: &[u8]) -> Vec<String> {
        self.host.send(bytes);
        self.answer()
    }

    /// Makes the printer answer what it has received.
    pub fn answer(&mut self) -> Vec<String> {
        let received = self.device.take_received();
        let mut bytes = &received[..];
        let mut replies = Vec::new();
        while !bytes.is_empty() {
            let (used, heard) = self.lines.feed(bytes);
            bytes = &bytes[used..];
            match heard {
                Some(Heard::Line(line)) => self
                    .machine
                    .run_with(self.numbers.answer(&mut self.printer, line), |_| replies.extend(self.host.read_lines())),
                Some(Heard::HalfALine(_)) => self.halves += 1,
                None => {}
            }
        }
        replies.extend(self.host.read_lines());
        replies
    }

    fn finish(&mut self) -> StepDigests {
        self.machine.run(self.printer.finish()).unwrap();
        self.machine.figures().digests
    }
}

/// A line as hosts number it, with its line end.
pub fn numbered(number: usize, text: &str) -> String {
    format!("{}\n", host_side::numbered(number as i64, text))
}

/// The first commands of a sliced file, as a host sends them, and the host's questions in between.
fn job() -> Vec<String> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/cube.gcode");
    let text = std::fs::read_to_string(path).unwrap();
    let commands = text.lines().map(|line| line.split(';').next().unwrap().trim()).filter(|line| !line.is_empty());
    let mut job: Vec<String> =
        ["M115", "M155 S1"].into_iter().chain(commands.take(COMMANDS)).map(str::to_owned).collect();
    job.extend(["M155 S0", "G28 W1 ; ok?", "M400", "M114", "M119", "M797"].map(str::to_owned));
    job
}

/// The job over a serial line: the replies to each line, and the steps.
fn over_serial(job: &[String]) -> (Vec<Vec<String>>, StepDigests) {
    let machine = machine(Serial::default());
    let mut printer = machine.printer();
    let (mut host, mut reader) = (HostLine::new(), LineReader::new());
    let mut replies = Vec::new();
    for (number, text) in (1..).zip(job) {
        let line = numbered(number, text);
        let (used, read) = reader.feed(line.as_bytes());
        assert_eq!(used, line.len());
        machine.run(host.answer(&mut printer, read.unwrap()));
        replies.push(machine.replies().0.take());
    }
    machine.run(printer.finish()).unwrap();
    let digests = machine.figures().digests;
    (replies, digests)
}

#[test]
fn usb_prints_a_job_as_a_serial_line_does() {
    let job = job();
    let (expected, digests) = over_serial(&job);
    let device = Device::new();
    let machine = machine(Port(&device));
    let mut conversation = Conversation::new(&machine);
    let mut said = 0;
    for ((number, text), expected) in (1..).zip(&job).zip(expected) {
        let replies = conversation.say(numbered(number, text).as_bytes());
        assert_eq!(replies, expected, "{text}");
        assert_eq!(replies.iter().filter(|reply| reply.starts_with("ok")).count(), 1, "{text}: {replies:?}");
        said += replies.len();
    }
    assert!(said > job.len() + 100, "only {said} lines: there was no heating to report");
    assert_eq!(conversation.finish(), digests);
    assert_eq!((device.dropped(), conversation.halves), (0, 0));
}

#[test]
fn a_garbled_line_is_requested_again() {
    let device = Device::new();
    let machine = machine(Port(&device));
    let mut conversation = Conversation::new(&machine);
    assert_eq!(conversation.say(numbered(1, "G21").as_bytes()), ["ok"]);
    let replies = conversation.say(b"N2 G90*1\n");
    assert_eq!(replies, ["Error:checksum mismatch, Last Line: 1", "Resend: 2", "ok"]);
    // A byte that marks breaks inside does not count as a break.
    let replies = conversation.say(b"N2 G9\xff0*1\n");
    assert_eq!(replies, ["Error:checksum mismatch, Last Line: 1", "Resend: 2", "ok"]);
    assert_eq!(conversation.say(numbered(2, "G90").as_bytes()), ["ok"]);
    assert_eq!(conversation.halves, 0);
}

#[test]
fn emergency_commands_act_as_their_bytes_arrive() {
    let device = Device::new();
    let mut host = device.host();
    host.plug_in();
    host.send(b"G1 X10\nN7 M1");
    assert_eq!(device.take_emergencies(), []);
    host.send(b"12*37\nM410 ; now\nM1121\nM108\n");
    assert_eq!(device.take_emergencies(), [Emergency::Stop, Emergency::QuickStop, Emergency::EndWait]);
    assert_eq!(
        device.take_received(),
        b"G1 X10\nN7 M112*37\nM410 ; now\nM1121\nM108\n",
        "they are answered in turn as well"
    );
}

/// Every connection is another host, but the machine is the same.
#[test]
fn a_new_connection_finds_the_machine_unchanged() {
    let device = Device::new();
    let machine = machine(Port(&device));
    let mut conversation = Conversation::new(&machine);
    for (number, text) in (1..).zip(["M104 S210", "M140 S60", "G28", "G1 X50 Y40 Z5 F6000", "G92 E3"]) {
        let replies = conversation.say(numbered(number, text).as_bytes());
        assert_eq!(replies.last().map(String::as_str), Some("ok"), "{text}: {replies:?}");
    }
    let before = conversation.say(b"M400\nM114\n");
    assert!(before[1].starts_with("X:50.00 Y:40.00 Z:5.00 E:3.00"), "{before:?}");
    assert_eq!(conversation.say(b"N6 G1 X170 Y1"), [""; 0]);
    conversation.host.plug_in();
    conversation.host.set_open(true);
    // Had the half line been kept, this would make a whole one.
    assert_eq!(conversation.say(b"M110 N0\n"), ["ok"]);
    assert_eq!(conversation.halves, 1);
    assert_eq!(conversation.say(b"M400\nM114\n"), before);
    let temperatures = conversation.say(b"M105\n");
    assert!(temperatures[0].contains("/210.00 ") && temperatures[0].contains("/60.00 "), "{temperatures:?}");
    assert_eq!(conversation.say(numbered(1, "G1 X51").as_bytes()), ["ok"]);
}
