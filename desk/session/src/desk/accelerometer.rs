//! An accelerometer on the desk: the frame's model, shaken by the motors' steps, and the chip
//! that samples it.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::f64::consts::TAU;
use std::rc::Rc;

use ferrostep_adxl345::TYPE;
use ferrostep_planner::{Geometry, StepObserver, TICKS_PER_SECOND};
use ferrostep_printer::{Accelerometer, AccelerometerSettings, CommandError, RecordEvent};
use ferrostep_simulator::frame::Mode;
use ferrostep_simulator::motion::Motion;

use crate::record::Observer;

/// Standard gravity, mm/s^2.
const GRAVITY_MM_PER_S2: f64 = 9806.65;

/// The range of an ADXL345, by its data sheet, and the samples that wait in its memory.
const RANGE_MICRO_G: i32 = 16_000_000;
const WAITING_SAMPLES: usize = 32;

/// Noise at any rate, as the standard deviation: about one and a half units of the finest
/// resolution, 3.9 mg.
const NOISE_MICRO_G: f64 = 6_000.0;

/// A record under way.
#[derive(Debug)]
struct Record {
    samples: u16,
    taken: u16,
    overflows: u32,
    /// Tick of its beginning; `None` while it waits for a move.
    since_tick: Option<u64>,
}

/// Frame, chip and time, which is that of the board in ticks of the motion clock.
#[derive(Debug)]
struct State {
    geometry: Geometry,
    /// Steps since the start.
    motor_steps: [i64; 3],
    /// Commanded motion of X and Y, mm.
    command: [Motion; 2],
    frame: [Mode; 2],
    tick: u64,
    /// Lead of the board's time over the motion clock, which stops between motions;
    /// ticks, modulo 2^64.
    ahead_ticks: u64,
    settings: AccelerometerSettings,
    record: Option<Record>,
    waiting: VecDeque<RecordEvent>,
    random: u64,
}

impl State {
    /// A share of 1 that looks random (Marsaglia 2003).
    fn share(&mut self) -> f64 {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        (self.random >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// A number of the normal distribution (Box and Muller 1958).
    fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.share()).ln()).sqrt() * (TAU * self.share()).cos()
    }

    /// Simulates the frame up to a tick.
    fn swing_to(&mut self, tick: u64) {
        let time_s = tick.saturating_sub(self.tick) as f64 / f64::from(TICKS_PER_SECOND);
        for (mode, command) in self.frame.iter_mut().zip(self.command) {
            mode.advance(time_s, command);
        }
        self.tick = self.tick.max(tick);
    }

    /// Advances time to a tick, and takes the samples that are due.
    fn pass_to(&mut self, tick: u64) {
        while let Some(Record { samples, taken, since_tick: Some(since_tick), overflows }) = self.record {
            if taken == samples {
                self.end();
                break;
            }
            let due = since_tick + u64::from(taken) * u64::from(TICKS_PER_SECOND) / u64::from(self.settings.rate_hz);
            if due > tick {
                break;
            }
            self.swing_to(due);
            let micro_g = self.sample();
            // One place stays free for the last line.
            let is_lost = self.waiting.len() >= WAITING_SAMPLES;
            if !is_lost {
                self.waiting.push_back(RecordEvent::Sample { number: taken, micro_g });
            }
            let overflows = overflows + u32::from(is_lost);
            self.record = Some(Record { samples, taken: taken + 1, since_tick: Some(since_tick), overflows });
        }
        self.swing_to(tick);
    }

    /// Returns what the chip measures now, micro-g.
    fn sample(&mut self) -> [i32; 3] {
        let unit = (2 * RANGE_MICRO_G) >> self.settings.resolution_bits;
        let [x, y] = [0, 1].map(|axis: usize| self.frame[axis].acceleration_mm_per_s2(self.command[axis]));
        [x, y, GRAVITY_MM_PER_S2].map(|mm_per_s2| {
            let micro_g = mm_per_s2 / GRAVITY_MM_PER_S2 * 1e6 + NOISE_MICRO_G * self.normal();
            let units = (micro_g / f64::from(unit)).round() as i32;
            units.saturating_mul(unit).clamp(-RANGE_MICRO_G, RANGE_MICRO_G - unit)
        })
    }

    /// Ends the record.
    fn end(&mut self) {
        if let Some(Record { overflows, since_tick: Some(_), .. }) = self.record.take() {
            self.waiting.push_back(RecordEvent::Ended { rate_hz: self.settings.rate_hz, overflows });
        }
    }

    fn begin(&mut self, tick: u64) {
        if let Some(record) = &mut self.record {
            record.since_tick = Some(tick);
            self.waiting.push_back(RecordEvent::Begun);
        }
    }

    /// Motors step.
    fn stepped(&mut self, motion_tick: u64, axes: u8, directions: u8) {
        if axes & 0b111 == 0 {
            return;
        }
        let tick = motion_tick.wrapping_add(self.ahead_ticks).max(self.tick);
        if matches!(self.record, Some(Record { since_tick: None, .. })) {
            self.begin(tick);
        }
        self.pass_to(tick);
        for (motor, steps) in self.motor_steps.iter_mut().enumerate() {
            if axes >> motor & 1 == 1 {
                *steps += if directions >> motor & 1 == 1 { -1 } else { 1 };
            }
        }
        let [x, y, _] = self.geometry.position_10nm(self.motor_steps);
        self.command = [x, y].map(|units| Motion::standing(units as f64 / 100_000.0));
    }
}

/// The accelerometer: an ADXL345 on a frame with one mode along X and one along Y.
#[derive(Debug)]
pub struct DeskAccelerometer(RefCell<State>);

impl DeskAccelerometer {
    /// An accelerometer on a frame at rest, whose motors are those of a geometry.
    pub fn new(geometry: Geometry, frame: [Mode; 2]) -> Self {
        Self(RefCell::new(State {
            geometry,
            motor_steps: [0; 3],
            command: [Motion::standing(0.0); 2],
            frame,
            tick: 0,
            ahead_ticks: 0,
            settings: AccelerometerSettings::new(&TYPE, 1600, 13),
            record: None,
            waiting: VecDeque::new(),
            random: 0x9E37_79B9_7F4A_7C15,
        }))
    }

    /// The board's time, in ticks, at which the motion clock has come to a tick.
    pub fn set_time(&self, board_tick: u64, motion_tick: u64) {
        self.0.borrow_mut().ahead_ticks = board_tick.wrapping_sub(motion_tick);
    }

    /// Advances time to a tick of the board's time.
    pub fn pass_to(&self, board_tick: u64) {
        self.0.borrow_mut().pass_to(board_tick);
    }

    /// Takes the next event of the record.
    pub fn take_event(&self) -> Option<RecordEvent> {
        self.0.borrow_mut().waiting.pop_front()
    }
}

impl Accelerometer for DeskAccelerometer {
    fn set(&self, rate_hz: Option<u16>, resolution_bits: Option<u8>) -> Result<AccelerometerSettings, CommandError> {
        let mut state = self.0.borrow_mut();
        let settings = state.settings.changed(&TYPE, rate_hz, resolution_bits)?;
        if rate_hz.is_some() || resolution_bits.is_some() {
            state.end();
        }
        state.settings = settings;
        Ok(settings)
    }

    fn record(&self, samples: u16, at_next_move: bool) -> Result<(), CommandError> {
        let mut state = self.0.borrow_mut();
        state.end();
        if samples > 0 {
            state.record = Some(Record { samples, taken: 0, overflows: 0, since_tick: None });
            if !at_next_move {
                let tick = state.tick;
                state.begin(tick);
            }
        }
        Ok(())
    }
}

/// Passes the motors' steps to an accelerometer, if there is one.
#[derive(Clone, Debug, Default)]
pub struct Tap(pub Option<Rc<DeskAccelerometer>>);

impl StepObserver for Tap {
    #[inline]
    fn stepped(&mut self, tick: u64, axes: u8, directions: u8) {
        if let Some(accelerometer) = &self.0 {
            accelerometer.0.borrow_mut().stepped(tick, axes, directions);
        }
    }
}

impl Observer for Tap {
    /// Homing renames places and moves nothing.
    fn redefined(&mut self, _tick: u64, _motor_steps: [i64; 4]) {}
    fn move_ended(&mut self, _tick: u64, _line: u32) {}
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
