//! The book and the README name files, code and each other; this test finds every name
//! that has gone stale.
//!
//! A failure prints one line for each: the page, the line, the name, and its fault.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod page;
mod references;
mod tree;
