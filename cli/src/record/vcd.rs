//! Step and direction signals as a value change dump (IEEE 1364), for GTKWave and similar viewers.

use std::io::{self, BufWriter, Write};

use ferrostep_planner::TICKS_PER_SECOND;
use ferrostep_printer::Profile;

use super::motor_names::motor_names;
use crate::output::{Output, OutputError};

/// Identifiers of the step signals; the direction signals are the next four.
const STEP_IDS: [char; 4] = ['!', '"', '#', '$'];
const DIRECTION_IDS: [char; 4] = ['%', '&', '\'', '('];

/// Writes the waveform.
pub struct VcdWriter {
    out: BufWriter<Output>,
    error: Option<io::Error>,
    /// Length of a pulse, ns; `None` if each edge steps.
    pulse_ns: Option<u64>,
    /// Levels of the step signals.
    levels: u8,
    /// When the current pulses end, ns, and their axes.
    falling: Option<(u64, u8)>,
    directions: u8,
}

impl VcdWriter {
    /// Declares the signals.
    ///
    /// # Errors
    /// The output cannot be written.
    pub fn new(out: Output, profile: &Profile) -> io::Result<Self> {
        let mut out = BufWriter::with_capacity(1 << 20, out);
        let names = motor_names(profile);
        writeln!(out, "$comment motion clock, idle time left out $end\n$timescale 1 ns $end")?;
        writeln!(out, "$scope module {} $end", profile.name)?;
        for (signal, ids) in [("step", STEP_IDS), ("direction", DIRECTION_IDS)] {
            for (name, id) in names.iter().zip(ids) {
                writeln!(out, "$var wire 1 {id} {signal}_{name} $end")?;
            }
        }
        writeln!(out, "$upscope $end\n$enddefinitions $end\n#0\n$dumpvars")?;
        for id in STEP_IDS.into_iter().chain(DIRECTION_IDS) {
            writeln!(out, "0{id}")?;
        }
        writeln!(out, "$end")?;
        let pulse_ns = (!profile.driver.both_edges).then_some(u64::from(profile.driver.pulse_width_ns));
        Ok(Self { out, error: None, pulse_ns, levels: 0, falling: None, directions: 0 })
    }

    pub(super) fn stepped(&mut self, tick: u64, axes: u8, directions: u8) {
        if self.error.is_none() {
            self.error = self.step(tick, axes, directions).err();
        }
    }

    fn step(&mut self, tick: u64, axes: u8, directions: u8) -> io::Result<()> {
        let now = (u128::from(tick) * 1_000_000_000 / u128::from(TICKS_PER_SECOND)) as u64;
        self.fall()?;
        writeln!(self.out, "#{now}")?;
        let changed = (self.directions ^ directions) & axes;
        self.directions ^= changed;
        // A pulse has ended before the next one begins.
        self.levels ^= axes;
        for motor in 0..4 {
            if changed >> motor & 1 == 1 {
                writeln!(self.out, "{}{}", directions >> motor & 1, DIRECTION_IDS[motor])?;
            }
            if axes >> motor & 1 == 1 {
                writeln!(self.out, "{}{}", self.levels >> motor & 1, STEP_IDS[motor])?;
            }
        }
        self.falling = self.pulse_ns.map(|pulse_ns| (now + pulse_ns, axes));
        Ok(())
    }

    fn fall(&mut self) -> io::Result<()> {
        if let Some((when, axes)) = self.falling.take() {
            self.levels &= !axes;
            writeln!(self.out, "#{when}")?;
            for (_, id) in STEP_IDS.iter().enumerate().filter(|(motor, _)| axes >> motor & 1 == 1) {
                writeln!(self.out, "0{id}")?;
            }
        }
        Ok(())
    }

    pub(super) fn finish(mut self) -> Result<(), OutputError> {
        match self.error.take().map_or_else(|| self.fall(), Err) {
            Ok(()) => Output::keep_buffered(self.out),
            Err(error) => Err(self.out.get_ref().failed(error)),
        }
    }
}
