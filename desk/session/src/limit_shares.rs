//! The share of each limit in a job's time.

use ferrostep_rules::{Axis, Limit, PlannedMove};
use serde::Serialize;

use crate::remarks::{Remark, RemarkKind};

/// Time and moves that a limit held down.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LimitShare {
    /// Name of the limit.
    pub limit: &'static str,
    /// Time, s.
    pub seconds: f64,
    /// Moves for most of whose time it held.
    pub moves: u64,
}

/// The rules by which a job was planned, and what they held down.
#[derive(Clone, Debug)]
pub struct RulesReport {
    /// Name of the rules.
    pub name: &'static str,
    /// Time and moves of each limit that held, the longest time first.
    pub limits: Vec<LimitShare>,
}

impl RulesReport {
    /// Leaves only those remarks of this firmware that hold for the other one too: what that one
    /// makes of limits has other remarks.
    pub fn keep(&self, remarks: &mut Vec<Remark>) {
        remarks.retain(|remark| remark.kind != RemarkKind::Corner);
    }
}

/// The shares so far.
///
/// The time at a move's largest speed is that of the limit of this speed. A ramp belongs to the
/// limit at its slower end by the ratio of the two speeds, and for the rest to the acceleration:
/// one that hardly changes the speed is held by the corner, one from rest by the acceleration.
#[derive(Clone, Debug, Default)]
pub(crate) struct Shares {
    rows: Vec<(Limit, f64, u64)>,
    /// The newest move; the limit at its end is that at the start of the next one.
    last: Option<PlannedMove>,
}

/// A move whose limits are all known.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Settled {
    /// The move.
    pub planned: PlannedMove,
    /// The limit of the speed at its end.
    end_limit: Limit,
}

/// Part of a move with constant acceleration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Phase {
    /// Duration of the phase, s.
    pub seconds: f64,
    /// Speeds at its start and its end, mm/s.
    pub speeds_mm_per_s: [f64; 2],
    /// Name of the limit that holds for most of the phase.
    pub limit: &'static str,
}

impl Settled {
    /// The first ramp, the largest speed, the last ramp.
    pub fn phases(&self) -> [Phase; 3] {
        let Self { planned, end_limit } = self;
        let [start, cruise, end] = [planned.start_mm_per_s, planned.cruise_mm_per_s, planned.end_mm_per_s];
        let of_ramp = |slow: f64, limit| if 2.0 * slow > cruise { limit } else { planned.acceleration_limit };
        [
            (planned.accelerate_s, [start, cruise], of_ramp(start, planned.start_limit)),
            (planned.cruise_s, [cruise, cruise], planned.cruise_limit),
            (planned.decelerate_s, [cruise, end], of_ramp(end, *end_limit)),
        ]
        .map(|(seconds, speeds_mm_per_s, limit)| Phase { seconds, speeds_mm_per_s, limit: name(limit) })
    }
}

impl Shares {
    /// Adds a move, after those before it. Returns the one before.
    pub fn add(&mut self, planned: &PlannedMove) -> Option<Settled> {
        let last = self.last.replace(*planned)?;
        Some(self.settle(last, planned.start_limit))
    }

    /// Motion ends here. Returns the last move.
    pub fn rest(&mut self) -> Option<Settled> {
        let last = self.last.take()?;
        Some(self.settle(last, Limit::Rest))
    }

    /// The shares of the moves that have been settled, the longest time first.
    pub fn shares(&self) -> Vec<LimitShare> {
        let mut rows = self.rows.clone();
        rows.sort_by(|(_, one, _), (_, other, _)| other.total_cmp(one));
        rows.into_iter().map(|(limit, seconds, moves)| LimitShare { limit: name(limit), seconds, moves }).collect()
    }

    fn settle(&mut self, planned: PlannedMove, end_limit: Limit) -> Settled {
        let ratio = |slow: f64| if planned.cruise_mm_per_s > 0.0 { slow / planned.cruise_mm_per_s } else { 0.0 };
        let at_start_s = planned.accelerate_s * ratio(planned.start_mm_per_s);
        let at_end_s = planned.decelerate_s * ratio(planned.end_mm_per_s);
        let ramps_s = planned.accelerate_s + planned.decelerate_s - at_start_s - at_end_s;
        let parts = [
            (planned.cruise_limit, planned.cruise_s),
            (planned.acceleration_limit, ramps_s),
            (planned.start_limit, at_start_s),
            (end_limit, at_end_s),
        ];
        let mut most = parts[0];
        for part in parts {
            self.row(part.0).1 += part.1;
            if part.1 > most.1 {
                most = part;
            }
        }
        self.row(most.0).2 += 1;
        Settled { planned, end_limit }
    }

    fn row(&mut self, limit: Limit) -> &mut (Limit, f64, u64) {
        let index = match self.rows.iter().position(|(other, ..)| *other == limit) {
            Some(index) => index,
            None => {
                self.rows.push((limit, 0.0, 0));
                self.rows.len() - 1
            }
        };
        &mut self.rows[index]
    }
}

/// The name of a limit.
fn name(limit: Limit) -> &'static str {
    match limit {
        Limit::AskedSpeed => "asked speed",
        Limit::MachineSpeed => "largest speed",
        Limit::AxisSpeed(Axis::X) => "largest speed of X",
        Limit::AxisSpeed(Axis::Y) => "largest speed of Y",
        Limit::AxisSpeed(Axis::Z) => "largest speed of Z",
        Limit::AxisSpeed(Axis::E) => "largest speed of the filament",
        Limit::Acceleration => "acceleration",
        Limit::AxisAcceleration(Axis::X) => "acceleration of X",
        Limit::AxisAcceleration(Axis::Y) => "acceleration of Y",
        Limit::AxisAcceleration(Axis::Z) => "acceleration of Z",
        Limit::AxisAcceleration(Axis::E) => "acceleration of the filament",
        Limit::Corner => "corner",
        Limit::FilamentCorner => "corner of the filament",
        Limit::ShortMove => "short move",
        Limit::CruiseRatio => "minimum cruise ratio",
        Limit::Rest => "rest",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn planned(speeds: [f64; 3], times: [f64; 3], start_limit: Limit, cruise_limit: Limit) -> PlannedMove {
        PlannedMove {
            tag: 0,
            length_mm: 1.0,
            start_mm_per_s: speeds[0],
            cruise_mm_per_s: speeds[1],
            end_mm_per_s: speeds[2],
            acceleration_mm_per_s2: 1.0,
            accelerate_s: times[0],
            cruise_s: times[1],
            decelerate_s: times[2],
            start_limit,
            cruise_limit,
            acceleration_limit: Limit::Acceleration,
        }
    }

    #[test]
    fn ramps_are_shared_between_corner_and_acceleration() {
        let mut shares = Shares::default();
        shares.add(&planned([0.0, 40.0, 30.0], [2.0, 3.0, 1.0], Limit::Rest, Limit::AskedSpeed));
        shares.add(&planned([30.0, 40.0, 0.0], [1.0, 0.0, 4.0], Limit::Corner, Limit::ShortMove));
        shares.rest();
        let found: Vec<_> = shares.shares().iter().map(|share| (share.limit, share.seconds, share.moves)).collect();
        // Three quarters of the ramps down to the corner's speed and up from it.
        let expected = [("acceleration", 6.5, 1), ("asked speed", 3.0, 1), ("corner", 1.5, 0)];
        assert_eq!(found[..3], expected);
        assert!(found[3..].iter().all(|(_, seconds, moves)| *seconds == 0.0 && *moves == 0), "{found:?}");
    }
}
