#![allow(clippy::unwrap_used)]
use super::*;
use ferrostep_planner::{AccelerationProfile, Interpolation};

/// The cartesian machine with these filters.
fn profile(shapers: [AxisShaper; 2]) -> Profile {
    let mut profile = ferrostep_profiles::load("cartesian").unwrap();
    profile.motion.shapers = shapers;
    profile
}

fn shaper(kind: ShaperKind, frequency_hz: f64, damping: f64) -> AxisShaper {
    AxisShaper { kind, frequency_hz, damping }
}

#[test]
fn without_words_the_profile_has_its_filters_and_the_frame_its_own_frequencies() {
    let own = [shaper(ShaperKind::Ei, 55.0, 0.06), AxisShaper::NONE];
    let words = FilterWords { is_compared: true, ..FilterWords::default() };
    let filters = words.of(Some(&profile(own))).unwrap();
    assert_eq!((filters.steps, filters.frame_hz), (own, [50.0, 40.0]));
    let compared = filters.compared.unwrap();
    assert_eq!((compared.kind, compared.frequency_hz, compared.damping), (ComparedKind::Mzv, [50.0, 40.0], [0.1; 2]));
    assert_eq!(FilterWords::default().of(Some(&profile(own))).unwrap().compared, None);
    let moved = FilterWords { frame_hz: [Some(60.0), None], ..words }.of(None).unwrap();
    assert_eq!((moved.frame_hz, moved.compared.unwrap().frequency_hz), ([60.0, 40.0], [60.0, 40.0]));
}

#[test]
fn a_kind_is_for_both_axes_and_both_plans() {
    let words = FilterWords { input_shaper: Some(ShaperKind::Zv), is_compared: true, ..FilterWords::default() };
    let own = [shaper(ShaperKind::Ei, 55.0, 0.06), AxisShaper::NONE];
    let filters = words.of(Some(&profile(own))).unwrap();
    assert_eq!(filters.steps, [shaper(ShaperKind::Zv, 55.0, 0.06), shaper(ShaperKind::Zv, 40.0, 0.1)]);
    let compared = filters.compared.unwrap();
    assert_eq!((compared.kind, compared.frequency_hz, compared.damping), (ComparedKind::Zv, [55.0, 40.0], [0.06, 0.1]));
    // The frame's frequencies are those given, or the usual ones.
    assert_eq!(filters.frame_hz, [50.0, 40.0]);
    let named = FilterWords { frame_hz: [Some(62.0), Some(44.0)], ..words }.of(Some(&profile(own))).unwrap();
    assert_eq!([named.steps[0].frequency_hz, named.steps[1].frequency_hz], [55.0, 44.0]);
    let named = FilterWords { shaper_frequency_hz: Some([61.0, 43.0]), shaper_damping: Some(0.02), ..words };
    let named = named.of(Some(&profile(own))).unwrap();
    assert_eq!(named.steps, [shaper(ShaperKind::Zv, 61.0, 0.02), shaper(ShaperKind::Zv, 43.0, 0.02)]);
    assert_eq!((named.compared.unwrap().frequency_hz, named.frame_hz), ([61.0, 43.0], [50.0, 40.0]));
    let other = FilterWords { compared: Some(ComparedKind::None), ..words }.of(Some(&profile(own))).unwrap();
    assert_eq!((other.compared.unwrap().kind, other.steps[0].kind), (ComparedKind::None, ShaperKind::Zv));
    let none = FilterWords { input_shaper: Some(ShaperKind::None), ..words }.of(Some(&profile(own))).unwrap();
    assert!(!none.steps.iter().any(is_filter));
    assert_eq!(none.compared.unwrap().kind, ComparedKind::None);
}

#[test]
fn detuning_moves_the_frame_and_leaves_the_filters() {
    let words = FilterWords {
        input_shaper: Some(ShaperKind::Mzv),
        shaper_frequency_hz: Some([60.0, 50.0]),
        is_compared: true,
        ..FilterWords::default()
    };
    let plain = profile([AxisShaper::NONE; 2]);
    let straight = words.of(Some(&plain)).unwrap();
    for (percent, expected) in [(-10.0, [54.0, 45.0]), (5.0, [63.0, 52.5]), (0.0, [60.0, 50.0])] {
        let moved = FilterWords { detune_percent: Some(percent), ..words }.of(Some(&plain)).unwrap();
        assert_eq!((moved.steps, moved.compared), (straight.steps, straight.compared));
        for (found, expected) in moved.frame_hz.into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-9, "{percent} {found}");
        }
    }
    // The profile's filters are as good; an axis without a filter goes along.
    let own = profile([shaper(ShaperKind::Zvd, 80.0, 0.1), AxisShaper::NONE]);
    let words = FilterWords { detune_percent: Some(25.0), is_compared: true, ..FilterWords::default() };
    let moved = words.of(Some(&own)).unwrap();
    assert_eq!((moved.frame_hz, moved.compared.unwrap().frequency_hz), ([100.0, 50.0], [80.0, 40.0]));
    // Only the compared plan's are known for a trace.
    assert_eq!(words.of(None).unwrap().frame_hz, [62.5, 50.0]);
}

#[test]
fn words_without_a_meaning_are_refused() {
    let plain = profile([AxisShaper::NONE; 2]);
    let words = FilterWords::default();
    let zv = FilterWords { input_shaper: Some(ShaperKind::Zv), ..words };
    let detuned = FilterWords { detune_percent: Some(5.0), ..words };
    assert_eq!(zv.of(None), Err(FilterError::OfTrace));
    assert_eq!(detuned.of(Some(&plain)), Err(FilterError::NothingToDetune));
    assert_eq!(detuned.of(None), Err(FilterError::NothingToDetune));
    let none = FilterWords { input_shaper: Some(ShaperKind::None), is_compared: true, ..detuned };
    assert_eq!(none.of(Some(&plain)), Err(FilterError::NothingToDetune));
    for percent in [50.1, -51.0] {
        let far = FilterWords { detune_percent: Some(percent), ..zv };
        assert_eq!(far.of(Some(&plain)), Err(FilterError::Detune(percent)));
    }
    let nan = FilterWords { detune_percent: Some(f64::NAN), ..zv };
    assert!(matches!(nan.of(Some(&plain)), Err(FilterError::Detune(_))));
    let twice = FilterWords { frame_hz: [None, Some(40.0)], detune_percent: Some(5.0), ..zv };
    assert_eq!(twice.of(Some(&plain)), Err(FilterError::FrameTwice));
    let own = profile([AxisShaper::NONE, shaper(ShaperKind::Zv, 44.0, 0.1)]);
    let two = FilterWords { is_compared: true, shaper_frequency_hz: Some([50.0, 45.0]), ..detuned };
    assert_eq!(two.of(Some(&own)), Err(FilterError::TwoFrequencies('Y', [44.0, 45.0])));
    let not_klippers = FilterWords { input_shaper: Some(ShaperKind::Zvdd), is_compared: true, ..words };
    assert_eq!(not_klippers.of(Some(&plain)), Err(FilterError::NotKlippers(ShaperKind::Zvdd)));
    let with_another = FilterWords { compared: Some(ComparedKind::Zvd), ..not_klippers };
    assert!(with_another.of(Some(&plain)).is_ok());
    assert!(FilterWords { is_compared: false, ..not_klippers }.of(Some(&plain)).is_ok());
}

#[test]
fn a_filter_that_the_machine_cannot_have_is_refused() {
    let mut other = profile([AxisShaper::NONE; 2]);
    let words = FilterWords { input_shaper: Some(ShaperKind::ThreeHumpEi), ..FilterWords::default() };
    let error = |words: FilterWords, profile: &Profile| words.of(Some(profile)).unwrap_err();
    let with = |frequency_hz: f64, damping| FilterWords {
        shaper_frequency_hz: Some([frequency_hz, 40.0]),
        shaper_damping: Some(damping),
        ..words
    };
    for (frequency_hz, damping, expected) in [
        (4.0, 0.1, "the filter of X is made for 4 Hz, expected 5 to 500 Hz"),
        (50.0, 0.3, "a damping ratio of 0.3, expected 0 to 0.2 for 3hump_ei"),
        (10.0, 0.1, "3hump_ei for 10 Hz, lasts longer than 100 ms, expected at least 19.83 Hz"),
    ] {
        let text = error(with(frequency_hz, damping), &other).to_string();
        assert!(text.contains(expected), "{text}");
    }
    other.motion.acceleration = AccelerationProfile::SCurveTable;
    assert!(error(words, &other).to_string().contains("step-bresenham with s-curve-table, expected"));
    other.motion.acceleration = AccelerationProfile::SCurve;
    assert!(words.of(Some(&other)).is_ok());
    other.motion.interpolation = Interpolation::PointByPoint;
    assert!(matches!(error(words, &other), FilterError::Methods { .. }));
    let none = FilterWords { input_shaper: Some(ShaperKind::None), ..words };
    assert!(none.of(Some(&other)).is_ok());
    let mut corexy = ferrostep_profiles::load("corexy").unwrap();
    assert!(words.of(Some(&corexy)).is_ok());
    corexy.steps_per_mm[1] = profile([AxisShaper::NONE; 2]).steps_per_mm[1];
    let text = error(words, &corexy).to_string();
    assert!(text.contains("different steps/mm"), "{text}");
}
