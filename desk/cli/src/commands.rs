//! The subcommands, a file or folder each.

pub mod blackbox;
pub mod calibrate;
pub mod compare;
pub mod estimate;
pub mod import;
pub mod inspect;
pub mod papers;
pub mod ports;
pub mod post_process;
pub mod preprocess;
pub mod print;
pub mod send;
#[cfg(unix)]
pub mod serve;
pub mod show;
pub mod simulate;
pub mod sweep;
