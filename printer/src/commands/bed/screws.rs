//! G35: reports the turns that level the bed screws.

use core::fmt;

use ferrostep_gcode::Real;

use crate::error::CommandError;
use crate::motion::length::mm;
use crate::ports::{Ports, Replies};
use crate::printer::Printer;
use crate::settings::profile::homing::{BedScrews, MeshSettings};

/// Parts of a turn in reports, as minutes of an hour.
const MINUTES: i64 = 60;

/// A turn, shown as hours and minutes of a clock's hand.
struct Turn {
    clockwise: bool,
    minutes: i64,
}

impl Turn {
    /// The turn that lifts the bed at a screw, or lowers it (below 0); `lift_10nm` in units of 10
    /// nm.
    fn of(screws: &BedScrews, lift_10nm: i64) -> Self {
        let pitch_10nm = screws.pitch_10nm.max(1);
        let minutes = (lift_10nm.abs() * MINUTES + pitch_10nm / 2) / pitch_10nm;
        Self { clockwise: (lift_10nm > 0) == screws.clockwise_lifts, minutes }
    }
}

impl fmt::Display for Turn {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { clockwise, minutes } = *self;
        if minutes == 0 {
            return out.write_str("right");
        }
        let direction = if clockwise { "clockwise" } else { "counterclockwise" };
        write!(out, "turn it {direction} by {}:{:02}", minutes / MINUTES, minutes % MINUTES)
    }
}

impl<P: Ports> Printer<'_, P> {
    /// Executes G35: probes above each screw. The first stays; the others are to be turned to its
    /// height.
    pub(super) async fn measure_screws(&mut self, settings: &MeshSettings) -> Result<(), CommandError> {
        let Some(screws) = &self.profile.bed_screws else { return Err(CommandError::NoScrews) };
        self.needs_home()?;
        let mut heights_10nm = [0; BedScrews::MAX];
        for (screw, height_10nm) in screws.screws.iter().flatten().zip(&mut heights_10nm) {
            *height_10nm = self.probe_apart(screw.place_10nm, settings.samples, settings).await?.mean_10nm();
        }
        self.report_screws(screws, &heights_10nm);
        Ok(())
    }

    #[inline(never)]
    fn report_screws(&self, screws: &BedScrews, heights_10nm: &[i64; BedScrews::MAX]) {
        let [base_10nm, ..] = *heights_10nm;
        for (number, (screw, height_10nm)) in screws.screws.iter().flatten().zip(heights_10nm).enumerate() {
            let (name, [x, y]) = (screw.name, screw.place_10nm.map(mm));
            let z = Real::fixed(*height_10nm as f64 / 100_000.0, 3);
            if number == 0 {
                self.replies.say(format_args!("echo:{name}: X{x} Y{y} Z{z}, the others are turned to it"));
            } else {
                let turn = Turn::of(screws, base_10nm - height_10nm);
                self.replies.say(format_args!("echo:{name}: X{x} Y{y} Z{z}, {turn}"));
            }
        }
    }
}
