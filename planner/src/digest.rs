//! Two hashes that show whether two prints made the same steps.

use crate::StepObserver;

const OFFSET: u64 = 0xcbf2_9ce4_8422_2325;
const PRIME: u64 = 0x0000_0100_0000_01b3;
/// A zero byte only multiplies, so a run of them is one multiplication by a power.
const PRIME_2: u64 = PRIME.wrapping_mul(PRIME);
const PRIME_5: u64 = PRIME_2.wrapping_mul(PRIME_2).wrapping_mul(PRIME);

/// FNV-1a-64 over step events.
///
/// `order` is taken over the (axes, directions) bytes of each event, `step` over its whole 12-byte
/// trace record: u64 tick little-endian, kind 0, axes, directions, 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepDigests {
    /// Hash of the motors and directions of all steps, in order.
    pub order: u64,
    /// Hash of the same with times.
    pub step: u64,
}

impl Default for StepDigests {
    fn default() -> Self {
        Self { order: OFFSET, step: OFFSET }
    }
}

impl StepObserver for StepDigests {
    #[inline]
    fn stepped(&mut self, tick: u64, axes: u8, directions: u8) {
        let byte = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(PRIME);
        self.order = byte(byte(self.order, axes), directions);

        let bytes = tick.to_le_bytes();
        let mut step = self.step;
        if tick >> 40 == 0 {
            for &low in &bytes[..4] {
                step = byte(step, low);
            }
            // Byte 4 with its own multiplication, bytes 5 to 7 and the kind with four more.
            step = (step ^ u64::from(bytes[4])).wrapping_mul(PRIME_5);
        } else {
            for each in bytes {
                step = byte(step, each);
            }
            step = byte(step, 0);
        }
        step = byte(step, axes);
        self.step = (step ^ u64::from(directions)).wrapping_mul(PRIME_2);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn fnv(bytes: impl IntoIterator<Item = u8>) -> u64 {
        bytes.into_iter().fold(OFFSET, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(PRIME))
    }

    #[test]
    fn the_published_test_vector_holds() {
        assert_eq!(fnv(*b"foobar"), 0x8594_4171_f739_67e8);
    }

    proptest! {
        #[test]
        fn the_shortcut_for_zero_bytes_changes_nothing(events in proptest::collection::vec((any::<u64>(), 0u32..64, any::<u8>(), any::<u8>()), 0..20)) {
            let mut digests = StepDigests::default();
            let (mut order, mut step) = (Vec::new(), Vec::new());
            for (tick, shift, axes, directions) in events {
                let tick = tick >> shift;
                digests.stepped(tick, axes, directions);
                order.extend([axes, directions]);
                step.extend(tick.to_le_bytes());
                step.extend([0, axes, directions, 0]);
            }
            prop_assert_eq!(digests, StepDigests { order: fnv(order), step: fnv(step) });
        }
    }
}
