//! Faults from outside: a campaign brings the printer into each of its states, lets a part fail at
//! a random instant, and compares the outcome with the promises of the documentation.
//!
//! | subject | module |
//! |---|---|
//! | board, image and job | [`bench`] |
//! | runs and their seeds | [`campaign`] |
//! | the states, and a run through all of them that takes snapshots | [`state`] |
//! | faults by name, with their shares | [`fault`] |
//! | how each fault is made to happen | [`inject`] |
//! | the promise for each fault, with its time limit | [`promise`] |
//! | when a run's verdict is certain, and the verdict | [`verdict`] |
//! | a matrix of fault and state, as text, CSV and JSON | [`matrix`] |
//!
//! The seed alone determines a run: fault, state, instant within the state, and details. So every
//! run can be repeated.
//!
//! Left out: a thermistor half out of its hole (no promise, and minutes of time for each run); the
//! NMI of a crystal that stops, which the emulator does not raise; a hang of the idle loop; two
//! independent faults at once; noise on pins other than edges; faults of the card; slow wear. The
//! host's line is the serial one.

pub mod bench;
pub mod campaign;
pub mod command;
pub mod fault;
pub mod host_side;
pub mod image;
pub mod inject;
pub mod matrix;
pub mod promise;
pub mod state;
pub mod verdict;
