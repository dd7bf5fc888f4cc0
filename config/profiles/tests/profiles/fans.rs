//! The fans of a profile.

use ferrostep_hal_shim::FanOutput;
use ferrostep_printer::{FanRule, FanSettings, PowerSupply, SupplySignal};
use ferrostep_profiles::{builtin_text, parse};

fn with(fans: &str) -> Result<[Option<FanSettings>; 6], String> {
    let text = format!("{}\n{fans}\n", builtin_text("cartesian").unwrap());
    parse(&text, "test.toml").map(|profile| profile.fans).map_err(|error| error.to_string())
}

#[test]
fn the_usual_two_are_there_without_a_table() {
    assert_eq!(with(""), Ok(FanSettings::USUAL));
    // A table of one leaves the other.
    let fans = with("[fans.part]\nkick_start_s = 0.1\nleast_power = 0.25").unwrap();
    assert_eq!(fans[0], Some(FanSettings { kick_start_ms: 100, least_power: 64, ..FanSettings::PART }));
    assert_eq!(fans[1..], FanSettings::USUAL[1..]);
}

#[test]
fn others_have_an_output_and_what_makes_them_turn() {
    let fans = with(
        "[fans.exhaust]\noutput = \"fan2\"\nnumber = 2\n[fans.fan5]\nturns = \"controller\"\npower = 0.5\nidle_s = 30",
    )
    .unwrap();
    let fan = |output: FanOutput| fans[output.index()].unwrap();
    assert_eq!(
        (fan(FanOutput::Fan2).name, fan(FanOutput::Fan2).rule),
        ("exhaust", FanRule::Commanded { number: Some(2) })
    );
    assert_eq!(fan(FanOutput::Fan5).rule, FanRule::Controller { power: 128, idle_s: 30 });
    // A machine whose part fan hangs at another output.
    let fans = with("[fans.part]\noutput = \"fan3\"\n[fans.filter]\noutput = \"part\"").unwrap();
    assert_eq!(fans[3].unwrap().rule, FanRule::Commanded { number: Some(0) });
    assert_eq!(fans[0].unwrap().rule, FanRule::Commanded { number: None });
    // Also its hot end's fan.
    let fans = with(
        "[fans.hotend]\noutput = \"fan4\"\nturns = \"hotend\"\n[fans.light]\noutput = \"hotend\"\nturns = \"command\"",
    )
    .unwrap();
    assert_eq!((fans[4].unwrap().rule, fans[1].unwrap().rule), (FanRule::HotEnd, FanRule::Commanded { number: None }));
}

#[test]
fn what_contradicts_itself_is_refused_by_its_key() {
    for (fans, says) in [
        ("[fans.exhaust]", "fans.exhaust.output"),
        (
            "[fans.a]\noutput = \"fan2\"\n[fans.b]\noutput = \"fan2\"",
            "fans.b.output = \"fan2\": expected another output: fan2 is used by the fan a",
        ),
        (
            "[fans.a]\noutput = \"fan2\"\nnumber = 0",
            "fans.a.number = 0: expected another number: 0 is used by the fan part",
        ),
        ("[fans.hotend]\nturns = \"command\"", "fans.hotend.turns = \"command\": expected \"hotend\" for one fan"),
        ("[fans.hotend]\nnumber = 3", "fans.hotend.number = 3: expected no such key"),
        ("[fans.fan2]\nturns = \"controller\"\npower = 0", "fans.fan2.power = 0: expected above 0"),
        ("[fans.\"a b\"]\noutput = \"fan2\"", "a name of letters, digits and _"),
        ("[fans.fan2]\noutput = \"fan9\"", "fans.fan2.output"),
        ("[fans.fan2]\nspeed = 1", "fans.fan2.speed"),
        ("[fans.part]\nleast_power = 2", "fans.part.least_power = 2: expected 0 to 1"),
    ] {
        let refusal = with(fans).unwrap_err();
        assert!(refusal.contains(says), "{fans}: {refusal}");
    }
}

#[test]
fn lights_and_relays_hang_at_outputs_for_fans() {
    let outputs = with(
        "[outputs.light]\noutput = \"fan4\"\nnumber = 0\npwm = true\nat_start = 0.5\nat_halt = 0.2\n\
         [outputs.relay]\noutput = \"fan2\"\nat_start = 1",
    )
    .unwrap();
    let rule = FanRule::Output { number: Some(0), is_pwm: true, at_start: 128, at_halt: 51, color: None };
    assert_eq!(outputs[4], Some(FanSettings { name: "light", rule, ..FanSettings::PART }));
    let rule = FanRule::Output { number: None, is_pwm: false, at_start: 255, at_halt: 0, color: None };
    assert_eq!(outputs[2], Some(FanSettings { name: "relay", rule, ..FanSettings::PART }));
    assert_eq!(outputs[..2], FanSettings::USUAL[..2]);
    for (tables, says) in [
        ("[outputs.light]", "outputs.light.output"),
        ("[outputs.light]\noutput = \"nozzle1\"", "outputs.light.output"),
        (
            "[outputs.light]\noutput = \"fan2\"\nat_start = 0.5",
            "outputs.light.at_start = 0.5: expected 0 or 1, or pwm = true",
        ),
        ("[outputs.light]\noutput = \"fan2\"\nat_halt = 2", "outputs.light.at_halt = 2: expected 0 to 1"),
        (
            "[outputs.light]\noutput = \"fan2\"\n[fans.a]\noutput = \"fan2\"",
            "expected another output: fan2 is used by a",
        ),
        (
            "[outputs.a]\noutput = \"fan2\"\n[outputs.b]\noutput = \"fan2\"",
            "expected another output: fan2 is used by a",
        ),
        ("[outputs.a]\noutput = \"fan2\"\ncolor = \"red\"", "outputs.a.color = \"red\": expected pwm = true with it"),
        (
            "[outputs.a]\noutput = \"fan2\"\npwm = true\ncolor = \"red\"\n\
             [outputs.b]\noutput = \"fan3\"\npwm = true\ncolor = \"red\"",
            "outputs.b.color = \"red\": expected another color: this one is used by a",
        ),
        ("[outputs.part]\noutput = \"fan2\"\n[fans.part]\nleast_power = 0.1", "a name that no fan has"),
        ("[outputs.\"a b\"]\noutput = \"fan2\"", "a name of letters, digits and _"),
        (
            "[outputs.a]\noutput = \"fan2\"\nnumber = 3\n[outputs.b]\noutput = \"fan3\"\nnumber = 3",
            "outputs.b.number = 3: expected another number: 3 is used by a",
        ),
        (
            "[outputs.a]\noutput = \"part\"",
            "outputs.a.output = \"part\": expected another output, or a fan with number = 0",
        ),
        ("[outputs.a]\noutput = \"hotend\"", "expected \"hotend\" for one fan"),
    ] {
        let refusal = with(tables).unwrap_err();
        assert!(refusal.contains(says), "{tables}: {refusal}");
    }
}

#[test]
fn the_supplys_signal_has_a_level() {
    let signal = |keys: &str| {
        let text = format!("{}\n[power_loss]\n{keys}\n", builtin_text("cartesian").unwrap());
        parse(&text, "test.toml").map(|profile| profile.supply_signal).map_err(|error| error.to_string())
    };
    let usual = SupplySignal { failing_is_low: false, debounce_ms: 6, rise_10nm: 0 };
    assert_eq!(signal("failing_is_low = false"), Ok(Some(usual)));
    let slow = SupplySignal { failing_is_low: true, debounce_ms: 50, rise_10nm: 500_000 };
    assert_eq!(signal("failing_is_low = true\ndebounce_s = 0.05\nrise_mm = 5"), Ok(Some(slow)));
    for (keys, key) in [
        ("", "failing_is_low"),
        ("failing_is_low = true\ndebounce_s = 1", "debounce_s"),
        ("failing_is_low = true\nrise_mm = -1", "rise_mm"),
    ] {
        let refusal = signal(keys).unwrap_err();
        assert!(refusal.contains(&format!("power_loss.{key}")), "{refusal}");
    }
}

#[test]
fn a_supply_has_a_level_and_a_state_at_the_start() {
    let supply = |keys: &str| {
        let text = format!("{}\n[power_supply]\n{keys}\n", builtin_text("cartesian").unwrap());
        parse(&text, "test.toml").map(|profile| profile.power_supply).map_err(|error| error.to_string())
    };
    assert_eq!(supply("on_is_low = true"), Ok(Some(PowerSupply { on_is_low: true, on_at_start: true })));
    let off = PowerSupply { on_is_low: false, on_at_start: false };
    assert_eq!(supply("on_is_low = false\non_at_start = false"), Ok(Some(off)));
    assert!(supply("").unwrap_err().contains("power_supply.on_is_low"));
    assert!(supply("on_is_low = 1").unwrap_err().contains("power_supply.on_is_low"));
    assert!(supply("on_is_low = true\npin = \"PE11\"").unwrap_err().contains("power_supply.pin"));
}
