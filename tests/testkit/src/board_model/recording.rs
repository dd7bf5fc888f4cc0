//! A record of the motors, taken at the pins.

use std::cell::{Cell, RefCell};

use ferrostep_step_player::OutputPorts;
use ferrostep_virtual_board::{VirtualPort, VirtualUpdateTimer};

use ferrostep_planner::Geometry;
use ferrostep_planner::kinematics::UNITS_PER_MM;

use super::time::{CYCLES_A_MS, CYCLES_A_US};

/// Time without a step after which X and Y are at rest.
const STANDSTILL_CYCLES: u64 = 5 * CYCLES_A_MS;

/// Steps nearer than this do not end a deceleration: at the accelerations here the last two steps
/// before standstill are twice as far apart.
const AT_SPEED_CYCLES: u64 = 250 * CYCLES_A_US;

/// Time over which the distance of a feed is measured, ms.
const FEED_WINDOW_MS: usize = 5;

/// The port, observed.
#[derive(Debug)]
pub(super) struct WatchedPort<'a> {
    port: VirtualPort<'a>,
    timer: &'a VirtualUpdateTimer,
    watch: RefCell<Watch>,
    events: Cell<u64>,
}

/// The record of one print.
#[derive(Clone, Debug, Default)]
pub struct Watch {
    /// Positions of the X and Y motors (A and B) at each whole ms, up to the last event.
    pub every_ms: Vec<[i64; 2]>,
    /// Number of times that X and Y stopped although their last two steps were those
    /// of a fast motion.
    pub stops_from_speed: u64,
    /// Cycle of the first and the last step of X or Y.
    pub first_and_last: Option<(u64, u64)>,
    stands_at: [i64; 2],
    last_interval: u64,
}

impl Watch {
    fn stepped(&mut self, now: u64, motors: [i64; 4]) {
        let [x, y, ..] = motors;
        if [x, y] == self.stands_at {
            return;
        }
        // Before the step: at a whole ms that coincides with the step the motors had not moved yet.
        let upto = now.div_ceil(CYCLES_A_MS) as usize;
        self.every_ms.resize(upto.max(self.every_ms.len()), self.stands_at);
        self.stands_at = [x, y];
        if let Some((_, last)) = self.first_and_last {
            let interval = now - last;
            let was_fast = self.last_interval > 0 && self.last_interval < AT_SPEED_CYCLES;
            self.stops_from_speed += u64::from(interval > STANDSTILL_CYCLES && was_fast);
            self.last_interval = interval;
        }
        let (first, _) = self.first_and_last.unwrap_or((now, now));
        self.first_and_last = Some((first, now));
    }

    /// Feed along the path of X and Y at each whole ms, mm/s, from the position 5 ms before.
    pub fn feeds(&self, geometry: &Geometry) -> Vec<f64> {
        let at = |[x, y]: [i64; 2]| {
            let [x, y, _] = geometry.position_10nm([x, y, 0]);
            [x, y].map(|coordinate| coordinate as f64 / UNITS_PER_MM as f64)
        };
        let places: Vec<[f64; 2]> = self.every_ms.iter().map(|&motors| at(motors)).collect();
        let distance = |from: &[f64; 2], to: &[f64; 2]| (to[0] - from[0]).hypot(to[1] - from[1]);
        let window_s = FEED_WINDOW_MS as f64 / 1_000.0;
        places.windows(FEED_WINDOW_MS + 1).map(|span| distance(&span[0], &span[FEED_WINDOW_MS]) / window_s).collect()
    }

    /// Returns true if the last of all stops came from speed.
    fn ended_at_speed(&self) -> bool {
        self.last_interval > 0 && self.last_interval < AT_SPEED_CYCLES
    }

    /// Time from the first to the last step, s.
    pub fn seconds(&self) -> f64 {
        let (first, last) = self.first_and_last.unwrap_or_default();
        (last - first) as f64 / (CYCLES_A_MS * 1000) as f64
    }

    /// Stops from speed, the end of the print included.
    pub fn all_stops_from_speed(&self) -> u64 {
        self.stops_from_speed + u64::from(self.ended_at_speed())
    }
}

impl<'a> WatchedPort<'a> {
    pub fn new(timer: &'a VirtualUpdateTimer, both_edges: bool) -> Self {
        Self { port: VirtualPort::new(timer, both_edges), timer, watch: RefCell::default(), events: Cell::new(0) }
    }

    pub fn port(&self) -> &VirtualPort<'a> {
        &self.port
    }

    pub fn watch(&self) -> Watch {
        self.watch.borrow().clone()
    }
}

impl OutputPorts<1> for WatchedPort<'_> {
    fn write(&self, port: usize, word: u32) {
        self.port.write(port, word);
        if self.events.replace(self.port.events()) != self.port.events() {
            self.watch.borrow_mut().stepped(self.timer.now_cycles(), self.port.motor_steps());
        }
    }
}
