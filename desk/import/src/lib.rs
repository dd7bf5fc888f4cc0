//! Makes a profile from another firmware's configuration: Klipper's `printer.cfg`, Marlin's
//! `Configuration.h`, or the reports of a running one.
//!
//! Every setting of the file ends up in a [`Row`]: what the profile keeps of it, or why it has no
//! place there. Keys that a profile needs and the file does not say come from the built-in profile
//! `cartesian` and are named ([`Imported::assumed`]).

mod c_macros;
mod c_tokens;
mod condition;
mod configuration;
mod definitions;
mod draft;
mod effort;
mod error;
mod expression;
mod glob;
mod http;
mod imported;
mod includes;
mod klipper;
mod klipper_map;
mod mark;
mod marlin;
mod marlin_map;
mod marlin_report;
mod moonraker;
mod nearest;
mod paths;
mod rows;
mod sensor;
mod text;

pub use configuration::{of_running_marlin, of_text, of_text_with, read};
pub use error::ImportError;
pub use http::{ApiKey, Url};
pub use imported::{Gap, Imported, Row, place};
pub use includes::Included;
pub use mark::is_untouched;
pub use moonraker::read_moonraker;
