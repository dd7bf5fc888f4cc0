//! Gains from the findings of a relay.

use super::gains::PidGains;
use super::relay::RelayFindings;

/// Proportional gain times slope and delay: about a third of pi / 2, at which a heater with this
/// delay, as an integrator with a delay, would swing endlessly.
const PROPORTIONAL: f32 = 0.5;
/// Integral time, in delays: the integral slowly takes over the power that the proportional
/// part gives at once.
const INTEGRAL_DELAYS: f32 = 5.0;
/// Derivative time, in delays: on the way up at full power the loop takes the power away about a
/// delay before the target.
const DERIVATIVE_DELAYS: f32 = 0.9;

/// The shortest delay that counts, s: that of the loop's own slope filter.
const MIN_DELAY_S: f32 = 0.5;

fn within(gain: f32, [low, high]: [f64; 2]) -> f32 {
    gain.clamp(low as f32, high as f32)
}

/// Gains of a heater by the findings of a relay at a target, degrees Celsius; within their ranges.
pub fn gains_by_relay(findings: &RelayFindings, target: f32) -> PidGains {
    let RelayFindings { slope_per_power, delay_s, fan_power, .. } = *findings;
    let delay_s = delay_s.max(MIN_DELAY_S);
    let proportional = within(PROPORTIONAL / (slope_per_power * delay_s), PidGains::PROPORTIONAL);
    PidGains {
        proportional,
        integral: within(proportional / (INTEGRAL_DELAYS * delay_s), PidGains::INTEGRAL),
        derivative: within(proportional * DERIVATIVE_DELAYS * delay_s, PidGains::DERIVATIVE),
        fan: within(fan_power / (target - PidGains::ROOM_CELSIUS).max(1.0), PidGains::FAN),
    }
}
