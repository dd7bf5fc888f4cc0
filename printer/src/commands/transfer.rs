//! A prepared job from a host's line (M790), executed as it arrives.
//!
//! While moves wait for room, the line is still read and the host's questions are still answered.
//! Numbered lines of G-code between the frames are executed between two items of the job.

use core::fmt;
use core::future::{Future, poll_fn};
use core::pin::pin;
use core::task::Poll;

use ferrostep_gcode::{Line, LineError, Reply};
use ferrostep_gpre::compact::{Decoder, Frame, FrameState};
use ferrostep_gpre::parts::{Part, Parts};
use ferrostep_gpre::transfer::{Event, Receiver, Report, Word};
use ferrostep_gpre::{Encoding, Fault, Header, Item, ReadError};
use ferrostep_hal_shim::Clock;
use ferrostep_planner::PLANNER_VERSION;

use crate::commands::host::Host;
use crate::error::{CommandError, Failure};
use crate::job::print::JobRequest;
use crate::ports::{Motion, Ports, Replies};
use crate::printer::Printer;
use crate::signals::Signals;

/// Longest silence before the first frame, s: a host that asks for a transfer has its job ready.
const MAX_SILENCE_BEFORE_JOB_S: u16 = 30;

/// Answer to a line that is not executed while a job is being received.
const PLAIN_LINE: &str = "echo:gpre: a prepared job is being received (M790), lines without a number are ignored until \
                          it ends; M112 ends it at once";

/// Maximum number of bytes taken from the line at once.
const CHUNK_BYTES: usize = 64;

/// The line on which a job arrives, together with the lines of all hosts.
pub trait JobLine {
    /// Waits for bytes of any host, at most a fifth of a second. Returns their number, and true if
    /// they are from the host that sends the job. `idle`: the machine has no other work meanwhile.
    fn read(&mut self, bytes: &mut [u8], idle: bool) -> impl Future<Output = (usize, bool)>;

    /// Reads text of the host that was read last, up to the end of a line. Returns the number of
    /// bytes used, and the line if it is complete.
    #[allow(clippy::type_complexity)]
    fn text<'a>(&'a mut self, bytes: &'a [u8]) -> (usize, Option<(&'a mut Host, Result<Line<'a>, LineError>)>);

    /// Sends replies to the job's host from now on.
    fn answer_job(&mut self);
}

/// Reason why a job ended early.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Stop {
    /// The job cannot be read.
    Read(ReadError),
    /// An item of the job cannot be executed.
    Done { failure: Failure, line: u32, frame: u32, offset: u64 },
    /// A move does not begin where the previous one ended.
    Elsewhere { frame: u32, offset: u64 },
    /// The host was silent for too long.
    Silent { silence_s: u16 },
    /// The host gave up.
    Aborted,
    /// M112, or motion was stopped in another way.
    Halted,
}

impl Stop {
    /// Stop for a failed command of this line: motion was stopped, or the command cannot be
    /// executed.
    // Not a call, which would copy the failure onto the stack below all that a line needs.
    #[inline(always)]
    fn of(failure: Failure, line: u32, frame: u32, offset: u64) -> Self {
        match failure {
            Failure::Command(CommandError::Stopped | CommandError::Halted) => Self::Halted,
            failure => Self::Done { failure, line, frame, offset },
        }
    }
}

impl From<ReadError> for Stop {
    fn from(error: ReadError) -> Self {
        Self::Read(error)
    }
}

impl fmt::Display for Stop {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Read(error) => fmt::Display::fmt(error, out),
            Self::Done { failure, line, frame, offset } => {
                write!(out, "frame {frame} at byte {offset}, line {line}: {failure}")
            }
            Self::Elsewhere { frame, offset } => write!(
                out,
                "frame {frame} at byte {offset}: the machine does not stand where the move before ended: home it (G28), then start \
                 the job again"
            ),
            Self::Silent { silence_s } => write!(out, "nothing from the host for {silence_s} s"),
            Self::Aborted => write!(out, "the host has given up"),
            Self::Halted => write!(out, "motion was stopped"),
        }
    }
}

/// Incoming side of the line: the present chunk, and the state of text and frames.
struct Incoming {
    receiver: Receiver,
    chunk: [u8; CHUNK_BYTES],
    /// Start of the unprocessed part of the chunk.
    at: usize,
    end: usize,
    /// True if the chunk is from the host that sends the job.
    of_job: bool,
    /// True if the chunk continues with text, which waits for the printer.
    text: bool,
    /// True while the job's host is in the middle of a text line.
    mid_text: bool,
    aborted: bool,
    /// True if the host must be answered.
    answer: bool,
    /// The limit last reported to the host.
    limit: u32,
    heard_ms: u64,
    /// True once a frame has arrived.
    any_frame: bool,
    /// Number of motion stops when the job began: one more ends the job.
    stops: u32,
}

impl Incoming {
    fn new(size: u32, now_ms: u64, stops: u32) -> Self {
        Self {
            receiver: Receiver::new(size),
            chunk: [0; CHUNK_BYTES],
            at: 0,
            end: 0,
            of_job: true,
            text: false,
            mid_text: false,
            aborted: false,
            answer: true,
            limit: 0,
            heard_ms: now_ms,
            any_frame: false,
            stops,
        }
    }

    /// Reports to the host, if a report is due.
    fn tell(&mut self, replies: &(impl Replies + ?Sized), room: usize) {
        if core::mem::take(&mut self.answer) || self.receiver.has_opened(self.limit, room) {
            let report = self.receiver.report(room);
            let [_, limit] = report.numbers;
            self.limit = limit;
            replies.say(format_args!("{report}"));
        }
    }

    /// Reads and answers until text arrives or the host gives up. With an idle machine it returns
    /// after each portion.
    async fn take_in<R: Replies + ?Sized>(
        &mut self,
        line: &mut impl JobLine,
        room: &mut [u8],
        filled: &mut usize,
        (replies, clock, signals): (&R, &impl Clock, &Signals),
        idle: bool,
    ) {
        while !self.text && !self.aborted {
            if self.at == self.end {
                let (length, of_job) = line.read(&mut self.chunk, idle).await;
                (self.at, self.end, self.of_job) = (0, length, of_job);
                self.text = length > 0 && (!of_job || self.mid_text);
            }
            while !self.text && !self.aborted {
                let Some(byte) = self.chunk.get(self.at).copied().filter(|_| self.at < self.end) else { break };
                match self.receiver.take(byte, room.get_mut(*filled..).unwrap_or_default()) {
                    Event::Nothing => {}
                    Event::Bytes(length) => {
                        *filled += length;
                        self.heard(clock, signals);
                    }
                    Event::Answer => self.heard(clock, signals),
                    Event::Aborted => self.aborted = true,
                    Event::Other => {
                        self.text = true;
                        continue;
                    }
                }
                self.at += 1;
            }
            self.tell(replies, room.len() - *filled);
            if idle {
                return;
            }
        }
    }

    /// Answers an M790 in the middle of a transfer, from a host that was restarted: the transfer
    /// resumes where it stopped.
    fn asked_again(&mut self, request: Option<JobRequest>, replies: &(impl Replies + ?Sized)) {
        match request {
            Some(request) if request.size == self.receiver.size() => self.answer = true,
            Some(_) => replies.say(format_args!("echo:gpre: another job is being received")),
            None => {}
        }
    }

    /// Skips the rest of the chunk up to the next text.
    fn skip_frames(&mut self) {
        while let Some(&byte) = self.chunk.get(self.at..self.end).and_then(|rest| rest.first()) {
            if self.receiver.take(byte, &mut []) == Event::Other {
                self.text = true;
                return;
            }
            self.at += 1;
        }
    }

    fn heard(&mut self, clock: &impl Clock, signals: &Signals) {
        signals.note_host();
        self.heard_ms = clock.now_ms();
        self.any_frame = true;
        self.answer = true;
    }
}

/// Runs one future to its end; another runs beside it and need not end.
async fn beside<T>(main: impl Future<Output = T>, other: impl Future<Output = ()>) -> T {
    let (mut main, mut other) = (pin!(main), pin!(other));
    let mut ended = false;
    poll_fn(|context| {
        let progress = main.as_mut().poll(context);
        if progress.is_pending() && !ended {
            ended = matches!(other.as_mut().poll(context), Poll::Ready(()));
        }
        progress
    })
    .await
}

impl<P: Ports> Printer<'_, P> {
    /// Declares that the caller will call [`Self::receive_job`] when M790 requests it.
    pub fn set_receives_jobs(&mut self) {
        self.identity.receives_jobs = true;
    }

    /// Takes the request for a transfer, if the last command was one.
    pub fn take_job_request(&mut self) -> Option<JobRequest> {
        self.print.job_request.take()
    }

    /// Executes M790.
    pub(crate) fn request_job(&mut self, size: u32, silence_s: u16) -> Result<(), CommandError> {
        if !self.identity.receives_jobs {
            return Err(CommandError::NoJobs);
        }
        self.needs_profiles_steps()?;
        self.print.job_request = Some(JobRequest { size, silence_s });
        Ok(())
    }

    /// Receives a prepared job and executes it as it arrives. `buffer` must have room for the
    /// longest frame ([`ferrostep_gpre::compact::MAX_FRAME_BYTES`]); more room is used for bytes
    /// that arrive meanwhile. Returns the outcome, and true if a frame has begun on the line and
    /// not ended; the outcome has already been reported to the host.
    pub async fn receive_job(
        &mut self,
        request: JobRequest,
        line: &mut impl JobLine,
        buffer: &mut [u8],
    ) -> (Report, bool) {
        let mut incoming = Incoming::new(request.size, self.clock.now_ms(), self.motion.stops());
        let mut progress = Progress { begun: false, frame: 0, offset: 0 };
        self.interpreter.modal.in_prepared_job = true;
        self.motion.set_bounded_in_time(false);
        let outcome = self.play(request, line, buffer, &mut incoming, &mut progress).await;
        self.interpreter.modal.in_prepared_job = false;
        let (replies, clock, signals) = (self.replies(), self.clock.clone(), self.signals);
        incoming.text = false;
        incoming.aborted = false;
        // No more of the job is accepted, but the host is answered while the machine comes to rest.
        let mut none = 0;
        let taken_in = incoming.take_in(line, &mut [], &mut none, (replies, &clock, signals), false);
        let ended = match outcome {
            Ok(()) => {
                let finished = beside(self.finish(), taken_in).await;
                if finished.is_err() {
                    // All of the job had been accepted; the part left undone is counted as after
                    // any other stop.
                    self.stop_motion();
                }
                let Progress { frame, offset, .. } = progress;
                finished.map_err(|error| {
                    Stop::of(Failure::Command(error), self.lines.number, frame.saturating_sub(1), offset)
                })
            }
            Err(stop) => {
                // After a halt no motion is left to end.
                let _ = beside(self.abandon_prepared(), taken_in).await;
                Err(stop)
            }
        };
        // Bytes that have arrived by now.
        while incoming.at < incoming.end {
            let _ = self.between(line, &mut incoming).await;
            incoming.skip_frames();
        }
        self.print.job_request = None;
        let Progress { begun, frame, offset } = progress;
        // Silence ends the frame that was being received: later bytes do not belong to it.
        let in_frame = incoming.receiver.is_in_frame() && !matches!(ended, Err(Stop::Silent { .. }));
        let word = match ended {
            Ok(()) => Word::Done,
            Err(_) if begun => Word::Stopped,
            Err(_) => Word::Refused,
        };
        line.answer_job();
        if let Err(stop) = ended {
            replies.say(format_args!("echo:gpre: {stop}"));
        }
        let place = if word == Word::Done { request.size } else { u32::try_from(offset).unwrap_or(u32::MAX) };
        let report = Report { word, numbers: [place, frame] };
        replies.say(format_args!("{report}"));
        (report, in_frame)
    }

    async fn play(
        &mut self,
        request: JobRequest,
        line: &mut impl JobLine,
        buffer: &mut [u8],
        incoming: &mut Incoming,
        progress: &mut Progress,
    ) -> Result<(), Stop> {
        let (replies, clock, signals) = (self.replies(), self.clock.clone(), self.signals);
        let mut parts = Parts::new();
        let mut filled = 0;
        incoming.tell(replies, buffer.len());
        loop {
            let bytes = buffer.get(..filled).unwrap_or_default();
            let used = match parts.next(bytes, incoming.receiver.is_complete())? {
                Part::End => return Ok(()),
                Part::More => {
                    self.between(line, incoming).await?;
                    incoming.take_in(line, buffer, &mut filled, (replies, &clock, signals), true).await;
                    let silent_ms = self.clock.now_ms().saturating_sub(incoming.heard_ms);
                    let allowed_s = if incoming.any_frame { u16::MAX } else { MAX_SILENCE_BEFORE_JOB_S };
                    let silence_s = request.silence_s.min(allowed_s);
                    if silent_ms > 1000 * u64::from(silence_s) {
                        return Err(Stop::Silent { silence_s });
                    }
                    0
                }
                Part::Passed(length) => length,
                Part::Header(length, header) => {
                    self.begin_prepared(&header).await?;
                    length
                }
                Part::Frame { length, number, offset } => {
                    (progress.frame, progress.offset) = (number, offset);
                    let (frame, room) = buffer.split_at_mut(length);
                    let mut ahead = filled - length;
                    let fault = |fault| Stop::Read(ReadError { fault, offset, frame: Some(number) });
                    let mut items = Frame::read(frame, offset, Some(number))?.items().map_err(fault)?;
                    progress.begun = true;
                    let mut place = Place::new(*items.start(), number, offset);
                    loop {
                        let taken_in = incoming.take_in(line, room, &mut ahead, (replies, &clock, signals), false);
                        if !beside(self.item(&mut items, &mut place), taken_in).await? {
                            break;
                        }
                        self.between(line, incoming).await?;
                    }
                    // While the machine was at work, the host may have had no reason to send or
                    // ask.
                    incoming.heard_ms = self.clock.now_ms();
                    filled = length + ahead;
                    progress.frame = number + 1;
                    progress.offset = offset + length as u64;
                    length
                }
            };
            // Including the received part of an incomplete frame.
            buffer.copy_within(used.., 0);
            filled -= used;
            incoming.tell(replies, buffer.len() - filled);
        }
    }

    /// Begins a prepared job: checks that it is for this machine, and sets the extruder's advance
    /// with which it was planned.
    pub(crate) async fn begin_prepared(&mut self, header: &Header) -> Result<(), Stop> {
        header.matches(self.profile.plan_hash, PLANNER_VERSION)?;
        if header.encoding != Encoding::Compact {
            return Err(Stop::Read(ReadError { fault: Fault::Wide, offset: 10, frame: None }));
        }
        self.end_tower("a prepared job has its own values");
        self.take_advance_of_profile().await.map_err(|error| Stop::of(Failure::Command(error), 0, 0, 0))
    }

    /// Executes the next item; `false` after the last.
    pub(crate) async fn item(&mut self, items: &mut Decoder<'_>, place: &mut Place) -> Result<bool, Stop> {
        let (frame, offset) = (place.number, place.offset);
        let fault = |fault| Stop::Read(ReadError { fault, offset, frame: Some(frame) });
        let Some(item) = items.next_item().map_err(fault)? else { return Ok(false) };
        let (line, result) = match item {
            Item::Move(next) => {
                // At the start of a frame, and wherever M410 may have stopped the previous moves.
                let expected_10nm = place.end_10nm.or((!place.begun).then_some(place.start.position_10nm));
                // If M290 has shifted Z, the move is refused for that reason.
                if expected_10nm.is_some_and(|expected| self.machine_10nm() != expected) && !self.is_shifted() {
                    return Err(Stop::Elsewhere { frame, offset });
                }
                (place.begun, place.end_10nm) = (true, Some(next.target_10nm().map(i64::from)));
                (next.line, self.prepared_move(next, &place.start.modal).await.map_err(Failure::Command))
            }
            Item::Fan { line, power } => (line, self.prepared_fan(line, power).await.map_err(Failure::Command)),
            Item::Command { line, text } => {
                place.end_10nm = None;
                (line, self.prepared_command(line, text).await)
            }
        };
        result.map(|()| true).map_err(|failure| Stop::of(failure, line, frame, offset))
    }

    /// Handles text between the frames.
    async fn between(&mut self, line: &mut impl JobLine, incoming: &mut Incoming) -> Result<(), Stop> {
        while incoming.text {
            let rest = incoming.chunk.get(incoming.at..incoming.end).unwrap_or_default();
            // A frame may follow a line end.
            let line_end = rest.iter().position(|byte| matches!(byte, b'\n' | b'\r'));
            let length = line_end.map_or(rest.len(), |end| end + 1);
            let (used, heard) = line.text(rest.get(..length).unwrap_or_default());
            if let Some((host, heard)) = heard {
                let numbered = match &heard {
                    Ok(heard) => heard.number.is_some(),
                    Err(error) => error.is_numbered(),
                };
                // The rest of a broken frame is not a line, and usually not text. A line number
                // shows that a line may be executed.
                if numbered || !incoming.of_job {
                    host.answer(self, heard).await;
                    if incoming.of_job {
                        incoming.heard_ms = self.clock.now_ms();
                    }
                    incoming.asked_again(self.print.job_request.take(), self.replies());
                } else if heard.is_ok() {
                    // Probably sent by a person, who must not wait for an answer until the job has
                    // ended.
                    let replies = self.replies();
                    replies.send(Reply::Text(PLAIN_LINE));
                    replies.send(Reply::Ok);
                }
            }
            incoming.at += used.clamp(1, length.max(1));
            let ends_line = line_end.is_some() && used >= length;
            incoming.mid_text = incoming.of_job && !ends_line;
            incoming.text = incoming.at < incoming.end && !(incoming.of_job && ends_line);
        }
        line.answer_job();
        if incoming.aborted {
            return Err(Stop::Aborted);
        }
        if self.signals.is_halted() || self.motion.stops() != incoming.stops { Err(Stop::Halted) } else { Ok(()) }
    }
}

/// Progress of a job.
struct Progress {
    /// True once part of the job was executed.
    begun: bool,
    frame: u32,
    offset: u64,
}

/// Place of an item in the job.
pub(crate) struct Place {
    start: FrameState,
    /// True once a move of the frame was executed.
    begun: bool,
    /// End of the previous move, if only moves have followed since.
    end_10nm: Option<[i64; 3]>,
    number: u32,
    offset: u64,
}

impl Place {
    /// Place at the start of a frame.
    pub(crate) fn new(start: FrameState, number: u32, offset: u64) -> Self {
        Self { start, begun: false, end_10nm: None, number, offset }
    }
}
