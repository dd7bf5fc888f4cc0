//! The gains of a heater's control loop, and their ranges.

/// The gains of a heater's PID loop; power is 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PidGains {
    /// Power per degree.
    pub proportional: f32,
    /// Power per degree and second.
    pub integral: f32,
    /// Power seconds per degree.
    pub derivative: f32,
    /// Cooling by the part-cooling fan at full power: power per degree between the target and
    /// [`Self::ROOM_CELSIUS`].
    pub fan: f32,
}

impl PidGains {
    /// The room's temperature as the fan's gain counts it, degrees Celsius.
    pub const ROOM_CELSIUS: f32 = 25.0;
    /// Smallest and largest proportional gain.
    pub const PROPORTIONAL: [f64; 2] = [0.000_1, 10.0];
    /// Smallest and largest integral gain.
    pub const INTEGRAL: [f64; 2] = [0.0, 10.0];
    /// Smallest and largest derivative gain.
    pub const DERIVATIVE: [f64; 2] = [0.0, 100.0];
    /// Smallest and largest gain of the fan: at most full power at 125 degrees.
    pub const FAN: [f64; 2] = [0.0, 0.01];
}
