#![allow(clippy::unwrap_used)]

use super::*;
use crate::frame::Mode;
use crate::motion::Motion;
use crate::shapers::Impulse;
use crate::shapers::{Shaper, ShaperKind};
use ferrostep_random_cases::cases;
use proptest::prelude::*;

/// Builds a law from pieces with these durations and accelerations, starting at rest.
fn law(position_mm: f64, parts: &[(f64, f64)]) -> Law {
    let (mut start_s, mut motion) = (0.5, Motion::standing(position_mm));
    let mut pieces = Vec::new();
    for &(duration_s, acceleration_mm_per_s2) in parts {
        motion.acceleration_mm_per_s2 = acceleration_mm_per_s2;
        pieces.push(Piece { start_s, duration_s, motion });
        motion = motion.after(duration_s);
        start_s += duration_s;
    }
    Law::new(pieces).unwrap()
}

/// Builds a law that accelerates, cruises and stops.
fn line(speed: f64, acceleration: f64, cruise_s: f64) -> Law {
    let ramp_s = speed / acceleration;
    law(0.0, &[(ramp_s, acceleration), (cruise_s, 0.0), (ramp_s, -acceleration)])
}

/// Steps/mm of the trains whose ringing is measured: half a step is 3 um, 0.8 % of what a stop from
/// 300 mm/s leaves at 120 Hz.
const FINE_STEPS_PER_MM: f64 = 160.0;

fn steps(law: &Law, impulses: &[Impulse]) -> Vec<StepTime> {
    step_times(&ShapedLaw { law, impulses }, 80.0)
}

#[test]
fn steps_of_a_ramp_are_where_the_square_root_puts_them() {
    let law = law(0.0, &[(0.1, 1000.0)]);
    let steps = steps(&law, Shaper::identity().impulses());
    // 5 mm at 80 steps/mm.
    assert_eq!(steps.len(), 400);
    for (index, step) in steps.iter().enumerate() {
        let distance_mm = (index as f64 + 0.5) / 80.0;
        assert!((step.time_s - 0.5 - (2.0 * distance_mm / 1000.0).sqrt()).abs() < 1e-12 && !step.negative);
    }
}

#[test]
fn a_law_outside_of_its_pieces_stands() {
    let law = line(100.0, 2000.0, 0.3);
    assert_eq!(law.at(0.2), Motion::standing(0.0));
    assert!((law.at(9.0).position_mm - 35.0).abs() < 1e-9);
    assert!(law.at(9.0).is_standing() && !law.at(0.6).is_standing());
    let [start_s, end_s] = law.ends_s();
    assert!((start_s - 0.5).abs() < 1e-12 && (end_s - 0.9).abs() < 1e-12);
}

#[test]
fn what_is_no_law_is_refused() {
    let piece = |start_s, duration_s| Piece { start_s, duration_s, motion: Motion::default() };
    assert_eq!(Law::new(Vec::new()), Err(LawError::Empty));
    assert_eq!(Law::new(vec![piece(0.0, 1.0), piece(1.1, 1.0)]), Err(LawError::Joint(1)));
    assert_eq!(Law::new(vec![piece(0.0, 0.0)]), Err(LawError::Number(0)));
    assert_eq!(Law::new(vec![piece(f64::NAN, 1.0)]), Err(LawError::Number(0)));
}

#[test]
fn an_advanced_law_jumps_and_its_steps_with_it() {
    let law = line(50.0, 1000.0, 0.2).advanced(0.04, |_| true);
    // Position + 0.04 s * speed: at the start of the ramp this raises the speed by 0.04 s of
    // acceleration and the position by 0.
    assert!((law.at(0.5).speed_mm_per_s - 40.0).abs() < 1e-9);
    assert!((law.at(0.6).position_mm - (line(50.0, 1000.0, 0.2).at(0.6).position_mm + 2.0)).abs() < 1e-9);
    let end = law.at(2.0).position_mm;
    let net: i64 = steps(&law, Shaper::identity().impulses()).iter().map(|one| if one.negative { -1 } else { 1 }).sum();
    assert_eq!(net, (end * 80.0).round() as i64);
}

/// Returns the amplitude that a train of steps leaves in a mode, mm, at `until_s`.
fn residual_of_steps(steps: &[StepTime], hz: f64, damping: f64, until_s: f64) -> f64 {
    let mut mode = Mode::new(hz, damping).unwrap();
    let (mut place, mut time_s) = (0.0, 0.0);
    for step in steps {
        mode.advance(step.time_s - time_s, Motion::standing(place));
        place += if step.negative { -1.0 } else { 1.0 } / FINE_STEPS_PER_MM;
        time_s = step.time_s;
    }
    mode.advance(until_s - time_s, Motion::standing(place));
    mode.ringing_mm(Motion::standing(place))
}

/// The step train of a shaped stop leaves the vibration that theory predicts, within 1 % of what an
/// unshaped one leaves.
///
/// The plan goes from rest to 300 mm/s and back to rest, within a third of a millisecond each:
/// nearly an impulse.
#[test]
fn steps_leave_what_the_theory_says() {
    for hz in [20.0, 50.0, 120.0] {
        let law = line(300.0, 1e6, 1.0);
        let end_s = law.ends_s()[1];
        let train =
            |shaper: &Shaper| step_times(&ShapedLaw { law: &law, impulses: shaper.impulses() }, FINE_STEPS_PER_MM);
        let plain = train(&Shaper::identity());
        let shaped = ShaperKind::ALL
            .map(|kind| Shaper::new(kind, hz, 0.1).map(|shaper| (kind, train(&shaper), shaper)).unwrap());
        for ratio in [0.8, 0.9, 1.0, 1.1, 1.2] {
            for damping in [0.05, 0.1, 0.15] {
                // Amplitude of the unshaped train at the same age: the last impulse is as old as
                // the train's end.
                let whole = residual_of_steps(&plain, hz * ratio, damping, end_s);
                for (kind, train, shaper) in &shaped {
                    let left = residual_of_steps(train, hz * ratio, damping, end_s + shaper.length_s());
                    let theory = shaper.residual(hz * ratio, damping);
                    assert!(
                        (left / whole - theory).abs() < 0.01,
                        "{kind} {hz} Hz at {ratio}, damping {damping}: {} instead of {theory}",
                        left / whole
                    );
                }
            }
        }
    }
}

fn any_law() -> impl Strategy<Value = Law> {
    (-50.0f64..50.0, prop::collection::vec((1e-4f64..0.05, -5000.0f64..5000.0), 1..30))
        .prop_map(|(position, parts)| law(position, &parts))
}

fn any_shaper() -> impl Strategy<Value = Shaper> {
    (prop::sample::select(ShaperKind::ALL.to_vec()), 20.0f64..120.0, 0.0f64..0.2)
        .prop_map(|(kind, hz, damping)| Shaper::new(kind, hz, damping).unwrap().centred())
}

proptest! {
    #![proptest_config(cases(64))]

    #[test]
    fn each_step_is_at_a_crossing_and_the_sum_is_the_way(law in any_law(), shaper in any_shaper()) {
        let shaped = ShapedLaw { law: &law, impulses: shaper.impulses() };
        let [start_s, end_s] = law.ends_s();
        let mut place = (shaped.at(start_s - 1.0).position_mm * 80.0).round();
        let mut before_s = f64::MIN;
        for step in step_times(&shaped, 80.0) {
            let sign = if step.negative { -1.0 } else { 1.0 };
            let position = shaped.at(step.time_s).position_mm * 80.0;
            prop_assert!((position - place - 0.5 * sign).abs() < 1e-6, "{position} at {place}");
            prop_assert!(step.time_s >= before_s);
            place += sign;
            before_s = step.time_s;
        }
        // The law may end in motion and then rest, without any speed or steps.
        prop_assert!((place - shaped.at(end_s + 1.0).position_mm * 80.0).abs() <= 0.5 + 1e-6);
    }

    #[test]
    fn any_cut_gives_the_same_steps(law in any_law(), shaper in any_shaper(), part in 0.1f64..0.9) {
        let cut: Vec<Piece> = law.pieces().iter().flat_map(|piece| {
            let first_s = piece.duration_s * part;
            let rest = Piece {
                start_s: piece.start_s + first_s,
                duration_s: piece.duration_s - first_s,
                motion: piece.motion.after(first_s),
            };
            [Piece { duration_s: first_s, ..*piece }, rest]
        }).collect();
        let cut = Law::new(cut).unwrap();
        let (whole, parts) = (steps(&law, shaper.impulses()), steps(&cut, shaper.impulses()));
        prop_assert_eq!(whole.len(), parts.len());
        for (one, other) in whole.iter().zip(&parts) {
            prop_assert!((one.time_s - other.time_s).abs() < 1e-7 && one.negative == other.negative);
        }
    }

    #[test]
    fn a_cursor_sees_what_a_search_finds(law in any_law(), shaper in any_shaper(), parts in prop::collection::vec(0.0f64..0.01, 1..200)) {
        let shaped = ShapedLaw { law: &law, impulses: shaper.impulses() };
        let mut cursor = ShapedCursor::new(shaped);
        let mut time_s = 0.4;
        for part in parts {
            time_s += part;
            let (one, other) = (cursor.at(time_s), shaped.at(time_s));
            prop_assert!((one.position_mm - other.position_mm).abs() < 1e-9);
            let next_s = cursor.next_breakpoint_s(time_s);
            let expected = shaped.breakpoints_s().into_iter().find(|other| *other > time_s).unwrap_or(f64::INFINITY);
            prop_assert_eq!(next_s, expected);
        }
    }

    #[test]
    fn constant_speed_passes_a_centred_shaper(speed in -300.0f64..300.0, shaper in any_shaper()) {
        let motion = Motion { position_mm: 1.0, speed_mm_per_s: speed, acceleration_mm_per_s2: 0.0 };
        let law = Law::new(vec![Piece { start_s: 0.0, duration_s: 2.0, motion }]).unwrap();
        let shaped = ShapedLaw { law: &law, impulses: shaper.impulses() };
        prop_assert!((shaped.at(1.0).position_mm - 1.0 - speed).abs() < 1e-9);
    }
}
