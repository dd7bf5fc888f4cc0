//! Every key missing, misspelt, mistyped or out of range is refused with its name, value and line.

use ferrostep_checked_toml::keys::{holder, paths};
use ferrostep_planner::{AccelerationProfile, Interpolation, MotionChoice};
use ferrostep_printer::ExtrusionSettings;
use ferrostep_profiles::{Problem, ProfileError, builtin_names, builtin_text, parse};
use toml::{Table, Value};

pub(crate) fn text() -> &'static str {
    builtin_text("cartesian").unwrap()
}

fn table() -> Table {
    text().parse().unwrap()
}

fn refused(table: &Table) -> ProfileError {
    let text = toml::to_string(table).unwrap();
    parse(&text, "test.toml").expect_err(&text)
}

/// The one-line error after a replacement in the cartesian profile.
fn error_after(from: &str, to: &str) -> String {
    assert_eq!(text().matches(from).count(), 1, "{from:?} must occur once");
    parse(&text().replace(from, to), "test.toml").expect_err(to).to_string()
}

/// Line number of a text in the cartesian profile, counted from 1.
pub(crate) fn line(wanted: &str) -> usize {
    1 + text().lines().position(|line| line.contains(wanted)).unwrap()
}

fn value<'a>(root: &'a mut Table, path: &str) -> &'a mut Value {
    let (first, rest) = path.split_once('.').map_or((path, None), |(first, rest)| (first, Some(rest)));
    let inner = root.get_mut(first).unwrap();
    match rest {
        None => inner,
        Some(rest) => value(inner.as_table_mut().unwrap(), rest),
    }
}

#[test]
fn all_keys_are_seen() {
    // 68 values in 14 tables: that the loops below have something to do.
    let keys = paths(&table());
    assert_eq!(keys.len(), 82, "{keys:?}");
}

/// A table that may be left out, and each of its keys.
const OPTIONAL: &str = "instantaneous_corner_velocity_mm_per_s";

#[test]
fn each_key_is_required() {
    for path in paths(&table()).into_iter().filter(|path| !path.starts_with(OPTIONAL)) {
        let mut table = table();
        let (holder, last) = holder(&mut table, &path).unwrap();
        holder.remove(last).unwrap();
        let error = refused(&table);
        assert!(matches!(error.problem(), Problem::MissingKey { key, .. } if *key == path), "{path}: {error}");
    }
}

#[test]
fn corners_have_limits_where_nothing_is_said() {
    let corners = |text: &str| parse(text, "test.toml").unwrap().limits.instantaneous_corner_velocity_mm_per_s;
    let written = format!("{OPTIONAL} = {{ z = 5, e = 10 }}");
    assert!(text().contains(&written));
    let infinite = f64::INFINITY;
    assert_eq!(corners(&text().replace(&written, "")), [infinite, infinite, 5.0, 10.0]);
    let own = format!("{OPTIONAL} = {{ x = 8, y = 7.5, z = 0.4 }}");
    assert_eq!(corners(&text().replace(&written, &own)), [8.0, 7.5, 0.4, 10.0]);
}

#[test]
fn each_misspelt_key_is_named_with_the_right_ones() {
    for path in paths(&table()) {
        let mut table = table();
        let (holder, last) = holder(&mut table, &path).unwrap();
        let value = holder.remove(last).unwrap();
        // At the front, where no two keys become alike.
        let misspelt = format!("z{last}");
        holder.insert(misspelt.clone(), value);
        let error = refused(&table);
        let Problem::UnknownKey { key, meant, expected } = error.problem() else {
            panic!("{path}: {error}");
        };
        assert_eq!(*key, format!("{}{misspelt}", path.strip_suffix(last).unwrap()));
        assert!(expected.contains(&format!("\"{last}\"")), "{path}: {error}");
        if last.len() > 3 {
            assert_eq!(meant.as_deref(), Some(last), "{path}");
        }
        assert!(error.line().is_some());
    }
}

#[test]
fn each_number_has_a_range() {
    let mut numbers = 0;
    for path in paths(&table()) {
        if !value(&mut table(), &path).is_integer() && !value(&mut table(), &path).is_float() {
            continue;
        }
        numbers += 1;
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -1e9, 1e12, f64::MAX] {
            let mut table = table();
            *value(&mut table, &path) = Value::Float(bad);
            let error = refused(&table);
            assert!(
                matches!(error.problem(), Problem::OutOfRange { key, .. } if *key == path),
                "{path} = {bad}: {error}"
            );
        }
    }
    assert_eq!(numbers, 57);
}

#[test]
fn each_value_has_a_type() {
    for path in paths(&table()) {
        for bad in [Value::Boolean(true), Value::Integer(1), Value::String("?".into()), Value::Array(vec![])] {
            let mut table = table();
            let value = value(&mut table, &path);
            // The name may be any text; numbers and flags have separate tests.
            let fits = bad.same_type(value) || (bad.is_integer() && value.is_float());
            if fits && !(bad.is_str() && path != "name") {
                continue;
            }
            *value = bad;
            let error = refused(&table);
            assert!(matches!(error.problem(), Problem::WrongType { key, .. } if *key == path), "{path}: {error}");
        }
    }
}

#[test]
fn errors_read_as_they_should() {
    let feed = line("max_feed_mm_per_s =");
    assert_eq!(
        error_after("{ x = 200, y = 200, z = 10, e = 60 }", "{ x = 200, y = -5, z = 10, e = 60 }"),
        format!("test.toml:{feed}: max_feed_mm_per_s.y = -5: expected 0.01 to 2000 mm/s")
    );
    assert_eq!(
        error_after("{ x = 200, y = 200, z = 10, e = 60 }", "{ x = 200, y = 200, e = 60 }"),
        format!("test.toml:{feed}: missing key \"max_feed_mm_per_s.z\", expected 0.01 to 2000 mm/s")
    );
    assert_eq!(
        error_after("jerk_mm_per_s3 = 10000", ""),
        "test.toml: missing key \"jerk_mm_per_s3\", expected 1 to 10000000 mm/s^3"
    );
    assert_eq!(
        error_after("max_celsius = 125\n", ""),
        format!("test.toml:{}: missing key \"bed.max_celsius\", expected 60 to 200 degrees Celsius", line("[bed]"))
    );
    assert_eq!(
        error_after("slow_mm_per_s = 2\n", "slow_mm_per_second = 2\n"),
        format!(
            "test.toml:{}: unknown key \"homing.z.slow_mm_per_second\", expected \"end\", \"sensor\", \
             \"triggers_low\", \"position_mm\", \"fast_mm_per_s\", \"slow_mm_per_s\", \"back_off_mm\", \
             \"overrun_mm\" or \"agree_mm\"",
            line("[homing.z]") + 5
        )
    );
    assert_eq!(
        error_after("kinematics = \"cartesian\"", "kinematics = \"delta\""),
        format!(
            "test.toml:{}: kinematics = \"delta\": expected \"cartesian\", \"corexy\" or \"corexz\"",
            line("kinematics =")
        )
    );
    assert_eq!(
        error_after("both_edges = false", "both_edges = 0"),
        format!("test.toml:{}: driver.both_edges = 0: expected true or false", line("both_edges ="))
    );
    let named = error_after("both_edges = false", "both_edges = false\ninverted = [\"x\", \"w\"]");
    let key = line("both_edges =") + 1;
    assert_eq!(
        named,
        format!("test.toml:{key}: driver.inverted = [\"x\", \"w\"]: expected a list of \"x\", \"y\", \"z\" or \"e\"")
    );
    let syntax = error_after("[driver]", "[driver");
    assert!(syntax.starts_with(&format!("test.toml:{}: not valid TOML: ", line("[driver]"))), "{syntax}");
    assert!(!syntax.contains('\n'), "{syntax}");
}

#[test]
fn names_that_would_break_a_report_are_refused() {
    for bad in ["", "   ", "two\\nlines", "caf\\u00e9", "123456789012345678901234567890123"] {
        let error = error_after("name = \"cartesian\"", &format!("name = \"{bad}\""));
        assert!(error.contains("name = \""), "{error}");
        assert!(error.contains("printable ASCII"), "{error}");
        assert!(!error.contains('\n'), "{error}");
    }
}

/// A profile after a replacement, with the key that is to blame.
pub fn assert_conflict(profile: &str, from: &str, to: &str, blamed: &str) {
    let text = builtin_text(profile).unwrap();
    assert!(text.contains(from), "{from}");
    let error = parse(&text.replacen(from, to, 1), "test.toml").expect_err(to);
    assert!(matches!(error.problem(), Problem::OutOfRange { key, .. } if key == blamed), "{blamed}: {error}");
}

#[test]
fn home_lies_inside_the_travel_and_at_its_end() {
    assert_conflict("corexy", "position_mm = 300", "position_mm = 300.01", "homing.x.position_mm");
    assert_conflict("corexy", "position_mm = 300", "position_mm = 149", "homing.x.position_mm");
    assert_conflict("cartesian", "position_mm = 0", "position_mm = 200", "homing.x.position_mm");
    assert_conflict("cartesian", "position_mm = 0", "position_mm = -0.01", "homing.x.position_mm");
    assert_conflict("cartesian", "end = \"min\"", "end = \"max\"", "homing.x.position_mm");
}

#[test]
fn homing_keeps_to_the_axis_and_its_speed() {
    assert_conflict("cartesian", "fast_mm_per_s = 4", "fast_mm_per_s = 10.5", "homing.z.fast_mm_per_s");
    assert_conflict("cartesian", "slow_mm_per_s = 25", "slow_mm_per_s = 51", "homing.x.slow_mm_per_s");
    assert_conflict("cartesian", "\"end-stop\"\n", "\"probe\"\n", "homing.x.sensor");
}

#[test]
fn homing_by_stall_needs_a_driver_with_a_signal_and_a_fast_motor() {
    // Z does not home by a stall, and a machine without such drivers has no signal.
    assert_conflict("prusa-mini", "\"probe\"\n", "\"stall\"\n", "homing.z.sensor");
    assert_conflict("cartesian", "\"end-stop\"\n", "\"stall\"\n", "homing.x.sensor");
    assert_conflict("prusa-mini", "\"stall\"\n", "\"stall\"\ntriggers_low = true\n", "homing.x.sensor");
    assert_conflict("prusa-mini", "stealth_chop = true\n", "stealth_chop = false\n", "homing.x.sensor");
    assert_conflict("prusa-mini", "stall_threshold = 130", "stall_threshold = 0", "drivers.x.stall_threshold");
    // 200 full steps of 16 microsteps at 100 steps/mm.
    assert_conflict("prusa-mini", "slow_mm_per_s = 50", "slow_mm_per_s = 31.9", "homing.x.slow_mm_per_s");
    let (from, to) = ("spread_cycle_above_mm_per_s = 0\n", "spread_cycle_above_mm_per_s = 50\n");
    assert_conflict("prusa-mini", from, to, "drivers.x.spread_cycle_above_mm_per_s");
    // 50 mm/s at 1250 mm/s^2 take 1 mm, which is to be half of the path back.
    assert_conflict("prusa-mini", "back_off_mm = 2.56", "back_off_mm = 1.99", "homing.x.back_off_mm");
    let text = builtin_text("prusa-mini").unwrap();
    for (from, to) in [
        ("slow_mm_per_s = 50", "slow_mm_per_s = 32"),
        (from, "spread_cycle_above_mm_per_s = 51\n"),
        ("back_off_mm = 2.56", "back_off_mm = 2"),
        ("\"probe\"\n", "\"probe\"\ntriggers_low = true\n"),
    ] {
        assert!(text.contains(from), "{from}");
        parse(&text.replacen(from, to, 1), "test.toml").unwrap();
    }
}

#[test]
fn a_step_pulse_fits_between_two_events() {
    // Two levels of 1 us are exactly the interval.
    assert_conflict("cartesian", "us = 1.0", "us = 1.001", "driver.pulse_width_us");
    let text = builtin_text("cartesian").unwrap().replace("us = 1.0", "us = 2.0");
    let both_edges = text.replace("both_edges = false", "both_edges = true");
    assert!(parse(&text, "test.toml").is_err());
    assert_eq!(parse(&both_edges, "test.toml").unwrap().driver.pulse_width_ns, 2000);
}

#[test]
fn motors_step_no_faster_than_events_may_follow() {
    // 500,000 steps/s at 2 us: exactly at x 1000 mm/s and 500 steps/mm.
    let fast = |feed: &str, steps: &str, profile: &str| {
        let text = builtin_text(profile).unwrap();
        let text = text.replace("{ x = 200, y = 200, z = 10", &format!("{{ x = {feed}, y = 200, z = 10"));
        let text = text.replace("{ x = 80, y = 80", &format!("{{ x = {steps}, y = 80"));
        parse(&text, "test.toml")
    };
    assert!(fast("1000", "500", "cartesian").is_ok());
    let error = fast("1000", "500.1", "cartesian").unwrap_err();
    assert_eq!(error.key(), Some("max_feed_mm_per_s.x"));

    // A motor of a CoreXY machine sees the sum of both axes' speeds: 1000 mm/s at 160
    // steps/mm, 6.25 us a step.
    assert_conflict(
        "corexy",
        "minimum_event_interval_us = 2.0",
        "minimum_event_interval_us = 6.26",
        "max_feed_mm_per_s.x",
    );
    let enough =
        builtin_text("corexy").unwrap().replace("minimum_event_interval_us = 2.0", "minimum_event_interval_us = 6.25");
    assert!(parse(&enough, "test.toml").is_ok());
}

#[test]
fn extrusion_is_allowed_below_the_nozzle_limit_only() {
    assert_conflict("cartesian", "min_extrusion_celsius = 170", "min_extrusion_celsius = 275", "min_extrusion_celsius");
}

#[test]
fn dotted_keys_and_other_spellings_of_the_same_values_are_the_same_profile() {
    for name in builtin_names() {
        let text = builtin_text(name).unwrap();
        let table: Table = text.parse().unwrap();
        // The writer turns the inline tables into sections.
        let sections = toml::to_string(&table).unwrap();
        assert_eq!(parse(&sections, "sections").unwrap(), parse(text, name).unwrap());
        assert_eq!(parse(&text.replace('\n', "\r\n"), "crlf").unwrap(), parse(text, name).unwrap());
    }
    let dotted = text()
        .replace("size_mm = { x = 200, y = 200, z = 200 }", "size_mm.x = 2e2\nsize_mm.y = 200.0\nsize_mm.z = 0xC8");
    assert_eq!(parse(&dotted, "dotted").unwrap(), parse(text(), "plain").unwrap());
    let error = parse(&dotted.replace("size_mm.y = 200.0\n", ""), "dotted").unwrap_err();
    assert_eq!(error.key(), Some("size_mm.y"));
}

#[test]
fn filament_by_length_is_chosen_and_kept_within_its_ranges() {
    let with = |text: &str| parse(&format!("{}\n[extrusion]\n{text}", builtin_text("cartesian").unwrap()), "test.toml");
    assert_eq!(with("").unwrap().extrusion, ExtrusionSettings::DEFAULT);
    assert_eq!(with("mode = \"gcode\"").unwrap().extrusion, ExtrusionSettings::DEFAULT);
    let chosen = "mode = \"adaptive\"\nlayer_height_mm = 1\nline_width_mm = 2.5\nfilament_diameter_mm = 40";
    let expected = ExtrusionSettings {
        adaptive: true,
        layer_height_10nm: 100_000,
        line_width_10nm: 250_000,
        filament_diameter_10nm: 4_000_000,
    };
    assert_eq!(with(chosen).unwrap().extrusion, expected);
    for (text, blamed) in [
        ("layer_height_mm = 0", "extrusion.layer_height_mm"),
        ("layer_height_mm = nan", "extrusion.layer_height_mm"),
        ("line_width_mm = 20.1", "extrusion.line_width_mm"),
        ("filament_diameter_mm = -1.75", "extrusion.filament_diameter_mm"),
        ("mode = \"volumetric\"", "extrusion.mode"),
        ("nozzle_mm = 0.4", "extrusion.nozzle_mm"),
    ] {
        assert_eq!(with(text).unwrap_err().key(), Some(blamed), "{text}");
    }
}

#[test]
fn the_motion_may_be_left_out_but_not_misspelt() {
    let with = |text: &str| parse(&format!("{text}\n{}", builtin_text("cartesian").unwrap()), "test.toml");
    let plain = with("").unwrap().motion;
    assert_eq!(plain, MotionChoice::DEFAULT);
    let chosen = with("interpolation = \"dual-rate\"\nacceleration = \"s-curve-table\"").unwrap().motion;
    assert_eq!(chosen.interpolation, Interpolation::DualRate);
    assert_eq!(chosen.acceleration, AccelerationProfile::SCurveTable);
    for choice in Interpolation::ALL {
        assert_eq!(with(&format!("interpolation = \"{}\"", choice.name())).unwrap().motion.interpolation, choice);
    }
    for choice in AccelerationProfile::ALL {
        assert_eq!(with(&format!("acceleration = \"{}\"", choice.name())).unwrap().motion.acceleration, choice);
    }
    for (text, blamed) in [
        ("interpolation = \"straight\"", "interpolation"),
        ("acceleration = 3", "acceleration"),
        ("dual_rate = { min_period_us = 10 }", "dual_rate.max_period_us"),
        ("dual_rate = { min_period_us = 10, max_period_us = 9 }", "dual_rate.max_period_us"),
        ("dual_rate = { min_period_us = 0, max_period_us = 9 }", "dual_rate.min_period_us"),
        ("s_curve_table = { start_hz = 1000, top_hz = 1000, jerk_hz_per_s2 = 1 }", "s_curve_table.top_hz"),
        ("s_curve_table = { start_hz = 900000, top_hz = 1000000, jerk_hz_per_s2 = 1 }", "a table of at most 65536"),
        ("s_curve_table = { start_hz = 1000000, top_hz = 1000000, jerk_hz_per_s2 = 1 }", "expected 1 to 999999"),
        ("s_curve_table = { start_hz = 0, top_hz = 1000, jerk_hz_per_s2 = 1 }", "s_curve_table.start_hz"),
        ("s_curve_table = { start_hz = 1, top_hz = 1000, jerk_hz_per_s2 = nan }", "s_curve_table.jerk_hz_per_s2"),
        ("s_curve_table = { start_hz = 1, top_hz = 1000, jerk_hz_per_s2 = -1 }", "s_curve_table.jerk_hz_per_s2"),
    ] {
        let error = with(text).unwrap_err().to_string();
        assert!(error.starts_with("test.toml:1: ") && error.contains(blamed), "{error}");
    }
}

#[test]
fn a_budget_may_be_left_out_but_not_misspelt() {
    let with = |tail: &str| parse(&format!("{}\n{tail}", text()), "test.toml");
    let costs = |tail: &str| {
        let profile = with(tail).unwrap();
        (profile.event_cost_ticks, profile.move_cost_ticks)
    };
    assert_eq!(costs(""), (210, 10_500));
    assert_eq!(costs("[budget]\n"), (210, 10_500));
    assert_eq!(costs("[budget]\nmoves_per_s = 1000\n"), (210, 84_000));
    assert_eq!(costs("[budget]\nevents_per_s = 900000\n"), (94, 10_500));
    let misspelt = with("[budget]\nlines_per_s = 8000\n").unwrap_err().to_string();
    assert!(misspelt.contains("unknown key \"budget.lines_per_s\""), "{misspelt}");
    for (key, value) in
        [("events_per_s", "999"), ("events_per_s", "10000001"), ("moves_per_s", "9"), ("moves_per_s", "nan")]
    {
        let error = with(&format!("[budget]\n{key} = {value}\n")).unwrap_err();
        let blamed = format!("budget.{key}");
        assert!(matches!(error.problem(), Problem::OutOfRange { key, .. } if *key == blamed), "{error}");
    }
}

#[test]
fn settings_of_drivers_are_checked() {
    let text = builtin_text("prusa-mini").unwrap();
    let x = text.find("[drivers.x]").unwrap();
    let with = |from: &str, to: &str| {
        let (head, tail) = text.split_at(x);
        assert!(tail.contains(from), "{from}");
        parse(&format!("{head}{}", tail.replacen(from, to, 1)), "test.toml")
    };
    for (from, to, blamed) in [
        ("current_ma = 350", "current_ma = 19", "drivers.x.current_ma"),
        ("current_ma = 350", "current_ma = 3001", "drivers.x.current_ma"),
        ("current_ma = 350", "current_ma = 350.5", "drivers.x.current_ma"),
        ("current_ma = 350", "current_ma = nan", "drivers.x.current_ma"),
        ("current_ma = 350", "current = 350", "drivers.x.current"),
        ("current_ma = 350\n", "", "drivers.x.current_ma"),
        ("hold_current_percent = 100", "hold_current_percent = 101", "drivers.x.hold_current_percent"),
        ("hold_current_percent = 100", "hold_current_percent = -1", "drivers.x.hold_current_percent"),
        ("microsteps = 16", "microsteps = 0", "drivers.x.microsteps"),
        ("microsteps = 16", "microsteps = 17", "drivers.x.microsteps"),
        ("microsteps = 16", "microsteps = 512", "drivers.x.microsteps"),
        ("microsteps = 16", "microsteps = 1.5", "drivers.x.microsteps"),
        ("interpolate = true", "interpolate = 1", "drivers.x.interpolate"),
        ("stealth_chop = true", "stealth_chop = \"on\"", "drivers.x.stealth_chop"),
        ("mm_per_s = 0", "mm_per_s = -1", "drivers.x.spread_cycle_above_mm_per_s"),
        ("mm_per_s = 0", "mm_per_s = 60.5", "drivers.x.spread_cycle_above_mm_per_s"),
        ("mm_per_s = 0", "mm_per_s = inf", "drivers.x.spread_cycle_above_mm_per_s"),
        ("stall_threshold = 130", "stall_threshold = 256", "drivers.x.stall_threshold"),
        ("[drivers.x]", "[drivers.a]", "drivers.a"),
    ] {
        let error = with(from, to).unwrap_err();
        assert_eq!(error.key(), Some(blamed), "{to}: {error}");
    }
    let seventeen = with("microsteps = 16", "microsteps = 17").unwrap_err().to_string();
    assert!(
        seventeen.ends_with("drivers.x.microsteps = 17: expected 1, 2, 4, 8, 16, 32, 64, 128 or 256"),
        "{seventeen}"
    );
    // Each is optional.
    let changed = with("mm_per_s = 0", "mm_per_s = 100").unwrap().drivers;
    assert_eq!(changed[0].unwrap().spread_cycle_above_mm_per_s, 100);
    assert_eq!(changed[1].unwrap().spread_cycle_above_mm_per_s, 0);
    let without = parse(&text[..x].replace("\"stall\"\n", "\"end-stop\"\n"), "test.toml").unwrap().drivers;
    assert_eq!(without, [None; 4]);
    let edges = text.replace("both_edges = false", "both_edges = true");
    assert!(parse(&edges, "test.toml").unwrap().drivers[3].unwrap().both_edges);
}
