//! Only the image's start and its crash handlers mask the step interrupt.
//!
//! BASEPRI cannot mask the step task's priority; PRIMASK and FAULTMASK can. Functions that set one
//! of these are in the list.

use std::collections::BTreeMap;

use ferrostep_image_code::code::{Code, Instruction, constant};

use crate::firmware::image::image;

/// The functions that may set PRIMASK, and why. `main` and the handlers' names are fixed by
/// cortex-m-rt and the compiler.
const MAY_SET_PRIMASK: [(&str, &str); 3] = [
    ("main", "RTIC's start: from reset to the end of `init`, when no task runs yet"),
    ("ferrostep_stm32f4_board::fault::handle", "the hard fault: heaters and motors off, for good"),
    ("DefaultHandler", "an unexpected interrupt: the same"),
];

/// Every instruction of the image.
fn instructions(code: &Code) -> Vec<Instruction> {
    let all = code.instructions().unwrap();
    assert!(all.len() > 10_000, "only {} instructions were found", all.len());
    all
}

#[test]
fn only_start_and_crash_handlers_mask_the_step_interrupt() {
    let code = Code::of(image()).unwrap();
    let mut masking = instructions(&code);
    masking.retain(|instruction| matches!(instruction.written_register(), Some("primask" | "faultmask")));
    let forbidden: Vec<String> = masking
        .iter()
        .filter(|instruction| {
            let names = code.names(instruction.address);
            let may = MAY_SET_PRIMASK.iter().any(|(name, _)| names.iter().any(|one| one == name));
            instruction.written_register() != Some("primask") || !may
        })
        .map(|instruction| format!("{instruction}   in {}", code.function(instruction.address)))
        .collect();
    assert!(forbidden.is_empty(), "the step interrupt is masked by\n  {}", forbidden.join("\n  "));
    for (name, why) in MAY_SET_PRIMASK {
        let is_used = masking.iter().any(|instruction| code.names(instruction.address).iter().any(|one| one == name));
        assert!(is_used, "{name} ({why}) does not mask any longer: take it off the list");
    }
}

/// Lists where the image raises its priority, and to which of RTIC's priorities: 15 in critical
/// sections, which delay all but steps, and in locks the ceiling of the resource.
#[test]
fn each_raised_priority_masks_something() {
    let code = Code::of(image()).unwrap();
    let all = instructions(&code);
    let mut sites = BTreeMap::<(Option<u32>, String), usize>::new();
    for (place, raised) in all.iter().enumerate() {
        if raised.written_register() != Some("basepri_max") {
            continue;
        }
        let start = code.function_start(raised.address).unwrap();
        let first = all.partition_point(|instruction| instruction.address < start);
        let register = raised.operands.rsplit(' ').next().unwrap();
        let site = format!("{raised}   in {}", code.function(raised.address));
        let mask = constant(&all[first..place], register);
        // The upper four bits of a byte, 0 being the highest priority, but as a
        // mask no mask at all.
        assert!(mask.is_none_or(|mask| (0x10..=0xf0).contains(&mask) && mask & 0xf == 0), "{mask:x?}: {site}");
        *sites.entry((mask.map(|mask| 16 - mask / 16), code.function(raised.address))).or_default() += 1;
    }
    for ((priority, function), count) in sites.iter().rev() {
        // A constant that travels through a branch is not followed.
        let priority = priority.map_or("?".to_owned(), |priority| priority.to_string());
        eprintln!("to {priority:>2}, {count:3} times in {function}");
    }
    let places = |wanted| sites.iter().filter(|((priority, _), _)| *priority == wanted).map(|(_, count)| count).sum();
    let (sections, unknown): (usize, usize) = (places(Some(15)), places(None));
    assert!(sections > unknown, "{sections} critical sections, {unknown} places whose mask could not be read");
}
