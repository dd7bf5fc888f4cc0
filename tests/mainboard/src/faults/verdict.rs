//! The outcome of a run with a fault, and its comparison with the documentation's promise.

use serde::Serialize;

use super::bench::Limits;
use super::fault::Fault;
use super::host_side::HostSide;
use super::promise::{MAX_SILENCE_MS, Promise, What};
use super::state::{DWELL_S, StartingPoint, State, TARGETS_CELSIUS, position_mm};
use crate::host::LineKind;
use crate::machine::Machine;
use crate::parts::heat::HeaterFault;
use crate::parts::motion::sheet::ProbeFault;

const MILLISECOND: u64 = 1_000_000;
/// Heaters off for this long after an alarm are off for good: a slow pulse lasts a
/// tenth of a second.
const OFF_FOR_NS: u64 = 1_200 * MILLISECOND;
/// A printer silent for this long does not answer: it reports temperatures each second.
const SILENT_NS: u64 = 1_600 * MILLISECOND;
/// Watched time after a fault without a promised end, if something is out of the ordinary.
const WATCHED_NS: u64 = 12_000 * MILLISECOND;
/// A block may exceed its maximum by this, degrees Celsius: its thermistor lags.
const MARGIN_CELSIUS: f64 = 15.0;
/// A motor further than this from its position has lost steps, in 1/256 of a full step:
/// four full steps.
const LOST_256: i64 = 1023;
/// Maximum difference between an axis's reported and true position, mm.
const MISPLACED_MM: f64 = 0.5;

/// The outcome of a run.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    /// The fault.
    pub fault: &'static str,
    /// The state in which the fault occurred.
    pub state: State,
    /// The seed that draws the whole run.
    pub seed: u64,
    /// The instant of the fault, s of the run.
    pub at_s: f64,
    /// The details of the fault.
    pub detail: String,
    /// The machine has no such part: the fault did not happen.
    pub without: bool,
    /// Time from the fault until heaters had power for the last time, ms; `None` if they still have
    /// power at the end.
    pub heaters_off_ms: Option<f64>,
    /// True if heaters had power or a target at the fault.
    pub was_hot: bool,
    /// The first line that the host read about the fault.
    pub host_read: String,
    /// Resets of the chip after the fault: cause, and time after it in ms.
    pub resets: Vec<String>,
    /// The highest true temperatures of nozzle and bed, degrees Celsius.
    pub hottest_celsius: [f64; 2],
    /// Time for which the run was watched after the fault, s.
    pub watched_s: f64,
    /// The first notable lines that the host read after the fault.
    pub heard: Vec<String>,
    /// Broken promises.
    pub violations: Vec<String>,
}

/// The observer of a run from its fault on.
#[derive(Debug)]
pub struct Watch {
    promise: Promise,
    state: State,
    fault: Fault,
    at_ns: u64,
    last_on_ns: Option<u64>,
    /// Last step, or end of the wait, ns: queued motion and the command in execution continue after
    /// the host has gone and count as use, so the time of a promise begins at their end.
    used_ns: u64,
    /// End of the state's G4, ns.
    dwelt_ns: u64,
    steps: u64,
    resets: usize,
    reset_ns: Option<u64>,
    field_256: Vec<i64>,
    position: Vec<i64>,
    per_step_256: [i64; 4],
    offset_mm: [f64; 3],
    limits_celsius: [f64; 2],
    powered: bool,
    unpowered_at_start: [u64; 3],
    heard: usize,
    misreported_mm: Option<(usize, f64)>,
}

fn alarm_of(side: &HostSide, since_ns: u64) -> Option<&str> {
    side.alarms(since_ns).map(|heard| heard.text.as_str()).next()
}

impl Watch {
    /// Starts watching.
    #[must_use]
    pub fn new(
        fault: Fault,
        promise: Promise,
        place: &StartingPoint,
        limits: &Limits,
        machine: &Machine,
        now_ns: u64,
    ) -> Self {
        let motion = &machine.plant.motion;
        let motors = limits.per_step_256.len();
        let heating = machine.plant.heaters.iter().any(|heater| heater.power > 0.0);
        Self {
            promise,
            state: place.state,
            fault,
            at_ns: now_ns,
            last_on_ns: (heating || place.state.is_hot()).then_some(now_ns),
            used_ns: now_ns,
            dwelt_ns: place.at_ns + DWELL_S * 1_000 * MILLISECOND,
            steps: 0,
            resets: machine.resets(),
            reset_ns: None,
            field_256: (0..motors).map(|motor| motion.field_256(motor)).collect(),
            position: (0..motors).map(|motor| machine.decoder.position(motor)).collect(),
            per_step_256: limits.per_step_256,
            offset_mm: place.offset_mm,
            limits_celsius: limits.max_celsius,
            powered: true,
            unpowered_at_start: std::array::from_fn(|motor| motion.record(motor).unpowered_steps),
            heard: 0,
            misreported_mm: None,
        }
    }

    /// The same observer with another promise.
    #[must_use]
    pub fn with(self, promise: Promise) -> Self {
        Self { promise, ..self }
    }

    /// Follows the machine; true once the verdict is certain.
    pub fn turn(&mut self, machine: &Machine, side: &HostSide, now_ns: u64) -> bool {
        self.powered = machine.powered();
        if self.powered && machine.plant.any_heater_on() {
            self.last_on_ns = Some(now_ns);
        }
        if self.fault == Fault::HostVanishes {
            let steps = (0..self.per_step_256.len()).map(|motor| machine.decoder.steps(motor)).sum();
            if steps != self.steps || self.is_waiting(machine, now_ns) {
                (self.steps, self.used_ns) = (steps, now_ns);
            }
        }
        if machine.resets() != self.resets && self.reset_ns.is_none() {
            self.reset_ns = Some(now_ns);
        }
        for line in &side.heard()[self.heard.min(side.heard().len())..] {
            if let Some(said_mm) = position_mm(&line.text).filter(|_| line.at_ns > self.at_ns) {
                for (axis, said_mm) in said_mm.into_iter().enumerate() {
                    let off_mm = machine.plant.motion.position_mm(axis) - self.offset_mm[axis] - said_mm;
                    if off_mm.abs() > MISPLACED_MM && self.state == State::Homing && self.reset_ns.is_none() {
                        self.misreported_mm.get_or_insert((axis, off_mm));
                    }
                }
            }
        }
        self.heard = side.heard().len();
        self.is_certain(side, now_ns)
    }

    /// True if the printer waits for time or heat, without a step.
    fn is_waiting(&self, machine: &Machine, now_ns: u64) -> bool {
        match self.state {
            State::Waiting => now_ns < self.dwelt_ns,
            State::Heating => machine.plant.heaters.iter().any(|place| {
                place.name.starts_with("nozzle") && place.heater.hottest_celsius() < TARGETS_CELSIUS[0] - 1.0
            }),
            _ => false,
        }
    }

    fn is_certain(&self, side: &HostSide, now_ns: u64) -> bool {
        let passed_ns = now_ns - self.at_ns;
        let within_ns = self.promise.within_ms * MILLISECOND;
        let off = self.last_on_ns.is_none_or(|on_ns| now_ns - on_ns > OFF_FOR_NS);
        let said = alarm_of(side, self.at_ns).is_some();
        match self.promise.what {
            What::Off => {
                (off && said && !self.has_targets(side)) || now_ns - self.used_ns > within_ns + 4_000 * MILLISECOND
            }
            What::Reset => {
                (off && self.reset_ns.is_some() && (said || !self.powered) && passed_ns > OFF_FOR_NS)
                    || passed_ns > within_ns + 4_000 * MILLISECOND
            }
            What::GoesOn => passed_ns > within_ns,
            What::Controlled => {
                let mends = matches!(self.fault, Fault::EndStop(_) | Fault::Probe(_)) && self.state == State::Homing;
                let homed = mends && (side.finished() || self.misreported_mm.is_some());
                if passed_ns < within_ns && !homed {
                    return false;
                }
                if mends {
                    return homed || said || passed_ns > 25_000 * MILLISECOND;
                }
                (off && passed_ns > OFF_FOR_NS) || !self.is_odd(side, now_ns) || passed_ns > WATCHED_NS
            }
        }
    }

    /// True if the printer has reported a target of any heater since its alarm.
    fn has_targets(&self, side: &HostSide) -> bool {
        let since_ns = side.alarms(self.at_ns).next().map_or(self.at_ns, |alarm| alarm.at_ns);
        side.temperatures(since_ns).is_some_and(|said| said.celsius[1] > 0.0 || said.celsius[3] > 0.0)
    }

    /// True if something is out of the ordinary: silence, alarms, or targets that the
    /// host did not set.
    fn is_odd(&self, side: &HostSide, now_ns: u64) -> bool {
        let silent = side.is_there() && side.silent_ns(now_ns) > SILENT_NS;
        let targets = match self.state {
            State::Heating | State::Homing | State::Waiting | State::Printing => TARGETS_CELSIUS,
            State::Boot | State::Idle | State::Halted => [0.0; 2],
        };
        let other = side.temperatures(self.at_ns).is_some_and(|said| {
            [said.celsius[1], said.celsius[3]]
                .into_iter()
                .zip(targets)
                .any(|(reported, set)| (reported - set).abs() > 0.5)
        });
        silent || other || alarm_of(side, self.at_ns).is_some() || self.reset_ns.is_some()
    }

    /// The verdict; `resets` are those of the run.
    #[must_use]
    pub fn outcome(
        &self,
        machine: &Machine,
        side: &HostSide,
        seed: u64,
        detail: &str,
        resets: &[(u64, String)],
        now_ns: u64,
    ) -> Outcome {
        // A nozzle above its target gets no power either: without an alarm it is not off for good.
        let ended = alarm_of(side, self.at_ns).is_some()
            || self.reset_ns.is_some()
            || !self.powered
            || matches!(self.promise.what, What::Off | What::Reset);
        let off_ms = match self.last_on_ns {
            _ if !ended => None,
            None => Some(0.0),
            Some(on_ns) if now_ns - on_ns > OFF_FOR_NS => Some(ms(on_ns - self.at_ns)),
            Some(_) => None,
        };
        let hottest = ["nozzle", "bed"].map(|name| {
            let places = machine.plant.heaters.iter().filter(|place| place.name.starts_with(name));
            places.map(|place| place.heater.hottest_celsius()).fold(0.0, f64::max)
        });
        let mut outcome = Outcome {
            fault: self.fault.name(),
            state: self.state,
            seed,
            at_s: self.at_ns as f64 / 1e9,
            detail: detail.to_owned(),
            without: false,
            heaters_off_ms: off_ms,
            was_hot: self.state.is_hot(),
            host_read: self.host_read(side),
            resets: resets
                .iter()
                .filter(|(at_ns, _)| *at_ns >= self.at_ns)
                .map(|(at_ns, cause)| format!("{cause} after {:.0} ms", ms(at_ns - self.at_ns)))
                .collect(),
            hottest_celsius: hottest.map(|celsius| (celsius * 10.0).round() / 10.0),
            watched_s: ms(now_ns - self.at_ns) / 1e3,
            heard: side.notable_lines(self.at_ns, 8),
            violations: Vec::new(),
        };
        outcome.violations = self.violations(machine, side, &outcome, now_ns);
        outcome
    }

    fn host_read(&self, side: &HostSide) -> String {
        let mut lines = side.alarms(self.at_ns).map(|heard| without_numbers(&heard.text));
        let Some(first) = lines.next() else {
            let from = side.heard().partition_point(|heard| heard.at_ns < self.at_ns);
            let notice = side.heard()[from..].iter().find(|heard| heard.text.starts_with("echo:driver"));
            return notice.map_or_else(|| "-".to_owned(), |heard| without_numbers(&heard.text));
        };
        if first != "start" {
            return first;
        }
        let cause = lines.find(|line| line.starts_with("echo:reset"));
        cause.map_or(first.clone(), |cause| format!("{first}, {cause}"))
    }

    fn violations(&self, machine: &Machine, side: &HostSide, outcome: &Outcome, now_ns: u64) -> Vec<String> {
        let mut found = Vec::new();
        let within_ms = self.promise.within_ms as f64;
        let alarm = alarm_of(side, self.at_ns);
        let was_on = self.state.is_hot();
        match self.promise.what {
            What::Off => {
                match outcome.heaters_off_ms {
                    None if was_on => found.push(format!("heaters still on after {:.1} s", outcome.watched_s)),
                    Some(after_ms) if after_ms > within_ms + ms(self.used_ns - self.at_ns) => {
                        found.push(format!("heaters off after {after_ms:.0} ms, promised within {within_ms} ms"));
                    }
                    _ => {}
                }
                if was_on && alarm.is_some() && self.has_targets(side) {
                    found.push("a heater still has a target after the alarm".to_owned());
                }
                let texts = self.promise.expected_texts;
                let said = texts.is_empty() && alarm.is_some()
                    || side
                        .heard()
                        .iter()
                        .filter(|heard| heard.at_ns >= self.at_ns)
                        .any(|heard| texts.iter().any(|text| heard.text.contains(text)));
                if !said && self.state != State::Halted {
                    found.push(format!("the host read \"{}\", expected one of {texts:?}", outcome.host_read));
                }
            }
            What::Reset => match self.reset_ns.map(|at_ns| ms(at_ns - self.at_ns)) {
                _ if !self.powered => {}
                None => found.push(format!("no reset within {:.1} s", outcome.watched_s)),
                Some(after_ms) if after_ms > within_ms.max(1_900.0) => {
                    found.push(format!("reset after {after_ms:.0} ms, promised within {within_ms} ms"));
                }
                Some(_) if outcome.heaters_off_ms.is_none_or(|off_ms| off_ms > within_ms) && was_on => {
                    let off =
                        outcome.heaters_off_ms.map_or("never".to_owned(), |off_ms| format!("after {off_ms:.0} ms"));
                    found.push(format!("heaters off {off}, promised within {within_ms} ms"));
                }
                Some(_) => {}
            },
            What::GoesOn => {
                let halted = side.alarms(self.at_ns).find(|heard| heard.kind == LineKind::Error);
                if let Some(halted) = halted.filter(|_| self.state != State::Halted) {
                    found.push(format!(
                        "the printer stopped with \"{}\" although nothing that it monitors failed",
                        halted.text
                    ));
                }
                if self.reset_ns.is_some() {
                    found.push(format!("the printer was reset: {}", outcome.resets.join(", ")));
                }
            }
            What::Controlled => {}
        }
        self.heat_is_controlled(side, outcome, now_ns, &mut found);
        self.motion_is_honest(machine, side, alarm, &mut found);
        found
    }

    fn heat_is_controlled(&self, side: &HostSide, outcome: &Outcome, now_ns: u64, found: &mut Vec<String>) {
        let cannot = matches!(self.fault, Fault::Heater(_, HeaterFault::StuckOn) | Fault::Thermistor(..));
        for (place, (celsius, limit)) in
            ["nozzle", "bed"].into_iter().zip(outcome.hottest_celsius.into_iter().zip(self.limits_celsius))
        {
            if celsius > limit + MARGIN_CELSIUS && !cannot {
                found.push(format!("the {place} reached {celsius} C; its maximum is {limit} C"));
            }
        }
        let on = outcome.heaters_off_ms.is_none();
        if on && self.powered && side.is_there() && side.silent_ns(now_ns) > MAX_SILENCE_MS * MILLISECOND {
            found.push(format!(
                "heaters have power, and the printer has been silent for {:.1} s",
                ms(side.silent_ns(now_ns)) / 1e3
            ));
        }
        if self.state == State::Halted && self.last_on_ns.is_some_and(|on_ns| on_ns > self.at_ns) {
            found.push("a heater got power again after M112".to_owned());
        }
    }

    fn motion_is_honest(&self, machine: &Machine, side: &HostSide, alarm: Option<&str>, found: &mut Vec<String>) {
        let motion = &machine.plant.motion;
        let unknown = matches!(self.fault, Fault::Probe(ProbeFault::Dead)) && !self.state.is_homed();
        if let Some(crash) = motion.sheet().crash().filter(|crash| crash.first_ns >= self.at_ns && !unknown) {
            found.push(format!("the nozzle went {:.2} mm into the bed", crash.deepest_mm));
        }
        let reported = alarm.is_some() || side.read_a_warning(self.at_ns);
        if let Some((axis, off_mm)) = self.misreported_mm.filter(|_| !reported) {
            found.push(format!(
                "after homing {} is {off_mm:.2} mm away from its reported position",
                ["X", "Y", "Z"][axis]
            ));
        }
        if !self.state.is_homed() || reported || self.reset_ns.is_some() {
            return;
        }
        for motor in 0..3 {
            let stepped = machine.decoder.position(motor) - self.position[motor];
            let moved = motion.field_256(motor) - self.field_256[motor];
            let lost = moved - stepped * self.per_step_256[motor];
            if lost.abs() > LOST_256 {
                let unpowered = motion.record(motor).unpowered_steps - self.unpowered_at_start[motor];
                found.push(format!(
                    "motor {} lost {} full steps ({unpowered} steps without current) and does not report it",
                    ["X", "Y", "Z"][motor],
                    lost / 256
                ));
            }
        }
    }
}

fn ms(ns: u64) -> f64 {
    ns as f64 / 1e6
}

/// A line of the printer without numbers and positions, so that equal lines can be counted.
fn without_numbers(line: &str) -> String {
    let line = line.split(" (temp").next().unwrap_or_default();
    let mut text = String::new();
    for letter in line.chars() {
        if letter.is_ascii_digit() {
            if !text.ends_with('#') {
                text.push('#');
            }
        } else {
            text.push(letter);
        }
    }
    text.chars().take(90).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_that_differ_only_in_numbers_are_equal() {
        let one = without_numbers("Error:MINTEMP triggered, system stopped! Heater_ID: E0 (temp: -12.0)");
        assert_eq!(one, without_numbers("Error:MINTEMP triggered, system stopped! Heater_ID: E0 (temp: 3.5)"));
        assert_eq!(without_numbers("echo:line 12: 7"), "echo:line #: #");
    }
}
