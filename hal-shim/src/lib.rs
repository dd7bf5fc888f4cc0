//! The traits that the printer needs of a board.
//!
//! embedded-hal's traits are used where they exist: waits are `embedded_hal_async::delay::DelayNs`.
#![cfg_attr(not(test), no_std)]

use ferrostep_planner::StepEntry;
use ferrostep_step_player::{DroppedSteps, FeedError, StepLink};

/// A heater with its thermometer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Heater {
    /// The hot end.
    Nozzle,
    /// The heated bed.
    Bed,
}

impl Heater {
    /// All heaters, in the order of their index.
    pub const ALL: [Self; 2] = [Self::Nozzle, Self::Bed];

    /// 0 for the nozzle, 1 for the bed.
    pub const fn index(self) -> usize {
        match self {
            Self::Nozzle => 0,
            Self::Bed => 1,
        }
    }

    /// What a person calls it: `nozzle`, `bed`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Nozzle => "nozzle",
            Self::Bed => "bed",
        }
    }
}

/// Why a reading is no temperature.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SensorError {
    /// Its circuit is open.
    Open,
    /// Its circuit is shorted.
    Shorted,
}

/// Time that never goes back.
pub trait Clock {
    /// Milliseconds since start.
    fn now_ms(&self) -> u64;
}

/// Thermometers and heaters.
pub trait ThermalBoard {
    /// What the converter reads at a heater's thermistor: the sum of 16 conversions of 12 bits, taken now or since the
    /// reading before (`ferrostep-thermistor` makes a temperature of it).
    fn reading(&mut self, heater: Heater) -> u16;
    /// Heater power from 0 to 1; anything else is cut to that.
    fn set_power(&mut self, heater: Heater, power: f32);
}

/// The fans. A board may lack either; setting it has no effect then.
pub trait Fans {
    /// Power of the part-cooling fan, 0 to 255.
    fn set_fan_power(&mut self, power: u8);
    /// Switches the hot end's own fan.
    fn set_hotend_fan(&mut self, on: bool);
}

/// The queue of step entries, seen from the side that fills it, and the interrupt that empties it.
pub trait StepOutput: MotorEnable {
    /// Number of slots that entries have filled so far, modulo 2^32. The newest event is not in one yet.
    fn queued(&self) -> u32;
    /// How many of them have been played, modulo 2^32.
    fn played(&self) -> u32;
    /// Slots that wait to be played, or are being played, the newest event included.
    fn waiting(&self) -> usize;
    /// How many more fit at least.
    fn room(&self) -> usize;
    /// Adds an entry.
    ///
    /// # Errors
    /// It does not fit, or comes too soon after the one before; nothing was added.
    fn push(&mut self, entry: StepEntry) -> Result<(), FeedError>;
    /// Adds entries. A queue may do so at a lower cost than one by one.
    ///
    /// # Errors
    /// As [`Self::push`]; the entries before the one that is meant were added.
    #[inline]
    fn push_all(&mut self, entries: &[StepEntry]) -> Result<(), FeedError> {
        entries.iter().try_for_each(|entry| self.push(*entry))
    }
    /// The motion ends with the newest entry.
    fn seal(&mut self);
    /// Lets the interrupt play what is queued, unless it does.
    fn start(&mut self);
    /// The flags shared with the interrupt.
    fn link(&self) -> &StepLink;
    /// From now on no motor steps; [`Self::drop_all`] must follow.
    fn request_stop(&mut self);
    /// After a stop: forgets what has not been played, and says what it was. Motion may start again.
    fn drop_all(&mut self) -> DroppedSteps;
    /// Updates of its timer that the interrupt has missed since the last call, because it was held up for longer than an
    /// interval. No step is lost with them: all later ones come that much later.
    fn take_missed_updates(&mut self) -> u32;

    /// Whether the board has sensors that axes home with. Without, the machine's counting motors tell where they would be.
    const HAS_SENSORS: bool = false;

    /// Whether the sensor of an axis is triggered.
    fn is_sensor_triggered(&self, _axis: usize) -> bool {
        false
    }
    /// From now on motion stops when the sensor of this axis triggers ([`StepLink::request_sensor_stop`]); `None`: at
    /// no sensor any more.
    fn watch_sensor(&mut self, _axis: Option<usize>) {}

    /// A clock that runs all the time, ticks of the nominal time base modulo 2^32: with it the machine knows how long
    /// planning takes. `None` where there is none, and then planning is taken to keep up.
    fn now_ticks(&self) -> Option<u32> {
        None
    }

    /// A portion of planning begins. A queue that measures how long planning takes notes the time; others need not
    /// care.
    fn planning_begins(&mut self) {}
    /// The last entry of a move has been planned, within the present portion.
    fn move_planned(&mut self) {}
    /// The portion has ended.
    fn planning_ends(&mut self) {}
}

/// The motors' enable signals.
pub trait MotorEnable {
    /// Switches the motors in the mask on or off.
    fn set_motors_enabled(&mut self, axes: u8, enabled: bool);
}

/// End stops and probe.
pub trait EndStops {
    /// Whether the sensor that homes X (0), Y (1) or Z (2) is triggered.
    fn is_triggered(&self, axis: usize) -> bool;
}
