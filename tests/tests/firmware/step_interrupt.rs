//! What the step interrupt can reach in the image: short, straight, and alone.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use ferrostep_tests::code::{Code, Instruction};

use crate::image::image;

/// TIM2's number (RM0090, table 61): the step interrupt.
const STEP_TIMER: u32 = 28;

/// TIM1_BRK_TIM9's: what the step interrupt calls for the start and the end of a motion, and for events near each other.
const STAY: u32 = 24;

/// Functions that the step interrupt may call. None: what it does is its own.
const MAY_CALL: [&str; 0] = [];

/// The measured interrupt is the handler of M798, which calls the one that it measures through its vector.
const MEASURED: &str = "step_interrupt_measured";

/// Where an instruction leads to.
#[derive(Debug, PartialEq, Eq)]
enum Flow {
    /// To the next one.
    On,
    /// To another, and if there is a condition also to the next one.
    Branch { target: u32, is_conditional: bool },
    /// To a function, and back.
    Call(u32),
    /// To a function whose address is computed, and back.
    ComputedCall,
    /// Back to where it was called from.
    Return { is_conditional: bool },
    /// To an address that is computed.
    Computed,
}

/// Names of conditions.
const CONDITIONS: [&str; 16] =
    ["eq", "ne", "hs", "cs", "lo", "cc", "mi", "pl", "vs", "vc", "hi", "ls", "ge", "lt", "gt", "le"];

/// Whether `name` is `base` with a condition (`Some(true)`) or without one.
fn with_condition(name: &str, base: &str) -> Option<bool> {
    match name.strip_prefix(base)? {
        "" => Some(false),
        condition => CONDITIONS.contains(&condition).then_some(true),
    }
}

fn flow(instruction: &Instruction) -> Flow {
    let (name, operands) = (instruction.name.as_str(), instruction.operands.as_str());
    if ["bl", "blx"].iter().any(|base| with_condition(name, base).is_some()) && name != "bls" && name != "blt" {
        return instruction.target().map_or(Flow::ComputedCall, Flow::Call);
    }
    if let Some(is_conditional) = with_condition(name, "bx") {
        return if operands == "lr" { Flow::Return { is_conditional } } else { Flow::Computed };
    }
    if name == "cbz" || name == "cbnz" {
        return instruction.target().map_or(Flow::Computed, |target| Flow::Branch { target, is_conditional: true });
    }
    if let Some(is_conditional) = with_condition(name, "b") {
        return instruction.target().map_or(Flow::Computed, |target| Flow::Branch { target, is_conditional });
    }
    if let Some(is_conditional) = with_condition(name, "pop") {
        return if operands.contains("pc") { Flow::Return { is_conditional } } else { Flow::On };
    }
    let pops_return = name.starts_with("ldm") && operands.contains("pc");
    let loads_return = name.starts_with("ldr") && operands.starts_with("pc, [sp]");
    if pops_return || loads_return {
        return Flow::Return { is_conditional: false };
    }
    // Table branches, and whatever else writes the program counter.
    if name.starts_with("tb") || operands.split(',').next().is_some_and(|first| first.trim() == "pc") {
        return Flow::Computed;
    }
    Flow::On
}

/// Why an instruction has no place in the step interrupt.
fn objection(instruction: &Instruction, before: Option<&Instruction>) -> Option<&'static str> {
    let name = instruction.name.as_str();
    let is_one_of = |starts: &[&str]| starts.iter().any(|start| name.starts_with(start));
    if name.starts_with('v') {
        Some("floating point: the core would save its registers, too")
    } else if is_one_of(&["udiv", "sdiv"]) {
        Some("division: up to 12 cycles")
    } else if is_one_of(&["ldrex", "strex", "clrex"]) {
        Some("exclusive access: a loop that may repeat")
    } else if is_one_of(&["dmb", "dsb"]) {
        Some("barrier: there is one core, and a compiler fence is enough")
    } else if name == "isb" {
        // RTIC's own, after the task: it puts BASEPRI back.
        let ends_task = before.is_some_and(|before| before.written_register() == Some("basepri"));
        (!ends_task).then_some("barrier outside of RTIC's end of a task")
    } else if matches!(instruction.written_register(), Some("primask" | "faultmask" | "basepri_max")) {
        Some("masks interrupts: critical section or lock")
    } else if is_one_of(&["cpsie", "svc", "bkpt", "wfi", "wfe"]) {
        Some("no business of an interrupt")
    } else if name == "udf" || name == "trap" {
        Some("the end of a panic")
    } else {
        None
    }
}

/// What can be reached.
#[derive(Default)]
struct Reached {
    instructions: BTreeMap<u32, Instruction>,
    objections: Vec<String>,
    computed_calls: usize,
}

/// Follows everything that can be executed from a function on.
fn reach(code: &Code, entry: u32) -> Reached {
    let mut reached = Reached::default();
    let mut seen = BTreeSet::new();
    let mut pending: Vec<(u32, Option<Instruction>)> = vec![(entry, None)];
    while let Some((address, before)) = pending.pop() {
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
        if let Some(reason) = objection(&instruction, before.as_ref()) {
            reached.objections.push(format!("{reason}: {instruction}   in {place}"));
        }
        let next = (instruction.next(), Some(instruction.clone()));
        let mut called = None;
        match flow(&instruction) {
            Flow::On => pending.push(next),
            Flow::Branch { target, is_conditional } => {
                if code.function_start(target) != code.function_start(address) {
                    called = Some(target);
                }
                pending.push((target, None));
                if is_conditional {
                    pending.push(next);
                }
            }
            Flow::Call(target) => {
                called = Some(target);
                // Who panics does not come back.
                if !code.function(target).contains("panic") {
                    pending.push((target, None));
                    pending.push(next);
                }
            }
            Flow::ComputedCall => {
                reached.computed_calls += 1;
                pending.push(next);
            }
            Flow::Return { is_conditional: true } => pending.push(next),
            Flow::Return { is_conditional: false } => {}
            Flow::Computed => reached.objections.push(format!("leads who knows where: {instruction}   in {place}")),
        }
        if let Some(target) = called {
            let callee = code.function(target);
            if callee.contains("panic") {
                reached.objections.push(format!("panic path, {callee}: {instruction}   in {place}"));
            } else if !MAY_CALL.iter().any(|name| callee.contains(name)) {
                reached.objections.push(format!("call of {callee}: {instruction}   in {place}"));
            }
        }
        reached.instructions.insert(address, instruction);
    }
    reached.objections.sort();
    reached
}

/// Fails with all that speaks against what can be reached from a function on.
fn assert_short_and_alone(code: &Code, entry: u32, computed_calls: usize) {
    let reached = reach(code, entry);
    let name = code.function(entry);
    eprintln!("{} instructions can be reached from {name} at {entry:#010x}", reached.instructions.len());
    assert!(reached.instructions.len() > 20, "that cannot be all");
    assert!(reached.objections.is_empty(), "{name}\n  {}", reached.objections.join("\n  "));
    assert_eq!(reached.computed_calls, computed_calls, "calls in {name} whose target is computed");
}

#[test]
fn the_step_interrupt_calls_nothing_waits_for_nothing_and_cannot_panic() {
    let code = Code::of(image()).unwrap();
    for interrupt in [STEP_TIMER, STAY] {
        assert_short_and_alone(&code, code.handler(interrupt).unwrap(), 0);
    }
}

/// Where both wait, the one that stays comes first, or the update would be served by a player that has not turned over.
const _: () = assert!(STAY < STEP_TIMER);

/// Critical sections do not keep out RTIC's priority 16, and RTIC would guard what a task of that priority shares with
/// a lower one by just these. The image cannot show that; the application's text can.
#[test]
fn the_step_tasks_are_alone_at_their_priority_and_share_with_each_other_only() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../app/src/main.rs");
    let text = std::fs::read_to_string(path).unwrap();
    let tasks: Vec<&str> = text.split("#[task(").skip(1).map(|task| task.split(")]").next().unwrap()).collect();
    let (highest, others): (Vec<&str>, Vec<&str>) = tasks.iter().partition(|task| task.contains("priority = 16"));
    assert_eq!(
        highest,
        [
            "binds = TIM2, priority = 16, shared = [step_timer]",
            "binds = TIM1_BRK_TIM9, priority = 16, shared = [step_timer]"
        ]
    );
    assert!(others.len() > 4 && others.iter().all(|task| !task.contains("step_timer")), "{others:?}");
    // RTIC refuses this where the priorities differ.
    assert!(text.contains("#[lock_free]\n        step_timer:"));
}

/// While M798 measures, the vector leads here.
#[test]
fn neither_does_the_measured_one_but_for_the_handler_it_measures() {
    let code = Code::of(image()).unwrap();
    let [entry] = code.functions_named(MEASURED)[..] else {
        panic!("not one function is called {MEASURED}: {:x?}", code.functions_named(MEASURED))
    };
    assert_short_and_alone(&code, entry, 1);
}

fn flow_of(name: &str, operands: &str) -> Flow {
    flow(&instruction(name, operands))
}

fn instruction(name: &str, operands: &str) -> Instruction {
    Instruction { address: 0x100, length: 2, name: name.to_owned(), operands: operands.to_owned() }
}

#[test]
fn branches_calls_and_returns_are_told_apart() {
    let branch = |is_conditional| Flow::Branch { target: 0x108, is_conditional };
    assert_eq!(flow_of("b", "#0x108"), branch(false));
    assert_eq!(flow_of("bls", "#0x108"), branch(true));
    assert_eq!(flow_of("blt", "#0x108"), branch(true));
    assert_eq!(flow_of("cbnz", "r0, #0x108"), branch(true));
    assert_eq!(flow_of("bl", "#0x108"), Flow::Call(0x108));
    assert_eq!(flow_of("blx", "r3"), Flow::ComputedCall);
    assert_eq!(flow_of("bx", "lr"), Flow::Return { is_conditional: false });
    assert_eq!(flow_of("bxeq", "lr"), Flow::Return { is_conditional: true });
    assert_eq!(flow_of("bx", "r3"), Flow::Computed);
    assert_eq!(flow_of("pop", "{r4, pc}"), Flow::Return { is_conditional: false });
    assert_eq!(flow_of("pop", "{r4, r5}"), Flow::On);
    assert_eq!(flow_of("ldr", "pc, [sp], #4"), Flow::Return { is_conditional: false });
    assert_eq!(flow_of("ldr", "pc, [r0, r1, lsl #2]"), Flow::Computed);
    assert_eq!(flow_of("tbb", "[pc, r0]"), Flow::Computed);
    assert_eq!(flow_of("bic", "r0, r1"), Flow::On);
    assert_eq!(flow_of("bfi", "r0, r1, #4, #8"), Flow::On);
}

#[test]
fn what_has_no_place_in_the_interrupt_is_found() {
    for (name, operands) in [
        ("vadd.f32", "s0, s1, s2"),
        ("udiv", "r0, r1, r2"),
        ("ldrex", "r0, [r1]"),
        ("dmb", "sy"),
        ("isb", "sy"),
        ("cpsid", "i"),
        ("msr", "basepri_max, r0"),
        ("udf", "#0xfe"),
    ] {
        assert!(objection(&instruction(name, operands), None).is_some(), "{name} {operands}");
    }
    let restored = instruction("msr", "basepri, r4");
    assert_eq!(objection(&restored, None), None);
    assert_eq!(objection(&instruction("isb", "sy"), Some(&restored)), None);
    assert_eq!(objection(&instruction("ldr", "r0, [r1]"), None), None);
}
