//! Any text is a command or an error that can be told; numbers read back from their own text.
#![no_main]

use ferrostep_gcode::{AxisWords, Command, Decimal, parse};
use libfuzzer_sys::fuzz_target;

fn reads_back(number: Option<Decimal>) {
    if let Some(number) = number {
        assert_eq!(Decimal::parse(number.to_string().as_bytes()), Ok(number));
        assert!(number.to_10nm_from_inches().is_some());
        assert!(number.to_10nm_from_mm().unsigned_abs() <= 922_337_203_685_478);
    }
}

fuzz_target!(|text: &str| {
    match parse(text) {
        Ok(Command::Linear { axes: AxisWords { x, y, z, e }, feed, .. }) => {
            [x, y, z, e, feed].into_iter().for_each(reads_back);
            assert!(feed.is_none_or(|feed| feed > Decimal::ZERO));
        }
        Ok(Command::Unknown(unknown)) => assert!(text.contains(unknown)),
        Ok(_) => {}
        Err(error) => assert!(!error.to_string().is_empty()),
    }
    let _: Result<Decimal, _> = Decimal::parse(text.as_bytes());
});
