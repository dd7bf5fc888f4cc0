//! The settings of a second tool.

use ferrostep_planner::PressureAdvance;

use super::{CHOPPER_SPEED, CURRENT, Group, STEPS, gain, setting};
use crate::heat::gains::PidGains;
use crate::settings::bounds::LARGEST_OFFSET_10NM;
use crate::settings::stored::values::{MM, Parts, Place, ToolValues, Values};

const OFFSET: [f64; 2] = [-(LARGEST_OFFSET_10NM as f64) / MM, LARGEST_OFFSET_10NM as f64 / MM];

impl<M: Parts> Group<M> {
    /// Settings of a second tool.
    pub(super) const OF_TOOLS: &'static [Self] = &[
        Self {
            code: "M92 T1",
            heading: "echo:; Steps per unit of T1:",
            axes: None,
            settings: &[setting("tools.t1.steps_per_mm", "E", STEPS, |values, _| {
                values.tool().map(|tool| Place::Number(&mut tool.extruder_steps_per_mm))
            })],
        },
        Self {
            code: "M218 T1",
            heading: "echo:; Hotend offsets (mm):",
            axes: None,
            settings: &[setting("tools.t1.offset_mm.*", "XYZ", OFFSET, |values, axis| {
                values.tool()?.offset_10nm.get_mut(axis).map(Place::Length)
            })],
        },
        Self {
            code: "M572 D1",
            heading: "echo:; Pressure Advance of T1:",
            axes: None,
            settings: &[
                setting("tools.t1.pressure_advance.seconds", "S", [0.0, PressureAdvance::MAX_SECONDS], |values, _| {
                    values.tool()?.advance.get_mut(0).map(Place::Optional)
                }),
                setting("tools.t1.pressure_advance.smooth_time_s", "W", PressureAdvance::SMOOTH_TIME_S, |values, _| {
                    values.tool()?.advance.get_mut(1).map(Place::Optional)
                }),
                setting(
                    "tools.t1.pressure_advance.above.seconds",
                    "L",
                    [0.0, PressureAdvance::MAX_SECONDS],
                    |values, _| values.tool()?.advance.get_mut(2).map(Place::Optional),
                ),
                setting(
                    "tools.t1.pressure_advance.above.filament_mm_per_s",
                    "T",
                    PressureAdvance::FILAMENT_MM_PER_S,
                    |values, _| values.tool()?.advance.get_mut(3).map(Place::Optional),
                ),
            ],
        },
        Self {
            code: "M906 T1",
            heading: "echo:; Stepper driver current of T1:",
            axes: None,
            settings: &[setting("tools.t1.driver.current_ma", "E", CURRENT, |values, _| {
                values.tool()?.driver.as_mut().map(|driver| Place::Whole(&mut driver.current_ma))
            })],
        },
        Self {
            code: "M913 T1",
            heading: "echo:; Hybrid threshold of T1 (mm/s):",
            axes: None,
            settings: &[setting("tools.t1.driver.spread_cycle_above_mm_per_s", "E", CHOPPER_SPEED, |values, _| {
                let driver = values.tool()?.driver.as_mut();
                driver.map(|driver| Place::Whole(&mut driver.spread_cycle_above_mm_per_s))
            })],
        },
        Self {
            code: "M569 T1",
            heading: "echo:; Driver stepping mode of T1:",
            axes: Some("E"),
            settings: &[setting("tools.t1.driver.stealth_chop", "S", [0.0, 1.0], |values, _| {
                values.tool()?.driver.as_mut().map(|driver| Place::Switch(&mut driver.stealth_chop))
            })],
        },
        Self {
            code: "M301 E1",
            heading: "echo:; Hotend PID of T1:",
            axes: None,
            settings: &[
                gain("tools.t1.nozzle.proportional", "P", PidGains::PROPORTIONAL, |values, _| {
                    of_tool(values, |gains| &mut gains.proportional)
                }),
                gain("tools.t1.nozzle.integral", "I", PidGains::INTEGRAL, |values, _| {
                    of_tool(values, |gains| &mut gains.integral)
                }),
                gain("tools.t1.nozzle.derivative", "D", PidGains::DERIVATIVE, |values, _| {
                    of_tool(values, |gains| &mut gains.derivative)
                }),
                gain("tools.t1.nozzle.fan_gain", "F", PidGains::FAN, |values, _| {
                    of_tool(values, |gains| &mut gains.fan)
                }),
            ],
        },
    ];
}

/// A gain of T1's own heater.
fn of_tool<M: Parts>(values: &mut Values<M>, gain: fn(&mut PidGains) -> &mut f32) -> Option<Place<'_>> {
    let ToolValues { gains, model: None, .. } = values.tool()? else { return None };
    gains.as_mut().map(|gains| Place::Single(gain(gains)))
}
