//! A whole file, from its bytes to the step queue.

use core::cell::RefCell;
use core::hint::black_box;

use ferrostep_gcode::{Command, LineReader, parse};
use ferrostep_planner::Progress;
use ferrostep_planner::look_ahead::Slot;
use ferrostep_printer::{Printer, Profile, Signals};

use crate::counter::Counter;
use crate::host_file::HostFile;
use crate::machine::{BenchPlanner, Machine, NoReplies, QuickTime, execute};
use crate::queue::BenchQueue;
use crate::report::{Mean, Print, StepEvents};
use crate::step_events;

/// The step interrupt is counted for the first of so many entries; the queue is emptied without it then.
const PLAYED_ENTRIES: u32 = 50_000;

/// Bytes read at once. Reading is not counted.
const PORTION_BYTES: usize = 2048;

/// Prints a file: instructions for each G0 and G1, everything else only executed. The step interrupt plays the first
/// part of it.
pub fn measure(
    counter: &Counter,
    profile: &Profile,
    ring: &mut [Slot],
    queue: &mut BenchQueue,
    step_events: &mut StepEvents,
    file: &mut HostFile,
) -> Result<Print, &'static str> {
    (queue.entries, queue.events) = (0, 0);
    let planner = RefCell::new(BenchPlanner::new(profile.geometry(), profile.limits, ring));
    let machine = Machine { planner: &planner };
    let signals = Signals::new();
    let mut printer = Printer::new(profile, machine, machine, QuickTime, &NoReplies, &signals);
    let mut print = Print::default();
    let mut make_room = |interpolate: &mut Mean, queue: &mut BenchQueue, all| {
        loop {
            let (instructions, progress) = counter.count(|| advance(&mut planner.borrow_mut(), queue, all));
            interpolate.add(instructions, 0);
            empty(counter, queue, step_events);
            match progress {
                Some(Progress::Worked) => {}
                Some(Progress::Waiting) if !all => return Err("no block leaves the full ring"),
                _ => return Ok(()),
            }
        }
    };

    let mut reader = LineReader::new();
    let mut buffer = [0; PORTION_BYTES];
    let mut read_instructions = 0;
    loop {
        let mut bytes = file.read(&mut buffer)?;
        if bytes.is_empty() {
            break;
        }
        while !bytes.is_empty() {
            let feed = &mut reader;
            let (instructions, (used, line)) = counter.count(move || feed.feed(bytes));
            bytes = bytes.get(used..).unwrap_or_default();
            read_instructions += instructions;
            let Some(line) = line else { continue };
            let text = line.map_err(|_| "a line cannot be read")?.text;
            make_room(&mut print.interpolate, queue, false)?;
            let (parse_instructions, command) = counter.count(|| parse(black_box(text)));
            let (execute_instructions, outcome) = counter.count(|| execute(&mut printer, black_box(text)));
            outcome?;
            if let Ok(Command::Linear { .. }) = command {
                print.moves += 1;
                print.parse.add(read_instructions + parse_instructions, 1);
                // Which parses too.
                print.plan.add(execute_instructions.saturating_sub(parse_instructions), 1);
            }
            read_instructions = 0;
        }
    }
    planner.borrow_mut().flush();
    make_room(&mut print.interpolate, queue, true)?;
    print.interpolate = print.interpolate.each_of(print.moves);
    (print.entries, print.events) = (queue.entries, queue.events);
    Ok(print)
}

/// Lets blocks leave until one more fits, or all of them; `None` when that is so, and an answer when the queue is full
/// or nothing moves.
#[inline]
fn advance(planner: &mut BenchPlanner<'_>, queue: &mut BenchQueue, all: bool) -> Option<Progress> {
    while all || !planner.has_room() {
        if !queue.has_room() {
            return Some(Progress::Worked);
        }
        if planner.advance(queue) == Progress::Waiting {
            return Some(Progress::Waiting);
        }
    }
    None
}

/// Empties the queue, by the interrupt at first.
fn empty(counter: &Counter, queue: &mut BenchQueue, step_events: &mut StepEvents) {
    if queue.entries < PLAYED_ENTRIES {
        queue.recount();
        step_events::play_waiting(counter, queue, step_events);
    } else {
        queue.drain();
    }
}
