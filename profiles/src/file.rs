//! The shape of a profile's text: names of keys and their types, no ranges.
//!
//! Every value carries its span, so that a refused one can be found in the text. What the keys mean is said in the
//! built-in profiles.

use std::fmt;

use serde::de::value::MapAccessDeserializer;
use serde::de::{self, IntoDeserializer, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use toml::Spanned;

/// A number with its place in the text; TOML integers are taken too.
pub type Number = Spanned<f64>;

/// A whole profile.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "a profile")]
pub struct ProfileFile {
    pub name: Spanned<String>,
    pub kinematics: KinematicsName,
    pub size_mm: Xyz,
    pub lower_end_mm: Option<Xyz>,
    pub steps_per_mm: Xyze,
    pub max_feed_mm_per_s: Xyze,
    pub max_acceleration_mm_per_s2: Xyze,
    pub acceleration_mm_per_s2: MoveAccelerations,
    pub junction_deviation_mm: Number,
    #[serde(default)]
    pub instantaneous_corner_velocity_mm_per_s: CornerVelocityTable,
    pub jerk_mm_per_s3: Number,
    pub minimum_event_interval_us: Number,
    pub min_extrusion_celsius: Number,
    pub heater_timeout_s: Option<Number>,
    pub homing: HomingTables,
    pub nozzle: HeaterTable,
    pub bed: HeaterTable,
    pub firmware_retraction: RetractionTable,
    pub driver: DriverTable,
    #[serde(default)]
    pub budget: BudgetTable,
    #[serde(default)]
    pub interpolation: InterpolationName,
    #[serde(default)]
    pub acceleration: AccelerationName,
    pub dual_rate: Option<DualRateTable>,
    pub s_curve_table: Option<SCurveTable>,
    #[serde(default)]
    pub extrusion: ExtrusionTable,
    #[serde(default)]
    pub drivers: DriverTables,
}

/// Filament for moves that tell none.
#[derive(Default, Deserialize)]
#[serde(
    deny_unknown_fields,
    expecting = "a table with the keys mode, layer_height_mm, line_width_mm, filament_diameter_mm"
)]
pub struct ExtrusionTable {
    #[serde(default)]
    pub mode: ExtrusionName,
    pub layer_height_mm: Option<Number>,
    pub line_width_mm: Option<Number>,
    pub filament_diameter_mm: Option<Number>,
}

/// Where filament comes from.
#[derive(Clone, Copy, Default, Deserialize, PartialEq)]
#[serde(rename_all = "kebab-case")]
pub enum ExtrusionName {
    #[default]
    Gcode,
    Adaptive,
}

/// How steps follow a line.
#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum InterpolationName {
    #[default]
    StepBresenham,
    Bresenham,
    PointByPoint,
    MinimumDeviation,
    DualRate,
}

/// How speed changes.
#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AccelerationName {
    #[default]
    Trapezoid,
    SCurve,
    SCurveTable,
}

/// Pulse periods of a motor.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table with the keys min_period_us, max_period_us")]
pub struct DualRateTable {
    pub min_period_us: Number,
    pub max_period_us: Number,
}

/// What the table of frequencies is made of.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table with the keys start_hz, top_hz, jerk_hz_per_s2")]
pub struct SCurveTable {
    pub start_hz: Number,
    pub top_hz: Number,
    pub jerk_hz_per_s2: Number,
}

/// How X and Y are driven.
#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum KinematicsName {
    Cartesian,
    CoreXy,
}

/// A value for each axis of the plane.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table with the keys x, y")]
pub struct Xy {
    pub x: Number,
    pub y: Number,
}

/// Where the bed is, lower and upper end along each axis of the plane.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table such as { x = [0, 180], y = [0, 180] }")]
pub struct BedTable {
    pub x: Spanned<[f64; 2]>,
    pub y: Spanned<[f64; 2]>,
}

/// A value for each of the three axes.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table with the keys x, y, z")]
pub struct Xyz {
    pub x: Number,
    pub y: Number,
    pub z: Number,
}

/// A value for each of the three axes and the extruder.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table with the keys x, y, z, e")]
pub struct Xyze {
    pub x: Number,
    pub y: Number,
    pub z: Number,
    pub e: Number,
}

/// A limit for some of the axes and the extruder.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table with any of the keys x, y, z, e")]
pub struct CornerVelocityTable {
    pub x: Option<Number>,
    pub y: Option<Number>,
    pub z: Option<Number>,
    pub e: Option<Number>,
}

/// Acceleration by the kind of move.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table with the keys print, travel, retract")]
pub struct MoveAccelerations {
    pub print: Number,
    pub travel: Number,
    pub retract: Number,
}

/// What holds for all axes, and the three homing tables.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "the tables homing.x, homing.y, homing.z")]
pub struct HomingTables {
    pub raise_mm: Option<Number>,
    pub home_at_mm: Option<Spanned<Xy>>,
    pub probe_offset_mm: Option<Xyz>,
    pub bed_mm: Option<BedTable>,
    pub x: HomingTable,
    pub y: HomingTable,
    pub z: HomingTable,
}

/// How one axis finds its home.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table of homing values")]
pub struct HomingTable {
    pub end: EndName,
    pub sensor: Spanned<SensorName>,
    #[serde(default)]
    pub triggers_low: bool,
    pub position_mm: Number,
    pub fast_mm_per_s: Number,
    pub slow_mm_per_s: Number,
    pub back_off_mm: Number,
    pub overrun_mm: Option<Number>,
    pub agree_mm: Option<Number>,
}

/// Which end of the travel.
#[derive(Clone, Copy, Deserialize, PartialEq)]
#[serde(rename_all = "kebab-case")]
pub enum EndName {
    Min,
    Max,
}

/// What triggers there.
#[derive(Clone, Copy, Deserialize, PartialEq)]
#[serde(rename_all = "kebab-case")]
pub enum SensorName {
    EndStop,
    Probe,
    Stall,
}

/// Range and control of a heater.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table of heater values")]
pub struct HeaterTable {
    pub sensor: ThermistorValue,
    pub pull_up_ohm: Option<Number>,
    pub watch_s: Option<Number>,
    pub watch_celsius: Option<Number>,
    pub runaway_s: Option<Number>,
    pub runaway_celsius: Option<Number>,
    pub min_celsius: Number,
    pub max_celsius: Number,
    pub max_target_celsius: Option<Number>,
    pub proportional: Number,
    pub integral: Number,
    pub derivative: Number,
    pub residency_window_celsius: Number,
    pub residency_s: Number,
    pub model: Option<ModelTable>,
}

/// What a heater heats, for the virtual board.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table of what the heater heats")]
pub struct ModelTable {
    pub power_w: Number,
    pub capacity_j_per_k: Number,
    pub loss_w_per_k: Number,
    pub fan_loss_w_per_k: Option<Number>,
    pub dead_time_s: Option<Number>,
}

/// What measures a heater: a name, or a table of two numbers.
pub enum ThermistorValue {
    Named(ThermistorName),
    Beta(BetaTable),
}

/// A thermistor that is known by its name.
#[derive(Clone, Copy, Deserialize)]
pub enum ThermistorName {
    #[serde(rename = "semitec-104gt-2")]
    Semitec104Gt2,
    #[serde(rename = "epcos-100k")]
    Epcos100k,
}

/// Any other thermistor.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table with the keys r25_ohm, beta_k")]
pub struct BetaTable {
    pub r25_ohm: Number,
    pub beta_k: Number,
}

impl<'de> Deserialize<'de> for ThermistorValue {
    /// By hand, for serde's untagged enums lose the places of their values.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(ThermistorVisitor)
    }
}

/// Takes a thermistor's name or its table.
struct ThermistorVisitor;

impl<'de> Visitor<'de> for ThermistorVisitor {
    type Value = ThermistorValue;

    fn expecting(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str("a thermistor's name or a table with the keys r25_ohm, beta_k")
    }

    fn visit_str<E: de::Error>(self, name: &str) -> Result<Self::Value, E> {
        ThermistorName::deserialize(name.into_deserializer()).map(ThermistorValue::Named)
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
        BetaTable::deserialize(MapAccessDeserializer::new(map)).map(ThermistorValue::Beta)
    }
}

/// G10 and G11 at start-up.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table of retraction values")]
pub struct RetractionTable {
    pub length_mm: Number,
    pub retract_mm_per_s: Number,
    pub extra_recover_mm: Number,
    pub recover_mm_per_s: Number,
    pub lift_mm: Number,
}

/// A motor; on CoreXY X and Y are A and B.
#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MotorName {
    X,
    Y,
    Z,
    E,
}

/// Step and direction signals.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table of driver values")]
pub struct DriverTable {
    pub pulse_width_us: Number,
    pub direction_setup_us: Number,
    pub both_edges: bool,
    #[serde(default)]
    pub inverted: Vec<MotorName>,
}

/// Drivers that can be set, by their motors.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, expecting = "the tables drivers.x, drivers.y, drivers.z, drivers.e")]
pub struct DriverTables {
    pub x: Option<DriverSettingsTable>,
    pub y: Option<DriverSettingsTable>,
    pub z: Option<DriverSettingsTable>,
    pub e: Option<DriverSettingsTable>,
}

/// What one of them is set to.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table of a driver's settings")]
pub struct DriverSettingsTable {
    pub current_ma: Number,
    pub hold_current_percent: Number,
    pub microsteps: Number,
    pub full_steps_per_turn: Option<Number>,
    pub mm_per_turn: Option<Number>,
    pub interpolate: bool,
    pub stealth_chop: bool,
    pub spread_cycle_above_mm_per_s: Number,
    pub stall_threshold: Number,
}

/// What the processor can keep up with; where nothing is said, what an STM32F407 can.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table of budget values")]
pub struct BudgetTable {
    pub events_per_s: Option<Number>,
    pub moves_per_s: Option<Number>,
}
