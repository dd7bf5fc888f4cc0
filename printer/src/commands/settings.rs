//! M201 to M221: machine settings that a job may change.

use ferrostep_gcode::{AxisWords, Decimal, FeedWords, Real, Reply, RetractionWords};
use ferrostep_planner::Limits;

use crate::error::CommandError;
use crate::motion::extrusion::AdaptiveExtrusion;
use crate::ports::{Motion, Ports, Replies};
use crate::printer::Printer;
use crate::settings::bounds::{LARGEST_LIMIT, PERCENTS, SMALLEST_LIMIT, in_range};
use crate::settings::profile::SQUARE_CORNER_SHARE;
use crate::settings::profile::filament::ExtrusionSettings;

/// Ratio to the profile's feed above which a feed is suspicious.
const FAR_FEED: f64 = 10.0;

/// Speed or acceleration in mm, from a word in units of `unit_mm`.
fn limit(word: char, value: Decimal, unit_mm: f64) -> Result<f64, CommandError> {
    in_range(word, value.to_f64() * unit_mm, SMALLEST_LIMIT, LARGEST_LIMIT)
}

fn percent(value: Decimal) -> Result<u16, CommandError> {
    let [least, most] = PERCENTS;
    let percent = in_range('S', value.to_f64(), least, most)?;
    // Whole percents, as in Marlin, so that a flow times a length stays exact.
    Ok(percent as u16)
}

fn set_axes(limits: &mut [f64; 4], words: &AxisWords, unit_mm: f64) -> Result<(), CommandError> {
    let words = [('X', words.x), ('Y', words.y), ('Z', words.z), ('E', words.e)];
    for (limit_of_axis, (letter, word)) in limits.iter_mut().zip(words) {
        if let Some(value) = word {
            *limit_of_axis = limit(letter, value, unit_mm)?;
        }
    }
    Ok(())
}

impl<P: Ports> Printer<'_, P> {
    /// Executes M201.
    pub(crate) fn set_max_acceleration(&mut self, words: &AxisWords) -> Result<(), CommandError> {
        let mut limits = self.motion.limits();
        set_axes(&mut limits.max_acceleration_mm_per_s2, words, self.interpreter.modal.unit_mm())?;
        self.motion.set_limits(limits);
        Ok(())
    }

    /// Executes M203.
    pub(crate) fn set_max_feed(&mut self, words: &AxisWords) -> Result<(), CommandError> {
        let mut limits = self.motion.limits();
        set_axes(&mut limits.max_feed_mm_per_s, words, self.interpreter.modal.unit_mm())?;
        self.motion.set_limits(limits);
        self.tell_far_feeds(words, &limits.max_feed_mm_per_s);
        Ok(())
    }

    /// Reports feeds of a line that are so far above the profile's that they may be in another
    /// firmware's unit.
    #[inline(never)]
    fn tell_far_feeds(&self, words: &AxisWords, feeds_mm_per_s: &[f64; 4]) {
        let words = [words.x, words.y, words.z, words.e];
        let of_profile = self.profile.limits.max_feed_mm_per_s;
        for (((name, word), feed), of_profile) in "XYZE".chars().zip(words).zip(feeds_mm_per_s).zip(of_profile) {
            if word.is_some() && *feed > FAR_FEED * of_profile {
                let [feed, of_profile] = [*feed, of_profile].map(|feed| Real::short(feed, 2));
                self.replies.note(
                    self.lines.number,
                    format_args!(
                        "M203: {name} is {feed} mm/s now, and the profile's limit is {of_profile} mm/s (M203 takes mm/s, as in Marlin; \
                         RepRapFirmware's mm/min are 60 times as much)"
                    ),
                );
            }
        }
    }

    /// Executes M204; S sets print and travel, and P and T override it.
    pub(crate) fn set_acceleration(
        &mut self,
        print: Option<Decimal>,
        retract: Option<Decimal>,
        travel: Option<Decimal>,
        both: Option<Decimal>,
    ) -> Result<(), CommandError> {
        let unit_mm = self.interpreter.modal.unit_mm();
        let mut limits = self.motion.limits();
        let before = limits.print_acceleration_mm_per_s2;
        if let Some(value) = both {
            limits.print_acceleration_mm_per_s2 = limit('S', value, unit_mm)?;
            limits.travel_acceleration_mm_per_s2 = limits.print_acceleration_mm_per_s2;
        }
        if let Some(value) = print {
            limits.print_acceleration_mm_per_s2 = limit('P', value, unit_mm)?;
        }
        if let Some(value) = retract {
            limits.retract_acceleration_mm_per_s2 = limit('R', value, unit_mm)?;
        }
        if let Some(value) = travel {
            limits.travel_acceleration_mm_per_s2 = limit('T', value, unit_mm)?;
        }
        self.hold_corner_speed(&mut limits, before);
        self.motion.set_limits(limits);
        Ok(())
    }

    /// Executes SET_VELOCITY_LIMIT.
    pub(crate) fn set_velocity_limit(
        &mut self,
        velocity: Option<Decimal>,
        acceleration: Option<Decimal>,
        corner: Option<Decimal>,
    ) -> Result<(), CommandError> {
        let mut limits = self.motion.limits();
        let before = limits.print_acceleration_mm_per_s2;
        let feeds = AxisWords { x: velocity, y: velocity, ..AxisWords::default() };
        set_axes(&mut limits.max_feed_mm_per_s, &feeds, 1.0)?;
        if let Some(value) = acceleration {
            limits.print_acceleration_mm_per_s2 = limit('A', value, 1.0)?;
            limits.travel_acceleration_mm_per_s2 = limits.print_acceleration_mm_per_s2;
        }
        self.hold_corner_speed(&mut limits, before);
        if let Some(value) = corner {
            let speed = limit('S', value, 1.0)?;
            let deviation = speed * speed * SQUARE_CORNER_SHARE / limits.print_acceleration_mm_per_s2;
            limits.junction_deviation_mm = deviation.clamp(0.000_01, 10.0);
        }
        self.motion.set_limits(limits);
        Ok(())
    }

    /// Keeps the corner speed rather than the junction deviation, if the profile asks for it: the
    /// deviation is the speed's square over the acceleration.
    fn hold_corner_speed(&self, limits: &mut Limits, before_mm_per_s2: f64) {
        if self.profile.holds_corner_speed {
            let deviation = limits.junction_deviation_mm * before_mm_per_s2 / limits.print_acceleration_mm_per_s2;
            limits.junction_deviation_mm = deviation.clamp(0.000_01, 10.0);
        }
    }

    /// Executes M205 with J, and with X, Y, Z and E.
    pub(crate) fn set_corners(
        &mut self,
        deviation: Option<Decimal>,
        corner_velocity: &AxisWords,
    ) -> Result<(), CommandError> {
        let unit_mm = self.interpreter.modal.unit_mm();
        let mut limits = self.motion.limits();
        if let Some(value) = deviation {
            limits.junction_deviation_mm = in_range('J', value.to_f64() * unit_mm, 0.000_01, 10.0)?;
        }
        // For an axis without such a limit only the junction deviation counts, as in Marlin where
        // that is compiled in.
        let of_profile = limits.instantaneous_corner_velocity_mm_per_s;
        set_axes(&mut limits.instantaneous_corner_velocity_mm_per_s, corner_velocity, unit_mm)?;
        for (limit, of_profile) in limits.instantaneous_corner_velocity_mm_per_s.iter_mut().zip(of_profile) {
            if !of_profile.is_finite() {
                *limit = of_profile;
            }
        }
        self.motion.set_limits(limits);
        Ok(())
    }

    /// Executes M207 and M208.
    pub(crate) fn set_retraction(&mut self, words: &RetractionWords, recover: bool) -> Result<(), CommandError> {
        let mut settings = self.interpreter.modal.retraction;
        let length = |word: char, value: Decimal, largest_mm: f64| -> Result<i64, CommandError> {
            let length_10nm = self.interpreter.modal.length_10nm(value).ok_or(CommandError::TooFar)?;
            let smallest_mm = if word == 'S' && recover { -largest_mm } else { 0.0 };
            in_range(word, length_10nm as f64 / 100_000.0, smallest_mm, largest_mm)?;
            Ok(length_10nm)
        };
        if let Some(value) = words.length {
            let length_10nm = length('S', value, 100.0)?;
            if recover {
                settings.extra_recover_10nm = length_10nm;
            } else {
                settings.length_10nm = length_10nm;
            }
        }
        if let Some(value) = words.feed {
            let rate = length('F', value, 60_000.0)? / 60;
            in_range('F', rate as f64, 1_000.0, f64::MAX)?;
            if recover {
                settings.recover_10nm_per_s = rate;
            } else {
                settings.retract_10nm_per_s = rate;
            }
        }
        if let Some(value) = words.lift {
            settings.lift_10nm = length('Z', value, 100.0)?;
        }
        self.interpreter.modal.retraction = settings;
        Ok(())
    }

    /// Executes M220.
    pub(crate) fn feed_percent(&mut self, words: FeedWords) -> Result<(), CommandError> {
        let percent = words.percent.map(percent).transpose()?;
        let modal = &mut self.interpreter.modal;
        if words.keeps {
            modal.kept_feed_percent = modal.feed_percent;
        }
        if words.restores {
            modal.feed_percent = modal.kept_feed_percent;
        }
        modal.feed_percent = percent.unwrap_or(modal.feed_percent);
        if words == FeedWords::default() {
            self.replies.send(Reply::FeedPercent(modal.feed_percent));
        }
        Ok(())
    }

    /// Executes M221.
    pub(crate) fn flow_percent(&mut self, tool: Option<u8>, value: Option<Decimal>) -> Result<(), CommandError> {
        if let Some(resting) = self.resting_tool(tool)? {
            match value {
                Some(value) => resting.flow_percent = percent(value)?,
                None => {
                    let flow = resting.flow_percent;
                    self.replies.send(Reply::FlowPercent(flow));
                }
            }
            return Ok(());
        }
        match value {
            Some(value) => self.interpreter.modal.flow_percent = percent(value)?,
            None => self.replies.send(Reply::FlowPercent(self.interpreter.modal.flow_percent)),
        }
        Ok(())
    }

    /// Executes M795, which applies to later moves.
    pub(crate) fn adaptive_extrusion(
        &mut self,
        on: Option<bool>,
        sizes: [Option<Decimal>; 3],
    ) -> Result<(), CommandError> {
        let mut settings = self.interpreter.modal.extrusion.settings();
        let mut sizes_10nm = [settings.layer_height_10nm, settings.line_width_10nm, settings.filament_diameter_10nm];
        let words = ['H', 'W', 'D'].into_iter().zip(ExtrusionSettings::RANGES_10NM);
        for ((size_10nm, written), (word, (least, most))) in sizes_10nm.iter_mut().zip(sizes).zip(words) {
            if let Some(value) = written {
                let [least_mm, most_mm] = [least, most].map(|limit| limit as f64 / 100_000.0);
                in_range(word, value.to_f64() * self.interpreter.modal.unit_mm(), least_mm, most_mm)?;
                *size_10nm = self.interpreter.modal.length_10nm(value).ok_or(CommandError::TooFar)?;
            }
        }
        [settings.layer_height_10nm, settings.line_width_10nm, settings.filament_diameter_10nm] = sizes_10nm;
        settings.adaptive = on.unwrap_or(settings.adaptive);
        if on.is_some() || sizes != [None; 3] {
            self.interpreter.modal.extrusion = AdaptiveExtrusion::new(settings);
        } else {
            let (adaptive, lambda) = (settings.adaptive, self.interpreter.modal.extrusion.lambda());
            self.replies.send(Reply::Extrusion { adaptive, sizes_10nm, lambda });
        }
        Ok(())
    }

    /// Executes M211.
    pub(crate) fn soft_limits(&mut self, enabled: Option<bool>) {
        match enabled {
            Some(enabled) => self.interpreter.modal.soft_limits = enabled,
            None => self.replies.send(Reply::SoftLimits {
                enabled: self.interpreter.modal.soft_limits,
                min_10nm: self.profile.lower_end_10nm,
                max_10nm: self.profile.size_10nm,
            }),
        }
    }

    // ANCHOR: m302
    /// Executes M302.
    pub(crate) fn cold_extrusion(&mut self, minimum: Option<Decimal>, allow: Option<bool>) -> Result<(), CommandError> {
        if let Some(value) = minimum {
            self.interpreter.modal.min_extrusion_celsius = in_range('S', value.to_f64(), 0.0, 500.0)? as f32;
            // Marlin: S0 allows cold extrusion, any other S forbids it again.
            self.interpreter.modal.cold_extrusion_allowed = value.nanos() == 0;
        }
        if let Some(allow) = allow {
            self.interpreter.modal.cold_extrusion_allowed = allow;
        }
        if minimum.is_none() && allow.is_none() {
            self.replies.send(Reply::ColdExtrusion {
                allowed: self.interpreter.modal.cold_extrusion_allowed,
                minimum: self.interpreter.modal.min_extrusion_celsius,
            });
        }
        Ok(())
    }
    // ANCHOR_END: m302
}
