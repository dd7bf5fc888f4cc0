//! Homing of the axes: places, order, sensors, and the keys that keep the nozzle off
//! the bed meanwhile.

use ferrostep_checked_toml::{Range, Section, range};
use ferrostep_planner::Limits;
use ferrostep_printer::{AxisHoming, HomeEnd, HomeSensor, SafeHoming};
use ferrostep_tmc2209::{DriverSettings, STALL_FULL_STEPS_PER_S};

use crate::axes::{AXES, FEED, Travel, units_10nm};

const PLACE: Range = range(-1_000.0, 2_000.0, "mm");
const BACK_OFF: Range = range(0.1, 50.0, "mm");
const OVERRUN: Range = range(0.0, 30.0, "mm");
const AGREE: Range = range(0.01, 2.0, "mm");
const RAISE: Range = range(0.5, 50.0, "mm");
const PROBE_OFFSET: Range = range(-300.0, 300.0, "mm");
const BED: Range = range(-2_000.0, 2_000.0, "mm");

/// Default of `overrun_mm`: how much longer than the travel the frame may be, and how far apart two
/// approaches may end.
const DEFAULT_OVERRUN_MM: f64 = 5.0;
const DEFAULT_AGREE_MM: f64 = 0.5;
/// The same for a probe, which triggers without a stalling motor.
const DEFAULT_PROBE_AGREE_MM: f64 = 0.2;

/// Homing of X, Y and Z, and the keys that keep the nozzle off the bed.
pub(crate) fn homing(
    keys: &Section<'_>,
    travel: &Travel,
    steps_per_mm: [f64; 4],
    limits: &Limits,
    drivers: &[Option<DriverSettings>; 4],
) -> ([AxisHoming; 3], SafeHoming) {
    let tables = keys.section(
        "homing",
        "[homing](homing.md) of each axis; a probe needs `raise_mm`, `home_at_mm` and `probe_offset_mm` too",
    );
    let safe = SafeKeys::read(&tables, travel);
    let mut index = 0..;
    let axes = AXES.map(|axis| {
        let index = index.next().unwrap_or_default();
        let table = tables.section(axis, "");
        let lengths = Lengths::read(
            &table,
            axis,
            [travel.lower_mm[index], travel.upper_mm[index]],
            limits.max_feed_mm_per_s[index],
        );
        if lengths.homing.sensor == HomeSensor::Stall {
            let acceleration = limits.max_acceleration_mm_per_s2[index].min(limits.travel_acceleration_mm_per_s2);
            by_stall(&table, axis, &lengths, steps_per_mm[index], acceleration, &drivers[index]);
        }
        lengths.homing
    });
    let safe = safe.checked(&tables, axes[2].sensor == HomeSensor::Probe);
    (axes, safe)
}

/// The keys that keep the nozzle off the bed, as the file has them.
struct SafeKeys {
    raise_mm: Option<f64>,
    home_at_mm: Option<[f64; 2]>,
    probe_offset_mm: Option<[f64; 3]>,
    bed_mm: [[f64; 2]; 2],
    is_round: bool,
}

impl SafeKeys {
    fn read(tables: &Section<'_>, travel: &Travel) -> Self {
        let within =
            [0, 1].map(|axis| PLACE.between(travel.lower_mm[axis], travel.upper_mm[axis], "within the travel"));
        let [lowest, highest] = SafeHoming::PROBE_Z_10NM.map(|length_10nm| length_10nm as f64 / 100_000.0);
        let offset_z = range(lowest, highest, "mm");
        // Where a probe triggers is measured on each machine, and a bed's outline changes no plan.
        let apart = tables.apart();
        let (bed_mm, is_round) = bed(&apart, travel);
        Self {
            raise_mm: tables
                .number("raise_mm", RAISE.at_most(travel.upper_mm[2] / 2.0, "at most half of size_mm.z"))
                .optional(
                    "0",
                    "minimum height above the bed while X and Y home; an unhomed Z is raised by it: leave that much \
                     room above the travel",
                ),
            home_at_mm: tables.numbers("home_at_mm", ["x", "y"], within).optional(
                "the current position",
                "nozzle position for homing Z, with the probe above the bed; Z then homes only with X and Y homed",
            ),
            probe_offset_mm: apart.numbers("probe_offset_mm", AXES, [PROBE_OFFSET, PROBE_OFFSET, offset_z]).optional(
                "",
                "with a probe only: offset from the nozzle's tip to the probe's trigger point (M851); z = −1: the \
                 probe triggers with the nozzle 1 mm above the bed; z above 0 only corrects a measurement",
            ),
            bed_mm,
            is_round,
        }
    }

    /// A probe needs all of it; without one the nozzle may home where it is.
    fn checked(self, tables: &Section<'_>, is_probe: bool) -> SafeHoming {
        let needed = |is_missing: bool, key: &str, why: &str| {
            if is_probe && is_missing {
                tables.refuse("z.sensor", format!("homing.{key} with it: {why}"));
            }
        };
        needed(
            self.home_at_mm.is_none(),
            "home_at_mm",
            "Z homes where the probe is above the bed; for example home_at_mm = { x = 100, y = 100 }",
        );
        needed(
            self.raise_mm.is_none(),
            "raise_mm",
            "X and Y would home at an unknown height; for example raise_mm = 5",
        );
        needed(
            self.probe_offset_mm.is_none(),
            "probe_offset_mm",
            "the offset from the nozzle to the probe; for example probe_offset_mm = { x = -29, y = -3, z = 0 }",
        );
        if self.probe_offset_mm.is_some() && !is_probe {
            let expected = "homing.z.sensor = \"probe\" with it: only a probe is offset from the nozzle";
            tables.refuse("probe_offset_mm.x", expected);
        }
        let offset_mm = self.probe_offset_mm.unwrap_or_default();
        if let Some(place_mm) = self.home_at_mm {
            for (axis, mm) in place_mm.into_iter().enumerate() {
                let (name, [from, to], offset) = (AXES[axis], self.bed_mm[axis], offset_mm[axis]);
                if (from..=to).contains(&(mm + offset)) {
                    continue;
                }
                let expected = format!(
                    "{} to {} mm: the probe is {offset} mm beside the nozzle (homing.probe_offset_mm.{name}), and misses the \
                     bed, which reaches from {from} to {to} mm (homing.bed_mm)",
                    from - offset,
                    to - offset
                );
                tables.refuse(&format!("home_at_mm.{name}"), expected);
            }
        }
        let safe = SafeHoming {
            raise_10nm: self.raise_mm.map_or(0, units_10nm),
            home_at_10nm: self.home_at_mm.map(|place| place.map(units_10nm)),
            probe_offset_10nm: offset_mm.map(units_10nm),
            bed_10nm: self.bed_mm.map(|ends| ends.map(units_10nm)),
            is_round: self.is_round,
        };
        let [offset_x, offset_y, _] = safe.probe_offset_10nm;
        if safe.home_at_10nm.is_some_and(|[x, y]| !safe.is_above_bed([x + offset_x, y + offset_y])) {
            let expected = "a place where the probe, homing.probe_offset_mm beside the nozzle, is above the round bed (homing.bed_mm)";
            tables.refuse("home_at_mm.x", expected);
        }
        safe
    }
}

/// Place of the bed, and true if it is a circle; the whole travel if the file has no `bed_mm`.
fn bed(tables: &Section<'_>, travel: &Travel) -> ([[f64; 2]; 2], bool) {
    let whole = [0, 1].map(|axis: usize| [travel.lower_mm[axis], travel.upper_mm[axis]]);
    let about = "extent of the bed, for the probe";
    let Some(table) = tables.optional_section("bed_mm", "the whole travel", about) else { return (whole, false) };
    let ends @ [[left, right], [front, back]] = ["x", "y"].map(|axis| table.ends(axis, BED).required(""));
    let is_round = table
        .flag("round")
        .or(false, "the bed is the circle between these ends: [only it is probed](levelling.md#a-round-bed)");
    if is_round && units_10nm(right - left) != units_10nm(back - front) {
        table.refuse("y", format!("{} mm from end to end as X has, for a round bed", right - left));
    }
    (ends, is_round)
}

/// Homing of one axis, and its lengths and speeds as the file has them.
struct Lengths {
    homing: AxisHoming,
    back_off_mm: f64,
}

impl Lengths {
    /// Within the axis's travel and speed.
    fn read(table: &Section<'_>, axis: &str, [lower, upper]: [f64; 2], max_feed_mm_per_s: f64) -> Self {
        let apart = table.apart();
        let end = apart
            .word("end", [("min", HomeEnd::Min), ("max", HomeEnd::Max)])
            .required("end of the travel towards which the axis homes");
        let sensors = [("end-stop", HomeSensor::EndStop), ("probe", HomeSensor::Probe), ("stall", HomeSensor::Stall)];
        let sensor = apart.word("sensor", sensors).required(
            "sensor at that end ([Homing](homing.md)): a switch; on Z, a probe; on X and Y, the driver's stall signal \
             (`stall_threshold`) at the frame",
        );
        let triggers_low =
            apart.flag("triggers_low").or(false, "the sensor's signal is low when it triggers; a stall signal is high");
        let position_mm = table
            .number("position_mm", PLACE.at_most(PLACE.high, "in the half of the travel that end names"))
            .required("machine coordinate at which the sensor triggers; with a probe, the bed's");
        let fast_mm_per_s = apart
            .number("fast_mm_per_s", FEED.at_most(max_feed_mm_per_s, "at most the axis's max_feed_mm_per_s"))
            .required("speed of the first approach");
        let slow_mm_per_s = apart
            .number("slow_mm_per_s", FEED.at_most(fast_mm_per_s, "at most this axis's fast_mm_per_s"))
            .required("speed of the second approach, which sets the position");
        let back_off_mm = apart
            .number("back_off_mm", BACK_OFF.at_most((upper - lower) / 2.0, "at most half of the travel"))
            .required("distance backed off between the two approaches");
        let overrun_mm = apart.number("overrun_mm", OVERRUN).or(
            DEFAULT_OVERRUN_MM,
            "how much longer than the travel the frame may be: an approach from an unknown position ends after the \
             travel plus this",
        );
        let default_agree_mm = if sensor == HomeSensor::Probe { DEFAULT_PROBE_AGREE_MM } else { DEFAULT_AGREE_MM };
        let agree_mm = apart
            .number("agree_mm", AGREE)
            .optional(
                "0.5, for a probe 0.2",
                "maximum difference between the trigger positions of the two approaches; beyond it twice, homing fails",
            )
            .unwrap_or(default_agree_mm);
        match sensor {
            HomeSensor::Probe if axis != "z" => {
                table.refuse("sensor", "\"end-stop\" or \"stall\": only Z homes by a probe");
            }
            HomeSensor::Stall if axis == "z" => {
                table.refuse("sensor", "\"end-stop\" or \"probe\": Z would push the nozzle into the bed");
            }
            HomeSensor::Stall if triggers_low => {
                table.refuse("sensor", "an end stop or a probe at triggers_low = true: a stall signal is high");
            }
            _ => {}
        }
        // An end that contradicts its position would let the soft limits drive into the frame.
        let middle = (lower + upper) / 2.0;
        let (half, word) = match end {
            HomeEnd::Min => (range(lower, middle, "mm"), "min"),
            HomeEnd::Max => (range(middle, upper, "mm"), "max"),
        };
        if !half.contains(position_mm) {
            table.refuse("position_mm", format!("{half}, the half of the travel at end = \"{word}\""));
        }
        let homing = AxisHoming {
            end,
            sensor,
            triggers_low,
            position_10nm: units_10nm(position_mm),
            fast_mm_per_s,
            slow_mm_per_s,
            back_off_10nm: units_10nm(back_off_mm),
            overrun_10nm: units_10nm(overrun_mm),
            agree_10nm: units_10nm(agree_mm),
        };
        Self { homing, back_off_mm }
    }
}

/// Checks the requirements of a stall signal: a driver that gives one, and a motor that is fast
/// enough for it on both approaches.
fn by_stall(
    table: &Section<'_>,
    axis: &str,
    lengths: &Lengths,
    steps_per_mm: f64,
    acceleration_mm_per_s2: f64,
    driver: &Option<DriverSettings>,
) {
    let AxisHoming { fast_mm_per_s, slow_mm_per_s, .. } = lengths.homing;
    let Some(driver) = driver else {
        let expected =
            format!("\"end-stop\": the stall signal needs a TMC2209, and the table [drivers.{axis}] is missing");
        return table.refuse("sensor", expected);
    };
    let driver_key = |name: &str| format!("drivers.{axis}.{name}");
    if driver.stall_threshold == 0 {
        let expected = format!("1 to 255: homing.{axis}.sensor is \"stall\", and at 0 no stall signal comes");
        table.reader().refuse(&driver_key("stall_threshold"), expected);
    }
    if !driver.stealth_chop {
        let expected = format!("drivers.{axis}.stealth_chop = true with it: in spreadCycle no stall signal comes");
        table.refuse("sensor", expected);
    }
    let slowest = f64::from(STALL_FULL_STEPS_PER_S) * f64::from(driver.microsteps) / steps_per_mm;
    if slow_mm_per_s < slowest {
        let expected = format!(
            "at least {slowest:.1} mm/s for \"stall\", {STALL_FULL_STEPS_PER_S} full steps a second: the driver cannot \
             measure the load of a slower motor"
        );
        table.refuse("slow_mm_per_s", expected);
    }
    // The signal stops where spreadCycle takes over.
    if driver.leaves_stealth_chop_at(fast_mm_per_s) {
        let expected =
            format!("0 or above homing.{axis}.fast_mm_per_s = {fast_mm_per_s}: in spreadCycle no stall signal comes");
        table.reader().refuse(&driver_key("spread_cycle_above_mm_per_s"), expected);
    }
    // Within half of the path back the second approach must have its speed.
    let least_mm = slow_mm_per_s * slow_mm_per_s / acceleration_mm_per_s2;
    if lengths.back_off_mm < least_mm {
        let expected = format!("at least {least_mm:.1} mm for \"stall\", to reach {slow_mm_per_s} mm/s in half of it");
        table.refuse("back_off_mm", expected);
    }
}
