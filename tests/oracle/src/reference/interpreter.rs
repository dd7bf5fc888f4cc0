//! The minimal G-code interpreter: Marlin's meaning of the commands that move or that
//! change how to move.
//!
//! Known: G0-G4, G10, G11, G20, G21, G28, G90-G92, M82, M83, M201, M203, M204, M205, M207, M208,
//! M220, M221, and the commands that wait for motion to end. All other commands are ignored.

mod settings;

use super::arc::Arc;
use super::decimal::{Decimal, OutOfRange, UNITS_PER_MM};
use super::interpret_error::InterpretError;
use super::job::{EXTRUDER_FRACTIONS_PER_UNIT, Job, Limits, Move, MoveKind};
use super::line::Command;
use super::profile::ReferenceProfile;

/// 25.4 mm in units of 10 nm.
const UNITS_PER_INCH: i64 = 2_540_000;

/// Positions beyond this (10 km) are refused, so that no sum or product overflows.
const POSITION_MAX_10NM: i64 = 1_000_000_000_000;

/// The extruder's total may go as far as 10 000 km.
const EXTRUDER_MAX: i128 = EXTRUDER_FRACTIONS_PER_UNIT * 1_000_000_000_000_000;

/// Marlin's feed until the first F, mm/s.
const INITIAL_FEED_MM_PER_S: f64 = 25.0;

const AXES: [u8; 4] = *b"XYZE";

/// Options for reading a job.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InterpretOptions {
    /// Ignore M201 to M205, so that the profile's limits hold throughout.
    pub without_limits: bool,
}

/// Interprets a whole job from its text.
///
/// # Errors
/// [`InterpretError`] for numbers no machine could mean. Malformed lines are ignored.
pub fn interpret(gcode: &[u8], profile: &ReferenceProfile, options: InterpretOptions) -> Result<Job, InterpretError> {
    let mut state = State::new(profile, options);
    // A line end at the end of the text does not begin another line.
    let text = gcode.strip_suffix(b"\n").unwrap_or(gcode);
    if !gcode.is_empty() {
        for line in text.split(|&byte| byte == b'\n') {
            state.job.lines = state.job.lines.checked_add(1).ok_or(InterpretError::TooManyLines)?;
            if let Some(command) = Command::parse(line) {
                let line = state.job.lines;
                state.execute(&command).map_err(|OutOfRange| InterpretError::OutOfRange { line })?;
            }
        }
    }
    state.job.homed_at_end = state.homing_before;
    state.job.logical_end_10nm = state.logical_10nm();
    Ok(state.job)
}

struct State {
    job: Job,
    options: InterpretOptions,
    limits: Limits,
    size_10nm: [i64; 3],
    lower_end_10nm: [i64; 3],
    home_10nm: [i64; 3],
    home_at_10nm: Option<[i64; 2]>,
    raise_10nm: i64,
    /// A Z that is not homed has been raised to here.
    raised_10nm: Option<i64>,
    /// Machine position without the retraction's lift.
    position_10nm: [i64; 3],
    /// Machine coordinate minus the coordinate the G-code uses, for X, Y, Z.
    offset_10nm: [i64; 3],
    homed: [bool; 3],
    /// The coordinate the G-code uses for E.
    extruder_10nm: i64,
    extruder_total: i128,
    inches: bool,
    relative: bool,
    extruder_relative: bool,
    feed_mm_per_s: f64,
    feed_percent: i64,
    feed_percent_saved: i64,
    flow_percent: i64,
    retraction: Retraction,
    lift_10nm: i64,
    /// The filament that G10 has retracted, until G11.
    retracted_10nm: Option<i64>,
    stop_before: bool,
    homing_before: bool,
}

struct Retraction {
    length_10nm: i64,
    feed_mm_per_s: f64,
    lift_10nm: i64,
    recover_extra_10nm: i64,
    recover_feed_mm_per_s: f64,
}

/// Target of a motion: machine X, Y, Z without lift, and the extruder's total.
struct Target {
    position_10nm: [i64; 3],
    extruder_total: i128,
}

impl State {
    fn new(profile: &ReferenceProfile, options: InterpretOptions) -> Self {
        let limits = Limits {
            max_feed_mm_per_s: profile.max_feed_mm_per_s,
            max_acceleration_mm_per_s2: profile.max_acceleration_mm_per_s2,
            acceleration_mm_per_s2: profile.acceleration_mm_per_s2,
            junction_deviation_mm: profile.junction_deviation_mm,
            corner_velocity_mm_per_s: profile.corner_velocity_mm_per_s,
        };
        let retraction = profile.firmware_retraction;
        Self {
            job: Job::new(limits),
            options,
            limits,
            size_10nm: profile.size_mm.map(units),
            lower_end_10nm: profile.lower_end_mm.map(units),
            home_10nm: profile.home_mm.map(units),
            home_at_10nm: profile.home_at_mm.map(|place| place.map(units)),
            raise_10nm: units(profile.raise_mm),
            raised_10nm: None,
            position_10nm: [0; 3],
            offset_10nm: [0; 3],
            homed: [false; 3],
            extruder_10nm: 0,
            extruder_total: 0,
            inches: false,
            relative: false,
            extruder_relative: false,
            feed_mm_per_s: INITIAL_FEED_MM_PER_S,
            feed_percent: 100,
            feed_percent_saved: 100,
            flow_percent: 100,
            retraction: Retraction {
                length_10nm: units(retraction.length_mm),
                feed_mm_per_s: retraction.retract_mm_per_s,
                lift_10nm: units(retraction.lift_mm),
                recover_extra_10nm: units(retraction.extra_recover_mm),
                recover_feed_mm_per_s: retraction.recover_mm_per_s,
            },
            lift_10nm: 0,
            retracted_10nm: None,
            stop_before: true,
            homing_before: false,
        }
    }

    fn execute(&mut self, command: &Command<'_>) -> Result<(), OutOfRange> {
        match (command.letter, command.number) {
            (b'G', 0 | 1) => self.straight(command)?,
            (b'G', 2 | 3) => self.arc(command)?,
            (b'G', 10) => self.retract()?,
            (b'G', 11) => self.recover()?,
            (b'G', 20) => self.inches = true,
            (b'G', 21) => self.inches = false,
            (b'G', 28) => self.home(command),
            (b'G', 90) => (self.relative, self.extruder_relative) = (false, false),
            (b'G', 91) => (self.relative, self.extruder_relative) = (true, true),
            (b'G', 92) => self.set_coordinates(command)?,
            (b'M', 82) => self.extruder_relative = false,
            (b'M', 83) => self.extruder_relative = true,
            (b'M', 201 | 203 | 204 | 205) if !self.options.without_limits => self.set_limits(command)?,
            (b'M', 207) => self.set_retraction(command)?,
            (b'M', 208) => self.set_recovery(command)?,
            (b'M', 220) => self.set_feed_factor(command)?,
            (b'M', 221) => {
                if let Some(percent) = command.value(b'S')?.map(Decimal::truncated).filter(|percent| *percent >= 0) {
                    self.flow_percent = percent;
                }
            }
            // Dwell, probing, pauses, motors off, filament change, and waits for
            // temperatures, moves or a pin.
            (b'G', 4 | 29 | 30) => self.stop_before = true,
            (b'M', 0 | 1 | 18 | 25 | 84 | 109 | 116 | 190 | 191 | 226 | 303 | 400 | 600) => self.stop_before = true,
            _ => {}
        }
        Ok(())
    }

    /// The position as the G-code counts it, without homing's offset and a retraction's lift.
    fn logical_10nm(&self) -> [i64; 4] {
        let [x, y, z] = self.position_10nm;
        let [offset_x, offset_y, offset_z] = self.offset_10nm;
        [x - offset_x, y - offset_y, z - offset_z, self.extruder_10nm]
    }

    fn length_10nm(&self, value: Decimal) -> Result<i64, OutOfRange> {
        let scale = if self.inches { UNITS_PER_INCH } else { UNITS_PER_MM };
        i64::try_from(value.times_rounded(scale)).map_err(|_| OutOfRange).and_then(in_range)
    }

    fn length_mm(&self, value: Decimal) -> f64 {
        if self.inches { value.to_f64() * 25.4 } else { value.to_f64() }
    }

    /// Applies F (length per minute) if it is present and positive.
    fn take_feed(&mut self, command: &Command<'_>) -> Result<(), OutOfRange> {
        if let Some(feed) = command.value(b'F')?.map(|value| self.length_mm(value) / 60.0).filter(|feed| *feed > 0.0) {
            self.feed_mm_per_s = feed;
        }
        Ok(())
    }

    /// Reads the words of a G0-G3, moves the extruder's coordinate, and returns the target
    /// before soft limits.
    fn target(&mut self, command: &Command<'_>) -> Result<Target, OutOfRange> {
        self.take_feed(command)?;
        let mut position = self.position_10nm;
        for ((coordinate, offset), letter) in position.iter_mut().zip(self.offset_10nm).zip(AXES) {
            if let Some(value) = command.value(letter)? {
                let value = self.length_10nm(value)?;
                *coordinate = in_range(if self.relative { *coordinate + value } else { value + offset })?;
            }
        }
        let mut delta = 0;
        if let Some(value) = command.value(b'E')? {
            let value = self.length_10nm(value)?;
            delta = if self.extruder_relative { value } else { value - self.extruder_10nm };
            self.extruder_10nm = in_range(self.extruder_10nm + delta)?;
        }
        let total = self.extruder_total + i128::from(delta) * i128::from(self.flow_percent);
        Ok(Target { position_10nm: position, extruder_total: extruder_in_range(total)? })
    }

    /// The position with every homed axis clamped to the machine.
    fn clamped(&self, mut position_10nm: [i64; 3]) -> [i64; 3] {
        let travel = self.lower_end_10nm.into_iter().zip(self.size_10nm);
        for ((coordinate, (lower, upper)), homed) in position_10nm.iter_mut().zip(travel).zip(self.homed) {
            if homed {
                *coordinate = (*coordinate).clamp(lower, upper.max(lower));
            }
        }
        position_10nm
    }

    fn feed_with_factor(&self) -> f64 {
        self.feed_mm_per_s * self.feed_percent as f64 / 100.0
    }

    fn straight(&mut self, command: &Command<'_>) -> Result<(), OutOfRange> {
        let target = self.target(command)?;
        let position_10nm = self.clamped(target.position_10nm);
        if position_10nm != target.position_10nm {
            self.job.clamped_moves = self.job.clamped_moves.saturating_add(1);
        }
        self.push(Target { position_10nm, ..target }, MoveKind::Line, self.feed_with_factor());
        Ok(())
    }

    fn arc(&mut self, command: &Command<'_>) -> Result<(), OutOfRange> {
        let extruder_before = self.extruder_10nm;
        let target = self.target(command)?;
        let [x, y, z_start] = self.position_10nm;
        let [x_end, y_end, z_end] = target.position_10nm;
        let arc =
            Arc { start: [x as f64, y as f64], end: [x_end as f64, y_end as f64], clockwise: command.number == 2 };
        let centre = if let Some(radius) = command.value(b'R')? {
            arc.centre_from_radius(self.length_10nm(radius)? as f64)
        } else {
            let mut offset = [0.0; 2];
            for (offset, letter) in offset.iter_mut().zip(*b"IJ") {
                if let Some(value) = command.value(letter)? {
                    *offset = self.length_10nm(value)? as f64;
                }
            }
            arc.centre_from_offset(offset)
        };
        let Some(centre) = centre else {
            // Marlin refuses such an arc and stays where it is.
            self.extruder_10nm = extruder_before;
            return Ok(());
        };
        let extruder_start = self.extruder_total;
        let extruder_delta = target.extruder_total - extruder_start;
        let feed = self.feed_with_factor();
        let mut was_clamped = false;
        for ([x, y], part) in arc.points_between(centre) {
            let z = z_start + ((z_end - z_start) as f64 * part).round() as i64;
            let unclamped = [in_range(x.round() as i64)?, in_range(y.round() as i64)?, z];
            let position_10nm = self.clamped(unclamped);
            was_clamped |= position_10nm != unclamped;
            let extruder_total = extruder_start + (extruder_delta as f64 * part).round() as i128;
            self.push(Target { position_10nm, extruder_total }, MoveKind::ArcChord { last: false }, feed);
        }
        let position_10nm = self.clamped(target.position_10nm);
        was_clamped |= position_10nm != target.position_10nm;
        if was_clamped {
            self.job.clamped_moves = self.job.clamped_moves.saturating_add(1);
        }
        let pushed = self.push(Target { position_10nm, ..target }, MoveKind::ArcChord { last: true }, feed);
        if !pushed
            && let Some(last) = self.job.moves.last_mut()
            && last.line == self.job.lines
        {
            // Clamping reduced the last chord to nothing: the chord before it ends the arc.
            last.kind = MoveKind::ArcChord { last: true };
        }
        Ok(())
    }

    fn retract(&mut self) -> Result<(), OutOfRange> {
        if self.retracted_10nm.is_some() {
            return Ok(());
        }
        let length = self.retraction.length_10nm;
        self.extruder_alone(-length, self.retraction.feed_mm_per_s)?;
        self.retracted_10nm = Some(length);
        self.lift_to(self.retraction.lift_10nm)
    }

    fn recover(&mut self) -> Result<(), OutOfRange> {
        if let Some(length) = self.retracted_10nm {
            self.lift_to(0)?;
            let recovered = length + self.retraction.recover_extra_10nm;
            self.extruder_alone(recovered, self.retraction.recover_feed_mm_per_s)?;
            self.retracted_10nm = None;
        }
        Ok(())
    }

    /// A firmware retraction: neither M220 nor M221 applies, so that G11 undoes what G10 did.
    fn extruder_alone(&mut self, delta_10nm: i64, feed_mm_per_s: f64) -> Result<(), OutOfRange> {
        let total = self.extruder_total + i128::from(delta_10nm) * EXTRUDER_FRACTIONS_PER_UNIT;
        let target = Target { position_10nm: self.position_10nm, extruder_total: extruder_in_range(total)? };
        self.push(target, MoveKind::FirmwareRetraction, feed_mm_per_s);
        Ok(())
    }

    fn lift_to(&mut self, lift_10nm: i64) -> Result<(), OutOfRange> {
        let [x, y, z] = self.position_10nm;
        let start_10nm = [x, y, in_range(z + self.lift_10nm)?];
        let end_10nm = [x, y, in_range(z + lift_10nm)?];
        let [_, _, feed_mm_per_s, _] = self.limits.max_feed_mm_per_s;
        self.lift_10nm = lift_10nm;
        self.push_between(start_10nm, end_10nm, self.extruder_total, MoveKind::FirmwareRetraction, feed_mm_per_s);
        Ok(())
    }

    /// Appends the move to a target; `false` if it displaces nothing.
    fn push(&mut self, target: Target, kind: MoveKind, feed_mm_per_s: f64) -> bool {
        let lifted = |[x, y, z]: [i64; 3]| [x, y, z + self.lift_10nm];
        let (start_10nm, end_10nm) = (lifted(self.position_10nm), lifted(target.position_10nm));
        self.position_10nm = target.position_10nm;
        self.push_between(start_10nm, end_10nm, target.extruder_total, kind, feed_mm_per_s)
    }

    fn push_between(
        &mut self,
        start_10nm: [i64; 3],
        end_10nm: [i64; 3],
        extruder_total: i128,
        kind: MoveKind,
        feed_mm_per_s: f64,
    ) -> bool {
        let extruder_start = std::mem::replace(&mut self.extruder_total, extruder_total);
        if start_10nm == end_10nm && extruder_start == extruder_total {
            return false;
        }
        self.job.moves.push(Move {
            line: self.job.lines,
            kind,
            start_10nm,
            end_10nm,
            extruder_start,
            extruder_end: extruder_total,
            feed_mm_per_s,
            limits: self.job.limits.len() - 1,
            stop_before: std::mem::take(&mut self.stop_before),
            homing_before: std::mem::take(&mut self.homing_before),
        });
        true
    }

    fn home(&mut self, command: &Command<'_>) {
        let all = !b"XYZ".iter().any(|&letter| command.has(letter));
        let home_at = self.home_at_10nm.filter(|_| all || command.has(b'Z'));
        if all || command.has(b'X') || command.has(b'Y') || home_at.is_some() {
            self.raise();
        }
        for (axis, letter) in b"XYZ".iter().enumerate() {
            if all || command.has(*letter) {
                self.position_10nm[axis] = self.home_10nm[axis];
                self.offset_10nm[axis] = 0;
                self.homed[axis] = true;
                if *letter == b'Z' {
                    self.lift_10nm = 0;
                }
            }
        }
        if let Some([x, y]) = home_at {
            (self.position_10nm[0], self.position_10nm[1]) = (x, y);
            self.raise();
        }
        self.stop_before = true;
        self.homing_before = true;
    }

    /// Z goes up to the height that homing wants, if it is lower; one that is not homed
    /// goes up by it, once.
    fn raise(&mut self) {
        let [_, _, z] = &mut self.position_10nm;
        let now = *z + self.lift_10nm;
        let wanted = if self.homed[2] {
            self.raise_10nm.min(self.size_10nm[2])
        } else {
            *self.raised_10nm.get_or_insert(now + self.raise_10nm)
        };
        if self.raise_10nm > 0 {
            *z += (wanted - now).max(0);
        }
    }

    fn set_coordinates(&mut self, command: &Command<'_>) -> Result<(), OutOfRange> {
        for (axis, letter) in b"XYZ".iter().enumerate() {
            if let Some(value) = command.value(*letter)? {
                self.offset_10nm[axis] = in_range(self.position_10nm[axis] - self.length_10nm(value)?)?;
            }
        }
        if let Some(value) = command.value(b'E')? {
            self.extruder_10nm = self.length_10nm(value)?;
        }
        Ok(())
    }
}

/// Profile lengths, which are checked to be finite, in units of 10 nm. The cast saturates.
fn units(length_mm: f64) -> i64 {
    ((length_mm * UNITS_PER_MM as f64).round() as i64).clamp(-POSITION_MAX_10NM, POSITION_MAX_10NM)
}

fn in_range(position_10nm: i64) -> Result<i64, OutOfRange> {
    if position_10nm.abs() <= POSITION_MAX_10NM { Ok(position_10nm) } else { Err(OutOfRange) }
}

fn extruder_in_range(total: i128) -> Result<i128, OutOfRange> {
    if total.abs() <= EXTRUDER_MAX { Ok(total) } else { Err(OutOfRange) }
}
