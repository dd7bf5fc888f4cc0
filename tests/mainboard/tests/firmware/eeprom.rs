//! M500 to M504 on a board that keeps its settings in an EEPROM: the image against the model of the
//! chip on its two wires.

use ferrostep_mainboard::machine::Machine;
use ferrostep_mainboard::parts::at24c32::At24c32;
use ferrostep_testkit::boards::{BOARDS, BoardFacts, pin};

use crate::firmware::bench::Bench;
use crate::firmware::port_log::PortState;

/// The board that has one.
fn octopus() -> &'static BoardFacts {
    BOARDS.iter().find(|board| board.name == "btt-octopus-1.1").unwrap()
}

fn chip(machine: &mut Machine) -> &mut At24c32 {
    &mut machine.plant.eeprom.as_mut().unwrap().chip
}

/// The board after its start, with an EEPROM changed before, and what it said since.
fn boot(change: impl FnOnce(&mut At24c32) + Send + 'static) -> (Bench, Vec<String>) {
    let mut bench = Bench::switch_on(octopus(), |machine| change(chip(machine)));
    let said = connect(&mut bench);
    (bench, said)
}

fn connect(bench: &mut Bench) -> Vec<String> {
    bench.host.wait_for("start", |line| line == "start").unwrap();
    let said = bench.host.listen(600).unwrap();
    bench.host.connect_again().unwrap();
    said
}

fn with_chip<T: Send + 'static>(bench: &mut Bench, act: impl FnOnce(&mut At24c32) -> T + Send + 'static) -> T {
    bench.with(move |machine, _| {
        let result = act(chip(machine));
        machine.plant.refresh_inputs();
        result
    })
}

/// The X of M203 that is in force.
fn feed(bench: &mut Bench) -> String {
    let line = bench.host.ask("M503 S0", "echo:  M203").unwrap();
    line.split(' ').find_map(|word| word.strip_prefix('X')).unwrap().to_owned()
}

/// The profile `corexy`'s.
const PROFILES: &str = "500.00";

/// Commands that make the longest record of this profile.
const ALL: [&str; 9] = [
    "M201 X5001 Y5002 Z301 E2001",
    "M203 X151 Y152 Z11 E61",
    "M204 P901 R902 T903",
    "M207 S2.5 F1800 Z0.3",
    "M208 S0.1 F1500",
    "M593 X F45 D0.12",
    "M593 Y F39 D0.08",
    "M301 P21 I1.2 D80",
    "M304 P60 I8 D300",
];

#[test]
fn settings_survive_a_reset_and_a_power_cut() {
    let (mut bench, said) = boot(|_| {});
    assert!(said.iter().all(|line| !line.contains("settings") && !line.contains("EEPROM")), "{said:?}");
    assert!(bench.host.ask("M115", "Cap:EEPROM").unwrap().ends_with(":1"));
    assert_eq!(feed(&mut bench), PROFILES);
    bench.host.send("M203 X151").unwrap();
    let stored = bench.host.ask("M500", "echo:Settings Stored").unwrap();
    assert!(stored.contains("1 values that differ"), "{stored}");
    assert!(bench.host.ask("M504", "echo:M504").unwrap().ends_with("stored are 1 values, 0 faults"));
    bench.press_reset();
    let said = connect(&mut bench);
    assert!(said.iter().any(|line| line == "echo:stored settings retrieved (1 values, 0 faults)"), "{said:?}");
    assert_eq!(feed(&mut bench), "151.00");
    bench.host.send("M502").unwrap();
    assert_eq!(feed(&mut bench), PROFILES);
    bench.host.ask("M501", "echo:stored settings retrieved").unwrap();
    assert_eq!(feed(&mut bench), "151.00");
    let (bytes, violations) = with_chip(&mut bench, |chip| (chip.bytes().to_vec(), chip.violations()));
    assert_eq!(violations, 0, "the bus keeps the times of 100 kHz");
    // Another chip, that has these bytes and is slow.
    let (mut bench, said) = boot(move |chip| {
        chip.set_bytes(&bytes);
        chip.set_write_ns(10_000_000);
    });
    assert!(said.iter().any(|line| line.contains("retrieved (1 values")), "{said:?}");
    assert_eq!(feed(&mut bench), "151.00");
    // M502 and M500 make it forget, over all four places and once more.
    for round in 0..5 {
        bench.host.send(&format!("M203 X{}", 200 + round)).unwrap();
        bench.host.ask("M500", "echo:Settings Stored").unwrap();
        bench.host.send("M502").unwrap();
        bench.host.ask("M501", "echo:stored settings").unwrap();
        assert_eq!(feed(&mut bench), format!("{}.00", 200 + round));
    }
    bench.host.send("M502").unwrap();
    assert!(bench.host.ask("M500", "echo:Settings Stored").unwrap().contains(" 0 values"));
    bench.press_reset();
    connect(&mut bench);
    assert_eq!(feed(&mut bench), PROFILES);
}

/// Heaters stay under control while the slowest chip writes the longest record, and the
/// watchdog is content.
#[test]
fn heat_goes_on_while_it_writes() {
    let (mut bench, _) = boot(|chip| chip.set_write_ns(10_000_000));
    for command in ALL {
        bench.host.send(command).unwrap();
    }
    bench.host.send("M104 S60").unwrap();
    bench.pass(20_000);
    let resets = bench.with(|machine, _| machine.resets());
    let before_ns = bench.now_ns();
    bench.host.send_raw(b"M500\n").unwrap();
    bench.wait_us(300_000);
    let mut changes = 0;
    let mut last = bench.heater_power("nozzle") > 0.0;
    for _ in 0..60 {
        bench.wait_us(5_000);
        let on = bench.heater_power("nozzle") > 0.0;
        changes += u32::from(on != last);
        last = on;
    }
    assert!(changes >= 2, "the control task switches the heater while the chip writes: {changes} changes");
    let stored = bench.host.wait_for("the end", |line| line.starts_with("echo:Settings Stored")).unwrap();
    let took_ms = (bench.now_ns() - before_ns) / 1_000_000;
    eprintln!("{stored}: {took_ms} ms");
    assert!((500..2_000).contains(&took_ms), "{took_ms} ms");
    assert_eq!(bench.with(|machine, _| machine.resets()), resets);
    bench.host.wait_for("ok", |line| line.starts_with("ok")).unwrap();
    bench.host.send_raw(b"M105\n").unwrap();
    let report = bench.host.wait_for("temperatures", |line| line.starts_with("ok T:")).unwrap();
    let celsius: f64 = report.trim_start_matches("ok T:").split(' ').next().unwrap().parse().unwrap();
    assert!((55.0..65.0).contains(&celsius), "{report}");
}

/// Breaks a chip, or mends it.
type Break = fn(&mut At24c32, bool);

#[test]
fn each_fault_is_named_and_stops_nothing() {
    let faults: [(Break, &str); 2] = [
        (|chip, broken| chip.set_plugged(!broken), "the EEPROM does not answer"),
        (|chip, broken| chip.set_sda_stuck(broken), "a line of the EEPROM (SCL or SDA) stays low"),
    ];
    for (break_it, words) in faults {
        let (mut bench, said) = boot(move |chip| break_it(chip, true));
        let expected = format!("echo:M501: {words}: the profile's settings are in force");
        assert!(said.contains(&expected), "{said:?}");
        bench.host.send("M203 X151").unwrap();
        let line = bench.host.ask("M500", "echo:M500").unwrap();
        assert_eq!(line, format!("echo:M500: nothing is stored: {words}"));
        assert_eq!(bench.host.ask("M501", "echo:M501").unwrap(), expected);
        assert_eq!(feed(&mut bench), "151.00", "what is in force stays");
        with_chip(&mut bench, move |chip| break_it(chip, false));
        bench.host.ask("M500", "echo:Settings Stored").unwrap();
        bench.host.ask("M501", "echo:stored settings retrieved (1 values, 0 faults)").unwrap();
    }
    // A protected chip acknowledges and does not write: reading back shows it.
    let (mut bench, _) = boot(|chip| chip.set_protected(true));
    bench.host.send("M203 X151").unwrap();
    let line = bench.host.ask("M500", "echo:M500").unwrap();
    assert_eq!(line, "echo:M500: nothing is stored: the memory for settings does not work");
}

/// The chip is reset while the EEPROM sends a byte, and then pulls SDA low: clocks end it.
#[test]
fn a_reset_within_a_read_harms_nothing() {
    let (mut bench, _) = boot(|_| {});
    for command in ALL {
        bench.host.send(command).unwrap();
    }
    bench.host.ask("M500", "echo:Settings Stored").unwrap();
    let mut held = 0;
    for round in 0..5 {
        bench.host.send_raw(b"M501\n").unwrap();
        bench.wait_us(9_000 + 1_230 * round);
        held += u32::from(with_chip(&mut bench, |chip| chip.pulls_sda()));
        bench.press_reset();
        let said = connect(&mut bench);
        assert!(said.iter().any(|line| line.starts_with("echo:stored settings retrieved (")), "{round}: {said:?}");
        assert_eq!(feed(&mut bench), "151.00");
    }
    assert!(held >= 2, "the line was held {held} times");
}

/// The power goes at instants within M500: the settings are those before it or those after it.
#[test]
fn a_power_cut_leaves_the_old_settings_or_the_new() {
    let (mut bench, _) = boot(|_| {});
    bench.host.send("M203 X151").unwrap();
    bench.host.ask("M500", "echo:Settings Stored").unwrap();
    let old = with_chip(&mut bench, |chip| chip.bytes().to_vec());
    let (mut kept, mut new) = (0, 0);
    for round in 0..5 {
        let bytes = old.clone();
        let (mut bench, _) = boot(move |chip| chip.set_bytes(&bytes));
        for command in ALL {
            bench.host.send(command).unwrap();
        }
        bench.host.send("M203 X152").unwrap();
        bench.host.send_raw(b"M500\n").unwrap();
        // The erasure of 32 pages and 11 pages of the record take some 450 ms, reading before
        // and after 200 ms.
        bench.wait_us(20_000 + 280_000 * round);
        let now_ns = bench.now_ns();
        let left = with_chip(&mut bench, move |chip| {
            chip.set_power(now_ns, false);
            chip.bytes().to_vec()
        });
        let (mut bench, said) = boot(move |chip| chip.set_bytes(&left));
        assert!(said.iter().any(|line| line.starts_with("echo:stored settings retrieved (")), "{round}: {said:?}");
        match feed(&mut bench).as_str() {
            "151.00" => kept += 1,
            "152.00" => new += 1,
            other => panic!("{round}: {other}"),
        }
        bench.host.send("M203 X153").unwrap();
        bench.host.ask("M500", "echo:Settings Stored").unwrap();
        bench.host.ask("M501", "echo:stored settings").unwrap();
        assert_eq!(feed(&mut bench), "153.00");
    }
    eprintln!("{kept} with the old settings, {new} with the new ones");
    assert!(kept >= 2 && new >= 1, "{kept}, {new}");
}

/// Marlin's pin table: neither line is ever driven high.
#[test]
fn the_lines_are_open_drain() {
    const OTYPER: u32 = 0x04;
    let (mut bench, _) = boot(|_| {});
    let lines = ["B8", "B9"].map(pin);
    let (mut state, mut open_drain) = (PortState::new(), false);
    for write in bench.port_writes() {
        open_drain |= write.port == 'B' && write.offset == OTYPER && write.value >> 8 & 0b11 == 0b11;
        state.apply(write);
        assert!(open_drain || lines.iter().all(|line| !state.is_output(*line)), "{write:x?}");
    }
    assert!(lines.iter().all(|line| state.is_output(*line)));
}
