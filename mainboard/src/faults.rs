//! Faults from outside: the printer is brought into each of its states, something fails at a random instant, and what comes of
//! it is held against what the documentation promises.
//!
//! | what | where |
//! |---|---|
//! | the states, and a run through all of them that takes snapshots | [`state`] |
//! | faults by name, with their shares | [`fault`] |
//! | how each is made to happen | [`inject`] |
//! | what is promised for each, and within which time | [`promise`] |
//! | when a run's verdict is certain, and what it is | [`verdict`] |
//! | a matrix of fault and state, as text, CSV and JSON | [`matrix`] |
//!
//! A run is drawn by its seed alone: fault, state, instant within the state, and what exactly fails. So each can be done again.
//!
//! Left out: a thermistor half out of its hole (no promise, and minutes of time for each); the NMI of a crystal that stops, which
//! the emulator does not raise; a hang of the idle loop; two faults at once (but for what a fault brings with it); noise on pins that is not an edge; faults of the card;
//! slow wear. The host's line is the serial one.

pub mod command;
pub mod fault;
pub mod host_side;
pub mod image;
pub mod inject;
pub mod matrix;
pub mod promise;
pub mod state;
pub mod verdict;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use rigless::emulator::Host;

use crate::machine::Machine;
use crate::parts::random::Random;
use crate::run::{self, Operator, Turn};
use crate::wiring::{Board, Printer};
use fault::Fault;
use host_side::HostSide;
use inject::Injection;
use state::{Place, State};
use verdict::{Limits, Outcome, Watch};

/// The seed of the machine's own noise: all runs begin with the same machine.
const MACHINE_SEED: u64 = 1;
/// A fault must come and be judged within this, ns.
const LIMIT_NS: u64 = 400_000_000_000;

/// A board, its printer and its image: what all runs share.
#[derive(Debug)]
pub struct Bench {
    board: Board,
    printer: Printer,
    /// The image that runs.
    pub images: [rigless::image::Image; 1],
    /// Where the core boots.
    pub boot: Option<u64>,
    /// What is printed.
    pub job: String,
    layout: image::Layout,
    limits: Limits,
}

impl Bench {
    /// From the repository's root: `boards/NAME.toml`, its profile, `target/images/NAME/ferrostep.elf` and the cube.
    ///
    /// # Errors
    /// A file is missing or wrong; the error says which.
    pub fn new(root: &Path, name: &str) -> Result<Self, String> {
        let board = Board::read(&root.join(format!("boards/{name}.toml"))).map_err(|error| error.to_string())?;
        let profile = root.join(format!("profiles/{}.toml", board.profile));
        let printer = Printer::read(&profile).map_err(|error| error.to_string())?;
        let elf = root.join(format!("target/images/{name}/ferrostep.elf"));
        let shown = elf.display();
        let read = |path: PathBuf| std::fs::read(&path).map_err(|error| format!("{}: {error}", path.display()));
        let layout = image::Layout::read(&board, &read(elf.clone())?)?;
        let image = rigless::image::Image::read(&elf, None).map_err(|error| format!("{shown}: {error}"))?;
        let job = read(root.join("examples/cube.gcode"))?;
        let limits = Limits {
            max_celsius: [printer.nozzle.max_celsius, printer.bed.as_ref().map_or(0.0, |bed| bed.max_celsius)],
            per_step_256: std::array::from_fn(|motor| {
                256 / i64::from(printer.drivers[motor].map_or(16, |driver| driver.microsteps)).max(1)
            }),
        };
        Ok(Self {
            boot: Some(0x0800_0000 + u64::from(board.boot_offset)),
            images: [image],
            job: String::from_utf8_lossy(&job).into_owned(),
            layout,
            limits,
            board,
            printer,
        })
    }

    /// The machine as it is before power-on.
    ///
    /// # Errors
    /// The board's file and the profile make no machine together.
    pub fn machine(&self) -> Result<Machine, String> {
        Machine::new(&self.board, &self.printer, MACHINE_SEED)
    }
}

/// Which runs to do.
#[derive(Debug, Clone, Copy)]
pub struct Wanted {
    /// This fault alone.
    pub only: Option<Fault>,
    /// This state alone.
    pub state: Option<State>,
}

/// Many runs.
#[derive(Debug, Clone, Copy)]
pub struct Runs {
    /// How many.
    pub count: usize,
    /// Draws their seeds.
    pub seed: u64,
    /// On this many threads.
    pub threads: usize,
    /// Which.
    pub wanted: Wanted,
    /// None begins after this.
    pub until: Option<Instant>,
}

/// Who makes the fault happen, plays the host and watches.
struct Culprit<'a> {
    side: HostSide,
    injection: Injection,
    watch: Option<Watch>,
    place: &'a Place,
    bench: &'a Bench,
    now_ns: u64,
}

/// An operator must own what it has: shared things are put on the heap for as long as the program runs.
struct Owned(Culprit<'static>);

impl Operator for Owned {
    fn turn(&mut self, machine: &mut Machine, now_ns: u64, host: &mut dyn Host) -> Turn {
        let culprit = &mut self.0;
        culprit.now_ns = now_ns;
        culprit.side.turn(machine, now_ns);
        let was_done = culprit.injection.is_done();
        if !was_done && now_ns >= culprit.injection.at_ns {
            // Whether motors have current is asked before the fault takes it away.
            let powered: Vec<bool> = machine.plant.drivers.iter().map(|driver| driver.energized()).collect();
            let before = Watch::new(
                culprit.injection.fault,
                promise::promise(culprit.injection.fault, culprit.place.state, false),
                culprit.place,
                &culprit.bench.limits,
                machine,
                now_ns,
            );
            culprit.injection.turn(machine, &mut culprit.side, &culprit.bench.layout, now_ns, host);
            if culprit.injection.without {
                return Turn::Stop;
            }
            let concerned = match culprit.injection.motor {
                Some(motor) => powered.get(motor).copied().unwrap_or(false),
                None => powered.iter().any(|on| *on),
            };
            let promise = promise::promise(culprit.injection.fault, culprit.place.state, concerned);
            culprit.watch = Some(before.with(promise));
            return Turn::GoOn;
        }
        culprit.injection.turn(machine, &mut culprit.side, &culprit.bench.layout, now_ns, host);
        let certain = culprit.watch.as_mut().is_some_and(|watch| watch.turn(machine, &culprit.side, now_ns));
        if certain || now_ns > culprit.place.at_ns + LIMIT_NS { Turn::Stop } else { Turn::GoOn }
    }

    fn next_turn_ns(&self) -> Option<u64> {
        self.0.injection.next_ns()
    }
}

/// A campaign: a bench and the places where its runs begin.
#[derive(Debug)]
pub struct Campaign {
    bench: &'static Bench,
    places: &'static [Place],
}

impl Campaign {
    /// Leads the printer through all states once. What it keeps stays until the program ends.
    ///
    /// # Errors
    /// The printer does not get through all its states.
    pub fn new(bench: Bench) -> Result<Self, String> {
        let bench: &'static Bench = Box::leak(Box::new(bench));
        let places = state::places(bench, &std::env::temp_dir())?;
        Ok(Self { bench, places: Box::leak(places.into_boxed_slice()) })
    }

    /// A run, which its seed draws but for what is wanted.
    #[must_use]
    pub fn run(&self, seed: u64, wanted: Wanted) -> Outcome {
        let mut random = Random::new(seed);
        let (fault_draw, state_draw) = (random.unit(), random.unit());
        let fault = wanted.only.unwrap_or_else(|| drawn_fault(fault_draw));
        let last = State::ALL.len() as f64;
        let state = wanted.state.unwrap_or(State::ALL[((state_draw * last) as usize).min(State::ALL.len() - 1)]);
        let places: Vec<&'static Place> = self.places.iter().filter(|place| place.state == state).collect();
        let place = places[random.between(0, places.len() as u64 - 1) as usize];
        let at_ns = place.at_ns + random.between(0, state.window_ns());
        let run = || self.run_at(place, Injection::new(fault, at_ns, random.clone()), seed);
        let failed = match catch_unwind(AssertUnwindSafe(run)) {
            Ok(Ok(outcome)) => return outcome,
            Ok(Err(error)) => format!("the emulator gives up: {error}"),
            Err(panic) => {
                let text = panic.downcast_ref::<String>().map(String::as_str);
                let text = text.or_else(|| panic.downcast_ref::<&str>().copied());
                format!("the emulator panics: {}", text.unwrap_or("no message"))
            }
        };
        Outcome { violations: vec![failed], ..nothing(fault, state, seed, at_ns) }
    }

    fn run_at(&self, place: &'static Place, injection: Injection, seed: u64) -> Result<Outcome, String> {
        let (fault, at_ns) = (injection.fault, injection.at_ns);
        let culprit =
            Culprit { side: place.host.clone(), injection, watch: None, place, bench: self.bench, now_ns: place.at_ns };
        let machine = self.bench.machine()?;
        let finished = run::run_from(&place.snapshot, machine, &self.bench.images, self.bench.boot, Owned(culprit))?;
        let culprit = &finished.operator.0;
        let Some(watch) = &culprit.watch else {
            return Ok(Outcome { without: true, ..nothing(fault, place.state, seed, at_ns) });
        };
        let (side, detail, resets) = (&culprit.side, &culprit.injection.detail, &finished.report.resets);
        Ok(watch.outcome(finished.machine(), side, seed, detail, resets, culprit.now_ns))
    }

    /// Many runs; the outcomes in the order of their seeds. `progress` hears of each as it ends.
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

fn nothing(fault: Fault, state: State, seed: u64, at_ns: u64) -> Outcome {
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
