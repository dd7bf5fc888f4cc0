//! What became of a run with a fault, and whether it is what the documentation promises.

use serde::Serialize;

use super::fault::Fault;
use super::host_side::HostSide;
use super::promise::{DEAF_MS, Promise, What};
use super::state::{Place, State, TARGETS_CELSIUS, position_mm};
use crate::host::Answer;
use crate::machine::Machine;
use crate::parts::heat::HeaterFault;
use crate::parts::motion::sheet::ProbeFault;

const MILLISECOND: u64 = 1_000_000;
/// Heaters that are off for this long, with a reason given, are off for good: a slow pulse lasts a tenth of a second.
const OFF_FOR_NS: u64 = 1_200 * MILLISECOND;
/// A printer that has said nothing for this long does not answer: it reports temperatures each second.
const SILENT_NS: u64 = 1_600 * MILLISECOND;
/// A fault without a promised end is watched for this long if something was out of the ordinary.
const WATCHED_NS: u64 = 12_000 * MILLISECOND;
/// A block may be hotter than its maximum by this: what is under way to its thermistor.
const MARGIN_CELSIUS: f64 = 15.0;
/// A motor that is further from its place than this has lost it, in 1/256 of a full step: four full steps.
const LOST_256: i64 = 1023;
/// The printer may say that an axis stands so far from where it does, mm.
const MISPLACED_MM: f64 = 0.5;

/// What became of a run.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    /// The fault.
    pub fault: &'static str,
    /// The state upon which it came.
    pub state: State,
    /// Draws everything of the run.
    pub seed: u64,
    /// When it came, s of the run.
    pub at_s: f64,
    /// What exactly it was.
    pub detail: String,
    /// The machine has no such part: nothing was done.
    pub without: bool,
    /// From the fault until heaters had power for the last time, ms; none if they still had at the end.
    pub heaters_off_ms: Option<f64>,
    /// Whether they had power, or a target, when it came.
    pub was_hot: bool,
    /// What the host read of it first.
    pub host_read: String,
    /// Resets of the chip after it, with their causes, and after how many ms.
    pub resets: Vec<String>,
    /// The hottest that nozzle and bed truly were, degrees Celsius.
    pub hottest_celsius: [f64; 2],
    /// How long the run was watched after the fault, s.
    pub watched_s: f64,
    /// The first telling lines that the host read after it.
    pub heard: Vec<String>,
    /// What is not as it is promised.
    pub violations: Vec<String>,
}

/// Who watches a run from its fault on.
#[derive(Debug)]
pub struct Watch {
    promise: Promise,
    state: State,
    fault: Fault,
    at_ns: u64,
    last_on_ns: Option<u64>,
    /// Queued motion goes on after a host has gone, and counts as use: a promise's time begins at its end.
    moved_ns: u64,
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
    lied_mm: Option<(usize, f64)>,
}

/// What of a printer's profile a watch needs.
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    /// The largest temperatures of nozzle and bed, degrees Celsius.
    pub max_celsius: [f64; 2],
    /// What a step moves, in 1/256 of a full step.
    pub per_step_256: [i64; 4],
}

fn alarm_of(side: &HostSide, since_ns: u64) -> Option<&str> {
    side.alarms(since_ns).map(|heard| heard.text.as_str()).next()
}

impl Watch {
    /// From now on.
    #[must_use]
    pub fn new(fault: Fault, promise: Promise, place: &Place, limits: &Limits, machine: &Machine, now_ns: u64) -> Self {
        let motion = &machine.plant.motion;
        let motors = limits.per_step_256.len();
        let heating = machine.plant.heaters.iter().any(|heater| heater.power > 0.0);
        Self {
            promise,
            state: place.state,
            fault,
            at_ns: now_ns,
            last_on_ns: (heating || place.state.is_hot()).then_some(now_ns),
            moved_ns: now_ns,
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
            lied_mm: None,
        }
    }

    /// The same, with another promise.
    #[must_use]
    pub fn with(self, promise: Promise) -> Self {
        Self { promise, ..self }
    }

    /// Whether the run's verdict is certain.
    pub fn turn(&mut self, machine: &Machine, side: &HostSide, now_ns: u64) -> bool {
        self.powered = machine.powered();
        if self.powered && machine.plant.any_heater_on() {
            self.last_on_ns = Some(now_ns);
        }
        if self.fault == Fault::HostVanishes {
            let steps = (0..self.per_step_256.len()).map(|motor| machine.decoder.steps(motor)).sum();
            if steps != self.steps {
                (self.steps, self.moved_ns) = (steps, now_ns);
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
                        self.lied_mm.get_or_insert((axis, off_mm));
                    }
                }
            }
        }
        self.heard = side.heard().len();
        self.is_certain(side, now_ns)
    }

    fn is_certain(&self, side: &HostSide, now_ns: u64) -> bool {
        let passed_ns = now_ns - self.at_ns;
        let within_ns = self.promise.within_ms * MILLISECOND;
        let off = self.last_on_ns.is_none_or(|on_ns| now_ns - on_ns > OFF_FOR_NS);
        let said = alarm_of(side, self.at_ns).is_some();
        match self.promise.what {
            What::Off => {
                (off && said && !self.has_targets(side)) || now_ns - self.moved_ns > within_ns + 4_000 * MILLISECOND
            }
            What::Reset => {
                (off && self.reset_ns.is_some() && (said || !self.powered) && passed_ns > OFF_FOR_NS)
                    || passed_ns > within_ns + 4_000 * MILLISECOND
            }
            What::GoesOn => passed_ns > within_ns,
            What::Controlled => {
                let mends = matches!(self.fault, Fault::EndStop(_) | Fault::Probe(_)) && self.state == State::Homing;
                let homed = mends && (side.finished() || self.lied_mm.is_some());
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

    /// Whether the printer reported a target, of any heater, since it gave a reason to stop.
    fn has_targets(&self, side: &HostSide) -> bool {
        let since_ns = side.alarms(self.at_ns).next().map_or(self.at_ns, |alarm| alarm.at_ns);
        side.temperatures(since_ns).is_some_and(|said| said.celsius[1] > 0.0 || said.celsius[3] > 0.0)
    }

    /// Whether something is out of the ordinary: silence, errors, other targets than the host has set.
    fn is_odd(&self, side: &HostSide, now_ns: u64) -> bool {
        let silent = side.is_there() && side.silent_ns(now_ns) > SILENT_NS;
        let targets = match self.state {
            State::Heating | State::Homing | State::Waiting | State::Printing => TARGETS_CELSIUS,
            State::Boot | State::Idle | State::Halted => [0.0; 2],
        };
        let other = side.temperatures(self.at_ns).is_some_and(|said| {
            [said.celsius[1], said.celsius[3]].into_iter().zip(targets).any(|(said, set)| (said - set).abs() > 0.5)
        });
        silent || other || alarm_of(side, self.at_ns).is_some() || self.reset_ns.is_some()
    }

    /// The verdict; `resets` are the run's.
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
        // A nozzle above its target gets no power either: that alone is not off for good.
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
            heard: side.telling(self.at_ns, 8),
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
                    Some(after_ms) if after_ms > within_ms + ms(self.moved_ns - self.at_ns) => {
                        found.push(format!("heaters off after {after_ms:.0} ms, promised within {within_ms} ms"));
                    }
                    _ => {}
                }
                if was_on && alarm.is_some() && self.has_targets(side) {
                    found.push("a heater still has a target after the reason to stop".to_owned());
                }
                let said = self.promise.says.is_empty() && alarm.is_some()
                    || side
                        .heard()
                        .iter()
                        .filter(|heard| heard.at_ns >= self.at_ns)
                        .any(|heard| self.promise.says.iter().any(|says| heard.text.contains(says)));
                if !said && self.state != State::Halted {
                    found.push(format!("the host reads \"{}\", expected {:?}", outcome.host_read, self.promise.says));
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
                let halted = side.alarms(self.at_ns).find(|heard| heard.answer == Answer::Error);
                if let Some(halted) = halted.filter(|_| self.state != State::Halted) {
                    found.push(format!("stops with \"{}\", and nothing has failed that it watches", halted.text));
                }
                if self.reset_ns.is_some() {
                    found.push(format!("is reset: {}", outcome.resets.join(", ")));
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
                found.push(format!("the {place} reaches {celsius} C, its maximum is {limit} C"));
            }
        }
        let on = outcome.heaters_off_ms.is_none();
        if on && self.powered && side.is_there() && side.silent_ns(now_ns) > DEAF_MS * MILLISECOND {
            found.push(format!(
                "heaters have power, and nothing was heard for {:.1} s",
                ms(side.silent_ns(now_ns)) / 1e3
            ));
        }
        if self.state == State::Halted && self.last_on_ns.is_some_and(|on_ns| on_ns > self.at_ns) {
            found.push("a heater has power again after M112".to_owned());
        }
    }

    fn motion_is_honest(&self, machine: &Machine, side: &HostSide, alarm: Option<&str>, found: &mut Vec<String>) {
        let motion = &machine.plant.motion;
        let unknown = matches!(self.fault, Fault::Probe(ProbeFault::Dead)) && !self.state.is_homed();
        if let Some(crash) = motion.sheet().crash().filter(|crash| crash.first_ns >= self.at_ns && !unknown) {
            found.push(format!("the nozzle is pressed {:.2} mm into the bed", crash.deepest_mm));
        }
        let told = alarm.is_some() || side.was_told(self.at_ns);
        if let Some((axis, off_mm)) = self.lied_mm.filter(|_| !told) {
            found.push(format!("{} is homed {off_mm:.2} mm from where it says", ["X", "Y", "Z"][axis]));
        }
        if !self.state.is_homed() || told || self.reset_ns.is_some() {
            return;
        }
        for motor in 0..3 {
            let stepped = machine.decoder.position(motor) - self.position[motor];
            let moved = motion.field_256(motor) - self.field_256[motor];
            let lost = moved - stepped * self.per_step_256[motor];
            if lost.abs() > LOST_256 {
                let unpowered = motion.record(motor).unpowered_steps - self.unpowered_at_start[motor];
                found.push(format!(
                    "motor {} lost {} full steps ({unpowered} steps without current), unreported",
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

/// A line of the printer with numbers and places left out, so that lines can be counted.
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
    fn lines_that_differ_in_numbers_are_one() {
        let one = without_numbers("Error:MINTEMP triggered, system stopped! Heater_ID: E0 (temp: -12.0)");
        assert_eq!(one, without_numbers("Error:MINTEMP triggered, system stopped! Heater_ID: E0 (temp: 3.5)"));
        assert_eq!(without_numbers("echo:line 12: 7"), "echo:line #: #");
    }
}
