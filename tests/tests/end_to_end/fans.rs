//! Fans by number and by name, in prints and prepared jobs.

use ferrostep_gpre::Encoding;
use ferrostep_hal_shim::{FanOutput, Heater};
use ferrostep_printer::Profile;
use ferrostep_profiles::{builtin_text, parse};
use ferrostep_virtual_board::HeaterFailure;

use crate::end_to_end::desk::{rehearse_from, rehearse_traced};
use crate::end_to_end::entries::entries;
use crate::end_to_end::hosts::{Conversation, Machine, machine};
use crate::end_to_end::prepared::prepared;

const FANS: &str = "\n[fans.exhaust]\noutput = \"fan2\"\nnumber = 2\n[fans.electronics]\noutput = \"fan5\"\n\
                    turns = \"controller\"\npower = 0.5\n[fans.light]\noutput = \"fan3\"\n";

fn with_fans() -> Profile {
    parse(&format!("{}{FANS}", builtin_text("cartesian").unwrap()), "fans.toml").unwrap()
}

const OUTPUTS: &str = "\n[outputs.light]\noutput = \"fan3\"\nnumber = 1\npwm = true\nat_start = 0.2\nat_halt = 1\n\
                       [outputs.relay]\noutput = \"fan2\"\nnumber = 0\nat_start = 1\n";

fn powers(machine: &Machine) -> [u8; FanOutput::COUNT] {
    FanOutput::ALL.map(|fan| machine.heaters().fan_power(fan))
}

#[test]
fn each_fan_turns_as_its_rule_says_and_with_the_motion() {
    let machine = machine(&with_fans());
    let mut conversation = Conversation::new(&machine);
    let mut say = |line: &str| {
        let replies = conversation.say(line);
        assert_eq!(replies.last().map(String::as_str), Some("ok"), "{line}: {replies:?}");
        powers(&machine)
    };
    say("G4 P100");
    assert_eq!(powers(&machine), [0; 6]);
    say("G28");
    say("M106 P2 S100");
    say("SET_PIN PIN=light VALUE=1");
    say("G4 P100");
    assert_eq!(powers(&machine), [0, 0, 100, 255, 0, 128], "motors are on");
    // Ten seconds of motion, then the exhaust stops: not before.
    say("G1 X100 F600");
    say("M107 P2");
    say("SET_FAN_SPEED FAN=part SPEED=0.2");
    assert_eq!(powers(&machine), [0, 0, 100, 255, 0, 128]);
    say("M400");
    say("G4 P100");
    assert_eq!(powers(&machine), [51, 0, 0, 255, 0, 128]);
    say("M104 S210");
    say("M84");
    say("G4 S70");
    assert_eq!(powers(&machine), [51, 255, 0, 255, 0, 0], "the electronics' fan has gone on for a minute");
}

#[test]
fn a_prepared_job_sets_every_fan_also_when_it_is_entered() {
    let profile = with_fans();
    let mut text = "M302 P1\nG28\nM83\nM106 P2 S77\nM106 S40\nSET_PIN PIN=light VALUE=0.2\n".to_owned();
    for line in 0..6000 {
        let [x, y] = [50 + line % 7 * 10, 50 + line % 5 * 10];
        text += &format!("G1 X{x} Y{y} E0.1 F3000\n");
    }
    let printed = rehearse_traced(&profile, &mut text.as_bytes());
    assert_eq!(printed.fan_powers, [40, 0, 77, 51, 0, 0]);
    let job = prepared(&profile, text.as_bytes(), Encoding::Compact).unwrap();
    let whole = rehearse_from(&profile, 0, &mut &job[..]);
    assert_eq!((whole.fan_powers, whole.figures.motor_steps), (printed.fan_powers, printed.figures.motor_steps));
    let (frame, _) = *entries(&job).last().unwrap();
    assert!(frame > 0);
    assert_eq!(rehearse_from(&profile, frame, &mut &job[..]).fan_powers, printed.fan_powers);
}

#[test]
fn lights_and_relays_are_as_the_profile_says_until_a_command() {
    let profile = parse(&format!("{}{OUTPUTS}", builtin_text("cartesian").unwrap()), "outputs.toml").unwrap();
    let machine = machine(&profile);
    let mut conversation = Conversation::new(&machine);
    let mut say = |line: &str| {
        let replies = conversation.say(line);
        assert_eq!(replies.last().map(String::as_str), Some("ok"), "{line}: {replies:?}");
        conversation.say("G4 P100");
        (powers(&machine)[2], powers(&machine)[3])
    };
    assert_eq!(say("G4 P100"), (255, 51));
    assert_eq!(say("M42 P1 S200"), (255, 200));
    assert_eq!(say("M42 P0 S0"), (0, 200));
    assert_eq!(say("SET_PIN PIN=relay VALUE=0.1"), (255, 200), "a relay has no half");
    // Motion comes first.
    say("G28");
    let replies = say("G1 X100 F3000");
    assert_eq!(replies, (255, 200));
    say("M42 P1 S7");
    assert_eq!(say("M400"), (255, 7));
    // Commands that end a print leave them unchanged.
    assert_eq!(say("M107"), (255, 7));
    assert_eq!(say("M84"), (255, 7));
}

/// A strip of light, one colour of which is at another place than the others.
#[test]
fn a_light_has_colours() {
    let colors = [("fan2", "red"), ("fan5", "green"), ("fan3", "blue")].map(|(output, color)| {
        format!("\n[outputs.{color}]\noutput = \"{output}\"\npwm = true\ncolor = \"{color}\"\n")
    });
    let text = [builtin_text("cartesian").unwrap().to_owned(), colors.concat()].concat();
    let profile = parse(&text, "light.toml").unwrap();
    let machine = machine(&profile);
    let mut conversation = Conversation::new(&machine);
    let mut say = |line: &str| {
        let replies = conversation.say(line);
        assert_eq!(replies.last().map(String::as_str), Some("ok"), "{line}: {replies:?}");
        conversation.say("G4 P100");
        let powers = powers(&machine);
        [2, 5, 3].map(|output: usize| powers[output])
    };
    assert_eq!(say("G28"), [0; 3]);
    assert_eq!(say("M150 R255 U128 B1 W9"), [255, 128, 1]);
    // Motion comes first.
    assert_eq!(say("G1 X100 F3000"), [255, 128, 1]);
    say("SET_LED LED=strip BLUE=1");
    assert_eq!(say("M400"), [0, 0, 255]);
    assert_eq!(say("SET_PIN PIN=green VALUE=0.2"), [0, 51, 255]);
    assert_eq!(say("M150"), [0; 3]);
    // A prepared job sets these colours as well.
    let job = "M302 P1\nG28\nM83\nM150 R9 U8 B7\nG1 X60 Y60 E1 F3000\n";
    let prepared = prepared(&profile, job.as_bytes(), Encoding::Compact).unwrap();
    assert_eq!(rehearse_from(&profile, 0, &mut &prepared[..]).fan_powers, [0, 0, 9, 7, 0, 8]);
}

#[test]
fn a_halt_has_its_own_light() {
    let profile = parse(&format!("{}{OUTPUTS}", builtin_text("cartesian").unwrap()), "outputs.toml").unwrap();
    let machine = machine(&profile);
    let mut conversation = Conversation::new(&machine);
    conversation.say("G4 P100");
    assert_eq!(powers(&machine)[2..4], [255, 51]);
    machine.set_heater_failure(Heater::Bed, Some(HeaterFailure::ThermistorOpen));
    conversation.say("G4 P100");
    assert_eq!(powers(&machine)[..4], [255, 255, 0, 255]);
}
