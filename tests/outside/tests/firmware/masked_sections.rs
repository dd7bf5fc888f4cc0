//! Every section of the shipped images that masks interrupts, with its length: the
//! list is `tests/outside/masked-sections.md`.

use std::collections::BTreeMap;
use std::path::PathBuf;

use ferrostep_checked_toml::book;
use ferrostep_image_code::code::Code;
use ferrostep_image_code::masked::{Mask, Section, sections};
use ferrostep_testkit::boards::BOARDS;
use ferrostep_testkit::program::repository;

use crate::firmware::image::image_of;

/// RTIC's priority of critical sections, which mask everything but steps.
const CRITICAL: u32 = 15;

/// The key of a row of the list: the mask, and the place.
type Place = (Mask, String);

/// The longest of a place's sections.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Longest {
    /// Cycles; `None` if it never ends.
    cycles: Option<u32>,
    has_loop: bool,
    calls_pointer: bool,
}

impl Longest {
    fn of(section: &Section) -> Self {
        let time = section.time.unwrap_or_default();
        Self {
            cycles: section.time.map(|time| time.cycles),
            has_loop: time.has_loop,
            calls_pointer: time.calls_pointer,
        }
    }

    fn most(self, other: Self) -> Self {
        Self {
            // Some cycles are more than none: those of a section that ends.
            cycles: self.cycles.max(other.cycles),
            has_loop: self.has_loop || other.has_loop,
            calls_pointer: self.calls_pointer || other.calls_pointer,
        }
    }
}

/// A function's name without the types that it is compiled for.
fn short(name: &str) -> String {
    let name = name.strip_prefix('<').map_or(name.to_owned(), |rest| {
        // The type that it belongs to is in brackets, which may hold others.
        let mut depth = 1;
        let end = rest.char_indices().find(|(_, character)| {
            depth += i32::from(*character == '<') - i32::from(*character == '>');
            depth == 0
        });
        end.map_or(rest.to_owned(), |(end, _)| format!("{}{}", &rest[..end], &rest[end + 1..]))
    });
    let (mut text, mut depth) = (String::new(), 0);
    for character in name.chars() {
        match character {
            '<' => depth += 1,
            '>' => depth -= 1,
            _ if depth == 0 => text.push(character),
            _ => {}
        }
    }
    text.split("::{").next().unwrap_or_default().trim_end_matches("::").to_owned()
}

/// Place at which a section is listed: a critical section under its function, a lock under its
/// priority alone, since the compiler's inlining moves locks.
fn place(section: &Section) -> Place {
    let where_to = match section.mask {
        Mask::All | Mask::Priority(CRITICAL) => format!("<code>{}</code>", short(&section.function)),
        Mask::Priority(_) | Mask::Unknown => "locks".to_owned(),
    };
    (section.mask, where_to)
}

/// All places of all shipped images.
fn places() -> BTreeMap<Place, Longest> {
    let mut places = BTreeMap::new();
    for board in &BOARDS {
        let code = Code::of(&image_of(board.name)).unwrap();
        let found = sections(&code).unwrap();
        assert!(found.len() > 50, "{}: only {} sections were found", board.name, found.len());
        for section in found {
            let longest: &mut Longest = places.entry(place(&section)).or_insert_with(|| Longest::of(&section));
            *longest = longest.most(Longest::of(&section));
        }
    }
    places
}

/// The bound that the list gives: the next of 10, 20, 50, 100 ... with a fourth to spare, so that
/// it need not change with every change of the code.
fn bound(cycles: u32) -> u32 {
    let with_spare = cycles + cycles / 4;
    let steps = (1..9).flat_map(|power| [1, 2, 5].map(|digit| digit * 10_u32.pow(power)));
    steps.into_iter().find(|step| *step >= with_spare).unwrap_or(u32::MAX)
}

fn masked(mask: Mask) -> String {
    match mask {
        Mask::All => "everything (PRIMASK)".to_owned(),
        Mask::Priority(priority) => priority.to_string(),
        Mask::Unknown => "not read".to_owned(),
    }
}

fn row((mask, place): &Place, longest: &Longest) -> String {
    let cycles = longest.cycles.map_or("for good".to_owned(), |cycles| bound(cycles).to_string());
    let notes =
        [(longest.has_loop, "a loop, counted once"), (longest.calls_pointer, "calls through a pointer, not counted")];
    let notes: Vec<&str> = notes.into_iter().filter(|(applies, _)| *applies).map(|(_, note)| note).collect();
    format!("| {} | {place} | {cycles} | {} |", masked(*mask), notes.join("; "))
}

fn page() -> PathBuf {
    repository().join("tests/outside/masked-sections.md")
}

/// A section fails the test if it is not in the list, or has become longer than its bound
/// there.
#[test]
fn every_masked_section_is_in_the_list() {
    let places = places();
    let rows: Vec<String> = places.iter().rev().map(|(place, longest)| row(place, longest)).collect();
    if std::env::var_os(book::REFRESH_VARIABLE).is_some() {
        let head = "| masks up to priority | where | cycles at most, each loop once | |\n|---|---|---|---|\n";
        book::keep(&page(), "masked sections", &format!("{head}{}", rows.join("\n"))).unwrap();
    }
    let text = std::fs::read_to_string(page()).unwrap();
    let listed: BTreeMap<(&str, &str), &str> = text
        .lines()
        .filter_map(|line| {
            let mut cells = line.strip_prefix("| ")?.split(" | ");
            Some(((cells.next()?, cells.next()?), cells.next()?))
        })
        .collect();
    let mut wrong = Vec::new();
    for ((mask, place), longest) in &places {
        let mask = masked(*mask);
        match (listed.get(&(mask.as_str(), place.as_str())), longest.cycles) {
            (None, _) => wrong.push(format!("not in the list: {place}, up to priority {mask}, {longest:?}")),
            (Some(&"for good"), None) => {}
            (Some(bound), Some(cycles)) if bound.parse().is_ok_and(|bound: u32| cycles <= bound) => {}
            (Some(bound), _) => {
                wrong.push(format!("listed with {bound} cycles: {place}, priority {mask}, {longest:?}"))
            }
        }
    }
    assert!(
        wrong.is_empty(),
        "{}\n  look at them; {}=1 writes the list in {} anew",
        wrong.join("\n"),
        book::REFRESH_VARIABLE,
        page().display()
    );
}

/// A section that masks the step interrupt ends before the first task runs, or never.
#[test]
fn no_section_that_ends_masks_the_step_interrupt_while_tasks_run() {
    let all: Vec<(String, Longest)> = places()
        .into_iter()
        .filter(|((mask, _), _)| *mask == Mask::All)
        .map(|((_, place), time)| (place, time))
        .collect();
    assert!(all.len() > 1, "{all:?}");
    for (place, longest) in all {
        assert!(place == "<code>main</code>" || longest.cycles.is_none(), "{place}: {longest:?}");
    }
}

#[test]
fn names_lose_the_types_that_they_are_compiled_for() {
    for (name, expected) in [
        ("SysTick", "SysTick"),
        ("<a::Printer<(a::Motion<b::Lock<c>>, d)>>::retract::{closure#0}", "a::Printer::retract"),
        ("<a::Host>::answer::<(x::Y<z>)>", "a::Host::answer"),
        ("a::drop_glue::<b::Delay<c>>", "a::drop_glue"),
    ] {
        assert_eq!(short(name), expected);
    }
    assert_eq!([1, 8, 9, 16, 40, 41, 400_000].map(bound), [10, 10, 20, 20, 50, 100, 500_000]);
}
