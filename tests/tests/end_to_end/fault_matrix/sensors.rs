//! Sensors of homing that fail at each time: the effect on the next G28, and that no print
//! continues before one has worked.

use ferrostep_printer::Profile;
use ferrostep_profiles::{builtin_text, parse};
use ferrostep_virtual_board::EndStopFailure;

use super::trial::{LONG_S, Trial, now_s};
use super::{At, Fault};
use crate::end_to_end::hosts::machine;

/// Sensors with which the MINI homes.
#[derive(Clone, Copy, Debug)]
pub enum Sensors {
    /// The MINI's own: stalls of X and Y, a fixed probe.
    Own,
    /// Switches at X and Y.
    Switches,
    /// A probe with a pin.
    Pin,
}

pub const ROWS: [(&str, Sensors, usize, EndStopFailure); 7] = [
    ("X's end stop never triggers", Sensors::Switches, 0, EndStopFailure::NeverTriggers),
    ("X's end stop is always triggered", Sensors::Switches, 0, EndStopFailure::AlwaysTriggered),
    ("X's driver reports no stall any more", Sensors::Own, 0, EndStopFailure::NeverTriggers),
    ("the probe never triggers", Sensors::Own, 2, EndStopFailure::NeverTriggers),
    ("the probe is always triggered", Sensors::Own, 2, EndStopFailure::AlwaysTriggered),
    ("the probe's pin does not come out", Sensors::Pin, 2, EndStopFailure::PinStaysIn),
    ("the probe's pin does not go in", Sensors::Pin, 2, EndStopFailure::PinStaysOut),
];

impl Sensors {
    fn profile(self) -> Profile {
        let own = builtin_text("prusa-mini").unwrap();
        let text = match self {
            Self::Own => own.to_owned(),
            Self::Switches => own.replace("sensor = \"stall\"", "sensor = \"end-stop\""),
            Self::Pin => format!("{own}\n[bltouch]\n"),
        };
        parse(&text, "mini.toml").unwrap()
    }
}

/// Maximum press of the nozzle into the bed, units of 10 nm, which the book's page of
/// homing promises.
const MAX_PRESS_10NM: i64 = 50_000;

/// Sends a line and checks that no motor pushes against the frame for longer than a first and a
/// second approach may, and that the nozzle presses on the bed as little as the book says.
fn say(trial: &mut Trial<'_>, profile: &Profile, line: &str) {
    let before_10nm = trial.machine.desk().pushed_10nm();
    trial.say(line);
    for (axis, pushed_10nm) in trial.machine.desk().pushed_10nm().into_iter().enumerate() {
        let length_10nm = profile.size_10nm[axis] - profile.lower_end_10nm[axis];
        let homing = &profile.homing[axis];
        let approaches_10nm = length_10nm + homing.overrun_10nm + 2 * homing.back_off_10nm;
        let most_10nm = if axis == 2 { MAX_PRESS_10NM } else { approaches_10nm };
        let pushed_10nm = pushed_10nm - before_10nm[axis];
        assert!(pushed_10nm <= most_10nm, "{line}: axis {axis} has pushed for {pushed_10nm} units");
    }
}

/// Reason for which homing was refused, up to the first advice.
fn refusal(trial: &Trial<'_>) -> Option<String> {
    let is_of_homing = |text: &&str| text.starts_with("homing ") || text.starts_with("the probe's pin ");
    let texts = trial.said.iter().filter_map(|line| line.strip_prefix("echo:line ")?.split_once(": "));
    let text = texts.map(|(_, text)| text).find(is_of_homing)?;
    let end = [", ", ": is ", " (M119)"].iter().filter_map(|advice| text.find(advice)).min();
    Some(text[..end.unwrap_or(text.len())].to_owned())
}

/// Outcome for the machine, as the table has it.
pub fn outcome(sensors: Sensors, at: At, axis: usize, failure: EndStopFailure) -> String {
    let case = format!("{sensors:?} {at:?} {axis} {failure:?}");
    let profile = sensors.profile();
    let machine = machine(&profile);
    let mut trial = Trial::new(&machine, at, Fault::EndStop(axis, failure));
    let begun_s = now_s(&machine);
    trial.fails_at(begun_s + at.command().map_or(5.0, |(_, seconds)| seconds));
    if let Some((line, _)) = at.command() {
        say(&mut trial, &profile, line);
    }
    let mut lines = 0;
    while at == At::Printing && now_s(&machine) < begun_s + LONG_S {
        lines += 1;
        say(&mut trial, &profile, &format!("G1 X{} E0.5 F900", 50 + 60 * (lines % 2)));
    }
    trial.be_silent((begun_s + LONG_S - now_s(&machine)).max(10.0));
    assert!(trial.has_failed(), "{case}: it has not happened");
    let during = refusal(&trial);

    trial.said.clear();
    say(&mut trial, &profile, "G28");
    let next = refusal(&trial).unwrap_or_else(|| panic!("{case}: {:#?}", trial.said));
    assert!(trial.said.iter().any(|line| line == "//action:pause"), "{case}: {:#?}", trial.said);
    // A host that does not know that word sends the print's next line.
    let steps = machine.desk().motor_steps();
    trial.said.clear();
    say(&mut trial, &profile, "G1 X70 Y70 Z0.3 E0.5 F900");
    assert_eq!(machine.desk().motor_steps(), steps, "{case}: {:#?}", trial.said);
    assert!(trial.said.iter().any(|line| line.contains("home it (G28)")), "{case}: {:#?}", trial.said);
    assert!(!machine.signals().is_halted(), "{case}");

    // The sensor is mended and G28 done: the print continues.
    machine.set_end_stop_failure(axis, None);
    trial.said.clear();
    say(&mut trial, &profile, "G28");
    assert_eq!(refusal(&trial), None, "{case}: {:#?}", trial.said);
    if at.is_hot() {
        say(&mut trial, &profile, "G1 X70 Y70 Z0.3 E0.5 F900");
        say(&mut trial, &profile, "M400");
        let place_mm = machine.desk().true_position_10nm().map(|units| units as f64 / 1e5);
        let apart_mm = [70.0, 70.0, 0.3].iter().zip(place_mm).map(|(to, at)| f64::abs(to - at)).fold(0.0, f64::max);
        assert!(apart_mm < 0.1, "{case}: {place_mm:?}, {:#?}", trial.said);
    }
    during.unwrap_or_else(|| format!("none; the next G28: {next}"))
}
