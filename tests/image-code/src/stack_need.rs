//! The stack that an image needs: its start, or all its tasks, each interrupting the one before.

use std::collections::BTreeMap;
use std::fmt::{self, Display, Formatter};

use crate::code::Code;
use crate::stack::{Deepest, EXCEPTION_BYTES, StackUse};

/// Lowest possible end of the stack: there is no RAM below it.
const RAM_START: u32 = 0x2000_0000;

/// Handlers that share a priority: one of each list runs at a time. Every other handler has a
/// separate priority.
const OF_ONE_PRIORITY: [&[&str]; 2] = [
    &["TIM2", "TIM1_BRK_TIM9"],
    // The last ones: no handler follows them.
    &["HardFault", "HardFaultTrampoline", "DefaultHandler", "DefaultHandler_"],
];

/// Places where tasks can begin to interrupt the image: at the end of RTIC's start, or asleep.
const BEFORE_TASKS: [&str; 2] = ["Reset", "main"];

/// The end of RTIC's start; part of `main` where the compiler has inlined it.
const END_OF_START: &str = "__rtic_init_resources";

/// The function that begins an image.
const START: &str = "Reset";

/// Stack that an image needs, and that it has.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StackNeed {
    /// Bytes that it needs at most.
    pub bytes: u32,
    /// Bytes between the start of RAM and the first stack pointer.
    pub size: u32,
    /// Bytes of each priority's deepest handler, by the names of the handler.
    pub priorities: BTreeMap<String, u32>,
    /// The deepest ways with the names and frames of their functions, for a person.
    pub ways: String,
}

impl StackNeed {
    /// Reads it from an image's instructions.
    ///
    /// # Errors
    /// An instruction cannot be followed ([`StackUse`]), or the image has not exactly one start.
    pub fn of(code: &Code) -> Result<Self, String> {
        let stack_use = StackUse::of(code)?;
        let of_function = |name: &str| -> Vec<u32> {
            let is_it = |one: &u32| code.names(*one).iter().any(|one| one.ends_with(name));
            code.functions_named(name).iter().copied().filter(is_it).collect()
        };
        let [start] = of_function(START)[..] else { return Err(format!("the image has not one function {START}")) };
        let starting = stack_use.deepest(start)?;
        let mut ways = way(code, "to start", &starting);
        let frame = |name: &str| of_function(name).into_iter().map(|one| stack_use.frame(one)).max();
        let mut before = frame(END_OF_START).unwrap_or(0);
        for name in BEFORE_TASKS {
            before += frame(name).ok_or_else(|| format!("the image has no function {name}"))?;
        }
        let mut priorities = BTreeMap::new();
        for handler in code.handlers() {
            let names = code.names(handler);
            if names.iter().any(|name| name == START) {
                continue;
            }
            let same = OF_ONE_PRIORITY.iter().find(|group| names.iter().any(|name| group.contains(&name.as_str())));
            let group = same.map_or_else(|| names.concat(), |group| group.concat());
            let deepest = stack_use.deepest(handler)?;
            ways += &way(code, &format!("in {}", names.join(", ")), &deepest);
            let most = priorities.entry(group).or_insert(0);
            *most = deepest.bytes.max(*most);
        }
        let tasks: u32 = priorities.values().map(|bytes| bytes + EXCEPTION_BYTES).sum();
        let bytes = starting.bytes.max(before + tasks);
        Ok(Self { bytes, size: code.initial_stack().saturating_sub(RAM_START), priorities, ways })
    }

    /// Checks that the stack is large enough.
    ///
    /// # Errors
    /// The stack is too small; the deepest paths are in the error.
    pub fn check(&self) -> Result<(), String> {
        if self.bytes <= self.size { Ok(()) } else { Err(format!("{}the stack needs {self}", self.ways)) }
    }
}

impl Display for StackNeed {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        write!(formatter, "{} of {} bytes", self.bytes, self.size)
    }
}

fn way(code: &Code, title: &str, deepest: &Deepest) -> String {
    let functions = deepest.way.iter().map(|(function, frame)| format!("    {frame:6} {}\n", code.function(*function)));
    std::iter::once(format!("{:6} bytes {title}\n", deepest.bytes)).chain(functions).collect()
}
