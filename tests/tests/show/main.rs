//! The page of `ferrostep show`: its values against the steps, bad input, and a browser that loads it.
#![allow(clippy::unwrap_used, clippy::expect_used)]

#[cfg(unix)]
mod browser;
mod comparisons;
mod pages;
mod prints;
mod values;
