//! The settings that a machine keeps, and where each lives.

use ferrostep_hal_shim::Heater;
use ferrostep_planner::backlash::Backlash;
use ferrostep_planner::{AxisShaper, EvenSpacing, Limits, PressureAdvance, SecondSlope, ShaperKind};
use ferrostep_tmc2209::DriverSettings;

use crate::heat::gains::PidGains;
use crate::heat::model::HeaterModel;
use crate::part::Part;
use crate::settings::profile::Profile;
use crate::settings::profile::filament::FirmwareRetraction;
use crate::settings::profile::homing::HomeSensor;
use crate::settings::profile::z_motors::Kept;

/// Units of 10 nm in a millimetre.
pub(super) const MM: f64 = 100_000.0;

/// Optional parts of a machine that have settings.
pub(crate) trait Parts: Copy + core::fmt::Debug + PartialEq + 'static {
    /// Heaters that are controlled by a model.
    type Models: Part;
    /// Several tools.
    type Tools: Part;
    /// Play of the drives.
    type Backlash: Part;
}

impl<M: Part, T: Part, L: Part> Parts for (M, T, L) {
    type Models = M;
    type Tools = T;
    type Backlash = L;
}

/// The settings of a further tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ToolValues {
    /// M92 T1 E.
    pub extruder_steps_per_mm: f64,
    /// M218.
    pub offset_10nm: [i64; 3],
    /// The tool's pressure advance, as in [`Values::advance`].
    pub advance: [Option<f64>; 4],
    /// Gains of its nozzle's own heater.
    pub gains: Option<PidGains>,
    /// The model that controls it instead.
    pub model: Option<HeaterModel>,
    /// Settings of its motor's driver, where that can be set.
    pub driver: Option<DriverSettings>,
}

/// All of them, of the running machine or of a profile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Values<M: Parts> {
    /// M92 E.
    pub extruder_steps_per_mm: f64,
    pub limits: Limits,
    pub retraction: FirmwareRetraction,
    /// M206.
    pub home_offset_10nm: [i64; 3],
    /// M852.
    pub skew_factors: [f64; 3],
    /// M425, of a machine whose profile has a table `backlash`.
    pub backlash: <M::Backlash as Part>::Of<Option<Backlash>>,
    /// Offset of the probe, of a machine with one.
    pub probe_offset_10nm: Option<[i64; 3]>,
    /// Filament that a change draws out and pushes in (M603).
    pub filament_10nm: [i64; 2],
    pub shapers: [AxisShaper; 2],
    /// K, the time it is averaged over, the K of fast flow, and from which flow on.
    pub advance: [Option<f64>; 4],
    /// Settings of the drivers that can be set.
    pub drivers: [Option<DriverSettings>; 4],
    /// Gains of the nozzle's and the bed's heater, where the machine has heaters.
    pub gains: Option<[PidGains; 2]>,
    /// Models that control the same heaters instead.
    pub models: <M::Models as Part>::Of<[Option<HeaterModel>; 2]>,
    /// Settings of T1, of a machine with several tools.
    pub tool: <M::Tools as Part>::Of<Option<ToolValues>>,
}

impl<M: Parts> Values<M> {
    /// Values of a profile, for a machine on which these drivers can be set, and which
    /// may have heaters.
    pub fn of_profile(profile: &Profile, drivers: &[Option<DriverSettings>; 4], has_heaters: bool) -> Self {
        let mut of_profile = profile.drivers;
        for (driver, live) in of_profile.iter_mut().zip(drivers) {
            if live.is_none() {
                *driver = None;
            }
        }
        let has_probe = profile.homing[2].sensor == HomeSensor::Probe;
        Self {
            extruder_steps_per_mm: profile.steps_per_mm[3].to_f64(),
            limits: profile.limits,
            retraction: profile.retraction,
            home_offset_10nm: [0; 3],
            skew_factors: profile.skew.factors(),
            backlash: M::Backlash::of(profile.backlash),
            probe_offset_10nm: has_probe.then_some(profile.safe_homing.probe_offset_10nm),
            filament_10nm: profile.pause.filament_10nm(),
            shapers: profile.motion.shapers,
            advance: advance_numbers(&profile.motion.pressure_advance),
            drivers: of_profile,
            gains: has_heaters.then_some([profile.nozzle.gains, profile.bed.gains]),
            models: M::Models::of(profile.control_models),
            tool: M::Tools::of(tool_of_profile(profile, has_heaters)),
        }
    }

    /// The play of the drives.
    pub(crate) fn backlash(&mut self) -> Option<&mut Backlash> {
        M::Backlash::get_mut(&mut self.backlash)?.as_mut()
    }

    /// The settings of T1.
    pub(crate) fn tool(&mut self) -> Option<&mut ToolValues> {
        M::Tools::get_mut(&mut self.tool)?.as_mut()
    }

    /// The gains of a heater that a PID loop controls.
    pub(super) fn gains_of(&mut self, heater: Heater) -> Option<&mut PidGains> {
        if self.model_of(heater).is_some() {
            return None;
        }
        self.gains.as_mut()?.get_mut(heater.index())
    }

    /// The model that controls a heater.
    pub(crate) fn model_of(&mut self, heater: Heater) -> Option<&mut HeaterModel> {
        M::Models::get_mut(&mut self.models)?.get_mut(heater.index())?.as_mut()
    }

    /// The advance that the four numbers mean.
    pub fn pressure_advance(&self) -> PressureAdvance {
        advance_of(&self.advance)
    }
}

/// The advance that four numbers mean.
pub(crate) fn advance_of(numbers: &[Option<f64>; 4]) -> PressureAdvance {
    let [seconds, smooth_time_s, fast, speed] = *numbers;
    let above = fast.zip(speed).map(|(seconds, filament_mm_per_s)| SecondSlope { filament_mm_per_s, seconds });
    PressureAdvance { seconds: seconds.unwrap_or_default(), above, smooth_time_s }
}

/// Values of a profile's T1.
fn tool_of_profile(profile: &Profile, has_heaters: bool) -> Option<ToolValues> {
    let Kept(tools) = profile.tools?;
    let tool = tools.get(1)?;
    Some(ToolValues {
        extruder_steps_per_mm: tool.steps_per_mm.to_f64(),
        offset_10nm: tool.offset_10nm,
        advance: advance_numbers(&tool.advance),
        gains: tool.heater.filter(|_| has_heaters).map(|heater| heater.settings.gains),
        model: profile.control_model(Heater::Nozzle1),
        driver: tool.driver,
    })
}

/// The four numbers of an advance, as [`Values::advance`] has them.
pub(crate) fn advance_numbers(advance: &PressureAdvance) -> [Option<f64>; 4] {
    let PressureAdvance { seconds, above, smooth_time_s } = *advance;
    let [fast, speed] = [above.map(|above| above.seconds), above.map(|above| above.filament_mm_per_s)];
    [Some(seconds), smooth_time_s, fast, speed]
}

/// Reference to the memory of a value.
pub(crate) enum Place<'a> {
    Number(&'a mut f64),
    Single(&'a mut f32),
    /// NaN means `None`.
    Optional(&'a mut Option<f64>),
    /// Units of 10 nm, or 10 nm a second; the value is mm.
    Length(&'a mut i64),
    Whole(&'a mut u16),
    Byte(&'a mut u8),
    Switch(&'a mut bool),
    Kind(&'a mut ShaperKind),
}

/// The kinds of filters by their numbers in a memory: new ones come last.
const KINDS: [ShaperKind; 9] = [
    ShaperKind::None,
    ShaperKind::Zv,
    ShaperKind::Mzv,
    ShaperKind::Zvd,
    ShaperKind::Zvdd,
    ShaperKind::Ei,
    ShaperKind::EiOld,
    ShaperKind::TwoHumpEi,
    ShaperKind::ThreeHumpEi,
];

/// Factor in the number of a kind with parameters: its impulses times this, and the thousandths.
const EVEN: u32 = 100_000;

fn number_of(kind: ShaperKind) -> f64 {
    if let ShaperKind::EvenMzv(EvenSpacing { impulses, period_thousandths }) = kind {
        return f64::from(u32::from(impulses) * EVEN + u32::from(period_thousandths));
    }
    (0_u8..).zip(KINDS).find(|(_, known)| *known == kind).map_or(0.0, |(number, _)| f64::from(number))
}

fn kind_of(number: u32) -> Option<ShaperKind> {
    if number < EVEN {
        return KINDS.get(number as usize).copied();
    }
    let impulses = u8::try_from(number / EVEN).ok()?;
    let period_thousandths = u16::try_from(number % EVEN).ok()?;
    Some(ShaperKind::EvenMzv(EvenSpacing { impulses, period_thousandths }))
}

impl Place<'_> {
    /// The present value; NaN for an optional one that is absent.
    pub fn get(&self) -> f64 {
        match self {
            Self::Number(value) => **value,
            Self::Single(value) => f64::from(**value),
            Self::Optional(value) => value.unwrap_or(f64::NAN),
            Self::Length(length) => **length as f64 / MM,
            Self::Whole(whole) => f64::from(**whole),
            Self::Byte(byte) => f64::from(**byte),
            Self::Switch(on) => f64::from(u8::from(**on)),
            Self::Kind(kind) => number_of(**kind),
        }
    }

    /// Changes it to a value within `range`. `false`: it is not within, or not whole where it must
    /// be, and the old value stays.
    pub fn set(&mut self, value: f64, [least, most]: [f64; 2]) -> bool {
        if let (Self::Optional(place), true) = (&mut *self, value.is_nan()) {
            **place = None;
            return true;
        }
        // NaN is in no range.
        if !(value >= least && value <= most) {
            return false;
        }
        let whole = value as u32;
        let is_whole = f64::from(whole) == value;
        match self {
            Self::Number(place) => **place = value,
            Self::Single(place) => **place = value as f32,
            Self::Optional(place) => **place = Some(value),
            Self::Length(place) => **place = libm::round(value * MM) as i64,
            Self::Whole(place) if is_whole => **place = whole as u16,
            Self::Byte(place) if is_whole => **place = whole as u8,
            Self::Switch(place) if is_whole => **place = whole != 0,
            Self::Kind(place) if is_whole => match kind_of(whole) {
                Some(kind) => **place = kind,
                None => return false,
            },
            Self::Whole(_) | Self::Byte(_) | Self::Switch(_) | Self::Kind(_) => return false,
        }
        true
    }
}
