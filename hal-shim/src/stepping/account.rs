//! What the slots of the ring step, for the accounts after a stop.

/// Steps that were in the queue when motion was stopped: signed by direction, and both directions added.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DroppedSteps {
    /// Forwards minus backwards, a motor each.
    pub signed: [i32; 4],
    /// All, a motor each.
    pub issued: [u32; 4],
}

impl DroppedSteps {
    /// Adds `count` events that step the same.
    pub(super) fn add(&mut self, steps: Steps, count: u32) {
        for (motor, (signed, issued)) in self.signed.iter_mut().zip(&mut self.issued).enumerate() {
            if steps.axes() >> motor & 1 != 0 {
                *issued = issued.wrapping_add(count);
                let backwards = steps.0 >> (motor + 4) & 1 != 0;
                let count = count as i32;
                *signed = signed.wrapping_add(if backwards { count.wrapping_neg() } else { count });
            }
        }
    }
}

/// What an event steps: from bit 0 on its four motors, from bit 4 on their directions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Steps(u32);

impl Steps {
    pub(super) const NONE: Self = Self(0);

    #[inline(always)]
    pub(super) fn new(axes: u8, directions: u8) -> Self {
        Self(u32::from(axes & 15) | u32::from(directions & 15) << 4)
    }

    pub(super) fn axes(self) -> u8 {
        self.0 as u8 & 15
    }
}

/// What a slot steps. A word, for one is written with every slot and hardly any is ever read.
///
/// From bit 0 on the steps of its first event, from bit 8 on those of the others, from bit 16 on the number of events.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlotAccount(u32);

impl SlotAccount {
    /// No events.
    pub const NONE: Self = Self(0);

    /// At most 2^16 events.
    #[inline(always)]
    pub(super) fn new(first: Steps, then: Steps, events: u32) -> Self {
        Self(first.0 | then.0 << 8 | events << 16)
    }

    /// The same, of a slot whose other events step these motors too.
    #[inline(always)]
    pub(super) fn with_axes(self, axes: u8) -> Self {
        Self(self.0 | u32::from(axes) << 8)
    }

    /// The same, of a slot whose first event steps this.
    #[inline(always)]
    pub(super) fn with_first(self, first: Steps) -> Self {
        Self(self.0 | first.0)
    }

    pub(super) fn first(self) -> Steps {
        Steps(self.0 & 0xff)
    }

    pub(super) fn then(self) -> Steps {
        Steps(self.0 >> 8 & 0xff)
    }

    pub(super) fn events(self) -> u32 {
        self.0 >> 16
    }
}
