//! The book's page of benchmarks: its tables and its chart, from the committed counts.

use std::fmt::Write;

use serde_json::Value;

use super::chart::{self, Bar, Group};
use super::cycle_model::events_per_s;
use super::figures::{number, shown};
use super::per_event::{FAST_STEPS_PER_S, MOST_BREAKPOINTS_PER_S};
use super::{desk, lines};
use crate::generated::Page;
use crate::steps::Failure;
use crate::system;

/// The page with the tables.
const PAGE: Page = Page { path: "docs/src/benchmarks.md", command: "cargo xtask bench --save-baseline" };
const CHART: &str = "docs/src/images/step-interrupt.svg";

/// Klipper's step, instructions: one motor, and each of two or more (counted by
/// executing its image).
const KLIPPER_ONE_MOTOR: f64 = 33.0;
const KLIPPER_EACH_OF_MANY: f64 = 50.0;

/// Steps a second by its own benchmark on an STM32F407: one motor, three motors.
const KLIPPER_ONE_MOTOR_PER_S: f64 = 3_652e3;
const KLIPPER_THREE_MOTORS_PER_S: f64 = 2_459e3;

/// Steps a second of one motor while four move, from Klipper's own cycle constants at 168 MHz.
const MARLIN_FOUR_AXES_PER_S: f64 = 143.6e3;

/// Writes tables and chart.
pub fn write(figures: &Value) -> Result<(), Failure> {
    PAGE.write(&tables(figures))?;
    let chart = system::root().join(CHART);
    std::fs::write(&chart, step_chart(figures)).map_err(|error| format!("{}: {error}", chart.display()))
}

/// A count by its key in `target.step_event`, if there is one.
fn event(figures: &Value, key: &str) -> Option<f64> {
    number(figures, &format!("target.step_event.{key}"))
}

/// Thousands a second.
fn thousands(per_s: Option<f64>) -> String {
    shown(per_s.map(|per_s| (per_s / 1000.0).round()))
}

/// The generated part of the page.
fn tables(figures: &Value) -> String {
    let mut out = String::new();
    // Writing to a string does not fail.
    let _ = step_interrupt(&mut out, figures);
    let _ = steps_per_second(&mut out, figures);
    let _ = line_to_queue(&mut out, figures);
    let _ = shaped(&mut out, figures);
    let _ = lines::tables(&mut out, figures);
    let _ = estimates(&mut out, figures);
    let _ = image(&mut out, figures);
    out.trim_end().to_owned() + "\n"
}

fn step_interrupt(out: &mut String, figures: &Value) -> std::fmt::Result {
    writeln!(out, "## The step interrupt\n")?;
    writeln!(out, "![Instructions of an event that steps motors](images/step-interrupt.svg)\n")?;
    writeln!(
        out,
        "Instructions from vector to return; keys are those of `target.step_event`. A step is an event, for drivers \
         that step at\nboth edges. With pulses, as in the firmware's profile, it is two: then Klipper takes 81 \
         instructions with one motor, 115\neach with more.\n"
    )?;
    writeln!(out, "| event | key | Ferrostep | Klipper |\n|---|---|---|---|")?;
    let (one, three) = (shown(Some(KLIPPER_ONE_MOTOR)), format!("three: {}", shown(Some(3.0 * KLIPPER_EACH_OF_MANY))));
    let rows = [
        ("inside a stair, one motor", "within_stair_1_axis", one.as_str()),
        ("the one of these with most to do", "most_within_stair_1_axis", ""),
        ("ends a stair, fetches the next, one motor", "new_stair_1_axis", &one),
        ("inside a stair, four motors at once", "within_stair_4_axes", &three),
        ("ends a stair, fetches the next, four motors at once", "new_stair_4_axes", &three),
        ("is a stair alone, four motors at once", "single_event_stair_4_axes", &three),
        ("inside a stair, motors on two ports", "two_ports.within_stair", ""),
        ("ends a stair, motors on two ports", "two_ports.new_stair", ""),
        ("inside a stair, motors on three ports", "three_ports.within_stair", ""),
        ("ends a stair, motors on three ports", "three_ports.new_stair", ""),
        ("inside a stair, an edge of the firmware's profile", "profile.within_stair", ""),
        ("ends a stair, an edge of the firmware's profile", "profile.new_stair", ""),
        ("starts a motion, before its first event", "start_of_motion", ""),
        ("ends a motion", "end_of_motion", ""),
        ("mean of a real print", "mean", ""),
    ];
    for (what, key, klipper) in rows {
        writeln!(out, "| {what} | `{key}` | {} | {klipper} |", shown(event(figures, key)))?;
    }
    writeln!(
        out,
        "| the most in a real print, but for its start and end | `worst` | {} | |\n",
        shown(event(figures, "worst"))
    )
}

/// The highest rates, by the events' pattern. Three and four motors share a row if another
/// motor costs nothing.
fn steps_per_second(out: &mut String, figures: &Value) -> std::fmt::Result {
    writeln!(out, "## Steps a second\n")?;
    writeln!(
        out,
        "A model until silicon confirms it: at 168 MHz 12 cycles to enter the interrupt, 10 to leave it, and 1.4 an \
         instruction\n(what Klipper's 46 cycles for 33 instructions come to). All motors of a port step with one \
         store, so steps are events\ntimes motors. This is the mean rate that the processor could keep up, doing nothing \
         else; single events may be no nearer\nthan [1 us](stepping.md#the-reload-value-in-time). In thousands of steps \
         a second:\n"
    )?;
    writeln!(out, "| motors at once | inside a stair | each event a stair | others |\n|---|---|---|---|")?;
    let others = [
        (1.0, "1_axis", format!("Klipper {}", thousands(Some(KLIPPER_ONE_MOTOR_PER_S)))),
        (3.0, "4_axes", format!("Klipper {}", thousands(Some(KLIPPER_THREE_MOTORS_PER_S)))),
        (4.0, "4_axes", format!("Marlin {} events", thousands(Some(MARLIN_FOUR_AXES_PER_S)))),
    ];
    for (motors, axes, others) in others {
        let ways = [
            event(figures, &format!("within_stair_{axes}")).map(events_per_s),
            event(figures, "single_event_stair_4_axes").map(events_per_s),
        ];
        write!(out, "| {motors} | ")?;
        for events in ways {
            write!(out, "{} | ", thousands(events.map(|events| events * motors)))?;
        }
        writeln!(out, "{others} |")?;
    }
    writeln!(
        out,
        "\nKlipper's figures are measured, by its own benchmark on an STM32F407 at 168 MHz. Marlin's follow from its own\n\
         cycle constants at the same frequency (one step an interrupt; 97.8 with linear advance and input shaping). \
         grblHAL's,\n400 on an STM32F446, were seen on an oscilloscope.\n"
    )
}

fn line_to_queue(out: &mut String, figures: &Value) -> std::fmt::Result {
    writeln!(out, "## From a line to the step queue\n")?;
    writeln!(out, "| part | key | instructions | goal |\n|---|---|---|---|")?;
    let rows = [
        ("read and parse a line of the cube", "parse_line", ""),
        ("the same lines' text to a block in the full ring", "line_to_block", ""),
        ("their moves alone to a block, reverse pass included", "block_full_look_ahead", ""),
        ("a step event of a long trapezoid: X, Y, filament", "interpolate_per_step_trapezoid", "90"),
        ("the same along X: one motor and filament", "interpolate_per_step_trapezoid_one_axis", "90"),
        ("a G0 or G1 of a whole print, from bytes to queue", "line_to_queue_mean", "12 000"),
        ("of these: to read and parse it", "line_to_queue.parse", ""),
        ("to plan it", "line_to_queue.plan", ""),
        ("to make its events", "line_to_queue.interpolate", ""),
        ("the last for each event", "line_to_queue.interpolate_per_event", ""),
        ("a move of the gyroid's infill, from a line to a block with its speeds", "gpre.line_to_block", ""),
        ("the same prepared, compact, checks included", "gpre.compact_to_block", "a fifth"),
        ("the same in the paper's packets", "gpre.wide_to_block", ""),
        ("the first to the queue", "gpre.line_to_queue", ""),
        ("the second", "gpre.compact_to_queue", ""),
        ("the third", "gpre.wide_to_queue", ""),
    ];
    for (what, key, goal) in rows {
        let count = shown(number(figures, &format!("target.{key}")));
        writeln!(out, "| {what} | `target.{key}` | {count} | {goal} |")?;
    }
    let workload = |key: &str| shown(number(figures, &format!("workload.print.{key}")));
    writeln!(
        out,
        "\nThe print is `examples/gyroid.gcode.gz` at 80 steps/mm: {} lines with G0 or G1, {} entries in the\nqueue, {} \
         step events.\n",
        workload("moves"),
        workload("entries"),
        workload("events"),
    )
}

/// Writes the part on shaped motion, if it was counted.
fn shaped(out: &mut String, figures: &Value) -> std::fmt::Result {
    let count = |key: &str| number(figures, &format!("target.shaped.{key}"));
    if count("per_step").is_none() {
        return Ok(());
    }
    writeln!(out, "## Shaped motion\n")?;
    writeln!(
        out,
        "A line of 20 mm at 300 mm/s and 10,000 mm/s² through [filters](input-shaping.md), MZV at 50 Hz in X and 40 Hz in Y: \
         X, Y\nand filament, from the popped block to entries in the queue (`target.shaped`). Every motor steps at its own time.\n"
    )?;
    writeln!(out, "| part | key | instructions | goal |\n|---|---|---|---|")?;
    let rows = [
        ("a motor's step: its time, and merging it with the others'", "per_step", "120"),
        (
            "a breakpoint, where one of seven delays comes to another piece of the plan",
            "per_breakpoint",
            "616: 264 for three of them",
        ),
        ("a block to pieces of the plan", "begin_line", ""),
        ("the line at 160 steps/mm, all of it", "line", ""),
        ("the same on CoreXY", "line_core_xy", ""),
    ];
    for (what, key, goal) in rows {
        writeln!(out, "| {what} | `{key}` | {} | {goal} |", shown(count(key)))?;
    }
    writeln!(
        out,
        "\nBy the model above, with 14 cycles for each square root and division, steps take {} % of 168 MHz at {} a second (goal: \
         25 %), each\na separate interrupt (`percent_at_140k_steps`). The shortest moves that the plan lets through make {} \
         breakpoints a second, which take\n{} % (`percent_of_most_breakpoints`).\n",
        shown(count("percent_at_140k_steps")),
        shown(Some(FAST_STEPS_PER_S)),
        shown(Some((MOST_BREAKPOINTS_PER_S / 100.0).round() * 100.0)),
        shown(count("percent_of_most_breakpoints")),
    )
}

fn estimates(out: &mut String, figures: &Value) -> std::fmt::Result {
    writeln!(out, "## Estimates on the desk\n")?;
    writeln!(
        out,
        "Instructions of `ferrostep estimate` on x86-64, from the process's start to its end, as valgrind counts them \
         (`desk.estimate`).\n"
    )?;
    writeln!(out, "| file | key | instructions | a line |\n|---|---|---|---|")?;
    for name in desk::FILES {
        let key = desk::key(name);
        let count = |what: &str| shown(number(figures, &format!("desk.estimate.{key}.{what}")));
        writeln!(out, "| `examples/{name}` | `{key}` | {} | {} |", count("instructions"), count("a_line"))?;
    }
    writeln!(out)
}

fn image(out: &mut String, figures: &Value) -> std::fmt::Result {
    let bytes = |key: &str| shown(number(figures, &format!("image.{key}")));
    writeln!(out, "## The image\n")?;
    writeln!(out, "| text | data | bss |\n|---|---|---|")?;
    writeln!(out, "| {} | {} | {} |\n", bytes("text"), bytes("data"), bytes("bss"))?;
    let compiler = figures.get("compiler").and_then(Value::as_str).unwrap_or("an unknown compiler");
    writeln!(out, "Bytes of the firmware. All figures of this page are of code by `{compiler}`.")
}

fn step_chart(figures: &Value) -> String {
    let bar = |label: &str, instructions: Option<f64>, own| {
        Some(Bar { label: label.to_owned(), instructions: instructions?, own })
    };
    let group = |heading: &str, axes: &str, klipper| {
        let count = |sort: &str| event(figures, &format!("{sort}_stair_{axes}"));
        let bars = [
            bar("Ferrostep, inside a stair", count("within"), true),
            bar("Ferrostep, a new stair", count("new"), true),
            bar("Klipper", Some(klipper), false),
        ];
        Group { heading: heading.to_owned(), bars: bars.into_iter().flatten().collect() }
    };
    let groups = [
        group("One motor steps", "1_axis", KLIPPER_ONE_MOTOR),
        group("Three motors step at the same instant", "4_axes", 3.0 * KLIPPER_EACH_OF_MANY),
    ];
    chart::svg("Instructions of an event that steps motors", &groups)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::baseline;
    use super::*;
    use serde_json::json;

    #[test]
    fn page_and_chart_show_the_committed_counts() {
        let figures = baseline::read().unwrap();
        let page = PAGE.read().unwrap();
        assert!(
            PAGE.replaced(&page, &tables(&figures)).as_ref() == Ok(&page),
            "`{}` writes {}",
            PAGE.command,
            PAGE.path
        );
        let chart = std::fs::read_to_string(system::root().join(CHART)).unwrap();
        assert!(chart == step_chart(&figures), "`cargo xtask bench --save-baseline` writes {CHART}");
    }

    #[test]
    fn shaped_motion_has_its_section_where_it_is_counted() {
        assert!(!tables(&json!({})).contains("Shaped"));
        let figures = json!({"target": {"shaped": {"per_step": 110.4, "percent_at_140k_steps": 24.1}}});
        let tables = tables(&figures);
        assert!(tables.contains("| `per_step` | 110.4 | 120 |"), "{tables}");
        assert!(tables.contains("24.1 % of 168 MHz at 140 000 a second"), "{tables}");
    }

    #[test]
    fn a_count_that_is_null_is_a_dash_in_its_row() {
        let figures = json!({"target": {"step_event": {"within_stair_1_axis": 17, "new_stair_1_axis": null}}});
        let tables = tables(&figures);
        assert!(tables.contains("| `within_stair_1_axis` | 17 | 33 |"), "{tables}");
        assert!(tables.contains("| `new_stair_1_axis` | - | 33 |"), "{tables}");
        // 168 MHz / (22 + 1.4 * 17) cycles.
        assert!(tables.contains("| 1 | 3 668 | - | Klipper 3 652 |"), "{tables}");
    }
}
