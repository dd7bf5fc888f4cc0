//! Input shaping: every axis follows the plan through its own filter, which leaves
//! the frame at rest.
//!
//! A shaper ([`AxisShaper`]) gives a [`Kernel`]: weights and delays. The shaped position of an axis
//! is the weighted sum of its planned positions at those delays (Singer and Seering 1990).
//!
//! The extruder's filter spreads the flow as the shapers and the frame together spread the path, so
//! that the filament comes where the nozzle is; its advance ([`crate::PressureAdvance`]) is the
//! mean between two delays.
//!
//! A moving average over some ms may follow in the filters of X, Y, Z and the extruder: it makes
//! the acceleration change gradually.

mod even_spacing;
mod fixed;
mod kernel;
mod machine_filters;
mod motor_states;
mod motor_steps;
mod path_pieces;
mod plan;
mod plan_ring;
mod shapers;
mod smoothing;
mod stepper;
mod taps;

pub use even_spacing::EvenSpacing;
pub use kernel::{Impulse, Kernel, MAX_IMPULSES, MAX_LENGTH_TICKS};
pub use machine_filters::{SMOOTH_TIME_S, Shaping, smooth_ticks};
pub use shapers::{AxisShaper, ShaperError, ShaperKind};

pub(crate) use plan_ring::MOST_IN_FILTER;
pub(crate) use stepper::{ShapedStepper, Standing};
