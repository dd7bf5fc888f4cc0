//! Holds a step trace against the job and the profile it came from and prints the report.
//!
//! `check_trace TRACE GCODE(.gz) PROFILE.toml|NAME [--look-ahead N]`. Exit status 0 if nothing was found.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use ferrostep_oracle::gcode_text;
use ferrostep_oracle::reference::ReferenceProfile;
use ferrostep_oracle::trace_check::{TraceCheckOptions, check_trace};
use std::{env, fs, process::ExitCode};

fn main() -> ExitCode {
    let mut paths = Vec::new();
    let mut options = TraceCheckOptions::default();
    let mut arguments = env::args().skip(1);
    while let Some(argument) = arguments.next() {
        if argument == "--look-ahead" {
            let value = arguments.next().expect("the option takes a value");
            options.look_ahead = Some(value.parse().expect("a number of moves"));
        } else {
            paths.push(argument);
        }
    }
    let [trace, gcode, profile] = paths.as_slice() else { panic!("arguments: TRACE GCODE PROFILE.toml [options]") };
    let profile = match profile.as_str() {
        "cartesian" => ReferenceProfile::cartesian(),
        "corexy" => ReferenceProfile::corexy(),
        "prusa-mini" => ReferenceProfile::prusa_mini(),
        path => ReferenceProfile::from_toml(&fs::read_to_string(path).expect("the profile")).expect("the profile"),
    };
    let text = gcode_text(&fs::read(gcode).expect("the job")).expect("the job");
    let trace = fs::File::open(trace).expect("the trace");
    let report = check_trace(trace, &text, &profile, &options).expect("the check");
    print!("{report}");
    if report.passed() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
