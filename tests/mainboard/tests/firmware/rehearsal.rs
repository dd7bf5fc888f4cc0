//! The same job on the desk, and its comparison with the pins.

use ferrostep_mainboard::decode::{Rules, TraceStep, compare};
use ferrostep_planner::{StepObserver, TICKS_PER_SECOND};
use ferrostep_session::desk::{Figures, LOOK_AHEAD_BLOCKS};
use ferrostep_session::job::{self, JobProgress};
use ferrostep_session::record::Observer;
use ferrostep_session::{JobReplies, Session};

use crate::firmware::job::Job;
use crate::firmware::pins::{PinEvent, PinLog};

/// The desk's result of a job.
pub struct Rehearsal {
    /// Counts and digests.
    pub figures: Figures,
    events: Vec<PinEvent>,
    /// Tick of each event.
    ticks: Vec<u64>,
    /// Number of the source line of each event; 0 = homing.
    lines: Vec<u32>,
    /// Number of events up to the end of the last homing.
    homed: usize,
}

/// Bound of how late a step may be on the pins, against the earliest of its motion.
const LATENESS: Rules = Rules { latency_bound_ns: 1_000, ..Rules::USUAL };

impl Rehearsal {
    /// Prints a job on the virtual board.
    pub fn of(job: &Job) -> Self {
        Self::with(job, "cartesian", LOOK_AHEAD_BLOCKS)
    }

    /// Prints a job with the largest look-ahead.
    pub fn far_ahead(job: &Job) -> Self {
        Self::with(job, "cartesian", 65_536)
    }

    /// Prints a job with another profile.
    pub fn on(profile: &str, job: &Job) -> Self {
        Self::with(job, profile, LOOK_AHEAD_BLOCKS)
    }

    fn with(job: &Job, profile: &str, look_ahead: usize) -> Self {
        let profile = ferrostep_profiles::load(profile).unwrap();
        let replies = JobReplies::new(|_: &str| {});
        let session = Session::print(profile, look_ahead, Watcher::default(), replies);
        let mut printer = session.printer();
        let text = job.text();
        let mut progress = JobProgress::default();
        session.run(job::run(&mut text.as_bytes(), &mut printer, &mut progress, |_| {})).unwrap();
        let figures = session.figures();
        let mut watcher = session.into_observer();
        watcher.lines.resize(watcher.events.len(), 0);
        let Watcher { events, ticks, lines, homed } = watcher;
        Self { figures, events, ticks, lines, homed }
    }

    /// The events of all lines after this one.
    pub fn events_after(&self, line: u32) -> &[PinEvent] {
        let first = self.lines.iter().rposition(|of| *of <= line).map_or(0, |last| last + 1);
        &self.events[first..]
    }

    /// The number of step events.
    pub fn event_count(&self) -> usize {
        self.events.len()
    }

    /// Each motor's position, counted like [`PinLog::displacement`].
    pub fn displacement(&self) -> [i64; 4] {
        let mut displacement = [0; 4];
        for event in &self.events {
            for (motor, steps) in displacement.iter_mut().enumerate() {
                let forwards = (event.axes & !event.directions) >> motor & 1;
                let backwards = (event.axes & event.directions) >> motor & 1;
                *steps += i64::from(forwards) - i64::from(backwards);
            }
        }
        displacement
    }

    /// Fails at the first difference unless the pins made exactly the rehearsal's events.
    pub fn assert_same_events(&self, job: &Job, pins: &PinLog) {
        self.assert_begins_with(job, pins);
        let (rehearsed, seen) = (self.events.len(), pins.events().len());
        if seen < rehearsed {
            panic!(
                "the image stopped after {seen} of {rehearsed} step events, before {:?} of {}",
                self.events[seen],
                job.source(self.lines[seen] as usize)
            );
        }
    }

    /// Fails at the first difference unless the pins end with exactly the rehearsal's events after
    /// homing, none of them late.
    pub fn assert_same_events_after_homing(&self, job: &Job, pins: &PinLog) {
        let steps = self.events.iter().zip(&self.ticks).zip(&self.lines).skip(self.homed);
        let desk: Vec<_> = steps
            .map(|((event, tick), line)| TraceStep {
                tick: *tick,
                axes: event.axes,
                directions: event.directions,
                line: *line,
            })
            .collect();
        let compared = compare(pins.last(desk.len()), &desk, u64::from(TICKS_PER_SECOND), &LATENESS);
        eprintln!("{} events after {} of homing, latest {} us", desk.len(), self.homed, compared.largest_latency_us());
        if let Some(difference) = compared.difference {
            let line = difference.desk.map_or(0, |step| step.line);
            panic!("after homing: {difference}; {}", job.source(line as usize));
        }
        assert!(self.homed > 0 && desk.len() > 1000, "{} events after {} of homing", desk.len(), self.homed);
        assert!(compared.agrees(), "{:?}; {} in all", compared.first_too_late, compared.too_late);
    }

    /// Fails at the first difference unless the rehearsal begins with the pins' events.
    pub fn assert_begins_with(&self, job: &Job, pins: &PinLog) {
        for (index, seen) in pins.events().iter().enumerate() {
            let Some(rehearsed) = self.events.get(index) else {
                panic!("the image makes {} events more than the desk's {index}", pins.events().len() - index);
            };
            let source = || job.source(self.lines[index] as usize);
            assert_eq!(seen, rehearsed, "step event {index} differs (left: the image, right: the desk); {}", source());
        }
    }
}

/// Records all events with their source lines.
#[derive(Default)]
struct Watcher {
    events: Vec<PinEvent>,
    ticks: Vec<u64>,
    lines: Vec<u32>,
    homed: usize,
}

impl StepObserver for Watcher {
    fn stepped(&mut self, tick: u64, axes: u8, directions: u8) {
        self.ticks.push(tick);
        self.events.push(PinEvent { axes, directions });
    }
}

impl Observer for Watcher {
    fn redefined(&mut self, _tick: u64, _motor_steps: [i64; 4]) {
        // The end stop ended the seek, so its end is not reported.
        self.lines.resize(self.events.len(), 0);
        self.homed = self.events.len();
    }

    fn move_ended(&mut self, _tick: u64, line: u32) {
        self.lines.resize(self.events.len(), line);
    }
}

/// The log of an image that makes the rehearsal's events after `change`.
fn log_of(rehearsal: &Rehearsal, change: impl FnOnce(&mut Vec<PinEvent>)) -> PinLog {
    let mut events = rehearsal.events.clone();
    change(&mut events);
    PinLog::new(events, false)
}

/// A short job, and an event in its last move.
fn short() -> (Job, Rehearsal, usize) {
    let job = Job::cube(44).without_heating();
    let rehearsal = Rehearsal::of(&job);
    let last = rehearsal.event_count() - 1;
    (job, rehearsal, last)
}

#[test]
fn equal_events_agree() {
    let (job, rehearsal, _) = short();
    let log = log_of(&rehearsal, |_| {});
    rehearsal.assert_same_events(&job, &log);
    assert_eq!(log.order_digest(), rehearsal.figures.digests.order);
    assert_eq!((log.issued(), log.displacement()), (rehearsal.figures.motor_steps, rehearsal.displacement()));
}

#[test]
#[should_panic(expected = "of examples/cube.gcode: G1 X110 Y85.643 E1.48541")]
fn a_wrong_direction_is_reported_with_its_line() {
    let (job, rehearsal, last) = short();
    rehearsal.assert_same_events(&job, &log_of(&rehearsal, |events| events[last].directions ^= events[last].axes));
}

#[test]
#[should_panic(expected = "the image stopped after")]
fn a_missing_step_is_reported() {
    let (job, rehearsal, last) = short();
    rehearsal.assert_same_events(&job, &log_of(&rehearsal, |events| events.truncate(last)));
}

#[test]
#[should_panic(expected = "the image makes 1 events more")]
fn an_extra_step_is_reported() {
    let (job, rehearsal, last) = short();
    rehearsal.assert_same_events(&job, &log_of(&rehearsal, |events| events.push(events[last])));
}
