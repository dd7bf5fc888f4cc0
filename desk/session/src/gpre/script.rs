//! The parts of a job in their order, from the G-code to the file: moves wait here until look-ahead
//! has settled their speeds.

use std::collections::VecDeque;

use ferrostep_gcode::{Command, parse};
use ferrostep_gpre::{Coordinate, EntrySpeed, Item, ModalState, PreparedMove};
use ferrostep_papers::Papers;
use ferrostep_planner::look_ahead::{ForwardPass, RingMemory};
use ferrostep_planner::{Move, PlannedBlock, Planner, Recorded, Recorder, SquaredSpeed};

/// Form in which the command in execution is written to the file.
#[derive(Clone, Debug, Default, PartialEq)]
enum Now {
    /// The line's moves.
    Moves {
        /// True if their filament counts in E.
        counts: bool,
    },
    /// A change of the fan.
    Fan { line: u32, power: u8 },
    /// The command's text; the machine makes its motion by itself (homing).
    #[default]
    Text,
}

/// A block's speeds.
#[derive(Clone, Copy, Debug)]
struct Speeds {
    planned: PlannedBlock,
    entry: SquaredSpeed,
    bound: SquaredSpeed,
}

/// A part of the job that is not in the file yet.
#[derive(Clone, Debug)]
enum Waiting {
    /// A block's first move; `None` for one that the machine makes by itself.
    First { item: Option<PreparedMove>, speeds: Option<Speeds> },
    /// Moves that the machine made by itself.
    Anew,
    /// A part that waits only for the parts before.
    Ready(Ready),
}

/// A part that is ready for the file.
#[derive(Clone, Debug, PartialEq)]
pub enum Ready {
    /// A block's first move.
    First {
        /// The move.
        item: PreparedMove,
        /// The whole block.
        planned: PlannedBlock,
        /// The maximum that the corner before it and both feeds allow.
        bound: SquaredSpeed,
        /// Number of moves that are joined to it.
        joined: usize,
    },
    /// A move that was joined to the one before.
    Joined(PreparedMove),
    /// The fan.
    Fan {
        /// Source line.
        line: u32,
        /// Power, 0 to 255.
        power: u8,
    },
    /// A command.
    Command {
        /// Source line.
        line: u32,
        /// The command's text.
        text: String,
    },
    /// The settings in force have changed.
    State {
        /// The state.
        modal: ModalState,
        /// Position of the machine, units of 10 nm.
        position_10nm: [i64; 3],
    },
}

impl Ready {
    /// The item of the file; `None` for a state.
    pub fn item(&self) -> Option<Item<'_>> {
        match self {
            Self::First { item, .. } | Self::Joined(item) => Some(Item::Move(item)),
            Self::Fan { line, power } => Some(Item::Fan { line: *line, power: *power }),
            Self::Command { line, text } => Some(Item::Command { line: *line, text }),
            Self::State { .. } => None,
        }
    }
}

/// The job between G-code and file.
#[derive(Debug, Default)]
pub struct Script {
    now: Now,
    waiting: VecDeque<Waiting>,
    /// Number of parts that have left `waiting`.
    left: u64,
    /// Blocks whose first moves have no speeds yet, counted from the job's start.
    unplanned: VecDeque<u64>,
    recorder: Recorder,
    pass: ForwardPass,
    /// The speed that the block before can reach at its end.
    reachable: SquaredSpeed,
}

impl Script {
    /// A line is about to be executed.
    pub fn begins(&mut self, line: u32, text: &str) {
        let command = parse(text);
        // The beginning of a command without effect is enough for a remark.
        let most = ferrostep_gpre::compact::MAX_TEXT_BYTES;
        let kept = match command {
            Ok(Command::Accepted | Command::Unknown(_)) => text.get(..text.floor_char_boundary(most)).unwrap_or(text),
            _ => text,
        };
        self.now = match command {
            Ok(Command::Linear { .. } | Command::Arc { .. }) => Now::Moves { counts: true },
            Ok(Command::Retract | Command::Recover) => Now::Moves { counts: false },
            Ok(Command::Fan { number: 0, power }) => Now::Fan { line, power },
            _ => Now::Text,
        };
        match self.now {
            Now::Moves { .. } => {}
            Now::Fan { line, power } => self.waiting.push_back(Waiting::Ready(Ready::Fan { line, power })),
            Now::Text => self.waiting.push_back(Waiting::Ready(Ready::Command { line, text: kept.to_owned() })),
        }
    }

    /// The line has been executed; these settings are in force.
    pub fn ended(&mut self, modal: ModalState, position_10nm: [i64; 3]) {
        if self.now == Now::Text {
            self.waiting.push_back(Waiting::Ready(Ready::State { modal, position_10nm }));
        }
        self.now = Now::Text;
    }

    /// The planner has taken a move.
    pub fn moved(&mut self, request: &Move, joined: bool) {
        let item = match self.now {
            Now::Moves { counts } => Some(PreparedMove {
                // The planner has taken it: within 5 m.
                target: request.target_10nm.map(|units| Coordinate::new(units as i32).unwrap_or_default()),
                filament_100pm: request.filament_100pm,
                feed_mm_per_s: request.feed_mm_per_s,
                line: request.line,
                ends_move: request.ends_move,
                counts,
                entry: EntrySpeed::Continues,
            }),
            _ => None,
        };
        match item {
            Some(item) if joined => self.waiting.push_back(Waiting::Ready(Ready::Joined(item))),
            None if joined => {}
            item => {
                self.unplanned.push_back(self.left + self.waiting.len() as u64);
                self.waiting.push_back(Waiting::First { item, speeds: None });
            }
        }
    }

    /// Takes the next block that leaves look-ahead, without making its steps, and notes its speeds.
    pub fn record_next<S: RingMemory>(&mut self, planner: &mut Planner<S, Papers>) -> Option<Recorded> {
        let recorded = self.recorder.next(planner)?;
        if let Recorded::Block { planned, entry, bound } = recorded
            && let Some(index) = self.unplanned.pop_front()
            && let Some(Waiting::First { speeds, .. }) = self.waiting.get_mut((index - self.left) as usize)
        {
            *speeds = Some(Speeds { planned, entry, bound });
        }
        Some(recorded)
    }

    /// Moves that have no speeds yet have been made in another way: up to an end stop.
    pub fn sought(&mut self) {
        self.unplanned.clear();
        for waiting in &mut self.waiting {
            if let Waiting::First { item: None, .. } = waiting {
                *waiting = Waiting::Anew;
            }
        }
    }

    /// The next part that is ready.
    pub fn pop(&mut self) -> Option<Ready> {
        loop {
            if let Waiting::First { speeds: None, .. } = self.waiting.front()? {
                return None;
            }
            self.left += 1;
            return Some(match self.waiting.pop_front()? {
                Waiting::Anew | Waiting::First { item: None, .. } => {
                    self.pass = ForwardPass::default();
                    self.reachable = SquaredSpeed::ZERO;
                    continue;
                }
                Waiting::First { item: Some(item), speeds } => {
                    let Speeds { planned, bound, .. } = speeds?;
                    let of_this = |waiting: &&Waiting| !matches!(waiting, Waiting::First { .. } | Waiting::Anew);
                    let of_this = self.waiting.iter().take_while(of_this);
                    let joined = of_this.filter(|waiting| matches!(waiting, Waiting::Ready(Ready::Joined(_)))).count();
                    Ready::First { item: PreparedMove { entry: self.entry(&speeds?), ..item }, planned, bound, joined }
                }
                Waiting::Ready(ready) => ready,
            });
        }
    }

    /// The shortest encoding of the planned speed, from which the reader's forward
    /// pass makes the same.
    fn entry(&mut self, speeds: &Speeds) -> EntrySpeed {
        let Speeds { planned, entry, bound } = speeds;
        let said = |said: EntrySpeed| {
            let mut pass = self.pass;
            let most = pass.fastest();
            let wanted = pass.next(&planned.block, *bound, false, said).ok()?;
            // A higher one would make the reader expect more speed at the block's end than it has.
            let holds = wanted.min(self.reachable).root() == planned.entry && wanted.min(most) <= *entry;
            holds.then_some(pass)
        };
        let (speed, pass) = if let Some(pass) = said(EntrySpeed::Bound) {
            (EntrySpeed::Bound, pass)
        } else if let Some(pass) = said(EntrySpeed::Falling) {
            (EntrySpeed::Falling, pass)
        } else {
            let mut pass = self.pass;
            // The entry is within its bounds, as it is the reverse pass's.
            let _ = pass.next(&planned.block, *bound, false, EntrySpeed::Given(*entry));
            (EntrySpeed::Given(*entry), pass)
        };
        self.pass = pass;
        self.reachable = SquaredSpeed::from(planned.entry).changed_over(&planned.block);
        speed
    }
}
