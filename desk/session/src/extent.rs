//! The extent of a file: the box of the places where its lines extrude, before any soft limit.

use std::fmt;

use ferrostep_planner::kinematics::UNITS_PER_MM;
use ferrostep_printer::{Ports, Printer};
use serde::Serialize;

use crate::job::Onlooker;

/// Lower and upper ends of a box, mm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Extent {
    /// Ends in X.
    pub x: [f64; 2],
    /// Ends in Y.
    pub y: [f64; 2],
    /// Ends in Z.
    pub z: [f64; 2],
}

impl fmt::Display for Extent {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { x: [x0, x1], y: [y0, y1], z: [z0, z1] } = self;
        write!(out, "X {x0:.1} to {x1:.1}, Y {y0:.1} to {y1:.1}, Z {z0:.1} to {z1:.1} mm")
    }
}

/// Follows the lines of a file and finds its extent.
#[derive(Debug, Default)]
pub struct ExtentFinder {
    ends_10nm: Option<[[i64; 2]; 3]>,
    /// Target of the move that is executed.
    target_10nm: Option<[i64; 3]>,
    /// Target of the newest move, if a soft limit has drawn it in: the next one begins there.
    drawn_in_10nm: Option<[i64; 3]>,
    clamped_moves: u64,
}

impl ExtentFinder {
    /// The extent; `None` where nothing is extruded.
    pub fn extent(&self) -> Option<Extent> {
        let [x, y, z] = self.ends_10nm?.map(|ends| ends.map(|end| end as f64 / UNITS_PER_MM as f64));
        Some(Extent { x, y, z })
    }

    fn take(&mut self, place_10nm: [i64; 3]) {
        let ends = self.ends_10nm.get_or_insert(place_10nm.map(|place| [place, place]));
        for ([lower, upper], place) in ends.iter_mut().zip(place_10nm) {
            (*lower, *upper) = ((*lower).min(place), (*upper).max(place));
        }
    }
}

impl<P: Ports> Onlooker<P> for ExtentFinder {
    fn begins(&mut self, printer: &Printer<'_, P>, _: u32, text: &str) {
        self.target_10nm = None;
        if !text.starts_with(['G', 'g']) {
            return;
        }
        let drawn_in = self.drawn_in_10nm.take();
        let Some(asked) = printer.asked_places(text) else { return };
        self.target_10nm = Some(asked.to_10nm);
        if asked.extrudes {
            let [_, _, z] = asked.to_10nm;
            self.take(drawn_in.unwrap_or(asked.from_10nm));
            self.take(asked.to_10nm);
            if let Some([[left, right], [front, back]]) = asked.reach_10nm {
                self.take([left, front, z]);
                self.take([right, back, z]);
            }
        }
    }

    fn ended(&mut self, printer: &Printer<'_, P>) {
        let clamped_moves = printer.tally().clamped_moves;
        if clamped_moves != self.clamped_moves {
            self.drawn_in_10nm = self.target_10nm;
        }
        self.clamped_moves = clamped_moves;
    }
}
