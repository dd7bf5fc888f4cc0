//! A card whose task runs whenever the printer accesses the mailbox: for the desk, which has no
//! tasks.

use core::cell::RefCell;

use ferrostep_hal_shim::card::CardSlot;

use crate::mailbox::{CardPort, Mailbox};
use crate::server::CardServer;

/// A mailbox with its server.
pub struct LocalCard<S: CardSlot>(RefCell<(Mailbox, CardServer<S>)>);

impl<S: CardSlot> LocalCard<S> {
    /// A mailbox and a server of a slot.
    pub fn new(slot: S) -> Self {
        Self(RefCell::new((Mailbox::new(), CardServer::new(slot))))
    }

    /// Calls `act` with the slot.
    pub fn with_slot<T>(&self, act: impl FnOnce(&S) -> T) -> T {
        self.0.borrow().1.with_slot(act)
    }
}

impl<S: CardSlot> CardPort for LocalCard<S> {
    fn with(&self, act: &mut dyn FnMut(&mut Mailbox)) {
        let (mailbox, server) = &mut *self.0.borrow_mut();
        act(mailbox);
        while server.serve(mailbox) {}
    }
}
