//! The times of a print by the lines of its file.

use std::io::{self, Read};
use std::rc::Rc;

use ferrostep_printer::{Ports, Printer};
use ferrostep_session::desk::{Desk, Figures, LineEnds, MotionState, seconds};
use ferrostep_session::input::Input;
use ferrostep_session::job::{self, JobError, JobProgress, Onlooker};
use ferrostep_session::macros::Macros;
use ferrostep_session::schedule::Schedule;
use ferrostep_session::watch::is_pause;
use ferrostep_session::{JobReplies, Session};
use ferrostep_show::{CommentReader, Mark, Marks, TimeOf};

use crate::moment::Moment;
use crate::progress_line;

/// Maximum number of pauses that are noted; a broken file could have any number.
const MAX_PAUSES: usize = 1 << 16;

/// The least time that something other than motion takes, s.
const WAIT_S: f64 = 1e-6;

/// The times of a print by the lines of its file.
#[derive(Debug, Default)]
pub struct PrintTimes {
    /// The end of each line's motion.
    schedule: Schedule,
    /// Lines with a pause or a colour change.
    pauses: Vec<u32>,
    /// The first line with a command.
    first_command: Option<u32>,
    has_progress: bool,
    /// The lines at which the first two layers begin, by the slicer's comments.
    layers: [Option<u32>; 2],
    slicer_time_s: Option<f64>,
    remarks: usize,
}

impl PrintTimes {
    /// Executes a job on a machine that only plans, by its own rules or another firmware's. `look`
    /// is called after each portion of the file.
    ///
    /// # Errors
    /// The job stops at a line, or cannot be read.
    pub fn of<D: Desk>(
        input: &mut Input,
        session: &Session<D, JobReplies<'_>>,
        mut look: impl FnMut(&JobProgress, &dyn Fn() -> Figures),
    ) -> Result<Self, JobError> {
        let ends = Rc::new(LineEnds::default());
        session.desk().follow_lines(Rc::clone(&ends));
        let now = || (session.desk().now_ns() as f64 * 1e-9, session.desk().state().tick());
        let mut commands = Commands { now, ends, waits_s: 0.0, line: 0, found: Self::default() };
        let mut layers =
            LayerReader { input, comments: CommentReader::default(), marks: Marks::default(), found: [None; 2] };
        let mut printer = session.printer();
        let mut done = JobProgress::default();
        let look = |done: &JobProgress| look(done, &|| session.figures());
        session.run(job::run_watched(&mut layers, &mut printer, &mut done, Macros::chosen(), &mut commands, look))?;
        commands.note_ends();
        commands.found.schedule.end(session.figures().print_time_s);
        Ok(Self {
            layers: layers.found,
            slicer_time_s: done.slicer_time_s,
            remarks: session.replies().remarks().to_vec().len(),
            ..commands.found
        })
    }

    /// Time of the whole print, s: from the first line to the last step, with homing, dwells and
    /// heating.
    pub const fn total_s(&self) -> f64 {
        self.schedule.total_s()
    }

    /// Time that the slicer has written, s.
    pub const fn slicer_time_s(&self) -> Option<f64> {
        self.slicer_time_s
    }

    /// Number of remarks on the job's lines.
    pub const fn remarks(&self) -> usize {
        self.remarks
    }

    /// The first line with a command.
    pub const fn first_command(&self) -> Option<u32> {
        self.first_command
    }

    /// Returns true if the file tells the printer how far the print is (M73 P or R).
    pub const fn has_progress(&self) -> bool {
        self.has_progress
    }

    /// The moment at the beginning of a line, when the motion of all lines before has ended.
    pub fn moment(&self, line: u32) -> Moment {
        let elapsed_s = self.before_s(line);
        let next = self.pauses.partition_point(|pause| *pause < line);
        let to_pause_s = self.pauses.get(next).map(|pause| self.before_s(*pause) - elapsed_s);
        Moment { elapsed_s, total_s: self.total_s(), to_pause_s }
    }

    /// The time of a part of the print, as a comment at a line tells it, s.
    pub fn of_part(&self, part: TimeOf, line: u32) -> f64 {
        let [first, second] = self.layers.map(|layer| layer.map(|line| self.before_s(line)));
        match part {
            TimeOf::Print | TimeOf::SilentPrint => self.total_s(),
            TimeOf::Model => self.total_s() - first.unwrap_or_default(),
            TimeOf::FirstLayer => second.unwrap_or(self.total_s()) - first.unwrap_or_default(),
            TimeOf::Elapsed => self.before_s(line),
            TimeOf::Remaining => self.total_s() - self.before_s(line),
        }
    }

    fn before_s(&self, line: u32) -> f64 {
        // What comes after the last step is no part of the print.
        self.schedule.at_s(line.saturating_sub(1)).min(self.total_s())
    }
}

/// Notes what commands a job has, and when its lines end.
struct Commands<F> {
    /// The time, s, and the motion clock, ticks.
    now: F,
    ends: Rc<LineEnds>,
    /// Time that something other than motion has taken before the line, s.
    waits_s: f64,
    line: u32,
    found: PrintTimes,
}

impl<F> Commands<F> {
    /// Notes the ends of moves. A wait begins when all motion before it has ended, so the waits
    /// before the present line are those before each of these ends.
    fn note_ends(&mut self) {
        while let Some((line, tick)) = self.ends.take() {
            self.found.schedule.note(line, self.waits_s + seconds(tick));
        }
    }
}

impl<P: Ports, F: Fn() -> (f64, u64)> Onlooker<P> for Commands<F> {
    fn begins(&mut self, _: &Printer<'_, P>, line: u32, text: &str) {
        self.note_ends();
        let (now_s, tick) = (self.now)();
        self.waits_s = now_s - seconds(tick);
        self.line = line;
        self.found.first_command.get_or_insert(line);
        if let Some(words) = progress_line::words(text.as_bytes()) {
            self.found.has_progress |= progress_line::tells_progress(&words);
        }
        if is_pause(text) && self.found.pauses.len() < MAX_PAUSES {
            self.found.pauses.push(line);
        }
    }

    fn ended(&mut self, _: &Printer<'_, P>) {
        // Homing and waits begin when all motion before them has ended.
        self.note_ends();
        let (now_s, _) = (self.now)();
        if now_s > self.found.schedule.newest_s() + WAIT_S {
            self.found.schedule.note(self.line, now_s);
        }
    }
}

/// Reads a job, and looks for the beginnings of its first layers on the way.
struct LayerReader<'a> {
    input: &'a mut Input,
    comments: CommentReader,
    marks: Marks,
    found: [Option<u32>; 2],
}

impl Read for LayerReader<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let length = self.input.read(bytes)?;
        let Self { comments, marks, found, .. } = self;
        if found.iter().any(Option::is_none) {
            comments.read(bytes.get(..length).unwrap_or_default(), |line, comment| {
                if marks.read(comment) == Some(Mark::Layer)
                    && let Some(place) = found.iter_mut().find(|place| place.is_none())
                {
                    *place = Some(line);
                }
            });
        }
        Ok(length)
    }
}
