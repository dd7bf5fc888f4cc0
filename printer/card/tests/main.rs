//! The card from outside, as one program: each takes long to link.

mod common;
mod damage;
mod files;
mod kept;
