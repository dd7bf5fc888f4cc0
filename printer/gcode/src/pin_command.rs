//! Commands for a probe whose pin a servo's pulses move (BLTouch).

/// M280, M401, M402, BLTOUCH_DEBUG.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PinCommand {
    /// M401: out, and seen to be.
    Out,
    /// M402: in, and seen to be.
    In,
    /// Any other width of pulses, without a check.
    Pulses {
        /// Microseconds.
        width_us: u16,
    },
}

impl PinCommand {
    /// Widths of the pulses, microseconds: the pin goes out.
    pub const OUT_US: u16 = 650;
    /// The signal follows the pin.
    pub const TOUCH_MODE_US: u16 = 1_165;
    /// The pin goes in.
    pub const IN_US: u16 = 1_475;
    /// The pin goes out and in, again and again.
    pub const SELF_TEST_US: u16 = 1_780;
    /// The alarm ends, the pin goes in.
    pub const RELEASE_US: u16 = 2_190;

    /// Marlin's width at an angle of 0 degrees, microseconds, from which on M280 takes its S for a
    /// width, and at 180 degrees.
    pub const ANGLES_US: [u16; 2] = [544, 2_400];

    /// Width of a servo's pulses at an angle of up to 180 degrees, as Marlin has it, microseconds.
    pub const fn at_angle_us(degrees: u16) -> u16 {
        let [from, to] = Self::ANGLES_US;
        let degrees = if degrees > 180 { 180 } else { degrees };
        from + ((to - from) as u32 * degrees as u32 / 180) as u16
    }
}
