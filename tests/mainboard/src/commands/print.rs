//! Prints a file on the machine and compares its pins with the desk's trace.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;
use rigless::emulator::Host;
use rigless::soc::Width;
use serde::Serialize;

use super::setup::{Setup, Via, receive, send, unsent};
use crate::decode::{Comparison, Rules, Trace, compare};
use crate::host::usb::State;
use crate::host::{self, Stream};
use crate::machine::Machine;
use crate::run::{Finished, Operator, Turn, run};

/// Options of the command.
#[derive(Debug, Args)]
pub struct Print {
    #[command(flatten)]
    setup: Setup,
    /// G-code.
    file: PathBuf,
    /// The line of the host.
    #[arg(long, value_enum, default_value_t = Via::Usb)]
    via: Via,
    /// The desk's trace of the same file (`ferrostep print --trace`), to compare with the pins.
    #[arg(long, value_name = "TRACE")]
    desk_trace: Option<PathBuf>,
    /// Let the firmware measure its step interrupt and its planning in cycles of the
    /// chip's counter (M798).
    #[arg(long)]
    measure: bool,
    /// Stop the job after this much virtual time, s.
    #[arg(long, default_value_t = 36_000)]
    at_most_s: u64,
    /// Print one JSON object on standard output.
    #[arg(long)]
    json: bool,
}

/// The host: prints the file and waits until motion has ended.
struct Job {
    stream: Stream,
    via: Via,
    plugged: bool,
    ends_ns: u64,
    quiet: bool,
    next_progress_ns: u64,
    stack_top: u32,
    stack_bytes: Option<u64>,
}

/// The start of RAM, which the stack grows down to (RM0090 2.3.1).
const RAM: u64 = 0x2000_0000;

/// The deepest use of the stack: RAM is zero before the start, and pushed words stay.
fn deepest_stack(host: &mut dyn Host, stack_top: u32) -> Option<u64> {
    let untouched = |word: &u64| host.read(*word, Width::W32).is_ok_and(|value| value == 0);
    let mut words = (RAM..u64::from(stack_top)).step_by(4).skip_while(untouched);
    words.next().map(|word| u64::from(stack_top) - word)
}

/// Virtual time between two lines of progress, ns.
const PROGRESS_NS: u64 = 30_000_000_000;

impl Operator for Job {
    fn turn(&mut self, machine: &mut Machine, now_ns: u64, host: &mut dyn Host) -> Turn {
        if self.via == Via::Usb && !self.plugged {
            self.plugged = true;
            machine.usb_host.plug();
        }
        let heard = receive(machine, self.via);
        if !heard.is_empty() {
            self.stream.received(now_ns, &heard);
        }
        let open = self.via == Via::Uart || machine.usb_host.state() == State::Open;
        while open && unsent(machine, self.via) == 0 {
            let Some(bytes) = self.stream.to_send(now_ns) else { break };
            send(machine, self.via, now_ns, &bytes);
        }
        if !self.quiet && now_ns >= self.next_progress_ns {
            self.next_progress_ns = now_ns + PROGRESS_NS;
            eprintln!("{:6.0} s: {} of {} lines", now_ns as f64 / 1e9, self.stream.acknowledged(), self.stream.lines());
        }
        if self.stream.finished() || now_ns >= self.ends_ns || self.stream.was_reset() {
            self.stack_bytes = deepest_stack(host, self.stack_top);
            return Turn::Stop;
        }
        Turn::Continue
    }
}

/// The result of a print.
#[derive(Debug, Serialize)]
pub struct Outcome {
    /// The board's name.
    pub board: String,
    /// SHA-256 of the image.
    pub image_sha256: String,
    /// The error or limit that stopped the job, if any.
    pub stopped: Option<String>,
    /// Digest of the order of steps from the pins' edges: of the steps after the last homing in the
    /// desk's trace, or of all steps without a trace.
    pub pin_order_digest: String,
    /// The same digest of the desk's trace.
    pub desk_order_digest: Option<String>,
    /// True if every step of the desk appeared on the pins, in its order, and none later than the
    /// bound; `None` without a trace.
    pub agrees: Option<bool>,
    /// The first difference, or the latest step, in words.
    pub difference: Option<String>,
    /// Number of compared steps.
    pub events: usize,
    /// Number of compared continuous runs of motion.
    pub runs: usize,
    /// Shortest high or low time of a step signal, us.
    pub smallest_pulse_us: f64,
    /// Shortest time between two step events, us.
    pub smallest_gap_us: f64,
    /// Shortest time from a direction change to the next step, us.
    pub smallest_direction_setup_us: f64,
    /// Largest delay of a step, us.
    pub largest_latency_us: Option<f64>,
    /// Steps with times below the drivers' data sheet.
    pub driver_timing_violations: u64,
    /// Motors whose steps moved nothing, and their slipped full steps.
    pub lost_steps: Vec<String>,
    /// Greatest depth of the nozzle in the bed beyond the sheet's give, mm.
    pub crash_mm: Option<f64>,
    /// The deepest use of the stack, bytes.
    pub stack_bytes: Option<u64>,
    /// Registers without a model that the firmware accessed, and other gaps of the emulator.
    pub unmodelled: Vec<String>,
    /// Messages of models about states that the manual forbids or leaves open.
    pub told: Vec<String>,
    /// Resets during the print.
    pub resets: Vec<(u64, String)>,
    /// The lines that the host read, without acknowledgements, temperatures and signs of life.
    pub host_lines: Vec<String>,
    /// Virtual time, s.
    pub virtual_s: f64,
    /// Retired instructions.
    pub instructions: u64,
    /// Virtual time per second of real time.
    pub realtime_factor: f64,
}

impl Print {
    /// Prints the file. True if the print is as it should be.
    ///
    /// # Errors
    /// A file cannot be read, the files contradict each other, or the emulator failed.
    pub fn run(&self) -> Result<bool, String> {
        let gcode = std::fs::read_to_string(&self.file)
            .map_err(|error| format!("{} cannot be read: {error}; name a G-code file in UTF-8", self.file.display()))?;
        let trace = match &self.desk_trace {
            Some(path) => {
                let bytes = std::fs::read(path).map_err(|error| {
                    format!("{} cannot be read: {error}; `ferrostep print FILE --trace {0}` writes it", path.display())
                })?;
                Some(Trace::parse(&bytes).map_err(|error| format!("{}: {error}", path.display()))?)
            }
            None => None,
        };
        let mut loaded = self.setup.load()?;
        let (printer, image_sha256) = (loaded.printer.clone(), loaded.image_sha256.clone());
        // M400 is the last line: its acknowledgement comes when motion has ended.
        let before = self.measure.then_some("M798 S1");
        let after = self.measure.then_some("M798");
        let lines = before.into_iter().chain(gcode.lines()).chain(["M400"]).chain(after);
        let options = host::Options { wait_for_start: true, ..host::Options::default() };
        let job = Job {
            stream: Stream::new(lines, options),
            via: self.via,
            plugged: false,
            ends_ns: self.at_most_s.saturating_mul(1_000_000_000),
            quiet: self.json,
            next_progress_ns: PROGRESS_NS,
            stack_top: loaded.stack_top,
            stack_bytes: None,
        };
        let began = std::time::Instant::now();
        let machine = std::mem::replace(&mut loaded.machine, Machine::new(&loaded.board, &printer, 0)?);
        let finished = run(machine, &loaded.images, &loaded.options(), job).map_err(|error| error.to_string())?;
        let wall_s = began.elapsed().as_secs_f64();
        let outcome = outcome(&finished, trace.as_ref(), &loaded.board.name, image_sha256, wall_s);
        let result = if self.json {
            serde_json::to_string_pretty(&outcome).map_err(|error| error.to_string())?
        } else {
            text(&outcome)
        };
        writeln!(std::io::stdout(), "{result}")
            .map_err(|error| format!("the result cannot be written to standard output: {error}"))?;
        Ok(outcome.is_well())
    }
}

fn outcome(finished: &Finished<Job>, trace: Option<&Trace>, board: &str, image_sha256: String, wall_s: f64) -> Outcome {
    let (machine, stream) = (finished.machine(), &finished.operator.stream);
    let mut decoder = machine.decoder.clone();
    let events = decoder.finish().to_vec();
    let smallest = decoder.smallest();
    let compared: Option<Comparison> = trace.map(|trace| {
        let desk = trace.steps_after_homing();
        let pins = events.get(events.len().saturating_sub(desk.len())..).unwrap_or_default();
        compare(pins, desk, trace.tick_hz, &Rules::default())
    });
    let digest = |steps: &mut dyn Iterator<Item = (u8, u8)>| format!("{:016x}", crate::decode::order_digest(steps));
    let desk_steps = trace.map(Trace::steps_after_homing);
    let compared_from = desk_steps.map_or(0, |desk| events.len().saturating_sub(desk.len()));
    let pins = events.get(compared_from..).unwrap_or_default();
    let us = |ns: u64| if ns == u64::MAX { f64::NAN } else { ns as f64 / 1000.0 };
    let stopped = if stream.was_reset() {
        Some("the printer was reset in mid-print".to_owned())
    } else if !stream.finished() {
        Some(format!(
            "{} of {} lines done after {} s of virtual time; --at-most-s allows more",
            stream.acknowledged(),
            stream.lines(),
            finished.operator.ends_ns / 1_000_000_000
        ))
    } else {
        stream.errors().next().map(|error| error.text.clone())
    };
    let host_lines = stream
        .heard()
        .iter()
        .filter(|heard| matches!(heard.kind, host::LineKind::Text | host::LineKind::Error | host::LineKind::Start))
        .filter(|heard| !heard.text.trim_start().starts_with("T:") && !heard.text.starts_with("ok"))
        .map(|heard| heard.text.clone())
        .collect();
    let lost_steps = (0..4)
        .map(|motor| (motor, machine.plant.motion.record(motor)))
        .filter(|(_, record)| record.unpowered_steps > 0 || record.slipped_periods > 0)
        .map(|(motor, record)| {
            let name = ["x", "y", "z", "e"][motor];
            format!(
                "{name}: {} without current, {} full steps slipped",
                record.unpowered_steps,
                4 * record.slipped_periods
            )
        })
        .collect();
    Outcome {
        board: board.to_owned(),
        image_sha256,
        stopped,
        pin_order_digest: digest(&mut pins.iter().map(|event| (event.axes, event.directions))),
        desk_order_digest: desk_steps.map(|desk| digest(&mut desk.iter().map(|step| (step.axes, step.directions)))),
        agrees: compared.as_ref().map(Comparison::agrees),
        difference: compared.as_ref().and_then(|compared| {
            let late = || compared.first_too_late.map(|late| late.to_string());
            compared.difference.map(|difference| difference.to_string()).or_else(late)
        }),
        events: compared.as_ref().map_or(events.len(), |compared| compared.pin_events),
        runs: compared.as_ref().map_or(0, |compared| compared.runs),
        smallest_pulse_us: us(smallest.pulse_ns()),
        smallest_gap_us: us(smallest.gap_ns),
        smallest_direction_setup_us: us(smallest.direction_setup_ns),
        largest_latency_us: compared.as_ref().map(Comparison::largest_latency_us),
        driver_timing_violations: machine.plant.drivers.iter().map(|driver| driver.timing().violations).sum(),
        lost_steps,
        crash_mm: machine.plant.motion.sheet().crash().map(|crash| crash.deepest_mm),
        stack_bytes: finished.operator.stack_bytes,
        unmodelled: finished.report.unmodelled.clone(),
        told: finished.report.told.clone(),
        resets: finished.report.resets.clone(),
        host_lines,
        virtual_s: finished.report.virtual_ns as f64 / 1e9,
        instructions: finished.report.instructions,
        realtime_factor: finished.report.virtual_ns as f64 / 1e9 / wall_s,
    }
}

impl Outcome {
    /// True if the job finished, agrees with the trace, and had no reset and no crash.
    fn is_well(&self) -> bool {
        self.stopped.is_none() && self.agrees != Some(false) && self.resets.is_empty() && self.crash_mm.is_none()
    }
}

/// The result as lines for a person.
fn text(outcome: &Outcome) -> String {
    let mut lines = vec![
        format!("board             {} (image {:.16})", outcome.board, outcome.image_sha256),
        format!("time              {:.1} s, {:.1} times real time", outcome.virtual_s, outcome.realtime_factor),
        format!("smallest pulse    {:.3} us", outcome.smallest_pulse_us),
        format!("smallest gap      {:.3} us", outcome.smallest_gap_us),
        format!("direction set-up  {:.3} us", outcome.smallest_direction_setup_us),
    ];
    if let (Some(agrees), Some(latency_us)) = (outcome.agrees, outcome.largest_latency_us) {
        let verdict = if agrees { "as on the desk" } else { "DIFFERENT from the desk" };
        lines.push(format!("steps             {} after homing, in {} runs: {verdict}", outcome.events, outcome.runs));
        lines.push(format!("latest step       {latency_us:.3} us"));
    }
    if let Some(stack_bytes) = outcome.stack_bytes {
        lines.push(format!("deepest stack     {stack_bytes} bytes"));
    }
    let lists = [
        ("host", &outcome.host_lines),
        ("lost", &outcome.lost_steps),
        ("unmodelled", &outcome.unmodelled),
        ("warning", &outcome.told),
    ];
    for (what, said) in lists {
        lines.extend(said.iter().map(|line| format!("{what:<17} {line}")));
    }
    lines.extend(
        outcome
            .resets
            .iter()
            .map(|(at_ns, cause)| format!("reset             at {:.6} s: {cause}", *at_ns as f64 / 1e9)),
    );
    let stops = [&outcome.difference, &outcome.stopped].into_iter().flatten();
    lines.extend(stops.map(|what| format!("STOPPED           {what}")));
    if let Some(crash_mm) = outcome.crash_mm {
        lines.push(format!("CRASHED           the nozzle went {crash_mm:.3} mm into the bed"));
    }
    lines.join("\n")
}
