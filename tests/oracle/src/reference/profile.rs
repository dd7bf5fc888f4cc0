//! The few values of a machine's profile that the checks need.

use super::decimal::Decimal;
use serde::Deserialize;
use std::fmt;
use std::ops::{Add, Sub};

/// Minimum interval of events if a profile has none, us.
const DEFAULT_EVENT_INTERVAL_US: f64 = 2.0;

/// Way in which the motors move the tool.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kinematics {
    /// One motor an axis.
    Cartesian,
    /// A = x + y, B = x - y.
    CoreXy,
    /// A = x + z, C = x - z.
    CoreXz,
}

impl Kinematics {
    /// Reads a name as profiles and traces write it; case, `-` and `_` do not matter.
    pub fn from_name(name: &str) -> Option<Self> {
        let plain: String = name.chars().filter(char::is_ascii_alphanumeric).collect();
        match plain.to_ascii_lowercase().as_str() {
            "cartesian" => Some(Self::Cartesian),
            "corexy" => Some(Self::CoreXy),
            "corexz" => Some(Self::CoreXz),
            _ => None,
        }
    }

    /// The name, and the motors' names, as traces write them.
    pub fn names(self) -> (&'static str, [&'static str; 4]) {
        match self {
            Self::Cartesian => ("cartesian", ["x", "y", "z", "e"]),
            Self::CoreXy => ("corexy", ["a", "b", "z", "e"]),
            Self::CoreXz => ("corexz", ["a", "y", "c", "e"]),
        }
    }

    /// Positions of the three motors for a position of the tool.
    pub fn motors<T: Copy + Add<Output = T> + Sub<Output = T>>(self, [x, y, z]: [T; 3]) -> [T; 3] {
        match self {
            Self::Cartesian => [x, y, z],
            Self::CoreXy => [x + y, x - y, z],
            Self::CoreXz => [x + z, y, x - z],
        }
    }

    /// Twice the position of the tool at these positions of the three motors.
    pub fn twice_the_tool<T: Copy + Add<Output = T> + Sub<Output = T>>(self, [a, b, c]: [T; 3]) -> [T; 3] {
        match self {
            Self::Cartesian => [a + a, b + b, c + c],
            Self::CoreXy => [a + b, a - b, c + c],
            Self::CoreXz => [a + c, b + b, a - c],
        }
    }
}

/// Acceleration along the path for the three kinds of move, mm/s^2.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
pub struct Acceleration {
    /// X, Y or Z with the extruder.
    pub print: f64,
    /// X, Y or Z alone.
    pub travel: f64,
    /// The extruder alone.
    pub retract: f64,
}

/// Settings of G10 and G11 until M207 and M208 change them.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
pub struct FirmwareRetraction {
    /// Filament pulled back by G10, mm.
    pub length_mm: f64,
    /// Speed of G10, mm/s.
    pub retract_mm_per_s: f64,
    /// Filament G11 pushes beyond what G10 pulled, mm.
    pub extra_recover_mm: f64,
    /// Speed of G11, mm/s.
    pub recover_mm_per_s: f64,
    /// Lift of Z while retracted, mm.
    pub lift_mm: f64,
}

impl Default for FirmwareRetraction {
    /// Marlin's defaults.
    fn default() -> Self {
        Self { length_mm: 3.0, retract_mm_per_s: 45.0, extra_recover_mm: 0.0, recover_mm_per_s: 8.0, lift_mm: 0.0 }
    }
}

/// A machine as the reference sees it. Axes are in the order x, y, z, e; lengths in mm, times in s.
#[derive(Clone, Debug, PartialEq)]
pub struct ReferenceProfile {
    /// Way in which the motors move the tool.
    pub kinematics: Kinematics,
    /// Exact steps of each motor for a millimetre (motors A and B of CoreXY under x and y).
    pub steps_per_mm: [Decimal; 4],
    /// Largest speed of each axis, mm/s.
    pub max_feed_mm_per_s: [f64; 4],
    /// Largest acceleration of each axis, mm/s^2.
    pub max_acceleration_mm_per_s2: [f64; 4],
    /// Acceleration along the path, mm/s^2.
    pub acceleration_mm_per_s2: Acceleration,
    /// Yu's delta, mm.
    pub junction_deviation_mm: f64,
    /// Maximum jump of the speed of each axis at a corner, mm/s; infinity for no limit.
    pub corner_velocity_mm_per_s: [f64; 4],
    /// The soft limits' far ends, mm.
    pub size_mm: [f64; 3],
    /// The soft limits' near ends, mm.
    pub lower_end_mm: [f64; 3],
    /// Position of each axis when its sensor has triggered, mm.
    pub home_mm: [f64; 3],
    /// Place of the nozzle in the plane while Z homes, mm; `None` for any place. Z is raised
    /// afterwards if there is one.
    pub home_at_mm: Option<[f64; 2]>,
    /// Height to which homing raises Z before X and Y move, or by which if it is
    /// unknown, mm; 0 for none.
    pub raise_mm: f64,
    /// Settings of G10 and G11.
    pub firmware_retraction: FirmwareRetraction,
    /// Step events nearer to each other than this join, us.
    pub minimum_event_interval_us: f64,
}

/// A profile could not be used.
#[derive(Debug)]
pub enum ProfileError {
    /// The text is not TOML, or a key is missing or of another type.
    Toml(toml::de::Error),
    /// The kinematics' name is not known here.
    UnknownKinematics(String),
    /// A value that must be finite and positive is not; the key's name.
    NotPositive(&'static str),
}

impl fmt::Display for ProfileError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Toml(error) => write!(formatter, "profile: {error}"),
            Self::UnknownKinematics(name) => write!(formatter, "profile: unknown kinematics {name:?}"),
            Self::NotPositive(key) => write!(formatter, "profile: {key} must be positive"),
        }
    }
}

impl std::error::Error for ProfileError {}

/// Three or four numbers, written as a table by axis or as a list.
#[derive(Deserialize)]
#[serde(untagged)]
enum PerAxis {
    Table {
        x: f64,
        y: f64,
        z: f64,
        #[serde(default)]
        e: f64,
    },
    Four([f64; 4]),
    Three([f64; 3]),
}

impl PerAxis {
    fn four(&self) -> [f64; 4] {
        match *self {
            Self::Table { x, y, z, e } => [x, y, z, e],
            Self::Four(values) => values,
            Self::Three([x, y, z]) => [x, y, z, 0.0],
        }
    }

    fn three(&self) -> [f64; 3] {
        let [x, y, z, _] = self.four();
        [x, y, z]
    }
}

#[derive(Deserialize)]
struct HomeText {
    #[serde(default)]
    position_mm: f64,
}

#[derive(Deserialize)]
struct HomingText {
    x: HomeText,
    y: HomeText,
    z: HomeText,
    home_at_mm: Option<PlaneText>,
    #[serde(default)]
    raise_mm: f64,
    #[serde(default)]
    probe_offset_mm: ProbeText,
}

/// A place in the plane.
#[derive(Deserialize)]
struct PlaneText {
    x: f64,
    y: f64,
}

/// Place at which the probe triggers, relative to the nozzle, mm; negative below it.
#[derive(Default, Deserialize)]
struct ProbeText {
    z: f64,
}

/// The keys that are read; all others are ignored.
#[derive(Deserialize)]
struct ProfileText {
    kinematics: String,
    steps_per_mm: PerAxis,
    max_feed_mm_per_s: PerAxis,
    max_acceleration_mm_per_s2: PerAxis,
    acceleration_mm_per_s2: Acceleration,
    junction_deviation_mm: f64,
    #[serde(default)]
    instantaneous_corner_velocity_mm_per_s: CornerText,
    size_mm: PerAxis,
    lower_end_mm: Option<PerAxis>,
    homing: HomingText,
    #[serde(default)]
    firmware_retraction: FirmwareRetraction,
    #[serde(default = "default_event_interval_us")]
    minimum_event_interval_us: f64,
}

/// Limits of some axes.
#[derive(Default, Deserialize)]
struct CornerText {
    x: Option<f64>,
    y: Option<f64>,
    z: Option<f64>,
    e: Option<f64>,
}

impl CornerText {
    /// Values of the four axes; where the profile has none, 5 mm/s for Z, 10 mm/s for the extruder,
    /// and no limit for X and Y.
    fn four(&self) -> [f64; 4] {
        let any = f64::INFINITY;
        [self.x.unwrap_or(any), self.y.unwrap_or(any), self.z.unwrap_or(5.0), self.e.unwrap_or(10.0)]
    }
}

fn default_event_interval_us() -> f64 {
    DEFAULT_EVENT_INTERVAL_US
}

impl ReferenceProfile {
    /// Reads the keys it needs from a profile's TOML text.
    ///
    /// # Errors
    /// [`ProfileError`] if a key is missing, of another type, or a limit is not positive.
    pub fn from_toml(text: &str) -> Result<Self, ProfileError> {
        let text: ProfileText = toml::from_str(text).map_err(ProfileError::Toml)?;
        let kinematics = Kinematics::from_name(&text.kinematics)
            .ok_or_else(|| ProfileError::UnknownKinematics(text.kinematics.clone()))?;
        let steps_per_mm = exact(text.steps_per_mm.four()).ok_or(ProfileError::NotPositive("steps_per_mm"))?;
        let profile = Self {
            kinematics,
            steps_per_mm,
            max_feed_mm_per_s: text.max_feed_mm_per_s.four(),
            max_acceleration_mm_per_s2: text.max_acceleration_mm_per_s2.four(),
            acceleration_mm_per_s2: text.acceleration_mm_per_s2,
            junction_deviation_mm: text.junction_deviation_mm,
            corner_velocity_mm_per_s: text.instantaneous_corner_velocity_mm_per_s.four(),
            size_mm: text.size_mm.three(),
            lower_end_mm: text.lower_end_mm.map_or([0.0; 3], |ends| ends.three()),
            home_mm: [
                text.homing.x.position_mm,
                text.homing.y.position_mm,
                text.homing.z.position_mm - text.homing.probe_offset_mm.z,
            ],
            home_at_mm: text.homing.home_at_mm.map(|place| [place.x, place.y]),
            raise_mm: text.homing.raise_mm,
            firmware_retraction: text.firmware_retraction,
            minimum_event_interval_us: text.minimum_event_interval_us,
        };
        profile.checked()
    }

    /// The profile `cartesian` of the shared table.
    pub fn cartesian() -> Self {
        Self {
            kinematics: Kinematics::Cartesian,
            steps_per_mm: whole([80, 80, 400, 95]),
            max_feed_mm_per_s: [200.0, 200.0, 10.0, 60.0],
            max_acceleration_mm_per_s2: [1500.0, 1500.0, 100.0, 5000.0],
            acceleration_mm_per_s2: Acceleration { print: 1000.0, travel: 1000.0, retract: 1500.0 },
            junction_deviation_mm: 0.1,
            corner_velocity_mm_per_s: [f64::INFINITY, f64::INFINITY, 5.0, 10.0],
            size_mm: [200.0; 3],
            lower_end_mm: [0.0; 3],
            home_mm: [0.0; 3],
            home_at_mm: None,
            raise_mm: 0.0,
            firmware_retraction: FirmwareRetraction::default(),
            minimum_event_interval_us: DEFAULT_EVENT_INTERVAL_US,
        }
    }

    /// The profile `corexy` of the shared table.
    pub fn corexy() -> Self {
        Self {
            kinematics: Kinematics::CoreXy,
            steps_per_mm: whole([160, 160, 800, 400]),
            max_feed_mm_per_s: [500.0, 500.0, 20.0, 80.0],
            max_acceleration_mm_per_s2: [10_000.0, 10_000.0, 500.0, 10_000.0],
            acceleration_mm_per_s2: Acceleration { print: 10_000.0, travel: 10_000.0, retract: 3000.0 },
            junction_deviation_mm: 0.02,
            corner_velocity_mm_per_s: [f64::INFINITY, f64::INFINITY, 5.0, 10.0],
            size_mm: [300.0; 3],
            lower_end_mm: [0.0; 3],
            home_mm: [300.0, 300.0, 0.0],
            home_at_mm: None,
            raise_mm: 0.0,
            firmware_retraction: FirmwareRetraction::default(),
            minimum_event_interval_us: DEFAULT_EVENT_INTERVAL_US,
        }
    }

    /// The profile `prusa-mini` of the shared table.
    pub fn prusa_mini() -> Self {
        Self {
            kinematics: Kinematics::Cartesian,
            steps_per_mm: whole([100, 100, 400, 325]),
            max_feed_mm_per_s: [180.0, 180.0, 12.0, 80.0],
            max_acceleration_mm_per_s2: [1250.0, 1250.0, 400.0, 4000.0],
            acceleration_mm_per_s2: Acceleration { print: 1250.0, travel: 1250.0, retract: 1250.0 },
            junction_deviation_mm: 0.05,
            corner_velocity_mm_per_s: [f64::INFINITY, f64::INFINITY, 2.0, 10.0],
            size_mm: [180.4, 180.0, 185.0],
            lower_end_mm: [-2.0, -3.0, 0.0],
            home_mm: [180.4, -3.0, 0.0],
            home_at_mm: Some([176.4, 24.1]),
            raise_mm: 4.0,
            firmware_retraction: FirmwareRetraction::default(),
            minimum_event_interval_us: DEFAULT_EVENT_INTERVAL_US,
        }
    }

    fn checked(self) -> Result<Self, ProfileError> {
        let positive = |values: &[f64], key| {
            if values.iter().all(|value| value.is_finite() && *value > 0.0) {
                Ok(())
            } else {
                Err(ProfileError::NotPositive(key))
            }
        };
        positive(&self.steps_per_mm.map(Decimal::to_f64), "steps_per_mm")?;
        positive(&self.max_feed_mm_per_s, "max_feed_mm_per_s")?;
        positive(&self.max_acceleration_mm_per_s2, "max_acceleration_mm_per_s2")?;
        let Acceleration { print, travel, retract } = self.acceleration_mm_per_s2;
        positive(&[print, travel, retract], "acceleration_mm_per_s2")?;
        positive(&[self.junction_deviation_mm], "junction_deviation_mm")?;
        positive(&self.size_mm, "size_mm")?;
        positive(&[self.minimum_event_interval_us], "minimum_event_interval_us")?;
        let retraction = self.firmware_retraction;
        positive(&[retraction.retract_mm_per_s, retraction.recover_mm_per_s], "firmware_retraction")?;
        Ok(self)
    }
}

fn exact(values: [f64; 4]) -> Option<[Decimal; 4]> {
    let [x, y, z, e] = values.map(Decimal::from_f64);
    Some([x?, y?, z?, e?])
}

fn whole(values: [u32; 4]) -> [Decimal; 4] {
    values.map(Decimal::from_integer)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    const CARTESIAN: &str = r#"
        name = "cartesian"
        kinematics = "cartesian"
        junction_deviation_mm = 0.1
        size_mm = { x = 200, y = 200, z = 200.0 }
        steps_per_mm = { x = 80, y = 80, z = 400, e = 95 }
        max_feed_mm_per_s = { x = 200, y = 200, z = 10, e = 60 }
        max_acceleration_mm_per_s2 = { x = 1500, y = 1500, z = 100, e = 5000 }
        acceleration_mm_per_s2 = { print = 1000, travel = 1000, retract = 1500 }
        somebody_elses = [1, 2]
        [homing.x]
        position_mm = 0
        [homing.y]
        position_mm = 0.0
        [homing.z]
        position_mm = 0.0
    "#;

    #[test]
    fn a_profile_file_gives_the_profile_of_the_table() {
        assert_eq!(ReferenceProfile::from_toml(CARTESIAN).unwrap(), ReferenceProfile::cartesian());
    }

    /// Outside checks were made with the shared profiles: neither side may drift.
    #[test]
    fn the_profiles_that_are_shipped_are_those_of_the_table() {
        let table = [
            ("cartesian", ReferenceProfile::cartesian()),
            ("corexy", ReferenceProfile::corexy()),
            ("prusa-mini", ReferenceProfile::prusa_mini()),
        ];
        for (name, expected) in table {
            let path = format!("{}/../../config/profiles/{name}.toml", env!("CARGO_MANIFEST_DIR"));
            let profile = ReferenceProfile::from_toml(&std::fs::read_to_string(path).unwrap()).unwrap();
            assert_eq!(profile, expected, "{name}");
        }
    }

    #[test]
    fn fractions_of_steps_are_exact() {
        let profile = ReferenceProfile::from_toml(&CARTESIAN.replace("e = 95", "e = 415.1")).unwrap();
        assert_eq!(profile.steps_per_mm[3].ratio(), (4151, 10));
    }

    #[test]
    fn unusable_profiles_are_refused() {
        let with = |from: &str, to: &str| ReferenceProfile::from_toml(&CARTESIAN.replace(from, to));
        assert!(matches!(with("\"cartesian\"", "\"delta\""), Err(ProfileError::UnknownKinematics(_))));
        assert!(matches!(with("z = 10,", "z = 0,"), Err(ProfileError::NotPositive("max_feed_mm_per_s"))));
        assert!(matches!(with("z = 400,", ""), Err(ProfileError::Toml(_))));
    }
}
