//! The memory card, on boards with a slot.

#[cfg(not(card))]
mod no_slot;
#[cfg(card)]
mod slot;

#[cfg(not(card))]
pub use no_slot::{BoardCard, BoardMailbox, serve, start};
#[cfg(card)]
pub use slot::{BoardCard, BoardMailbox, BoardMailboxLock, CardHosts, serve, start};
