//! The host of the web page: it prints an uploaded file line by line, as `ferrostep send` does, and
//! passes on a person's lines.
//!
//! Two sides share its state: the page's requests, from several threads, which only note wishes,
//! and [`run`], which alone talks with the printer. Only M112 goes past it, straight to the line.

mod driver;
mod job_lines;
mod page_side;
mod readings;
mod shared;
mod watching;

pub use driver::run;
pub use page_side::PageSide;
pub use readings::Readings;
pub use shared::{PageHost, Setup};
