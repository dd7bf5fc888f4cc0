//! Prepared jobs from outside, as one program: each takes long to link.

mod compact;
mod content;
mod framed;
mod header;
mod transfer;
