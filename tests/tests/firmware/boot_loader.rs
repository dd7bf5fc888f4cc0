//! A boot loader that ran as a task, with interrupts masked, and jumps to the image from there.

use ferrostep_image_code::code::Code;
use ferrostep_tests::qemu::Register;

use crate::board_pins::halted_asleep;
use crate::boards::BOARDS;
use crate::image::{Bench, image_of};

/// Below all that the stack comes down to.
const PROGRAM: u32 = 0x2000_0200;

/// All of RTIC's priorities masked but the highest, a stack of its own, and on to the address in the first word after it; the
/// second is the stack: `movs r0, #0x10; msr basepri, r0; movs r0, #2; msr control, r0; isb; ldr r1, [pc, #4]; ldr r2, [pc,
/// #8]; mov sp, r2; bx r1`.
const LEAVE: [u16; 12] =
    [0x2010, 0xf380, 0x8811, 0x2002, 0xf380, 0x8814, 0xf3bf, 0x8f6f, 0x4901, 0x4a02, 0x4695, 0x4708];

/// With masks left the image would never hear its host; with another stack it would run over the other's memory.
#[test]
fn an_image_starts_whatever_masks_and_stack_a_boot_loader_leaves() {
    for board in &BOARDS {
        let code = Code::of(&image_of(board.name)).unwrap();
        let is_reset = |start: &u32| code.names(*start).iter().any(|name| name == "Reset");
        let reset = code.functions_named("Reset").into_iter().find(is_reset).unwrap();
        let mut bench = Bench::boot_board(board);
        let mut debugger = halted_asleep(&mut bench);
        let mut program: Vec<u8> = LEAVE.into_iter().flat_map(u16::to_le_bytes).collect();
        // A stack of some words, which the image would run over.
        program.extend([reset | 1, PROGRAM + 0x80].into_iter().flat_map(u32::to_le_bytes));
        debugger.write_memory(PROGRAM, &program).unwrap();
        debugger.set_register(Register::ProgramCounter, PROGRAM).unwrap();
        debugger.resume().unwrap();
        bench.host.wait_for("start", |line| line == "start").unwrap();
        bench.host.send_raw(b"M110 N0\nM115\n").unwrap();
        let line = bench.host.wait_for("M115", |line| line.starts_with("FIRMWARE_NAME")).unwrap();
        assert!(line.contains("EXTRUDER_COUNT:1"), "{}: {line}", board.name);
    }
}
