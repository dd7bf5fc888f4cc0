//! The black box: records in memory that a reset leaves alone, the step queue's past, and their
//! output to a host (M791).

use core::cell::{Cell, RefCell};
use core::fmt::{self, Write};

use ferrostep_black_box::{Dump, Facts, Found, HeaterSample, MAX_TEXT_BYTES, Record, RecordMemory, StepPast};
use ferrostep_hal_shim::Heater;
use ferrostep_planner::TICKS_PER_SECOND;
use ferrostep_printer::Heating;
use ferrostep_printer::heat::HeatFault;
use ferrostep_step_interrupt::STEPS;
use ferrostep_step_player::{Past, PastSlot};
use ferrostep_stm32f4::ResetCause;
use ferrostep_stm32f4_board::board::{self, PIN_MAP};
use ferrostep_stm32f4_board::{Rcc, black_box};
use heapless::String;
use rtic::Mutex;
use rtic_monotonics::systick::prelude::*;

use crate::clock::Mono;
use crate::host_line::Writers;
use crate::identity::IDENTITY;
use crate::ports::{BoardMachine, BoardReplies};
use crate::profile::PROFILE;

/// Interval between two checks for room for a line, ms.
const LOOK_MS: u32 = 2;

/// Number of checks after which a host that does not read gets no more lines: 2 s.
const MAX_LOOKS: u32 = 1000;

/// The records, shared by the tasks that write them. One writes at a time.
pub struct Records(&'static RecordMemory);

impl Records {
    /// Takes over the records of the program that ran before this reset, and the step queue's past;
    /// the interrupt may run after this call.
    pub fn start(cause: ResetCause, rcc: &Rcc) -> Self {
        // After a power-on the memory is random.
        STEPS.restart(cause != ResetCause::PowerOn);
        let memory = black_box::start(rcc);
        if memory.restart(STEPS.motions()) == Found::Records {
            memory.add_last(None, &Record::Reset(cause.name().as_bytes()));
        }
        Self(memory)
    }

    /// Records the last words of the previous program.
    pub fn last_words(&self, words: &dyn fmt::Display) {
        self.0.add_last(None, &Record::LastWords(text(words).as_bytes()));
    }

    /// Records the present temperatures.
    pub fn temperatures(&self, heating: &impl Heating) {
        let sample = |heater| {
            let status = heating.status(heater);
            HeaterSample::new(status.celsius, status.target_celsius, status.power)
        };
        self.record(&Record::Temperatures([Heater::Nozzle, Heater::Bed].map(sample)));
        if heating.chamber_is_heated().is_some() {
            self.record(&Record::Chamber(sample(Heater::Chamber)));
        }
        if heating.has_nozzles() {
            self.record(&Record::Nozzle1(sample(Heater::Nozzle1)));
        }
    }

    /// Records a driver's report.
    #[cfg(drivers)]
    pub fn driver(&self, event: &dyn fmt::Display) {
        self.record(&Record::Driver(text(event).as_bytes()));
    }

    /// Records that the machine was halted: nothing more is recorded until the next motion.
    pub fn halted(&self, fault: Option<HeatFault>) {
        match fault {
            Some(fault) => self.record(&Record::Halt(text(&fault).as_bytes())),
            None => self.record(&Record::Halt(b"by M112 or a motor's driver")),
        }
        self.0.freeze(STEPS.motions());
    }

    fn record(&self, record: &Record<'_>) {
        self.0.record(Mono::now().ticks(), STEPS.motions(), record);
    }
}

/// A text, cut to the length that a record holds.
#[inline(never)]
fn text(of: &dyn fmt::Display) -> String<MAX_TEXT_BYTES> {
    let mut text = String::new();
    let _cut = write!(text, "{of}");
    text
}

/// Records the motor positions at the end of the queue.
pub fn note_position(machine: &BoardMachine) {
    let steps = machine.motor_steps().map(|steps| steps as i32);
    STEPS.note_position(machine.slots_queued(), steps, Mono::now().ticks());
}

/// The black box, as shared with the task that executes commands.
pub struct BoardBlackBox<B> {
    records: RefCell<B>,
    is_wanted: Cell<bool>,
}

impl<B: Mutex<T = Records>> BoardBlackBox<B> {
    /// Creates a black box that no host has asked for yet.
    pub const fn new(records: B) -> Self {
        Self { records: RefCell::new(records), is_wanted: Cell::new(false) }
    }

    /// Returns true once after a host has asked for the record, which goes to the host that was
    /// answered last.
    pub fn take_wanted(&self) -> bool {
        self.is_wanted.take()
    }

    /// Sends the record to the host that is being answered, as fast as that host reads, at
    /// standstill.
    pub async fn send_to<W: Mutex<T = Writers>>(&self, replies: &BoardReplies<W>) {
        let facts = Facts {
            both_edges: PROFILE.driver.both_edges,
            tick_hz: TICKS_PER_SECOND,
            pulse_ticks: STEPS.pulse_ticks(),
            now_ms: Mono::now().ticks(),
            names: [board::NAME, PROFILE.name, IDENTITY.version()],
        };
        let memory = self.records.borrow_mut().lock(|records| records.0);
        let mut dump = Dump::new(Steps, memory, facts);
        let mut line = String::new();
        while dump.next_line(&mut line) {
            let mut looks = 0;
            while !replies.have_room() {
                looks += 1;
                if looks > MAX_LOOKS {
                    return;
                }
                Mono::delay(LOOK_MS.millis()).await;
            }
            replies.text(&line);
        }
    }
}

impl<B> fmt::Debug for BoardBlackBox<B> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("BoardBlackBox")
    }
}

impl<B: Mutex<T = Records>> ferrostep_printer::BlackBox for BoardBlackBox<B> {
    fn command(&self, line: u32, text: &str) {
        self.records.borrow_mut().lock(|records| records.record(&Record::Command { line, text: text.as_bytes() }));
    }

    fn send(&self) {
        self.is_wanted.set(true);
    }

    fn clear(&self) {
        self.records.borrow_mut().lock(|records| records.0.clear());
        STEPS.forget_past();
    }
}

/// The step queue's past, in terms of this board's motors.
struct Steps;

impl StepPast for Steps {
    fn past(&self) -> Past {
        STEPS.past()
    }

    fn slot(&self, number: u32) -> Option<PastSlot> {
        STEPS.past_slot(number, &PIN_MAP.with_inverted(PROFILE.driver.inverted))
    }
}
