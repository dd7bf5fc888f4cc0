//! A switch that a carriage presses at one end of an axis.

use crate::parts::random::Random;

/// Minimum and maximum time between two bounces, in ns: short for a software filter,
/// long for an edge.
const BOUNCE_NS: (u64, u64) = (20_000, 200_000);

/// The end of the axis with the switch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Side {
    /// Pressed at and below its position.
    Low,
    /// Pressed at and above its position.
    High,
}

/// A switch and its position.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct EndStopConfig {
    /// 0 for X, 1 for Y, 2 for Z.
    pub axis: usize,
    /// The end of the axis.
    pub side: Side,
    /// The position at which it closes, in mm.
    pub at_mm: f64,
    /// Distance that the carriage must move back before it opens, in mm.
    pub hysteresis_mm: f64,
    /// Duration of the bouncing after it closes, in ns; 0 for an optical switch.
    pub bounce_ns: u64,
    /// The level when pressed.
    pub high_when_triggered: bool,
    /// Seed of its bounces.
    pub seed: u64,
}

/// A fault of a switch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum EndStopFault {
    /// Never pressed: a broken lever, a disconnected wire.
    StuckOpen,
    /// Always pressed.
    StuckClosed,
}

/// The switch.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct EndStop {
    axis: usize,
    sign: i64,
    close: i64,
    open: i64,
    bounce_ns: u64,
    high_when_triggered: bool,
    fault: Option<EndStopFault>,
    random: Random,
    pressed: bool,
    /// The contact's state now; differs from `pressed` while it bounces.
    contact: bool,
    bounce_until_ns: u64,
    next_bounce_ns: Option<u64>,
    closings: u64,
}

impl EndStop {
    /// A switch on an axis that counts `units_per_mm`.
    pub(super) fn new(config: &EndStopConfig, units_per_mm: f64) -> Self {
        // Positions count towards the switch: pressed from `close` on, open again below `open`.
        let sign = if config.side == Side::Low { -1 } else { 1 };
        let close = sign * (config.at_mm * units_per_mm).round() as i64;
        let open = close - (config.hysteresis_mm.max(0.0) * units_per_mm).round() as i64;
        Self {
            axis: config.axis,
            sign,
            close,
            open,
            bounce_ns: config.bounce_ns,
            high_when_triggered: config.high_when_triggered,
            fault: None,
            random: Random::new(config.seed),
            pressed: false,
            contact: false,
            bounce_until_ns: 0,
            next_bounce_ns: None,
            closings: 0,
        }
    }

    pub(super) fn axis(&self) -> usize {
        self.axis
    }

    /// Follows the carriage to this position; true if the level changed.
    pub(super) fn update(&mut self, now_ns: u64, position: i64) -> bool {
        let towards = self.sign * position;
        let pressed = towards >= self.close || (self.pressed && towards >= self.open);
        if pressed == self.pressed {
            return false;
        }
        let before = self.level();
        self.pressed = pressed;
        self.contact = pressed;
        self.next_bounce_ns = None;
        if pressed {
            self.closings += 1;
            self.bounce_until_ns = now_ns + self.bounce_ns;
            self.plan_bounce(now_ns);
        }
        self.level() != before
    }

    fn plan_bounce(&mut self, now_ns: u64) {
        let next_ns = now_ns + self.random.between(BOUNCE_NS.0, BOUNCE_NS.1);
        self.next_bounce_ns = if next_ns < self.bounce_until_ns {
            Some(next_ns)
        } else {
            (self.contact != self.pressed).then_some(self.bounce_until_ns)
        };
    }

    pub(super) fn come_to_rest(&mut self) {
        (self.contact, self.next_bounce_ns, self.closings) = (self.pressed, None, 0);
    }

    /// Bounces up to `now_ns`; true if the level changed.
    pub(super) fn advance(&mut self, now_ns: u64) -> bool {
        let before = self.level();
        while let Some(at_ns) = self.next_bounce_ns.filter(|&at_ns| at_ns <= now_ns) {
            self.contact = !self.contact;
            self.plan_bounce(at_ns);
        }
        self.level() != before
    }

    /// The next bounce, ns.
    pub fn next_event_ns(&self) -> Option<u64> {
        self.next_bounce_ns
    }

    /// The level on its wire.
    pub fn level(&self) -> bool {
        let closed = match self.fault {
            None => self.contact,
            Some(EndStopFault::StuckOpen) => false,
            Some(EndStopFault::StuckClosed) => true,
        };
        closed == self.high_when_triggered
    }

    /// True if the carriage presses it, without bounces and faults.
    pub fn pressed(&self) -> bool {
        self.pressed
    }

    /// The number of times it was pressed since the start.
    pub fn closings(&self) -> u64 {
        self.closings
    }

    /// Breaks or mends the switch. The level may change at once: read it again.
    pub fn set_fault(&mut self, fault: Option<EndStopFault>) {
        self.fault = fault;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stop(side: Side, bounce_ns: u64, high_when_triggered: bool) -> EndStop {
        let config =
            EndStopConfig { axis: 0, side, at_mm: 5.0, hysteresis_mm: 0.5, bounce_ns, high_when_triggered, seed: 3 };
        EndStop::new(&config, 100.0)
    }

    #[test]
    fn a_switch_closes_at_its_position_and_opens_after_its_hysteresis() {
        let mut low = stop(Side::Low, 0, true);
        let levels: Vec<bool> = [600, 501, 500, 540, 550, 551, 500]
            .map(|position| {
                low.update(0, position);
                low.level()
            })
            .to_vec();
        assert_eq!(levels, [false, false, true, true, true, false, true]);
        assert_eq!(low.closings(), 2);
        let mut high = stop(Side::High, 0, false);
        assert!(high.level());
        assert!(high.update(0, 500) && !high.level());
        assert!(!high.update(0, 450) && high.update(0, 449) && high.level());
    }

    #[test]
    fn a_switch_bounces_for_its_time_and_ends_closed() {
        for seed in 0..50 {
            let mut stop = stop(Side::High, 3_000_000, true);
            stop.random = Random::new(seed);
            stop.update(1_000_000, 500);
            let mut edges = Vec::new();
            while let Some(at_ns) = stop.next_event_ns() {
                assert!(stop.advance(at_ns));
                edges.push(at_ns);
            }
            assert!(edges.len() >= 14 && edges.len() % 2 == 0, "{}", edges.len());
            assert!(edges.iter().all(|&at_ns| at_ns > 1_000_000 && at_ns <= 4_000_000));
            assert!(stop.level());
        }
    }

    #[test]
    fn faults_hold_the_level() {
        let mut stop = stop(Side::High, 0, true);
        stop.set_fault(Some(EndStopFault::StuckOpen));
        assert!(!stop.update(0, 500) && !stop.level() && stop.pressed());
        stop.set_fault(Some(EndStopFault::StuckClosed));
        assert!(stop.level());
        assert!(!stop.update(0, 0) && stop.level());
        stop.set_fault(None);
        assert!(!stop.level());
    }
}
