//! Shapers against the simulator's, which are written by themselves, and what they leave of a
//! mode's vibration.
#![allow(clippy::unwrap_used)]

use std::fmt::Write as _;
use std::path::Path;

use ferrostep_checked_toml::book;
use ferrostep_planner::shaping::{Kernel, MAX_LENGTH_TICKS};
use ferrostep_planner::{AxisShaper, EvenSpacing, ShaperError, ShaperKind, TICKS_PER_SECOND};
use ferrostep_simulator::shapers::{Shaper as Reference, ShaperKind as ReferenceKind};
use proptest::prelude::*;

/// The simulator's kind of the same name.
fn reference(kind: ShaperKind) -> ReferenceKind {
    kind.to_string().parse().unwrap()
}

/// All kinds, and some of the numbers that MZV takes.
fn kinds() -> [ShaperKind; 12] {
    let even = |impulses, period_thousandths| ShaperKind::EvenMzv(EvenSpacing { impulses, period_thousandths });
    let mut kinds = [even(3, 600), even(4, 1100), even(5, 900)].into_iter();
    std::array::from_fn(|index| match ShaperKind::NAMED.get(index) {
        Some((_, kind)) => *kind,
        None => kinds.next().unwrap(),
    })
}

/// Compares a shaper with the simulator's.
fn compare(shaper: &AxisShaper) {
    let ticks_per_second = f64::from(TICKS_PER_SECOND);
    let reference = Reference::new(reference(shaper.kind), shaper.frequency_hz, shaper.damping).unwrap();
    let kernel = match shaper.kernel() {
        Ok(kernel) => kernel,
        Err(error) => {
            assert!(matches!(error, ShaperError::TooLong { .. }), "{shaper:?}");
            let length_ticks = reference.length_s() * ticks_per_second;
            assert!(length_ticks > f64::from(MAX_LENGTH_TICKS) - 1.0, "{shaper:?}: {length_ticks}");
            return;
        }
    };
    assert_eq!(kernel.impulses().len(), reference.impulses().len(), "{shaper:?}");
    for (one, other) in kernel.impulses().iter().zip(reference.impulses()) {
        assert!((one.weight - other.weight).abs() < 1e-8, "{shaper:?}: {one:?}, {other:?}");
        let delay_ticks = other.delay_s * ticks_per_second;
        assert!((f64::from(one.delay_ticks) - delay_ticks).abs() <= 1.0, "{shaper:?}: {one:?}, {delay_ticks}");
    }
    assert!((kernel.centroid_ticks() - reference.centroid_s() * ticks_per_second).abs() <= 1.0, "{shaper:?}");
}

/// A filter that is as long as the longest is taken, alone and beside a moving average.
#[test]
fn the_longest_filter_is_taken_and_one_a_tick_longer_is_not() {
    for kind in kinds() {
        let shaper = AxisShaper { kind, frequency_hz: 100.0, damping: 0.05 };
        let left_ticks = MAX_LENGTH_TICKS - shaper.kernel().unwrap().length_ticks();
        assert!(shaper.kernel_beside(left_ticks).is_ok(), "{kind:?}");
        assert!(
            kind == ShaperKind::None
                || matches!(shaper.kernel_beside(left_ticks + 1), Err(ShaperError::TooLong { is_smooth: true, .. })),
            "{kind:?}"
        );
    }
}

// ANCHOR: every_kind
#[test]
fn shapers_are_the_simulators_at_the_ends_of_their_ranges() {
    for kind in kinds() {
        for frequency_hz in [5.0, 7.5, 10.0, 20.0, 40.0, 99.9, 250.0, 500.0] {
            for part in [0.0, 1e-6, 0.05, 0.25, 0.5, 1.0] {
                compare(&AxisShaper { kind, frequency_hz, damping: part * kind.max_damping() });
            }
        }
    }
}
// ANCHOR_END: every_kind

proptest! {
    #[test]
    fn shapers_are_the_simulators(
        kind in prop::sample::select(kinds().to_vec()),
        frequency_hz in 5.0..=500.0_f64,
        part in 0.0..=1.0_f64,
    ) {
        compare(&AxisShaper { kind, frequency_hz, damping: part * kind.max_damping() });
    }
}

/// Every number of impulses and every length to a hundredth of a period: here is what the simulator
/// finds by least squares, and what it refuses is refused.
#[test]
fn mzv_of_any_number_and_length_is_the_simulators() {
    let mut made = 0;
    for impulses in 0..=7 {
        for period_thousandths in (0..=3000).step_by(10) {
            let kind = ShaperKind::EvenMzv(EvenSpacing { impulses, period_thousandths });
            let shaper = AxisShaper { kind, frequency_hz: 60.0, damping: 0.1 };
            let name = kind.to_string();
            assert_eq!(ShaperKind::from_name(&name), Some(kind));
            if impulses <= 5 && name.parse::<ReferenceKind>().is_ok() {
                compare(&shaper);
                made += 1;
            } else {
                assert_eq!(shaper.kernel(), Err(ShaperError::Spacing), "{name}");
            }
        }
    }
    assert!(made > 200, "{made}");
}

#[test]
fn names_of_mzv_have_their_numbers_in_several_ways() {
    let of = |impulses, period_thousandths| Some(ShaperKind::EvenMzv(EvenSpacing { impulses, period_thousandths }));
    for (name, kind) in [
        ("mzv(5,0.9)", of(5, 900)),
        ("MZV(n=6,t=.9)", of(6, 900)),
        ("mzv(n=5,t=.9)", of(5, 900)),
        ("mzv(4,1.)", of(4, 1000)),
        ("mzv(4,1)", of(4, 1000)),
        ("mzv(4.0,1)", of(4, 1000)),
        ("mzv(4)", None),
        ("mzv(4.5,1)", None),
        ("mzv(5,1.1.1)", None),
        ("mzv(,1)", None),
        ("mzv(5,0.9000)", None),
        ("mzv(5,0.9001)", None),
        ("mzv(5,66)", None),
        ("mzv(5,-1)", None),
        ("mzv(5,0.9,1)", None),
        ("mzv(5,q=1)", None),
        ("mzv()", None),
        ("mzv(5,.)", None),
        ("mzv(5,0.9", None),
        ("zvd(5,0.9)", None),
        ("mzv(256,1)", None),
        ("", None),
    ] {
        assert_eq!(ShaperKind::from_name(name), kind, "{name}");
    }
}

#[test]
fn the_ends_of_the_ranges_are_the_simulators() {
    for kind in kinds() {
        assert_eq!(kind.max_damping(), reference(kind).max_damping(), "{kind:?}");
        if kind == ShaperKind::None {
            continue;
        }
        let made = |frequency_hz, damping| AxisShaper { kind, frequency_hz, damping }.kernel().map(|_| ());
        assert_eq!(made(500.1, 0.1), Err(ShaperError::Frequency));
        assert_eq!(made(4.999, 0.1), Err(ShaperError::Frequency));
        assert_eq!(made(f64::NAN, 0.1), Err(ShaperError::Frequency));
        assert_eq!(made(50.0, -1e-9), Err(ShaperError::Damping));
        assert_eq!(made(50.0, f64::NAN), Err(ShaperError::Damping));
        assert_eq!(made(200.0, kind.max_damping()), Ok(()));
        assert_eq!(made(200.0, kind.max_damping() + 1e-9), Err(ShaperError::Damping));
    }
}

/// The frequency that refusals name is taken, and hardly lower ones are not.
#[test]
fn the_lowest_frequency_is_taken() {
    for kind in kinds() {
        for part in [0.0, 0.1, 0.3, 1.0] {
            let shaper = AxisShaper { kind, frequency_hz: 100.0, damping: kind.max_damping() * part };
            let lowest_hz = shaper.lowest_frequency_hz(0);
            let at = |frequency_hz| AxisShaper { frequency_hz, ..shaper }.kernel();
            assert!(at(lowest_hz).is_ok(), "{shaper:?} {lowest_hz}");
            assert!(kind == ShaperKind::None || at(lowest_hz - 0.02).is_err(), "{shaper:?} {lowest_hz}");
        }
    }
}

/// An image's profile is compiled from this expression.
#[test]
fn a_shaper_is_printed_as_an_expression() {
    let printed = format!("{:?}", [AxisShaper::NONE, AxisShaper { kind: ShaperKind::TwoHumpEi, ..AxisShaper::NONE }]);
    let expected = "[AxisShaper { kind: ShaperKind::None, frequency_hz: 40.0, damping: 0.1 }, \
                    AxisShaper { kind: ShaperKind::TwoHumpEi, frequency_hz: 40.0, damping: 0.1 }]";
    assert_eq!(printed, expected);
}

/// Frequency and damping that the page's shapers are made for.
const FREQUENCY_HZ: f64 = 40.0;
const DAMPING: f64 = 0.1;

/// Vibration after a kernel's last impulse against that after the unshaped command, of a mode with
/// this frequency and damping.
fn residual(kernel: &Kernel, frequency_hz: f64, damping: f64) -> f64 {
    let omega = std::f64::consts::TAU * frequency_hz;
    let damped = omega * (1.0 - damping * damping).sqrt();
    let seconds = |ticks: u32| f64::from(ticks) / f64::from(TICKS_PER_SECOND);
    let end_s = seconds(kernel.length_ticks());
    let (mut sine, mut cosine) = (0.0, 0.0);
    for one in kernel.impulses() {
        let left_s = end_s - seconds(one.delay_ticks);
        let swing = one.weight * (-damping * omega * left_s).exp();
        sine += swing * (damped * left_s).sin();
        cosine += swing * (damped * left_s).cos();
    }
    sine.hypot(cosine)
}

#[test]
fn the_books_table_of_shapers_is_current() {
    let mut page =
        "| kind | ends later by, periods | corner is rounded by, a/f² | 0.8 f | 0.9 f | f | 1.1 f | 1.2 f | lowest \
                    frequency, Hz |\n|---|---|---|---|---|---|---|---|---|\n"
            .to_owned();
    let example = ShaperKind::from_name("mzv(5,1.1)").unwrap();
    for kind in ShaperKind::NAMED.map(|(_, kind)| kind).into_iter().skip(1).chain([example]) {
        let shaper = AxisShaper { kind, frequency_hz: FREQUENCY_HZ, damping: DAMPING };
        let kernel = shaper.kernel().unwrap();
        let periods = |ticks: f64| ticks * FREQUENCY_HZ / f64::from(TICKS_PER_SECOND);
        let centroid = kernel.centroid_ticks();
        let variance: f64 = kernel
            .impulses()
            .iter()
            .map(|one| one.weight * periods(f64::from(one.delay_ticks) - centroid).powi(2))
            .sum();
        write!(page, "| `{kind}` | {:.2} | {:.3}", periods(kernel.length_ticks().into()), variance / 2.0).unwrap();
        for part in [0.8, 0.9, 1.0, 1.1, 1.2] {
            let worst = [0.05, 0.1, 0.15]
                .into_iter()
                .map(|damping| residual(&kernel, FREQUENCY_HZ * part, damping))
                .fold(0.0, f64::max);
            write!(page, " | {:.1} %", worst * 100.0).unwrap();
        }
        writeln!(page, " | {:.2} |", shaper.lowest_frequency_hz(0)).unwrap();
    }
    book::keep(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/src/input-shaping.md"), "kinds", &page).unwrap();
}
