//! Input shaping from G-code to the frame: hosts, homing, time, and the remaining ringing.

use ferrostep_planner::{AxisShaper, ShaperKind};
use ferrostep_printer::Profile;
use ferrostep_session::desk::LOOK_AHEAD_BLOCKS;
use serde_json::Value;

use crate::end_to_end::command::{directory, ferrostep, file};
use crate::end_to_end::desk::{profile, rehearse};
use crate::end_to_end::hosts::{Conversation, machine};

/// A machine whose frame rings at 50 and 40 Hz, the simulator's defaults.
fn shaped(name: &str) -> Profile {
    let shaper = |frequency_hz| AxisShaper { kind: ShaperKind::Mzv, frequency_hz, damping: 0.06 };
    let mut profile = profile(name);
    profile.motion.shapers = [shaper(50.0), shaper(40.0)];
    profile
}

/// Corners, curves of short moves, retractions and lifts.
fn job() -> Vec<String> {
    let mut lines: Vec<String> = ["M302 P1", "M83", "G1 X40 Y40 Z1 F6000"].map(str::to_owned).into();
    for index in 0..40 {
        let (x, y) = (40 + index % 3 * 20, 40 + index % 4 * 12);
        lines.push(format!("G1 X{x} Y{y} E0.4 F3600"));
        if index % 5 == 4 {
            lines.extend(["G1 E-0.8 F2400", "G1 Z2", "G1 Z1", "G1 E0.8"].map(str::to_owned));
        }
        for part in 0..12 {
            lines.push(format!("G1 X{x}.{part:02} Y{y}.{:02} E0.005 F3000", part * part / 2));
        }
    }
    lines
}

#[test]
fn a_shaped_print_from_a_host_is_that_of_the_file() {
    for name in ["cartesian", "corexy"] {
        let profile = shaped(name);
        let machine = machine(&profile);
        let mut conversation = Conversation::new(&machine);
        for line in job() {
            assert_eq!(conversation.say(&line), ["ok"], "{line}");
        }
        conversation.finish();
        let file = rehearse(&profile, LOOK_AHEAD_BLOCKS, &mut job().join("\n").as_bytes());
        let plain = rehearse(&super::desk::profile(name), LOOK_AHEAD_BLOCKS, &mut job().join("\n").as_bytes());
        assert!(file.outcome.is_ok() && plain.outcome.is_ok());
        let figures = machine.figures();
        assert_eq!(figures.digests, file.figures.digests, "{name}");
        assert_eq!((figures.underruns, figures.starvation_flushes), (0, 0), "{name}");
        assert_ne!(figures.digests, plain.figures.digests, "{name}");
    }
}

#[test]
fn homing_follows_the_plan_itself_and_ends_at_the_same_places() {
    let job = "G28\nG1 X50 Y30 Z5 F3000\nG28 X\nG1 X20\nM114\n";
    for name in ["cartesian", "corexy", "prusa-mini"] {
        let [shaped, plain] =
            [shaped(name), profile(name)].map(|profile| rehearse(&profile, LOOK_AHEAD_BLOCKS, &mut job.as_bytes()));
        assert!(shaped.outcome.is_ok() && plain.outcome.is_ok(), "{name}: {:?}", shaped.outcome);
        assert_eq!(shaped.logical_10nm, plain.logical_10nm, "{name}");
        assert_eq!(shaped.notices, plain.notices, "{name}");
    }
}

fn number(value: &Value, path: &[&str]) -> f64 {
    path.iter().fold(value, |value, key| &value[key]).as_f64().unwrap_or_else(|| panic!("{path:?}: {value}"))
}

#[test]
fn a_shaped_print_rings_less_in_hardly_more_time() {
    let folder = directory();
    // Stops from full speed, by retractions.
    let stops =
        |index| format!("G1 X{} Y{} E1 F9000\nG1 E-0.8 F2400\nG1 E0.8\n", 20 + index % 2 * 90, 20 + index % 3 * 45);
    let lines: String = ["M302 P1\nM83\nM201 X5000 Y5000\nM204 P5000 T5000\n".to_owned()]
        .into_iter()
        .chain((0..8).map(stops))
        .collect();
    let plain = file(&folder, "plain.gcode", format!("G28\n{lines}\n"));
    let set =
        "SET_INPUT_SHAPER SHAPER_TYPE=mzv SHAPER_FREQ_X=50 SHAPER_FREQ_Y=40 DAMPING_RATIO_X=0.06 DAMPING_RATIO_Y=0.06";
    let shaped = file(&folder, "shaped.gcode", format!("{set}\nG28\n{lines}\n"));
    let [plain, shaped] = [plain, shaped].map(|path| path.to_str().unwrap().to_owned());
    let [before, after] = [&plain, &shaped].map(|job| ferrostep(["simulate", job.as_str(), "--json"]).json());
    let ringing = [&before, &after].map(|result| number(result, &["ringing", "rms_um"]));
    // The remaining deviation is that of whole steps, 12.5 um.
    assert!(ringing[1] * 5.0 < ringing[0], "{ringing:?}");
    let error = [&before, &after].map(|result| number(result, &["contour_error_um", "rms"]));
    assert!(error[1] * 2.0 < error[0], "{error:?}");
    // The filters' length is added at every standstill that a command waits for, and
    // not a tick more.
    let times = [&plain, &shaped].map(|job| {
        let [printed, estimated] =
            ["print", "estimate"].map(|command| ferrostep([command, job.as_str(), "--json"]).json());
        let [printed, estimated] = [printed, estimated].map(|result| number(&result, &["motion_time_s"]));
        assert!((printed - estimated).abs() < 1e-6, "{printed} {estimated}");
        printed
    });
    assert!((0.0..0.2).contains(&(times[1] - times[0])), "{times:?}");
}
