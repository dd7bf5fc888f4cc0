//! Gains from what a relay has found.

use super::gains::PidGains;
use super::relay::RelayFindings;

/// Gains of a heater by the findings of a relay at a target, degrees Celsius.
pub fn gains_by_relay(findings: &RelayFindings, target: f32) -> PidGains {
    let RelayFindings { slope_per_power, delay_s, fan_power, .. } = *findings;
    let proportional = 0.6 / (slope_per_power * delay_s);
    PidGains {
        proportional,
        integral: proportional / (5.0 * delay_s),
        derivative: proportional * delay_s,
        fan: fan_power / (target - PidGains::ROOM_CELSIUS).max(1.0),
    }
}
