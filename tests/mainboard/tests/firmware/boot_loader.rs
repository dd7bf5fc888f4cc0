//! A boot loader that runs as a task, with interrupts masked, and jumps to the image from there.

use ferrostep_image_code::code::Code;
use ferrostep_testkit::boards::BOARDS;

use crate::firmware::bench::Bench;
use crate::firmware::foreign_code::{PROGRAM, load};
use crate::firmware::images::image_of;

/// Masks all of RTIC's priorities but the highest, and selects a separate stack:
/// `movs r0, #0x10; msr basepri, r0; movs r0, #2; msr control, r0; isb`.
const MASKS: [u16; 8] = [0x2010, 0xf380, 0x8811, 0x2002, 0xf380, 0x8814, 0xf3bf, 0x8f6f];

/// `mov sp, r2; bx r1`.
const LEAVE: [u16; 2] = [0x4695, 0x4708];

/// With masks in force the image could never receive from its host; with another stack it would
/// overwrite the other's memory.
#[test]
fn an_image_starts_with_any_masks_and_stack() {
    for board in &BOARDS {
        let code = Code::of(&image_of(board.name)).unwrap();
        let is_reset = |start: &u32| code.names(*start).iter().any(|name| name == "Reset");
        let reset = code.functions_named("Reset").into_iter().find(is_reset).unwrap();
        let mut bench = Bench::boot_patched(board);
        // A stack of a few words, which the image would overflow.
        let program = [&MASKS[..], &load(1, reset | 1), &load(2, PROGRAM + 0x80), &LEAVE].concat();
        bench.execute(&program);
        bench.host.wait_for("start", |line| line == "start").unwrap();
        bench.host.send_raw(b"M110 N0\nM115\n").unwrap();
        let line = bench.host.wait_for("M115", |line| line.starts_with("FIRMWARE_NAME")).unwrap();
        assert!(line.contains("EXTRUDER_COUNT:1"), "{}: {line}", board.name);
    }
}
