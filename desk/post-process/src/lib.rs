//! Writes the time of a print into its G-code, where slicers and hosts read it.
//!
//! A file is read twice. The first time [`PrintTimes`] executes it on a machine that only plans,
//! and notes when the motion of each line ends. The second time [`rewrite`] copies it line by line
//! and puts these times in place of the slicer's: in comments, and in the words of M73. Everything
//! else stays byte for byte, and no step changes, since both are text to a printer. In binary
//! G-code the blocks with such times are written anew, compressed and encoded as they were.

mod binary;
mod lines;
mod moment;
mod print_times;
mod progress_line;
mod rewrite;
mod run;

pub use moment::Moment;
pub use print_times::PrintTimes;
pub use rewrite::{Additions, Changes, RewriteError, rewrite};
pub use run::{Failure, Options, Report, post_process};
