//! Steps with a name and a time, and the closing summary.

use std::process::ExitCode;
use std::time::{Duration, Instant};

/// Why a step failed, for a person.
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
    passed: bool,
}

impl Run {
    /// A run without steps.
    pub fn new(task: &'static str) -> Run {
        Run { task, began: Instant::now(), steps: Vec::new() }
    }

    /// Says the step's name and runs it.
    pub fn step<T>(&mut self, name: &'static str, action: impl FnOnce() -> Result<T, Failure>) -> Result<T, Failure> {
        // Standard error, where cargo's own messages go: one stream keeps them in order.
        let start = Instant::now();
        // The summary does not come where a run is ended from outside.
        eprintln!("\n==> {name} (after {} min)", start.duration_since(self.began).as_secs() / 60);
        let result = action();
        self.steps.push(Step { name, duration: start.elapsed(), passed: result.is_ok() });
        result
    }

    /// Prints what was done and turns the result into the process's exit code: 0, or 1 after a failure.
    pub fn finish(self, result: Result<(), Failure>) -> ExitCode {
        eprintln!("\ncargo xtask {}:", self.task);
        for step in &self.steps {
            let word = if step.passed { "passed" } else { "FAILED" };
            eprintln!("  {word} {:7.1} s  {}", step.duration.as_secs_f64(), step.name);
        }
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
