//! The wide encoding of prepared jobs: the packets of Yu 2019, 84 bytes per block and 12 bytes per
//! command.
//!
//! The desktop tool and the bench image read and write it; a printer's image refuses it
//! ([`ferrostep_gpre::Fault::Wide`]). It reaches planner and printer through their interfaces for
//! motion made elsewhere: [`ferrostep_planner::Request`] with
//! [`ferrostep_planner::Planner::add_given_block`], and [`ferrostep_printer::OtherMotion`].
//!
//! Packets carry no positions. Their limits and corners are checked as far as motor steps reveal
//! them.

mod block;
mod packet;
mod player;
mod reader;
mod step_limits;
#[cfg(feature = "write")]
mod writer;

pub use block::PreparedBlock;
pub use packet::{Packet, STATUS_BYTES, Status, TRAJECTORY_BYTES, Trajectory};
pub use player::PacketPlayer;
pub use reader::{PacketReader, PacketRequest};
#[cfg(feature = "write")]
pub use writer::PacketWriter;
