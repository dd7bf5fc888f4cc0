//! Content of the start of a frame.

use ferrostep_gpre::compact::{Frame, FrameState};
use ferrostep_gpre::{Fault, LimitValues, ModalState};

use super::{Limit, Start, refused};
use crate::framed::framed;

/// Start state of a frame without items, or the fault for which it is rejected.
fn start(start: &Start) -> Result<FrameState, Fault> {
    let bytes = start.with(0, |_| ());
    let frame = Frame::read(&bytes, 0, None).unwrap();
    frame.items().map(|decoder| *decoder.start())
}

fn content(text: &'static str) -> Result<FrameState, Fault> {
    Err(Fault::Content(text))
}

const LIMITS: usize = size_of::<LimitValues>() / size_of::<f32>();

#[test]
fn all_of_it_is_read() {
    let limits: Vec<_> = (0..LIMITS)
        .map(|index| if index % 2 == 0 { Limit::Whole(index as u64 + 1) } else { Limit::Float(0.5) })
        .collect();
    let given = Start { limits: Some(limits), ..Start::default() };
    let expected = FrameState {
        can_be_entered: true,
        position_10nm: [1_000, -2_000, 30],
        line: 7,
        feed_mm_per_s: 40.0,
        fan_power: 200,
        modal: ModalState {
            nozzle_celsius: 215,
            bed_celsius: 60,
            feed_percent: 100,
            flow_percent: 95,
            extruder_10nm: 123,
            offset_10nm: [4, 5, -6],
            lift_10nm: 8,
            limits: Some(core::array::from_fn(|index| if index % 2 == 0 { index as f32 + 1.0 } else { 0.5 })),
        },
    };
    assert_eq!(start(&given), Ok(expected));
    let modal = ModalState { limits: None, ..expected.modal };
    let given = Start { can_be_entered: false, ..Start::default() };
    assert_eq!(start(&given), Ok(FrameState { can_be_entered: false, modal, ..expected }));
}

#[test]
fn a_place_beyond_five_metres_is_refused() {
    for axis in 0..3 {
        for (place, is_read) in [(500_000_000, true), (-500_000_000, true), (500_000_001, false), (-500_000_001, false)]
        {
            let mut given = Start::default();
            given.position[axis] = place;
            match start(&given) {
                Ok(state) if is_read => assert_eq!(state.position_10nm[axis], place),
                outcome => assert_eq!(outcome, content("coordinates within 5 m"), "{place}"),
            }
        }
        // Includes a value of more than 32 bits: its lower half alone would be a valid position.
        let mut given = Start::default();
        given.position[axis] = (1 << 32) + 5;
        assert_eq!(start(&given), content("coordinates within 5 m"));
    }
}

#[test]
fn a_feed_that_is_none_is_refused() {
    for feed in [0.0, -0.0, -40.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        assert_eq!(start(&Start { feed, ..Start::default() }), content("a feed above zero"), "{feed}");
    }
    for feed in [f32::MIN_POSITIVE, f32::MAX] {
        assert_eq!(start(&Start { feed, ..Start::default() }).map(|state| state.feed_mm_per_s), Ok(feed));
    }
}

#[test]
fn percentages_and_temperatures_have_16_bits() {
    for index in 0..4 {
        let mut given = Start::default();
        given.small[index] = 65_535;
        assert!(start(&given).is_ok());
        given.small[index] = 65_536;
        assert_eq!(start(&given), content("percentages and temperatures of 16 bits"));
        given.small[index] = 1 << 32;
        assert_eq!(start(&given), content("a number of at most 32 bits"));
    }
    assert_eq!(start(&Start { line: (1 << 32) - 1, ..Start::default() }).map(|state| state.line), Ok(u32::MAX));
    assert_eq!(start(&Start { line: 1 << 32, ..Start::default() }), content("a number of at most 32 bits"));
}

#[test]
fn a_limit_that_is_none_is_refused() {
    let bad = [0.0, -1.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY].map(Limit::Float);
    for index in 0..LIMITS {
        for limit in bad.into_iter().chain([Limit::Whole(0)]) {
            let mut limits = vec![Limit::Whole(1); LIMITS];
            limits[index] = limit;
            let given = Start { limits: Some(limits), ..Start::default() };
            // The last four limits, those of corners, may be infinite.
            if index >= LIMITS - 4 && matches!(limit, Limit::Float(f32::INFINITY)) {
                assert!(start(&given).is_ok());
                continue;
            }
            assert_eq!(start(&given), content("limits above zero"), "{limit:?} at {index}");
        }
    }
}

#[test]
fn units_are_from_1_to_1000() {
    for (unit, is_read) in [(0, false), (1, true), (1000, true), (1001, false), (u64::from(u32::MAX), false)] {
        for given in [Start { unit, ..Start::default() }, Start { filament_unit: unit, ..Start::default() }] {
            match start(&given) {
                Ok(_) => assert!(is_read, "{unit}"),
                outcome => assert_eq!((outcome, is_read), (content("units from 1 to 1000"), false), "{unit}"),
            }
        }
    }
}

/// Every prefix of a start is rejected: a whole start needs all its bits.
#[test]
fn a_frame_that_ends_within_its_start_is_refused() {
    let limits = Some(vec![Limit::Float(1.0); LIMITS]);
    let bytes = Start { limits, ..Start::default() }.bits(0).into_bytes();
    for length in 0..bytes.len() {
        let (read, fault) = refused(&framed(&bytes[..length]));
        assert!(read == 0 && matches!(fault, Fault::Content(_)), "{fault}");
    }
}
