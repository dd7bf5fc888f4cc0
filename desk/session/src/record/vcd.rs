//! Step and direction signals as a value change dump (IEEE 1364), for GTKWave and similar viewers.

use std::io::{self, BufWriter, Write};

use ferrostep_planner::{Move, TICKS_PER_SECOND};
use ferrostep_printer::{DriverTiming, Profile};

use super::motor_names::motor_names;
use super::window::{Cut, Window};
use crate::output::{Output, OutputError};

/// Identifiers of the step signals; the direction signals are the next four.
const STEP_IDS: [char; 4] = ['!', '"', '#', '$'];
const DIRECTION_IDS: [char; 4] = ['%', '&', '\'', '('];

/// All motors.
const ALL: u8 = 0b1111;

/// Writes the waveform.
pub struct VcdWriter {
    out: BufWriter<Output>,
    error: Option<io::Error>,
    timing: DriverTiming,
    /// The part of the motion that is written.
    cut: Cut,
    /// True once the part has begun.
    is_open: bool,
    /// The signals' levels.
    levels: Levels,
    /// End of the current pulses, ns, and their axes.
    falling: Option<(u64, u8)>,
    /// The last step's time, ns.
    stepped_ns: u64,
}

/// Levels of all signals, a bit for each motor.
#[derive(Clone, Copy, Default)]
struct Levels {
    steps: u8,
    directions: u8,
}

/// A tick of the motion clock, ns.
fn nanoseconds(tick: u64) -> u64 {
    (u128::from(tick) * 1_000_000_000 / u128::from(TICKS_PER_SECOND)) as u64
}

impl VcdWriter {
    /// Declares the signals.
    ///
    /// # Errors
    /// The output cannot be written.
    pub fn new(out: Output, profile: &Profile, window: Window) -> io::Result<Self> {
        let mut out = BufWriter::with_capacity(1 << 20, out);
        let names = motor_names(profile);
        writeln!(out, "$comment motion clock, idle time left out $end\n$timescale 1 ns $end")?;
        writeln!(out, "$scope module {} $end", profile.name)?;
        for (signal, ids) in [("step", STEP_IDS), ("direction", DIRECTION_IDS)] {
            for (name, id) in names.iter().zip(ids) {
                writeln!(out, "$var wire 1 {id} {signal}_{name} $end")?;
            }
        }
        writeln!(out, "$upscope $end\n$enddefinitions $end")?;
        Ok(Self {
            out,
            error: None,
            timing: profile.driver,
            cut: Cut::new(window),
            is_open: false,
            levels: Levels { steps: 0, directions: profile.driver.inverted & ALL },
            falling: None,
            stepped_ns: 0,
        })
    }

    pub(super) fn planned(&mut self, taken: &Move) {
        self.cut.planned(taken);
    }

    pub(super) fn move_ended(&mut self, tick: u64) {
        self.cut.move_ended(nanoseconds(tick));
    }

    pub(super) fn redefined(&mut self, tick: u64) {
        self.cut.redefined(nanoseconds(tick));
    }

    /// Returns true if the part has a change so far.
    pub(super) fn has_changes(&self) -> bool {
        self.is_open
    }

    pub(super) fn stepped(&mut self, tick: u64, axes: u8, directions: u8) {
        if self.error.is_none() {
            self.error = self.step(tick, axes, directions).err();
        }
    }

    fn step(&mut self, tick: u64, axes: u8, directions: u8) -> io::Result<()> {
        let now_ns = nanoseconds(tick);
        self.cut.stepped(self.falling.map(|(when_ns, _)| when_ns));
        // The levels at the pins: an inverted motor's direction is low where it is high for others.
        let turned = (self.levels.directions ^ directions ^ self.timing.inverted) & axes;
        let fallen_ns = self.fall()?;
        if turned != 0 {
            let levels = Levels { directions: self.levels.directions ^ turned, ..self.levels };
            self.change(self.turn_ns(now_ns, fallen_ns), levels)?;
        }
        // A pulse has ended before the next one begins.
        self.change(now_ns, Levels { steps: self.levels.steps ^ axes, ..self.levels })?;
        let is_pulse = !self.timing.both_edges;
        self.falling = is_pulse.then(|| (now_ns + u64::from(self.timing.pulse_width_ns), axes));
        self.stepped_ns = now_ns;
        Ok(())
    }

    /// The time at which a board changes a direction for a step: with the end of the pulse before;
    /// where both edges step, half way from the step before, or as late as the set-up time allows.
    fn turn_ns(&self, now_ns: u64, fallen_ns: Option<u64>) -> u64 {
        let setup_ns = u64::from(self.timing.direction_setup_ns);
        let interval_ns = now_ns - self.stepped_ns;
        let after_ns = match fallen_ns {
            Some(fallen_ns) => return fallen_ns.min(now_ns),
            None if self.timing.both_edges => (interval_ns / 2).min(interval_ns.saturating_sub(setup_ns)),
            // No pulse has come yet.
            None => interval_ns.saturating_sub(setup_ns),
        };
        self.stepped_ns + after_ns
    }

    /// Ends the pulses under way; the time of it.
    fn fall(&mut self) -> io::Result<Option<u64>> {
        let Some((when_ns, axes)) = self.falling.take() else { return Ok(None) };
        self.change(when_ns, Levels { steps: self.levels.steps & !axes, ..self.levels })?;
        Ok(Some(when_ns))
    }

    /// Changes levels, and writes what differs if it lies in the window.
    fn change(&mut self, when_ns: u64, levels: Levels) -> io::Result<()> {
        if self.cut.contains(when_ns) {
            self.open()?;
            writeln!(self.out, "#{when_ns}")?;
            self.write(
                levels,
                Levels {
                    steps: levels.steps ^ self.levels.steps,
                    directions: levels.directions ^ self.levels.directions,
                },
            )?;
        }
        self.levels = levels;
        Ok(())
    }

    /// Writes all levels at the beginning of the window.
    fn open(&mut self) -> io::Result<()> {
        if !std::mem::replace(&mut self.is_open, true) {
            let begin_ns = self.cut.begin_ns().unwrap_or(self.stepped_ns);
            writeln!(self.out, "#{begin_ns}\n$dumpvars")?;
            self.write(self.levels, Levels { steps: ALL, directions: ALL })?;
            writeln!(self.out, "$end")?;
        }
        Ok(())
    }

    /// Writes the levels of these motors' signals.
    fn write(&mut self, levels: Levels, of: Levels) -> io::Result<()> {
        for (levels, of, ids) in [(levels.directions, of.directions, DIRECTION_IDS), (levels.steps, of.steps, STEP_IDS)]
        {
            for (motor, id) in ids.into_iter().enumerate().filter(|(motor, _)| of >> motor & 1 == 1) {
                writeln!(self.out, "{}{id}", levels >> motor & 1)?;
            }
        }
        Ok(())
    }

    pub(super) fn finish(mut self) -> Result<(), OutputError> {
        // A window without a change also shows the levels.
        let ended = self.error.take().map_or_else(|| self.fall().and_then(|_| self.open()), Err);
        match ended {
            Ok(()) => Output::keep_buffered(self.out),
            Err(error) => Err(self.out.get_ref().failed(error)),
        }
    }
}
