//! `mainboard faults`: runs with faults, and their matrix.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::Args;

use super::fault::{self, Fault};
use super::matrix::{Matrix, reproduction};
use super::state::State;
use super::verdict::Outcome;
use super::{Bench, Campaign, Runs, Wanted};

/// Lets parts fail at random instants and holds what comes of it against the documentation.
#[derive(Debug, Args)]
pub struct Faults {
    /// The board: a name of boards/, with an image in target/images/.
    #[arg(long, default_value = "prusa-buddy")]
    pub board: String,
    /// Runs.
    #[arg(long, default_value_t = 200)]
    pub count: usize,
    /// Draws the runs' own seeds.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// This fault alone.
    #[arg(long, value_parser = fault_named)]
    pub only: Option<Fault>,
    /// This state alone.
    #[arg(long, value_parser = state_named)]
    pub state: Option<State>,
    /// One run, with the seed that a report names, and all that is known of it.
    #[arg(long)]
    pub run: Option<u64>,
    /// Threads.
    #[arg(long, default_value_t = 2)]
    pub threads: usize,
    /// Begins no run after this many minutes.
    #[arg(long)]
    pub minutes: Option<u64>,
    /// The repository's root.
    #[arg(long, default_value = "..")]
    pub root: PathBuf,
    /// Prints JSON: the matrix and each violation.
    #[arg(long)]
    pub json: bool,
    /// Writes the matrix here, as CSV.
    #[arg(long)]
    pub csv: Option<PathBuf>,
    /// Writes each outcome here as it comes, a line of JSON each.
    #[arg(long)]
    pub outcomes: Option<PathBuf>,
}

fn fault_named(name: &str) -> Result<Fault, String> {
    let all = || fault::ALL.map(|(name, ..)| name).join(", ");
    Fault::named(name).ok_or_else(|| format!("no such fault; expected one of {}", all()))
}

fn state_named(name: &str) -> Result<State, String> {
    let all = || State::ALL.map(State::name).join(", ");
    State::ALL.into_iter().find(|state| state.name() == name).ok_or_else(|| format!("expected one of {}", all()))
}

impl Faults {
    /// Does the runs and prints their matrix; whether nothing was violated.
    ///
    /// # Errors
    /// The board does not get through its states, or a file cannot be written.
    pub fn execute(&self) -> Result<bool, String> {
        let began = Instant::now();
        let campaign = Campaign::new(Bench::new(&self.root, &self.board)?)?;
        eprintln!("{}: all states reached after {:.1} s", self.board, began.elapsed().as_secs_f64());
        let wanted = Wanted { only: self.only, state: self.state };
        if let Some(seed) = self.run {
            let outcome = campaign.run(seed, wanted);
            println!("{}", serde_json::to_string_pretty(&outcome).map_err(|error| error.to_string())?);
            return Ok(outcome.violations.is_empty());
        }
        let file = self.outcomes.as_ref().map(|path| {
            std::fs::File::create(path)
                .map(std::sync::Mutex::new)
                .map_err(|error| format!("{} cannot be written: {error}", path.display()))
        });
        let file = file.transpose()?;
        let progress = |index: usize, outcome: &Outcome| {
            if let (Some(file), Ok(line)) = (&file, serde_json::to_string(outcome))
                && let Ok(mut file) = file.lock()
            {
                // What cannot be written is missing in the file alone.
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
                .map_err(|error| format!("{} cannot be written: {error}", path.display()))?;
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
