//! Records samples of a chip with a memory: a board's task between the commands and
//! the host's line.

use ferrostep_hal_shim::{AccelerometerChip, AccelerometerFault, WaitingSamples};
use ferrostep_planner::TICKS_PER_SECOND;

use super::{AccelerometerSettings, RecordEvent, RecordFault};
use crate::error::CommandError;

/// Samples over which the chip's rate is measured; over fewer, the beginning and the end of a
/// sample would count too much.
const MEASURED_SAMPLES: u32 = 1000;

/// A chip that takes no sample within this many periods and this time has failed. The time is
/// longer than a chip takes to start.
const SILENT_PERIODS: u64 = 10;
const SILENT_TICKS: u64 = TICKS_PER_SECOND as u64 / 10;

/// A host that takes no line for this long does not want the record.
const UNREAD_TICKS: u64 = 5 * TICKS_PER_SECOND as u64;

/// The rate and the resolution of a recorder that has not been set, as far as the chip has them.
const USUAL_RATE_HZ: u16 = 1600;
const USUAL_RESOLUTION_BITS: u8 = 13;

/// A record under way.
#[derive(Clone, Copy, Debug)]
struct Record {
    samples: u16,
    taken: u16,
    overflows: u32,
    /// True once the host has been informed that it begins.
    is_told: bool,
    /// Samples that the chip has ready, of those that it was asked for last.
    ready: u8,
    /// The last call, and the time from the beginning to it.
    now_ticks: u32,
    elapsed_ticks: u64,
    /// Time when a sample came last, and since when the host takes no line.
    came_ticks: u64,
    unread_since_ticks: Option<u64>,
    /// Time of the first and of the last look at which the chip had taken samples, and
    /// their number then.
    first: Option<(u64, u32)>,
    last: (u64, u32),
}

impl Record {
    const fn new(samples: u16, now_ticks: u32) -> Self {
        Self {
            samples,
            taken: 0,
            overflows: 0,
            is_told: false,
            ready: 0,
            now_ticks,
            elapsed_ticks: 0,
            came_ticks: 0,
            unread_since_ticks: None,
            first: None,
            last: (0, 0),
        }
    }

    fn pass_to(&mut self, now_ticks: u32) {
        self.elapsed_ticks += u64::from(now_ticks.wrapping_sub(self.now_ticks));
        self.now_ticks = now_ticks;
    }

    /// Notes the samples in the chip's memory.
    fn see(&mut self, WaitingSamples { samples, overflowed }: WaitingSamples) {
        self.ready = samples;
        self.overflows += u32::from(overflowed);
        if samples > 0 {
            self.came_ticks = self.elapsed_ticks;
            self.last = (self.elapsed_ticks, u32::from(self.taken) + u32::from(samples));
            self.first.get_or_insert(self.last);
        }
    }

    fn is_silent(&self, rate_hz: u16) -> bool {
        let periods = SILENT_PERIODS * u64::from(TICKS_PER_SECOND) / u64::from(rate_hz.max(1));
        self.elapsed_ticks - self.came_ticks > SILENT_TICKS + periods
    }

    /// Samples a second: measured by the motion clock over a long record, since chips are off by
    /// some percent; else the set rate.
    fn rate_hz(&self, set_hz: u16) -> u16 {
        let (Some((first_ticks, first)), (last_ticks, last)) = (self.first, self.last) else { return set_hz };
        let (samples, ticks) = (last - first, last_ticks - first_ticks);
        if self.overflows > 0 || samples < MEASURED_SAMPLES || ticks == 0 {
            return set_hz;
        }
        let hz = (u64::from(samples) * u64::from(TICKS_PER_SECOND) + ticks / 2) / ticks;
        u16::try_from(hz).unwrap_or(set_hz)
    }

    fn end(&self, set_hz: u16) -> RecordEvent {
        RecordEvent::Ended { rate_hz: self.rate_hz(set_hz), overflows: self.overflows }
    }
}

/// State of the recorder.
#[derive(Clone, Copy, Debug)]
enum State {
    Idle,
    /// A record of this many samples waits for a move.
    Armed(u16),
    Recording(Record),
}

/// The recorder of one chip. Time comes in as ticks of the motion clock, modulo 2^32; it is to
/// be called at least every 40 s while it records, and often enough that the chip's memory
/// does not overflow.
#[derive(Debug)]
pub struct Recorder<C> {
    chip: C,
    settings: AccelerometerSettings,
    state: State,
    /// The end of the record before, until it has been reported.
    ended: Option<RecordEvent>,
}

impl<C: AccelerometerChip> Recorder<C> {
    /// A recorder for a chip that has not been asked yet.
    pub fn new(chip: C) -> Self {
        let settings = AccelerometerSettings::new(&C::TYPE, USUAL_RATE_HZ, USUAL_RESOLUTION_BITS);
        Self { chip, settings, state: State::Idle, ended: None }
    }

    /// Sets rate and resolution, see [`Accelerometer::set`](super::Accelerometer::set).
    ///
    /// # Errors
    /// A value is out of range, or the chip does not answer; the settings are unchanged.
    pub fn set(
        &mut self,
        rate_hz: Option<u16>,
        resolution_bits: Option<u8>,
    ) -> Result<AccelerometerSettings, CommandError> {
        let settings = self.settings.changed(&C::TYPE, rate_hz, resolution_bits)?;
        self.chip.check().map_err(CommandError::Accelerometer)?;
        if rate_hz.is_some() || resolution_bits.is_some() {
            self.end();
        }
        self.settings = settings;
        Ok(settings)
    }

    /// Begins a record, see [`Accelerometer::record`](super::Accelerometer::record).
    ///
    /// # Errors
    /// The chip does not answer; the record before has ended.
    pub fn record(&mut self, samples: u16, at_next_move: bool, now_ticks: u32) -> Result<(), CommandError> {
        self.end();
        if samples == 0 {
            return Ok(());
        }
        let begun = if at_next_move { self.chip.check() } else { self.begin() };
        begun.map_err(CommandError::Accelerometer)?;
        self.state =
            if at_next_move { State::Armed(samples) } else { State::Recording(Record::new(samples, now_ticks)) };
        Ok(())
    }

    /// Returns true if a record waits for a move of X, Y or Z.
    pub const fn awaits_move(&self) -> bool {
        matches!(self.state, State::Armed(_))
    }

    /// The move has begun.
    pub fn move_began(&mut self, now_ticks: u32) {
        let State::Armed(samples) = self.state else { return };
        match self.begin() {
            Ok(()) => self.state = State::Recording(Record::new(samples, now_ticks)),
            Err(fault) => self.fail(RecordFault::Chip(fault)),
        }
    }

    /// The next line of the record, which must have room; `None` if there is no line to send yet.
    pub fn next(&mut self, now_ticks: u32) -> Option<RecordEvent> {
        if let Some(ended) = self.ended.take() {
            return Some(ended);
        }
        let set_hz = self.settings.rate_hz;
        let State::Recording(record) = &mut self.state else { return None };
        record.pass_to(now_ticks);
        record.unread_since_ticks = None;
        if !record.is_told {
            record.is_told = true;
            return Some(RecordEvent::Begun);
        }
        if record.taken == record.samples {
            self.end();
            return self.ended.take();
        }
        if record.ready == 0 {
            match self.chip.waiting() {
                Ok(waiting) => record.see(waiting),
                Err(fault) => return self.failed(RecordFault::Chip(fault)),
            }
            if record.ready == 0 {
                let is_silent = record.is_silent(set_hz);
                return if is_silent { self.failed(RecordFault::Chip(AccelerometerFault::Silent)) } else { None };
            }
        }
        match self.chip.take() {
            Ok(micro_g) => {
                let number = record.taken;
                record.ready -= 1;
                record.taken += 1;
                Some(RecordEvent::Sample { number, micro_g })
            }
            Err(fault) => self.failed(RecordFault::Chip(fault)),
        }
    }

    /// The host's line is full. An unread record ends after a while.
    pub fn wait_for_room(&mut self, now_ticks: u32) {
        let State::Recording(record) = &mut self.state else { return };
        record.pass_to(now_ticks);
        let since_ticks = *record.unread_since_ticks.get_or_insert(record.elapsed_ticks);
        if record.elapsed_ticks - since_ticks > UNREAD_TICKS {
            self.fail(RecordFault::Unread);
        }
    }

    fn begin(&mut self) -> Result<(), AccelerometerFault> {
        self.chip.begin(self.settings.rate_hz, self.settings.resolution_bits)
    }

    /// Ends the record. A record that the host does not know of yet ends silently.
    fn end(&mut self) {
        if let State::Recording(record) = core::mem::replace(&mut self.state, State::Idle) {
            self.chip.end();
            if record.is_told {
                self.ended = Some(record.end(self.settings.rate_hz));
            }
        }
    }

    fn fail(&mut self, fault: RecordFault) {
        self.state = State::Idle;
        self.chip.end();
        self.ended = Some(RecordEvent::Failed(fault));
    }

    fn failed(&mut self, fault: RecordFault) -> Option<RecordEvent> {
        self.fail(fault);
        self.ended.take()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
