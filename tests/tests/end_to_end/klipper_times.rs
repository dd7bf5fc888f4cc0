//! Print times by profiles of `ferrostep import` beside those of Klipper's own look-ahead, for five
//! machines and the ten examples.
//!
//! `times.csv` is the output of `tests/hosts/klipper_times.py`, whose text lists the
//! changes in the jobs.

use std::f64::consts::TAU;
use std::fmt::Write;

use ferrostep_random_cases::share_of;

use crate::end_to_end::command::{directory, example, ferrostep, file, repository};

/// Maximum difference, as a share of Klipper's time.
const MOST_OFF: f64 = 0.003;

/// Length of the chords into which Klipper cuts arcs, mm.
const CHORD_MM: f64 = 1.0;

#[test]
fn imported_profiles_take_klippers_times() {
    let folder = repository().join("tests/cases/klipper-times");
    let times = std::fs::read_to_string(folder.join("times.csv")).unwrap();
    let rows: Vec<Vec<&str>> = times.lines().skip(1).map(|line| line.split(',').collect()).collect();
    assert_eq!(rows.len(), 50);
    // The first one in every run, and this run's share of the others.
    for index in std::iter::once(0).chain(share_of(rows.len() as u64 - 1).map(|index| index as usize + 1)) {
        let [machine, job, seconds] = rows[index][..] else { panic!("{:?}", rows[index]) };
        let imported = ferrostep_import::read(&folder.join(format!("{machine}.cfg")), false).unwrap();
        let table: toml::Table = imported.profile.parse().unwrap();
        let most = table["acceleration_mm_per_s2"]["print"].as_float().unwrap();
        let directory = directory();
        let profile = file(&directory, "machine.toml", &imported.profile);
        let plain = format!("{job}.gcode");
        let is_plain = repository().join("examples").join(&plain).exists();
        let text = String::from_utf8(example(&if is_plain { plain } else { format!("{plain}.gz") })).unwrap();
        let job_file = file(&directory, "job.gcode", klippers(&text, most));
        let outcome = ferrostep([
            "estimate".as_ref(),
            job_file.as_os_str(),
            "--profile".as_ref(),
            profile.as_os_str(),
            "--json".as_ref(),
        ]);
        assert_eq!(outcome.status, Some(0), "{machine} {job}: {outcome:#?}");
        let (here, there): (f64, f64) = (outcome.json()["motion_time_s"].as_f64().unwrap(), seconds.parse().unwrap());
        let off = here / there - 1.0;
        assert!(off.abs() <= MOST_OFF, "{machine} {job}: {here} s, Klipper {there} s: {:.2} %", off * 100.0);
    }
}

/// A job's lines as both sides get them.
fn klippers(text: &str, most_acceleration: f64) -> String {
    let mut out = String::with_capacity(text.len());
    let mut place = [0.0; 3];
    for line in text.lines().map(|line| line.split(';').next().unwrap().trim()) {
        let code = line.split_whitespace().next().unwrap_or_default();
        let word = |letter: char| {
            let text = line.split_whitespace().skip(1).find_map(|word| word.strip_prefix(letter))?;
            Some(text.parse::<f64>().unwrap())
        };
        match code {
            "M201" | "M203" | "M205" => continue,
            "M204" => {
                let acceleration = word('P').or(word('S')).unwrap().min(most_acceleration);
                writeln!(out, "M204 S{acceleration}").unwrap();
                continue;
            }
            "G2" | "G3" => {
                let end = ['X', 'Y'].map(|axis| word(axis).unwrap());
                let center = ['I', 'J'].map(|letter| word(letter).unwrap_or(0.0));
                let ends = chords([place[0], place[1]], end, center, code == "G2");
                let filament = word('E').map(|length| length / ends.len() as f64);
                for [x, y] in ends {
                    write!(out, "G1 X{x:.5} Y{y:.5}").unwrap();
                    if let Some(length) = filament {
                        write!(out, " E{length:.7}").unwrap();
                    }
                    if let Some(feed) = word('F') {
                        write!(out, " F{feed}").unwrap();
                    }
                    out.push('\n');
                }
                [place[0], place[1]] = end;
                continue;
            }
            // The only relative moves are at the end, without arcs after them.
            "G0" | "G1" => {
                for (axis, letter) in ['X', 'Y', 'Z'].into_iter().enumerate() {
                    place[axis] = word(letter).unwrap_or(place[axis]);
                }
            }
            _ => {}
        }
        writeln!(out, "{line}").unwrap();
    }
    out
}

/// The ends of the chords of an arc around a place beside its start.
fn chords(start: [f64; 2], end: [f64; 2], [i, j]: [f64; 2], is_clockwise: bool) -> Vec<[f64; 2]> {
    let center = [start[0] + i, start[1] + j];
    let to_end = [end[0] - center[0], end[1] - center[1]];
    let mut angle = (-i * to_end[1] + j * to_end[0]).atan2(-i * to_end[0] - j * to_end[1]);
    if angle < 0.0 {
        angle += TAU;
    }
    if is_clockwise {
        angle -= TAU;
    }
    if angle == 0.0 && start == end {
        angle = TAU;
    }
    let count = (i.hypot(j) * angle.abs() / CHORD_MM).floor().max(1.0) as usize;
    let place = |index: usize| {
        let (sin, cos) = (angle * index as f64 / count as f64).sin_cos();
        [center[0] - i * cos + j * sin, center[1] - i * sin - j * cos]
    };
    (1..count).map(place).chain([end]).collect()
}
