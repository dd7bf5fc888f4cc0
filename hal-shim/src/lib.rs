//! The traits through which the printer uses a board.
//!
//! embedded-hal's traits are used where they exist: waits are `embedded_hal_async::delay::DelayNs`.
#![cfg_attr(not(test), no_std)]

mod accelerometer;
pub mod card;
mod servo;

pub use accelerometer::{AccelerometerChip, AccelerometerFault, AccelerometerType, WaitingSamples};
use ferrostep_planner::{Move, StepDigests, StepEntry, StepObserver};
pub use ferrostep_step_player::{DroppedSteps, FeedError, StepLink};
pub use servo::ServoPulses;

/// A heater with its temperature sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Heater {
    /// The hot end.
    Nozzle,
    /// The heated bed.
    Bed,
    /// The chamber: a temperature sensor and, on some machines, a heater.
    Chamber,
    /// The hot end of a second tool.
    Nozzle1,
}

impl Heater {
    /// Number of heaters that a machine may have.
    pub const COUNT: usize = 4;

    /// All heaters, in the order of their index. Every machine has the first two.
    pub const ALL: [Self; Self::COUNT] = [Self::Nozzle, Self::Bed, Self::Chamber, Self::Nozzle1];

    /// Index of the heater in [`Self::ALL`].
    pub const fn index(self) -> usize {
        self as usize
    }

    /// Returns true for a tool's hot end.
    pub const fn is_nozzle(self) -> bool {
        matches!(self, Self::Nozzle | Self::Nozzle1)
    }

    /// Name of the heater in texts: `nozzle`, `bed`, `chamber`, `nozzle1`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Nozzle => "nozzle",
            Self::Bed => "bed",
            Self::Chamber => "chamber",
            Self::Nozzle1 => "nozzle1",
        }
    }
}

/// A board's connector for a heater or thermistor other than the nozzle's and the bed's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpareConnector {
    /// Connector of a second nozzle.
    Nozzle1,
    /// Connector of a third nozzle.
    Nozzle2,
    /// Connector of a fourth nozzle.
    Nozzle3,
    /// Connector of a thermistor next to the probe.
    ProbeThermistor,
    /// Thermistor on the board itself.
    BoardThermistor,
}

impl SpareConnector {
    /// All connectors with a heater output and a thermistor input.
    pub const HEATERS: [Self; 3] = [Self::Nozzle1, Self::Nozzle2, Self::Nozzle3];

    /// All connectors with a thermistor input.
    pub const THERMISTORS: [Self; 5] =
        [Self::Nozzle1, Self::Nozzle2, Self::Nozzle3, Self::ProbeThermistor, Self::BoardThermistor];

    /// Name of the connector in a board file: `nozzle1` ...
    pub const fn name(self) -> &'static str {
        match self {
            Self::Nozzle1 => "nozzle1",
            Self::Nozzle2 => "nozzle2",
            Self::Nozzle3 => "nozzle3",
            Self::ProbeThermistor => "probe",
            Self::BoardThermistor => "board",
        }
    }
}

/// Reason for which a reading gives no temperature.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SensorError {
    /// The circuit is open.
    Open,
    /// The circuit is shorted.
    Shorted,
}

/// A monotonic clock.
pub trait Clock {
    /// Milliseconds since start.
    fn now_ms(&self) -> u64;
}

/// Temperature sensors and heaters.
pub trait ThermalBoard {
    /// Converter reading of a heater's thermistor: the sum of 16 conversions of 12 bits, taken now
    /// or since the previous reading (`ferrostep-thermistor` turns it into a temperature). 0 for a
    /// heater that the machine does not have.
    fn reading(&mut self, heater: Heater) -> u16;
    /// Sets the heater power, 0 to 1; other values are clamped.
    fn set_power(&mut self, heater: Heater, power: f32);
    /// Switches the power supply of heaters, motors and fans; no effect on a board that cannot.
    fn set_supply(&mut self, _on: bool) {}
}

/// A fan output of a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FanOutput {
    /// Output of the part-cooling fan.
    Part,
    /// Output of the hot end's own fan.
    HotEnd,
    /// Third fan output.
    Fan2,
    /// Fourth fan output.
    Fan3,
    /// Fifth fan output.
    Fan4,
    /// Sixth fan output.
    Fan5,
}

impl FanOutput {
    /// Number of outputs that a board may have.
    pub const COUNT: usize = 6;

    /// All outputs, in the order of their index.
    pub const ALL: [Self; Self::COUNT] = [Self::Part, Self::HotEnd, Self::Fan2, Self::Fan3, Self::Fan4, Self::Fan5];

    /// Index of the output in [`Self::ALL`].
    pub const fn index(self) -> usize {
        self as usize
    }

    /// Name of the output in a board file: `part`, `hotend`, `fan2` to `fan5`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Part => "part",
            Self::HotEnd => "hotend",
            Self::Fan2 => "fan2",
            Self::Fan3 => "fan3",
            Self::Fan4 => "fan4",
            Self::Fan5 => "fan5",
        }
    }
}

/// The fans. Setting one that a board lacks has no effect.
pub trait Fans {
    /// Sets the power of a fan, 0 to 255.
    fn set_fan_power(&mut self, fan: FanOutput, power: u8);
    /// Pulses counted so far from a fan's tachometer, modulo 2^16: two per turn. `None` if the
    /// board has no tachometer.
    fn tachometer(&self, _fan: FanOutput) -> Option<u16> {
        None
    }
}

/// The queue of step entries, seen from the planner, which fills it; the step interrupt empties it.
pub trait StepQueue {
    /// Number of slots filled so far, modulo 2^32. The newest event is not in a slot yet.
    fn queued(&self) -> u32;
    /// Number of slots played so far, modulo 2^32.
    fn played(&self) -> u32;
    /// Number of slots waiting or being played, including the newest event.
    fn waiting(&self) -> usize;
    /// Minimum number of further entries that fit.
    fn room(&self) -> usize;
    /// Adds an entry.
    ///
    /// # Errors
    /// The entry does not fit, or comes too soon after the one before; the queue is unchanged.
    fn push(&mut self, entry: StepEntry) -> Result<(), FeedError>;
    /// Adds entries. A queue may do this at a lower cost than one by one.
    ///
    /// # Errors
    /// As [`Self::push`]; the entries before the refused one were added.
    #[inline]
    fn push_all(&mut self, entries: &[StepEntry]) -> Result<(), FeedError> {
        entries.iter().try_for_each(|entry| self.push(*entry))
    }
    /// Ends the motion with the newest entry.
    fn seal(&mut self);
    /// Starts the interrupt, unless it is already playing the queue.
    fn start(&mut self);
    /// The flags shared with the interrupt.
    fn link(&self) -> &StepLink;
    /// Steps of X, Y, Z (A, B, Z) and the extruder that are queued but not yet made by the motors,
    /// forwards minus backwards.
    fn unplayed_steps(&self) -> [i32; 4];
    /// Stops all motors before their next step; [`Self::drop_all`] must follow.
    fn request_stop(&mut self);
    /// Drops the unplayed entries after a stop, and returns their steps. Motion may start again.
    fn drop_all(&mut self) -> DroppedSteps;
    /// Timer updates that the interrupt has missed since the last call because it was held up for
    /// longer than an interval. No step is lost; all later steps are delayed by that much.
    fn take_missed_updates(&mut self) -> u32;
}

/// The sensors that axes home with: end stops, a probe, the drivers' stall signals.
pub trait HomingSensors: StepQueue {
    /// Returns true if the sensor of X (0), Y (1) or Z (2) is triggered.
    fn is_sensor_triggered(&self, axis: usize) -> bool;
    /// Stops motion from now on when the sensor of this axis triggers
    /// ([`StepLink::request_sensor_stop`]); with `None` at no sensor.
    fn watch_sensor(&mut self, axis: Option<usize>);
    /// Adds an entry of a move towards the watched sensor. A real sensor stops the motors when it
    /// triggers, so the whole entry is added. A model knows in advance at which event it triggers,
    /// and adds the events up to that one.
    ///
    /// # Errors
    /// As [`StepQueue::push`].
    fn push_towards_sensor(&mut self, entry: StepEntry) -> Result<Approach, FeedError> {
        self.push(entry)?;
        Ok(Approach { added: Some(entry), triggered: false })
    }
    /// Sends pulses to a probe whose pin is moved by a servo signal; they replace those not yet
    /// sent. No effect on a board without such an output: the build refuses a profile that needs
    /// one.
    fn send_servo_pulses(&mut self, _pulses: ServoPulses) {}
    /// Returns true if all servo pulses have been sent, and the pause after the last one has
    /// passed.
    fn are_servo_pulses_sent(&self) -> bool {
        true
    }
}

/// The result of adding an entry of a move towards a sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Approach {
    /// Part of the entry that was added.
    pub added: Option<StepEntry>,
    /// True if the sensor triggers at the end of that part: the move ends there.
    pub triggered: bool,
}

/// A clock that measures how long planning takes.
pub trait PlanningClock {
    /// Current time in ticks of the nominal time base, modulo 2^32. `None` without a clock:
    /// planning is then assumed to keep up.
    fn now_ticks(&self) -> Option<u32> {
        None
    }
    /// Marks the beginning of a portion of planning.
    fn planning_begins(&mut self) {}
    /// Marks the end of the portion.
    fn planning_ends(&mut self) {}
}

/// Observes the motion in ticks of the motion clock. As a [`StepObserver`] it sees every step when
/// the step is queued. A queue for real motors needs only the digests.
pub trait MotionWatch: StepObserver {
    /// True if the position of the pushed filament is tracked, for a filament motion sensor.
    const FOLLOWS_FILAMENT: bool = true;

    /// True if a switch may accompany the filament motion sensor.
    const HAS_FILAMENT_SWITCH: bool = true;
    /// Digests of the steps so far. A board digests steps when they are queued, virtual motors when
    /// they make them.
    fn digests(&self) -> StepDigests;
    /// Notes that a move was taken. `slowed_moves`: how many moves so far were slowed because the
    /// board could not keep up with them; a block is slowed when the move after it has been taken,
    /// or when it is full.
    fn move_taken(&mut self, _taken: &Move, _slowed_moves: u64) {}
    /// Notes that a move of this source line ends at this tick, after the entries added so far.
    fn move_ended(&mut self, _tick: u64, _line: u32) {}
    /// Notes that the motors are at rest, that all motion has been played or dropped, and that the
    /// motion clock continues from this tick.
    fn stands_at(&mut self, _tick: u64) {}
    /// Notes, at standstill, that homing sets the motor positions as of this tick.
    fn redefined(&mut self, _tick: u64, _motor_steps: [i64; 4]) {}
}

/// The motors' enable signals.
pub trait MotorEnable {
    /// Switches the motors in the mask on or off.
    fn set_motors_enabled(&mut self, motors: u8, enabled: bool);
    /// Selects the Z motors that make the next steps; the others stand still. Bit 0 is the axis's
    /// first motor. At standstill only; [`StepQueue::drop_all`] selects all of them again. No
    /// effect if Z has one motor.
    fn step_z_motors(&mut self, _motors: u8) {}
    /// Selects the extruder that makes the next steps, by its tool number; the others stand still
    /// at their present current. At standstill only; [`StepQueue::drop_all`] keeps the selection.
    /// No effect with a single extruder.
    fn step_extruder(&mut self, _tool: u8) {}
}

/// All parts of a board that produce motion.
pub trait StepOutput: HomingSensors + PlanningClock + MotorEnable + MotionWatch {}

impl<Q: HomingSensors + PlanningClock + MotorEnable + MotionWatch> StepOutput for Q {}
