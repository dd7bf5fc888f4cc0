//! Share of their speed that blocks keep when they leave look-ahead.

use crate::block::Speed;

/// A share of the nominal speed, in 1/256.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Pace(u16);

/// No block is slowed below this, 0.01 mm/s in units of [`Speed`], the slowest feed
/// that is planned.
const SLOWEST: Speed = Speed(656);

impl Pace {
    /// All of it.
    pub const FULL: Self = Self(256);

    /// Pace of this many 256ths, from 1 to 256; other numbers become the nearest of these.
    pub const fn from_256ths(pace_256ths: u16) -> Self {
        Self(if pace_256ths == 0 {
            1
        } else if pace_256ths > 256 {
            256
        } else {
            pace_256ths
        })
    }

    /// The share in 1/256.
    pub const fn in_256ths(self) -> u16 {
        self.0
    }

    /// The nominal speed at this pace; not below 0.01 mm/s, unless the speed itself is.
    pub fn of(self, nominal: Speed) -> Speed {
        let share = (u64::from(nominal.0) * u64::from(self.0)) >> 8;
        Speed(share as u32).max(SLOWEST.min(nominal))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_keep_their_range() {
        assert_eq!(Pace::from_256ths(0), Pace::from_256ths(1));
        assert_eq!(Pace::from_256ths(u16::MAX), Pace::FULL);
        assert_eq!(Pace::from_256ths(128).in_256ths(), 128);
        for nominal in [Speed(1), Speed(655), Speed(1_000_000), Speed(u32::MAX)] {
            assert_eq!(Pace::FULL.of(nominal), nominal);
            assert!(Pace::from_256ths(1).of(nominal) <= nominal);
        }
        assert_eq!(Pace::from_256ths(64).of(Speed(1_000_000)), Speed(250_000));
        assert_eq!(Pace::from_256ths(1).of(Speed(1_000_000)), Speed(3_906));
        assert_eq!(Pace::from_256ths(1).of(Speed(10_000)), SLOWEST);
    }
}
