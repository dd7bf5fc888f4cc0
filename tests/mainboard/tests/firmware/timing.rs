//! M798: histograms of the step interrupt and of planning, switched on and off during a print that
//! they do not change.

use crate::firmware::bench::Bench;
use crate::firmware::job::Job;
use crate::firmware::same_steps::assert_printed_as_rehearsed;

/// Lines of the cube: skirt and perimeters.
const LINES: usize = 120;

/// Lines of the job before which measuring is switched on and off.
const ON: usize = 60;
const OFF: usize = 110;

/// A line of M798.
#[derive(Debug, PartialEq, Eq)]
struct Times {
    count: u64,
    p50: u64,
    p99: u64,
    p99_9: u64,
    max: u64,
    unit: String,
}

/// Asks for a histogram.
fn times(bench: &mut Bench, name: &str) -> Times {
    let line = bench.host.ask("M798", &format!("echo:timing {name} ")).unwrap();
    let word = |name: &str| {
        let rest = line.split_once(&format!(" {name}:")).unwrap_or_else(|| panic!("no {name} in {line:?}")).1;
        rest.split(' ').next().unwrap().to_owned()
    };
    let number = |name| word(name).parse().unwrap();
    Times {
        count: number("count"),
        p50: number("p50"),
        p99: number("p99"),
        p99_9: number("p99.9"),
        max: number("max"),
        unit: word("unit"),
    }
}

/// All histograms: latency and duration of the step interrupt, planning.
fn all(bench: &mut Bench) -> [Times; 3] {
    let all = ["step_latency", "step_duration", "planning"].map(|name| times(bench, name));
    eprintln!("{all:#?}");
    all
}

/// True if a line of the job moves an axis: a feed alone does not.
fn is_move(line: &str) -> bool {
    line.starts_with("G1 ") && line.contains(['X', 'Y', 'Z', 'E'])
}

#[test]
fn times_are_measured_while_switched_on_and_no_step_changes() {
    let mut job = Job::cube(LINES).without_heating().without_homing();
    // The machine is at rest at each switch, so that all events in between are measured.
    for (index, line) in [(OFF, "M798 S0"), (OFF, "M400"), (ON, "M798 S1"), (ON, "M400")] {
        job.insert(index, line);
    }
    // The inserted lines before count as well.
    let (on, off) = (ON + 2, OFF + 4);
    let mut bench = Bench::boot();
    let never = all(&mut bench);
    assert!(never.iter().all(|times| times.count == 0 && times.max == 0), "measured without M798: {never:?}");

    for line in job.lines().take(on) {
        bench.host.send(line).unwrap();
    }
    let before = bench.pins().events().len() as u64;
    for line in job.lines().take(off).skip(on) {
        bench.host.send(line).unwrap();
    }
    let events = bench.pins().events().len() as u64 - before;
    let seen = all(&mut bench);
    assert!(events > 1000, "only {events} events were measured");
    let [latency, duration, planning] = &seen;
    for times in &seen {
        let Times { p50, p99, p99_9, max, .. } = times;
        assert!(0 < *p50 && p50 <= p99 && p99 <= p99_9 && p99_9 <= max, "{times:?}");
    }
    // The step timer's interrupt also occurs between motions, to check for the next one.
    assert!(latency.count >= events, "{latency:?} of {events} events");
    assert_eq!(latency.count, duration.count);
    assert_eq!(latency.unit, "ticks");
    assert_eq!((duration.unit.as_str(), planning.unit.as_str()), ("cycles", "cycles"));
    let moves = job.lines().take(off).skip(on).filter(|line| is_move(line)).count() as u64;
    assert_eq!(planning.count, moves, "{planning:?}");
    assert!(planning.p50 > duration.p50, "planning a move takes longer than a step of it: {seen:?}");

    for line in job.lines().skip(off) {
        bench.host.send(line).unwrap();
    }
    bench.host.send("M400").unwrap();
    assert_eq!(all(&mut bench), seen, "measured after it was switched off");
    bench.host.send("M798 R").unwrap();
    assert!(all(&mut bench).iter().all(|times| times.count == 0 && times.max == 0), "not cleared");
    assert_printed_as_rehearsed(bench, &job);
}
