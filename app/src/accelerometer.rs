//! The accelerometer, on boards with a connector for one.

#[cfg(not(accelerometer))]
mod no_plug;
#[cfg(accelerometer)]
mod plug;

#[cfg(not(accelerometer))]
pub use no_plug::{BoardRecorder, recorder};
#[cfg(accelerometer)]
pub use plug::{BoardAccelerometer, BoardRecorder, MAX_LINES, recorder, send_line};
