//! Lines of two axes: instructions from one build of the bench, entries from the other, and the
//! book's tables of both.

use std::fmt::Write;

use serde_json::{Value, json};

use super::figures::{number, shown};
use crate::steps::Failure;

/// Wu 2024, tables 1 to 5: the line, its key, and the factor by which the classic
/// algorithm took longer.
const WU_LINES: [(&str, &str, &str); 5] = [
    ("y = x/3, (30, 10)", "x3", "1.23"),
    ("y = x/10, (100, 10)", "x10", "1.56"),
    ("y = x/50, (500, 10)", "x50", "1.96"),
    ("y = x/100, (1000, 10)", "x100", "2.92"),
    ("y = x, (30, 30)", "x1", "1.00"),
];

/// The queues to which Wu's lines are drawn.
const KINDS: [&str; 2] = ["bresenham", "bresenham_pulses"];

/// The methods that draw lines of every slope.
const WAYS: [&str; 3] = ["classic", "classic_coalesced", "step"];

/// The steepest of these lines that the book shows: those above mirror those below.
const MOST_SHOWN_DY: f64 = 55.0;

/// Takes the lines' entries and decisions out of the workload and puts them beside the
/// lines' instructions.
pub fn join(target: &mut Value, workload: &mut Value) -> Result<(), Failure> {
    let missing = || "the bench told nothing of its lines".to_owned();
    let workload = workload.as_object_mut().ok_or_else(missing)?;
    for kind in KINDS {
        let wu = workload.remove(kind).ok_or_else(missing)?;
        join_wu(target.get_mut(kind).ok_or_else(missing)?, &wu)?;
    }
    let slopes = workload.remove("bresenham_slopes").ok_or_else(missing)?;
    let lines = target.get_mut("bresenham_slopes").and_then(Value::as_array_mut).ok_or_else(missing)?;
    let told = slopes.as_array().filter(|told| told.len() == lines.len()).ok_or_else(missing)?;
    for (line, told) in lines.iter_mut().zip(told) {
        for way in WAYS {
            let cost = line.get_mut(way).and_then(Value::as_object_mut).ok_or_else(missing)?;
            cost.extend(told.get(way).and_then(Value::as_object).ok_or_else(missing)?.clone());
        }
    }
    Ok(())
}

/// The same for one kind of queue.
fn join_wu(lines: &mut Value, told: &Value) -> Result<(), Failure> {
    let missing = || "the bench told nothing of its lines".to_owned();
    for (_, key, _) in WU_LINES {
        let line = lines.get_mut(key).and_then(Value::as_object_mut).ok_or_else(missing)?;
        let ways: Vec<String> = line.keys().cloned().collect();
        for what in ["entries", "decisions"] {
            let counts =
                ways.iter().map(|way| Some((way.clone(), told.pointer(&format!("/{key}/{way}/{what}"))?.clone())));
            let counts: Option<serde_json::Map<_, _>> = counts.collect();
            line.insert(what.to_owned(), json!(counts.ok_or_else(missing)?));
        }
    }
    Ok(())
}

/// The tables.
pub fn tables(out: &mut String, figures: &Value) -> std::fmt::Result {
    writeln!(out, "## Step Bresenham\n")?;
    wu_lines(out, figures)?;
    rules(out, figures)?;
    slopes(out, figures)
}

/// The quotient, with two decimals.
fn ratio(count: Option<f64>, by: Option<f64>) -> String {
    count.zip(by).map_or("-".to_owned(), |(count, by)| format!("{:.2}", count / by))
}

fn wu_lines(out: &mut String, figures: &Value) -> std::fmt::Result {
    writeln!(
        out,
        "Wu's five lines, instructions from end point to entries in the step queue, which takes them as they are \
         made. His ratio\n(tables 1 to 5) is of run times in MATLAB, classic to step. For drivers that step at both edges, as \
         the TMC2209 of\nprinter boards (`target.bresenham`):\n"
    )?;
    wu_table(out, figures, "bresenham")?;
    writeln!(
        out,
        "\nThe same with pulses (`target.bresenham_pulses`), where the last step of a stair takes another slot of the \
         queue,\nwhoever makes the stair:\n"
    )?;
    wu_table(out, figures, "bresenham_pulses")?;
    writeln!(out)
}

fn wu_table(out: &mut String, figures: &Value, kind: &str) -> std::fmt::Result {
    writeln!(
        out,
        "| line | classic, an entry a step | classic, equal steps in one entry | step | classic to step | coalesced to \
         step | Wu's ratio |"
    )?;
    writeln!(out, "|---|---|---|---|---|---|---|")?;
    for (line, key, wu_ratio) in WU_LINES {
        let [classic, coalesced, step] = WAYS.map(|way| number(figures, &format!("target.{kind}.{key}.{way}")));
        let ratios = [ratio(classic, step), ratio(coalesced, step)].join(" | ");
        let counts = [classic, coalesced, step].map(shown).join(" | ");
        writeln!(out, "| {line} | {counts} | {ratios} | {wu_ratio} |")?;
    }
    Ok(())
}

fn rules(out: &mut String, figures: &Value) -> std::fmt::Result {
    writeln!(
        out,
        "The rules for a stair's width, and the decision values that each compares with zero \
         (`target.bresenham.*.decisions`).\nA division a stair is what the column *step* above has, and the firmware. Drivers that step at both edges.\n"
    )?;
    writeln!(
        out,
        "| line | decisions, classic | from the first stair (corollary 2) | from the quotient (corollary 1) | \
         instructions, first stair | quotient | a division a stair |"
    )?;
    writeln!(out, "|---|---|---|---|---|---|---|")?;
    for (line, key, _) in WU_LINES {
        let count = |key_in_line: &str| shown(number(figures, &format!("target.bresenham.{key}.{key_in_line}")));
        let decisions = ["classic", "step_first_stair", "step_quotient"].map(|way| count(&format!("decisions.{way}")));
        let instructions = ["step_first_stair", "step_quotient", "step"].map(count);
        writeln!(out, "| {line} | {} | {} |", decisions.join(" | "), instructions.join(" | "))?;
    }
    writeln!(out)
}

fn slopes(out: &mut String, figures: &Value) -> std::fmt::Result {
    writeln!(
        out,
        "Lines of every slope, from (0, 0) to (100, dy), the same three ways (`target.bresenham_slopes`), for drivers \
         that step at\nboth edges: instructions / entries. Above 1/2 step Bresenham's stairs are the complement's: counts mirror those \
         below.\n"
    )?;
    writeln!(out, "| dy | classic, an entry a step | classic, equal steps in one entry | step | coalesced to step |")?;
    writeln!(out, "|---|---|---|---|---|")?;
    let lines = figures.pointer("/target/bresenham_slopes").and_then(Value::as_array);
    for line in lines.into_iter().flatten() {
        let dy = number(line, "dy");
        if dy.is_some_and(|dy| dy > MOST_SHOWN_DY) {
            continue;
        }
        let counts = WAYS.map(|way| {
            ["instructions", "entries"].map(|count| shown(number(line, &format!("{way}.{count}")))).join(" / ")
        });
        let [coalesced, step] = [WAYS[1], WAYS[2]].map(|way| number(line, &format!("{way}.instructions")));
        writeln!(out, "| {} | {} | {} |", shown(dy), counts.join(" | "), ratio(coalesced, step))?;
    }
    writeln!(out)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn counted() -> (Value, Value) {
        let mut target = json!({"bresenham_slopes": [{"dy": 7}]});
        let mut workload = json!({"bresenham_slopes": [{}]});
        for way in WAYS {
            for (_, key, _) in WU_LINES {
                for (kind, cost) in KINDS.into_iter().zip([300, 400]) {
                    target[kind][key][way] = json!(cost);
                    workload[kind][key][way] = json!({"entries": 11, "decisions": 10});
                }
            }
            target["bresenham_slopes"][0][way] = json!({"instructions": 200});
            workload["bresenham_slopes"][0][way] = json!({"entries": 8, "decisions": 7});
        }
        (target, workload)
    }

    #[test]
    fn counts_of_two_builds_are_combined() {
        let (mut target, mut workload) = counted();
        join(&mut target, &mut workload).unwrap();
        assert_eq!(workload, json!({}));
        assert_eq!(target["bresenham"]["x3"]["step"], json!(300));
        assert_eq!(target["bresenham"]["x3"]["decisions"]["step"], json!(10));
        let cost = json!({"instructions": 200, "entries": 8, "decisions": 7});
        assert_eq!(
            target["bresenham_slopes"][0],
            json!({"dy": 7, "classic": cost, "classic_coalesced": cost, "step": cost})
        );
        let mut out = String::new();
        tables(&mut out, &json!({"target": target})).unwrap();
        assert!(out.contains("| 7 | 200 / 8 | 200 / 8 | 200 / 8 | 1.00 |"), "{out}");
        for cost in [300, 400] {
            let row = format!("| y = x/3, (30, 10) | {cost} | {cost} | {cost} | 1.00 | 1.00 | 1.23 |");
            assert!(out.contains(&row), "{out}");
        }
    }

    #[test]
    fn a_line_without_counts_is_an_error() {
        let (target, workload) = counted();
        for missing in ["bresenham", "bresenham_pulses", "bresenham_slopes"] {
            let mut less = workload.clone();
            less.as_object_mut().unwrap().remove(missing);
            assert!(join(&mut target.clone(), &mut less).is_err());
        }
        let mut fewer = workload.clone();
        fewer["bresenham_slopes"] = json!([]);
        assert!(join(&mut target.clone(), &mut fewer).is_err());
        assert!(join(&mut json!({}), &mut workload.clone()).is_err());
    }
}
