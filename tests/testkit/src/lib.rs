//! Parts that tests of the whole machine share: a board in virtual time, hostile input, the command
//! and its served printer.
//!
//! [`board_model`] runs the crates under test as the firmware does, at any speed of host and
//! processor. [`live_machine`] makes hostile conversations with it of any bytes. [`stress_file`]
//! writes a demanding print, [`feed_chart`] draws the result. [`host_side`] numbers a host's lines
//! and receives its bytes. [`program`] is the `ferrostep` command, [`served`] its printer with
//! hosts and page, [`shown`] its pages of prints; [`slicers`] reads the printers for slicers;
//! [`chromium`] is the browser, [`python`] runs the hosts and the browser of `tests/hosts/`.
//! [`stored_settings`] switches a machine on with any bytes in its memory. [`step_edges`] plays a
//! trace on the step interrupt's model at its latest. [`boards`] has the boards as their makers
//! describe them. [`against_klipper`] measures the book's tables. The crate `ferrostep-oracle`
//! judges the results.
#![deny(missing_docs)]
#![forbid(unsafe_code)]

pub mod against_klipper;
pub mod board_model;
pub mod boards;
pub mod chromium;
pub mod feed_chart;
pub mod hand_made;
pub mod host_side;
pub mod hostile;
pub mod live_machine;
pub mod program;
pub mod python;
#[cfg(unix)]
pub mod served;
pub mod shown;
pub mod slicers;
pub mod step_edges;
pub mod stored_settings;
pub mod stress_file;
