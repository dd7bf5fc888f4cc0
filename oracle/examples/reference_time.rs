//! Prints a job's motion time by the reference planner.
//!
//! `reference_time GCODE(.gz) PROFILE.toml|NAME [--junction-deviation MM] [--without-limits] [--look-ahead N]`
#![allow(clippy::unwrap_used, clippy::expect_used)]

use ferrostep_oracle::gcode_text;
use ferrostep_oracle::reference::{InterpretOptions, ReferenceProfile, interpret, plan};
use std::{env, fs, num::NonZeroUsize};

fn main() {
    let mut paths = Vec::new();
    let mut options = InterpretOptions::default();
    let mut junction_deviation_mm = None;
    let mut look_ahead = None;
    let mut arguments = env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().expect("the option takes a value");
        match argument.as_str() {
            "--without-limits" => options.without_limits = true,
            "--junction-deviation" => junction_deviation_mm = Some(value().parse::<f64>().expect("a number of mm")),
            "--look-ahead" => look_ahead = Some(value().parse::<NonZeroUsize>().expect("a number of moves")),
            _ => paths.push(argument),
        }
    }
    let [gcode, profile] = paths.as_slice() else { panic!("arguments: GCODE PROFILE.toml [options]") };
    let mut profile = match profile.as_str() {
        "cartesian" => ReferenceProfile::cartesian(),
        "corexy" => ReferenceProfile::corexy(),
        "prusa-mini" => ReferenceProfile::prusa_mini(),
        path => ReferenceProfile::from_toml(&fs::read_to_string(path).expect("the profile")).expect("the profile"),
    };
    profile.junction_deviation_mm = junction_deviation_mm.unwrap_or(profile.junction_deviation_mm);
    let text = gcode_text(&fs::read(gcode).expect("the job")).expect("the job");
    let job = interpret(&text, &profile, options).expect("the job");
    let plan = plan(&job, look_ahead);
    println!("lines          {}", job.lines);
    println!("moves          {}", job.move_count());
    println!("clamped moves  {}", job.clamped_moves);
    println!("filament       {:.5} mm", job.filament_mm());
    println!("motion time    {:.4} s", plan.motion_time_s);
}
