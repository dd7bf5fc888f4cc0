//! Where the axes home, how, and what keeps the nozzle off the bed meanwhile.

use std::ops::RangeInclusive;

use ferrostep_checked_toml::{Checker, Range, range};
use ferrostep_hal_shim::tmc2209::{DriverSettings, STALL_FULL_STEPS_PER_S};
use ferrostep_planner::Limits;
use ferrostep_printer::{AxisHoming, HomeEnd, HomeSensor, SafeHoming};
use toml::Spanned;

use crate::ProfileError;
use crate::check::CheckAxes;
use crate::convert::{FEED, units_10nm};
use crate::file::{DriverTables, EndName, HomingTable, Number, ProfileFile, SensorName, Xyz};

const SIZE: Range = range(10.0, 2_000.0, "mm");
const LOWER_END: Range = range(-1_000.0, 0.0, "mm");
const BACK_OFF: Range = range(0.1, 50.0, "mm");
const OVERRUN: Range = range(0.0, 30.0, "mm");
const AGREE: Range = range(0.01, 2.0, "mm");
const RAISE: Range = range(0.5, 50.0, "mm");
const PROBE_OFFSET: Range = range(-300.0, 300.0, "mm");

/// How much longer than the travel a frame may be, and how far apart two approaches may end, where a profile does not say.
const DEFAULT_OVERRUN_MM: f64 = 5.0;
const DEFAULT_AGREE_MM: f64 = 0.5;
/// The same of a probe, which is looked at without a stalling motor in between.
const DEFAULT_PROBE_AGREE_MM: f64 = 0.2;

/// Ends of the travel of X, Y and Z, mm.
pub struct Travel {
    /// Lower ends, at most 0.
    pub lower_mm: [f64; 3],
    /// Upper ends.
    pub upper_mm: [f64; 3],
}

impl Travel {
    /// As the file has it.
    pub fn new(file: &ProfileFile, check: &Checker<'_>) -> Result<Self, ProfileError> {
        let upper_mm = check.three("size_mm", &file.size_mm, SIZE)?;
        let lower_mm = match &file.lower_end_mm {
            Some(ends) => check.three("lower_end_mm", ends, LOWER_END)?,
            None => [0.0; 3],
        };
        Ok(Self { lower_mm, upper_mm })
    }

    /// Of one axis.
    fn of(&self, axis: usize) -> RangeInclusive<f64> {
        self.lower_mm[axis]..=self.upper_mm[axis]
    }
}

/// Homing of X, Y and Z.
pub fn axes(
    file: &ProfileFile,
    travel: &Travel,
    steps_per_mm: [f64; 4],
    limits: &Limits,
    drivers: &[Option<DriverSettings>; 4],
    check: &Checker<'_>,
) -> Result<[AxisHoming; 3], ProfileError> {
    let axis = |axis: usize, name, table| {
        let homing = homing(name, table, travel.of(axis), limits.max_feed_mm_per_s[axis], check)?;
        if homing.sensor == HomeSensor::Stall {
            let acceleration = limits.max_acceleration_mm_per_s2[axis].min(limits.travel_acceleration_mm_per_s2);
            homing_by_stall(name, table, steps_per_mm[axis], acceleration, &file.drivers, &drivers[axis], check)?;
        }
        Ok(homing)
    };
    Ok([axis(0, "x", &file.homing.x)?, axis(1, "y", &file.homing.y)?, axis(2, "z", &file.homing.z)?])
}

/// What keeps the nozzle off the bed. A probe needs all of it; without one the nozzle may home where it is.
pub fn safe(
    file: &ProfileFile,
    travel: &Travel,
    z: &AxisHoming,
    check: &Checker<'_>,
) -> Result<SafeHoming, ProfileError> {
    let tables = &file.homing;
    let is_probe = z.sensor == HomeSensor::Probe;
    let needed = |key: &str, why: &str| {
        let shown = Spanned::new(tables.z.sensor.span(), "\"probe\"");
        check.refuse("homing.z.sensor", &shown, format!("{key} with it: {why}"))
    };
    if is_probe {
        if tables.home_at_mm.is_none() {
            let why = "the probe finds the bed only where it is above it, such as home_at_mm = { x = 100, y = 100 }";
            return Err(needed("homing.home_at_mm", why));
        }
        if tables.raise_mm.is_none() {
            let why = "X and Y home at an unknown height, such as raise_mm = 5";
            return Err(needed("homing.raise_mm", why));
        }
        if tables.probe_offset_mm.is_none() {
            let why = "where it is beside the nozzle, such as probe_offset_mm = { x = -29, y = -3, z = 0 }";
            return Err(needed("homing.probe_offset_mm", why));
        }
    }
    let probe_offset_mm = match &tables.probe_offset_mm {
        Some(offset) if is_probe => probe_offset(offset, check)?,
        Some(offset) => {
            let expected = "homing.z.sensor = \"probe\" with it: only a probe is beside the nozzle";
            return Err(check.refuse("homing.probe_offset_mm.x", &offset.x, expected));
        }
        None => [0.0; 3],
    };
    let bed_mm = bed(file, travel, check)?;
    let home_at_10nm = home_at(file, travel, bed_mm, probe_offset_mm, check)?;
    let highest = range(RAISE.low, RAISE.high.min(travel.upper_mm[2] / 2.0), "mm, and at most half of size_mm.z");
    let raise_mm = tables.raise_mm.as_ref().map(|raise| check.number("homing.raise_mm", raise, highest)).transpose()?;
    Ok(SafeHoming {
        raise_10nm: raise_mm.map_or(0, units_10nm),
        home_at_10nm,
        probe_offset_10nm: probe_offset_mm.map(units_10nm),
        bed_10nm: bed_mm.map(|ends| ends.map(units_10nm)),
    })
}

/// From the nozzle to the probe.
fn probe_offset(offset: &Xyz, check: &Checker<'_>) -> Result<[f64; 3], ProfileError> {
    let [lowest, highest] = SafeHoming::PROBE_Z_10NM.map(|length_10nm| length_10nm as f64 / 100_000.0);
    let z =
        range(lowest, highest, "mm: the nozzle is 0 to 10 mm above the bed when the probe triggers, and Z is negative");
    Ok([
        check.number("homing.probe_offset_mm.x", &offset.x, PROBE_OFFSET)?,
        check.number("homing.probe_offset_mm.y", &offset.y, PROBE_OFFSET)?,
        check.number("homing.probe_offset_mm.z", &offset.z, z)?,
    ])
}

/// Where the bed is; the travel where the file does not say.
fn bed(file: &ProfileFile, travel: &Travel, check: &Checker<'_>) -> Result<[[f64; 2]; 2], ProfileError> {
    let whole = [0, 1].map(|axis: usize| [travel.lower_mm[axis], travel.upper_mm[axis]]);
    let Some(bed) = &file.homing.bed_mm else { return Ok(whole) };
    for (name, ends) in [("x", &bed.x), ("y", &bed.y)] {
        let [from, to] = *ends.get_ref();
        if !(-2_000.0..=2_000.0).contains(&from) || !(-2_000.0..=2_000.0).contains(&to) || from >= to {
            let shown = Spanned::new(ends.span(), format!("[{from}, {to}]"));
            let expected = "the bed's lower and upper end within -2000 to 2000 mm, such as [0, 180]";
            return Err(check.refuse(&format!("homing.bed_mm.{name}"), &shown, expected));
        }
    }
    Ok([*bed.x.get_ref(), *bed.y.get_ref()])
}

/// Where the nozzle homes Z: within the travel, and with the probe above the bed.
fn home_at(
    file: &ProfileFile,
    travel: &Travel,
    bed_mm: [[f64; 2]; 2],
    probe_offset_mm: [f64; 3],
    check: &Checker<'_>,
) -> Result<Option<[i64; 2]>, ProfileError> {
    let Some(place) = &file.homing.home_at_mm else { return Ok(None) };
    let place = place.get_ref();
    for (axis, (name, value)) in [("x", &place.x), ("y", &place.y)].into_iter().enumerate() {
        let key = format!("homing.home_at_mm.{name}");
        let mm = check.number(&key, value, range(travel.lower_mm[axis], travel.upper_mm[axis], "mm, the travel"))?;
        let ([from, to], offset) = (bed_mm[axis], probe_offset_mm[axis]);
        if !(from..=to).contains(&(mm + offset)) {
            let expected = format!(
                "{} to {} mm: the probe is {offset} mm beside the nozzle (homing.probe_offset_mm.{name}), and misses the bed, \
                 which reaches from {from} to {to} mm (homing.bed_mm)",
                from - offset,
                to - offset
            );
            return Err(check.refuse(&key, value, expected));
        }
    }
    Ok(Some([*place.x.get_ref(), *place.y.get_ref()].map(units_10nm)))
}

/// Homing of one axis, within its travel and its speed.
fn homing(
    axis: &str,
    table: &HomingTable,
    travel_mm: RangeInclusive<f64>,
    max_feed_mm_per_s: f64,
    check: &Checker<'_>,
) -> Result<AxisHoming, ProfileError> {
    let key = |name: &str| format!("homing.{axis}.{name}");
    let shown = |word| toml::Spanned::new(table.sensor.span(), word);
    let sensor = match table.sensor.get_ref() {
        SensorName::EndStop => HomeSensor::EndStop,
        SensorName::Probe if axis == "z" => HomeSensor::Probe,
        SensorName::Probe => {
            let expected = "\"end-stop\" or \"stall\": only Z homes by a probe";
            return Err(check.refuse(&key("sensor"), &shown("\"probe\""), expected));
        }
        SensorName::Stall if axis != "z" => HomeSensor::Stall,
        SensorName::Stall => {
            let expected = "\"end-stop\" or \"probe\": Z would push the nozzle into the bed";
            return Err(check.refuse(&key("sensor"), &shown("\"stall\""), expected));
        }
    };
    if sensor == HomeSensor::Stall && table.triggers_low {
        let expected = "an end stop or a probe at triggers_low = true: a stall signal is high";
        return Err(check.refuse(&key("sensor"), &shown("\"stall\""), expected));
    }
    // An end that contradicts its position would let the soft limits drive into the frame.
    let (lower, upper) = (*travel_mm.start(), *travel_mm.end());
    let middle = (lower + upper) / 2.0;
    let (end, travel) = match table.end {
        EndName::Min => (HomeEnd::Min, range(lower, middle, "mm")),
        EndName::Max => (HomeEnd::Max, range(middle, upper, "mm")),
    };
    let position = table.position_mm.get_ref();
    if !(travel.low..=travel.high).contains(position) {
        let word = if end == HomeEnd::Min { "min" } else { "max" };
        let expected = format!("{travel}, the half of the travel at end = \"{word}\"");
        return Err(check.refuse(&key("position_mm"), &table.position_mm, expected));
    }
    let fast_mm_per_s = check.number(
        &key("fast_mm_per_s"),
        &table.fast_mm_per_s,
        range(FEED.low, max_feed_mm_per_s, "mm/s, the axis's max_feed_mm_per_s"),
    )?;
    let slow_mm_per_s = check.number(
        &key("slow_mm_per_s"),
        &table.slow_mm_per_s,
        range(FEED.low, fast_mm_per_s, "mm/s, this axis's fast_mm_per_s"),
    )?;
    let back_off = range(BACK_OFF.low, BACK_OFF.high.min((upper - lower) / 2.0), BACK_OFF.unit);
    let optional = |name: &str, value: &Option<Number>, range, default| match value {
        Some(value) => check.number(&key(name), value, range),
        None => Ok(default),
    };
    let default_agree_mm = if sensor == HomeSensor::Probe { DEFAULT_PROBE_AGREE_MM } else { DEFAULT_AGREE_MM };
    Ok(AxisHoming {
        end,
        sensor,
        triggers_low: table.triggers_low,
        position_10nm: units_10nm(*position),
        fast_mm_per_s,
        slow_mm_per_s,
        back_off_10nm: units_10nm(check.number(&key("back_off_mm"), &table.back_off_mm, back_off)?),
        overrun_10nm: units_10nm(optional("overrun_mm", &table.overrun_mm, OVERRUN, DEFAULT_OVERRUN_MM)?),
        agree_10nm: units_10nm(optional("agree_mm", &table.agree_mm, AGREE, default_agree_mm)?),
    })
}

/// What a stall signal needs: a driver that gives one, and a motor that is fast enough for it on both approaches.
fn homing_by_stall(
    axis: &str,
    table: &HomingTable,
    steps_per_mm: f64,
    acceleration_mm_per_s2: f64,
    driver_tables: &DriverTables,
    driver: &Option<DriverSettings>,
    check: &Checker<'_>,
) -> Result<(), ProfileError> {
    let key = |name: &str| format!("homing.{axis}.{name}");
    let driver_table = if axis == "x" { &driver_tables.x } else { &driver_tables.y };
    let (Some(driver), Some(driver_table)) = (driver, driver_table) else {
        let shown = toml::Spanned::new(table.sensor.span(), "\"stall\"");
        let expected = format!("\"end-stop\": the stall signal is a TMC2209's, and there is no table [drivers.{axis}]");
        return Err(check.refuse(&key("sensor"), &shown, expected));
    };
    let driver_key = |name: &str| format!("drivers.{axis}.{name}");
    if driver.stall_threshold == 0 {
        let expected = format!("1 to 255: homing.{axis}.sensor is \"stall\", and at 0 no stall signal comes");
        return Err(check.refuse(&driver_key("stall_threshold"), &driver_table.stall_threshold, expected));
    }
    if !driver.stealth_chop {
        let shown = toml::Spanned::new(table.sensor.span(), "\"stall\"");
        let expected = format!("drivers.{axis}.stealth_chop = true with it: in spreadCycle no stall signal comes");
        return Err(check.refuse(&key("sensor"), &shown, expected));
    }
    let slowest = f64::from(STALL_FULL_STEPS_PER_S) * f64::from(driver.microsteps) / steps_per_mm;
    let slow_mm_per_s = *table.slow_mm_per_s.get_ref();
    if slow_mm_per_s < slowest {
        let expected = format!(
            "at least {slowest:.1} mm/s for \"stall\", {STALL_FULL_STEPS_PER_S} full steps a second: the driver cannot \
             tell the load of a slower motor"
        );
        return Err(check.refuse(&key("slow_mm_per_s"), &table.slow_mm_per_s, expected));
    }
    // The signal stops where spreadCycle takes over.
    let fast_mm_per_s = *table.fast_mm_per_s.get_ref();
    let until = *driver_table.spread_cycle_above_mm_per_s.get_ref();
    if until > 0.0 && until <= fast_mm_per_s {
        let expected =
            format!("0 or above homing.{axis}.fast_mm_per_s = {fast_mm_per_s}: in spreadCycle no stall signal comes");
        let key = driver_key("spread_cycle_above_mm_per_s");
        return Err(check.refuse(&key, &driver_table.spread_cycle_above_mm_per_s, expected));
    }
    // Within half of the way back the second approach must have its speed.
    let least_mm = slow_mm_per_s * slow_mm_per_s / acceleration_mm_per_s2;
    if *table.back_off_mm.get_ref() < least_mm {
        let expected = format!("at least {least_mm:.1} mm for \"stall\", to reach {slow_mm_per_s} mm/s in half of it");
        return Err(check.refuse(&key("back_off_mm"), &table.back_off_mm, expected));
    }
    Ok(())
}
