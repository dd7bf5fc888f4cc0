//! Steps with a name, a time and a cost, and the closing table.

use std::process::ExitCode;
use std::time::{Duration, Instant};

use crate::cost;

/// Reason for which a step failed, for a person.
pub type Failure = String;

/// A run of steps that ends with the first failure.
pub struct Run {
    task: &'static str,
    began: Instant,
    steps: Vec<Step>,
}

/// A step that has ended.
struct Step {
    name: &'static str,
    duration: Duration,
    /// Seconds that its programs have spent on a core.
    core_s: f64,
    passed: bool,
}

impl Run {
    /// A run without steps.
    pub fn new(task: &'static str) -> Run {
        Run { task, began: Instant::now(), steps: Vec::new() }
    }

    /// Prints the step's name and runs it.
    pub fn step<T>(&mut self, name: &'static str, action: impl FnOnce() -> Result<T, Failure>) -> Result<T, Failure> {
        let start = self.begin(name);
        let spent_s = cost::spent_s();
        let result = action();
        self.end(name, start, cost::spent_s() - spent_s, result.is_ok());
        result
    }

    /// Runs a step that takes all cores beside steps that leave some idle, and waits for both. If
    /// both fail, the step's failure is returned.
    pub fn beside<T>(
        &mut self,
        name: &'static str,
        action: impl FnOnce() -> Result<(), Failure> + Send,
        steps: impl FnOnce(&mut Run) -> Result<T, Failure>,
    ) -> Result<T, Failure> {
        let start = self.begin(name);
        let ((ended, core_s), value) = std::thread::scope(|scope| {
            let action = scope.spawn(|| (action(), cost::spent_s()));
            let value = steps(self);
            (action.join().unwrap_or_else(|_| (Err(format!("{name} panicked")), 0.0)), value)
        });
        self.end(name, start, core_s, ended.is_ok());
        ended.and(value)
    }

    /// Prints a step's name.
    fn begin(&self, name: &str) -> Instant {
        let start = Instant::now();
        // Standard error, where cargo's own messages go: one stream keeps them in order. A run that
        // is ended from outside prints no summary.
        eprintln!("\n==> {name} (after {} min)", start.duration_since(self.began).as_secs() / 60);
        start
    }

    fn end(&mut self, name: &'static str, start: Instant, core_s: f64, passed: bool) {
        self.steps.push(Step { name, duration: start.elapsed(), core_s, passed });
    }

    /// The steps so far, with the core-seconds of each.
    pub fn costs(&self) -> impl Iterator<Item = (&'static str, f64)> {
        self.steps.iter().map(|step| (step.name, step.core_s))
    }

    /// Prints the table of steps and turns the result into the process's exit code: 0, or 1
    /// after a failure.
    pub fn finish(self, result: Result<(), Failure>) -> ExitCode {
        eprintln!("\ncargo xtask {}:\n           seconds  core-seconds", self.task);
        for step in &self.steps {
            let word = if step.passed { "passed" } else { "FAILED" };
            eprintln!("  {word} {:9.1} {:13.1}  {}", step.duration.as_secs_f64(), step.core_s, step.name);
        }
        let core_s: f64 = self.steps.iter().map(|step| step.core_s).sum();
        eprintln!("         {:9.1} {core_s:13.1}  altogether", self.began.elapsed().as_secs_f64());
        match result {
            Ok(()) => {
                match self.steps.iter().filter(|step| !step.passed).count() {
                    0 => eprintln!("all {} steps passed", self.steps.len()),
                    failed => eprintln!("{failed} of {} steps failed, which this run permits", self.steps.len()),
                }
                ExitCode::SUCCESS
            }
            Err(reason) => {
                eprintln!("stopped: {reason}");
                ExitCode::FAILURE
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failure_beside_ends_the_run() {
        let results = |beside: Result<(), &'static str>, within: Result<u8, &'static str>| {
            let mut run = Run::new("test");
            let result = run.beside(
                "beside",
                || beside.map_err(str::to_owned),
                |run| run.step("within", || within.map_err(str::to_owned)),
            );
            let steps: Vec<_> = run.steps.iter().map(|step| (step.name, step.passed)).collect();
            assert_eq!(steps, [("within", within.is_ok()), ("beside", beside.is_ok())]);
            result
        };
        assert_eq!(results(Ok(()), Ok(7)), Ok(7));
        assert_eq!(results(Ok(()), Err("w")), Err("w".to_owned()));
        assert_eq!(results(Err("b"), Ok(7)), Err("b".to_owned()));
        assert_eq!(results(Err("b"), Err("w")), Err("b".to_owned()));
    }

    #[test]
    fn a_panic_beside_is_a_failure() {
        let result = Run::new("test").beside("beside", || panic!("on purpose"), |_| Ok(()));
        assert_eq!(result, Err("beside panicked".to_owned()));
    }
}
