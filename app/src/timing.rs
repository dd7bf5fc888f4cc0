//! M798: times that the board measures of itself.

use core::cell::RefCell;
use core::fmt;

use ferrostep_gcode::TimingFigures;
use ferrostep_printer::Timing;
use ferrostep_stm32f4::histogram::Summary;
use ferrostep_stm32f4_board::measured::{self, Measured, Switch};

/// Interval at which measured times are logged, ms.
pub const LOG_INTERVAL_MS: u32 = 1000;

/// The measurement switch, as the printer sees it.
pub struct BoardTiming<'a>(RefCell<&'a mut Switch>);

impl<'a> BoardTiming<'a> {
    /// Creates the view of the switch.
    pub fn new(switch: &'a mut Switch) -> Self {
        Self(RefCell::new(switch))
    }
}

impl fmt::Debug for BoardTiming<'_> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("BoardTiming")
    }
}

impl Timing for BoardTiming<'_> {
    fn switch(&self, on: bool) {
        self.0.borrow_mut().set(on);
    }

    fn clear(&self) {
        measured::clear();
    }

    fn figures(&self) -> [TimingFigures; 3] {
        measured::all().map(|Measured { name, unit, summary }| {
            let Summary { count, p50, p99, p99_9, max } = summary;
            TimingFigures { name, count, p50, p99, p99_9, max, unit }
        })
    }
}

/// Logs M798's lines for a debug probe, while times are measured.
pub fn log() {
    if !measured::is_on() {
        return;
    }
    for Measured { name, unit, summary } in measured::all() {
        let Summary { count, p50, p99, p99_9, max } = summary;
        defmt::info!(
            "timing {=str} count:{=u32} p50:{=u32} p99:{=u32} p99.9:{=u32} max:{=u32} unit:{=str}",
            name,
            count,
            p50,
            p99,
            p99_9,
            max,
            unit
        );
    }
}
