//! Names of axes.

/// Names of the axes, in the order of their index.
pub const AXIS_NAMES: [char; 4] = ['X', 'Y', 'Z', 'E'];
