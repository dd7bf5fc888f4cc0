//! Tests arcs as each firmware cuts them.

use ferrostep_random_cases::cases;
use ferrostep_rules::arcs::{Arc, ArcCut, ArcLimits, Chord, MarlinArcs};
use proptest::prelude::*;
use std::f64::consts::TAU;

fn quarter(radius: f64, is_clockwise: bool) -> Arc {
    let y = if is_clockwise { -radius } else { radius };
    Arc { displacement_mm: [radius, y, 0.0, 1.0], centre_mm: [0.0, y], is_clockwise }
}

const KLIPPER: ArcCut = ArcCut::Klipper { resolution_mm: 1.0 };

#[test]
fn chords_by_each_firmware() {
    // A quarter of a circle of 10 mm radius: 15.708 mm.
    for is_clockwise in [false, true] {
        let arc = quarter(10.0, is_clockwise);
        assert!((arc.sweep().abs() - TAU / 4.0).abs() < 1e-12);
        assert_eq!(arc.chords(&KLIPPER, 50.0).len(), 15);
        // 72 chords in a circle are 18 in this quarter, 0.87 mm long.
        assert_eq!(arc.chords(&ArcCut::Marlin(MarlinArcs::default()), 50.0).len(), 18);
        // 0.25 mm long by 200 chords per second at 50 mm/s; 0.63 mm by the deviation at 300 mm/s.
        assert_eq!(arc.chords(&ArcCut::Rrf, 50.0).len(), 63);
        assert_eq!(arc.chords(&ArcCut::Rrf, 300.0).len(), 25);
    }
    let per_second = MarlinArcs { segments_per_s: Some(100.0), ..MarlinArcs::default() };
    assert_eq!(quarter(10.0, false).chords(&ArcCut::Marlin(per_second), 50.0).len(), 31);
    // Chords of a small circle are no shorter than 0.1 mm.
    assert_eq!(quarter(0.5, false).chords(&ArcCut::Marlin(MarlinArcs::default()), 50.0).len(), 7);
    assert_eq!(quarter(0.1, false).chords(&KLIPPER, 50.0).len(), 1);
}

#[test]
fn an_arc_to_its_start_is_a_circle() {
    for is_clockwise in [false, true] {
        let arc = Arc { displacement_mm: [0.0, 0.0, 0.0, 2.0], centre_mm: [5.0, 0.0], is_clockwise };
        assert_eq!(arc.chords(&KLIPPER, 50.0).len(), 31);
        assert_eq!(arc.sweep(), if is_clockwise { -TAU } else { TAU });
    }
}

#[test]
fn marlin_s_hints_end_at_rest() {
    let limits = ArcLimits { acceleration_mm_per_s2: 1000.0, speed_mm_per_s: 200.0 };
    let cut = ArcCut::Marlin(MarlinArcs { hints: Some(limits), ..MarlinArcs::default() });
    let hints: Vec<_> = quarter(10.0, false).chords(&cut, 150.0).map(|chord| chord.hint.unwrap()).collect();
    assert_eq!((hints[0].radius_mm, hints[1].radius_mm), (0.0, 10.0));
    // First by a r, then by braking over the rest of the arc.
    assert!((hints[0].safe_exit_mm_per_s - 100.0).abs() < 1e-9);
    assert_eq!(hints[17].safe_exit_mm_per_s, 0.0);
    assert!(hints.windows(2).all(|pair| pair[1].safe_exit_mm_per_s <= pair[0].safe_exit_mm_per_s));
}

proptest! {
    #![proptest_config(cases(256))]

    #[test]
    fn chords_end_on_the_arc_and_make_its_displacement(
        radius in 0.01f64..200.0, from in 0.0f64..TAU, sweep in 0.01f64..6.2,
        is_clockwise in any::<bool>(), z in -1.0f64..1.0, feed in 1.0f64..400.0,
    ) {
        let turned = if is_clockwise { from - sweep } else { from + sweep };
        let [x, y] = [radius * (turned.cos() - from.cos()), radius * (turned.sin() - from.sin())];
        let centre_mm = [-radius * from.cos(), -radius * from.sin()];
        let arc = Arc { displacement_mm: [x, y, z, 3.0], centre_mm, is_clockwise };
        prop_assert!((arc.sweep().abs() - sweep).abs() < 1e-6);
        for cut in [KLIPPER, ArcCut::Marlin(MarlinArcs::default()), ArcCut::Rrf] {
            let mut place = [0.0f64; 4];
            for Chord { displacement_mm, .. } in arc.chords(&cut, feed) {
                place.iter_mut().zip(displacement_mm).for_each(|(place, part)| *place += part);
                let off = (place[0] - centre_mm[0]).hypot(place[1] - centre_mm[1]) - radius;
                prop_assert!(off.abs() < 1e-6 * (1.0 + radius), "{off} mm off the arc");
            }
            for (place, whole) in place.into_iter().zip(arc.displacement_mm) {
                prop_assert!((place - whole).abs() < 1e-9 * (1.0 + radius));
            }
        }
    }
}

#[test]
fn wild_arcs_have_an_end() {
    let huge = Arc { displacement_mm: [1.0, 0.0, 0.0, 0.0], centre_mm: [f64::MAX, 0.0], is_clockwise: true };
    let zero = Arc { displacement_mm: [0.0; 4], centre_mm: [0.0; 2], is_clockwise: false };
    for cut in [KLIPPER, ArcCut::Marlin(MarlinArcs::default()), ArcCut::Rrf] {
        assert!(huge.chords(&cut, 50.0).len() <= 10_000_000);
        assert!(zero.chords(&cut, 50.0).next().is_some());
    }
    let tiny = ArcCut::Klipper { resolution_mm: 0.0 };
    assert!(quarter(10.0, false).chords(&tiny, 50.0).len() <= 10_000_000);
}
