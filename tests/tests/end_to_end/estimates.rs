//! The cost of an estimate, and its accuracy.

use ferrostep_printer::Replies;
use ferrostep_session::desk::{Desk, LOOK_AHEAD_BLOCKS};
use ferrostep_session::job::{self, JobProgress};
use ferrostep_session::{JobReplies, Session};

use crate::end_to_end::command::{example, ferrostep};
use crate::end_to_end::desk::profile;

/// An estimate, or a print, that has ended.
struct Ended {
    print_time_s: f64,
    motion_time_s: f64,
    /// Number of runs of the heaters' model and of the drivers' code: the only costs that could
    /// grow with the print time.
    heat_samples: u64,
    driver_polls: u64,
}

fn estimate(machine: &str, text: &[u8]) -> Ended {
    run(&Session::estimate(profile(machine), LOOK_AHEAD_BLOCKS, JobReplies::new(|_: &str| {})), text)
}

fn print(machine: &str, text: &[u8]) -> Ended {
    run(&Session::print(profile(machine), LOOK_AHEAD_BLOCKS, (), JobReplies::new(|_: &str| {})), text)
}

fn run<D: Desk>(session: &Session<D, impl Replies>, text: &[u8]) -> Ended {
    let mut progress = JobProgress::default();
    session.run(job::run(&mut &text[..], &mut session.printer(), &mut progress, |_| {})).unwrap();
    let figures = session.figures();
    Ended {
        print_time_s: figures.print_time_s,
        motion_time_s: figures.motion_time_s,
        heat_samples: session.heat_samples(),
        driver_polls: session.drivers().polls(),
    }
}

/// Text that heats, dwells for this time, moves, then makes a move of this duration.
fn after_hours(seconds: u32) -> String {
    format!(
        "M86 S0\nG28\nM190 S60\nM109 S210\nG4 S300\nG4 S{seconds}\nG92 X0\nM211 S0\nM203 X500\n\
         G1 X10 F600\nG1 X{} F60\nG1 X0 F600\n",
        10 + seconds
    )
}

/// One hour costs no more than ten: heaters at rest are not stepped.
#[test]
fn the_cost_of_an_estimate_is_independent_of_the_print_time() {
    for machine in ["cartesian", "corexy", "prusa-mini"] {
        let [short, long] = [1, 2000].map(|seconds| estimate(machine, after_hours(seconds).as_bytes()));
        assert!(long.print_time_s > short.print_time_s + 3900.0, "{machine}: {} s", long.print_time_s);
        assert_eq!(long.heat_samples, short.heat_samples, "{machine}");
        assert_eq!(long.driver_polls, short.driver_polls, "{machine}");
        // A print does step them.
        let print = print(machine, after_hours(1).as_bytes());
        assert!(print.heat_samples > short.heat_samples + 10_000, "{machine}: {}", print.heat_samples);
        let watches = print.driver_polls > 2 * short.driver_polls;
        assert_eq!(watches, machine != "cartesian", "{machine}: {} {}", print.driver_polls, short.driver_polls);
    }
}

/// An estimate of a print of twenty minutes steps heaters only after a change of a target.
#[test]
fn an_estimate_steps_heaters_only_until_they_settle() {
    for machine in ["cartesian", "corexy", "prusa-mini"] {
        let ended = estimate(machine, &example("cube.gcode"));
        assert!(ended.print_time_s > 1300.0);
        // The MINI's bed takes four minutes for its 60 C.
        let most = if machine == "prusa-mini" { 40_000 } else { 20_000 };
        assert!((10_000..most).contains(&ended.heat_samples), "{machine}: {}", ended.heat_samples);
    }
}

/// Heaters that were not stepped have the right temperatures: waits after hours at rest, for more
/// heat, for less, for none.
#[test]
fn an_estimate_waits_as_long_as_a_print() {
    let text = "M86 S0\nG28\nM190 S60\nM109 S210\nG4 S900\nM109 S230\nG4 S600\nM109 R190\nG4 S600\nM190 S80\nM140 S0\nG4 S100\n\
                M190 S70\nG4 S400\nM104 S0\nG4 S2000\nM109 S200\nG1 X20 F3000\nG1 X30 E1\n";
    for machine in ["cartesian", "corexy", "prusa-mini"] {
        let (estimate, print) = (estimate(machine, text.as_bytes()), print(machine, text.as_bytes()));
        assert_eq!(estimate.motion_time_s, print.motion_time_s);
        let apart_s = (estimate.print_time_s - print.print_time_s).abs();
        assert!(apart_s < 2.0, "{machine}: {} s, {} s", estimate.print_time_s, print.print_time_s);
        assert!(estimate.heat_samples < print.heat_samples / 2, "{machine}");
    }
}

/// A heater too weak for its target is never at rest, however steady: it fails as in a print.
#[test]
fn an_estimate_notices_a_failed_heater() {
    let directory = crate::end_to_end::command::directory();
    let text = std::fs::read_to_string(crate::end_to_end::command::repository().join("config/profiles/cartesian.toml"))
        .unwrap();
    let weak = text.replacen("\nproportional = 0.1\nintegral = 0.004\n", "\nproportional = 0.0001\nintegral = 0\n", 1);
    assert_ne!(weak, text);
    let machine = crate::end_to_end::command::file(&directory, "weak.toml", weak);
    let job = crate::end_to_end::command::file(&directory, "job.gcode", "G4 S600\nM109 S200\n");
    for command in ["estimate", "print"] {
        let outcome = ferrostep([command.as_ref(), job.as_os_str(), "--profile".as_ref(), machine.as_os_str()]);
        assert_eq!(outcome.status, Some(1), "{outcome:#?}");
        assert!(outcome.stderr.contains("Error:Heating failed, system stopped! Heater_ID: E0"), "{outcome:#?}");
    }
}
