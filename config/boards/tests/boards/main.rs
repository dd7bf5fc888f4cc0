//! The boards' files, and the refusal of wrong ones.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod book;
mod boot_loader;
mod builtin;
mod fit;
mod refusals;
mod robustness;
