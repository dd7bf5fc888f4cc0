//! Runs with faults, each drawn by its seed.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use rigless::emulator::Host;

use super::bench::Bench;
use super::fault::{self, Fault};
use super::host_side::HostSide;
use super::inject::Injection;
use super::promise::promise;
use super::state::{StartingPoint, State, starting_points};
use super::verdict::{Outcome, Watch};
use crate::machine::Machine;
use crate::parts::random::Random;
use crate::run::{self, Operator, Turn};

/// Virtual time after a run's start within which its fault must happen and be judged, ns.
const LIMIT_NS: u64 = 400_000_000_000;

/// A selection of runs.
#[derive(Debug, Clone, Copy)]
pub struct Wanted {
    /// The only fault to try; `None`: all.
    pub only: Option<Fault>,
    /// The only state to try; `None`: all.
    pub state: Option<State>,
}

/// A series of runs.
#[derive(Debug, Clone, Copy)]
pub struct Runs {
    /// Number of runs.
    pub count: usize,
    /// The seed that draws the seeds of the runs.
    pub seed: u64,
    /// Number of threads.
    pub threads: usize,
    /// The selection.
    pub wanted: Wanted,
    /// No run starts after this instant.
    pub until: Option<Instant>,
}

/// The operator of a run: makes the fault happen, plays the host and watches. An operator owns its
/// data, so bench and starting point are leaked.
struct FaultRun {
    side: HostSide,
    injection: Injection,
    watch: Option<Watch>,
    start: &'static StartingPoint,
    bench: &'static Bench,
    now_ns: u64,
}

impl Operator for FaultRun {
    fn turn(&mut self, machine: &mut Machine, now_ns: u64, host: &mut dyn Host) -> Turn {
        self.now_ns = now_ns;
        self.side.turn(machine, now_ns);
        let was_done = self.injection.is_done();
        if !was_done && now_ns >= self.injection.at_ns {
            // Read before the fault switches motors off.
            let powered: Vec<bool> = machine.plant.drivers.iter().map(|driver| driver.energized()).collect();
            let before = Watch::new(
                self.injection.fault,
                promise(self.injection.fault, self.start.state, false),
                self.start,
                &self.bench.limits,
                machine,
                now_ns,
            );
            self.injection.turn(machine, &mut self.side, &self.bench.layout, now_ns, host);
            if self.injection.without {
                return Turn::Stop;
            }
            let concerned = match self.injection.motor {
                Some(motor) => powered.get(motor).copied().unwrap_or(false),
                None => powered.iter().any(|on| *on),
            };
            let promise = promise(self.injection.fault, self.start.state, concerned);
            self.watch = Some(before.with(promise));
            return Turn::Continue;
        }
        self.injection.turn(machine, &mut self.side, &self.bench.layout, now_ns, host);
        let certain = self.watch.as_mut().is_some_and(|watch| watch.turn(machine, &self.side, now_ns));
        if certain || now_ns > self.start.at_ns + LIMIT_NS { Turn::Stop } else { Turn::Continue }
    }

    fn next_turn_ns(&self) -> Option<u64> {
        self.injection.next_ns()
    }
}

/// A campaign: a bench and the starting points of its runs.
#[derive(Debug)]
pub struct Campaign {
    bench: &'static Bench,
    starts: &'static [StartingPoint],
}

impl Campaign {
    /// Leads the printer through all states once. Bench and starting points are leaked: they live
    /// until the program ends.
    ///
    /// # Errors
    /// The printer does not reach all states.
    pub fn new(bench: Bench) -> Result<Self, String> {
        let bench: &'static Bench = Box::leak(Box::new(bench));
        let starts = starting_points(bench, &std::env::temp_dir())?;
        Ok(Self { bench, starts: Box::leak(starts.into_boxed_slice()) })
    }

    /// Executes a run; the seed draws everything that the selection leaves open.
    #[must_use]
    pub fn run(&self, seed: u64, wanted: Wanted) -> Outcome {
        let mut random = Random::new(seed);
        let (fault_draw, state_draw) = (random.unit(), random.unit());
        let fault = wanted.only.unwrap_or_else(|| drawn_fault(fault_draw));
        let last = State::ALL.len() as f64;
        let state = wanted.state.unwrap_or(State::ALL[((state_draw * last) as usize).min(State::ALL.len() - 1)]);
        let starts: Vec<&'static StartingPoint> = self.starts.iter().filter(|start| start.state == state).collect();
        let start = starts[random.between(0, starts.len() as u64 - 1) as usize];
        let at_ns = start.at_ns + random.between(0, state.window_ns());
        let run = || self.run_at(start, Injection::new(fault, at_ns, random.clone()), seed);
        let failed = match catch_unwind(AssertUnwindSafe(run)) {
            Ok(Ok(outcome)) => return outcome,
            Ok(Err(error)) => format!("the emulator failed: {error}"),
            Err(panic) => {
                let text = panic.downcast_ref::<String>().map(String::as_str);
                let text = text.or_else(|| panic.downcast_ref::<&str>().copied());
                format!("the emulator panicked: {}", text.unwrap_or("no message"))
            }
        };
        Outcome { violations: vec![failed], ..empty_outcome(fault, state, seed, at_ns) }
    }

    fn run_at(&self, start: &'static StartingPoint, injection: Injection, seed: u64) -> Result<Outcome, String> {
        let (fault, at_ns) = (injection.fault, injection.at_ns);
        let operator = FaultRun {
            side: start.host.clone(),
            injection,
            watch: None,
            start,
            bench: self.bench,
            now_ns: start.at_ns,
        };
        let machine = self.bench.machine()?;
        let finished = run::run_from(&start.snapshot, machine, &self.bench.images, self.bench.boot, operator)?;
        let operator = &finished.operator;
        let Some(watch) = &operator.watch else {
            return Ok(Outcome { without: true, ..empty_outcome(fault, start.state, seed, at_ns) });
        };
        let (side, detail, resets) = (&operator.side, &operator.injection.detail, &finished.report.resets);
        Ok(watch.outcome(finished.machine(), side, seed, detail, resets, operator.now_ns))
    }

    /// Executes a series of runs and returns the outcomes in the order of their seeds; calls
    /// `progress` after each run.
    pub fn runs(&self, runs: Runs, progress: impl Fn(usize, &Outcome) + Sync) -> Vec<Outcome> {
        let Runs { count, seed, threads, wanted, until } = runs;
        let mut random = Random::new(seed);
        let seeds: Vec<u64> = (0..count).map(|_| random.bits() >> 16).collect();
        let next = AtomicUsize::new(0);
        let outcomes: Mutex<Vec<(usize, Outcome)>> = Mutex::new(Vec::with_capacity(count));
        std::thread::scope(|scope| {
            for _ in 0..threads.max(1) {
                scope.spawn(|| {
                    loop {
                        let index = next.fetch_add(1, Ordering::Relaxed);
                        let Some(seed) = seeds.get(index) else { break };
                        if until.is_some_and(|until| Instant::now() >= until) {
                            break;
                        }
                        let outcome = self.run(*seed, wanted);
                        progress(index, &outcome);
                        if let Ok(mut outcomes) = outcomes.lock() {
                            outcomes.push((index, outcome));
                        }
                    }
                });
            }
        });
        let mut outcomes = outcomes.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
        outcomes.sort_by_key(|(index, _)| *index);
        outcomes.into_iter().map(|(_, outcome)| outcome).collect()
    }
}

fn drawn_fault(draw: f64) -> Fault {
    let sum: u32 = fault::ALL.iter().map(|(.., share)| share).sum();
    let mut left = draw * f64::from(sum);
    for (_, fault, share) in fault::ALL {
        left -= f64::from(share);
        if left < 0.0 {
            return fault;
        }
    }
    Fault::Control
}

fn empty_outcome(fault: Fault, state: State, seed: u64, at_ns: u64) -> Outcome {
    Outcome {
        fault: fault.name(),
        state,
        seed,
        at_s: at_ns as f64 / 1e9,
        detail: String::new(),
        without: false,
        heaters_off_ms: None,
        was_hot: state.is_hot(),
        host_read: "-".to_owned(),
        resets: Vec::new(),
        heard: Vec::new(),
        hottest_celsius: [0.0; 2],
        watched_s: 0.0,
        violations: Vec::new(),
    }
}
