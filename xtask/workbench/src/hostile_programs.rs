//! Prints programs that no slicer writes and counts every motor's steps at every move's end.
//!
//! ```text
//! cargo xtask hostile-programs [--programs 10000] [--moves 1000] [--first 0]
//! ```
//!
//! Exit status 0 if every motor is where it must be at every end. The count uses the text, the
//! profile and the trace, and shares no code with the planner ([`ferrostep_oracle::trace_ends`]).

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;

use ferrostep_oracle::reference::ReferenceProfile;
use ferrostep_oracle::trace_ends::{Ends, count_ends};
use ferrostep_planner::StepObserver;
use ferrostep_session::job::{self, JobProgress};
use ferrostep_session::record::Observer;
use ferrostep_session::{JobReplies, Session};
use ferrostep_testkit::hostile::Hostile;
use indicatif::ProgressBar;

/// The trace's records, in memory.
struct Records(Vec<u8>);

impl Records {
    fn push(&mut self, tick: u64, rest: [u8; 4]) {
        self.0.extend(tick.to_le_bytes());
        self.0.extend(rest);
    }
}

impl StepObserver for Records {
    fn stepped(&mut self, tick: u64, axes: u8, directions: u8) {
        self.push(tick, [0, axes, directions, 0]);
    }
}

impl Observer for Records {
    fn redefined(&mut self, tick: u64, motor_steps: [i64; 4]) {
        self.push(tick, [1, 0, 0, 0]);
        for steps in motor_steps {
            // No profile has a motor that goes further.
            self.0.extend(i32::try_from(steps).unwrap_or(i32::MAX).to_le_bytes());
        }
    }

    fn move_ended(&mut self, tick: u64, line: u32) {
        self.push(tick, [2, 0, 0, 0]);
        self.0.extend(line.to_le_bytes());
    }
}

/// Prints a program. Returns the ends of its moves, or the reason for which it stopped.
fn print(program: &Hostile) -> Result<Ends, String> {
    let profile = ferrostep_profiles::parse(&program.profile, "hostile").map_err(|error| error.to_string())?;
    let reference = ReferenceProfile::from_toml(&program.profile).map_err(|error| error.to_string())?;
    let kinematics = reference.kinematics.names();
    let header = serde_json::json!({
        "format": "ferrostep-trace", "version": 1, "tick_hz": ferrostep_planner::TICKS_PER_SECOND,
        "axes": kinematics.1, "kinematics": kinematics.0,
        "steps_per_mm": profile.steps_per_mm.map(|steps| steps.to_f64()),
    });
    let records = Records(format!("{header}\n").into_bytes());
    let replies = JobReplies::new(|_: &str| {});
    let session = Session::print(profile, program.look_ahead, records, replies);
    let outcome = {
        let mut printer = session.printer();
        session.run(job::run(&mut program.text.as_bytes(), &mut printer, &mut JobProgress::default(), |_| {}))
    };
    outcome.map_err(|error| error.to_string())?;
    let trace = session.into_observer().0;
    count_ends(&trace[..], program.text.as_bytes(), &reference).map_err(|error| error.to_string())
}

/// Arguments of `hostile-programs`.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct Options {
    /// Number of programs
    #[arg(long, default_value_t = 10_000)]
    programs: u64,
    /// Moves of each
    #[arg(long, default_value_t = 1_000)]
    moves: u64,
    /// The first one's seed
    #[arg(long, default_value_t = 0)]
    first: u64,
}

/// Prints programs; returns true if every motor was where it must be at every end.
pub fn run(options: &Options) -> bool {
    let Options { programs, moves, first } = *options;
    let (next, bar) = (AtomicU64::new(first), ProgressBar::new(programs));
    let (total, failures) = (Mutex::new(Ends::default()), Mutex::new(Vec::new()));
    let workers = thread::available_parallelism().map_or(1, usize::from);
    thread::scope(|scope| {
        for _ in 0..workers {
            scope.spawn(|| {
                loop {
                    let seed = next.fetch_add(1, Ordering::Relaxed);
                    if seed >= first + programs {
                        break;
                    }
                    let outcome = print(&Hostile::new(seed, moves as usize));
                    if !matches!(outcome, Ok(Ends { wrong: 0, .. })) {
                        failures
                            .lock()
                            .unwrap_or_else(PoisonError::into_inner)
                            .push(format!("program {seed}: {outcome:?}"));
                    }
                    if let Ok(ends) = outcome {
                        let mut total = total.lock().unwrap_or_else(PoisonError::into_inner);
                        (total.moves, total.wrong) = (total.moves + ends.moves, total.wrong + ends.wrong);
                    }
                    bar.inc(1);
                }
            });
        }
    });
    bar.finish_and_clear();
    let total = total.into_inner().unwrap_or_else(PoisonError::into_inner);
    let failures = failures.into_inner().unwrap_or_else(PoisonError::into_inner);
    failures.iter().take(20).for_each(|failure| println!("{failure}"));
    println!(
        "{programs} programs, {} ends of moves, {} wrong, {} programs failed",
        total.moves,
        total.wrong,
        failures.len()
    );
    failures.is_empty()
}
