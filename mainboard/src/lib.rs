//! A virtual mainboard: printer boards around an emulated STM32F4 on which the shipped images run unmodified.
//!
//! Nothing here knows the firmware. The chip is rigless's, written from ST's reference manual (RM0090) by others, and what
//! it lacks is in [`chip`]; the parts on the board and the mechanics around it are in [`parts`], from their data sheets; what
//! hangs on which pin is read from the board's file, as a maker would read a wiring plan, in [`wiring`]; what the pins did is
//! decoded and held against the desk's plan in [`decode`]; the host at the other end of the line is in [`host`].

pub mod chip;
pub mod commands;
pub mod conversation;
pub mod decode;
pub mod faults;
pub mod host;
pub mod machine;
pub mod parts;
pub mod pins;
pub mod plant;
pub mod run;
pub mod wiring;
