//! The command that sets each setting that a machine keeps, between which limits, and by which name
//! a memory knows it.

mod of_models;
mod of_tools;

use core::fmt::{self, Display, Formatter, Write};

use ferrostep_gcode::Real;
use ferrostep_hal_shim::Heater;
use ferrostep_planner::backlash::Backlash;
use ferrostep_planner::{AxisShaper, PressureAdvance};

use super::values::{MM, Parts, Place, Values};
use crate::heat::gains::PidGains;
use crate::motion::skew::Skew;
use crate::part::Part;
use crate::settings::bounds::{FULL_POWER, LARGEST_LIMIT, LARGEST_MM, SMALLEST_LIMIT};
use crate::settings::profile::filament::PauseSettings;
use crate::settings::profile::homing::SafeHoming;

/// A setting: one value, or one for each of its letters.
pub(crate) struct Setting<M: Parts> {
    /// The setting's key in a profile, with `*` for the axis. A memory knows it by this name.
    pub name: &'static str,
    /// The words of its values.
    pub letters: &'static str,
    /// Minimum and maximum, in the profile's unit; those of the command.
    pub range: [f64; 2],
    /// Factor from the profile's unit to the command's.
    pub scale: f64,
    /// Returns value number `index` of the setting, where this machine has it.
    pub place: fn(&mut Values<M>, usize) -> Option<Place<'_>>,
}

/// The settings of a command.
pub(crate) struct Group<M: Parts> {
    /// The command.
    pub code: &'static str,
    /// Heading of the group in a report.
    pub heading: &'static str,
    /// `Some`: a line for each of these axes, and in it a word for each setting. `None`: all
    /// values in a line.
    pub axes: Option<&'static str>,
    pub settings: &'static [Setting<M>],
}

const fn setting<M: Parts>(
    name: &'static str,
    letters: &'static str,
    range: [f64; 2],
    place: fn(&mut Values<M>, usize) -> Option<Place<'_>>,
) -> Setting<M> {
    Setting { name, letters, range, scale: 1.0, place }
}

const AXES: &str = "XYZE";
const LIMITS: [f64; 2] = [SMALLEST_LIMIT, LARGEST_LIMIT];
/// Range of the steps in a profile.
const STEPS: [f64; 2] = [1.0, 10_000.0];
const LENGTHS: [f64; 2] = [0.0, 100.0];
/// The slowest and the fastest feed of M207 and M208.
const SPEEDS: [f64; 2] = [0.01, 1000.0];
/// mA.
const CURRENT: [f64; 2] = [0.0, 3000.0];
/// Range of the speed of M913, mm/s.
const CHOPPER_SPEED: [f64; 2] = [0.0, 2000.0];
const SKEW: [f64; 2] = [-(Skew::MAX_FACTOR as f64), Skew::MAX_FACTOR as f64];
const FILAMENT: [f64; 2] = [0.0, PauseSettings::MAX_FILAMENT_10NM as f64 / MM];
const PROBE_Z: [f64; 2] = [SafeHoming::PROBE_Z_10NM[0] as f64 / MM, SafeHoming::PROBE_Z_10NM[1] as f64 / MM];

impl<M: Parts> Group<M> {
    /// Every setting that M500 stores, but for those of models. A new one is a line here, if a
    /// place in [`Values`] has it. Names and their meaning stay: memories of machines contain them.
    const GROUPS: &'static [Self] = &[
        Self {
            code: "M92",
            heading: "echo:; Steps per unit:",
            axes: None,
            settings: &[setting("steps_per_mm.e", "E", STEPS, |values, _| {
                Some(Place::Number(&mut values.extruder_steps_per_mm))
            })],
        },
        Self {
            code: "M203",
            heading: "echo:; Max feedrates (units/s):",
            axes: None,
            settings: &[setting("max_feed_mm_per_s.*", AXES, LIMITS, |values, axis| {
                values.limits.max_feed_mm_per_s.get_mut(axis).map(Place::Number)
            })],
        },
        Self {
            code: "M201",
            heading: "echo:; Max Acceleration (units/s2):",
            axes: None,
            settings: &[setting("max_acceleration_mm_per_s2.*", AXES, LIMITS, |values, axis| {
                values.limits.max_acceleration_mm_per_s2.get_mut(axis).map(Place::Number)
            })],
        },
        Self {
            code: "M204",
            heading: "echo:; Acceleration (units/s2):",
            axes: None,
            settings: &[
                setting("acceleration_mm_per_s2.print", "P", LIMITS, |values, _| {
                    Some(Place::Number(&mut values.limits.print_acceleration_mm_per_s2))
                }),
                setting("acceleration_mm_per_s2.retract", "R", LIMITS, |values, _| {
                    Some(Place::Number(&mut values.limits.retract_acceleration_mm_per_s2))
                }),
                setting("acceleration_mm_per_s2.travel", "T", LIMITS, |values, _| {
                    Some(Place::Number(&mut values.limits.travel_acceleration_mm_per_s2))
                }),
            ],
        },
        Self {
            code: "M205",
            heading: "echo:; Corners:",
            axes: None,
            settings: &[
                setting("junction_deviation_mm", "J", [0.000_01, 10.0], |values, _| {
                    Some(Place::Number(&mut values.limits.junction_deviation_mm))
                }),
                setting("instantaneous_corner_velocity_mm_per_s.*", AXES, LIMITS, |values, axis| {
                    // An axis without such a limit gets none.
                    let limit = values.limits.instantaneous_corner_velocity_mm_per_s.get_mut(axis)?;
                    limit.is_finite().then_some(Place::Number(limit))
                }),
            ],
        },
        Self {
            code: "M207",
            heading: "echo:; Retract:",
            axes: None,
            settings: &[
                setting("firmware_retraction.length_mm", "S", LENGTHS, |values, _| {
                    Some(Place::Length(&mut values.retraction.length_10nm))
                }),
                Setting {
                    scale: 60.0,
                    ..setting("firmware_retraction.retract_mm_per_s", "F", SPEEDS, |values, _| {
                        Some(Place::Length(&mut values.retraction.retract_10nm_per_s))
                    })
                },
                setting("firmware_retraction.lift_mm", "Z", LENGTHS, |values, _| {
                    Some(Place::Length(&mut values.retraction.lift_10nm))
                }),
            ],
        },
        Self {
            code: "M208",
            heading: "echo:; Recover:",
            axes: None,
            settings: &[
                setting("firmware_retraction.extra_recover_mm", "S", [-100.0, 100.0], |values, _| {
                    Some(Place::Length(&mut values.retraction.extra_recover_10nm))
                }),
                Setting {
                    scale: 60.0,
                    ..setting("firmware_retraction.recover_mm_per_s", "F", SPEEDS, |values, _| {
                        Some(Place::Length(&mut values.retraction.recover_10nm_per_s))
                    })
                },
            ],
        },
        Self {
            code: "M603",
            heading: "echo:; Filament load/unload lengths:",
            axes: None,
            settings: &[
                setting("pause.unload_mm", "U", FILAMENT, |values, _| {
                    values.filament_10nm.first_mut().map(Place::Length)
                }),
                setting("pause.load_mm", "L", FILAMENT, |values, _| values.filament_10nm.get_mut(1).map(Place::Length)),
            ],
        },
        Self {
            code: "M593",
            heading: "echo:; Input Shaping:",
            axes: Some("XY"),
            settings: &[
                setting("input_shaper.*.kind", "P", [0.0, 1e9], |values, axis| {
                    values.shapers.get_mut(axis).map(|shaper| Place::Kind(&mut shaper.kind))
                }),
                setting("input_shaper.*.frequency_hz", "F", AxisShaper::FREQUENCY_HZ, |values, axis| {
                    values.shapers.get_mut(axis).map(|shaper| Place::Number(&mut shaper.frequency_hz))
                }),
                setting("input_shaper.*.damping", "D", [0.0, 0.99], |values, axis| {
                    values.shapers.get_mut(axis).map(|shaper| Place::Number(&mut shaper.damping))
                }),
            ],
        },
        Self {
            code: "M572",
            heading: "echo:; Pressure Advance:",
            axes: None,
            settings: &[
                setting("pressure_advance.seconds", "S", [0.0, PressureAdvance::MAX_SECONDS], |values, _| {
                    values.advance.get_mut(0).map(Place::Optional)
                }),
                setting("pressure_advance.smooth_time_s", "W", PressureAdvance::SMOOTH_TIME_S, |values, _| {
                    values.advance.get_mut(1).map(Place::Optional)
                }),
                setting("pressure_advance.above.seconds", "L", [0.0, PressureAdvance::MAX_SECONDS], |values, _| {
                    values.advance.get_mut(2).map(Place::Optional)
                }),
                setting(
                    "pressure_advance.above.filament_mm_per_s",
                    "T",
                    PressureAdvance::FILAMENT_MM_PER_S,
                    |values, _| values.advance.get_mut(3).map(Place::Optional),
                ),
            ],
        },
        Self {
            code: "M851",
            heading: "echo:; Z-Probe Offset (mm):",
            axes: None,
            settings: &[
                setting("homing.probe_offset_mm.*", "XY", [-2000.0, 2000.0], |values, axis| {
                    values.probe_offset_10nm.as_mut()?.get_mut(axis).map(Place::Length)
                }),
                setting("homing.probe_offset_mm.z", "Z", PROBE_Z, |values, _| {
                    values.probe_offset_10nm.as_mut()?.get_mut(2).map(Place::Length)
                }),
            ],
        },
        Self {
            code: "M206",
            heading: "echo:; Home offset:",
            axes: None,
            settings: &[setting("homing.home_offset_mm.*", "XYZ", [-LARGEST_MM, LARGEST_MM], |values, axis| {
                values.home_offset_10nm.get_mut(axis).map(Place::Length)
            })],
        },
        Self {
            code: "M852",
            heading: "echo:; Skew Factor:",
            axes: None,
            settings: &[
                setting("skew.xy.factor", "I", SKEW, |values, _| values.skew_factors.first_mut().map(Place::Number)),
                setting("skew.xz.factor", "J", SKEW, |values, _| values.skew_factors.get_mut(1).map(Place::Number)),
                setting("skew.yz.factor", "K", SKEW, |values, _| values.skew_factors.get_mut(2).map(Place::Number)),
            ],
        },
        Self {
            code: "M906",
            heading: "echo:; Stepper driver current:",
            axes: None,
            settings: &[setting("drivers.*.current_ma", AXES, CURRENT, |values, motor| {
                values.drivers.get_mut(motor)?.as_mut().map(|driver| Place::Whole(&mut driver.current_ma))
            })],
        },
        Self {
            code: "M913",
            heading: "echo:; Hybrid threshold (mm/s):",
            axes: None,
            settings: &[setting("drivers.*.spread_cycle_above_mm_per_s", AXES, CHOPPER_SPEED, |values, motor| {
                let driver = values.drivers.get_mut(motor)?.as_mut();
                driver.map(|driver| Place::Whole(&mut driver.spread_cycle_above_mm_per_s))
            })],
        },
        Self {
            code: "M914",
            heading: "echo:; StallGuard threshold:",
            axes: None,
            settings: &[setting("drivers.*.stall_threshold", AXES, [0.0, 255.0], |values, motor| {
                values.drivers.get_mut(motor)?.as_mut().map(|driver| Place::Byte(&mut driver.stall_threshold))
            })],
        },
        Self {
            code: "M569",
            heading: "echo:; Driver stepping mode:",
            axes: Some(AXES),
            settings: &[setting("drivers.*.stealth_chop", "S", [0.0, 1.0], |values, motor| {
                values.drivers.get_mut(motor)?.as_mut().map(|driver| Place::Switch(&mut driver.stealth_chop))
            })],
        },
        Self {
            code: "M301",
            heading: "echo:; Hotend PID:",
            axes: None,
            settings: &[
                gain("nozzle.proportional", "P", PidGains::PROPORTIONAL, |values, _| {
                    values.gains_of(Heater::Nozzle).map(|gains| Place::Single(&mut gains.proportional))
                }),
                gain("nozzle.integral", "I", PidGains::INTEGRAL, |values, _| {
                    values.gains_of(Heater::Nozzle).map(|gains| Place::Single(&mut gains.integral))
                }),
                gain("nozzle.derivative", "D", PidGains::DERIVATIVE, |values, _| {
                    values.gains_of(Heater::Nozzle).map(|gains| Place::Single(&mut gains.derivative))
                }),
                gain("nozzle.fan_gain", "F", PidGains::FAN, |values, _| {
                    values.gains_of(Heater::Nozzle).map(|gains| Place::Single(&mut gains.fan))
                }),
            ],
        },
        Self {
            code: "M304",
            heading: "echo:; Bed PID:",
            axes: None,
            settings: &[
                gain("bed.proportional", "P", PidGains::PROPORTIONAL, |values, _| {
                    values.gains_of(Heater::Bed).map(|gains| Place::Single(&mut gains.proportional))
                }),
                gain("bed.integral", "I", PidGains::INTEGRAL, |values, _| {
                    values.gains_of(Heater::Bed).map(|gains| Place::Single(&mut gains.integral))
                }),
                gain("bed.derivative", "D", PidGains::DERIVATIVE, |values, _| {
                    values.gains_of(Heater::Bed).map(|gains| Place::Single(&mut gains.derivative))
                }),
            ],
        },
    ];

    /// The play of drives.
    const OF_BACKLASH: &'static [Self] = &[Self {
        code: "M425",
        heading: "echo:; Backlash compensation:",
        axes: None,
        settings: &[
            setting("backlash.correction", "F", [0.0, 1.0], |values, _| {
                values.backlash().map(|backlash| Place::Number(&mut backlash.correction))
            }),
            setting("backlash.smoothing_mm", "S", [0.0, Backlash::MAX_SMOOTHING_MM], |values, _| {
                values.backlash().map(|backlash| Place::Number(&mut backlash.smoothing_mm))
            }),
            setting("backlash.play_mm.*", "XYZ", [0.0, Backlash::MAX_MM], |values, axis| {
                values.backlash()?.play_mm.get_mut(axis).map(Place::Number)
            }),
        ],
    }];

    /// All that a machine may have.
    pub fn all() -> impl Iterator<Item = &'static Self> {
        let of_tool_models = if M::Models::PRESENT && M::Tools::PRESENT { Self::OF_TOOL_MODELS } else { &[] };
        let of_models = if M::Models::PRESENT { Self::OF_MODELS } else { &[] };
        let of_tools = if M::Tools::PRESENT { Self::OF_TOOLS } else { &[] };
        let of_backlash = if M::Backlash::PRESENT { Self::OF_BACKLASH } else { &[] };
        Self::GROUPS.iter().chain(of_models).chain(of_tools).chain(of_tool_models).chain(of_backlash)
    }
}

/// A gain of a heater: the profile's powers are 0 to 1.
const fn gain<M: Parts>(
    name: &'static str,
    letter: &'static str,
    range: [f64; 2],
    place: fn(&mut Values<M>, usize) -> Option<Place<'_>>,
) -> Setting<M> {
    Setting { scale: FULL_POWER, ..setting(name, letter, range, place) }
}

impl<M: Parts> Group<M> {
    /// Largest number of values of a setting.
    pub fn values_of(&self, setting: &Setting<M>) -> usize {
        self.axes.unwrap_or(setting.letters).len()
    }

    /// A setting's value by its key in a profile.
    pub fn key<'a>(&self, setting: &'a Setting<M>, index: usize) -> Key<'a> {
        let axes = self.axes.unwrap_or(setting.letters);
        Key {
            name: setting.name,
            axis: axes.as_bytes().get(index).map_or('?', |letter| char::from(letter.to_ascii_lowercase())),
        }
    }
}

/// The key of a value in a profile.
#[derive(Clone, Copy)]
pub(crate) struct Key<'a> {
    name: &'a str,
    axis: char,
}

impl Display for Key<'_> {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        match self.name.split_once('*') {
            Some((before, after)) => write!(out, "{before}{}{after}", self.axis),
            None => out.write_str(self.name),
        }
    }
}

/// A value with two decimals, as hosts know it, or with those that it has.
pub(crate) struct Shown(pub f64);

impl Display for Shown {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        let hundredths = self.0 * 100.0;
        let is_short = (libm::round(hundredths) - hundredths).abs() < 5e-5;
        if is_short { Real::fixed(self.0, 2).fmt(out) } else { Real::short(self.0, 6).fmt(out) }
    }
}

impl<M: Parts> Group<M> {
    /// Writes the command that sets its values, those of one axis where it has a line for each.
    /// `false`: the machine has none of them, such as the offset of a probe.
    // Not by `Display`: the depth of the stack is reckoned as if any of those called any.
    pub fn write_command(&self, values: &mut Values<M>, axis: usize, out: &mut impl Write) -> Result<bool, fmt::Error> {
        out.write_str(self.code)?;
        if let Some(axis) = self.axes.and_then(|axes| axes.as_bytes().get(axis)) {
            write!(out, " {}", char::from(*axis))?;
        }
        let mut has_values = false;
        for setting in self.settings {
            for (index, letter) in (0..).zip(setting.letters.bytes()) {
                let index = if self.axes.is_some() { axis } else { index };
                if let Some(place) = (setting.place)(values, index) {
                    has_values = true;
                    write_word(out, char::from(letter), &place, setting.scale)?;
                }
            }
        }
        Ok(has_values)
    }
}

/// Writes a word of a command; leaves out an absent value.
fn write_word(out: &mut impl Write, letter: char, place: &Place<'_>, scale: f64) -> fmt::Result {
    match place {
        Place::Kind(kind) => write!(out, " {letter}\"{kind}\""),
        Place::Whole(_) | Place::Byte(_) | Place::Switch(_) => write!(out, " {letter}{}", place.get() as u32),
        Place::Optional(None) => Ok(()),
        Place::Single(value) => write!(out, " {letter}{}", Shown(shortest(**value, scale))),
        Place::Length(length_10nm) => write!(out, " {letter}{}", Shown(shortest_length(**length_10nm, scale))),
        Place::Number(_) | Place::Optional(_) => {
            write!(out, " {letter}{}", Shown(place.get() * scale))
        }
    }
}

/// A length, or a speed a second, in a command's unit, with the fewest decimals, at most five, that
/// are read back as this value: F2540, not F2539.9998.
fn shortest_length(length_10nm: i64, scale: f64) -> f64 {
    const MM: f64 = 100_000.0;
    let exact = length_10nm as f64 / MM * scale;
    let rounded = [100.0, 1e3, 1e4, 1e5].map(|decimals| libm::round(exact * decimals) / decimals);
    // As the command divides its words: without a rest.
    let reads_back = |rounded: &f64| (libm::round(rounded * MM) / scale) as i64 == length_10nm;
    rounded.into_iter().find(reads_back).unwrap_or(exact)
}

/// The value in a command's unit, with the fewest decimals, at most six, that are read back as this
/// value: 51, not 51.000001.
fn shortest(value: f32, scale: f64) -> f64 {
    let exact = f64::from(value) * scale;
    let rounded = [100.0, 1e3, 1e4, 1e5].map(|decimals| libm::round(exact * decimals) / decimals);
    rounded.into_iter().find(|rounded| (rounded / scale) as f32 == value).unwrap_or(exact)
}
