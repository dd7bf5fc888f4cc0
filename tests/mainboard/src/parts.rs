//! The parts around the chip: drivers, motors and axes, switches, heaters, sensors,
//! fans and the supply.
//!
//! All times are virtual nanoseconds from the start of the run (`u64`). A part depends on its
//! inputs and its seed only: the same calls give the same run. A level is a `bool`; `Option<bool>`
//! is a wire that may float, `None` when it does. Parts follow data sheets and physics, never the
//! firmware. Each module lists what it covers and what it leaves out.
//!
//! | module | part |
//! |---|---|
//! | [`tmc2209`] | stepper driver: registers, datagrams, STEP/DIR, StallGuard, faults |
//! | [`wire`] | the drivers' serial line, by bytes (a USART) or by edges (a pin) |
//! | [`motion`] | motors, kinematics, axes between their frame ends, end stops, probe, nozzle and bed |
//! | [`heat`] | heaters with their mass, thermistors |
//! | [`fan`] | rotor and tacho |
//! | [`encoder`] | a sensor that sees filament move |
//! | [`adxl345`] | accelerometer: registers, memory, its end of an SPI bus |
//! | [`bltouch`] | a probe whose pin a servo's pulses move: touches, touch mode, alarm |
//! | [`at24c32`] | EEPROM: pages, write cycles, its end of an I2C bus |
//! | [`sd_card`] | memory card: identification, blocks, busy times, faults |
//! | [`frame`] | the spring between motors and nozzle |
//! | [`supply`] | rails: sag, cut, return |
//! | [`random`] | the seeded generator of all noise |

pub mod adxl345;
pub mod at24c32;
pub mod bltouch;
pub mod encoder;
pub mod fan;
pub mod frame;
pub mod heat;
pub mod motion;
pub mod random;
pub mod sd_card;
pub mod supply;
pub mod tmc2209;
pub mod wire;

#[cfg(test)]
mod tests;
