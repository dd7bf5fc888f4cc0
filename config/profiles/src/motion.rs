//! The methods that make the steps.

use ferrostep_checked_toml::{Range, Section, range};
use ferrostep_planner::{
    AccelerationProfile, AxisShaper, DualRatePeriods, EvenSpacing, Interpolation, MotionChoice, PATH_TOLERANCE_MM,
    PressureAdvance, SCurveTableSettings, SMOOTH_TIME_S, SecondSlope, ShaperError, ShaperKind, TICKS_PER_SECOND,
    smooth_ticks,
};

const JERK: Range = range(1.0, 10_000_000.0, "mm/s^3");
const PERIOD: Range = range(1.0, 1_000_000.0, "us");
const FREQUENCY: Range = range(1.0, 1_000_000.0, "steps/s");
const SHAPER_FREQUENCY: Range = range(AxisShaper::FREQUENCY_HZ[0], AxisShaper::FREQUENCY_HZ[1], "Hz");
const SHAPER_DAMPING: Range = range(0.0, 0.99, "");
const ADVANCE: Range = range(0.0, PressureAdvance::MAX_SECONDS, "s");
const SMOOTH_TIME: Range = range(PressureAdvance::SMOOTH_TIME_S[0], PressureAdvance::SMOOTH_TIME_S[1], "s");
const FILAMENT_SPEED: Range =
    range(PressureAdvance::FILAMENT_MM_PER_S[0], PressureAdvance::FILAMENT_MM_PER_S[1], "mm/s");
const TABLE_JERK: Range = range(1.0, 1_000_000_000.0, "steps/s^3");

const MS_PER_TICK: f64 = 1e3 / TICKS_PER_SECOND as f64;
const PATH_TOLERANCE: Range = range(PATH_TOLERANCE_MM[0], PATH_TOLERANCE_MM[1], "mm");

/// The least acceleration of short moves in curves that a tolerance may lead to, mm/s^2.
const MIN_ACCELERATION_MM_PER_S2: f64 = 100.0;

const AXES_SMOOTH_TIME: Range = range(SMOOTH_TIME_S[0], SMOOTH_TIME_S[1], "s");

/// The methods and their settings. Prepared jobs hold trapezoids, so that settings of S-curves do
/// not bind them; shapers change the motion as it is played, so that they do not bind them either.
pub(crate) fn motion(keys: &Section<'_>) -> MotionChoice {
    let default = MotionChoice::DEFAULT;
    let interpolation = keys
        .word("interpolation", Interpolation::ALL.map(|choice| (choice.name(), choice)))
        .or(default.interpolation, "how steps follow a straight line ([CoreXY](papers/corexy.md)); M796 I");
    let choice = MotionChoice {
        interpolation,
        dual_rate: dual_rate(keys),
        acceleration: keys
            .word("acceleration", AccelerationProfile::ALL.map(|choice| (choice.name(), choice)))
            .or(default.acceleration, "acceleration profile ([Li 2017](papers/li.md)); M796 A"),
        jerk_mm_per_s3: keys
            .apart()
            .number("jerk_mm_per_s3", JERK)
            .required("maximum jerk along the path with `acceleration = \"s-curve\"`"),
        filament_jerk_mm_per_s3: keys
            .apart()
            .number("filament_jerk_mm_per_s3", JERK)
            .or(default.filament_jerk_mm_per_s3, "maximum jerk of extruder-only moves, which do not shake the frame"),
        s_curve_table: s_curve_table(&keys.apart()),
        ..default
    };
    let (shapers, smooth_time_s) = filters(&keys.apart());
    let choice = MotionChoice {
        shapers,
        smooth_time_s,
        // Lines accelerate as far as the extruder can follow: the plan depends on it.
        pressure_advance: pressure_advance(keys, "none").unwrap_or(PressureAdvance::NONE),
        filament_on_the_way: keys.apart().flag("filament_on_the_way").or(
            default.filament_on_the_way,
            "filament is retracted and recovered during travel moves, without a stop ([Filament on the \
             way](filament-on-the-way.md)); prepared jobs stop",
        ),
        ..choice
    };
    let choice = MotionChoice { path_tolerance_mm: path_tolerance(keys, &choice), ..choice };
    if choice.smooth_time_s.is_some() && choice.acceleration != AccelerationProfile::Trapezoid {
        let expected = "\"trapezoid\" with input_shaper.smooth_time_s, which limits the jerk by itself";
        keys.refuse("acceleration", expected);
    }
    if is_shaped(&choice) && interpolation != Interpolation::StepBresenham {
        let expected = "\"step-bresenham\" with input_shaper and pressure_advance: the other methods do not time each motor separately";
        keys.refuse("interpolation", expected);
    }
    choice
}

/// Maximum distance of the filtered path from the programmed one. Accelerations and corners follow
/// from it and the filters, so that prepared jobs are for both.
fn path_tolerance(keys: &Section<'_>, choice: &MotionChoice) -> Option<f64> {
    let tolerance_mm = keys.apart().number("path_tolerance_mm", PATH_TOLERANCE).optional(
        "filters round corners without a limit",
        "maximum deviation of the commanded path from the programmed one [after the filters](path-tolerance.md) of \
         input_shaper: cornering speeds and accelerations are lowered to keep it, besides junction_deviation_mm",
    )?;
    keys.bind("path_tolerance_mm", &(tolerance_mm, choice.shapers, choice.smooth_time_s));
    let with_tolerance = MotionChoice { path_tolerance_mm: Some(tolerance_mm), ..*choice };
    match with_tolerance.tolerance_acceleration_mm_per_s2() {
        None => {
            let expected = "an input_shaper.x, input_shaper.y or input_shaper.smooth_time_s in the profile: without a \
                            filter the path is exact, and junction_deviation_mm sets the speed of its corners";
            keys.refuse("path_tolerance_mm", expected);
        }
        Some(acceleration) if acceleration < MIN_ACCELERATION_MM_PER_S2 => {
            let least_mm = (tolerance_mm * MIN_ACCELERATION_MM_PER_S2 / acceleration * 1e4).ceil() * 1e-4;
            let expected = format!(
                "at least {least_mm:.4} mm, where short moves still accelerate at {MIN_ACCELERATION_MM_PER_S2} mm/s^2; or \
                 shorter filters: a higher input_shaper frequency_hz, a kind such as \"zv\" or a smaller smooth_time_s"
            );
            keys.refuse("path_tolerance_mm", expected);
        }
        _ => {}
    }
    Some(tolerance_mm)
}

/// Returns true if a motor goes through a filter.
pub(crate) fn is_shaped(choice: &MotionChoice) -> bool {
    choice.pressure_advance.is_some()
        || choice.smooth_time_s.is_some()
        || choice.shapers.iter().any(|shaper| shaper.kind != ShaperKind::None)
}

/// Pressure advance of an extruder, the lead with which it runs ahead of the flow; `None` without
/// the table, which then means `default`.
pub(crate) fn pressure_advance(keys: &Section<'_>, default: &'static str) -> Option<PressureAdvance> {
    let about = "how far the extruder [runs ahead of the flow](pressure-advance.md); M900, M572 and SET_PRESSURE_ADVANCE change it";
    let table = keys.optional_section("pressure_advance", default, about)?;
    let seconds = table.number("seconds", ADVANCE).required("K: filament advance, mm per mm/s of filament speed");
    let smooth_time_s = table.number("smooth_time_s", SMOOTH_TIME).optional(
        "nearly as long as the filters of X and Y spread the motion, at least 8 ms",
        "smoothing time of the advance",
    );
    let above =
        table.optional_section("above", "one K for all flow", "second K, for fast flow").map(|above| SecondSlope {
            filament_mm_per_s: above
                .number("filament_mm_per_s", FILAMENT_SPEED)
                .required("filament speed from which the second K applies"),
            seconds: above.number("seconds", ADVANCE).required("K from that speed on"),
        });
    Some(PressureAdvance { seconds, above, smooth_time_s })
}

/// Shapers of X and Y, and the time of the moving average.
fn filters(keys: &Section<'_>) -> ([AxisShaper; 2], Option<f64>) {
    let about = "[filters](input-shaping.md) that keep the frame from ringing; M593 and SET_INPUT_SHAPER change them";
    let table = keys.section_of_defaults("input_shaper", about);
    let shapers =
        ["x", "y"].map(|axis| (axis, table.optional_section(axis, "no filter", "").map(|axis| shaper(&axis))));
    let smooth_time_s = table.number("smooth_time_s", AXES_SMOOTH_TIME).optional(
        "no moving average",
        "time over which X, Y, Z and the extruder are also [averaged](input-shaping.md#a-limit-for-the-jerk): the \
         acceleration changes within it; only with `acceleration = \"trapezoid\"`",
    );
    if let Some(time_s) = smooth_time_s
        && let Ok(ticks) = smooth_ticks(smooth_time_s)
    {
        let alone = |shaper: &AxisShaper| shaper.kernel().is_ok();
        for (axis, shaper) in &shapers {
            // A filter that is too long alone is refused by its own keys.
            if let Some(shaper) = shaper.filter(alone)
                && let Err(ShaperError::TooLong { .. }) = shaper.kernel_beside(ticks)
            {
                let most_ms =
                    100.0 - f64::from(shaper.kernel().map_or(0, |kernel| kernel.length_ticks())) * MS_PER_TICK;
                let expected = format!(
                    "at most {:.4} s beside input_shaper.{axis}, which with {time_s} s lasts longer than 100 ms; or at least {} Hz \
                     there",
                    (most_ms * 10.0).floor() * 1e-4,
                    shaper.lowest_frequency_hz(ticks)
                );
                table.refuse("smooth_time_s", expected);
            }
        }
    }
    (shapers.map(|(_, shaper)| shaper.unwrap_or(AxisShaper::NONE)), smooth_time_s)
}

/// The shaper of one axis, with a filter that is not too long.
fn shaper(table: &Section<'_>) -> AxisShaper {
    let kind = table
        .word_or("kind", ShaperKind::NAMED, "mzv(5,0.9)", ShaperKind::from_name)
        .required("shaper type ([which one](input-shaping.md#which-one))");
    let frequency_hz = table
        .number("frequency_hz", SHAPER_FREQUENCY)
        .required("ringing frequency of the axis, high enough that the filter lasts at most 100 ms");
    let damping = table.number("damping", SHAPER_DAMPING).or(
        AxisShaper::NONE.damping,
        "damping ratio; at most 0.4 for `\"ei\"`, 0.3 for `\"2hump_ei\"`, 0.2 for `\"3hump_ei\"`",
    );
    let shaper = AxisShaper { kind, frequency_hz, damping };
    let name = kind.to_string();
    match shaper.kernel() {
        Ok(_) => {}
        // The range above has refused the first; the others do not concern a single filter.
        Err(
            ShaperError::Frequency
            | ShaperError::Methods
            | ShaperError::UnequalMotors
            | ShaperError::SmoothTime
            | ShaperError::SmoothSCurve,
        ) => {}
        Err(ShaperError::Damping) => table.refuse("damping", format!("0 to {} for {name:?}", kind.max_damping())),
        Err(ShaperError::Spacing) => table.refuse("kind", format!("in mzv(N,T) {}", EvenSpacing::RULE)),
        Err(ShaperError::TooLong { .. }) => {
            let lowest_hz = shaper.lowest_frequency_hz(0);
            let expected = format!(
                "at least {lowest_hz} Hz for {name:?}, whose filter would last longer than 100 ms; or a shorter kind"
            );
            table.refuse("frequency_hz", expected);
        }
    }
    shaper
}

/// Periods, the longest not below the shortest.
fn dual_rate(keys: &Section<'_>) -> DualRatePeriods {
    let default = MotionChoice::DEFAULT.dual_rate;
    let table = keys.optional_section("dual_rate", "10 and 3000 µs", "pulse periods of a motor under `\"dual-rate\"`");
    let Some(table) = table else { return default };
    let shortest_us = table.number("min_period_us", PERIOD).required("shortest pulse period planned for a motor");
    let longest_us = table.number("max_period_us", PERIOD.at_least(shortest_us, "at least min_period_us")).required(
        "if one motor has more than max/min times the other's pulses, `\"minimum-deviation\"` is used instead",
    );
    let [shortest_ns, longest_ns] = [shortest_us, longest_us].map(|us| (us * 1e3).round() as u32);
    DualRatePeriods { shortest_ns, longest_ns }
}

/// The table of frequencies; it ends above where it starts.
fn s_curve_table(keys: &Section<'_>) -> SCurveTableSettings {
    let about = "ramp of `\"s-curve-table\"`: step rates of a block's busiest motor, which no block exceeds";
    let absent = "1000 to 10 000 steps/s, 100 000 steps/s³";
    let Some(table) = keys.optional_section("s_curve_table", absent, about) else {
        return MotionChoice::DEFAULT.s_curve_table;
    };
    let start_hz = table
        .number("start_hz", range(FREQUENCY.low, FREQUENCY.high - 1.0, FREQUENCY.unit))
        .required("highest step rate at which a motor starts without a ramp")
        .round();
    let top_hz = table
        .number("top_hz", FREQUENCY.at_least(start_hz + 1.0, "above start_hz"))
        .required("step rate at the end of the ramp")
        .round();
    let jerk = table
        .number("jerk_hz_per_s2", TABLE_JERK)
        .required("jerk of the ramp, large enough for at most 65 536 slices of 2/`start_hz`")
        .round();
    let settings =
        SCurveTableSettings { start_hz: start_hz as u32, top_hz: top_hz as u32, jerk_hz_per_s2: jerk as u32 };
    if settings.slices() > f64::from(SCurveTableSettings::MAX_SLICES) {
        let expected = "a table of at most 65536 slices of 2/start_hz: a larger jerk or a lower start_hz";
        table.refuse("jerk_hz_per_s2", expected);
    }
    settings
}
