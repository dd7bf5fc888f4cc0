//! Over whole prints the extruder is never more than a step away from lambda s(t) by the
//! machine's time law, ramps included; an extruder that steps with the leading motor, in the same
//! blocks, is farther off.

use std::fs::{self, File};

use ferrostep_oracle::reference::ReferenceProfile;
use ferrostep_oracle::trace_check::{Extrusion, TraceCheckOptions, check_trace};

use crate::end_to_end::command::{directory, example, ferrostep, repository};
use crate::end_to_end::papers::REFRESH_VARIABLE;

/// Marks before and after the table in the book.
const BEGIN: &str = "<!-- both extruders over whole prints -->\n";
const END: &str = "<!-- end -->\n";

/// Prints an example and compares its extruder, and a slaved one, with the law.
#[track_caller]
fn print(name: &str) -> Extrusion {
    let directory = directory();
    let trace = directory.path().join("trace");
    let path = format!("examples/{name}");
    let arguments = ["print", &path, "--profile", "cartesian", "--json", "--trace"].map(AsRef::as_ref);
    let outcome = ferrostep(arguments.into_iter().chain([trace.as_os_str()]));
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    let options = TraceCheckOptions::default();
    let report =
        check_trace(File::open(&trace).unwrap(), &example(name), &ReferenceProfile::cartesian(), &options).unwrap();
    assert!(report.passed(), "{report}");
    report.extrusion
}

#[test]
fn an_extruder_slaved_to_the_master_is_farther_from_lambda_s() {
    let mut table =
        "| file | blocks | extruder steps | by separate times: farthest off, steps | mean | with the leading \
                     motor: farthest off, steps | mean |\n|---|---|---|---|---|---|---|\n"
            .to_owned();
    for (name, least_blocks) in [("cube.gcode", 3_000), ("gyroid.gcode.gz", 50_000)] {
        let found = print(name);
        let Extrusion { blocks, own_steps, slaved_steps, own, slaved, .. } = found;
        assert!(blocks > least_blocks && found.led_by_the_extruder < blocks / 100, "{name}: {found:?}");
        // Both are on the same step at each block's end.
        assert_eq!(own_steps, slaved_steps, "{name}");
        assert!(own.largest_steps <= 1.0, "{name}: {found:?}");
        assert!(own.mean_steps() < slaved.mean_steps(), "{name}: {found:?}");
        assert!(own.largest_steps < slaved.largest_steps, "{name}: {found:?}");
        table += &format!(
            "| `{name}` | {blocks} | {own_steps} | {:.3} | {:.3} | {:.3} | {:.3} |\n",
            own.largest_steps,
            own.mean_steps(),
            slaved.largest_steps,
            slaved.mean_steps()
        );
    }
    let page = repository().join("docs/src/papers/wu.md");
    let text = fs::read_to_string(&page).unwrap();
    let (before, rest) = text.split_once(BEGIN).unwrap();
    let (kept, behind) = rest.split_once(END).unwrap();
    if std::env::var_os(REFRESH_VARIABLE).is_some() {
        fs::write(page, format!("{before}{BEGIN}\n{table}\n{END}{behind}")).unwrap();
    } else {
        assert!(
            kept.trim() == table.trim(),
            "the table has changed: look at it, then set {REFRESH_VARIABLE} to keep it\n{table}"
        );
    }
}
