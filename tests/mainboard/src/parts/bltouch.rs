//! A BLTouch: a pin beside the nozzle that a coil puts out and draws in, told by a servo's pulses.
//!
//! Its maker, Antclabs, describes it in the manual of the Smart V3; what is here is what the
//! hosts that drive it know of it: Klipper's `klippy/extras/bltouch.py` and `docs/BLTouch.md`,
//! Marlin's `Marlin/src/feature/bltouch.cpp`, and their users (Klipper issues 391 and 2267,
//! Marlin's pull request 13814).
//!
//! | behaviour | source | test |
//! |---|---|---|
//! | commands by pulses of 650, 1165, 1475, 1780 and 2190 us every 20 ms | Klipper; Marlin by angles, up to 4 us beside | `pulses_are_told_apart_by_their_width` |
//! | a pin that is out and touches: 10 ms high, and it goes in | Marlin | `a_touch_is_a_pulse_and_the_pin_comes_out_again` |
//! | it comes out again by itself unless it is called in, and raises its alarm if the bed is still there after 650 ms | Klipper 391, 2267 | the same |
//! | the signal is high in alarm, whichever way the pin did not go; calling it in does not end that, the release does | Marlin 13814 | `an_alarm_is_high_until_it_is_released` |
//! | in touch mode the signal follows the pin: high while it is in or pushed in; the mode ends an alarm | Marlin 13814, Klipper | `touch_mode_follows_the_pin` |
//!
//! Left out: the light, the self-test of the first seconds, the output modes (5 V, open drain) and
//! a V3's commands for them.

use serde::{Deserialize, Serialize};

const MS: u64 = 1_000_000;

/// A command, by its pulses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Command {
    /// The pin goes out.
    Out,
    /// The signal follows the pin.
    TouchMode,
    /// The pin goes in.
    In,
    /// The pin goes out and in, again and again.
    SelfTest,
    /// The alarm ends, the pin goes in.
    Release,
}

/// Widths, microseconds.
const WIDTHS_US: [(u64, Command); 5] = [
    (650, Command::Out),
    (1_165, Command::TouchMode),
    (1_475, Command::In),
    (1_780, Command::SelfTest),
    (2_190, Command::Release),
];

/// Greatest difference of a pulse from its width, ns: more than the 4 us between Marlin's angles
/// and Klipper's widths, and less than half of the 103 us from one command of the V3 to the next.
const TOLERANCE_NS: u64 = 10_000;

/// Pulses alike before it obeys; the period that they may have.
const PULSES: u32 = 3;
const PERIOD_NS: std::ops::RangeInclusive<u64> = 18 * MS..=22 * MS;

/// The pin goes out, or in, in this time.
const MOVE_NS: u64 = 250 * MS;
/// Duration of the signal when the pin is touched.
const SIGNAL_NS: u64 = 10 * MS;
/// Time after which the pin drops again without a command to go in.
const DROP_NS: u64 = 100 * MS;
/// ... and must be off the bed this long after its signal.
const OFF_NS: u64 = 650 * MS;
/// The pin moves by this before its sensor sees it, mm.
const TRAVEL_MM: f64 = 0.5;

/// Faults of the probe.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Fault {
    /// The pin does not go out.
    StuckIn,
    /// The pin does not go in.
    StuckOut,
    /// The signal's wire is broken.
    SignalWire,
    /// The servo's wire is broken.
    ServoWire,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
enum Pin {
    In,
    Out,
}

/// The probe.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct BlTouch {
    /// The nozzle's height above the bed at which it triggers, mm.
    trigger_mm: f64,
    pin: Pin,
    /// Position to which the coil moves the pin, and the instant of its arrival, ns.
    moves: Option<(Pin, u64)>,
    touch_mode: bool,
    alarm: bool,
    /// The end of the signal of a touch.
    signal_end_ns: Option<u64>,
    /// Instant by which a pin that was touched must be off the bed, unless it is called in.
    off_by_ns: Option<u64>,
    /// The nozzle's height above the bed below the pin; `None`: beside it.
    gap_mm: Option<f64>,
    control: bool,
    rose_ns: Option<u64>,
    heard: Option<(Command, u32)>,
    told: Option<Command>,
    fault: Option<Fault>,
    record: Record,
}

/// Counts of what has happened to the probe.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Record {
    /// Touches that it has signalled.
    pub touches: u32,
    /// Alarms.
    pub alarms: u32,
    /// Commands that it has obeyed, and that pulses have repeated.
    pub commands: u32,
    /// Pulses.
    pub pulses: u32,
    /// Pulses of an unknown width.
    pub strange_pulses: u32,
    /// Greatest difference of a pulse from its width, ns.
    pub worst_width_ns: u64,
    /// Steps of X and Y while the pin was not in.
    pub steps_with_pin_out: u32,
}

impl BlTouch {
    /// A probe whose pin is in, and that triggers with the nozzle at this height.
    pub fn new(trigger_mm: f64) -> Self {
        Self {
            trigger_mm,
            pin: Pin::In,
            moves: None,
            touch_mode: false,
            alarm: false,
            signal_end_ns: None,
            off_by_ns: None,
            gap_mm: None,
            control: false,
            rose_ns: None,
            heard: None,
            told: None,
            fault: None,
            record: Record::default(),
        }
    }

    /// The level on its wire; `None`: nothing drives it.
    pub fn level(&self) -> Option<bool> {
        let high =
            self.alarm || self.signal_end_ns.is_some() || self.touch_mode && (self.pin == Pin::In || self.touches());
        (self.fault != Some(Fault::SignalWire)).then_some(high)
    }

    /// True if the pin is neither in nor going in.
    pub fn is_out(&self) -> bool {
        self.pin == Pin::Out || matches!(self.moves, Some((Pin::Out, _)))
    }

    /// True if the probe flashes.
    pub fn is_in_alarm(&self) -> bool {
        self.alarm
    }

    /// Counts of what has happened to the probe.
    pub fn record(&self) -> Record {
        self.record
    }

    /// Breaks or mends it.
    pub fn set_fault(&mut self, fault: Option<Fault>) {
        self.fault = fault;
    }

    /// Pulls the pin out, as a hand would or a power cut leaves it.
    pub fn pull_out(&mut self) {
        self.pin = Pin::Out;
    }

    /// X or Y makes a step.
    pub fn stepped_in_plane(&mut self) {
        self.record.steps_with_pin_out += u32::from(self.is_out());
    }

    fn touches(&self) -> bool {
        self.gap_mm.is_some_and(|gap| gap <= self.trigger_mm)
    }

    /// True if the bed is too near for the pin to be out as far as it goes.
    fn is_blocked(&self) -> bool {
        self.gap_mm.is_some_and(|gap| gap <= self.trigger_mm + TRAVEL_MM)
    }

    /// The nozzle's height above the bed below the pin. True if the level may have changed.
    pub fn set_gap(&mut self, now_ns: u64, gap_mm: Option<f64>) -> bool {
        let before = self.level();
        self.gap_mm = gap_mm;
        let is_pushed = self.pin == Pin::Out && self.moves.is_none() && self.touches();
        if is_pushed && !self.touch_mode && !self.alarm && self.fault != Some(Fault::StuckOut) {
            self.record.touches += 1;
            self.signal_end_ns = Some(now_ns + SIGNAL_NS);
            self.off_by_ns = Some(now_ns + OFF_NS);
            self.pin = Pin::In;
            // Dropped again.
            self.moves = Some((Pin::Out, now_ns + DROP_NS));
        }
        self.level() != before
    }

    /// The level of the servo's wire. True if the level of the signal changed.
    pub fn set_control(&mut self, now_ns: u64, level: bool) -> bool {
        let level = level && self.fault != Some(Fault::ServoWire);
        if std::mem::replace(&mut self.control, level) == level {
            return false;
        }
        if level {
            if self.rose_ns.is_none_or(|before| !PERIOD_NS.contains(&(now_ns - before))) {
                self.heard = None;
            }
            self.rose_ns = Some(now_ns);
            return false;
        }
        let width_ns = self.rose_ns.map_or(0, |rose_ns| now_ns - rose_ns);
        self.record.pulses += 1;
        let beside = |&(width_us, command): &(u64, Command)| (width_ns.abs_diff(width_us * 1000), command);
        let nearest = WIDTHS_US.iter().map(beside).min_by_key(|(beside_ns, _)| *beside_ns);
        let Some((beside_ns, command)) = nearest.filter(|(beside_ns, _)| *beside_ns <= TOLERANCE_NS) else {
            self.record.strange_pulses += 1;
            self.heard = None;
            return false;
        };
        self.record.worst_width_ns = self.record.worst_width_ns.max(beside_ns);
        let count = match self.heard {
            Some((before, count)) if before == command => count + 1,
            _ => 1,
        };
        self.heard = Some((command, count));
        if count != PULSES {
            return false;
        }
        let before = self.level();
        self.obey(now_ns, command);
        self.level() != before
    }

    fn obey(&mut self, now_ns: u64, command: Command) {
        self.record.commands += 1;
        self.told = Some(command);
        match command {
            Command::TouchMode => {
                self.touch_mode = true;
                self.alarm = false;
                self.signal_end_ns = None;
                return;
            }
            Command::Release => self.alarm = false,
            // An alarm does not end with it.
            _ if self.alarm => return,
            _ => {}
        }
        self.touch_mode = false;
        self.signal_end_ns = None;
        self.off_by_ns = None;
        self.moves = Some((if command == Command::Out { Pin::Out } else { Pin::In }, now_ns + MOVE_NS));
    }

    /// Advances time; true if the level changed.
    pub fn advance(&mut self, now_ns: u64) -> bool {
        let before = self.level();
        if self.signal_end_ns.is_some_and(|end_ns| end_ns <= now_ns) {
            self.signal_end_ns = None;
        }
        if let Some((to, at_ns)) = self.moves.filter(|(_, at_ns)| *at_ns <= now_ns) {
            self.moves = None;
            let stuck = match (to, self.fault) {
                (Pin::Out, Some(Fault::StuckIn)) | (Pin::In, Some(Fault::StuckOut)) => self.pin != to,
                (Pin::Out, _) => self.is_blocked(),
                _ => false,
            };
            match self.off_by_ns {
                // It continues to try until its time is over.
                Some(off_by_ns) if stuck && now_ns < off_by_ns => {
                    self.moves = Some((to, off_by_ns.min(at_ns + DROP_NS)))
                }
                _ if stuck => self.raise_alarm(),
                _ => {
                    self.pin = to;
                    self.off_by_ns = None;
                }
            }
        }
        self.level() != before
    }

    fn raise_alarm(&mut self) {
        self.off_by_ns = None;
        // The release draws in what it can, and does not look.
        if self.told != Some(Command::Release) {
            self.alarm = true;
            self.record.alarms += 1;
        }
    }

    /// The next event that changes something by itself, ns.
    pub fn next_event_ns(&self) -> Option<u64> {
        self.moves.map(|(_, at_ns)| at_ns).into_iter().chain(self.signal_end_ns).min()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A probe 10 mm above the bed, and the time.
    struct Bench {
        probe: BlTouch,
        now_ns: u64,
    }

    impl Bench {
        fn new() -> Self {
            let mut probe = BlTouch::new(2.0);
            probe.set_gap(0, Some(10.0));
            Self { probe, now_ns: 0 }
        }

        fn wait(&mut self, ms: u64) {
            for _ in 0..ms {
                self.now_ns += MS;
                self.probe.advance(self.now_ns);
            }
        }

        fn tell(&mut self, width_us: u64, count: u32) {
            for _ in 0..count {
                self.probe.set_control(self.now_ns, true);
                self.probe.set_control(self.now_ns + width_us * 1000, false);
                self.wait(20);
            }
        }

        fn level(&self) -> Option<bool> {
            self.probe.level()
        }
    }

    #[test]
    fn pulses_are_told_apart_by_their_width() {
        let mut bench = Bench::new();
        bench.tell(650, 2);
        bench.wait(400);
        assert!(!bench.probe.is_out(), "two are noise");
        for (width_us, is_out) in [(661, false), (639, false), (647, true), (1_472, false), (650, true), (2_194, false)]
        {
            bench.tell(width_us, 20);
            assert_eq!(bench.probe.is_out(), is_out, "{width_us}");
        }
        let record = bench.probe.record();
        assert_eq!((record.commands, record.strange_pulses, record.worst_width_ns), (4, 40, 4_000));
    }

    #[test]
    fn a_touch_is_a_pulse_and_the_pin_comes_out_again() {
        let mut bench = Bench::new();
        bench.tell(650, 20);
        assert_eq!((bench.probe.is_out(), bench.level()), (true, Some(false)));
        assert!(bench.probe.set_gap(bench.now_ns, Some(2.0)));
        assert_eq!(bench.level(), Some(true));
        bench.wait(11);
        assert_eq!(bench.level(), Some(false));
        // Off the bed in time: it is out again, and triggers again.
        bench.wait(300);
        bench.probe.set_gap(bench.now_ns, Some(5.0));
        bench.wait(200);
        assert!(bench.probe.is_out() && !bench.probe.is_in_alarm());
        assert!(bench.probe.set_gap(bench.now_ns, Some(1.9)));
        // Not off it: the alarm.
        bench.wait(700);
        assert!(bench.probe.is_in_alarm());
        assert_eq!((bench.level(), bench.probe.record().touches), (Some(true), 2));
        // Called in at the bed, it stays in.
        let mut bench = Bench::new();
        bench.tell(650, 20);
        bench.probe.set_gap(bench.now_ns, Some(2.0));
        bench.tell(1_475, 20);
        bench.wait(1_000);
        assert_eq!((bench.probe.is_out(), bench.level()), (false, Some(false)));
    }

    #[test]
    fn an_alarm_is_high_until_it_is_released() {
        let mut bench = Bench::new();
        bench.probe.set_fault(Some(Fault::StuckIn));
        bench.tell(650, 20);
        assert_eq!((bench.probe.is_in_alarm(), bench.level()), (true, Some(true)));
        bench.tell(1_475, 20);
        assert_eq!(bench.level(), Some(true));
        bench.tell(2_190, 20);
        assert_eq!(bench.level(), Some(false));
        bench.probe.set_fault(None);
        bench.tell(650, 20);
        assert_eq!((bench.probe.is_out(), bench.level()), (true, Some(false)));
        bench.probe.set_fault(Some(Fault::StuckOut));
        bench.tell(1_475, 20);
        assert_eq!(bench.level(), Some(true));
        bench.tell(2_190, 20);
        assert_eq!((bench.probe.is_out(), bench.level()), (true, Some(false)), "it does not look");
        bench.tell(1_475, 20);
        assert_eq!(bench.level(), Some(true));
    }

    #[test]
    fn touch_mode_follows_the_pin() {
        let mut bench = Bench::new();
        bench.tell(1_165, 5);
        assert_eq!(bench.level(), Some(true));
        bench.tell(650, 20);
        bench.tell(1_165, 5);
        assert_eq!(bench.level(), Some(false));
        bench.probe.set_gap(bench.now_ns, Some(1.0));
        assert_eq!(bench.level(), Some(true));
        bench.probe.set_fault(Some(Fault::SignalWire));
        assert_eq!(bench.level(), None);
    }
}
