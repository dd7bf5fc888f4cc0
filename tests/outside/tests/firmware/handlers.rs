//! Ends of handlers (erratum 838869): a store that still waits on a slow bus must not
//! overlap the return.

use ferrostep_image_code::code::{Code, Instruction};
use ferrostep_testkit::boards::BOARDS;

use crate::firmware::image::image_of;

/// Interrupts by their numbers (RM0090, table 61): TIM1_BRK_TIM9, TIM2.
const STEPS: [(&str, u32); 2] = [("TIM1_BRK_TIM9", 24), ("TIM2", 28)];

/// EXTI2, USART1, OTG_FS: on every board.
const ON_EVERY_BOARD: [(&str, u32); 3] = [("EXTI2", 8), ("USART1", 37), ("OTG_FS", 67)];

/// The lines to the drivers.
const USART2: (&str, u32) = ("USART2", 38);
const TIM7: (&str, u32) = ("TIM7", 55);

fn function(all: &[Instruction], start: u32, code: &Code) -> Vec<Instruction> {
    all.iter().filter(|one| code.function_start(one.address) == Some(start)).cloned().collect()
}

/// A handler may leave its work, and the barrier after it, to a function that it calls.
#[test]
fn stores_to_slow_buses_are_complete_before_a_handler_returns() {
    for board in &BOARDS {
        let code = Code::of(&image_of(board.name)).unwrap();
        let all = code.instructions().unwrap();
        let has_barrier = |start| function(&all, start, &code).iter().any(|one| one.name == "dsb");
        let of_drivers = board.is_printer().then_some(if board.own_lines { TIM7 } else { USART2 });
        for (name, interrupt) in ON_EVERY_BOARD.into_iter().chain(of_drivers) {
            let start = code.handler(interrupt).unwrap();
            let body = function(&all, start, &code);
            let mut calls = body.iter().filter(|one| one.name.starts_with('b')).filter_map(Instruction::target);
            assert!(has_barrier(start) || calls.any(has_barrier), "{}: {name} has no barrier", board.name);
        }
    }
}

/// The step interrupt's are the last instruction before each of its returns.
#[test]
fn the_step_interrupt_waits_for_its_stores_before_it_returns() {
    for board in &BOARDS {
        let code = Code::of(&image_of(board.name)).unwrap();
        let all = code.instructions().unwrap();
        for (name, interrupt) in STEPS {
            let start = code.handler(interrupt).unwrap();
            let body = function(&all, start, &code);
            let is_return =
                |one: &Instruction| one.operands.contains("pc}") || one.name == "bx" && one.operands.contains("lr");
            assert!(body.iter().any(is_return), "{}: {name} does not return", board.name);
            for [before, one] in body.array_windows().filter(|[_, one]| is_return(one)) {
                assert_eq!(before.name, "dsb", "{}: {name}: {one}", board.name);
            }
        }
    }
}
