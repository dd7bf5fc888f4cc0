#![allow(clippy::unwrap_used)]

use super::*;
use proptest::prelude::*;

/// Damping ratio that the tables are for.
const DAMPING: f64 = 0.1;

fn weights(kind: ShaperKind) -> Vec<f64> {
    Shaper::new(kind, 40.0, DAMPING).unwrap().impulses().iter().map(|one| one.weight).collect()
}

fn near(values: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(values.len(), expected.len());
    for (value, expected) in values.iter().zip(expected) {
        assert!((value - expected).abs() <= tolerance, "{values:?} instead of {expected}");
    }
}

#[test]
fn weights_at_a_damping_of_a_tenth() {
    near(&weights(ShaperKind::Zv), &[0.578, 0.422], 0.0006);
    near(&weights(ShaperKind::Mzv), &[0.365, 0.408, 0.227], 0.0006);
    near(&weights(ShaperKind::EiOld), &[0.351, 0.463, 0.187], 0.0006);
    near(&weights(ShaperKind::Ei), &[0.355, 0.453, 0.192], 0.0006);
    near(&weights(ShaperKind::Zvd), &[0.334, 0.488, 0.178], 0.0006);
    near(&weights(ShaperKind::TwoHumpEi), &[0.259, 0.360, 0.273, 0.109], 0.0006);
    near(&weights(ShaperKind::ThreeHumpEi), &[0.221, 0.277, 0.260, 0.167, 0.075], 0.0006);
}

/// Returns the worst residual of modes with damping 0.05, 0.1 and 0.15 at a multiple of the
/// shaper's frequency.
fn worst_residual(kind: ShaperKind, ratio: f64) -> f64 {
    let shaper = Shaper::new(kind, 40.0, DAMPING).unwrap();
    [0.05, 0.1, 0.15].into_iter().map(|damping| shaper.residual(40.0 * ratio, damping)).fold(0.0, f64::max)
}

#[test]
fn residuals_beside_the_frequency() {
    // Rows: residuals at .8, .9, 1, 1.1, 1.2, 2 and 3 times the frequency, from another program.
    let table: [(ShaperKind, [f64; 7], f64); 7] = [
        (ShaperKind::Zv, [0.30, 0.160, 0.072, 0.161, 0.29, 0.84, 0.28], 0.0616),
        (ShaperKind::Mzv, [0.22, 0.107, 0.043, 0.083, 0.13, 0.33, 0.57], 0.0815),
        (ShaperKind::Zvd, [0.087, 0.026, 0.005, 0.026, 0.084, 0.71, 0.08], 0.123),
        (ShaperKind::EiOld, [0.060, 0.037, 0.047, 0.030, 0.052, 0.71, 0.10], 0.129),
        (ShaperKind::Ei, [0.043, 0.046, 0.065, 0.049, 0.051, 0.71, 0.10], 0.132),
        (ShaperKind::TwoHumpEi, [0.064, 0.049, 0.025, 0.051, 0.072, 0.60, 0.06], 0.227),
        (ShaperKind::ThreeHumpEi, [0.025, 0.056, 0.072, 0.053, 0.035, 0.50, 0.05], 0.362),
    ];
    for (kind, residuals, variance) in table {
        let shaper = Shaper::new(kind, 40.0, DAMPING).unwrap();
        assert!((shaper.variance_s2() * 1600.0 - variance).abs() <= 0.001, "{kind}: {}", shaper.variance_s2() * 1600.0);
        for (ratio, expected) in [0.8, 0.9, 1.0, 1.1, 1.2, 2.0, 3.0].into_iter().zip(residuals) {
            let residual = worst_residual(kind, ratio);
            // The table's values have two or three digits.
            let digits = if (0.85..1.15).contains(&ratio) { 0.0011 } else { 0.006 };
            assert!((residual - expected).abs() <= digits, "{kind} at {ratio}: {residual} instead of {expected}");
        }
    }
}

#[test]
fn three_impulses_over_three_quarters_of_a_period_are_mzv() {
    let even = ShaperKind::EvenMzv(EvenSpacing::new(3, 0.75).unwrap());
    for damping in [0.0, 0.06, 0.3] {
        let (even, mzv) =
            (Shaper::new(even, 37.0, damping).unwrap(), Shaper::new(ShaperKind::Mzv, 37.0, damping).unwrap());
        for (one, other) in even.impulses().iter().zip(mzv.impulses()) {
            assert!((one.weight - other.weight).abs() < 1e-12 && (one.delay_s - other.delay_s).abs() < 1e-12);
        }
    }
}

#[test]
fn evenly_spaced_impulses_have_their_zeros_or_are_refused() {
    for (count, periods) in [(4, 0.8), (5, 0.9), (5, 1.0), (6, 1.2)] {
        let spacing = EvenSpacing::new(count, periods).unwrap();
        let shaper = Shaper::new(ShaperKind::EvenMzv(spacing), 50.0, 0.0).unwrap();
        let tau = periods * (count as f64 - 2.0) / (count as f64 - 2.0 * periods - 1.0);
        for zero in 0..count - 1 {
            let residual = shaper.residual(50.0 * (1.0 + zero as f64 / tau), 0.0);
            assert!(residual < 1e-9, "{count} {periods} zero {zero}: {residual}");
        }
    }
    assert_eq!(EvenSpacing::new(2, 0.5), Err(even_spacing::EvenSpacingError::Count(2)));
    assert!(matches!(EvenSpacing::new(3, 1.0), Err(even_spacing::EvenSpacingError::Length { .. })));
    assert!(matches!(EvenSpacing::new(4, f64::NAN), Err(even_spacing::EvenSpacingError::Length { .. })));
    assert_eq!(EvenSpacing::new(3, 0.2), Err(even_spacing::EvenSpacingError::Negative));
}

#[test]
fn the_forms_without_fitted_damping_are_those_with_it_when_there_is_none() {
    let pairs = [
        (ShaperKind::EiOld, ShaperKind::Ei),
        (ShaperKind::TwoHumpEiOld, ShaperKind::TwoHumpEi),
        (ShaperKind::ThreeHumpEiOld, ShaperKind::ThreeHumpEi),
    ];
    for (old, new) in pairs {
        let (old, new) = (Shaper::new(old, 60.0, 0.0).unwrap(), Shaper::new(new, 60.0, 0.0).unwrap());
        for (one, other) in old.impulses().iter().zip(new.impulses()) {
            assert!((one.weight - other.weight).abs() < 0.003, "{old:?} {new:?}");
            assert!((one.delay_s - other.delay_s).abs() * 60.0 < 0.003, "{old:?} {new:?}");
        }
    }
}

#[test]
fn wrong_numbers_are_refused_by_name() {
    assert_eq!(Shaper::new(ShaperKind::Zv, 0.5, 0.1), Err(ShaperError::Frequency(0.5)));
    assert!(matches!(Shaper::new(ShaperKind::Zv, f64::NAN, 0.1), Err(ShaperError::Frequency(_))));
    let error = Shaper::new(ShaperKind::ThreeHumpEi, 50.0, 0.25).unwrap_err();
    assert_eq!(error.to_string(), "the shaper's damping ratio is 0.25, expected 0 to 0.2 for this shaper");
    assert!(Shaper::new(ShaperKind::Zvd, 50.0, -0.01).is_err());
    assert!(Shaper::new(ShaperKind::Zvd, 50.0, f64::NAN).is_err());
}

#[test]
fn names_are_read_back() {
    for kind in ShaperKind::ALL {
        assert_eq!(kind.to_string().parse(), Ok(kind));
        assert_eq!(kind.to_string().to_uppercase().parse(), Ok(kind));
    }
    assert_eq!("mzv(5, 0.9)".parse(), Ok(ShaperKind::EvenMzv(EvenSpacing::new(5, 0.9).unwrap())));
    for wrong in ["", "mzv(3", "mzv(3)", "mzv(9,99)", "zw"] {
        assert!(wrong.parse::<ShaperKind>().is_err(), "{wrong}");
    }
}

fn any_kind() -> impl Strategy<Value = ShaperKind> {
    prop::sample::select(ShaperKind::ALL.to_vec())
}

proptest! {
    #[test]
    fn weights_are_positive_and_sum_to_one(kind in any_kind(), hz in 1.0f64..1000.0, part in 0.0f64..1.0) {
        let damping = part * kind.max_damping();
        let shaper = Shaper::new(kind, hz, damping).unwrap();
        let sum: f64 = shaper.impulses().iter().map(|one| one.weight).sum();
        prop_assert!((sum - 1.0).abs() < 1e-12);
        prop_assert!(shaper.impulses().windows(2).all(|pair| pair[0].delay_s < pair[1].delay_s));
        // Weights of the fitted shapers become negative only near the end of the fitted range.
        if part < 0.9 {
            prop_assert!(shaper.impulses().iter().all(|one| one.weight > 0.0), "{:?}", shaper);
        }
        prop_assert!(shaper.centred().centroid_s().abs() < 1e-12);
    }

    #[test]
    fn zero_vibration_is_zero_at_any_damping(hz in 1.0f64..1000.0, damping in 0.0f64..0.95) {
        for kind in [ShaperKind::Zv, ShaperKind::Mzv, ShaperKind::Zvd, ShaperKind::Zvdd] {
            prop_assert!(Shaper::new(kind, hz, damping).unwrap().residual(hz, damping) < 1e-12);
        }
    }

    #[test]
    fn any_bytes_name_a_shaper_or_are_refused(text in ".{0,20}") {
        let _ = text.parse::<ShaperKind>();
    }
}
