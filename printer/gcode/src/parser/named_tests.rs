//! Commands with names.
#![allow(clippy::unwrap_used)]

use super::tests::{number, reads, reads_with, refused, some};
use crate::{AxisWords, Command, NOT_EXECUTED, NotExecuted, PinCommand, WaitTarget, parse};

#[test]
fn limits_heat_layers_and_pauses_are_executed() {
    let limit = |velocity: &str, acceleration: &str| Command::VelocityLimit {
        velocity: (!velocity.is_empty()).then(|| number(velocity)),
        acceleration: (!acceleration.is_empty()).then(|| number(acceleration)),
        corner: None,
        cruise_ratio: None,
        to_deceleration: None,
    };
    let short_moves = |ratio, to_deceleration| Command::VelocityLimit {
        velocity: None,
        acceleration: some("3000"),
        corner: None,
        cruise_ratio: ratio,
        to_deceleration,
    };
    let corners = "of the limits VELOCITY, ACCEL and SQUARE_CORNER_VELOCITY have an effect";
    reads("SET_VELOCITY_LIMIT ACCEL=3000", limit("", "3000"));
    reads("set_velocity_limit velocity=150.5  Accel=3000 ACCEL=2000", limit("150.5", "2000"));
    reads_with("SET_VELOCITY_LIMIT ACCEL=3000 ACCEL_TO_DECEL=1500", short_moves(None, some("1500")), corners);
    reads_with("SET_VELOCITY_LIMIT ACCEL=3000 MINIMUM_CRUISE_RATIO=0.25", short_moves(some("0.25"), None), corners);
    reads_with("SET_VELOCITY_LIMIT ACCEL=3000 ACCEL_TO_DECEL=fast", limit("", "3000"), corners);
    let Command::VelocityLimit { velocity, acceleration, .. } = limit("", "") else { unreachable!() };
    let corner = Some(number("5"));
    let corner = Command::VelocityLimit { velocity, acceleration, corner, cruise_ratio: None, to_deceleration: None };
    reads("SET_VELOCITY_LIMIT SQUARE_CORNER_VELOCITY=5", corner);
    reads("SET_HEATER_TEMPERATURE HEATER=extruder TARGET=210", Command::SetNozzle(Some(0), some("210")));
    reads("SET_HEATER_TEMPERATURE HEATER=heater_bed TARGET=60.5", Command::SetBed(some("60.5")));
    reads("SET_HEATER_TEMPERATURE HEATER=EXTRUDER", Command::SetNozzle(Some(0), some("0")));
    let other = "heaters and thermometers are extruder, heater_bed and chamber; no effect";
    reads_with("SET_HEATER_TEMPERATURE HEATER=dryer TARGET=40", Command::Accepted, other);
    reads_with("TEMPERATURE_WAIT SENSOR=raspberry_pi MINIMUM=40", Command::Accepted, other);
    reads("SET_HEATER_TEMPERATURE HEATER=chamber TARGET=40", Command::SetChamber(some("40")));
    for name in ["chamber", "'heater_generic chamber'", "\"temperature_sensor Chamber\""] {
        let text = format!("TEMPERATURE_WAIT SENSOR={name} MINIMUM=40");
        reads(&text, Command::WaitChamber(WaitTarget::AtLeast(number("40"))));
    }
    reads("TEMPERATURE_WAIT SENSOR=extruder MINIMUM=200", Command::WaitNozzle(Some(0), WaitTarget::Current));
    let cooling = "MAXIMUM: cooling is not waited for; no effect";
    let wait = Command::WaitBed(WaitTarget::Current);
    reads_with("TEMPERATURE_WAIT SENSOR=heater_bed MINIMUM=50 MAXIMUM=70", wait, cooling);
    reads_with("TEMPERATURE_WAIT SENSOR=heater_bed MAXIMUM=40", Command::Accepted, cooling);
    reads("TURN_OFF_HEATERS", Command::HeatersOff);
    reads("SET_PRINT_STATS_INFO TOTAL_LAYER=50", Command::Layer { current: None, total: Some(50) });
    reads("SET_PRINT_STATS_INFO CURRENT_LAYER=3", Command::Layer { current: Some(3), total: None });
    let fan = |name, power| Command::NamedFan { name, power };
    reads("SET_FAN_SPEED FAN=exhaust SPEED=0.5", fan("exhaust", 128));
    reads("SET_FAN_SPEED SPEED=1 FAN=Part", fan("Part", 255));
    reads("SET_PIN PIN=light VALUE=0", fan("light", 0));
    reads("SET_LED LED=case RED=1 GREEN=0.5", Command::SetLight { colors: [255, 128, 0, 0] });
    reads("set_led led=case white=.1", Command::SetLight { colors: [0, 0, 0, 26] });
    reads_with("SET_PIN PIN=light VALUE=200", fan("light", 255), "V is too large and becomes the largest value");
    for (name, width_us) in
        [("pin_down", 650), ("touch_mode", 1_165), ("pin_up", 1_475), ("self_test", 1_780), ("RESET", 2_190)]
    {
        reads(&format!("BLTOUCH_DEBUG COMMAND={name}"), Command::ProbePin(PinCommand::Pulses { width_us }));
    }
    reads("PAUSE", Command::Pause(AxisWords::default()));
    reads("Resume", Command::ResumePrint);
}

#[test]
fn what_is_missing_or_malformed_is_refused() {
    for (text, expected) in [
        ("SET_VELOCITY_LIMIT", "VELOCITY or ACCEL with a number above 0"),
        ("SET_VELOCITY_LIMIT ACCEL=0", "VELOCITY or ACCEL with a number above 0"),
        ("SET_VELOCITY_LIMIT ACCEL=fast VELOCITY=10", "VELOCITY or ACCEL with a number above 0"),
        ("SET_VELOCITY_LIMIT ACCEL=1e4", "VELOCITY or ACCEL with a number above 0"),
        (
            "SET_HEATER_TEMPERATURE TARGET=200",
            "HEATER=extruder, extruder1, heater_bed or chamber, and TARGET with a number",
        ),
        (
            "SET_HEATER_TEMPERATURE HEATER=extruder TARGET={t}",
            "HEATER=extruder, extruder1, heater_bed or chamber, and TARGET with a number",
        ),
        (
            "TEMPERATURE_WAIT SENSOR=extruder",
            "SENSOR=extruder, extruder1, heater_bed or chamber, and MINIMUM or MAXIMUM with a number",
        ),
        ("SET_FAN_SPEED SPEED=1", "FAN with a name, and SPEED with a number from 0 to 1"),
        ("SET_FAN_SPEED FAN=a SPEED=-0.1", "FAN with a name, and SPEED with a number from 0 to 1"),
        ("SET_LED LED=case RED=2", "LED with a name, and RED, GREEN, BLUE or WHITE with a number from 0 to 1"),
        ("SET_PIN PIN=light", "PIN with a name, and VALUE with a number from 0 to 1"),
        ("BLTOUCH_DEBUG", "COMMAND=pin_down, pin_up, touch_mode, self_test or reset"),
        ("BLTOUCH_DEBUG COMMAND=pin", "COMMAND=pin_down, pin_up, touch_mode, self_test or reset"),
        ("SET_PRINT_STATS_INFO CURRENT_LAYER=-1", "TOTAL_LAYER or CURRENT_LAYER with a number"),
    ] {
        let command = text.split(' ').next().unwrap();
        assert_eq!(refused(text), format!("{command}: expected {expected}"), "{text}");
    }
}

/// Klipper ignores a word that a command does not have; if another is missing, it is the
/// likeliest cause.
#[test]
fn unknown_words_are_named() {
    use crate::AdvanceWords;
    let advance = Command::PressureAdvance(None, AdvanceWords { slow: some("0.0660"), ..AdvanceWords::default() });
    reads_with(
        "SET_PRESSURE_ADVANCE ADVANCE=0.0660 ADVANCE_LOOKAHEAD_TIME=0.010",
        advance,
        "ADVANCE_LOOKAHEAD_TIME has no effect",
    );
    let fan = Command::NamedFan { name: "a", power: 255 };
    reads_with("SET_PIN PIN=a VALUE=1 CYCLE_TIME=0.01", fan, "CYCLE_TIME has no effect");
    reads_with("TURN_OFF_HEATERS now", Command::HeatersOff, "now has no effect");
    reads_with("PAUSE REASON=x A=1", Command::Pause(AxisWords::default()), "REASON and others have no effect");
    for (text, word) in [
        ("SET_PRESSURE_ADVANCE K=0.05", "K"),
        ("SET_INPUT_SHAPER SHAPER_FREQUENCY_X=40", "SHAPER_FREQUENCY_X"),
        ("SET_FAN_SPEED FAN=a VALUE=1", "VALUE"),
        ("SET_VELOCITY_LIMIT ACCELERATION=1000", "ACCELERATION"),
        ("ACTIVATE_EXTRUDER extruder1", "extruder1"),
    ] {
        assert!(refused(text).contains(&format!(": unknown word \"{word}\", expected ")), "{}", refused(text));
    }
}

/// Commands that begin, pause and end files for Klipper are known, and a remark says why
/// they do nothing.
#[test]
fn what_means_nothing_here_says_so() {
    for (text, says) in [
        ("bed_mesh_profile LOAD=default", "M420 S1 follows the mesh that M500 has stored"),
        ("EXCLUDE_OBJECT_DEFINE NAME=cube CENTER=100,100", "all are printed"),
        ("EXCLUDE_OBJECT_START NAME=cube", "all are printed"),
        ("START_PRINT EXTRUDER_TEMP=210 BED_TEMP=60", "write G28, M190 and M109"),
        ("PRINT_START", "nothing is homed"),
        ("END_PRINT", "heaters, fan and motors stay on"),
        ("PRINT_END", "heaters, fan and motors stay on"),
        ("TIMELAPSE_TAKE_FRAME", "there is no such output"),
    ] {
        assert_eq!(parse(text), Ok(Command::Accepted), "{text}");
        let entry = NotExecuted::of(text).unwrap_or_else(|| panic!("{text}"));
        assert!(entry.to_string().contains(says), "{text}: {entry}");
    }
    // No name hides another, and none is executed as well.
    for entry in NOT_EXECUTED.iter().filter(|entry| entry.letter == crate::NAMED) {
        for name in entry.name.split(", ") {
            let name = name.replace('*', "_X");
            assert_eq!(NotExecuted::find_named(name.as_bytes()).unwrap().1.name, entry.name, "{name}");
        }
    }
    assert_eq!(parse("BED_MESHES"), Ok(Command::Unknown("BED_MESHES")));
}

/// The bed's mesh by Klipper's words.
#[test]
fn the_beds_mesh() {
    use crate::{BedArea, BedCommand};
    let measure = |area| Command::Bed(BedCommand::Measure { area, unless_on: false });
    reads("BED_MESH_CALIBRATE", measure(None));
    let [left, front, right, back] = ["10", "20.5", "100", "110"].map(super::tests::some);
    let area = BedArea { left, right, front, back, is_size: false };
    reads("bed_mesh_calibrate MESH_MIN=10,20.5 mesh_max=100,110", measure(Some(area)));
    reads_with("BED_MESH_CALIBRATE ADAPTIVE=1", measure(None), "ADAPTIVE has no effect");
    reads_with("BED_MESH_CALIBRATE ADAPTIVE=1 METHOD=scan", measure(None), "ADAPTIVE and others have no effect");
    reads("BED_MESH_CLEAR", Command::Bed(BedCommand::Clear));
    reads("PROBE_ACCURACY SAMPLES=20", Command::Bed(BedCommand::Repeat { samples: Some(20), x: None, y: None }));
    for text in ["BED_MESH_CALIBRATE MESH_MIN=1,2", "BED_MESH_CALIBRATE MESH_MIN=1 MESH_MAX=2,3"] {
        assert_eq!(refused(text), "BED_MESH_CALIBRATE: expected MESH_MIN and MESH_MAX with x,y, or neither", "{text}");
    }
    assert_eq!(refused("PROBE_ACCURACY SAMPLES=256"), "PROBE_ACCURACY: expected SAMPLES with a number up to 255");
}
