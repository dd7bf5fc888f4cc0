//! The fans: their outputs, their control, and their slowest speed.

use ferrostep_checked_toml::{Range, Section, range};
use ferrostep_hal_shim::FanOutput;
use ferrostep_printer::LightColor::{Blue, Green, Red, White};
use ferrostep_printer::{FanRule, FanSettings, FanTable};

use crate::names::check_name;

const NUMBER: Range = range(0.0, 255.0, "");
const POWER: Range = range(0.0, 1.0, "of full power");
const KICK_START: Range = range(0.0, 10.0, "s");
const IDLE: Range = range(0.0, 3_600.0, "s");
const SPEED: Range = range(0.0, 30_000.0, "turns/min");
/// Longest name, bytes.
const MAX_NAME: usize = 32;

/// Control of a fan, read before its other keys.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Turns {
    ByCommand,
    HotEnd,
    Controller,
}

/// 0 to 1 as 0 to 255.
fn byte(share: f64) -> u8 {
    (share * 255.0).round() as u8
}

/// The fans by their outputs.
pub(crate) fn fans(keys: &Section<'_>) -> FanTable {
    let sections = keys.named_sections(
        "fans",
        "NAME",
        "`part` and `hotend`, at the outputs of these names",
        "[fans](fans.md); `part` and `hotend` exist without a table",
        "a fan of this name, for SET_FAN_SPEED and M123",
    );
    let mut table = FanSettings::USUAL;
    let mut names: [Option<&str>; FanOutput::COUNT] = [None; FanOutput::COUNT];
    for (name, section) in &sections {
        let (output, settings) = fan(name, section);
        check_name(keys, &format!("fans.{name}"), name, MAX_NAME);
        let (Some(output), index) = (output, output.map_or(0, FanOutput::index)) else { continue };
        if let Some(other) = names[index].replace(name) {
            let expected = format!("another output: {} is used by the fan {other}", output.name());
            section.refuse("output", expected);
        }
        table[index] = Some(settings);
    }
    let outputs = keys.named_sections(
        "outputs",
        "NAME",
        "no outputs",
        "[lights and relays](fans.md#lights-and-relays) at the board's outputs for fans",
        "an output of this name, for SET_PIN and M123",
    );
    for (name, section) in &outputs {
        let (output, settings) = other_output(name, section);
        check_name(keys, &format!("outputs.{name}"), name, MAX_NAME);
        if sections.iter().any(|(fan, _)| fan.eq_ignore_ascii_case(name)) {
            keys.refuse(&format!("outputs.{name}"), "a name that no fan has");
        }
        let Some(output) = output else { continue };
        if let Some(other) = names[output.index()].replace(name) {
            section.refuse("output", format!("another output: {} is used by {other}", output.name()));
        }
        table[output.index()] = Some(settings);
    }
    check_outputs(keys, &table);
    for (at, fan) in table.iter().enumerate() {
        let Some(FanSettings { name, rule: FanRule::Commanded { number: Some(number) }, .. }) = fan else { continue };
        let is_same = |other: &&FanSettings| other.rule == FanRule::Commanded { number: Some(*number) };
        if let Some(other) = table.iter().take(at).flatten().find(is_same) {
            let expected = format!("another number: {number} is used by the fan {}", other.name);
            keys.refuse(&format!("fans.{name}.number"), expected);
        }
    }
    if !table.iter().flatten().any(|fan| fan.rule == FanRule::HotEnd) {
        let place = names[FanOutput::HotEnd.index()].unwrap_or("hotend");
        let expected = "\"hotend\" for one fan: without it the filament melts on its way to the nozzle";
        keys.refuse(&format!("fans.{place}.turns"), expected);
    }
    table
}

/// A fan and its output; `None` if it is refused.
fn fan(name: &'static str, keys: &Section<'_>) -> (Option<FanOutput>, FanSettings) {
    let output = keys
        .word("output", FanOutput::ALL.map(|output| (output.name(), output)))
        .optional("the output of that name", "the board's output")
        .or_else(|| FanOutput::ALL.into_iter().find(|output| output.name() == name));
    if output.is_none() {
        keys.refuse("output", "an output of the board: part, hotend or fan2 to fan5");
    }
    let usual = if output == Some(FanOutput::HotEnd) { Turns::HotEnd } else { Turns::ByCommand };
    let turns = keys
        .word("turns", [("command", Turns::ByCommand), ("hotend", Turns::HotEnd), ("controller", Turns::Controller)])
        .optional(
            "`\"hotend\"` at the output `hotend`, else `\"command\"`",
            "on M106 and SET_FAN_SPEED; while a nozzle is hot; or while motors have current or the bed heats",
        )
        .unwrap_or(usual);
    let number = keys
        .whole("number", NUMBER)
        .optional("0 for `part`, else none", "P of M106 and M107, for a commanded fan")
        .map(|number| number as u8);
    let power = keys.number("power", POWER).or(1.0, "power of a controller fan");
    let idle_s = keys.number("idle_s", IDLE).or(60.0, "time that a controller fan runs on after the motors");
    let settings = FanSettings {
        name,
        rule: match turns {
            Turns::ByCommand if name == "part" => FanRule::Commanded { number: Some(number.unwrap_or(0)) },
            Turns::ByCommand => FanRule::Commanded { number },
            Turns::HotEnd => FanRule::HotEnd,
            Turns::Controller => FanRule::Controller { power: byte(power), idle_s: idle_s.round() as u16 },
        },
        kick_start_ms: (keys.number("kick_start_s", KICK_START).or(0.0, "time at full power when the fan starts") * 1e3)
            .round() as u16,
        least_power: byte(
            keys.number("least_power", POWER).or(0.0, "minimum power: lower settings above 0 are raised to it"),
        ),
        least_rpm: keys
            .number("least_rpm", SPEED)
            .or(
                0.0,
                "minimum speed at full power, below which [a print pauses](fans.md#a-fan-that-does-not-turn); 0 = not \
                 checked",
            )
            .round() as u16,
    };
    if number.is_some() && turns != Turns::ByCommand {
        keys.refuse("number", "no such key: this fan does not turn by command");
    }
    if turns == Turns::Controller && byte(power) == 0 {
        keys.refuse("power", "above 0: it would never turn");
    }
    (output, settings)
}

/// No two outputs have a number or a colour, and M106 still has its fan.
fn check_outputs(keys: &Section<'_>, table: &FanTable) {
    let number = |fan: &FanSettings| if let FanRule::Output { number, .. } = fan.rule { number } else { None };
    let color = |fan: &FanSettings| if let FanRule::Output { color, .. } = fan.rule { color } else { None };
    for (at, fan) in table.iter().enumerate() {
        let Some((fan, wanted)) = fan.as_ref().and_then(|fan| Some((fan, color(fan)?))) else { continue };
        if let Some(other) = table.iter().take(at).flatten().find(|other| color(other) == Some(wanted)) {
            keys.refuse(
                &format!("outputs.{}.color", fan.name),
                format!("another color: this one is used by {}", other.name),
            );
        }
    }
    for (at, fan) in table.iter().enumerate() {
        let Some((fan, wanted)) = fan.as_ref().and_then(|fan| Some((fan, number(fan)?))) else { continue };
        if let Some(other) = table.iter().take(at).flatten().find(|other| number(other) == Some(wanted)) {
            let expected = format!("another number: {wanted} is used by {}", other.name);
            keys.refuse(&format!("outputs.{}.number", fan.name), expected);
        }
    }
    let has_part_fan = table.iter().flatten().any(|fan| fan.rule == FanRule::Commanded { number: Some(0) });
    if let Some(Some(FanSettings { name, rule: FanRule::Output { .. }, .. })) = table.first()
        && !has_part_fan
    {
        let expected = "another output, or a fan with number = 0 elsewhere: M106 sets that one";
        keys.refuse(&format!("outputs.{name}.output"), expected);
    }
}

/// An output that is not a fan's; `None` if it is refused.
fn other_output(name: &'static str, keys: &Section<'_>) -> (Option<FanOutput>, FanSettings) {
    let output = keys
        .word("output", FanOutput::ALL.map(|output| (output.name(), output)))
        .optional("none, and the table is refused", "fan output of the board");
    if output.is_none() {
        keys.refuse("output", "an output of the board: part, hotend or fan2 to fan5");
    }
    let number = keys.whole("number", NUMBER).optional("set by name only", "P of M42").map(|number| number as u8);
    let is_pwm =
        keys.flag("pwm").or(false, "PWM for values between off and full; without it, M42 S1 and above is full");
    let color = keys.word("color", [("red", Red), ("green", Green), ("blue", Blue), ("white", White)]).optional(
        "none",
        "colour channel of a light: [M150](fans.md#a-light-of-several-colours) R, U, B or W; needs pwm = true",
    );
    if color.is_some() && !is_pwm {
        keys.refuse("color", "pwm = true with it");
    }
    let power = |key, about| {
        let power = keys.number(key, POWER).or(0.0, about);
        if !is_pwm && power != 0.0 && power != 1.0 {
            keys.refuse(key, "0 or 1, or pwm = true");
        }
        byte(power)
    };
    let at_start = power("at_start", "value at start-up");
    let at_halt =
        power("at_halt", "value while the machine is [halted](safety.md#what-happens-then), and after a panic");
    let rule = FanRule::Output { number, is_pwm, at_start, at_halt, color };
    (output, FanSettings { name, rule, kick_start_ms: 0, least_power: 0, least_rpm: 0 })
}
