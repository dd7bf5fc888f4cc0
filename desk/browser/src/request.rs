//! The program's arguments.

use std::path::PathBuf;

use ferrostep_profiles::PlannedBy;

/// A question to the program.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// The job's file.
    pub job: PathBuf,
    /// The page to write.
    pub page: PathBuf,
    /// Name of a built-in profile, [`OF_JOB`](crate::OF_JOB), or the path of a profile or of
    /// another firmware's configuration.
    pub machine: String,
    /// The rules by which the time is estimated; `None` for those of the machine.
    pub rules: Option<PlannedBy>,
}

impl Request {
    /// Reads the arguments: `JOB PAGE MACHINE [RULES]`.
    ///
    /// # Errors
    /// Arguments are missing, superfluous or unknown.
    pub fn of(arguments: impl Iterator<Item = String>) -> Result<Self, String> {
        let arguments: Vec<String> = arguments.collect();
        let (job, page, machine, rules) = match arguments.as_slice() {
            [job, page, machine] => (job, page, machine, None),
            [job, page, machine, rules] => (job, page, machine, Some(named(rules)?)),
            _ => return Err(format!("{} arguments, expected JOB PAGE MACHINE [RULES]", arguments.len())),
        };
        Ok(Self { job: job.into(), page: page.into(), machine: machine.clone(), rules })
    }

    /// The name of the job's file, without its folder.
    pub fn job_name(&self) -> &str {
        self.job.file_name().and_then(|name| name.to_str()).unwrap_or("the job")
    }
}

fn named(name: &str) -> Result<PlannedBy, String> {
    PlannedBy::named(name).ok_or_else(|| {
        let known = PlannedBy::NAMED.map(|(name, _)| name).join(", ");
        format!("rules {name}: unknown, expected one of {known}")
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn of(arguments: &[&str]) -> Result<Request, String> {
        Request::of(arguments.iter().map(|&argument| argument.to_owned()))
    }

    #[test]
    fn arguments_name_job_page_machine_and_rules() {
        let request = of(&["/job/cube.gcode", "/page.html", "cartesian", "klipper"]).unwrap();
        assert_eq!((request.job_name(), request.machine.as_str()), ("cube.gcode", "cartesian"));
        assert_eq!(request.rules, Some(PlannedBy::Klipper));
        assert_eq!(of(&["a", "b", "c"]).unwrap().rules, None);
    }

    #[test]
    fn other_arguments_are_refused_in_words() {
        assert_eq!(of(&["a"]).unwrap_err(), "1 arguments, expected JOB PAGE MACHINE [RULES]");
        assert!(of(&["a", "b", "c", "reprap"]).unwrap_err().contains("marlin-classic-jerk"));
    }
}
