//! A profile that names a part that the board lacks is refused, with the profile's line.

use std::sync::atomic::{AtomicU32, Ordering};

use ferrostep_boards::{builtin_names, fit, load};

/// The line number of a text in a built-in profile.
fn line_of(profile: &str, part: &str) -> usize {
    let text = ferrostep_profiles::builtin_text(profile).unwrap();
    1 + text.lines().position(|line| line.starts_with(part)).unwrap()
}

/// The error of a profile after a replacement, on a board.
fn error_after(board: &str, profile: &str, from: &str, to: &str) -> Option<String> {
    let text = ferrostep_profiles::builtin_text(profile).unwrap();
    assert!(text.contains(from), "{from}");
    // The profile is a file, as a user's own: errors name the line of that file.
    // Tests run at the same time.
    static FILES: AtomicU32 = AtomicU32::new(0);
    let name = format!("ferrostep-{}-{}.toml", std::process::id(), FILES.fetch_add(1, Ordering::Relaxed));
    let path = std::env::temp_dir().join(name);
    // The MINI's tachometers are its board's alone.
    let text = if board == "prusa-buddy" { text.to_owned() } else { text.replace("least_rpm = 1000", "least_rpm = 0") };
    std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
    let path_text = path.to_str().unwrap();
    let profile = ferrostep_profiles::load(path_text).unwrap();
    let error = fit::check(&load(board).unwrap(), &profile, path_text).err();
    std::fs::remove_file(&path).unwrap();
    error.map(|error| error.to_string().replace(path_text, "test.toml"))
}

#[test]
fn every_board_can_be_its_own_profile() {
    for name in builtin_names() {
        let board = load(name).unwrap();
        let profile = ferrostep_profiles::load(&board.profile).unwrap();
        fit::check(&board, &profile, &board.profile).unwrap();
    }
}

#[test]
fn both_edges_are_for_drivers_that_are_told_so() {
    let (from, to) = ("both_edges = false", "both_edges = true");
    // Over their lines they are: these profiles set all four drivers.
    for (board, name) in [("prusa-buddy", "prusa-mini"), ("btt-octopus-1.1", "corexy")] {
        let profile = ferrostep_profiles::load(name).unwrap();
        assert!(profile.driver.both_edges, "{name}");
        fit::check(&load(board).unwrap(), &profile, name).unwrap();
    }
    // This one sets none.
    let text = ferrostep_profiles::builtin_text("cartesian").unwrap().replace(from, to);
    let profile = ferrostep_profiles::parse(&text, "test.toml").unwrap();
    // Nothing that steps hangs on the bench.
    fit::check(&load("bench").unwrap(), &profile, "cartesian").unwrap();
    let error = fit::check(&load("btt-octopus-1.1").unwrap(), &profile, "cartesian").unwrap_err().to_string();
    let line = line_of("cartesian", from);
    assert_eq!(
        error,
        format!(
            "cartesian:{line}: driver.both_edges = true: expected false: motors.x of the board btt-octopus-1.1 is driven \
             by a socket, which steps at rising edges unless it is a tmc2209 with a line and a table [drivers.x]"
        )
    );
}

#[test]
fn drivers_are_connected_as_the_board_says() {
    let wiring = |board: &str, profile: &str| {
        fit::wiring(&load(board).unwrap(), &ferrostep_profiles::load(profile).unwrap())
            .into_iter()
            .map(|wiring| wiring.map(|wiring| (wiring.line, wiring.address, wiring.sense_milliohm)))
            .collect::<Vec<_>>()
    };
    let shared = [(0, 1, 220), (0, 3, 220), (0, 0, 220), (0, 2, 220)].map(Some);
    assert_eq!(wiring("prusa-buddy", "prusa-mini"), shared);
    assert_eq!(wiring("btt-octopus-1.1", "corexy"), [(0, 0, 110), (1, 0, 110), (2, 0, 110), (3, 0, 110)].map(Some));
    assert_eq!(wiring("btt-octopus-1.1", "cartesian"), [None; 4]);
    assert_eq!(wiring("bench", "corexy"), [None; 4]);
}

#[test]
fn sensors_are_where_the_profile_wants_them() {
    let sensors = |board: &str, profile: &str| {
        fit::sensor_pins(&load(board).unwrap(), &ferrostep_profiles::load(profile).unwrap())
            .map(|sensor| sensor.map(|(pin, triggers_low)| (pin.to_string(), triggers_low)))
    };
    let high = |pins: [&str; 3]| pins.map(|pin| Some((pin.to_owned(), false)));
    assert_eq!(sensors("prusa-buddy", "prusa-mini"), high(["PE2", "PE1", "PA8"]));
    assert_eq!(sensors("btt-octopus-1.1", "corexy"), high(["PG6", "PG9", "PG10"]));
    // A socket's stall signal comes over its end stop's pin.
    assert_eq!(sensors("btt-octopus-1.1", "prusa-mini"), high(["PG6", "PG9", "PB7"]));
    assert_eq!(sensors("prusa-buddy", "corexy"), [None, None, None]);
    let text = ferrostep_profiles::builtin_text("corexy").unwrap().replacen(
        "\"end-stop\"\n",
        "\"end-stop\"\ntriggers_low = true\n",
        1,
    );
    let profile = ferrostep_profiles::parse(&text, "test.toml").unwrap();
    let low = fit::sensor_pins(&load("btt-octopus-1.1").unwrap(), &profile).map(|sensor| sensor.unwrap().1);
    assert_eq!(low, [true, false, false]);
}

#[test]
fn a_filament_sensor_needs_an_input() {
    for (board, profile, pin, constant) in [
        ("btt-octopus-1.1", "corexy", "PG12", "Some(SensorPin { port: 6, number: 12, triggers_low: true })"),
        ("prusa-buddy", "prusa-mini", "PB4", "Some(SensorPin { port: 1, number: 4, triggers_low: true })"),
    ] {
        let board = load(board).unwrap();
        let plain = ferrostep_profiles::load(profile).unwrap();
        assert_eq!(fit::filament_pin(&board, &plain), None, "no profile says that there is one");
        let text = ferrostep_profiles::builtin_text(profile).unwrap();
        let [motion, text] =
            ["kind = \"motion\"", "missing_is_low = true"].map(|keys| format!("{text}\n[filament_sensor]\n{keys}\n"));
        let motion = ferrostep_profiles::parse(&motion, "test.toml").unwrap();
        assert_eq!(fit::filament_pin(&board, &motion).unwrap().0.to_string(), pin);
        let profile = ferrostep_profiles::parse(&text, "test.toml").unwrap();
        let (found, missing_is_low) = fit::filament_pin(&board, &profile).unwrap();
        assert_eq!((found.to_string().as_str(), missing_is_low), (pin, true));
        let [without, with] = [&plain, &profile].map(|profile| ferrostep_boards::constants::sensors(&board, profile));
        assert!(with.contains(&format!("FILAMENT: Option<SensorPin> = {constant};")), "{with}");
        assert!(without.contains("FILAMENT: Option<SensorPin> = None;"), "{without}");
        // Clock, pull-up and mode.
        let stores = |text: &str| text.matches("Store {").count();
        assert!(stores(&with) >= stores(&without) + 3, "{with}");
        fit::check(&board, &profile, "test.toml").unwrap();
        let mut bare = board.clone();
        bare.inputs.retain(|(input, _)| *input != "filament");
        let error = fit::check(&bare, &profile, "test.toml").unwrap_err().to_string();
        assert!(error.contains("filament_sensor") && error.contains("has no input `filament`"), "{error}");
    }
}

/// The Octopus has a second connector for it (Marlin's pin table: FIL_RUNOUT2_PIN is PG13),
/// the Buddy has none.
#[test]
fn a_second_filament_sensor_needs_a_second_input() {
    let profile = |name: &str| {
        let sensors = "[filament_sensor]\nkind = \"motion\"\n[filament_switch]\nmissing_is_low = true\n";
        let text = format!("{}\n{sensors}", ferrostep_profiles::builtin_text(name).unwrap());
        ferrostep_profiles::parse(&text, "test.toml").unwrap()
    };
    let board = load("btt-octopus-1.1").unwrap();
    let corexy = profile("corexy");
    fit::check(&board, &corexy, "test.toml").unwrap();
    let (pin, missing_is_low) = fit::filament_switch_pin(&board, &corexy).unwrap();
    assert_eq!((pin.to_string().as_str(), missing_is_low), ("PG13", true));
    let items = ferrostep_boards::constants::sensors(&board, &corexy);
    let constant = "FILAMENT_SWITCH: Option<SensorPin> = Some(SensorPin { port: 6, number: 13, triggers_low: true });";
    assert!(items.contains(constant), "{items}");
    let plain = ferrostep_boards::constants::sensors(&board, &ferrostep_profiles::load("corexy").unwrap());
    assert!(plain.contains("FILAMENT_SWITCH: Option<SensorPin> = None;"), "{plain}");
    let error = fit::check(&load("prusa-buddy").unwrap(), &profile("prusa-mini"), "test.toml").unwrap_err().to_string();
    assert!(error.contains("filament_switch") && error.contains("has no input `filament2`"), "{error}");
}

#[test]
fn the_supplys_signal_needs_the_boards_input() {
    let check = |board: &str, profile: &str| {
        let text = ferrostep_profiles::builtin_text(profile).unwrap();
        let text = format!("{text}\n[power_loss]\nfailing_is_low = false\n");
        let profile = ferrostep_profiles::parse(&text, "test.toml").unwrap();
        let board = load(board).unwrap();
        let constant = ferrostep_boards::constants::sensors(&board, &profile);
        fit::check(&board, &profile, "test.toml").map(|()| constant).map_err(|error| error.to_string())
    };
    let constant = check("btt-octopus-1.1", "corexy").unwrap();
    let pin = "POWER_LOSS: Option<SensorPin> = Some(SensorPin { port: 2, number: 0, triggers_low: false });";
    assert!(constant.contains(pin), "{constant}");
    let error = check("prusa-buddy", "prusa-mini").unwrap_err();
    assert!(error.contains("power_loss") && error.contains("has no input `power_loss`"), "{error}");
}

#[test]
fn fans_need_outputs_and_tachometers_that_the_board_has() {
    let check = |board: &str, fans: &str| {
        let text = format!("{}\n{fans}", ferrostep_profiles::builtin_text("corexy").unwrap());
        let profile = ferrostep_profiles::parse(&text, "test.toml").unwrap();
        fit::check(&load(board).unwrap(), &profile, "test.toml").map_err(|error| error.to_string())
    };
    assert_eq!(check("btt-octopus-1.1", "[fans.exhaust]\noutput = \"fan5\"\nnumber = 2"), Ok(()));
    for board in ["prusa-buddy", "bench"] {
        let no_output = check(board, "[fans.exhaust]\noutput = \"fan2\"\nnumber = 2").unwrap_err();
        let expected = format!("fans.exhaust.output = fan2: expected an output of the board {board}: part, hotend");
        assert!(no_output.contains(&expected), "{no_output}");
    }
    let no_tacho = check("btt-octopus-1.1", "[fans.hotend]\nleast_rpm = 500").unwrap_err();
    assert!(no_tacho.contains("fans.hotend.least_rpm = 500: expected no such key"), "{no_tacho}");
    assert_eq!(check("btt-octopus-1.1", "[fans.part]\nkick_start_s = 0.1\nleast_power = 0.2"), Ok(()));
}

#[test]
fn pulses_are_as_long_as_the_driver_wants() {
    let error = error_after("prusa-buddy", "prusa-mini", "pulse_width_us = 0.2", "pulse_width_us = 0.05").unwrap();
    let line = line_of("prusa-mini", "pulse_width_us");
    let expected = "driver.pulse_width_us = 0.05: expected at least 0.1 us for the tmc2209";
    assert!(error.starts_with(&format!("test.toml:{line}: {expected}")), "{error}");
}

#[test]
fn a_current_is_what_the_sense_resistors_allow() {
    let (from, to) = ("current_ma = 350", "current_ma = 1000");
    let error = error_after("prusa-buddy", "prusa-mini", from, to).unwrap();
    let line = line_of("prusa-mini", from);
    let expected = "drivers.x.current_ma = 1000: expected 17 to 958 mA at the 0.22 ohm of the board prusa-buddy";
    assert_eq!(error, format!("test.toml:{line}: {expected}"));
    assert_eq!(error_after("prusa-buddy", "prusa-mini", from, "current_ma = 950"), None);
    // A driver plugged into a socket has the usual resistors.
    assert_eq!(error_after("btt-octopus-1.1", "prusa-mini", from, to), None);
    let error = error_after("btt-octopus-1.1", "prusa-mini", from, "current_ma = 1800").unwrap();
    assert!(
        error.ends_with(
            "drivers.x.current_ma = 1800: expected 31 to 1768 mA at the 0.11 ohm of the board btt-octopus-1.1"
        ),
        "{error}"
    );
}

#[test]
fn an_axis_homes_by_what_the_board_has() {
    // The Buddy board has no end stop for Z but a probe; X and Y have the drivers' stall signals.
    let text = std::fs::read_to_string("prusa-buddy.toml").unwrap();
    let without_probe = text.replace("probe = \"PA8\"\n", "");
    let board = ferrostep_boards::parse(&without_probe, "test.toml").unwrap();
    let profile = ferrostep_profiles::load("prusa-mini").unwrap();
    let error = fit::check(&board, &profile, "prusa-mini").unwrap_err().to_string();
    assert!(error.contains(": homing.z.sensor = \"probe\": expected a sensor of the board"), "{error}");
    assert!(error.ends_with("whose inputs are filament, button"), "{error}");
}

#[test]
fn a_heaters_thermistor_is_the_boards() {
    let line = line_of("prusa-mini", "sensor = \"epcos-100k\"");
    let error = |board: &str, from: &str, to: &str| error_after(board, "prusa-mini", from, to);
    let (from, to) = ("sensor = \"epcos-100k\"", "sensor = \"semitec-104gt-2\"");
    assert_eq!(
        error("prusa-buddy", from, to).unwrap(),
        format!(
            "test.toml:{line}: bed.sensor = \"semitec-104gt-2\": expected \"epcos-100k\", the thermistor at the input \
             bed of the board prusa-buddy"
        )
    );
    // The Octopus leaves its thermistors to the profile.
    assert_eq!(error("btt-octopus-1.1", from, to), None);
    let to = "sensor = \"epcos-100k\"\npull_up_ohm = 2200";
    for board in ["prusa-buddy", "btt-octopus-1.1", "bench"] {
        assert_eq!(
            error(board, from, to).unwrap(),
            format!(
                "test.toml:{}: bed.pull_up_ohm = 2200: expected 4700 ohm, the resistor of the board {board}",
                line + 1
            )
        );
    }
}

#[test]
fn a_board_that_heats_has_both_heaters() {
    let text = std::fs::read_to_string("prusa-buddy.toml").unwrap();
    let without = text.replace("[heaters.bed]\npin = \"PB0\"\ntimer = \"TIM3_CH3\"\nsensor = \"bed\"\n", "");
    assert!(without.len() < text.len());
    let board = ferrostep_boards::parse(&without, "test.toml").unwrap();
    let profile = ferrostep_profiles::load("prusa-mini").unwrap();
    let error = fit::check(&board, &profile, "prusa-mini").unwrap_err().to_string();
    assert!(
        error.contains(": bed.sensor = \"epcos-100k\": expected one of the heaters nozzle of the board"),
        "{error}"
    );
}

#[test]
fn a_supply_is_switched_where_the_board_has_an_output_for_it() {
    let of = |board, profile| error_after(board, profile, "[driver]", "[power_supply]\non_is_low = true\n[driver]");
    assert_eq!(of("btt-octopus-1.1", "corexy"), None);
    let line = line_of("prusa-mini", "[driver]");
    let expected = format!(
        "test.toml:{line}: power_supply = a table: expected no such table: the board prusa-buddy has no output `power_supply`"
    );
    assert_eq!(of("prusa-buddy", "prusa-mini"), Some(expected));
}

#[test]
fn a_probes_pin_is_moved_where_the_board_has_an_output_for_a_servo() {
    let of = |board, profile| error_after(board, profile, "[driver]", "[bltouch]\n[driver]");
    let line = line_of("prusa-mini", "[driver]");
    let expected = format!(
        "test.toml:{line}: bltouch = a table: expected no such table: the board prusa-buddy has no output `servo`"
    );
    assert_eq!(of("prusa-buddy", "prusa-mini"), Some(expected));
}

#[test]
fn a_chamber_hangs_at_the_board_s_connectors() {
    let of = |board, profile, sensor, keys: &str| {
        let chamber = format!("[chamber]\nsensor = {sensor}\nmin_celsius = 0\nmax_celsius = 80\n{keys}\n[driver]");
        error_after(board, profile, "[driver]", &chamber)
    };
    let epcos = "\"epcos-100k\"";
    let both = "thermistor = \"nozzle1\"\nheater = \"nozzle3\"";
    assert_eq!(of("btt-octopus-1.1", "corexy", epcos, both), None);
    assert_eq!(of("prusa-buddy", "prusa-mini", epcos, "thermistor = \"probe\""), None);
    for (keys, says) in [
        (both, "chamber.thermistor = nozzle1: expected input for a thermistor of the board prusa-buddy: "),
        ("thermistor = \"probe\"\nheater = \"nozzle1\"", "chamber.heater = nozzle1: expected no table [chamber]"),
    ] {
        let error = of("prusa-buddy", "prusa-mini", epcos, keys).unwrap();
        assert!(error.contains(says), "{error}");
    }
    let error = of("btt-octopus-1.1", "corexy", epcos, "thermistor = \"nozzle1\"\npull_up_ohm = 1000").unwrap();
    assert!(error.contains("chamber.pull_up_ohm = 1000: expected 4700 ohm, the resistor"), "{error}");
}

#[test]
fn a_light_hangs_at_an_output_of_the_board() {
    let light = "[outputs.light]\noutput = \"fan4\"\n[driver]";
    assert_eq!(error_after("btt-octopus-1.1", "corexy", "[driver]", light), None);
    let error = error_after("prusa-buddy", "prusa-mini", "[driver]", light).unwrap();
    assert!(
        error.contains("outputs.light.output = fan4: expected an output of the board prusa-buddy: hotend, part")
            || error.contains("outputs.light.output"),
        "{error}"
    );
}

/// A profile whose Z these motors lift.
fn lifted(motors: &str) -> ferrostep_printer::Profile {
    let text = format!("{}\n[z_motors.motors]\n{motors}", ferrostep_profiles::builtin_text("corexy").unwrap());
    ferrostep_profiles::parse(&text, "test.toml").unwrap()
}

#[test]
fn further_motors_of_z_are_the_boards() {
    let octopus = || load("btt-octopus-1.1").unwrap();
    let three = lifted("z = {}\nz2 = { inverted = true }\ne1 = {}\n");
    fit::check(&octopus(), &three, "test.toml").unwrap();
    let board = octopus().for_machine(&three);
    let names: Vec<&str> = board.moving_motors().map(|motor| motor.name).collect();
    assert_eq!(names, ["x", "y", "z", "e", "z2", "e1"]);
    // C, F and G; the fourth is on E.
    assert_eq!(board.motor_ports(), [2, 5, 6]);
    let four = lifted("z = {}\nz2 = {}\ne1 = {}\ne2 = {}\n");
    fit::check(&octopus(), &four, "test.toml").unwrap();
    assert_eq!(octopus().for_machine(&four).motor_ports(), [2, 4, 5, 6]);
    // Each has its own line and the settings of Z.
    let wiring: Vec<_> = fit::wiring(&octopus(), &three).into_iter().flatten().map(|wiring| wiring.line).collect();
    assert_eq!(wiring, [0, 1, 2, 3, 4, 5]);
    let error = fit::check(&load("prusa-buddy").unwrap(), &three, "test.toml").unwrap_err().to_string();
    assert!(error.contains("expected no table [z_motors]: the board prusa-buddy has no motors to spare"), "{error}");
    let without_e1 = ferrostep_boards::builtin_text("btt-octopus-1.1").unwrap().replace("[motors.e1]", "[motors.e4]");
    assert!(ferrostep_boards::parse(&without_e1, "own.toml").is_err());
    let [start, end] = ["[motors.e1]", "[motors.e2]"]
        .map(|table| ferrostep_boards::builtin_text("btt-octopus-1.1").unwrap().find(table).unwrap());
    let text = ferrostep_boards::builtin_text("btt-octopus-1.1").unwrap();
    let own = ferrostep_boards::parse(&format!("{}{}", &text[..start], &text[end..]), "own.toml").unwrap();
    let error = fit::check(&own, &three, "test.toml").unwrap_err().to_string();
    assert!(
        error.contains("z_motors.motors.e1") && error.contains("motors of the board btt-octopus-1.1: z, z2, e2, e3"),
        "{error}"
    );
    // A fifth port would cost the step interrupt too much.
    let error = fit::check(&octopus(), &lifted("z = {}\ne1 = {}\ne3 = {}\n"), "test.toml").unwrap_err().to_string();
    assert!(error.contains("on 4 ports at most, not on A, C, E, F, G"), "{error}");
}

/// A further motor's driver that does not step at both edges, or not at that current,
/// is found as well.
#[test]
fn further_motors_have_drivers_that_can_be_set() {
    let text = ferrostep_boards::builtin_text("btt-octopus-1.1").unwrap();
    let with = |from: &str, to: &str| {
        assert!(text.contains(from));
        let board = ferrostep_boards::parse(&text.replacen(from, to, 1), "own.toml").unwrap();
        fit::check(&board, &lifted("z = {}\nz2 = {}\n"), "test.toml").unwrap_err().to_string()
    };
    let error = with("driver = \"socket\"\nuart = \"PC7\"", "driver = \"a4988\"");
    assert!(error.contains("motors.z2 of the board btt-octopus-1.1 is driven by a a4988"), "{error}");
    let error = with("uart = \"PC7\"", "uart = \"PC7\"\nsense_resistor_ohm = 0.9");
    assert!(error.contains("drivers.z.current_ma = 800"), "{error}");
}

/// A profile with a second tool.
fn two_tools(t1: &str) -> ferrostep_printer::Profile {
    let driver = "driver = { current_ma = 700, hold_current_percent = 60, microsteps = 16, interpolate = true, stealth_chop = false, \
                  spread_cycle_above_mm_per_s = 0, stall_threshold = 0 }";
    let text = ferrostep_profiles::builtin_text("corexy").unwrap();
    let text = format!("{text}\n[tools.t1]\noffset_mm = {{ x = 20, y = 0, z = 0 }}\n{driver}\n{t1}\n");
    ferrostep_profiles::parse(&text, "test.toml").unwrap()
}

#[test]
fn a_second_tools_motor_heater_and_thermistor_are_the_boards() {
    let octopus = || load("btt-octopus-1.1").unwrap();
    let two = two_tools("motor = \"e1\"\ninverted = true\nheater = \"nozzle1\"\nthermistor = \"nozzle2\"");
    fit::check(&octopus(), &two, "test.toml").unwrap();
    let board = octopus().for_machine(&two);
    let names: Vec<&str> = board.moving_motors().map(|motor| motor.name).collect();
    assert_eq!(names, ["x", "y", "z", "e", "e1"]);
    assert!(board.further_e.iter().all(|(_, is_inverted)| *is_inverted));
    // Its driver has its own place, after those that further motors of Z would have.
    let wiring = fit::wiring(&octopus(), &two);
    assert_eq!((wiring.len(), wiring[7].unwrap().line), (8, 7));
    assert_eq!(wiring[4..7], [None; 3]);
    for (board, profile, says) in [
        ("prusa-buddy", &two, "expected no table [tools]: the board prusa-buddy has no motors to spare"),
        (
            "btt-octopus-1.1",
            &two_tools("motor = \"e1\"\nheater = \"nozzle1\"\n[tools.t1.nozzle]\npull_up_ohm = 1000"),
            "tools.t1.nozzle.pull_up_ohm",
        ),
    ] {
        let error = fit::check(&load(board).unwrap(), profile, "test.toml").unwrap_err().to_string();
        assert!(error.contains(says), "{error}");
    }
}
