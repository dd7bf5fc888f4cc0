//! A whole file, from its bytes to the step queue.

use core::cell::RefCell;
use core::ffi::CStr;
use core::hint::black_box;

use ferrostep_gcode::{Command, LineReader, parse};
use ferrostep_planner::look_ahead::Slot;

use ferrostep_printer::{Printer, Profile, Signals};

use crate::figures::{Mean, StepEvents};
use crate::host_file::HostFile;
use crate::machine::{BenchPlanner, Machine, NoReplies, QuickTime, execute};
use crate::pieces::{Goal, Outcome, advance};
use crate::queue::PrintQueue;
use crate::report::Print;
use crate::span::Counter;
use crate::step_events;

/// The file, in the emulator's working folder.
const FILE: &CStr = c"print.gcode";

/// Queues that the step interrupt plays; later ones are emptied without it.
const PLAYED_QUEUES: u32 = 1000;

/// Bytes read at once. Reading is not counted.
const PORTION_BYTES: usize = 2048;

/// Prints the file: instructions for each G0 and G1, everything else only executed. The step
/// interrupt plays the first part of it.
pub fn measure(
    counter: &Counter,
    profile: &Profile,
    ring: &mut [Slot],
    queue: &mut PrintQueue,
    step_events: &mut StepEvents,
) -> Result<Print, &'static str> {
    let mut played = 0;
    let mut empty = |queue: &mut PrintQueue| {
        if played < PLAYED_QUEUES {
            played += 1;
            step_events::play_waiting(counter, queue, step_events);
        } else {
            queue.empty();
        }
    };
    let mut file = HostFile::open(FILE)?;
    let planner = RefCell::new(BenchPlanner::new(profile.geometry(), profile.limits, ring));
    let machine = Machine { planner: &planner };
    let signals = Signals::new();
    let mut printer = Printer::<(_, _, _, _)>::new(profile, machine, machine, QuickTime, &NoReplies, &signals);
    let mut print = Print::default();
    let mut make_room = |interpolate: &mut Mean, goal| {
        loop {
            let (instructions, outcome) = counter.count(|| advance(&mut planner.borrow_mut(), queue, goal));
            interpolate.add(instructions, 0);
            empty(queue);
            match outcome {
                Outcome::Reached => return Ok(()),
                Outcome::QueueFull => {}
                Outcome::Waiting if goal == Goal::AllBlocks => return Ok(()),
                Outcome::Waiting => return Err("no block leaves the full ring"),
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
            make_room(&mut print.interpolate, Goal::OneBlock)?;
            let (parse_instructions, command) = counter.count(|| parse(black_box(text)));
            let (execute_instructions, outcome) = counter.count(|| execute(&mut printer, black_box(text)));
            outcome?;
            if let Ok(Command::Linear { .. }) = command {
                print.moves += 1;
                print.parse.add(read_instructions + parse_instructions, 1);
                // The execution includes the parser.
                print.plan.add(execute_instructions.saturating_sub(parse_instructions), 1);
            }
            read_instructions = 0;
        }
    }
    planner.borrow_mut().flush();
    make_room(&mut print.interpolate, Goal::AllBlocks)?;
    print.interpolate = print.interpolate.each_of(print.moves);
    Ok(print)
}
