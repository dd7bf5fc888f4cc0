#![allow(clippy::unwrap_used)]
use super::*;

#[test]
fn a_key_is_set_where_it_stands_or_added() {
    let mut table: Table = "a = { x = 1 }\n[b]\nc = 2".parse().unwrap();
    set(&mut table, "a.x", 3.0).unwrap();
    set(&mut table, "b.d.e", 0.5).unwrap();
    set(&mut table, "f", 1e20).unwrap();
    let expected: Table = "f = 1e20\na = { x = 3 }\n[b]\nc = 2\n[b.d]\ne = 0.5".parse().unwrap();
    assert_eq!(table, expected);
    assert_eq!(set(&mut table, "f.g", 1.0).unwrap_err(), "f.g: \"f\" is not a table of the profile");
}

#[test]
fn what_a_job_sets_itself_is_left_out_where_it_would_hold_over_the_values() {
    let commands =
        |keys: &[&str]| format!("{:?}", dropped(&keys.iter().map(|&key| key.to_owned()).collect::<Vec<_>>()));
    let (limits, filters, both) = (
        commands(&["acceleration_mm_per_s2.print"]),
        commands(&["input_shaper.x.frequency_hz"]),
        commands(&["pressure_advance.seconds", "junction_deviation_mm"]),
    );
    assert!(limits.contains("M204") && !limits.contains("M593"));
    assert!(filters.contains("M593") && !filters.contains("M204"));
    assert!(both.contains("M900") && both.contains("M205"));
}
