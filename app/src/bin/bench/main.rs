//! Counts the processor's instructions for the parts of a print, for `cargo xtask bench`.
//!
//! In the emulator the timer that is read here advances once an instruction, so the numbers are exact: the same on
//! every run and every machine. What an instruction costs on silicon (flash wait states, interrupt entry) is not in
//! them. Each number is a mean over [`lines::LINES`].
#![no_std]
#![no_main]

mod lines;
mod machine;
#[path = "../../profile.rs"]
mod profile;
mod report;

use core::cell::RefCell;
use core::future::Future;
use core::hint::black_box;
use core::panic::PanicInfo;
use core::pin::pin;
use core::sync::atomic::{Ordering, compiler_fence};
use core::task::{Context, Poll, Waker};

use cortex_m::singleton;
use cortex_m_rt::entry;
use cortex_m_semihosting::{debug, hprintln};
use ferrostep_gcode::{LineReader, parse};
use ferrostep_hal_shim::step_player::StepLink;
use ferrostep_hal_shim::step_ring::StepRing;
use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::{Progress, StepKind};
use ferrostep_printer::{Printer, Signals};
use ferrostep_stm32f4::bench::BenchPins;
use ferrostep_stm32f4::motion_clock::MotionClock;
use ferrostep_stm32f4::pac::{Peripherals, RCC, TIM2};
use ferrostep_stm32f4::step_timer::StepTimer;

use lines::LINES;
use machine::{BenchPlanner, Entries, LOOK_AHEAD_BLOCKS, Machine, NoReplies, NoTime};
use profile::PROFILE;
use report::{Mean, Report};

/// Rounds over the lines before anything is counted: the look-ahead ring is then full, as in a long print.
const WARM_UP_ROUNDS: usize = 3;

/// Entries in the step ring of the step handler's bench.
const STEP_RING_ENTRIES: usize = 2 * machine::KEPT_ENTRIES;

/// The ring that the step handler empties.
static STEP_RING: StepRing<STEP_RING_ENTRIES> = StepRing::new();

/// Its flags.
static STEP_LINK: StepLink = StepLink::new();

/// The board's parts that the bench takes.
struct Parts {
    counter: Counter,
    step_timer: TIM2,
    rcc: RCC,
    pins: &'static BenchPins,
}

impl Parts {
    fn take() -> Option<Self> {
        let peripherals = Peripherals::take()?;
        let rcc = peripherals.RCC;
        let pins = singleton!(: BenchPins = BenchPins::new(peripherals.GPIOC, &peripherals.GPIOA, &rcc))?;
        let counter = Counter::start(MotionClock::start(peripherals.TIM5, &rcc));
        Some(Self { counter, step_timer: peripherals.TIM2, rcc, pins })
    }
}

/// The clock that counts instructions.
struct Counter {
    clock: MotionClock,
    /// What counting nothing counts.
    overhead: u32,
}

impl Counter {
    fn start(clock: MotionClock) -> Self {
        let mut counter = Self { clock, overhead: 0 };
        counter.overhead = counter.count(|| ()).0;
        counter
    }

    fn now(&self) -> u32 {
        // Nothing moves from one side of the reading to the other.
        compiler_fence(Ordering::SeqCst);
        let now = self.clock.now_ticks();
        compiler_fence(Ordering::SeqCst);
        now
    }

    /// Runs a piece; how many instructions it took, and its result.
    fn count<T>(&self, piece: impl FnOnce() -> T) -> (u32, T) {
        let start = self.now();
        let result = black_box(piece());
        let end = self.now();
        (end.wrapping_sub(start).saturating_sub(self.overhead), result)
    }
}

#[entry]
fn main() -> ! {
    let report = Parts::take().map(measure);
    match report {
        Some(Ok(report)) => {
            hprintln!("{}", report);
            debug::exit(debug::EXIT_SUCCESS);
        }
        Some(Err(reason)) => hprintln!("{}", reason),
        None => hprintln!("the peripherals were taken before"),
    }
    debug::exit(debug::EXIT_FAILURE);
    halt()
}

/// Every piece, in the order of a print.
fn measure(parts: Parts) -> Result<Report, &'static str> {
    let mut report = Report { parse_line: parse_lines(&parts.counter)?, ..Report::default() };
    let entries = singleton!(: Entries = Entries::new()).ok_or("no memory for the step entries")?;
    print_lines(&parts.counter, entries, &mut report)?;
    report.step_event = step_events(parts, entries);
    Ok(report)
}

/// Bytes to a command: line reader and parser.
fn parse_lines(counter: &Counter) -> Result<Mean, &'static str> {
    let mut reader = LineReader::new();
    let mut mean = Mean::default();
    for text in LINES {
        let mut bytes = heapless::Vec::<u8, 64>::from_slice(text.as_bytes()).map_err(|_| "a line is too long")?;
        bytes.push(b'\n').map_err(|_| "a line is too long")?;
        let bytes = black_box(bytes.as_slice());
        let (instructions, parsed) = counter.count(|| match reader.feed(bytes).1 {
            Some(Ok(line)) => black_box(parse(line.text)).is_ok(),
            _ => false,
        });
        if !parsed {
            return Err("a line does not parse");
        }
        mean.add(instructions, 1);
    }
    Ok(mean)
}

/// Text to a block in the full look-ahead ring, and the blocks that leave it to step entries.
fn print_lines(counter: &Counter, entries: &mut Entries, report: &mut Report) -> Result<(), &'static str> {
    let profile = &PROFILE;
    let ring: &'static mut [Slot] = singleton!(: [Slot; LOOK_AHEAD_BLOCKS] = [Slot::EMPTY; LOOK_AHEAD_BLOCKS])
        .ok_or("no memory for the look-ahead ring")?;
    let planner = RefCell::new(BenchPlanner::new(profile.geometry(), profile.limits, ring));
    let machine = Machine { planner: &planner };
    let signals = Signals::new();
    let mut printer = Printer::new(profile, machine, machine, NoTime, &NoReplies, &signals);
    let mut execute = |text: &str| match poll_once(printer.execute(0, black_box(text))) {
        Some(Ok(())) => Ok(()),
        Some(Err(_)) => Err("a line was refused"),
        None => Err("a line waits, with nothing to wait for"),
    };
    execute("G1 F1200")?;
    for round in 0..=WARM_UP_ROUNDS {
        execute("G92 E0")?;
        for text in LINES {
            while !machine.planner.borrow().has_room() {
                let (entries_before, events_before) = (entries.entries, entries.events);
                let (instructions, progress) = counter.count(|| machine.planner.borrow_mut().advance(entries));
                if progress == Progress::Waiting {
                    return Err("no block leaves the full ring");
                }
                if round == WARM_UP_ROUNDS {
                    report.block_to_queue_per_step.add(instructions, entries.events - events_before);
                    report.block_to_queue_per_entry.add(instructions, entries.entries - entries_before);
                }
            }
            let (instructions, outcome) = counter.count(|| execute(text));
            outcome?;
            if round == WARM_UP_ROUNDS {
                report.line_to_block.add(instructions, 1);
            }
        }
    }
    Ok(())
}

/// The step interrupt's work for each event, without the processor's own entry and exit and without the time that it
/// waits for a step signal to be long enough.
fn step_events(parts: Parts, entries: &Entries) -> Mean {
    let Parts { counter, step_timer, rcc, pins } = parts;
    let mut events = 0;
    for &entry in entries.kept.oldest_ordered() {
        STEP_RING.push(entry);
        if let StepKind::Stair { count, .. } = entry.kind() {
            events += u32::from(count);
        }
    }
    let mut handler = StepTimer::start(step_timer, &rcc, pins, &STEP_RING, &STEP_LINK, 0);
    STEP_LINK.start();
    let mut instructions = 0;
    while STEP_LINK.is_busy() {
        instructions += counter.count(|| handler.update()).0;
    }
    let mut mean = Mean::default();
    mean.add(instructions, events);
    mean
}

/// The result of a future that has nothing to wait for.
fn poll_once<F: Future>(future: F) -> Option<F::Output> {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(output) => Some(output),
        Poll::Pending => None,
    }
}

fn halt() -> ! {
    loop {
        cortex_m::asm::wfi();
    }
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    hprintln!("{}", info);
    debug::exit(debug::EXIT_FAILURE);
    halt()
}
