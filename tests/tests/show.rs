//! The page of `ferrostep show`: its values against the steps, and bad input. A browser loads it in
//! `tests/outside`.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod comparisons;
mod kinds;
mod pages;
mod rest;
mod rules;
mod values;
