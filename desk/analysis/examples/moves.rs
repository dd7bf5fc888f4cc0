//! Prints each move of a G-code file with its time and the limit that holds for most of it:
//! `cargo run -p ferrostep-analysis --example moves -- examples/cube.gcode`

use ferrostep_analysis::job_machine::JobMachine;
use ferrostep_profiles::PlannedBy;
use ferrostep_session::job::{self, JobProgress};
use ferrostep_session::rules::{Piece, PlanObserver};
use ferrostep_session::{JobReplies, Session, input::Input};

struct Table;

impl PlanObserver for Table {
    fn ran(&mut self, Piece { line, displacement_mm: [x, y, z, e], phases, .. }: &Piece) {
        let seconds: f64 = phases.iter().map(|phase| phase.seconds).sum();
        let limit = phases.iter().max_by(|a, b| a.seconds.total_cmp(&b.seconds)).map_or("", |phase| phase.limit);
        println!("line {line}: X{x:+.2} Y{y:+.2} Z{z:+.2} E{e:+.3} in {seconds:.4} s, {limit}");
    }

    fn stands(&mut self, _: u64, _: [f64; 3]) {}
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let file = std::env::args_os().nth(1).ok_or("usage: moves FILE")?;
    let mut input = Input::open(file.as_ref())?;
    let machine = JobMachine::of(None, Some(PlannedBy::Klipper), file.as_ref(), &input)?.ruled()?;
    let rules = machine.by.ok_or("this firmware's rules have no observer")?;
    let session = Session::by_rules(machine.profile, rules, JobReplies::new(|text: &str| eprintln!("{text}")));
    session.desk().observe(Box::new(Table));
    session.run(job::run(&mut input, &mut session.printer(), &mut JobProgress::default(), |_| {}))?;
    println!("{:.1} s", session.figures().print_time_s);
    Ok(())
}
