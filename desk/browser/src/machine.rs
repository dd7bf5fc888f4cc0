//! The machine that prints the job.

use std::path::Path;

use ferrostep_analysis::job_machine::JobMachine;
use ferrostep_import::{Imported, Row, place};
use ferrostep_printer::Profile;
use ferrostep_session::rules::{ByRules, RuledMachine};
use serde::Serialize;

use crate::request::Request;

/// The request's word for the machine that the command takes without a profile.
pub const OF_JOB: &str = "of-the-job";

/// A machine, and the planner of its time.
#[derive(Debug)]
pub struct Machine {
    /// The machine's profile.
    pub profile: Profile,
    /// The planner of another firmware; `None` for this firmware's rules.
    pub by: Option<ByRules>,
    /// The machine's name for people.
    pub name: String,
    /// Sentence about the values taken from the slicer's comments.
    pub note: Option<String>,
    /// The settings that were kept, of a machine by its configuration.
    pub kept: Option<Kept>,
}

/// The settings that a profile keeps of another firmware's configuration.
#[derive(Clone, Debug, Serialize)]
pub struct Kept {
    /// Number of settings that were kept.
    pub kept: usize,
    /// Parts of the machine's identity that the configuration leaves open: the built-in profile's
    /// values stand in.
    pub by_permission: Vec<String>,
    /// Settings that were not kept: place, setting, and the reason.
    pub left_out: Vec<String>,
    /// Included files, which were not read.
    pub unread: Vec<String>,
}

impl Kept {
    fn of(imported: &Imported) -> Self {
        let is_kept = |row: &&Row| row.kept.is_some();
        let left_out = imported.rows.iter().filter(|row| !is_kept(row));
        let left_out =
            left_out.map(|row| format!("{}: {} = {}: {}", place(&row.file, row.line), row.key, row.value, row.why));
        Self {
            kept: imported.rows.iter().filter(is_kept).count(),
            by_permission: imported.by_permission.clone(),
            left_out: left_out.collect(),
            unread: imported.unread.clone(),
        }
    }
}

impl Machine {
    /// Reads the machine that a request names. Where a configuration leaves out the machine's
    /// identity, the built-in profile's values stand in, and [`Kept::by_permission`] names them.
    ///
    /// # Errors
    /// The profile or configuration cannot be read: the message names file, line and key.
    pub fn of(request: &Request) -> Result<Self, String> {
        let name = request.machine.as_str();
        if name == OF_JOB {
            let machine = JobMachine::of_file(None, request.rules, &request.job).map_err(|error| error.to_string())?;
            let RuledMachine { profile, by, .. } = machine.ruled().map_err(|error| error.to_string())?;
            return Ok(Self { name: machine.name(&profile), note: machine.note, profile, by, kept: None });
        }
        let is_ours = ferrostep_profiles::builtin_text(name).is_some() || name.ends_with(".toml");
        let (text, origin, kept) = if is_ours {
            (ferrostep_profiles::text(name).map_err(|error| error.to_string())?, name, None)
        } else {
            let imported = ferrostep_import::read(Path::new(name), true).map_err(|error| error.to_string())?;
            (imported.profile.clone(), "the imported profile", Some(Kept::of(&imported)))
        };
        let RuledMachine { profile, by, .. } =
            RuledMachine::parse(&text, origin, request.rules).map_err(|error| error.to_string())?;
        Ok(Self { name: profile.name.to_owned(), note: None, profile, by, kept })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const CONFIGURATION: &str =
        concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/cases/import/k20-max-power/printer.cfg");

    fn machine(path: &str) -> Result<Machine, String> {
        let arguments = ["job.gcode", "page.html", path, "klipper"].map(str::to_owned);
        Machine::of(&Request::of(arguments.into_iter()).unwrap())
    }

    #[test]
    fn a_configuration_says_what_is_kept_of_it() {
        let machine = machine(CONFIGURATION).unwrap();
        assert!(machine.by.is_some());
        let kept = machine.kept.unwrap();
        assert!(kept.kept > 30 && kept.by_permission.is_empty(), "{kept:?}");
        let has_place = |line: &String| line.starts_with("printer.cfg:");
        assert!(!kept.left_out.is_empty() && kept.left_out.iter().all(has_place), "{kept:?}");
    }

    #[test]
    fn a_configuration_without_a_part_of_the_machine_names_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("printer.cfg");
        let text = std::fs::read_to_string(CONFIGURATION).unwrap();
        std::fs::write(&path, text.replace("position_max: 220", "")).unwrap();
        let kept = machine(path.to_str().unwrap()).unwrap().kept.unwrap();
        assert!(kept.by_permission.iter().any(|part| part.contains("size_mm.x")), "{kept:?}");
    }

    #[test]
    fn a_job_describes_its_machine_as_for_the_command() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("job.gcode");
        std::fs::write(&path, "G28\n; bed_shape = 0x0,350x0,350x350,0x350\n").unwrap();
        let arguments = [path.to_str().unwrap(), "page.html", OF_JOB].map(str::to_owned);
        let machine = Machine::of(&Request::of(arguments.into_iter()).unwrap()).unwrap();
        assert_eq!(machine.name, "cartesian with the file's travel, 350 x 350 x 200 mm");
        assert!(machine.note.unwrap().contains("in the comments of job.gcode"));
    }

    #[test]
    fn a_file_beside_a_configuration_is_included() {
        let folder = tempfile::tempdir().unwrap();
        let [path, other] = ["printer.cfg", "limits.cfg"].map(|name| folder.path().join(name));
        let text = std::fs::read_to_string(CONFIGURATION).unwrap();
        std::fs::write(&path, format!("[include limits.cfg]\n{}", text.replace("position_max: 220", ""))).unwrap();
        std::fs::write(&other, "[stepper_x]\nposition_max: 190\n").unwrap();
        let machine = machine(path.to_str().unwrap()).unwrap();
        assert_eq!(machine.profile.size_10nm[0], 19_000_000);
        assert!(machine.kept.unwrap().unread.is_empty());
    }

    #[test]
    fn a_broken_configuration_names_its_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("printer.cfg");
        std::fs::write(&path, "[printer]\nkinematics: delta\n").unwrap();
        let refused = machine(path.to_str().unwrap()).unwrap_err();
        assert!(refused.starts_with("printer.cfg:2: "), "{refused}");
        assert!(machine("no-such.toml").unwrap_err().contains("no-such.toml"));
    }
}
