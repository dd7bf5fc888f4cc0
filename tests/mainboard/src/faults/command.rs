//! `mainboard faults`: runs with faults, and their matrix.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::Args;

use super::bench::Bench;
use super::campaign::{Campaign, Runs, Wanted};
use super::fault::{self, Fault};
use super::matrix::{Matrix, reproduction};
use super::state::State;
use super::verdict::Outcome;

/// Injects faults at random instants and compares the outcome with the documentation.
#[derive(Debug, Args)]
pub struct Faults {
    /// The board: a name in config/boards/, with an image in target/images/.
    #[arg(long, default_value = "prusa-buddy")]
    pub board: String,
    /// Number of runs.
    #[arg(long, default_value_t = 200)]
    pub count: usize,
    /// Seed that draws the seeds of the runs.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Run this fault only.
    #[arg(long, value_parser = fault_named)]
    pub only: Option<Fault>,
    /// Run this state only.
    #[arg(long, value_parser = state_named)]
    pub state: Option<State>,
    /// Repeat the run of this seed, as a report names it, and print its details.
    #[arg(long)]
    pub run: Option<u64>,
    /// Number of threads.
    #[arg(long, default_value_t = 2)]
    pub threads: usize,
    /// Start no run after this many minutes.
    #[arg(long)]
    pub minutes: Option<u64>,
    /// The repository's root.
    #[arg(long, default_value = "../..")]
    pub root: PathBuf,
    /// Print JSON: the matrix and every violation.
    #[arg(long)]
    pub json: bool,
    /// Write the matrix to this CSV file.
    #[arg(long)]
    pub csv: Option<PathBuf>,
    /// Write every outcome to this file as it occurs, one JSON object a line.
    #[arg(long)]
    pub outcomes: Option<PathBuf>,
}

fn fault_named(name: &str) -> Result<Fault, String> {
    let all = || fault::ALL.map(|(name, ..)| name).join(", ");
    Fault::named(name).ok_or_else(|| format!("unknown fault; choose one of {}", all()))
}

fn state_named(name: &str) -> Result<State, String> {
    let all = || State::ALL.map(State::name).join(", ");
    State::ALL
        .into_iter()
        .find(|state| state.name() == name)
        .ok_or_else(|| format!("unknown state; choose one of {}", all()))
}

impl Faults {
    /// Executes the runs and prints their matrix. True if every promise held.
    ///
    /// # Errors
    /// The board does not reach all its states, or a file cannot be written.
    pub fn execute(&self) -> Result<bool, String> {
        let began = Instant::now();
        let campaign = Campaign::new(Bench::new(&self.root, &self.board)?)?;
        eprintln!("{}: reached all states after {:.1} s", self.board, began.elapsed().as_secs_f64());
        let wanted = Wanted { only: self.only, state: self.state };
        if let Some(seed) = self.run {
            let outcome = campaign.run(seed, wanted);
            println!("{}", serde_json::to_string_pretty(&outcome).map_err(|error| error.to_string())?);
            return Ok(outcome.violations.is_empty());
        }
        let file = self.outcomes.as_ref().map(|path| {
            std::fs::File::create(path)
                .map(std::sync::Mutex::new)
                .map_err(|error| format!("{} cannot be written: {error}; check --outcomes", path.display()))
        });
        let file = file.transpose()?;
        let progress = |index: usize, outcome: &Outcome| {
            if let (Some(file), Ok(line)) = (&file, serde_json::to_string(outcome))
                && let Ok(mut file) = file.lock()
            {
                // A failed write only loses its line of the file.
                let _ = std::io::Write::write_all(&mut *file, format!("{line}\n").as_bytes());
            }
            if (index + 1).is_multiple_of(500) {
                eprintln!("{} of {} runs after {:.0} s", index + 1, self.count, began.elapsed().as_secs_f64());
            }
        };
        let until = self.minutes.map(|minutes| Instant::now() + Duration::from_secs(60 * minutes));
        let outcomes =
            campaign.runs(Runs { count: self.count, seed: self.seed, threads: self.threads, wanted, until }, progress);
        self.report(&outcomes, began)
    }

    fn report(&self, outcomes: &[Outcome], began: Instant) -> Result<bool, String> {
        let matrix = Matrix::new(outcomes);
        let violations: Vec<&Outcome> = outcomes.iter().filter(|outcome| !outcome.violations.is_empty()).collect();
        if let Some(path) = &self.csv {
            std::fs::write(path, matrix.csv())
                .map_err(|error| format!("{} cannot be written: {error}; check --csv", path.display()))?;
        }
        if self.json {
            let report = serde_json::json!({ "board": self.board, "matrix": matrix, "violations": violations });
            println!("{report}");
            return Ok(violations.is_empty());
        }
        println!("{}\n{}", matrix.text(), matrix.lines());
        for outcome in &violations {
            println!("{}", outcome.violations.join("; "));
            println!("    {} ({}; at {:.4} s)", outcome.host_read, outcome.detail, outcome.at_s);
            println!("    {}", reproduction(&self.board, outcome));
        }
        println!(
            "{} runs, {} with violations, {:.0} s",
            outcomes.len(),
            violations.len(),
            began.elapsed().as_secs_f64()
        );
        Ok(violations.is_empty())
    }
}
