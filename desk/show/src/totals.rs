//! Sums up the time of a print, and finds its extremes, before nodes are left out.

use serde::Serialize;

use crate::node::{Kind, Node};

/// Maximum number of features that are counted apart.
pub(crate) const MAX_FEATURES: usize = 64;

/// The largest of something, and where.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Extreme {
    /// The value.
    pub value: f64,
    /// Time, s.
    pub time_s: f64,
    /// Number of the line.
    pub line: u32,
}

impl Extreme {
    fn note(&mut self, value: f64, node: &Node) {
        if value > self.value {
            *self = Self { value, time_s: node.time_s, line: node.line };
        }
    }
}

/// Times and paths of one kind of motion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Share {
    /// s.
    pub time_s: f64,
    /// mm.
    pub path_mm: f64,
    /// mm^3.
    pub volume_mm3: f64,
}

/// Sums of a print's time.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Totals {
    /// Shares by [`Kind`].
    pub kinds: [Share; 7],
    /// Printing, by the number of the feature.
    pub features: Vec<Share>,
    /// Time of parts of moves that change their speed by more than a tenth of the asked
    /// one within them, s.
    pub changing_s: f64,
    /// Time that moves take longer than at the speed that their lines ask for, s: while speeds
    /// change, at corners, and by limits.
    pub slower_s: f64,
    /// Number of retractions.
    pub retractions: u64,
    /// The first retraction, mm.
    pub first_retraction: Extreme,
    /// The longest retraction, mm.
    pub longest_retraction: Extreme,
    /// The first move that was slowed because the board could not keep up with it; its value is 1.
    pub first_slowed: Extreme,
    /// Time of the moves that were slowed, s.
    pub slowed_s: f64,
    /// Greatest distance of printing from the path that the lines ask for, mm.
    pub greatest_deviation: Extreme,
    /// Maximum number of retractions in one layer, and the layer, from 0.
    pub most_retractions: (u64, u32),
    /// Time at which the part begins, after a line that primes the nozzle, s.
    pub part_start_s: f64,
    /// Retractions in the present layer.
    #[serde(skip)]
    in_layer: (u64, u32),
    /// Extremes since the last printing: of the way to the parking place, if nothing
    /// more is printed.
    #[serde(skip)]
    since_print: Aside,
    /// Fastest printing, mm/s.
    pub fastest_print: Extreme,
    /// Fastest travel, mm/s.
    pub fastest_travel: Extreme,
    /// Greatest flow into the nozzle while printing, mm^3/s.
    pub greatest_flow: Extreme,
    /// Greatest compressed volume, mm^3.
    pub greatest_pressure: Extreme,
    /// Longest travel without a break, mm.
    pub longest_travel: Extreme,
    /// Longest wait that is not for a heater, s.
    pub longest_wait: Extreme,
    /// Path of the present travel, mm.
    #[serde(skip)]
    travel_mm: f64,
    /// Time of the present wait, s.
    #[serde(skip)]
    wait_s: f64,
}

/// Extremes of motion that does not print.
#[derive(Clone, Copy, Debug, Default)]
struct Aside {
    longest_retraction: Extreme,
    longest_travel: Extreme,
    fastest_travel: Extreme,
}

impl Totals {
    /// Leaves the lines printed so far out of the extremes: it was no part, but a line that
    /// primes the nozzle.
    pub(crate) fn begin_part(&mut self, time_s: f64) {
        self.part_start_s = time_s;
        for extreme in [
            &mut self.fastest_print,
            &mut self.greatest_flow,
            &mut self.greatest_deviation,
            &mut self.greatest_pressure,
            &mut self.longest_retraction,
            &mut self.longest_travel,
            &mut self.fastest_travel,
            &mut self.longest_wait,
        ] {
            *extreme = Extreme::default();
        }
        self.since_print = Aside::default();
    }

    /// Returns true if something has been printed.
    pub(crate) fn has_printed(&self) -> bool {
        self.kinds[Kind::Print as usize].time_s > 0.0
    }

    /// Ends the sums. A job that prints nothing has its extremes all the same.
    pub(crate) fn finish(mut self) -> Self {
        if !self.has_printed() {
            self.count_aside();
        }
        self
    }

    /// Counts the extremes since the last printing.
    fn count_aside(&mut self) {
        let Aside { longest_retraction, longest_travel, fastest_travel } = std::mem::take(&mut self.since_print);
        for (extreme, aside) in [
            (&mut self.longest_retraction, longest_retraction),
            (&mut self.longest_travel, longest_travel),
            (&mut self.fastest_travel, fastest_travel),
        ] {
            if aside.value > extreme.value {
                *extreme = aside;
            }
        }
    }

    /// Counts the part between two nodes.
    pub(crate) fn note(&mut self, before: &Node, node: &Node) {
        let time_s = (node.time_s - before.time_s).max(0.0);
        let path_mm = before.distance_mm(node);
        let share = Share {
            time_s,
            path_mm: if node.kind.moves() { path_mm } else { 0.0 },
            volume_mm3: if node.kind == Kind::Print { path_mm * f64::from(node.bead) } else { 0.0 },
        };
        self.kinds[node.kind as usize].add(share);
        let feed = f64::from(node.feed_mm_per_s);
        if matches!(node.kind, Kind::Print | Kind::Travel) && feed > 0.0 {
            self.slower_s += (time_s - path_mm / feed).max(0.0);
            if f64::from((node.speed_mm_per_s - before.speed_mm_per_s).abs()) > 0.1 * feed {
                self.changing_s += time_s;
            }
        }
        if node.is_slowed {
            self.slowed_s += time_s;
            if self.first_slowed.value == 0.0 {
                self.first_slowed.note(1.0, node);
            }
        }
        self.wait_s = if node.kind == Kind::Wait { self.wait_s + time_s } else { 0.0 };
        self.travel_mm = if node.kind == Kind::Travel { self.travel_mm + path_mm } else { 0.0 };
        match node.kind {
            Kind::Print => {
                let feature = usize::from(node.feature).min(MAX_FEATURES - 1);
                if self.features.len() <= feature {
                    self.features.resize(feature + 1, Share::default());
                }
                self.features[feature].add(share);
                self.count_aside();
                self.greatest_deviation.note(node.deviation_mm.into(), node);
                self.fastest_print.note(node.speed_mm_per_s.into(), node);
                self.greatest_flow.note(node.flow_mm3_per_s().into(), node);
            }
            Kind::Travel => {
                self.since_print.fastest_travel.note(node.speed_mm_per_s.into(), node);
                self.since_print.longest_travel.note(self.travel_mm, node);
            }
            // A retraction after a move that settles may have two parts.
            Kind::Retract if (before.kind, before.line) != (Kind::Retract, node.line) => {
                self.retractions += 1;
                let length_mm = f64::from(-node.bead);
                if self.retractions == 1 {
                    self.first_retraction.note(length_mm, node);
                }
                self.since_print.longest_retraction.note(length_mm, node);
                let in_layer = if self.in_layer.1 == node.layer { self.in_layer.0 + 1 } else { 1 };
                self.in_layer = (in_layer, node.layer);
                self.most_retractions = self.most_retractions.max(self.in_layer);
            }
            Kind::Wait => self.longest_wait.note(self.wait_s, node),
            Kind::Retract | Kind::Prime | Kind::Homing | Kind::Heating => {}
        }
        self.greatest_pressure.note(node.pressure_mm3.into(), node);
    }
}

impl Share {
    fn add(&mut self, other: Self) {
        self.time_s += other.time_s;
        self.path_mm += other.path_mm;
        self.volume_mm3 += other.volume_mm3;
    }
}
