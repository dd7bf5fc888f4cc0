//! A sample of faults from outside: each fault in two states, compared with the documentation's promises.
//!
//! Thousands of them: `ferrostep-mainboard faults --count 10000`.
#![allow(clippy::unwrap_used)]

use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use ferrostep_mainboard::faults::bench::Bench;
use ferrostep_mainboard::faults::campaign::{Campaign, Wanted};
use ferrostep_mainboard::faults::fault::{ALL, Block, DriverFault, Fault, ThermistorFault};
use ferrostep_mainboard::faults::matrix::{Matrix, reproduction};
use ferrostep_mainboard::faults::state::State;
use ferrostep_mainboard::faults::verdict::Outcome;
use ferrostep_mainboard::parts::heat::HeaterFault;

const BOARD: &str = "prusa-buddy";

/// Two states for each fault: where it matters or, for faults that take minutes to be detected, where it does not.
fn states(fault: Fault) -> [State; 2] {
    match fault {
        Fault::EndStop(_) | Fault::Probe(_) | Fault::InputStorm => [State::Homing, State::Printing],
        Fault::Driver(DriverFault::Hot | DriverFault::Short) | Fault::MotorSupply(_) => {
            [State::Homing, State::Printing]
        }
        Fault::Driver(_) => [State::Idle, State::Printing],
        Fault::Thermistor(_, ThermistorFault::SlippedOut) | Fault::Heater(_, HeaterFault::Broken) => {
            [State::Idle, State::Halted]
        }
        Fault::Heater(Block::Bed, HeaterFault::StuckOn) => [State::Idle, State::Halted],
        Fault::HostVanishes => [State::Idle, State::Waiting],
        Fault::Flip(_) => [State::Waiting, State::Printing],
        _ => [State::Idle, State::Waiting],
    }
}

/// A campaign with the image of target/images; without it the test fails.
fn campaign() -> Campaign {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    Campaign::new(Bench::new(&root, BOARD).unwrap()).unwrap()
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes minutes without optimization")]
fn every_fault_keeps_its_promise_in_two_states() {
    let campaign = campaign();
    let wanted: Vec<Wanted> = ALL
        .iter()
        .flat_map(|(_, fault, _)| states(*fault).map(|state| Wanted { only: Some(*fault), state: Some(state) }))
        .collect();
    let (next, outcomes) = (AtomicUsize::new(0), Mutex::new(Vec::<Outcome>::new()));
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                while let Some(wanted) = wanted.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let outcome = campaign.run(7, *wanted);
                    outcomes.lock().unwrap().push(outcome);
                }
            });
        }
    });
    let outcomes = outcomes.into_inner().unwrap();
    println!("{}", Matrix::new(&outcomes).text());
    let violated: Vec<String> = outcomes
        .iter()
        .filter(|outcome| !outcome.violations.is_empty())
        .map(|outcome| format!("{}\n    {}", outcome.violations.join("; "), reproduction(BOARD, outcome)))
        .collect();
    assert!(violated.is_empty(), "{}", violated.join("\n"));
    // The effects of faults must be visible: a campaign that injects nothing finds nothing.
    let found = |name: &str, state: State| {
        outcomes.iter().find(|outcome| outcome.fault == name && outcome.state == state).unwrap()
    };
    assert!(found("nozzle-thermistor-open", State::Waiting).host_read.contains("MINTEMP"));
    assert!(found("nozzle-thermistor-open", State::Waiting).heaters_off_ms.unwrap() > 10.0);
    assert!(found("core-halted", State::Waiting).host_read.contains("watchdog"));
    assert!(found("driver-resets", State::Printing).host_read.starts_with("Error"));
    assert!(found("3v3-returns", State::Waiting).resets.len() == 1);
    assert!(outcomes.iter().any(|outcome| outcome.without), "this board has no end stops");
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes minutes without optimization")]
fn a_seed_alone_determines_a_run() {
    let campaign = campaign();
    let wanted = Wanted { only: Fault::named("ram-bit-flips"), state: Some(State::Printing) };
    let [one, same, other] = [5, 5, 6].map(|seed| campaign.run(seed, wanted));
    let text = |outcome: &Outcome| serde_json::to_string(outcome).unwrap();
    assert_eq!(text(&one), text(&same));
    assert_ne!(text(&one), text(&other));
}
