//! The machine of a command: the profile that is named, or else the built-in one with the travel
//! of the printer that the job was sliced for.

use std::path::Path;

use ferrostep_analysis::sweep::machine_with;
use ferrostep_planner::kinematics::UNITS_PER_MM;
use ferrostep_printer::Profile;
use ferrostep_profiles::PlannedBy;
use ferrostep_session::input::{self, Input, ShownTravel};
use ferrostep_session::rules::RuledMachine;

use crate::terminal::tell;

/// The profile if none is named.
const BUILT_IN: &str = "cartesian";

/// The name or path of the profile.
pub fn name_or_path(named: Option<&str>) -> &str {
    named.unwrap_or(BUILT_IN)
}

/// A machine, and its name for people.
pub struct Machine {
    /// The machine, with the rules of its moves.
    pub ruled: RuledMachine,
    /// The profile's name, with the travel if that is another one.
    pub name: String,
}

impl Machine {
    /// Loads the profile that is named, or else the built-in one, whose travel becomes what the
    /// slicer's comments say; tells the person what it took from them, or could not. `asked`: the
    /// rules that hold in place of the profile's.
    ///
    /// # Errors
    /// The profile cannot be read, or its limits make no plan by the rules.
    pub fn of_job(named: Option<&str>, asked: Option<PlannedBy>, file: &Path, input: &Input) -> Result<Self, String> {
        let ruled = RuledMachine::load(name_or_path(named), asked).map_err(|error| error.to_string())?;
        let profile = ruled.profile;
        let built_in = Self { ruled, name: profile.name.to_owned() };
        if named.is_some() {
            return Ok(built_in);
        }
        let own_mm = travel_mm(&profile);
        let name = input::name(file);
        let Ok(sliced_for) = input.sliced_for(file) else { return Ok(built_in) };
        if let Some(comment) = sliced_for.unreadable() {
            tell(format_args!(
                "note: {name}: no travel can be read from its comment \"{comment}\": the machine is {BUILT_IN}, {}; \
                 name your printer with --profile",
                ShownTravel(own_mm)
            ));
            return Ok(built_in);
        }
        let travel_mm = sliced_for.travel_mm(own_mm);
        if travel_mm == own_mm {
            return Ok(built_in);
        }
        let shown = ShownTravel(travel_mm);
        match with_travel(travel_mm, asked) {
            Ok(ruled) => {
                tell(format_args!(
                    "note: the machine is {BUILT_IN} with the travel in the comments of {name}, {shown}: name your \
                     printer with --profile"
                ));
                Ok(Self { ruled, name: format!("{BUILT_IN} with the file's travel, {shown}") })
            }
            Err(problem) => {
                tell(format_args!(
                    "note: the travel in the comments of {name}, {shown}, is no machine's here ({problem}): the machine \
                     is {BUILT_IN}, {}; name your printer with --profile",
                    ShownTravel(own_mm)
                ));
                Ok(built_in)
            }
        }
    }
}

fn travel_mm(profile: &Profile) -> [[f64; 2]; 3] {
    let mm = |units_10nm: i64| units_10nm as f64 / UNITS_PER_MM as f64;
    std::array::from_fn(|axis| [profile.lower_end_10nm[axis], profile.size_10nm[axis]].map(mm))
}

/// The built-in profile with another travel; it homes at its lower ends.
fn with_travel(travel_mm: [[f64; 2]; 3], asked: Option<PlannedBy>) -> Result<RuledMachine, String> {
    let text = ferrostep_profiles::text(BUILT_IN).map_err(|error| error.to_string())?;
    let mut values = Vec::new();
    for (axis, [lower, upper]) in ["x", "y", "z"].iter().zip(travel_mm) {
        values.push((format!("lower_end_mm.{axis}"), lower));
        values.push((format!("size_mm.{axis}"), upper));
        values.push((format!("homing.{axis}.position_mm"), lower));
    }
    machine_with(&text, BUILT_IN, &values, asked).map_err(|error| error.to_string())
}
