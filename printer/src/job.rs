//! A print's course: the state of the job at hand from line to line, and the parts that pause,
//! change or end it.

pub(crate) mod button;
pub(crate) mod card;
pub(crate) mod change_macros;
pub(crate) mod command_kind;
mod debounce;
pub(crate) mod filament;
pub(crate) mod lines;
pub(crate) mod macros;
pub(crate) mod modes;
pub(crate) mod paused;
pub(crate) mod power_loss;
pub(crate) mod prepared;
pub(crate) mod print;
pub(crate) mod print_clock;
pub(crate) mod tool_box;
pub(crate) mod tower;
