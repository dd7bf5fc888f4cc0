//! Detection of failed heaters: all thermal checks are here.
//!
//! [`Safety::check`] sees each sample of one heater: the temperature (freed of single bad readings,
//! see `Thermometer`), the target, and the power that was in force up to now. A fault switches
//! *all* heaters off, in the same sample ([`super::HeatControl`]). The checks use no value that the
//! control has worked out, and set none.
//!
//! | what has happened | what reports it | after |
//! |---|---|---|
//! | thermistor open or shorted | [`Trip::Sensor`] | 3 samples |
//! | hotter than the maximum, colder than the minimum | [`Trip::TooHot`], [`Trip::TooCold`] | 3 samples |
//! | no power at the heater, thermistor out or frozen, while heating up | [`Trip::HeatingFailed`] | the watch period |
//! | the same, at the target | [`Trip::Runaway`] | the runaway period below the hysteresis |
//! | transistor failed closed | [`Trip::RisesUnpowered`], or [`Trip::TooHot`] | with the power at 0, a quarter of the watch period and 10 degrees |
//! | the same, of a heater too weak to rise | [`Trip::StaysHotUnpowered`] | 10 minutes above 80 degrees without power |
//! | converter has stopped, at the target | [`Trip::Frozen`] | the runaway period, once the power has changed by 5 % |
//! | the same, while an autotune heats | [`Trip::Frozen`] | 5 s, of a chamber a minute |

use core::fmt;

use ferrostep_hal_shim::SensorError;

use crate::settings::profile::heaters::{HeaterSettings, HeaterWatch};

use super::sample_time::SAMPLE_MS;

/// A heater at power 0 that becomes this much hotter within its watch period is being heated,
/// degrees. Over a hot bed a nozzle takes minutes for that, and so does a bed under a hot nozzle.
const UNPOWERED_RISE_CELSIUS: f32 = 10.0;

/// Above this temperature, degrees Celsius, a heater without power must become colder ...
const HOT_CELSIUS: f32 = 80.0;
/// ... by this much, degrees ...
const COOLING_CELSIUS: f32 = 2.0;
/// ... within this time. A heavy bed in a chamber of 60 degrees takes a third of that.
const COOLING_MS: u32 = 600_000;

/// The room's temperature as the hysteresis counts it, degrees Celsius.
const ROOM_CELSIUS: f32 = 25.0;
/// Minimum distance below its target that a heater is allowed, however near the room's
/// temperature, degrees.
const LEAST_HYSTERESIS_CELSIUS: f32 = 4.0;

/// A change of power, as a share of full power, that no heater takes without the temperature
/// changing by a step of its reading.
const POWER_THAT_SHOWS: f32 = 0.05;

/// The longest time that a reading may stay the same while an autotune heats at full power: a
/// nozzle of 5 degrees a second would become far too hot in the runaway period.
const TUNED_MS: u32 = 5_000;
/// The same of a chamber, whose air takes that long for a step of its reading where the heater
/// hardly reaches the target, and becomes 3 degrees warmer meanwhile.
const TUNED_CHAMBER_MS: u32 = 60_000;

/// A fault that a check has found; temperatures in degrees Celsius.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Trip {
    /// The thermistor's circuit is open or shorted.
    Sensor(SensorError),
    /// The temperature is at or above the maximum.
    TooHot(f32),
    /// Below the minimum, or not a number.
    TooCold(f32),
    /// The temperature, below its target, has not risen by the watch's degrees in the watch period.
    HeatingFailed(f32),
    /// The target had been reached, and the temperature has been too far below it for too long.
    Runaway(f32),
    /// The temperature rises though the heater is switched off.
    RisesUnpowered(f32),
    /// The temperature, far above the room's, does not fall though the heater is switched off.
    StaysHotUnpowered(f32),
    /// The reading stays exactly the same though the power has changed.
    Frozen(f32),
}

impl Trip {
    /// Returns true if only a reset of the board ends it, not M999: the heater, its transistor or
    /// the thermistor's place has failed, and no reading can show that it is sound again. A host
    /// that repeats M999 and M104 would grant a heater without a thermistor one watch period at
    /// full power after the other.
    ///
    /// The others end when the reading is within its limits again: a plug put back, a nozzle
    /// that has cooled.
    pub const fn needs_reset(self) -> bool {
        match self {
            Self::Sensor(_) | Self::TooHot(_) | Self::TooCold(_) => false,
            Self::HeatingFailed(_)
            | Self::Runaway(_)
            | Self::RisesUnpowered(_)
            | Self::StaysHotUnpowered(_)
            | Self::Frozen(_) => true,
        }
    }
}

impl fmt::Display for Trip {
    /// The words by which hosts recognise a thermal error.
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            Self::TooHot(_) | Self::Sensor(SensorError::Shorted) => "MAXTEMP triggered",
            Self::TooCold(_) | Self::Sensor(SensorError::Open) => "MINTEMP triggered",
            Self::HeatingFailed(_) => "Heating failed",
            Self::Runaway(_) | Self::RisesUnpowered(_) | Self::StaysHotUnpowered(_) => "Thermal Runaway",
            Self::Frozen(_) => "Thermal Malfunction",
        })
    }
}

/// A temperature and how many samples ago it was.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Since {
    celsius: f32,
    samples: u32,
}

impl Since {
    const fn now(celsius: f32) -> Self {
        Self { celsius, samples: 0 }
    }

    fn tick(&mut self) {
        self.samples = self.samples.saturating_add(1);
    }
}

/// Phase of the heater.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    /// The heater's target is 0.
    Off,
    /// The heater has not reached its target: the time when it last became hotter by the watch's
    /// degrees, and the lowest temperature since.
    Heating(Since),
    /// The heater has reached its target; since then it has been too far below it for
    /// this many samples.
    Holding(u32),
}

/// The checks of one heater.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Safety {
    phase: Phase,
    /// The target of the phase.
    target: f32,
    /// Samples without power.
    unpowered: u32,
    /// The lowest temperature without power, lately.
    lowest: Since,
    /// The temperature without power from which it must fall.
    hot: Since,
    /// The last temperature that differed from the one before, and the power then.
    changed: (f32, f32),
    /// Samples since a change of the power large enough to change the reading.
    unanswered: u32,
}

impl Safety {
    /// A heater that is off.
    pub(crate) const fn new() -> Self {
        Self {
            phase: Phase::Off,
            target: 0.0,
            unpowered: 0,
            lowest: Since::now(0.0),
            // Any first sample is colder, and begins the time.
            hot: Since::now(f32::INFINITY),
            changed: (0.0, 0.0),
            unanswered: 0,
        }
    }

    /// Looks at a sample: the temperature, the target (0 for off), the power up to now (0 to 1),
    /// and whether an autotune makes it swing. The settings are the same each time.
    ///
    /// # Errors
    /// The heater, or its thermistor, has failed.
    pub fn check(
        &mut self,
        settings: &HeaterSettings,
        reading: Result<f32, SensorError>,
        target: f32,
        power: f32,
        is_tuned: bool,
    ) -> Result<(), Trip> {
        let celsius = reading.map_err(Trip::Sensor)?;
        if celsius >= settings.max_celsius {
            return Err(Trip::TooHot(celsius));
        }
        if celsius.is_nan() || celsius < settings.min_celsius {
            return Err(Trip::TooCold(celsius));
        }
        self.follow(celsius, target);
        self.check_phase(settings, celsius)?;
        // A chamber that the bed warms rises without power, and stays warm.
        if !settings.is_warmed_by_others {
            self.check_unpowered(&settings.watch, celsius, power)?;
            self.check_cooling(celsius, power)?;
        }
        self.check_same(settings, celsius, power, is_tuned)
    }

    /// Begins a new phase at a new target; [`Self::check_phase`] decides in the same sample whether
    /// it is reached already. A heater that has been heating up gets no more time than it had: a
    /// host that sends M104 again and again must not put the watch to sleep.
    fn follow(&mut self, celsius: f32, target: f32) {
        if target == self.target {
            return;
        }
        self.target = target;
        self.phase = match self.phase {
            _ if target <= 0.0 => Phase::Off,
            Phase::Heating(since) => Phase::Heating(since),
            Phase::Off | Phase::Holding(_) => Phase::Heating(Since::now(celsius)),
        };
    }

    /// Returns true if it is no farther below the target than the runaway check allows. Above the
    /// target counts as near.
    ///
    /// The bound is the profile's hysteresis, but at most a third of the difference between room
    /// and target. The loss to a draught grows with that difference, and a thermistor that has
    /// fallen out, which reads the room, must never be near a low target.
    fn is_near(&self, settings: &HeaterSettings, celsius: f32) -> bool {
        let HeaterSettings { watch, residency_window_celsius, .. } = settings;
        let least = residency_window_celsius.max(LEAST_HYSTERESIS_CELSIUS);
        let share = ((self.target - ROOM_CELSIUS) / 3.0).max(least);
        celsius >= self.target - watch.runaway_celsius.min(share)
    }

    /// Checks that heating up makes progress, and that the target, once reached, is held.
    fn check_phase(&mut self, settings: &HeaterSettings, celsius: f32) -> Result<(), Trip> {
        let is_near = self.is_near(settings, celsius);
        let watch = &settings.watch;
        match &mut self.phase {
            Phase::Off => {}
            Phase::Heating(_) if is_near => self.phase = Phase::Holding(0),
            Phase::Heating(since) if celsius >= since.celsius + watch.watch_celsius => *since = Since::now(celsius),
            Phase::Heating(since) => {
                // Just switched on again it may keep cooling while the heat is on its way. The time
                // runs nevertheless.
                since.celsius = since.celsius.min(celsius);
                since.tick();
                if since.samples >= watch.watch_ms / SAMPLE_MS {
                    return Err(Trip::HeatingFailed(celsius));
                }
            }
            Phase::Holding(below) if is_near => *below = 0,
            Phase::Holding(below) => {
                *below = below.saturating_add(1);
                if *below >= watch.runaway_ms / SAMPLE_MS {
                    return Err(Trip::Runaway(celsius));
                }
            }
        }
        Ok(())
    }

    /// Checks that the temperature hardly rises without power. Heat on its way to the thermistor
    /// when the power went may arrive first: it has a quarter of the watch period.
    fn check_unpowered(&mut self, watch: &HeaterWatch, celsius: f32, power: f32) -> Result<(), Trip> {
        let watch_samples = watch.watch_ms / SAMPLE_MS;
        self.unpowered = if power > 0.0 { 0 } else { self.unpowered.saturating_add(1) };
        let settles = self.unpowered <= watch_samples / 4;
        if settles || celsius <= self.lowest.celsius || self.lowest.samples >= watch_samples {
            self.lowest = Since::now(celsius);
        }
        self.lowest.tick();
        if celsius >= self.lowest.celsius + UNPOWERED_RISE_CELSIUS {
            return Err(Trip::RisesUnpowered(celsius));
        }
        Ok(())
    }

    /// Checks that a heater far hotter than any room becomes colder without power. Otherwise one
    /// that is too weak to rise further would stay on without end.
    fn check_cooling(&mut self, celsius: f32, power: f32) -> Result<(), Trip> {
        if power > 0.0 || celsius < HOT_CELSIUS || celsius <= self.hot.celsius - COOLING_CELSIUS {
            self.hot = Since::now(celsius);
        }
        self.hot.tick();
        if self.hot.samples > COOLING_MS / SAMPLE_MS {
            return Err(Trip::StaysHotUnpowered(celsius));
        }
        Ok(())
    }

    /// Checks that the reading at the target changes when the power does, and always in an
    /// autotune. On the way there the watch notices a frozen reading.
    fn check_same(&mut self, settings: &HeaterSettings, celsius: f32, power: f32, is_tuned: bool) -> Result<(), Trip> {
        let (same_celsius, same_power) = self.changed;
        if celsius != same_celsius || !matches!(self.phase, Phase::Holding(_)) {
            self.changed = (celsius, power);
            self.unanswered = 0;
        } else if is_tuned || self.unanswered > 0 || (power - same_power).abs() >= POWER_THAT_SHOWS {
            self.unanswered = self.unanswered.saturating_add(1);
        }
        let longest_ms = match is_tuned && power > 0.0 {
            true if settings.is_warmed_by_others => TUNED_CHAMBER_MS,
            true => TUNED_MS,
            false => settings.watch.runaway_ms,
        };
        if self.unanswered >= longest_ms / SAMPLE_MS {
            return Err(Trip::Frozen(celsius));
        }
        Ok(())
    }
}
