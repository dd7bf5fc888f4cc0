//! The time of a job by the rules of another firmware.
//!
//! The printer's own code reads the job, as in an estimate: units, coordinates, retractions,
//! percentages, macros, waits and homing are those of the desk's run. Only the moves go to that
//! firmware's planner ([`ferrostep_rules`]), with arcs as it cuts them, and the commands that
//! change its limits are read as it reads them. Homing keeps this firmware's time.

mod changes;
mod machine;
mod motion;
mod observer;
mod plan;
mod reader;
mod refusals;
mod scale;
mod settings;

pub use machine::{MachineError, RuledMachine};
pub use motion::RulesMotion;
pub use observer::{Piece, PlanObserver};
pub use reader::RulesReader;
pub use refusals::Refusals;
pub use scale::{Scale, Scaled};
pub use settings::ByRules;
