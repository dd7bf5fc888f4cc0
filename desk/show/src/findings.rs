//! The findings of a print, in words: why it stopped, the warnings of its lines, and where it
//! is fastest, longest or most.

use serde::Serialize;

use crate::totals::{Extreme, Totals};

/// Minimum wait that is reported, s.
const LEAST_WAIT_S: f64 = 0.5;

/// Maximum number of commands without effect that are named.
const MAX_COMMANDS: usize = 12;
/// Minimum time of slowed moves that a person may want to act on, s.
const LEAST_SLOWED_S: f64 = 0.05;

/// A remark about the print, with the place that it is about.
#[derive(Clone, Debug, Serialize)]
pub struct Finding {
    /// `stop`, `warning`, `note`, `extreme` or `place`.
    pub weight: &'static str,
    /// A sentence.
    pub text: String,
    /// Number of the first line that it is about.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub line: Option<u32>,
    /// Time, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_s: Option<f64>,
}

/// A remark on a job's lines.
#[derive(Clone, Copy, Debug)]
pub struct Remarked<'a> {
    /// Text of the remark.
    pub message: &'a str,
    /// Number of its lines.
    pub count: u64,
    /// The first of them.
    pub line: Option<u32>,
    /// Weight of the remark.
    pub weight: Weight,
}

/// Weight of a remark.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Weight {
    /// Moves are drawn in to the machine's edge: the part is another one.
    LostMoves,
    /// A person may want to change something.
    Warning,
    /// The part is as it should be all the same.
    Note,
    /// The lines have no effect: all such remarks are one finding.
    WithoutEffect,
}

/// Outcome of a print besides its motion.
#[derive(Clone, Debug, Default)]
pub struct Outcome<'a> {
    /// Reason for which the print stopped early, and its line.
    pub stopped: Option<(String, Option<u32>)>,
    /// Remarks on its lines and on its end.
    pub remarks: Vec<Remarked<'a>>,
    /// Moves that were slowed because the board could not keep up with them.
    pub slowed_moves: u64,
}

impl Outcome<'_> {
    /// Returns the findings that the page lists, the most important first.
    pub fn findings(&self, totals: &Totals) -> Vec<Finding> {
        let stop = self.stopped.iter().map(|(reason, line)| Finding {
            weight: "stop",
            text: format!("The print stops here: {reason}"),
            line: *line,
            time_s: None,
        });
        let of = |weight| {
            let remarks = self.remarks.iter().filter(move |one| one.weight == weight);
            remarks.map(Remarked::finding)
        };
        let slowed = slowed(self.slowed_moves, totals);
        let (slow, hardly_slow) = if totals.slowed_s >= LEAST_SLOWED_S { (slowed, None) } else { (None, slowed) };
        let retraction = first_retraction(totals);
        let warnings = of(Weight::LostMoves).chain(of(Weight::Warning)).chain(slow);
        let notes = of(Weight::Note).chain(self.without_effect()).chain(hardly_slow);
        stop.chain(warnings).chain(notes).chain(retraction).chain(extremes(totals)).collect()
    }

    /// The lines without effect, as one note.
    fn without_effect(&self) -> Option<Finding> {
        let all = || self.remarks.iter().filter(|one| one.weight == Weight::WithoutEffect);
        let count: u64 = all().map(|one| one.count.max(1)).sum();
        let mut commands: Vec<&str> = Vec::new();
        for one in all() {
            let command = one.message.split(':').next().unwrap_or_default();
            if !commands.contains(&command) {
                commands.push(command);
            }
        }
        let (shown, more) = commands.split_at(commands.len().min(MAX_COMMANDS));
        let more = if more.is_empty() { String::new() } else { format!(" and {} more", more.len()) };
        let lines = if count == 1 { "1 line has" } else { &format!("{count} lines have") };
        (count > 0).then(|| Finding {
            weight: "note",
            text: format!("{lines} no effect on this machine: {}{more}", shown.join(", ")),
            line: all().filter_map(|one| one.line).min(),
            time_s: None,
        })
    }
}

impl Remarked<'_> {
    fn finding(&self) -> Finding {
        Finding {
            weight: if self.weight <= Weight::Warning { "warning" } else { "note" },
            text: match self.count {
                0 | 1 => self.message.to_owned(),
                count => format!("{} ({count} lines)", self.message),
            },
            line: self.line,
            time_s: None,
        }
    }
}

/// A finding about a place of the print.
fn place(weight: &'static str, place: &Extreme, text: String) -> Finding {
    Finding { weight, text, line: Some(place.line), time_s: Some(place.time_s) }
}

fn slowed(moves: u64, totals: &Totals) -> Option<Finding> {
    (moves > 0 && totals.first_slowed.value > 0.0).then(|| {
        let moves = if moves == 1 { "1 move is" } else { &format!("{moves} moves are") };
        let text = format!(
            "{moves} slowed, for the board cannot keep up with them: {:.1} s of the print. This is the first",
            totals.slowed_s
        );
        let weight = if totals.slowed_s >= LEAST_SLOWED_S { "warning" } else { "note" };
        place(weight, &totals.first_slowed, text)
    })
}

fn first_retraction(totals: &Totals) -> Option<Finding> {
    (totals.retractions > 0).then(|| {
        let count = totals.retractions;
        let retractions = if count == 1 { "The only retraction" } else { &format!("The first of {count} retractions") };
        place("place", &totals.first_retraction, format!("{retractions}: {:.2} mm", totals.first_retraction.value))
    })
}

/// Finds the places where the print is fastest, longest or most; leaves out what the
/// print does not have.
fn extremes(totals: &Totals) -> impl Iterator<Item = Finding> {
    let extreme = |extreme: &Extreme, text: String| (extreme.value > 0.0).then(|| place("extreme", extreme, text));
    let Totals { greatest_flow, fastest_print, longest_travel, longest_retraction, .. } = totals;
    let Totals { greatest_deviation, greatest_pressure, longest_wait, .. } = totals;
    let retraction = || extreme(longest_retraction, format!("Longest retraction: {:.2} mm", longest_retraction.value));
    let wait = || extreme(longest_wait, format!("Longest wait that is not for a heater: {:.1} s", longest_wait.value));
    let all = [
        extreme(greatest_flow, format!("Greatest flow: {:.1} mm³/s", greatest_flow.value)),
        extreme(fastest_print, format!("Fastest printing: {:.0} mm/s", fastest_print.value)),
        extreme(longest_travel, format!("Longest travel: {:.0} mm", longest_travel.value)),
        // A single retraction has its own finding.
        (totals.retractions > 1).then(retraction).flatten(),
        extreme(greatest_deviation, format!("Farthest from the path asked for: {:.3} mm", greatest_deviation.value)),
        extreme(
            greatest_pressure,
            format!("Greatest pressure in the nozzle: {:.2} mm³ too much in it", greatest_pressure.value),
        ),
        (longest_wait.value > LEAST_WAIT_S).then(wait).flatten(),
    ];
    all.into_iter().flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn findings_come_in_the_order_of_their_weight() {
        let remark = |message, count, weight| Remarked { message, count, line: Some(7), weight };
        let outcome = Outcome {
            stopped: Some(("the bed is gone".to_owned(), Some(9))),
            remarks: vec![
                remark("a corner", 1, Weight::Note),
                remark("M862.3: not checked", 2, Weight::WithoutEffect),
                remark("no heat", 3, Weight::Warning),
                remark("M115: unknown command", 1, Weight::WithoutEffect),
                remark("the target is outside", 4, Weight::LostMoves),
            ],
            slowed_moves: 1,
        };
        let at = |value, line| Extreme { value, time_s: 1.5, line };
        let mut totals = Totals::default();
        totals.retractions = 1;
        totals.first_retraction = at(0.8, 3);
        totals.longest_retraction = at(0.8, 3);
        totals.first_slowed = at(1.0, 4);
        totals.slowed_s = 2.0;
        totals.fastest_print = at(60.0, 5);
        totals.longest_wait = at(0.5, 6);
        let findings = outcome.findings(&totals);
        let told: Vec<_> = findings.iter().map(|one| (one.weight, one.text.as_str(), one.line)).collect();
        assert_eq!(
            told,
            [
                ("stop", "The print stops here: the bed is gone", Some(9)),
                ("warning", "the target is outside (4 lines)", Some(7)),
                ("warning", "no heat (3 lines)", Some(7)),
                (
                    "warning",
                    "1 move is slowed, for the board cannot keep up with them: 2.0 s of the print. This is the first",
                    Some(4)
                ),
                ("note", "a corner", Some(7)),
                ("note", "3 lines have no effect on this machine: M862.3, M115", Some(7)),
                ("place", "The only retraction: 0.80 mm", Some(3)),
                ("extreme", "Fastest printing: 60 mm/s", Some(5)),
            ]
        );
        totals.slowed_s = 0.01;
        let findings = outcome.findings(&totals);
        let slowed = findings.iter().find(|one| one.text.contains("slowed"));
        assert_eq!(slowed.map(|one| one.weight), Some("note"), "a hundredth of a second is nothing to act on");
        assert!(Outcome::default().findings(&Totals::default()).is_empty());
    }
}
