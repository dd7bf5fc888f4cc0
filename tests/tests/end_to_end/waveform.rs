//! The waveform of `--vcd`, read as a viewer reads it.

use std::collections::BTreeMap;

use crate::end_to_end::command::{directory, example, ferrostep, file};

/// One signal on its way through the file.
#[derive(Debug, Default)]
struct Signal {
    high: bool,
    changed_ns: u64,
    rising_edges: u64,
    edges: u64,
    shortest_high_ns: Option<u64>,
    shortest_low_ns: Option<u64>,
    /// Minimum time from a change of its direction to its next step.
    shortest_setup_ns: Option<u64>,
}

impl Signal {
    fn set(&mut self, high: bool, now_ns: u64) {
        if self.high == high {
            return;
        }
        let lasted = now_ns - self.changed_ns;
        let shortest = if high { &mut self.shortest_low_ns } else { &mut self.shortest_high_ns };
        *shortest = Some(shortest.map_or(lasted, |before| before.min(lasted)));
        self.rising_edges += u64::from(high);
        self.edges += 1;
        (self.high, self.changed_ns) = (high, now_ns);
    }
}

/// All signals by name, after the last change.
fn read(text: &str, pulse_ns: Option<u64>) -> BTreeMap<String, Signal> {
    let (head, body) = text.split_once("$enddefinitions $end").unwrap();
    assert!(head.contains("$timescale 1 ns $end"), "{head}");
    let mut names = BTreeMap::new();
    for declaration in head.lines().filter(|line| line.starts_with("$var ")) {
        let words: Vec<&str> = declaration.split_whitespace().collect();
        assert_eq!((words[1], words[2], words[5]), ("wire", "1", "$end"), "{declaration}");
        assert_eq!(names.insert(words[3], words[4]), None, "an identifier stands for one signal");
    }
    let mut signals: BTreeMap<String, Signal> =
        names.values().map(|name| ((*name).to_owned(), Signal::default())).collect();
    let mut now_ns = 0;
    for word in body.split_whitespace() {
        match word.split_at(1) {
            ("#", time) => {
                let time: u64 = time.parse().unwrap();
                assert!(time >= now_ns, "time goes from {now_ns} back to {time}");
                now_ns = time;
            }
            ("$", _) => {}
            (value @ ("0" | "1"), id) => {
                let (name, high) = (names[id], value == "1");
                // The beginning of a pulse counts if pulses step.
                if let Some(motor) = name.strip_prefix("step_").filter(|_| high || pulse_ns.is_none()) {
                    let turned_ns = signals[&format!("direction_{motor}")].changed_ns;
                    let step = signals.get_mut(name).unwrap();
                    if step.high != high {
                        let setup_ns = now_ns - turned_ns;
                        step.shortest_setup_ns =
                            Some(step.shortest_setup_ns.map_or(setup_ns, |least| least.min(setup_ns)));
                    }
                }
                signals.get_mut(name).unwrap().set(high, now_ns);
            }
            _ => panic!("{word:?} is no change of a signal"),
        }
    }
    signals
}

/// A job's waveform, against its summary; without a pulse's length each edge is a step.
#[track_caller]
fn check(job: &[u8], profile: &str, names: [&str; 4], pulse_ns: Option<u64>) {
    let directory = directory();
    let (job, vcd) = (file(&directory, "job.gcode", job), directory.path().join("out.vcd"));
    let outcome = ferrostep([
        "print".as_ref(),
        job.as_os_str(),
        "--profile".as_ref(),
        profile.as_ref(),
        "--json".as_ref(),
        "--vcd".as_ref(),
        vcd.as_os_str(),
    ]);
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    let summary = outcome.json();
    let signals = read(&std::fs::read_to_string(vcd).unwrap(), pulse_ns);
    for (axis, name) in ["x", "y", "z", "e"].into_iter().zip(names) {
        let signal = &signals[&format!("step_{name}")];
        assert!(signal.rising_edges > 0, "{name} does not move");
        if pulse_ns.is_some() {
            assert_eq!(summary["motor_steps"][axis], signal.rising_edges, "{name}");
            assert!(!signal.high, "{name} stays high");
            assert_eq!(signal.shortest_high_ns, pulse_ns, "{name}");
            assert!(signal.shortest_low_ns >= pulse_ns, "{name}: {signal:?}");
        } else {
            assert_eq!(summary["motor_steps"][axis], signal.edges, "{name}");
            // Events are 2 us apart; times are cut to the nanosecond.
            assert!(signal.shortest_high_ns.min(signal.shortest_low_ns) >= Some(1_999), "{name}: {signal:?}");
        }
        // 0.2 us in the profile with pulses, 0.1 us in the other; times are cut to the nanosecond.
        let setup_ns = if pulse_ns.is_some() { 199 } else { 99 };
        assert!(signal.shortest_setup_ns >= Some(setup_ns), "{name}: {signal:?}");
        assert!(signals[&format!("direction_{name}")].rising_edges > 0, "{name} never turns round");
    }
    assert_eq!(signals.len(), 8);
}

/// The first layer of a cube.
#[test]
fn the_waveform_has_the_steps_of_a_sliced_file() {
    let text = String::from_utf8(example("cube.gcode")).unwrap();
    let layer: String = text.split_inclusive('\n').take(900).collect();
    check(layer.as_bytes(), "cartesian", ["x", "y", "z", "e"], Some(1000));
}

#[test]
fn the_waveform_names_corexy_motors_a_and_b() {
    let job = "G28\nM302 P1\nG1 X100 Y120 Z5 F30000\nG2 I10 J5 E3\nG1 X200 Y50 Z2 E1\n";
    check(job.as_bytes(), "corexy", ["a", "b", "z", "e"], None);
}

/// A part of the waveform has the changes that all of it has there, and begins with the
/// levels of that time.
#[test]
fn a_part_of_the_waveform_is_cut_out_of_it() {
    let directory = directory();
    let job = file(&directory, "job.gcode", "G28\nG1 X100 Y40 F6000\nG1 X20 Y90\n");
    let waveform = |name: &str, window: &[&str]| {
        let out = directory.path().join(name);
        let mut arguments = vec!["print", job.to_str().unwrap(), "--vcd", out.to_str().unwrap()];
        arguments.extend(window);
        let outcome = ferrostep(&arguments);
        assert_eq!(outcome.status, Some(0), "{outcome:#?}");
        std::fs::read_to_string(out).unwrap()
    };
    let (all, part) = (waveform("all.vcd", &[]), waveform("part.vcd", &["--from", "9.1", "--to", "9.25"]));
    let time = |line: &str| line.strip_prefix('#').map(|time| time.parse::<u64>().unwrap());
    let inside = |line: &&str| time(line).is_some_and(|time| (9_100_000_000..9_250_000_000).contains(&time));
    let expected: Vec<_> = all.lines().filter(inside).collect();
    assert!(expected.len() > 100, "{}", expected.len());
    let body = part.split_once("$enddefinitions $end\n").unwrap().1;
    let (start, changes) = body.split_once("$end\n").unwrap();
    assert_eq!(start.lines().next(), Some("#9100000000"));
    assert!(all.ends_with(changes) || all.contains(changes), "the part is a piece of the whole");
    assert_eq!(changes.lines().filter(|line| line.starts_with('#')).collect::<Vec<_>>(), expected);
    // The levels at its beginning are those after the changes before.
    let before: String = all
        .lines()
        .take_while(|line| time(line).is_none_or(|time| time < 9_100_000_000))
        .fold(String::new(), |text, line| text + line + "\n");
    for level in start.lines().skip(2) {
        let last = before.lines().rev().find(|line| line.len() == 2 && line.ends_with(&level[1..]));
        assert_eq!(last, Some(level));
    }
    let outcome = ferrostep(["print", job.to_str().unwrap(), "--vcd", "x", "--from", "3", "--to", "2"]);
    assert_eq!(outcome.status, Some(2), "{outcome:#?}");
    assert!(outcome.stderr.contains("--to 2: the waveform ends before it begins"), "{outcome:#?}");
}

/// Lines and layers are parts of the waveform as well: a line's part has its steps, one after the
/// other they make up the whole.
#[test]
fn a_part_of_the_waveform_is_told_by_lines_or_layers() {
    let directory = directory();
    let text =
        "G28\nM302 P1\n;LAYER_CHANGE\nG1 X100 Y40 E2 F6000\nG2 X60 Y60 R30\n;LAYER_CHANGE\nG1 Z.4\nG1 X20 Y90 E1\n";
    let job = file(&directory, "job.gcode", text);
    let waveform = |window: &[&str]| {
        let out = directory.path().join("out.vcd");
        let mut arguments = vec!["print", job.to_str().unwrap(), "--vcd", out.to_str().unwrap()];
        arguments.extend(window);
        let outcome = ferrostep(&arguments);
        assert_eq!(outcome.status, Some(0), "{outcome:#?}");
        (std::fs::read_to_string(out).unwrap(), outcome.stderr)
    };
    // Beginnings of pulses of all motors.
    let steps = |text: &str| -> usize {
        let body = text.split_once("$enddefinitions $end").unwrap().1;
        let changes = body.split_once("$end\n").map_or(body, |(_, changes)| changes);
        changes.lines().filter(|line| ["1!", "1\"", "1#", "1$"].contains(line)).count()
    };
    let part = |window: &[&str]| steps(&waveform(window).0);
    let all = part(&[]);
    let homing = part(&["--to", "line:3"]);
    let [first, arc, second] = [["line:4", "line:4"], ["line:5", "line:5"], ["line:6", "line:8"]]
        .map(|[from, to]| part(&["--from", from, "--to", to]));
    assert!(first > 5000 && arc > 1000 && second > 3000 && homing > 1000, "{homing} {first} {arc} {second}");
    assert_eq!(homing + first + arc + second, all);
    let (line, _) = waveform(&["--from", "line:4", "--to", "line:4"]);
    let signals = read(&line, Some(1000));
    let moved = |name: &str| signals[&format!("step_{name}")].rising_edges;
    // 100 mm in X, 80 steps a mm.
    assert_eq!((moved("x"), moved("z")), (8000, 0), "{signals:#?}");
    assert!(moved("e") > 0, "{signals:#?}");
    assert_eq!(part(&["--from", "layer:1", "--to", "layer:1"]), first + arc);
    assert_eq!(part(&["--from", "layer:2"]), second);
    assert_eq!(part(&["--from", "layer:2", "--to", "layer:2"]), second);
    assert_eq!(part(&["--from", "line:5", "--to", "99"]), arc + second);
    let (empty, said) = waveform(&["--from", "line:700"]);
    assert_eq!(steps(&empty), 0);
    assert!(said.contains("no motion lies in the waveform's part"), "{said}");

    std::fs::write(directory.path().join("flat.gcode"), "G28\nG1 X5\n").unwrap();
    for (file, window, reason) in [
        ("job.gcode", ["--from=layer:3", "--to=layer:4"], "layer:3: "),
        (
            "job.gcode",
            ["--from=line:5", "--to=line:4"],
            "--to line:4: the waveform ends before it begins (--from line:5)",
        ),
        ("job.gcode", ["--from=layer:2", "--to=layer:1"], "--to layer:1: the waveform ends before it begins"),
        ("flat.gcode", ["--from=layer:1", "--to=layer:1"], "no comment of "),
        (
            "job.gcode",
            ["--from=row:3", "--to=4"],
            "expected seconds, 0 or more, as 12.5, a line, as line:120, or a layer",
        ),
        ("-", ["--from=layer:1", "--to=4"], "it must be a file: give lines or seconds"),
    ] {
        let path = directory.path().join(file);
        let file = if file == "-" { "-" } else { path.to_str().unwrap() };
        let out = directory.path().join("refused.vcd");
        let outcome = ferrostep(["print", file, "--vcd", out.to_str().unwrap(), window[0], window[1]]);
        assert_eq!(outcome.status, Some(2), "{outcome:#?}");
        assert!(outcome.stderr.contains(reason) && !out.exists(), "{outcome:#?}");
    }
}
