//! The motors of a board, by their number.

/// Motors of most machines: X (A), Y (B), Z and E. The further motors of Z follow them.
pub const MOTORS: usize = 4;

/// Z, whose further motors come after those of all axes.
pub(crate) const Z: usize = 2;

/// The most motors: X (A), Y (B), Z, E, the further ones of Z, and the second extruder's.
pub const MOST_MOTORS: usize = NAMES.len();

/// Names of the motors, by their number.
const NAMES: [&str; 8] = ["X", "Y", "Z", "E", "Z2", "Z3", "Z4", "E1"];

/// The second extruder's motor.
pub const SECOND_EXTRUDER: usize = NAMES.len() - 1;

/// The name of a motor's driver.
pub fn motor_name(motor: usize) -> &'static str {
    NAMES.get(motor).copied().unwrap_or("?")
}
