//! The fans of a profile.

use ferrostep_hal_shim::FanOutput;
use ferrostep_printer::{FanRule, FanSettings};
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
    // Its hot end's, too.
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
            "fans.b.output = \"fan2\": expected another output: fan2 is the fan a's",
        ),
        ("[fans.a]\noutput = \"fan2\"\nnumber = 0", "fans.a.number = 0: expected another number: 0 is the fan part's"),
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
