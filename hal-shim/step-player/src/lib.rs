//! The queue of step entries between planner and step interrupt, and the interrupt's code that
//! turns them into edges, without registers.
//!
//! It has two halves. The [`StepFeeder`] belongs to the planner task: it turns entries into *slots*
//! that hold the very words to store to the ports. The [`StepPlayer`] belongs to the step
//! interrupt: at each update of its timer it stores a word a port and, where a stair ends, takes
//! the next slot. The feeder does all work that can be done beforehand, so that an event costs the
//! interrupt the same with one motor or with four.
//!
//! The timer runs all the time and reloads from a preloaded register: a value written at one update
//! sets the gap *after the next one*. A slot therefore holds the reload value of the slot after it,
//! which is written one event early: an interrupt that comes late delays an edge, and all later
//! ones are on time again.
#![cfg_attr(not(test), no_std)]

mod dropped;
mod feeder;
mod held_event;
#[cfg(test)]
mod interrupted_access;
mod link;
mod past;
mod pins;
mod player;
mod replay;
mod shared_word;
mod slot;
mod virtual_timer;

pub use dropped::DroppedSteps;
pub use feeder::{FeedError, MAX_SLOTS_AN_ENTRY, Signals, StepFeeder};
pub use link::StepLink;
pub use past::{Past, PastSlot, PositionMark};
pub use pins::{MotorPins, Pin, PinMap};
pub use player::{
    BothEdges, IDLE_TICKS, MIN_GAP_TICKS, NextWords, OutputPorts, Pulses, StepPlayer, Stepping, UpdateTimer,
};
pub use replay::{MAX_REPLAYED_SLOTS, Replayed, replay};
pub use slot::MAX_EVENTS;
pub use virtual_timer::{CYCLES_A_TICK, VirtualUpdateTimer};

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
