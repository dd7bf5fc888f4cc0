//! M201 to M205, M207, M208 and M220: settings for the moves to come.

use super::{AXES, State};
use crate::reference::decimal::{Decimal, OutOfRange};
use crate::reference::line::Command;

/// Marlin refuses junction deviations outside of these, mm.
const JUNCTION_DEVIATION_MM: std::ops::RangeInclusive<f64> = 0.01..=0.3;

impl State {
    pub(super) fn set_limits(&mut self, command: &Command<'_>) -> Result<(), OutOfRange> {
        // A limit of 0 would stop the machine for good: only positive values are accepted.
        let value = |letter| -> Result<Option<f64>, OutOfRange> {
            Ok(command.value(letter)?.map(|value| self.length_mm(value)).filter(|value| *value > 0.0))
        };
        let mut limits = self.limits;
        match command.number {
            201 | 203 => {
                let values = if command.number == 201 {
                    &mut limits.max_acceleration_mm_per_s2
                } else {
                    &mut limits.max_feed_mm_per_s
                };
                for (limit, letter) in values.iter_mut().zip(AXES) {
                    *limit = value(letter)?.unwrap_or(*limit);
                }
            }
            204 => {
                let accelerations = &mut limits.acceleration_mm_per_s2;
                if let Some(both) = value(b'S')? {
                    (accelerations.print, accelerations.travel) = (both, both);
                }
                accelerations.print = value(b'P')?.unwrap_or(accelerations.print);
                accelerations.retract = value(b'R')?.unwrap_or(accelerations.retract);
                accelerations.travel = value(b'T')?.unwrap_or(accelerations.travel);
            }
            _ => {
                let deviation = value(b'J')?.filter(|value| JUNCTION_DEVIATION_MM.contains(value));
                limits.junction_deviation_mm = deviation.unwrap_or(limits.junction_deviation_mm);
                // An axis without such a limit keeps to the junction deviation alone.
                let limited =
                    limits.corner_velocity_mm_per_s.iter_mut().zip(AXES).filter(|(limit, _)| limit.is_finite());
                for (limit, letter) in limited {
                    *limit = value(letter)?.unwrap_or(*limit);
                }
            }
        }
        if limits != self.limits {
            self.limits = limits;
            self.job.limits.push(limits);
        }
        Ok(())
    }

    pub(super) fn set_retraction(&mut self, command: &Command<'_>) -> Result<(), OutOfRange> {
        if let Some(value) = command.value(b'S')? {
            self.retraction.length_10nm = self.length_10nm(value)?;
        }
        if let Some(feed) = command.value(b'F')?.map(|value| self.length_mm(value) / 60.0).filter(|feed| *feed > 0.0) {
            self.retraction.feed_mm_per_s = feed;
        }
        if let Some(value) = command.value(b'Z')? {
            self.retraction.lift_10nm = self.length_10nm(value)?;
        }
        Ok(())
    }

    pub(super) fn set_recovery(&mut self, command: &Command<'_>) -> Result<(), OutOfRange> {
        if let Some(value) = command.value(b'S')? {
            self.retraction.recover_extra_10nm = self.length_10nm(value)?;
        }
        if let Some(feed) = command.value(b'F')?.map(|value| self.length_mm(value) / 60.0).filter(|feed| *feed > 0.0) {
            self.retraction.recover_feed_mm_per_s = feed;
        }
        Ok(())
    }

    pub(super) fn set_feed_factor(&mut self, command: &Command<'_>) -> Result<(), OutOfRange> {
        if command.has(b'B') {
            self.feed_percent_saved = self.feed_percent;
        }
        if command.has(b'R') {
            self.feed_percent = self.feed_percent_saved;
        }
        if let Some(percent) = command.value(b'S')?.map(Decimal::truncated).filter(|percent| *percent > 0) {
            self.feed_percent = percent;
        }
        Ok(())
    }
}
