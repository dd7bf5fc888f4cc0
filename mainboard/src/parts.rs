//! What stands around the chip: drivers, motors and axes, switches, heaters, sensors, fans and the supply.
//!
//! Everything here counts virtual nanoseconds from the start of the run (`u64`) and depends on its inputs and its seeds
//! only: the same calls give the same run. A level is a `bool`; where a wire can be left alone it is an `Option<bool>`
//! and `None` is a floating wire. Parts never look at the firmware: they follow data sheets and physics. Each module
//! has a table of what it covers and a list of what it leaves out.
//!
//! | module | part |
//! |---|---|
//! | [`tmc2209`] | stepper driver: registers, datagrams, STEP/DIR, StallGuard, faults |
//! | [`wire`] | the drivers' serial line, by bytes (a USART) or by edges (a pin) |
//! | [`motion`] | motors, kinematics, axes between their frame ends, end stops, probe, nozzle and bed |
//! | [`heat`] | heaters with their mass, thermistors |
//! | [`fan`] | rotor and tacho |
//! | [`supply`] | rails: sag, cut, return |
//! | [`random`] | the seeded generator of all noise |

pub mod fan;
pub mod heat;
pub mod motion;
pub mod random;
pub mod supply;
pub mod tmc2209;
pub mod wire;

#[cfg(test)]
mod tests;
