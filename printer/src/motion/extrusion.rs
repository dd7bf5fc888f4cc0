//! Velocity-adaptive extrusion (Wu 2024, eqs. 10 and 11): filament by the length of the path, for
//! G-code without E words.
//!
//! The volume laid along a path of length S, S h b, equals the volume pushed, pi D^2/4 E. So E =
//! lambda S with lambda = 4 h b / (pi D^2). E is planned as in any other move, and the extruder's
//! speed and acceleration are lambda times the nozzle's at every instant.

use crate::settings::profile::filament::ExtrusionSettings;

/// Fraction bits of lambda. At most 509 within the settings' ranges, and at least 6e-8: known to
/// five digits even then.
const LAMBDA_BITS: u32 = 40;

/// Fraction bits of a path's length, beyond 10 nm.
const LENGTH_BITS: u32 = 16;

/// Turns lengths into filament. Rounding loses none: what one move leaves, the next one pushes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AdaptiveExtrusion {
    settings: ExtrusionSettings,
    /// Filament for a length of path, in units of 2^-40.
    lambda: u64,
    /// Filament owed, units of 2^-56 of 0.1 nm; less than 0.1 nm.
    owed: u64,
}

impl AdaptiveExtrusion {
    /// Extrusion by these settings, with no filament owed.
    pub fn new(settings: ExtrusionSettings) -> Self {
        let (h, b, d) = (settings.layer_height_10nm, settings.line_width_10nm, settings.filament_diameter_10nm);
        let lambda = 4.0 * h as f64 * b as f64 / (core::f64::consts::PI * (d as f64 * d as f64));
        Self { settings, lambda: (lambda * (1u64 << LAMBDA_BITS) as f64 + 0.5) as u64, owed: 0 }
    }

    /// Settings in force.
    pub fn settings(&self) -> ExtrusionSettings {
        self.settings
    }

    /// lambda, mm of filament a mm of path.
    pub fn lambda(&self) -> f64 {
        self.lambda as f64 / (1u64 << LAMBDA_BITS) as f64
    }

    /// Filament along a straight path in the plane, units of 0.1 nm, at a flow in percent; and
    /// the state after it.
    ///
    /// Coordinates are at most 5 m from zero: all products fit.
    pub fn along(&self, from_10nm: [i64; 2], to_10nm: [i64; 2], flow_percent: u16) -> (i64, Self) {
        let [x, y] = [0, 1].map(|axis| (to_10nm[axis] - from_10nm[axis]) as f64);
        let length = libm::sqrt(x * x + y * y) * (1u64 << LENGTH_BITS) as f64 + 0.5;
        // A hundredth of the flow is a percent, and a hundredth of 10 nm is the unit.
        let percents = u128::from(self.lambda) * u128::from(length as u64) * u128::from(flow_percent);
        let sum = percents + u128::from(self.owed);
        let bits = LAMBDA_BITS + LENGTH_BITS;
        ((sum >> bits) as i64, Self { owed: (sum & ((1 << bits) - 1)) as u64, ..*self })
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use proptest::prelude::*;

    fn settings(layer_height_10nm: i64, line_width_10nm: i64, filament_diameter_10nm: i64) -> ExtrusionSettings {
        ExtrusionSettings { adaptive: true, layer_height_10nm, line_width_10nm, filament_diameter_10nm }
    }

    #[test]
    fn lambda_is_the_ratio_of_the_sections() {
        let extrusion = AdaptiveExtrusion::new(settings(20_000, 45_000, 175_000));
        // 0.2 mm by 0.45 mm, by the area of a disc of 1.75 mm.
        assert!((extrusion.lambda() - 0.09 / 2.405_281_875).abs() < 1e-9);
        let (filament_100pm, _) = extrusion.along([0, 0], [3_000_000, 4_000_000], 100);
        assert_eq!(filament_100pm, (50.0 * 1e7 * 0.09 / 2.405_281_875_f64) as i64);
    }

    #[test]
    fn the_extremes_fit() {
        for settings in [settings(500_000, 2_000_000, 50_000), settings(1_000, 5_000, 10_000_000)] {
            let extrusion = AdaptiveExtrusion::new(settings);
            let (filament, _) = extrusion.along([-500_000_000; 2], [500_000_000; 2], 999);
            let expected = extrusion.lambda() * 2f64.sqrt() * 1e9 * 999.0;
            assert!((filament as f64 - expected).abs() < 1.0 + 1e-9 * expected, "{filament} {expected}");
        }
    }

    proptest! {
        #[test]
        fn many_short_moves_push_as_much_as_a_long_one(
            ends in proptest::collection::vec(1i64..30, 1..2000), h in 1_000i64..500_000, flow in 1u16..=999,
        ) {
            let whole = AdaptiveExtrusion::new(settings(h, 45_000, 175_000));
            let (mut parts, mut at, mut pushed) = (whole, 0, 0);
            for length in ends {
                let (filament, next) = parts.along([at, 7], [at + length, 7], flow);
                (parts, at, pushed) = (next, at + length, pushed + filament);
            }
            prop_assert_eq!(pushed, whole.along([0, 7], [at, 7], flow).0);
        }
    }
}
