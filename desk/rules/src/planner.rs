//! Common planner for all rules.

use crate::arcs::{ArcCut, ArcLimits, MarlinArcs};
use crate::change::{Change, Effect};
use crate::klipper::Klipper;
use crate::marlin::Marlin;
use crate::motion::{Move, MoveError, PlannedMove};
use crate::rrf::Rrf;
use std::fmt;
use std::str::FromStr;

/// Rules by which a print is planned, with the names used on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Rules {
    /// Klipper and Kalico.
    Klipper,
    /// Marlin with junction deviation.
    MarlinJunctionDeviation,
    /// Marlin with classic jerk, and Prusa's firmwares.
    MarlinClassicJerk,
    /// RepRapFirmware.
    Rrf,
}

impl Rules {
    /// All rules.
    pub const ALL: [Self; 4] = [Self::Klipper, Self::MarlinJunctionDeviation, Self::MarlinClassicJerk, Self::Rrf];

    /// Returns the name of the rules.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Klipper => "klipper",
            Self::MarlinJunctionDeviation => "marlin-junction-deviation",
            Self::MarlinClassicJerk => "marlin-classic-jerk",
            Self::Rrf => "rrf",
        }
    }

    /// Returns the firmware's name for people.
    pub const fn firmware(self) -> &'static str {
        match self {
            Self::Klipper => "Klipper",
            Self::MarlinJunctionDeviation => "Marlin with junction deviation",
            Self::MarlinClassicJerk => "Marlin with classic jerk",
            Self::Rrf => "RepRapFirmware",
        }
    }

    /// Returns the factor that M220 applies to later speeds; `None` if the firmware refuses the
    /// value and keeps the factor.
    ///
    /// Klipper accepts any value above 0. Marlin truncates to whole percents. RepRapFirmware
    /// accepts 1 % and more.
    pub fn speed_factor(self, percent: f64) -> Option<f64> {
        let percent = match self {
            Self::MarlinJunctionDeviation | Self::MarlinClassicJerk => percent.trunc(),
            Self::Klipper | Self::Rrf => percent,
        };
        let least = if self == Self::Rrf { 1.0 } else { f64::MIN_POSITIVE };
        (percent.is_finite() && percent >= least).then_some(percent / 100.0)
    }
}

impl fmt::Display for Rules {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(self.name())
    }
}

/// Error for a name of rules that do not exist.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownRules(String);

impl fmt::Display for UnknownRules {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "no rules are named {:?}, expected", self.0)?;
        for (index, rules) in Rules::ALL.iter().enumerate() {
            write!(out, "{} {rules}", if index == 0 { "" } else { "," })?;
        }
        Ok(())
    }
}

impl std::error::Error for UnknownRules {}

impl FromStr for Rules {
    type Err = UnknownRules;

    fn from_str(name: &str) -> Result<Self, UnknownRules> {
        Self::ALL.into_iter().find(|rules| rules.name() == name).ok_or_else(|| UnknownRules(name.to_owned()))
    }
}

/// Planner by one firmware's rules.
#[derive(Clone, Debug)]
pub enum Planner {
    /// Klipper's planner.
    Klipper(Klipper),
    /// Marlin's planner, with either rule for corners.
    Marlin(Marlin),
    /// RepRapFirmware's planner.
    Rrf(Rrf),
}

impl Planner {
    /// Adds a move, and appends the moves that are now planned to `released`.
    ///
    /// # Errors
    /// A displacement is not finite, or the speed is not above 0; the queue stays as it was.
    pub fn push(&mut self, one: &Move, released: &mut Vec<PlannedMove>) -> Result<(), MoveError> {
        match self {
            Self::Klipper(planner) => planner.push(one, released),
            Self::Marlin(planner) => planner.push(one, released),
            Self::Rrf(planner) => planner.push(one, released),
        }
    }

    /// Plans all waiting moves so that motion ends at rest: for a dwell, a wait, homing, or the end
    /// of the print.
    pub fn flush(&mut self, released: &mut Vec<PlannedMove>) {
        match self {
            Self::Klipper(planner) => planner.flush(released),
            Self::Marlin(planner) => planner.flush(released),
            Self::Rrf(planner) => planner.flush(released),
        }
    }

    /// Applies a command that changes limits.
    pub fn change(&mut self, change: &Change<'_>) -> Effect {
        match self {
            Self::Klipper(planner) => planner.change(change),
            Self::Marlin(planner) => planner.change(change),
            Self::Rrf(planner) => planner.change(change),
        }
    }

    /// Returns the number of waiting moves.
    pub fn queued(&self) -> usize {
        match self {
            Self::Klipper(planner) => planner.queued(),
            Self::Marlin(planner) => planner.queued(),
            Self::Rrf(planner) => planner.queued(),
        }
    }

    /// Returns the method by which the firmware cuts arcs, with its defaults and the limits in
    /// force.
    pub fn arc_cut(&self) -> ArcCut {
        match self {
            Self::Klipper(_) => ArcCut::Klipper { resolution_mm: 1.0 },
            Self::Marlin(planner) => {
                let [x, y, ..] = planner.settings().max_acceleration_mm_per_s2;
                let [x_speed, y_speed, ..] = planner.settings().max_feed_mm_per_s;
                let hints = Some(ArcLimits { acceleration_mm_per_s2: x.min(y), speed_mm_per_s: x_speed.min(y_speed) });
                ArcCut::Marlin(MarlinArcs { hints, ..MarlinArcs::default() })
            }
            Self::Rrf(_) => ArcCut::Rrf,
        }
    }
}
