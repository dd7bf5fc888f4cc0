//! Li's cases of a segment between others, from the table.

use crate::table::FrequencyTable;

/// The paper's case of a segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlanCase {
    /// Case (a): start and stop are slower than the run frequency, which is reached.
    Full,
    /// Case (b): start and stop are slower than the run frequency, which is not reached.
    NoCruise,
    /// Case (c): started at the run frequency or above, stopped below it.
    SlowsDown,
    /// Case (d): started below the run frequency, stopped at it or above.
    SpeedsUp,
    /// Start and stop are no slower than the run frequency, which is kept throughout.
    AtRun,
    /// The line is too short for the change from start to stop: the slower of the two throughout.
    TooShort,
}

/// Division of a segment's pulses (Li 2017, sect. 2, eqs. 5 and 6).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// Case of the segment.
    pub case: PlanCase,
    /// A, the number of pulses of the acceleration.
    pub acceleration: f64,
    /// C, the number of pulses of the cruise.
    pub cruise: f64,
    /// D, the number of pulses of the deceleration.
    pub deceleration: f64,
    /// F at the start of the segment.
    pub start: f64,
    /// F at the end of the segment.
    pub stop: f64,
    /// Frequency of the cruise, Hz; without a cruise, the highest frequency of the segment.
    pub run_hz: f64,
}

impl Plan {
    /// Plans a segment of this many pulses between a start and a stop frequency, at most at the run
    /// frequency, all in Hz. The run frequency is limited to the table's highest. Start and stop
    /// frequencies below f0 count as f0, from which a motor starts without a ramp; a run frequency
    /// not above f0 has no ramp at all.
    pub fn new(table: &FrequencyTable, pulses: f64, start_hz: f64, stop_hz: f64, run_hz: f64) -> Self {
        let run_hz = if run_hz < table.top_hz() { run_hz } else { table.top_hz() };
        let constant = |case, hz: f64| Self {
            case,
            acceleration: 0.0,
            cruise: pulses,
            deceleration: 0.0,
            start: table.pulses_to(hz),
            stop: table.pulses_to(hz),
            run_hz: hz,
        };
        let least = table.start_hz();
        let starts_below = start_hz < run_hz && run_hz > least;
        let stops_below = stop_hz < run_hz && run_hz > least;
        if !starts_below && !stops_below {
            return constant(PlanCase::AtRun, run_hz);
        }
        let run = table.pulses_to(run_hz);
        let start = if starts_below { table.pulses_to(start_hz) } else { run };
        let stop = if stops_below { table.pulses_to(stop_hz) } else { run };
        let (acceleration, deceleration) = (run - start, run - stop);
        let cruise = pulses - acceleration - deceleration;
        if cruise >= 0.0 {
            let case = match (starts_below, stops_below) {
                (true, true) => PlanCase::Full,
                (true, false) => PlanCase::SpeedsUp,
                _ => PlanCase::SlowsDown,
            };
            return Self { case, acceleration, cruise, deceleration, start, stop, run_hz };
        }
        // M; if one of the ramps is missing, the other does not fit either.
        let difference = stop - start;
        let magnitude = if difference < 0.0 { -difference } else { difference };
        if magnitude > pulses {
            let slower = if start_hz < stop_hz { start_hz } else { stop_hz };
            return constant(PlanCase::TooShort, if slower > least { slower } else { least });
        }
        let acceleration = 0.5 * (pulses + difference);
        let deceleration = 0.5 * (pulses - difference);
        let run_hz = table.frequency_after(start + acceleration);
        Self { case: PlanCase::NoCruise, acceleration, cruise: 0.0, deceleration, start, stop, run_hz }
    }

    /// Duration of the segment, s.
    pub fn duration_s(&self, table: &FrequencyTable) -> f64 {
        let top = self.start + self.acceleration;
        let ramp = |pulses: f64, from: f64| {
            if pulses > 0.0 { table.time_after(from + pulses) - table.time_after(from) } else { 0.0 }
        };
        let cruise_s = if self.cruise > 0.0 { self.cruise / self.run_hz } else { 0.0 };
        ramp(self.acceleration, self.start) + cruise_s + ramp(self.deceleration, top - self.deceleration)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use proptest::prelude::*;

    fn table() -> FrequencyTable {
        FrequencyTable::new(1_000.0, 10_000.0, 100_000.0).unwrap()
    }

    fn plan(pulses: f64, start: f64, stop: f64, run: f64) -> Plan {
        Plan::new(&table(), pulses, start, stop, run)
    }

    #[test]
    fn the_paper_s_cases() {
        let full = plan(10_000.0, 1_000.0, 1_000.0, 10_000.0);
        assert_eq!(full.case, PlanCase::Full);
        assert!((full.acceleration - 3_300.0).abs() < 1.0 && (full.deceleration - 3_300.0).abs() < 1.0);
        assert!((full.cruise - 3_400.0).abs() < 2.0);
        let short = plan(2_000.0, 1_000.0, 4_000.0, 10_000.0);
        assert_eq!(short.case, PlanCase::NoCruise);
        let difference = table().pulses_to(4_000.0);
        assert!((short.acceleration - (2_000.0 + difference) / 2.0).abs() < 1e-9);
        assert!((short.deceleration - (2_000.0 - difference) / 2.0).abs() < 1e-9);
        assert!(short.run_hz > 4_000.0 && short.run_hz < 10_000.0);
        assert_eq!(plan(9_000.0, 8_000.0, 2_000.0, 5_000.0).case, PlanCase::SlowsDown);
        assert_eq!(plan(9_000.0, 2_000.0, 8_000.0, 5_000.0).case, PlanCase::SpeedsUp);
        assert_eq!(plan(9_000.0, 7_000.0, 8_000.0, 5_000.0).case, PlanCase::AtRun);
        let tiny = plan(10.0, 2_000.0, 8_000.0, 9_000.0);
        assert_eq!((tiny.case, tiny.run_hz), (PlanCase::TooShort, 2_000.0));
        assert_eq!(plan(10.0, 8_000.0, 2_000.0, 9_000.0).run_hz, 2_000.0);
        assert_eq!(plan(10.0, 8_000.0, 500.0, 9_000.0).run_hz, 1_000.0);
    }

    #[test]
    fn below_the_start_frequency_nothing_ramps() {
        let slow = plan(500.0, 0.0, 0.0, 400.0);
        assert_eq!((slow.case, slow.cruise, slow.run_hz), (PlanCase::AtRun, 500.0, 400.0));
        assert!((slow.duration_s(&table()) - 1.25).abs() < 1e-12);
        assert_eq!(plan(0.0, 0.0, 0.0, 5_000.0).cruise + plan(0.0, 0.0, 0.0, 5_000.0).acceleration, 0.0);
    }

    proptest! {
        #[test]
        fn every_pulse_has_its_place(
            pulses in 0.0f64..20_000.0, start in 0.0f64..12_000.0, stop in 0.0f64..12_000.0, run in 1.0f64..15_000.0,
        ) {
            let table = table();
            let plan = Plan::new(&table, pulses, start, stop, run);
            prop_assert!(plan.acceleration >= 0.0 && plan.cruise >= 0.0 && plan.deceleration >= 0.0);
            prop_assert!((plan.acceleration + plan.cruise + plan.deceleration - pulses).abs() <= 1e-9 * (1.0 + pulses));
            prop_assert!(plan.run_hz <= run.min(10_000.0) * (1.0 + 1e-9));
            let seconds = plan.duration_s(&table);
            prop_assert!(seconds.is_finite() && seconds >= pulses / plan.run_hz * (1.0 - 0.02) - 1e-9);
        }
    }
}
