//! The traits that the printer needs of a board.
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

/// A heater with its thermometer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Heater {
    /// The hot end.
    Nozzle,
    /// The heated bed.
    Bed,
    /// The chamber: its thermometer, and the heater that some have.
    Chamber,
    /// The hot end of a second tool.
    Nozzle1,
}

impl Heater {
    /// Number of heaters that a machine may have.
    pub const COUNT: usize = 4;

    /// All heaters, in the order of their index. Every machine has the first two.
    pub const ALL: [Self; Self::COUNT] = [Self::Nozzle, Self::Bed, Self::Chamber, Self::Nozzle1];

    /// The heater's place in [`Self::ALL`].
    pub const fn index(self) -> usize {
        self as usize
    }

    /// Returns true if it is the hot end of a tool.
    pub const fn is_nozzle(self) -> bool {
        matches!(self, Self::Nozzle | Self::Nozzle1)
    }

    /// The heater's name in texts: `nozzle`, `bed`, `chamber`, `nozzle1`.
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
    /// A second nozzle's.
    Nozzle1,
    /// A third nozzle's.
    Nozzle2,
    /// A fourth nozzle's.
    Nozzle3,
    /// A thermistor beside the probe.
    ProbeThermistor,
    /// A thermistor on the board.
    BoardThermistor,
}

impl SpareConnector {
    /// All that have a heater's output and a thermistor's input.
    pub const HEATERS: [Self; 3] = [Self::Nozzle1, Self::Nozzle2, Self::Nozzle3];

    /// All that have a thermistor's input.
    pub const THERMISTORS: [Self; 5] =
        [Self::Nozzle1, Self::Nozzle2, Self::Nozzle3, Self::ProbeThermistor, Self::BoardThermistor];

    /// The connector's name in a board's file: `nozzle1` ...
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

/// Reason why a reading gives no temperature.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SensorError {
    /// The circuit is open.
    Open,
    /// The circuit is shorted.
    Shorted,
}

/// Time that never goes back.
pub trait Clock {
    /// Milliseconds since start.
    fn now_ms(&self) -> u64;
}

/// Thermometers and heaters.
pub trait ThermalBoard {
    /// The converter's reading of a heater's thermistor: the sum of 16 conversions of 12 bits,
    /// taken now or since the reading before (`ferrostep-thermistor` makes a temperature of it). 0
    /// for a heater that the machine does not have.
    fn reading(&mut self, heater: Heater) -> u16;
    /// Heater power from 0 to 1; anything else is cut to that.
    fn set_power(&mut self, heater: Heater, power: f32);
    /// Switches the power supply of heaters, motors and fans; without effect on a
    /// board that cannot.
    fn set_supply(&mut self, _on: bool) {}
}

/// A board's output for a fan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FanOutput {
    /// The part-cooling fan's.
    Part,
    /// The hot end's own fan's.
    HotEnd,
    /// A third one.
    Fan2,
    /// A fourth one.
    Fan3,
    /// A fifth one.
    Fan4,
    /// A sixth one.
    Fan5,
}

impl FanOutput {
    /// Number of outputs that a board may have.
    pub const COUNT: usize = 6;

    /// All outputs, in the order of their index.
    pub const ALL: [Self; Self::COUNT] = [Self::Part, Self::HotEnd, Self::Fan2, Self::Fan3, Self::Fan4, Self::Fan5];

    /// The output's place in [`Self::ALL`].
    pub const fn index(self) -> usize {
        self as usize
    }

    /// The output's name in a board's file: `part`, `hotend`, `fan2` to `fan5`.
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
    /// Power of a fan, 0 to 255.
    fn set_fan_power(&mut self, fan: FanOutput, power: u8);
    /// Pulses that a fan's tachometer has given so far, modulo 2^16: two a turn. `None` where the
    /// board has no tachometer.
    fn tachometer(&self, _fan: FanOutput) -> Option<u16> {
        None
    }
}

/// The queue of step entries, seen from the planner, which fills it; the step interrupt empties it.
pub trait StepQueue {
    /// Number of slots that entries have filled so far, modulo 2^32. The newest event is
    /// not in a slot yet.
    fn queued(&self) -> u32;
    /// Number of slots that have been played so far, modulo 2^32.
    fn played(&self) -> u32;
    /// Slots that wait to be played, or are being played, the newest event included.
    fn waiting(&self) -> usize;
    /// Minimum number of further entries that fit.
    fn room(&self) -> usize;
    /// Adds an entry.
    ///
    /// # Errors
    /// The entry does not fit, or comes too soon after the one before; the queue is unchanged.
    fn push(&mut self, entry: StepEntry) -> Result<(), FeedError>;
    /// Adds entries. A queue may do so at a lower cost than one by one.
    ///
    /// # Errors
    /// As [`Self::push`]; the entries before the refused one were added.
    #[inline]
    fn push_all(&mut self, entries: &[StepEntry]) -> Result<(), FeedError> {
        entries.iter().try_for_each(|entry| self.push(*entry))
    }
    /// The motion ends with the newest entry.
    fn seal(&mut self);
    /// Starts the interrupt, unless it already plays the queue.
    fn start(&mut self);
    /// The flags shared with the interrupt.
    fn link(&self) -> &StepLink;
    /// Steps of X, Y, Z (A, B, Z) and the extruder that it holds and the motors have not made,
    /// forwards minus backwards.
    fn unplayed_steps(&self) -> [i32; 4];
    /// Stops all motors before their next step; [`Self::drop_all`] must follow.
    fn request_stop(&mut self);
    /// Forgets, after a stop, the entries that have not been played, and returns their steps.
    /// Motion may start again.
    fn drop_all(&mut self) -> DroppedSteps;
    /// Updates of its timer that the interrupt has missed since the last call, because it was
    /// held up for longer than an interval. No step is lost with them: all later ones come
    /// that much later.
    fn take_missed_updates(&mut self) -> u32;
}

/// The sensors that axes home with: end stops, a probe, the drivers' stall signals.
pub trait HomingSensors: StepQueue {
    /// Returns true if the sensor of X (0), Y (1) or Z (2) is triggered.
    fn is_sensor_triggered(&self, axis: usize) -> bool;
    /// Stops motion from now on when the sensor of this axis triggers
    /// ([`StepLink::request_sensor_stop`]); `None`: at no sensor.
    fn watch_sensor(&mut self, axis: Option<usize>);
    /// Adds an entry of a move towards the watched sensor. A real sensor stops the motors when it
    /// triggers, so the whole entry is added. A model knows beforehand at which event it triggers,
    /// and adds the events up to that one.
    ///
    /// # Errors
    /// As [`StepQueue::push`].
    fn push_towards_sensor(&mut self, entry: StepEntry) -> Result<Approach, FeedError> {
        self.push(entry)?;
        Ok(Approach { added: Some(entry), triggered: false })
    }
    /// Sends pulses to the probe whose pin a servo's signal moves; they replace those that have
    /// not been sent. Without effect on a board that has no such output: the build refuses a
    /// profile that needs it.
    fn send_servo_pulses(&mut self, _pulses: ServoPulses) {}
    /// Returns true if all of them have been sent, and the pause after the last one has passed.
    fn are_servo_pulses_sent(&self) -> bool {
        true
    }
}

/// The result of adding an entry of a move towards a sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Approach {
    /// The part of it that was added.
    pub added: Option<StepEntry>,
    /// The sensor triggers at its end: the move ends there.
    pub triggered: bool,
}

/// A clock that measures how long planning takes.
pub trait PlanningClock {
    /// The present time, ticks of the nominal time base modulo 2^32. `None` without a clock: then
    /// planning is taken to keep up.
    fn now_ticks(&self) -> Option<u32> {
        None
    }
    /// A portion of planning begins.
    fn planning_begins(&mut self) {}
    /// The portion has ended.
    fn planning_ends(&mut self) {}
}

/// Observes the motion in ticks of the motion clock. As [`StepObserver`] it sees every step as it
/// is queued. A queue to real motors needs only the digests.
pub trait MotionWatch: StepObserver {
    /// True if the position of the pushed filament is followed, for a sensor that sees it move.
    const FOLLOWS_FILAMENT: bool = true;

    /// True if a switch may accompany that sensor.
    const HAS_FILAMENT_SWITCH: bool = true;
    /// Digests of the steps so far. A board digests them as they are queued; virtual motors
    /// as they make them.
    fn digests(&self) -> StepDigests;
    /// A move was taken. `slowed_moves`: how many of all moves were slowed because the board
    /// could not keep up with them; a block is slowed when the move after it has been taken, or
    /// when it is full.
    fn move_taken(&mut self, _taken: &Move, _slowed_moves: u64) {}
    /// Notes that a move of this source line ends at this tick, after the entries added so far.
    fn move_ended(&mut self, _tick: u64, _line: u32) {}
    /// Notes that the motors are at rest, that all motion has been played or dropped, and that the
    /// motion clock continues from this tick.
    fn stands_at(&mut self, _tick: u64) {}
    /// Notes, at standstill, that homing sets the motors' positions, as of this tick.
    fn redefined(&mut self, _tick: u64, _motor_steps: [i64; 4]) {}
}

/// The motors' enable signals.
pub trait MotorEnable {
    /// Switches the motors in the mask on or off.
    fn set_motors_enabled(&mut self, motors: u8, enabled: bool);
    /// Selects the motors of Z that make the next steps; the others stand still. Bit 0 is the
    /// axis's first motor. At standstill only; [`StepQueue::drop_all`] selects all of them again.
    /// Without effect where Z has one motor.
    fn step_z_motors(&mut self, _motors: u8) {}
    /// Selects the extruder that makes the next steps, by its tool; the others stand still, with
    /// the current that they have. At standstill only; [`StepQueue::drop_all`] keeps the selection.
    /// Without effect with a single extruder.
    fn step_extruder(&mut self, _tool: u8) {}
}

/// All parts of a board that make motion.
pub trait StepOutput: HomingSensors + PlanningClock + MotorEnable + MotionWatch {}

impl<Q: HomingSensors + PlanningClock + MotorEnable + MotionWatch> StepOutput for Q {}
