//! The image's effect on heaters, fans and motors: none before the first command, the right pins on
//! command, and off with the heaters first after a failure of the firmware.

use std::path::Path;

use ferrostep_image_code::code::Code;
use ferrostep_image_code::flow::{Flow, flow};
use ferrostep_mainboard::parts::wire::LineFault;
use ferrostep_testkit::boards::{BOARDS, BoardFacts, pin};

use crate::firmware::bench::Bench;
use crate::firmware::foreign_code::{STAND_STILL, load};
use crate::firmware::images::image_of;
use crate::firmware::port_log::{BSRR, MODER, PortState, PortWrite};

/// Long enough for the image's last message, ms.
const A_WHILE_MS: u64 = 50;

/// The start of RAM, which contains the stack.
const RAM: u32 = 0x2000_0000;

/// The USB controller's DCTL, and the soft disconnect in it (RM0090, 34.16.4).
const USB_CONTROL: u32 = 0x5000_0804;
const OFF_THE_BUS: u32 = 1 << 1;

/// An address without memory.
const NOWHERE: u32 = 0x6000_0000;

/// The state after some stores; panics if a heater is on at any time, or a motor is on
/// before `may_move`.
fn state_after(board: &BoardFacts, writes: &[PortWrite], may_move: bool) -> PortState {
    let (heaters, enable) = (board.heater_pins(), board.all_enable());
    let spare: Vec<_> = board.spare.iter().map(|name| pin(name)).collect();
    let mut state = PortState::new();
    for (index, &write) in writes.iter().enumerate() {
        state.apply(write);
        for &heater in &heaters {
            assert!(!state.is_high(heater), "{}: heater {heater:?} on by store {index}, {write:x?}", board.name);
        }
        for &enable in enable.iter().filter(|enable| !may_move || spare.contains(enable)) {
            let is_on = state.is_output(enable) && !state.is_high(enable);
            assert!(!is_on, "{}: motor {enable:?} on by store {index}, {write:x?}", board.name);
        }
    }
    state
}

/// Checks that all heaters and motors are driven, and off; a timer may drive its own pins.
pub fn assert_all_off(board: &BoardFacts, state: &PortState) {
    for (index, heater) in board.heater_pins().into_iter().enumerate() {
        let is_timed = board.heaters_are_timed && index < 2 && state.is_alternate(heater);
        let is_driven = is_timed || state.is_output(heater);
        assert!(is_driven && !state.is_high(heater), "{}: heater {heater:?}", board.name);
    }
    for enable in board.all_enable() {
        assert!(state.is_output(enable) && state.is_high(enable), "{}: motor {enable:?}", board.name);
    }
}

/// Checks that no heater gets power, from a timer or otherwise.
pub fn assert_nothing_heats(board: &BoardFacts, bench: &mut Bench) {
    assert!(!bench.any_heater_on(), "{}: a heater is on", board.name);
}

/// Checks that all heaters are plain outputs, and low.
pub fn assert_heaters_are_taken_from_timers(board: &BoardFacts, state: &PortState) {
    for heater in board.heater_pins() {
        assert!(state.is_output(heater) && !state.is_high(heater), "{}: heater {heater:?}", board.name);
    }
}

/// Checks that the first stores take all heaters' levels low, before any other store.
pub fn assert_heaters_come_first(board: &BoardFacts, writes: &[PortWrite]) {
    let mut waiting = board.heater_pins();
    for write in writes {
        if waiting.is_empty() {
            return;
        }
        let before = waiting.len();
        waiting.retain(|heater| write.level(*heater) != Some(false));
        assert!(write.offset == BSRR && waiting.len() < before, "{}: {write:x?} comes before {waiting:?}", board.name);
    }
    assert!(waiting.is_empty(), "{}: {waiting:?} are never switched off", board.name);
}

#[test]
fn outputs_stay_off_from_reset_to_the_first_command() {
    for board in &BOARDS {
        let mut bench = Bench::boot_board(board);
        let writes = bench.port_writes();
        assert_heaters_come_first(board, &writes);
        bench.with(|machine, _| {
            let plant = &machine.plant;
            assert!(plant.heaters.iter().all(|heater| heater.last_on_ns.is_none()), "a heater was on");
            assert!(!plant.drivers.iter().any(|driver| driver.energized()), "a motor has current");
        });
        let state = state_after(board, &writes, false);
        assert_all_off(board, &state);
        assert_nothing_heats(board, &mut bench);
        for fan in board.fans.iter().map(|name| pin(name)) {
            let is_driven = state.is_output(fan) || state.is_alternate(fan);
            assert!(is_driven && !state.is_high(fan), "{}: fan {fan:?}", board.name);
        }
        let [steps, directions] = board.signals;
        for (motor, (step, direction)) in steps.map(pin).into_iter().zip(directions.map(pin)).enumerate() {
            assert!(state.is_output(step) && !state.is_high(step), "{}: step of {motor}", board.name);
            let forwards = state.is_high(direction) == board.inverted[motor];
            assert!(state.is_output(direction) && forwards, "{}: direction of {motor}", board.name);
        }
        // A pin is low, or off, before it becomes an output.
        let first_output = writes.iter().position(|write| write.offset == MODER).unwrap();
        for heater in board.heater_pins() {
            let low = writes.iter().position(|write| write.level(heater) == Some(false)).unwrap();
            assert!(low < first_output, "{}: heater {heater:?}", board.name);
        }
    }
}

#[test]
fn outputs_commanded_off_stay_off() {
    for board in &BOARDS {
        let mut bench = Bench::boot_board(board);
        for command in ["M104 S0", "M140 S0", "M109 S0", "M107", "M106 S0"] {
            bench.host.send(command).unwrap();
        }
        let state = state_after(board, &bench.port_writes(), false);
        assert_all_off(board, &state);
        assert_nothing_heats(board, &mut bench);
        assert!(!board.fans.iter().any(|name| state.is_high(pin(name))), "{}: a fan is on", board.name);
    }
}

#[test]
fn the_image_configures_drivers_before_motion() {
    let board = BOARDS.iter().find(|board| board.name == "prusa-buddy").unwrap();
    let mut bench = Bench::boot_board(board);
    // A move waits until the drivers have confirmed their settings.
    for line in ["G91", "G1 X1 F1200", "M400"] {
        bench.host.send(line).unwrap();
    }
    assert_eq!(displacement(board, &bench.port_writes()), [100, 0, 0, 0]);
    for (motor, current, microsteps, chopper, threshold) in [
        ("X", "348 mA", 16, "stealthChop", 130),
        ("Y", "348 mA", 16, "stealthChop", 130),
        ("Z", "348 mA", 8, "stealthChop", 0),
        ("E", "398 mA", 16, "spreadCycle", 0),
    ] {
        let line = bench.host.ask("M122", &format!("echo:driver {motor}:")).unwrap();
        let expected = format!(
            "confirmed, {current}, {current} at rest, {microsteps} microsteps, {chopper}, stall threshold {threshold}"
        );
        assert!(line.contains(&expected), "{line}");
    }
    bench.host.send("M906 X300").unwrap();
    let line = bench.host.ask("M906", "echo:driver X:").unwrap();
    assert!(line.starts_with("echo:driver X: 300 mA"), "{line}");
}

/// The chip changes over by the time between its steps, whose threshold the image computes.
#[test]
fn above_its_speed_a_driver_leaves_stealth_chop() {
    const DRV_STATUS: u8 = 0x6f;
    const STEALTH: u32 = 1 << 30;
    let board = BOARDS.iter().find(|board| board.name == "prusa-buddy").unwrap();
    let mut bench = Bench::boot_board(board);
    bench.host.send("M913 X20").unwrap();
    let line = bench.host.ask("M913", "echo:driver X:").unwrap();
    assert_eq!(line, "echo:driver X: stealthChop, spreadCycle above 20 mm/s");
    bench.host.send("G91").unwrap();
    for (move_mm_per_s, is_quiet) in [(19, true), (21, false), (40, false)] {
        bench.host.send(&format!("G1 X{} F{}", move_mm_per_s, move_mm_per_s * 60)).unwrap();
        bench.pass(600);
        let now_ns = bench.now_ns();
        let status = bench.with(move |machine, _| machine.plant.drivers[0].read(now_ns, DRV_STATUS));
        assert_eq!(status & STEALTH != 0, is_quiet, "at {move_mm_per_s} mm/s: {status:#x}");
        bench.host.send("M400").unwrap();
    }
}

/// The frame has moved out of reach: no stall reports an end.
#[test]
fn homing_without_a_stall_fails_after_the_travel() {
    let board = BOARDS.iter().find(|board| board.name == "prusa-buddy").unwrap();
    let mut bench = Bench::boot_board(board);
    bench.change(|plant, _| plant.motion.set_frame(0, -1000.0, 1000.0));
    let line = bench.host.ask("M119", "x_max").unwrap();
    assert_eq!(line, "x_max: open");
    let line = bench.host.ask("G28 X", "echo:line").unwrap();
    assert!(
        line.contains(
            "homing X failed: its sensor did not trigger within 192.4 mm, expected it at the end of the axis"
        ),
        "{line}"
    );
    // Up by 4 mm, back by 2.56, then the travel from -2 to 180.4 mm and 10 mm.
    assert_eq!(displacement(board, &bench.port_writes()), [-256 + 19_240, 0, 1_600, 0]);
}

#[test]
fn a_silent_driver_is_named_and_other_commands_work() {
    let board = BOARDS.iter().find(|board| board.own_lines).unwrap();
    let mut bench = Bench::switch_on(board, |machine| {
        for line in machine.plant.own_lines() {
            line.bus_mut().set_fault(LineFault { garble: 0.0, mute: true });
        }
    });
    bench.host.connect().unwrap();
    for command in ["G1 X1 F1200", "G28"] {
        bench.host.send_raw(format!("{command}\n").as_bytes()).unwrap();
        let line = bench.host.wait_for(command, |line| line.starts_with("echo:line")).unwrap();
        assert!(line.contains("driver X does not answer: "), "{command}: {line}");
        assert!(line.ends_with("is the motor supply on?"), "{command}: {line}");
    }
    let line = bench.host.ask("M122", "echo:driver X: ").unwrap();
    assert!(line.contains("failed"), "{line}");
    // No motor has moved, and commands without drivers work.
    assert_eq!(displacement(board, &bench.port_writes()), [0; 4]);
    let line = bench.host.ask("M115", "FIRMWARE_NAME").unwrap();
    assert!(line.contains("COREXY"), "{line}");
}

/// The motors' positions, in steps.
fn displacement(board: &BoardFacts, writes: &[PortWrite]) -> [i64; 4] {
    let signals = board.signals.map(|pins| pins.map(pin));
    let [steps, directions] = signals;
    let (mut state, mut displacement) = (PortState::new(), [0; 4]);
    for &write in writes {
        let before = steps.map(|step| state.is_high(step));
        state.apply(write);
        for motor in 0..4 {
            let is_high = state.is_high(steps[motor]);
            if is_high != before[motor] && (is_high || board.both_edges) {
                let backwards = state.is_high(directions[motor]) != board.inverted[motor];
                displacement[motor] += if backwards { -1 } else { 1 };
            }
        }
    }
    displacement
}

#[test]
fn each_motor_steps_by_its_own_pins() {
    for board in &BOARDS {
        let mut bench = Bench::boot_board(board);
        let from = bench.port_writes().len();
        let mut expected = [0; 4];
        // One axis at a time, then all of them.
        for (x, y, z, e) in [(2, 0, 0, 0), (0, -3, 0, 0), (0, 0, 1, 0), (0, 0, 0, 2), (-1, -1, 1, -1)] {
            for line in ["M302 P1".to_owned(), "G91".to_owned(), format!("G1 X{x} Y{y} Z{z} E{e} F1200")] {
                bench.host.send(&line).unwrap();
            }
            bench.host.send("M400").unwrap();
            let [a, b] = if board.core_xy { [x + y, x - y] } else { [x, y] };
            for (motor, mm) in [a, b, z, e].into_iter().enumerate() {
                expected[motor] += mm * board.steps_per_mm[motor];
            }
            assert_eq!(displacement(board, &bench.port_writes()), expected, "{}: {x} {y} {z} {e}", board.name);
        }
        let writes = bench.port_writes();
        state_after(board, &writes[..from], false);
        let state = state_after(board, &writes, true);
        for motor in board.enable.map(pin) {
            assert!(!state.is_high(motor), "{}: motor {motor:?} is off", board.name);
        }
        bench.host.send("M84").unwrap();
        assert_all_off(board, &state_after(board, &bench.port_writes(), true));
    }
}

#[test]
fn idle_motors_are_switched_off_and_lose_their_homing() {
    let board = &BOARDS[0];
    let mut bench = Bench::boot_board(board);
    // With homed axes Z is kept above 0.
    for line in ["M84 S2", "G28", "G1 X5 F6000", "G1 Z-3", "M400"] {
        bench.host.send(line).unwrap();
    }
    let z = |bench: &mut Bench| displacement(board, &bench.port_writes())[2];
    let homed_z = z(&mut bench);
    // A dwell is not idle time.
    bench.host.send("G4 S4").unwrap();
    assert!(!state_after(board, &bench.port_writes(), true).is_high(pin(board.enable[0])));
    let line = bench.host.wait_for("switched off", |line| line.contains("switched off")).unwrap();
    assert_eq!(line, "echo:motors switched off after a rest (M84 S), home before the next move");
    assert_all_off(board, &state_after(board, &bench.port_writes(), true));
    for line in ["M84 S0", "G1 Z-1", "M400"] {
        bench.host.send(line).unwrap();
    }
    // After the loss of homing Z has no limit.
    assert_eq!(z(&mut bench) - homed_z, -board.steps_per_mm[2]);
    // M84 S0 switches the idle time off.
    let heard = bench.host.listen(5000).unwrap();
    assert!(heard.is_empty(), "{heard:?}");
    assert!(!state_after(board, &bench.port_writes(), true).is_high(pin(board.enable[0])));
}

/// Moves motors and heats heaters, causes a failure, and checks its effects.
fn assert_ends_safely(board: &'static BoardFacts, last_words: &str, go_wrong: impl Fn(&mut Bench)) {
    let mut bench = Bench::boot_patched(board);
    for line in ["M302 P1", "G91", "G1 X1 Y1 Z1 E1 F1200", "M400"] {
        bench.host.send(line).unwrap();
    }
    bench.host.send("M104 S150").unwrap();
    bench.host.send("M140 S60").unwrap();
    bench.pass(2000);
    for heater in ["nozzle", "bed"] {
        assert!(bench.heater_power(heater) > 0.99, "{}: {heater} does not heat", board.name);
    }
    let before = bench.port_writes().len();
    let off_the_bus = |bench: &mut Bench| {
        bench.with(|machine, _| {
            machine.stores().iter().filter(|one| one.address == USB_CONTROL && one.value & OFF_THE_BUS != 0).count()
        })
    };
    let left_before = off_the_bus(&mut bench);
    go_wrong(&mut bench);
    let line = bench.host.wait_for(last_words, |line| line.starts_with("Error:")).unwrap();
    assert!(line.contains(last_words) && line.ends_with("kill() called!"), "{}: {line}", board.name);
    bench.pass(A_WHILE_MS);
    // After its last message the image ignores all input.
    bench.host.send_raw(b"M999\nM105\n").unwrap();
    let heard = bench.host.listen(A_WHILE_MS).unwrap();
    assert!(heard.is_empty(), "{}: {heard:?}", board.name);
    let writes = bench.port_writes();
    let after = stores_from_switching_off(board, &writes[before..]);
    assert!(!after.is_empty(), "{}: no output was switched off", board.name);
    assert_heaters_come_first(board, after);
    let mut state = PortState::new();
    writes[..before].iter().for_each(|&write| state.apply(write));
    assert!(!state.is_high(pin(board.enable[0])), "{}: the motors were off before", board.name);
    writes[before..].iter().for_each(|&write| state.apply(write));
    assert_all_off(board, &state);
    assert_heaters_are_taken_from_timers(board, &state);
    assert_fans_blow(board, &state);
    assert_eq!(off_the_bus(&mut bench) - left_before, 1, "{}: the host at the USB port waits for ever", board.name);
    // The parts outside the chip agree.
    assert_nothing_heats(board, &mut bench);
    bench.with(|machine, _| {
        assert!(!machine.plant.drivers.iter().any(|driver| driver.energized()), "a motor has current");
    });
}

/// The stores from the one on that switches the first heater off: before the failure the control
/// switches heaters in normal operation.
fn stores_from_switching_off<'a>(board: &BoardFacts, writes: &'a [PortWrite]) -> &'a [PortWrite] {
    let Some(motors_off) = writes.iter().position(|write| write.level(pin(board.enable[0])) == Some(true)) else {
        return &[];
    };
    let heaters = board.heater_pins();
    let is_off = |write: &PortWrite| heaters.iter().any(|heater| write.level(*heater) == Some(false));
    let Some(last) = writes[..motors_off].iter().rposition(is_off) else { return &[] };
    let before = writes[..last].iter().rev().take_while(|write| is_off(write)).count();
    &writes[last - before..]
}

/// Checks that the fans of part and hot end, the first two, are plain outputs and high, and
/// no other fan is.
fn assert_fans_blow(board: &BoardFacts, state: &PortState) {
    for (index, fan) in board.fans.iter().map(|name| pin(name)).enumerate() {
        assert!(state.is_output(fan) && state.is_high(fan) == (index < 2), "{}: fan {fan:?}", board.name);
    }
}

/// `bx r2`: jumps to the address in it.
const JUMP: u16 = 0x4710;

/// Makes the processor jump to a check of the image that fails: the undefined instruction there.
/// Returns its address.
pub fn force_panic(image: &Path, bench: &mut Bench) -> u32 {
    let code = Code::of(image).unwrap();
    let is_of_planner = |address: u32| code.function(address).contains("ferrostep_planner");
    let trap = code
        .instructions()
        .unwrap()
        .into_iter()
        .find(|instruction| flow(instruction) == Flow::Trap && is_of_planner(instruction.address))
        .expect("the planner checks its arithmetic");
    bench.execute(&[&load(2, trap.address | 1)[..], &[JUMP]].concat());
    trap.address
}

/// Makes the processor jump to an address without memory.
pub fn jump_nowhere(bench: &mut Bench) {
    bench.execute(&[&load(2, NOWHERE | 1)[..], &[JUMP]].concat());
}

#[test]
fn a_panic_switches_heaters_off_first() {
    for board in &BOARDS {
        assert_ends_safely(board, "firmware panic at 0x0", |bench| {
            force_panic(&image_of(board.name), bench);
        });
    }
}

#[test]
fn a_stray_jump_switches_heaters_off_first() {
    for board in &BOARDS {
        assert_ends_safely(board, "firmware fault at 0x60000000", jump_nowhere);
    }
}

/// The address of NMIPENDSET (PM0214, 4.4.3), and `str r0, [r1]`.
const ICSR: u32 = 0xe000_ed04;
const STORE: u16 = 0x6008;

fn pend_non_maskable(bench: &mut Bench) {
    bench.execute(&[&load(0, 1 << 31)[..], &load(1, ICSR), &[STORE, STAND_STILL]].concat());
}

#[test]
fn the_non_maskable_interrupt_switches_heaters_off_first() {
    for board in &BOARDS {
        assert_ends_safely(board, "unexpected interrupt -14", pend_non_maskable);
    }
}

#[test]
fn a_stopped_crystal_switches_heaters_off_first() {
    for board in &BOARDS {
        assert_ends_safely(board, "the crystal has stopped", |bench| {
            let now = rigless::time::VirtualNanos(bench.now_ns());
            bench.with(move |machine, _| machine.chip.stop_crystal(now));
            // The chip's model has the flag, but no connection to the core (RM0090, 6.2.7).
            pend_non_maskable(bench);
        });
    }
}

#[test]
fn a_stack_overflow_switches_heaters_off_first() {
    for board in &BOARDS {
        assert_ends_safely(board, "firmware fault, stack overflow", |bench| {
            // The next interrupt finds no room for eight words. `mov sp, r0`.
            bench.execute(&[&load(0, RAM + 8)[..], &[0x4685, STAND_STILL]].concat());
        });
    }
}

/// The Buddy board, and a store to its heaters' port.
fn buddy_and_store(value: u32) -> (&'static BoardFacts, PortWrite) {
    let board = BOARDS.iter().find(|board| board.name == "prusa-buddy").unwrap();
    (board, PortWrite { port: 'B', offset: BSRR, value })
}

#[test]
#[should_panic = "heater ('B', 1) on"]
fn a_heater_switched_on_is_detected() {
    let (board, on) = buddy_and_store(1 << 1);
    state_after(board, &[on], true);
}

#[test]
#[should_panic = "motor ('D', 14) on"]
fn a_motor_switched_on_is_detected() {
    let (board, off) = buddy_and_store(0b11 << 16);
    state_after(board, &[off, PortWrite { port: 'D', offset: MODER, value: 1 << 28 }], false);
}

#[test]
#[should_panic = "comes before"]
fn motors_before_heaters_are_detected() {
    let (board, off) = buddy_and_store(0b11 << 16);
    assert_heaters_come_first(board, &[PortWrite { port: 'D', ..off }, off]);
}

#[test]
#[should_panic = "never switched off"]
fn a_forgotten_heater_is_detected() {
    let (board, one) = buddy_and_store(0b01 << 16);
    assert_heaters_come_first(board, &[one]);
}
