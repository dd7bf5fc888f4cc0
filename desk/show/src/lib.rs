//! One self-contained page that shows a print as it is executed: the path in space, coloured by
//! what the steps do.
//!
//! [`Recorder`] takes the steps as they are made, the ends of moves, waits and temperatures, and
//! keeps [`Node`]s of the path: few where the motion is even, more where it changes. [`SourceText`]
//! reads what slicers say in comments. [`write_page`] puts the page together: data in columns,
//! deflated, and the page's own programs (`desk/show/page/`), which fetch nothing.

mod columns;
mod commanded;
mod comment_reader;
mod comparison;
mod findings;
mod layers;
mod lines;
mod marks;
mod motor;
mod node;
mod page;
mod path;
mod pieces;
mod recorder;
mod reduce;
mod rest;
mod sampler;
mod source;
mod speeds;
mod surface;
mod temperatures;
mod times;
mod totals;

pub use commanded::PlannedMove;
pub use comment_reader::CommentReader;
pub use comparison::{Row, write_comparison};
pub use findings::{Finding, Outcome, Remarked, Weight};
pub use lines::LineState;
pub use marks::{Mark, Marks};
pub use node::{Kind, Node};
pub use page::{Job, LimitTime, RulesShown, Sources, write_page};
pub use recorder::{ExecutedMove, Machine, Phase, Recorder, Recording};
pub use rest::{Rest, RestState};
pub use source::{Marked, SourceText, Text};
pub use surface::Surface;
pub use temperatures::{Chamber, Temperature};
pub use times::{SlicerTime, TimeOf, slicer_times};
pub use totals::{Extreme, Totals};
