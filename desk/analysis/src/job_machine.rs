//! The machine of a job: the profile that is named, or else the built-in one with the travel and
//! the limits of the printer that the job was sliced for.

use std::path::Path;

use ferrostep_planner::kinematics::UNITS_PER_MM;
use ferrostep_printer::Profile;
use ferrostep_profiles::{PlannedBy, ProfileError};
use ferrostep_session::input::{self, Input, ShownTravel, SlicedFor};
use ferrostep_session::rules::{MachineError, RuledMachine};

use crate::sweep::{SweepError, machine_with, text_with};

/// The profile if none is named.
const BUILT_IN: &str = "cartesian";

/// Values of a profile's keys.
type Changes = Vec<(String, f64)>;

/// The name or path of the profile.
pub fn name_or_path(named: Option<&str>) -> &str {
    named.unwrap_or(BUILT_IN)
}

/// The machine of a job.
#[derive(Clone, Debug)]
pub struct JobMachine {
    /// The profile's name or path, which precedes errors.
    pub origin: String,
    /// The profile's text.
    pub text: String,
    /// The rules in place of the profile's.
    asked: Option<PlannedBy>,
    /// Sentence for a person: the slicer's values that hold, or the reason for which they do not.
    pub note: Option<String>,
    /// The values in place of the profile's, for a person.
    taken: Option<String>,
}

impl JobMachine {
    /// The profile that is named, or else the built-in one, whose travel and limits become what the
    /// slicer's comments say: of each all, or nothing. `asked`: the rules that hold in place of the
    /// profile's.
    ///
    /// # Errors
    /// The profile that is named cannot be read.
    pub fn of(named: Option<&str>, asked: Option<PlannedBy>, file: &Path, input: &Input) -> Result<Self, ProfileError> {
        let machine = Self::untouched(named, asked)?;
        Ok(match input.sliced_for(file) {
            Ok(sliced_for) if named.is_none() => {
                // The file's folder would make the one line long.
                let name = file.file_name().map_or(file, Path::new);
                machine.taking(&input::name(name), &sliced_for)
            }
            _ => machine,
        })
    }

    /// The same for a file that is opened here. The built-in profile holds for a file that is no
    /// job.
    ///
    /// # Errors
    /// The profile that is named cannot be read.
    pub fn of_file(named: Option<&str>, asked: Option<PlannedBy>, file: &Path) -> Result<Self, ProfileError> {
        match Input::open(file) {
            Ok(input) if named.is_none() => Self::of(named, asked, file, &input),
            _ => Self::untouched(named, asked),
        }
    }

    fn untouched(named: Option<&str>, asked: Option<PlannedBy>) -> Result<Self, ProfileError> {
        let origin = name_or_path(named).to_owned();
        Ok(Self { text: ferrostep_profiles::text(&origin)?, origin, asked, note: None, taken: None })
    }

    /// The machine with the rules of its moves.
    ///
    /// # Errors
    /// The profile is refused, or its limits make no plan by the rules.
    pub fn ruled(&self) -> Result<RuledMachine, MachineError> {
        RuledMachine::parse(&self.text, &self.origin, self.asked)
    }

    /// The machine's name for people: the profile's, with the values that replace it.
    pub fn name(&self, profile: &Profile) -> String {
        match &self.taken {
            Some(taken) => format!("{} with the file's {taken}", profile.name),
            None => profile.name.to_owned(),
        }
    }

    /// The machine with what the comments of a file say.
    fn taking(mut self, name: &str, sliced_for: &SlicedFor) -> Self {
        let Ok(profile) = ferrostep_profiles::parse(&self.text, &self.origin) else { return self };
        let own_mm = travel_mm(&profile);
        let own = ShownTravel(own_mm);
        if let Some(comment) = sliced_for.unreadable() {
            self.note = Some(format!(
                "{name}: no travel can be read from its comment \"{comment}\": the machine is {BUILT_IN}, {own}; name \
                 your printer with --profile"
            ));
            return self;
        }
        let travel_mm = sliced_for.travel_mm(own_mm);
        let shown = ShownTravel(travel_mm);
        let travel = (travel_mm != own_mm).then(|| travel_changes(travel_mm));
        let limits =
            sliced_for.limits().map(|limits| limits.into_iter().map(|(key, value)| (key.to_owned(), value)).collect());
        let (travel, limits, refused) = match (self.possible(travel), self.possible(limits)) {
            (Err(problem), _) => {
                self.note = Some(format!(
                    "the travel in the comments of {name}, {shown}, does not suit ferrostep's machine ({problem}): the machine is \
                     {BUILT_IN}, {own}; name your printer with --profile"
                ));
                return self;
            }
            (Ok(travel), Ok(limits)) => (travel, limits, None),
            (Ok(travel), Err(problem)) => (travel, None, Some(problem)),
        };
        let named = match (&travel, &limits) {
            (None, None) => None,
            (Some(_), None) => Some("travel"),
            (None, Some(_)) => Some("speeds and accelerations"),
            (Some(_), Some(_)) => Some("travel, speeds and accelerations"),
        };
        let model = sliced_for.model().map(|model| format!(" for {model}")).unwrap_or_default();
        let left = refused
            .map(|problem| format!(" (its speeds and accelerations do not suit ferrostep's machine: {problem})"));
        let left = left.unwrap_or_default();
        let changes: Changes = travel.into_iter().chain(limits).flatten().collect();
        match (named, text_with(&self.text, &self.origin, &changes)) {
            (Some(named), Ok(text)) => {
                self.text = text;
                self.note = Some(format!(
                    "the machine is {BUILT_IN} with the {named} in the comments of {name}{model}{left}, {shown}: name \
                     your printer with --profile"
                ));
                self.taken = Some(format!("{named}, {shown}"));
            }
            _ if !left.is_empty() => {
                self.note = Some(format!(
                    "{name}{model}{left}: the machine is {BUILT_IN}, {own}; name your printer with --profile"
                ));
            }
            _ => {}
        }
        self
    }

    /// The changes, if there is a machine with them.
    fn possible(&self, changes: Option<Changes>) -> Result<Option<Changes>, SweepError> {
        if let Some(changes) = &changes {
            machine_with(&self.text, &self.origin, changes, self.asked)?;
        }
        Ok(changes)
    }
}

fn travel_mm(profile: &Profile) -> [[f64; 2]; 3] {
    let mm = |units_10nm: i64| units_10nm as f64 / UNITS_PER_MM as f64;
    std::array::from_fn(|axis| [profile.lower_end_10nm[axis], profile.size_10nm[axis]].map(mm))
}

/// The built-in profile's keys of its travel; it homes at its lower ends.
fn travel_changes(travel_mm: [[f64; 2]; 3]) -> Changes {
    let mut changes = Vec::new();
    for (axis, [lower, upper]) in ["x", "y", "z"].iter().zip(travel_mm) {
        changes.push((format!("lower_end_mm.{axis}"), lower));
        changes.push((format!("size_mm.{axis}"), upper));
        changes.push((format!("homing.{axis}.position_mm"), lower));
    }
    changes
}
