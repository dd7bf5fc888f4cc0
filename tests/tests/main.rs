//! The whole machine at work, with Rust and a C compiler alone: one program, since each takes long
//! to link. What needs programs from outside is in `tests/outside`.

mod bed;
mod card;
mod docs;
mod end_to_end;
mod house;
mod next_tier;
mod overload;
mod serve;
mod show;
mod usb;
