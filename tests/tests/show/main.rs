//! The page of `ferrostep show`: its values against the steps, bad input, a browser that loads it, and its pictures.
#![allow(clippy::unwrap_used, clippy::expect_used)]

#[cfg(unix)]
mod browser;
mod comparisons;
mod pages;
#[cfg(unix)]
mod pictures;
mod prints;
mod values;
