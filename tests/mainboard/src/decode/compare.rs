//! Compares the pins' events with the desk's.
//!
//! The order must be the same from the first event to the last. Times are compared run by run:
//! while the queue holds moves, the chip makes events at the desk's intervals, and only a delayed
//! interrupt makes an event late. After the queue has run empty, the next move starts when it
//! arrives, which the desk cannot know: a new run begins. Within a run the event with the
//! smallest difference (pin - desk) is punctual; the latency of another event is its difference
//! minus the smallest one.
//!
//! A latency has no sign: an event that is too early makes all others of its run late. A delay of
//! the whole run is invisible.

use serde::{Deserialize, Serialize};

use super::pins::Event;
use super::trace::TraceStep;

/// Upper ends of the bins of [`Comparison::histogram`], ns; the last bin has all larger latencies.
pub const HISTOGRAM_NS: [u64; 13] =
    [100, 200, 500, 1_000, 2_000, 5_000, 10_000, 20_000, 50_000, 100_000, 200_000, 500_000, 1_000_000];

/// The limits between runs of motion, and of latencies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Rules {
    /// A gap of the desk as long as this ends a run, ns.
    pub rest_ns: u64,
    /// A gap of the desk as long as this ends a run if the pins' gap differs from it by more than
    /// `latency_bound_ns`, ns. A delay longer than the bound goes unnoticed in such a gap: choose
    /// it longer than any interval within a fast move.
    pub pause_ns: u64,
    /// Latencies above this count as too late, ns.
    pub latency_bound_ns: u64,
}

impl Rules {
    /// 20 ms, 1 ms, 100 us: from rest the first steps of a move are some milliseconds apart.
    pub const USUAL: Self = Self { rest_ns: 20_000_000, pause_ns: 1_000_000, latency_bound_ns: 100_000 };
}

impl Default for Rules {
    fn default() -> Self {
        Self::USUAL
    }
}

/// The first difference between pins and desk.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Difference {
    /// Index of the event, from 0.
    pub index: usize,
    /// The pins' event; `None` after their last one.
    pub pins: Option<Event>,
    /// The desk's step; `None` after its last one.
    pub desk: Option<TraceStep>,
}

impl std::fmt::Display for Difference {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "event {}: the pins ", self.index)?;
        match self.pins {
            Some(event) => write!(
                formatter,
                "step {:04b} (backwards {:04b}) at {:.6} s, ",
                event.axes,
                event.directions,
                event.at_ns as f64 / 1e9
            )?,
            None => write!(formatter, "make no further step,  ")?,
        }
        match self.desk {
            Some(step) => write!(
                formatter,
                "the desk steps {:04b} (backwards {:04b}) at tick {}, line {}",
                step.axes, step.directions, step.tick, step.line
            ),
            None => write!(formatter, "the desk makes no further step"),
        }
    }
}

/// An event and its latency.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Late {
    /// Index of the event.
    pub index: usize,
    /// Instant of the event on the pins, ns.
    pub at_ns: u64,
    /// Source line of its move.
    pub line: u32,
    /// Latency of the event, ns.
    pub latency_ns: u64,
}

impl std::fmt::Display for Late {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            formatter,
            "event {} of line {} left {:.1} us late, at {:.6} s",
            self.index,
            self.line,
            self.latency_ns as f64 / 1e3,
            self.at_ns as f64 / 1e9
        )
    }
}

/// The result of a comparison.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Comparison {
    /// Number of events on the pins.
    pub pin_events: usize,
    /// Number of steps of the desk.
    pub desk_events: usize,
    /// The first difference in the order; times are compared up to it.
    pub difference: Option<Difference>,
    /// Number of runs of continuous motion.
    pub runs: usize,
    /// The latest event.
    pub latest: Option<Late>,
    /// The first event later than the bound: after a lost or doubled edge it shows the place.
    pub first_too_late: Option<Late>,
    /// Number of events later than the bound.
    pub too_late: usize,
    /// Number of events by latency: bin i counts those up to `HISTOGRAM_NS[i]` and above the bin
    /// before; the last bin counts the rest.
    pub histogram: [u64; HISTOGRAM_NS.len() + 1],
    /// The largest difference between an interval on the pins and the desk's, within the runs, ns.
    pub largest_disagreement_ns: u64,
    /// The same difference between runs, ns: how long the machine waited without the desk knowing.
    pub largest_wait_ns: u64,
}

impl Comparison {
    /// True if the order is the same throughout, and no event is later than the bound.
    #[must_use]
    pub fn agrees(&self) -> bool {
        self.difference.is_none() && self.too_late == 0
    }

    /// The largest latency, us.
    #[must_use]
    pub fn largest_latency_us(&self) -> f64 {
        self.latest.map_or(0.0, |late| late.latency_ns as f64 / 1000.0)
    }
}

/// Compares the events on the pins with the desk's steps, whose clock has `tick_hz` ticks a second.
#[must_use]
pub fn compare(pins: &[Event], desk: &[TraceStep], tick_hz: u64, rules: &Rules) -> Comparison {
    let same = |(pin, desk): &(&Event, &TraceStep)| (pin.axes, pin.directions) == (desk.axes, desk.directions);
    let equal = pins.iter().zip(desk).take_while(same).count();
    let mut comparison = Comparison {
        pin_events: pins.len(),
        desk_events: desk.len(),
        difference: (equal < pins.len() || equal < desk.len()).then(|| Difference {
            index: equal,
            pins: pins.get(equal).copied(),
            desk: desk.get(equal).copied(),
        }),
        runs: 0,
        latest: None,
        first_too_late: None,
        too_late: 0,
        histogram: [0; HISTOGRAM_NS.len() + 1],
        largest_disagreement_ns: 0,
        largest_wait_ns: 0,
    };
    let desk_ns = |index: usize| ticks_to_ns(desk[index].tick, tick_hz);
    let mut run_from = 0;
    for index in 1..equal {
        let desk_gap = desk_ns(index) - desk_ns(index - 1);
        let pin_gap = i128::from(pins[index].at_ns) - i128::from(pins[index - 1].at_ns);
        let disagreement = u64::try_from((pin_gap - desk_gap).unsigned_abs()).unwrap_or(u64::MAX);
        let pause = desk_gap >= i128::from(rules.pause_ns) && disagreement > rules.latency_bound_ns;
        if pause || desk_gap >= i128::from(rules.rest_ns) {
            comparison.largest_wait_ns = comparison.largest_wait_ns.max(disagreement);
            comparison.run(pins, desk, run_from..index, tick_hz, rules);
            run_from = index;
        } else {
            comparison.largest_disagreement_ns = comparison.largest_disagreement_ns.max(disagreement);
        }
    }
    if equal > 0 {
        comparison.run(pins, desk, run_from..equal, tick_hz, rules);
    }
    comparison
}

impl Comparison {
    fn run(&mut self, pins: &[Event], desk: &[TraceStep], range: std::ops::Range<usize>, tick_hz: u64, rules: &Rules) {
        self.runs += 1;
        let offset = |index: usize| i128::from(pins[index].at_ns) - ticks_to_ns(desk[index].tick, tick_hz);
        let least = range.clone().map(offset).min().unwrap_or(0);
        for index in range {
            let latency_ns = u64::try_from(offset(index) - least).unwrap_or(u64::MAX);
            let late = Late { index, at_ns: pins[index].at_ns, line: desk[index].line, latency_ns };
            self.histogram[HISTOGRAM_NS.partition_point(|upper| *upper < latency_ns)] += 1;
            if self.latest.is_none_or(|latest| latency_ns > latest.latency_ns) {
                self.latest = Some(late);
            }
            if latency_ns > rules.latency_bound_ns {
                self.too_late += 1;
                self.first_too_late.get_or_insert(late);
            }
        }
    }
}

/// A tick in ns, rounded down.
fn ticks_to_ns(tick: u64, tick_hz: u64) -> i128 {
    i128::from(tick) * 1_000_000_000 / i128::from(tick_hz.max(1))
}
