//! A machine by its profile, with the rules that its moves are planned by.

use std::fmt;

use ferrostep_printer::Profile;
use ferrostep_profiles::{PlannedBy, ProfileError, RuleKeys};
use ferrostep_rules::{Rules, SettingError};

use super::scale::{Scale, Scaled};
use super::settings::{ByRules, of_profile};
use crate::desk::LimitFactors;

/// A profile, and the planner of another firmware if its rules hold.
#[derive(Clone, Debug)]
pub struct RuledMachine {
    /// The profile.
    pub profile: Profile,
    /// The planner; `None` for the rules of this firmware.
    pub by: Option<ByRules>,
    /// Factors of the limits of this firmware's planner.
    pub factors: LimitFactors,
    keys: RuleKeys,
    asked: Option<PlannedBy>,
    origin: String,
}

/// Reason for which there is no such machine.
#[derive(Debug)]
pub enum MachineError {
    /// The profile.
    Profile(ProfileError),
    /// The rules make no plan with the profile's limits.
    Limits {
        /// The profile's name or path.
        origin: String,
        /// Name of the rules.
        rules: &'static str,
        /// The limit.
        error: SettingError,
    },
}

impl fmt::Display for MachineError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Profile(error) => error.fmt(out),
            Self::Limits { origin, rules, error } => {
                write!(out, "{origin}: {rules} makes no plan with its limits: {error}")
            }
        }
    }
}

impl std::error::Error for MachineError {}

impl RuledMachine {
    /// Loads a built-in profile by its name, or else the file at this path; `asked`: the rules that
    /// hold in place of the profile's.
    ///
    /// # Errors
    /// [`MachineError`].
    pub fn load(name_or_path: &str, asked: Option<PlannedBy>) -> Result<Self, MachineError> {
        let text = ferrostep_profiles::text(name_or_path).map_err(MachineError::Profile)?;
        Self::parse(&text, name_or_path, asked)
    }

    /// Reads a profile's text; `origin`, a path or a name, precedes errors.
    ///
    /// # Errors
    /// [`MachineError`].
    pub fn parse(text: &str, origin: &str, asked: Option<PlannedBy>) -> Result<Self, MachineError> {
        let (profile, keys) = ferrostep_profiles::parse_with_rules(text, origin).map_err(MachineError::Profile)?;
        Self { profile, by: None, factors: LimitFactors::default(), keys, asked, origin: origin.to_owned() }
            .scaled(Scale::NONE)
    }

    /// Returns true if the profile is of a printer with another firmware, whose limits it has.
    pub fn has_other_firmware(&self) -> bool {
        self.keys.planned_by != PlannedBy::Own
    }

    /// The same with other limits.
    ///
    /// # Errors
    /// [`MachineError::Limits`].
    pub fn scaled(&self, scale: Scale) -> Result<Self, MachineError> {
        let Self { profile, keys, asked, .. } = self;
        let by = of_profile(profile, keys, *asked, scale).map_err(|error| {
            let rules = asked.unwrap_or(keys.planned_by).name();
            MachineError::Limits { origin: self.origin.clone(), rules, error }
        })?;
        Ok(Self { by, factors: scale.of_own_planner(), ..self.clone() })
    }

    /// Returns true if the machine's rules have a limit that can be scaled.
    pub fn has(&self, limit: Scaled) -> bool {
        match self.by.as_ref().map(|by| by.rules) {
            None => matches!(limit, Scaled::Acceleration | Scaled::Corner),
            Some(Rules::Klipper) => true,
            Some(_) => limit != Scaled::ShortMove,
        }
    }
}
