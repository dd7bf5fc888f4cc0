//! Code that the step interrupt can reach in the image: short, straight, and alone.

use std::collections::{BTreeMap, BTreeSet};

use ferrostep_image_code::code::{Code, Instruction};
use ferrostep_image_code::flow::{Flow, flow};
use ferrostep_image_code::interrupt_time::{self, MEASURED, STEP_TIMER};
use ferrostep_step_player::MIN_GAP_TICKS;
use ferrostep_testkit::boards::BOARDS;
use ferrostep_testkit::program::repository;
use ferrostep_virtual_board::CYCLES_A_TICK;

use crate::firmware::image::{image, image_of};

/// TIM1_BRK_TIM9's number: the step interrupt calls it for the end of a motion, and the planner
/// task for its start.
const START_OR_END: u32 = 24;

/// Reason for which an instruction has no place in the step interrupt.
fn objection(instruction: &Instruction, after: Option<&Instruction>) -> Option<&'static str> {
    let name = instruction.name.as_str();
    let is_one_of = |starts: &[&str]| starts.iter().any(|start| name.starts_with(start));
    if name.starts_with('v') {
        Some("floating point: the core would save its registers, too")
    } else if is_one_of(&["udiv", "sdiv"]) {
        Some("division: up to 12 cycles")
    } else if is_one_of(&["ldrex", "strex", "clrex"]) {
        Some("exclusive access: a loop that may repeat")
    } else if name == "dsb" {
        // The handler's stores must have arrived when it returns (`handlers.rs`).
        let is_last = after.is_some_and(|after| matches!(flow(after), Flow::Return { is_conditional: false }));
        (!is_last).then_some("barrier before the end of the handler")
    } else if is_one_of(&["dmb", "isb"]) {
        Some("barrier: there is one core, and a compiler fence is enough")
    } else if matches!(instruction.written_register(), Some("primask" | "faultmask" | "basepri" | "basepri_max")) {
        Some("masks interrupts: critical section or lock")
    } else if is_one_of(&["cpsie", "svc", "bkpt", "wfi", "wfe"]) {
        Some("no business of an interrupt")
    } else if name == "udf" || name == "trap" {
        Some("a check that can fail")
    } else {
        None
    }
}

/// Code that can be reached.
#[derive(Default)]
struct Reached {
    instructions: BTreeMap<u32, Instruction>,
    objections: Vec<String>,
}

/// Follows everything that can be executed from a function on.
fn reach(code: &Code, entry: u32, may_call: &[&str]) -> Reached {
    let mut reached = Reached::default();
    let mut seen = BTreeSet::new();
    let mut pending = vec![entry];
    while let Some(address) = pending.pop() {
        if !seen.insert(address) {
            continue;
        }
        let place = code.function(address);
        let instruction = match code.instruction(address) {
            Ok(instruction) => instruction,
            Err(error) => {
                reached.objections.push(format!("cannot be read: {error}"));
                continue;
            }
        };
        let after = code.instruction(instruction.next()).ok();
        if let Some(reason) = objection(&instruction, after.as_ref()) {
            reached.objections.push(format!("{reason}: {instruction}   in {place}"));
        }
        let next = instruction.next();
        let mut called = None;
        match flow(&instruction) {
            Flow::On => pending.push(next),
            Flow::Branch { target, is_conditional } => {
                if code.function_start(target) != code.function_start(address) {
                    called = Some(target);
                }
                pending.push(target);
                if is_conditional {
                    pending.push(next);
                }
            }
            Flow::Call(target) => {
                called = Some(target);
                pending.push(target);
                pending.push(next);
            }
            Flow::ComputedCall => {
                reached.objections.push(format!("call of a computed address: {instruction}   in {place}"));
                pending.push(next);
            }
            Flow::Return { is_conditional: true } => pending.push(next),
            // A trap is an objection already.
            Flow::Return { is_conditional: false } | Flow::Trap => {}
            Flow::Computed => reached.objections.push(format!("leads who knows where: {instruction}   in {place}")),
        }
        if let Some(target) = called {
            let callee = code.function(target);
            if !may_call.iter().any(|name| callee.contains(name)) {
                reached.objections.push(format!("call of {callee}: {instruction}   in {place}"));
            }
        }
        reached.instructions.insert(address, instruction);
    }
    reached.objections.sort();
    reached
}

/// Fails with the list of all forbidden instructions that a function can reach; it may call the
/// named functions.
fn assert_short_and_alone(code: &Code, entry: u32, may_call: &[&str]) {
    let reached = reach(code, entry, may_call);
    let name = code.function(entry);
    eprintln!("{} instructions can be reached from {name} at {entry:#010x}", reached.instructions.len());
    assert!(reached.instructions.len() > 20, "that cannot be all");
    assert!(reached.objections.is_empty(), "{name}\n  {}", reached.objections.join("\n  "));
}

#[test]
fn the_step_interrupt_never_calls_waits_or_panics() {
    let code = Code::of(image()).unwrap();
    for interrupt in [STEP_TIMER, START_OR_END] {
        assert_short_and_alone(&code, code.handler(interrupt).unwrap(), &[]);
    }
}

/// The interrupt's longest time keeps the limit; building an image fails where this does.
#[test]
fn the_reload_value_arrives_in_time_in_every_image() {
    let gap_cycles = MIN_GAP_TICKS * CYCLES_A_TICK as u32;
    for board in &BOARDS {
        let code = Code::of(&image_of(board.name)).unwrap();
        let [time, measured] = interrupt_time::check(&code, gap_cycles).unwrap();
        eprintln!("{}: {time}; measured: {measured}; a gap has {gap_cycles}", board.name);
        // The interrupt has to be entered, and three registers to be stored.
        assert!(time.to_reload.cached > 40 && time.reload_instructions > 12, "{time}");
        assert!(measured.to_reload.cached > time.to_reload.cached);
        // A handler with as many instructions more is refused with its figures.
        let error = interrupt_time::check(&code, time.to_reload.uncached - 1).unwrap_err();
        assert!(error.contains("the reload value arrives after the next update"), "{error}");
        assert!(error.contains(&format!("({} with flash", time.to_reload.uncached)), "{error}");
    }
}

/// The end of a motion comes first if both are pending, or an update would be served by a player
/// that has not ended it.
const _: () = assert!(START_OR_END < STEP_TIMER);

/// Critical sections do not keep out the core's highest priority, and RTIC would guard what a task
/// of that priority shares with a lower one by just these. The image cannot show that no task has
/// it; the application's text can.
#[test]
fn the_step_handlers_are_alone_at_their_priority() {
    let folder = repository().join("app");
    let text = std::fs::read_to_string(folder.join("src/main.rs")).unwrap();
    let tasks: Vec<&str> = text.split("#[task(").skip(1).map(|task| task.split(")]").next().unwrap()).collect();
    assert!(tasks.len() > 4 && tasks.iter().all(|task| !task.contains("priority = 16")), "{tasks:?}");
    assert!(tasks.iter().all(|task| !task.contains("TIM2") && !task.contains("TIM1_BRK_TIM9")), "{tasks:?}");
    let handlers = std::fs::read_to_string(folder.join("step-interrupt/src/lib.rs")).unwrap();
    assert!(
        handlers.contains("const HIGHEST: u8 = 0;")
            && handlers.matches("set_priority(interrupt, HIGHEST)").count() == 1
    );
}

/// The vector leads here while M798 measures.
#[test]
fn the_measured_step_interrupt_calls_only_its_handler() {
    let code = Code::of(image()).unwrap();
    let [entry] = code.functions_named(MEASURED)[..] else {
        panic!("not one function is called {MEASURED}: {:x?}", code.functions_named(MEASURED))
    };
    assert_short_and_alone(&code, entry, &["TIM2"]);
}

fn instruction(name: &str, operands: &str) -> Instruction {
    Instruction { address: 0x100, length: 2, name: name.to_owned(), operands: operands.to_owned() }
}

#[test]
fn forbidden_instructions_in_the_interrupt_are_found() {
    for (name, operands) in [
        ("vadd.f32", "s0, s1, s2"),
        ("udiv", "r0, r1, r2"),
        ("ldrex", "r0, [r1]"),
        ("dmb", "sy"),
        ("dsb", "sy"),
        ("isb", "sy"),
        ("cpsid", "i"),
        ("msr", "basepri, r4"),
        ("msr", "basepri_max, r0"),
        ("udf", "#0xfe"),
    ] {
        assert!(objection(&instruction(name, operands), None).is_some(), "{name} {operands}");
    }
    let (barrier, load) = (instruction("dsb", "sy"), instruction("ldr", "r0, [r1]"));
    assert!(objection(&barrier, Some(&load)).is_some());
    assert_eq!(objection(&barrier, Some(&instruction("bx", "lr"))), None);
    assert_eq!(objection(&instruction("ldr", "r0, [r1]"), None), None);
}
