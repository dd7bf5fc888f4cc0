//! Plans files by Klipper's rules and by the reference's, and prints the results of a frame and a
//! nozzle for both under several shapers.
//!
//! ```text
//! cargo xtask klipper-table FILE... [--corexy] [--feeds FACTOR] [--acceleration MM_PER_S2]
//!     [--times]
//! ```
//!
//! The limits are the machine's, not those of the file (M201 to M205 are left out): a bed-slinger
//! with Z at 12 mm/s and 200 mm/s^2 and retractions at 1250 mm/s^2, or the profile `corexy`. The
//! reference rounds corners by a junction deviation of 0.02 mm.

use std::path::PathBuf;

use ferrostep_oracle::reference::{
    Acceleration, InterpretOptions, Job, ReferenceProfile, interpret, plan as reference_plan,
};
use ferrostep_simulator::frame::{FrameSettings, SecondMode};
use ferrostep_simulator::klipper::{self, KlipperSettings};
use ferrostep_simulator::measures::{Measures, Report};
use ferrostep_simulator::plan::{Filters, Machine, MoveSpeeds, Plan, simulate};
use ferrostep_simulator::shapers::{Shaper, ShaperKind};

use crate::job_text;
use crate::steps::Failure;

const FILAMENT_MM2: f64 = 1.75 * 1.75 * std::f64::consts::FRAC_PI_4;

/// Damping for which the shapers are made.
const SHAPER_DAMPING: f64 = 0.1;

/// Arguments of `klipper-table`.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// The jobs, plain or gzip
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Plans for the profile `corexy` instead of a bed-slinger
    #[arg(long)]
    corexy: bool,
    /// The files' speeds times this
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    feeds: f64,
    /// The bed-slinger's acceleration
    #[arg(long, value_name = "MM_PER_S2", default_value_t = 1000.0)]
    acceleration: f64,
    /// Only the times
    #[arg(long)]
    times: bool,
}

/// Prints a table for each file.
///
/// # Errors
/// A file cannot be read, or no frame or filter is made of its numbers.
pub fn run(options: &Options) -> Result<(), Failure> {
    let profile = if options.corexy { ReferenceProfile::corexy() } else { bed_slinger(options.acceleration) };
    let frequency_hz = if options.corexy { [60.0, 50.0] } else { [50.0, 40.0] };
    for file in &options.files {
        let name = file.display();
        let mut job = interpret(&job_text(file)?, &profile, InterpretOptions { without_limits: true })
            .map_err(|error| format!("{name}: {error}"))?;
        job.moves.iter_mut().for_each(|one| one.feed_mm_per_s *= options.feeds);
        println!("{name}");
        times(&job);
        if !options.times {
            table(&job, frequency_hz)?;
        }
    }
    Ok(())
}

fn bed_slinger(acceleration: f64) -> ReferenceProfile {
    ReferenceProfile {
        max_feed_mm_per_s: [600.0, 600.0, 12.0, 60.0],
        max_acceleration_mm_per_s2: [acceleration, acceleration, 200.0, 5000.0],
        acceleration_mm_per_s2: Acceleration { print: acceleration, travel: acceleration, retract: 1250.0 },
        junction_deviation_mm: 0.02,
        ..ReferenceProfile::cartesian()
    }
}

fn reference(job: &Job) -> Vec<MoveSpeeds> {
    reference_plan(job, None).moves.iter().map(|one| MoveSpeeds::from(one.law)).collect()
}

fn times(job: &Job) {
    let settings = KlipperSettings::default();
    let corners_only = KlipperSettings {
        minimum_cruise_ratio: 0.0,
        instantaneous_corner_velocity_mm_per_s: f64::INFINITY,
        ..settings
    };
    let time_s =
        |speeds: &[MoveSpeeds]| Plan::of_job(job, speeds, FILAMENT_MM2).iter().map(Plan::duration_s).sum::<f64>();
    println!(
        "  Klipper {:.1} s, square corner velocity alone {:.1} s, reference {:.1} s",
        time_s(&klipper::plan(job, &settings)),
        time_s(&klipper::plan(job, &corners_only)),
        time_s(&reference(job))
    );
}

fn table(job: &Job, frequency_hz: [f64; 2]) -> Result<(), Failure> {
    println!(
        "  plan       shaper  time s   p99 f  .9 f 1.1 f  rms f  2nd p99, um  corner mm3  end mm3  accel p99, max  ringing rms um"
    );
    let settings = KlipperSettings { pressure_advance_s: 0.04, ..KlipperSettings::default() };
    for (name, speeds, extruder) in
        [("klipper", klipper::plan(job, &settings), Some(settings)), ("reference", reference(job), None)]
    {
        let plans = Plan::of_job(job, &speeds, FILAMENT_MM2);
        for kind in [ShaperKind::None, ShaperKind::Mzv, ShaperKind::Zv] {
            // The shaper is made for the frequency; the frame is off by a factor.
            let shaper = |hz| Shaper::new(kind, hz, SHAPER_DAMPING).map_err(|error| error.to_string());
            let shapers = [shaper(frequency_hz[0])?, shaper(frequency_hz[1])?];
            let filters = match extruder {
                Some(settings) => settings.filters(shapers),
                None => Filters { shapers, ..Filters::default() },
            };
            let report = |factor: f64, second: Option<SecondMode>| -> Result<Report, Failure> {
                let frame = FrameSettings {
                    frequency_hz: frequency_hz.map(|hz| hz * factor),
                    second,
                    ..FrameSettings::default()
                };
                let machine = Machine { frame, ..Machine::default() };
                let mut measures = Measures::default();
                let time_s = simulate(&plans, &filters, &machine, FILAMENT_MM2, &mut measures)
                    .map_err(|error| error.to_string())?;
                Ok(measures.finish(time_s).0)
            };
            let (right, low, high) = (report(1.0, None)?, report(0.9, None)?, report(1.1, None)?);
            let second = report(1.0, Some(SecondMode::default()))?;
            let p99 = |report: &Report| report.contour_error_um.p99;
            println!(
                "  {name:10} {kind:6} {:8.1} {:6.0} {:5.0} {:5.0} {:6.1} {:12.0} {:11.4} {:8.4} {:8.0} {:6.0} {:10.1}",
                right.time_s,
                p99(&right),
                p99(&low),
                p99(&high),
                right.contour_error_um.rms,
                p99(&second),
                right.bead.corner_volume_mm3,
                right.bead.end_volume_mm3,
                right.true_acceleration_mm_per_s2.p99,
                right.true_acceleration_mm_per_s2.max,
                right.ringing.rms_um
            );
        }
    }
    Ok(())
}
