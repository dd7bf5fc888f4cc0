//! Each image's stack holds what its tasks need, however they interrupt each other.

use ferrostep_image_code::code::Code;
use ferrostep_image_code::stack::{EXCEPTION_BYTES, StackUse};
use ferrostep_testkit::boards::BOARDS;

use crate::firmware::image::image_of;

/// Where the stack may end: below it there is no RAM.
const RAM_START: u32 = 0x2000_0000;

/// Handlers of one priority, of which one runs at a time; every other has a priority of its own.
const OF_ONE_PRIORITY: [&[&str]; 2] = [
    &["TIM2", "TIM1_BRK_TIM9"],
    // Nothing comes after these.
    &["HardFault", "HardFaultTrampoline", "DefaultHandler", "DefaultHandler_"],
];

/// Places where tasks can begin to interrupt the image: at the end of RTIC's start, or asleep.
const BEFORE_TASKS: [&str; 2] = ["Reset", "main"];

/// The end of RTIC's start; part of `main` where the compiler has inlined it.
const END_OF_START: &str = "__rtic_init_resources";

#[test]
fn the_stack_holds_all_tasks_nested() {
    for board in &BOARDS {
        let code = Code::of(&image_of(board.name)).unwrap();
        let stack_use = StackUse::of(&code).unwrap();
        let of_function = |name: &str| {
            let found: Vec<u32> = code.functions_named(name);
            let exact = found.iter().copied().filter(|&one| code.names(one).iter().any(|one| one.ends_with(name)));
            exact.collect::<Vec<_>>()
        };
        let [start] = of_function("Reset")[..] else { panic!("{}: one start", board.name) };
        let starting = stack_use.deepest(start).unwrap();
        eprintln!("{}: {:6} bytes to start", board.name, starting.bytes);
        for (function, frame) in &starting.way {
            eprintln!("    {frame:6} {}", code.function(*function));
        }
        let frame = |name: &str| of_function(name).into_iter().map(|one| stack_use.frame(one)).max();
        let before: u32 = BEFORE_TASKS.iter().map(|name| frame(name).expect(name)).sum();
        let before = before + frame(END_OF_START).unwrap_or(0);

        let mut groups = std::collections::BTreeMap::new();
        for handler in code.handlers() {
            let names = code.names(handler);
            if names.iter().any(|name| name == "Reset") {
                continue;
            }
            let same = OF_ONE_PRIORITY.iter().find(|group| names.iter().any(|name| group.contains(&name.as_str())));
            let group = same.map_or_else(|| names.concat(), |group| group[0].to_owned());
            let deepest = stack_use.deepest(handler).unwrap();
            eprintln!("{}: {:6} bytes in {}", board.name, deepest.bytes, names.join(", "));
            for (function, frame) in &deepest.way {
                eprintln!("    {frame:6} {}", code.function(*function));
            }
            let most = groups.entry(group).or_insert(0);
            *most = deepest.bytes.max(*most);
        }
        let tasks: u32 = groups.values().map(|bytes| bytes + EXCEPTION_BYTES).sum();
        let most = starting.bytes.max(before + tasks);
        let size = code.initial_stack() - RAM_START;
        eprintln!("{}: {} to start, {before} before {tasks} of tasks: {most} of {size}", board.name, starting.bytes);
        assert!(groups.len() >= 8, "{}: only {} priorities", board.name, groups.len());
        assert!(most <= size, "{}: {most} bytes may be on a stack of {size}", board.name);
    }
}
