//! The board's connections for the profile's demands: sensors, and configurable drivers.

use ferrostep_stm32f4::sensor_lines::SensorPin;
use ferrostep_stm32f4_board::board::Store;

include!(concat!(env!("OUT_DIR"), "/sensors.rs"));
include!(concat!(env!("OUT_DIR"), "/drivers.rs"));
