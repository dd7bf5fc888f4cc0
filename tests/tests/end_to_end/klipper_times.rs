//! Print times by Klipper's rules beside those of Klipper's own look-ahead, for five imported
//! machines and the ten examples.
//!
//! `times.csv` is the output of `tests/hosts/klipper_times.py`, which says how.

use ferrostep_random_cases::share_of;

use crate::end_to_end::command::{directory, ferrostep, file, repository};

/// Maximum difference, as a share of Klipper's time.
const MOST_OFF: f64 = 1e-5;

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
        let directory = directory();
        let profile = file(&directory, "machine.toml", &imported.profile);
        let plain = repository().join(format!("examples/{job}.gcode"));
        let path = if plain.exists() { plain } else { repository().join(format!("examples/{job}.gcode.gz")) };
        let outcome = ferrostep([
            "estimate".as_ref(),
            path.as_os_str(),
            "--profile".as_ref(),
            profile.as_os_str(),
            "--json".as_ref(),
        ]);
        assert_eq!(outcome.status, Some(0), "{machine} {job}: {outcome:#?}");
        let summary = outcome.json();
        assert_eq!(summary["rules"], "klipper", "{machine} {job}");
        let (here, there): (f64, f64) = (summary["motion_time_s"].as_f64().unwrap(), seconds.parse().unwrap());
        let off = here / there - 1.0;
        assert!(off.abs() <= MOST_OFF, "{machine} {job}: {here} s, Klipper {there} s: {off:e}");
        // Every second of motion has its limit.
        let limits = summary["limits"].as_array().unwrap();
        let of_limits: f64 = limits.iter().map(|limit| limit["seconds"].as_f64().unwrap()).sum();
        assert!((of_limits / here - 1.0).abs() < 1e-9, "{machine} {job}: {of_limits} s of {here} s");
    }
}
