//! The seed of a run's random cases.

use std::time::{SystemTime, UNIX_EPOCH};

/// Environment variable with the tests' seed.
pub const VARIABLE: &str = "PROPTEST_RNG_SEED";

/// Gives every program that cargo runs a seed, unless it has one: so this program has one as well.
const CARGO_CONFIG: &str = include_str!("../../.cargo/config.toml");

/// The seed that is set, or a new one.
pub fn of_this_run() -> u64 {
    given(std::env::var(VARIABLE).ok().as_deref()).unwrap_or_else(|| {
        // A clock before 1970 gives any seed.
        SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos() as u64)
    })
}

/// The variable's number, if it is not the one that cargo's configuration gives to everyone.
fn given(variable: Option<&str>) -> Option<u64> {
    let seed = variable.filter(|seed| !CARGO_CONFIG.contains(&format!("{VARIABLE} = \"{seed}\"")))?;
    seed.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_an_explicit_seed_is_taken() {
        assert_eq!(
            [given(Some("7")), given(Some("20190101")), given(Some("x")), given(None)],
            [Some(7), None, None, None]
        );
        assert!(CARGO_CONFIG.contains(VARIABLE));
    }

    #[test]
    fn each_run_has_another_seed() {
        if given(std::env::var(VARIABLE).ok().as_deref()).is_none() {
            let first = of_this_run();
            std::thread::sleep(std::time::Duration::from_millis(1));
            assert_ne!(first, of_this_run());
        }
    }
}
