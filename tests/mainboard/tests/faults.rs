//! A sample of faults from outside: each fault in two states, compared with the
//! documentation's promises.
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

/// Two states for each fault: where it matters or, for faults that take minutes to be detected,
/// where it does not.
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
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    Campaign::new(Bench::new(&root, BOARD).unwrap()).unwrap()
}

/// The faults are tried in as many tests, so that a check need not run them all.
const PARTS: usize = 5;

/// Each fault of a part with both states.
fn of_part(part: usize) -> Vec<(&'static str, Fault, State)> {
    let faults = ALL.iter().skip(part).step_by(PARTS);
    faults.flat_map(|(name, fault, _)| states(*fault).map(|state| (*name, *fault, state))).collect()
}

/// A fault and a state, with what must be seen of them: a campaign that injects
/// nothing finds nothing.
type Effect = (&'static str, State, fn(&Outcome) -> bool);
const EFFECTS: [Effect; 5] = [
    ("nozzle-thermistor-open", State::Waiting, |seen| seen.host_read.contains("MINTEMP")),
    ("nozzle-thermistor-open", State::Waiting, |seen| seen.heaters_off_ms.unwrap() > 10.0),
    ("core-halted", State::Waiting, |seen| seen.host_read.contains("watchdog")),
    ("driver-resets", State::Printing, |seen| seen.host_read.starts_with("Error")),
    ("3v3-returns", State::Waiting, |seen| seen.resets.len() == 1),
];

fn assert_every_fault_keeps_its_promise(part: usize) {
    let campaign = campaign();
    let wanted = of_part(part);
    let (next, outcomes) = (AtomicUsize::new(0), Mutex::new(Vec::<Outcome>::new()));
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                while let Some((_, fault, state)) = wanted.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let outcome = campaign.run(7, Wanted { only: Some(*fault), state: Some(*state) });
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
    let is_end_stop = |outcome: &&Outcome| matches!(Fault::named(outcome.fault), Some(Fault::EndStop(_)));
    for outcome in &outcomes {
        for (name, state, is_seen) in EFFECTS {
            assert!(
                (outcome.fault, outcome.state) != (name, state) || is_seen(outcome),
                "{name}: {}",
                outcome.host_read
            );
        }
    }
    let mut of_end_stops = outcomes.iter().filter(is_end_stop);
    assert!(of_end_stops.all(|outcome| outcome.without), "this board has no end stops");
}

macro_rules! parts {
    ($($name:ident: $part:literal,)*) => {
        $(
            #[test]
            fn $name() {
                assert_every_fault_keeps_its_promise($part);
            }
        )*

        /// All faults are in one of the parts, and so is each with a known effect.
        #[test]
        fn the_parts_are_all_faults() {
            let tried: Vec<_> = [$($part),*].into_iter().flat_map(of_part).collect();
            assert_eq!(tried.len(), 2 * ALL.len());
            for (_, fault, _) in ALL {
                assert!(tried.iter().any(|(_, of, _)| *of == fault), "{}", fault.name());
            }
            for (name, state, _) in EFFECTS {
                assert!(tried.iter().any(|(of, _, with)| (*of, *with) == (name, state)), "{name}");
            }
            assert!(tried.iter().any(|(_, fault, _)| matches!(fault, Fault::EndStop(_))));
        }
    };
}

parts! {
    every_fault_keeps_its_promise_in_two_states_0: 0,
    every_fault_keeps_its_promise_in_two_states_1: 1,
    every_fault_keeps_its_promise_in_two_states_2: 2,
    every_fault_keeps_its_promise_in_two_states_3: 3,
    every_fault_keeps_its_promise_in_two_states_4: 4,
}

#[test]
fn a_seed_alone_determines_a_run() {
    let campaign = campaign();
    let wanted = Wanted { only: Fault::named("ram-bit-flips"), state: Some(State::Printing) };
    let [one, same, other] = [5, 5, 6].map(|seed| campaign.run(seed, wanted));
    let text = |outcome: &Outcome| serde_json::to_string(outcome).unwrap();
    assert_eq!(text(&one), text(&same));
    assert_ne!(text(&one), text(&other));
}
