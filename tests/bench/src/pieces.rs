//! The parts of a print on its way to the step queue, one at a time.
//!
//! Each has a separate planner on the stack, and leaves it before the next: they are not inlined
//! into one function, whose planners would not all fit.

use core::cell::RefCell;
use core::hint::black_box;

use ferrostep_gcode::{LineReader, parse};
use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::{Limits, Move, Progress};
use ferrostep_printer::{Printer, Profile, Signals};

use crate::cube_lines::LINES;
use crate::figures::Mean;
use crate::machine::{BenchPlanner, Machine, NoReplies, QuickTime, execute};
use crate::queue::PrintQueue;
use crate::span::Counter;

/// Rounds over the lines before anything is counted: the look-ahead ring is then full, as
/// in a long print.
const WARM_UP_ROUNDS: usize = 3;

/// Bytes to a command: line reader and parser.
pub fn parse_lines(counter: &Counter) -> Result<Mean, &'static str> {
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

/// Text to a block in the full look-ahead ring.
#[inline(never)]
pub fn lines_to_blocks(
    counter: &Counter,
    profile: &Profile,
    ring: &mut [Slot],
    queue: &mut PrintQueue,
) -> Result<Mean, &'static str> {
    let planner = RefCell::new(BenchPlanner::new(profile.geometry(), profile.limits, ring));
    let machine = Machine { planner: &planner };
    let signals = Signals::new();
    let mut printer = Printer::<(_, _, _, _)>::new(profile, machine, machine, QuickTime, &NoReplies, &signals);
    let mut mean = Mean::default();
    execute(&mut printer, "G1 F1200")?;
    for round in 0..=WARM_UP_ROUNDS {
        execute(&mut printer, "G92 E0")?;
        for text in LINES {
            make_room(&mut planner.borrow_mut(), queue)?;
            let (instructions, outcome) = counter.count(|| execute(&mut printer, black_box(text)));
            outcome?;
            if round == WARM_UP_ROUNDS {
                mean.add(instructions, 1);
            }
        }
    }
    Ok(mean)
}

/// The same lines' moves to blocks: kinematics, corner and the reverse pass through the full ring.
#[inline(never)]
pub fn moves_to_blocks(
    counter: &Counter,
    profile: &Profile,
    ring: &mut [Slot],
    queue: &mut PrintQueue,
) -> Result<Mean, &'static str> {
    let mut planner = BenchPlanner::new(profile.geometry(), profile.limits, ring);
    let mut mean = Mean::default();
    for round in 0..=WARM_UP_ROUNDS {
        let mut extruded_100pm = 0;
        for text in LINES {
            let request = relative(&mut extruded_100pm, text)?;
            make_room(&mut planner, queue)?;
            let (instructions, outcome) = counter.count(|| planner.add(black_box(&request)));
            outcome.map_err(|_| "a move was refused")?;
            if round == WARM_UP_ROUNDS {
                mean.add(instructions, 1);
            }
        }
    }
    Ok(mean)
}

/// The move of a line with X, Y and E, read by the shortest code; E counts from the line before.
fn relative(extruded_100pm: &mut i64, text: &str) -> Result<Move, &'static str> {
    let (mut target_10nm, mut filament_100pm) = ([0; 3], 0);
    for word in text.split(' ').skip(1) {
        let (letter, digits) = word.split_at_checked(1).ok_or("a line of other words")?;
        let value: f64 = digits.parse().map_err(|_| "a line of other words")?;
        let [x, y, _] = &mut target_10nm;
        match letter {
            "X" => *x = (value * 1e5 + 0.5) as i64,
            "Y" => *y = (value * 1e5 + 0.5) as i64,
            _ => filament_100pm = (value * 1e7 + 0.5) as i64,
        }
    }
    let filament_100pm = filament_100pm - core::mem::replace(extruded_100pm, filament_100pm);
    Ok(Move { target_10nm, filament_100pm, feed_mm_per_s: 20.0, line: 0, ends_move: true })
}

/// Releases blocks until one more fits.
fn make_room(planner: &mut BenchPlanner<'_>, queue: &mut PrintQueue) -> Result<(), &'static str> {
    loop {
        let outcome = advance(planner, queue, Goal::OneBlock);
        queue.empty();
        match outcome {
            Outcome::Reached => return Ok(()),
            Outcome::QueueFull => {}
            Outcome::Waiting => return Err("no block leaves the full ring"),
        }
    }
}

/// Number of blocks that shall leave the look-ahead ring.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Goal {
    /// The fewest that let another fit.
    OneBlock,
    /// All blocks.
    AllBlocks,
    /// The blocks that one call of the planner takes: none, or one.
    OneCall,
}

/// Reason for which [`advance`] has returned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The goal is reached.
    Reached,
    /// The queue must be emptied first.
    QueueFull,
    /// No block may leave.
    Waiting,
}

/// Blocks to the step queue. One copy, as in the firmware.
pub fn advance(planner: &mut BenchPlanner<'_>, queue: &mut PrintQueue, goal: Goal) -> Outcome {
    while goal != Goal::OneBlock || !planner.has_room() {
        if !queue.has_room() {
            return Outcome::QueueFull;
        }
        if planner.advance(queue) == Progress::Waiting {
            return Outcome::Waiting;
        }
        if goal == Goal::OneCall {
            break;
        }
    }
    Outcome::Reached
}

/// A trapezoid of 30 mm along `path_mm` (X and Y) with 1 mm of filament, at 100 mm/s and 1000
/// mm/s^2: instructions from the popped block to entries in the queue.
#[inline(never)]
pub fn trapezoid(
    counter: &Counter,
    profile: &Profile,
    ring: &mut [Slot],
    queue: &mut PrintQueue,
    [x_mm, y_mm]: [i64; 2],
) -> Result<u32, &'static str> {
    let limits = Limits {
        max_feed_mm_per_s: [200.0; 4],
        max_acceleration_mm_per_s2: [5000.0; 4],
        print_acceleration_mm_per_s2: 1000.0,
        ..profile.limits
    };
    let mut planner = BenchPlanner::new(profile.geometry(), limits, ring);
    let request = Move {
        target_10nm: [x_mm * 100_000, y_mm * 100_000, 0],
        filament_100pm: 10_000_000,
        feed_mm_per_s: 100.0,
        line: 0,
        ends_move: true,
    };
    planner.add(&request).map_err(|_| "the trapezoid was refused")?;
    planner.flush();
    let mut instructions = 0;
    loop {
        let (part, outcome) = counter.count(|| advance(&mut planner, queue, Goal::AllBlocks));
        instructions += part;
        queue.empty();
        if outcome != Outcome::QueueFull {
            return Ok(instructions);
        }
    }
}
