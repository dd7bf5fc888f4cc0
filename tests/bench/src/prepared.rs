//! The same moves as G-code and prepared, in both encodings: from their bytes to a block whose
//! speeds are known, and on to the step queue.

use core::cell::RefCell;
use core::future::Future;
use core::hint::black_box;
use core::pin::pin;
use core::task::{Context, Poll, Waker};

use ferrostep_gcode::LineReader;
use ferrostep_gpre::compact::{Decoder, Frame, FrameState};
use ferrostep_gpre::{Header, Item};
use ferrostep_papers::wide::{Packet, PacketPlayer, PacketReader, PacketRequest};
use ferrostep_planner::look_ahead::Slot;
use ferrostep_printer::{CommandError, Printer, Profile, Signals};

use crate::figures::Mean;
use crate::machine::{BenchPlanner, BenchPrinter, Machine, NoReplies, QuickTime, execute};
use crate::pieces::{Goal, Outcome, advance};
use crate::queue::PrintQueue;
use crate::span::Counter;

/// Infill of `examples/gyroid.gcode.gz`, and the jobs that the desk prepares of it.
const LINES: &str = include_str!("gyroid/job.gcode");
const COMPACT: &[u8] = include_bytes!("gyroid/compact.gpre");
const WIDE: &[u8] = include_bytes!("gyroid/wide.gpre");

/// Moves before anything is counted: the look-ahead ring is then full, as in a long print.
const WARM_UP_MOVES: u32 = 160;

/// Instructions for the same moves, on two ways.
#[derive(Clone, Copy, Debug, Default)]
pub struct Ways {
    /// The way to a block with its speeds.
    pub to_block: Mean,
    /// The way to the step queue.
    pub to_queue: Mean,
}

/// Instructions of all three sources.
#[derive(Clone, Copy, Debug, Default)]
pub struct Prepared {
    /// The compact encoding.
    pub compact: Ways,
    /// The paper's packets.
    pub wide: Ways,
    /// G-code.
    pub line: Ways,
}

/// Source of moves.
trait Source {
    /// Takes the next piece; returns its number of moves, and `None` at the end.
    fn next(&mut self, printer: &mut BenchPrinter<'_, '_>) -> Result<Option<u32>, &'static str>;
}

/// Lines, with the reader that finds their ends.
struct Text {
    reader: LineReader,
    rest: &'static [u8],
}

impl Source for Text {
    #[inline(never)]
    fn next(&mut self, printer: &mut BenchPrinter<'_, '_>) -> Result<Option<u32>, &'static str> {
        let (used, line) = self.reader.feed(self.rest);
        self.rest = self.rest.get(used..).unwrap_or_default();
        match line {
            None => Ok(None),
            Some(Ok(line)) => execute(printer, line.text).map(|()| Some(u32::from(line.text.starts_with("G1 X")))),
            Some(Err(_)) => Err("a line cannot be read"),
        }
    }
}

/// Frames of bits.
struct Frames {
    rest: &'static [u8],
    items: Option<(Decoder<'static>, FrameState)>,
}

impl Source for Frames {
    #[inline(never)]
    fn next(&mut self, printer: &mut BenchPrinter<'_, '_>) -> Result<Option<u32>, &'static str> {
        const WRONG: &str = "a frame cannot be read";
        loop {
            if let Some((items, start)) = &mut self.items {
                match items.next_item().map_err(|_| WRONG)? {
                    Some(Item::Move(next)) => {
                        return match printer.try_prepared_move(next, &start.modal) {
                            Some(Ok(())) => Ok(Some(1)),
                            _ => Err("a prepared move was refused, or waits"),
                        };
                    }
                    Some(Item::Command { text, .. }) => return execute(printer, text).map(|()| Some(0)),
                    Some(Item::Fan { .. }) => return Ok(Some(0)),
                    None => self.items = None,
                }
            }
            if self.rest.is_empty() {
                return Ok(None);
            }
            let head = self.rest.first_chunk().ok_or(WRONG)?;
            let length = ferrostep_gpre::compact::frame_length(head).map_err(|_| WRONG)?;
            let (frame, rest) = self.rest.split_at_checked(length).ok_or(WRONG)?;
            let items = Frame::read(frame, 0, None).map_err(|_| WRONG)?.items().map_err(|_| WRONG)?;
            let start = *items.start();
            (self.items, self.rest) = (Some((items, start)), rest);
        }
    }
}

/// The outcome of something that has nothing to wait for.
fn at_once(doing: impl Future<Output = Result<(), CommandError>>) -> Result<(), &'static str> {
    match pin!(doing).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(Ok(())) => Ok(()),
        Poll::Ready(Err(_)) => Err("a prepared move was refused"),
        Poll::Pending => Err("a prepared move waits, with nothing to wait for"),
    }
}

/// The paper's packets.
struct Packets {
    rest: &'static [u8],
    reader: PacketReader,
    player: PacketPlayer,
}

impl Source for Packets {
    #[inline(never)]
    fn next(&mut self, printer: &mut BenchPrinter<'_, '_>) -> Result<Option<u32>, &'static str> {
        const WRONG: &str = "a packet cannot be read";
        loop {
            if self.rest.is_empty() {
                return Ok(None);
            }
            let start = self.rest.first_chunk().ok_or(WRONG)?;
            let length = Packet::length(*start).map_err(|_| WRONG)?;
            let (packet, rest) = self.rest.split_at_checked(length).ok_or(WRONG)?;
            self.rest = rest;
            let packet = Packet::read(packet).map_err(|_| WRONG)?;
            match self.reader.take(&packet)? {
                Some(PacketRequest::Block(block, moves)) => {
                    return at_once(self.player.block(&block, moves, printer)).map(|()| Some(moves));
                }
                Some(PacketRequest::Command { text, .. }) => {
                    let text = core::str::from_utf8(text).map_err(|_| WRONG)?;
                    return execute(printer, text).map(|()| Some(0));
                }
                Some(PacketRequest::Fan { .. }) => return Ok(Some(0)),
                // The machine's place is not measured: it has not been homed.
                Some(PacketRequest::Place(_)) | None => {}
            }
        }
    }
}

/// Counts all three, to a block and to the queue.
#[inline(never)]
pub fn measure(
    counter: &Counter,
    profile: &Profile,
    ring: &mut [Slot],
    queue: &mut PrintQueue,
) -> Result<Prepared, &'static str> {
    let without_header = |job: &'static [u8]| {
        let header = Header::read(job).map_err(|_| "a job has no header")?;
        header
            .matches(profile.plan_hash, ferrostep_planner::PLANNER_VERSION)
            .map_err(|_| "a job of another machine")?;
        Ok::<_, &'static str>((header, job.get(header.length() as usize..).ok_or("a job is its header")?))
    };
    let ((header, compact), (_, wide)) = (without_header(COMPACT)?, without_header(WIDE)?);
    // The job is one frame, whose checksum is for all of its moves.
    let (opening, opened) = counter.count(|| Frame::read(black_box(compact), 0, None).is_ok());
    if !opened {
        return Err("a job of several frames");
    }
    let mut bench = Bench { counter, profile, ring, queue };
    let moves = bench.both(|| Frames { rest: black_box(compact), items: None })?;
    let opened = |mean: Mean| mean.with_share_of(opening, header.moves);
    Ok(Prepared {
        compact: Ways { to_block: opened(moves.to_block), to_queue: opened(moves.to_queue) },
        wide: bench.both(|| Packets {
            rest: black_box(wide),
            reader: PacketReader::default(),
            player: PacketPlayer::new(profile, 0),
        })?,
        line: bench.both(|| Text { reader: LineReader::new(), rest: black_box(LINES.as_bytes()) })?,
    })
}

/// Parts that are needed to count.
struct Bench<'a> {
    counter: &'a Counter,
    profile: &'a Profile,
    ring: &'a mut [Slot],
    queue: &'a mut PrintQueue,
}

impl Bench<'_> {
    fn both<S: Source>(&mut self, source: impl Fn() -> S) -> Result<Ways, &'static str> {
        let Self { counter, profile, ring, queue } = self;
        let mut count = |way| one(counter, profile, ring, queue, &mut source(), way);
        Ok(Ways { to_block: count(Way::ToBlock)?, to_queue: count(Way::ToQueue)? })
    }
}

/// Destination up to which moves are counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Way {
    ToBlock,
    ToQueue,
}

/// Counts one of them on a separate planner.
#[inline(never)]
fn one(
    counter: &Counter,
    profile: &Profile,
    ring: &mut [Slot],
    queue: &mut PrintQueue,
    source: &mut dyn Source,
    way: Way,
) -> Result<Mean, &'static str> {
    let planner = RefCell::new(BenchPlanner::new(profile.geometry(), profile.limits, ring));
    let machine = Machine { planner: &planner };
    let signals = Signals::new();
    let mut printer = Printer::<(_, _, _, _)>::new(profile, machine, machine, QuickTime, &NoReplies, &signals);
    let (mut mean, mut moves) = (Mean::default(), 0);
    loop {
        let mut instructions = 0;
        while !planner.borrow().has_room() {
            let mut planner = planner.borrow_mut();
            let (part, outcome) = match way {
                Way::ToBlock => {
                    let see = |planned: &_| {
                        black_box(planned);
                    };
                    let (part, taken) = counter.count(|| planner.take_planned(see));
                    (part, if taken { Outcome::Reached } else { Outcome::Waiting })
                }
                Way::ToQueue => counter.count(|| advance(&mut planner, queue, Goal::OneBlock)),
            };
            instructions += part;
            queue.empty();
            if outcome == Outcome::Waiting {
                return Err("no block leaves the full ring");
            }
        }
        let (part, taken) = counter.count(|| source.next(&mut printer));
        let Some(taken) = taken? else { return Ok(mean) };
        moves += taken;
        if moves > WARM_UP_MOVES {
            mean.add(instructions + part, taken);
        }
    }
}
