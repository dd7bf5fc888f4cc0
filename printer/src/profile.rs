//! The machine as numbers, from a profile file or a board's constants.

use ferrostep_hal_shim::{FanOutput, Heater, SpareConnector};
use ferrostep_planner::backlash::Backlash;
use ferrostep_planner::surface::MeshInterpolation;
use ferrostep_planner::{Geometry, Kinematics, Limits, MotionChoice, StepsPerMm};
use ferrostep_step_player::Signals;
use ferrostep_thermistor::Thermistor;
use ferrostep_tmc2209::DriverSettings;
use ferrostep_virtual_board::{
    HeatedMass, START_10NM, SheetShape, VirtualEndStop, VirtualHeaters, VirtualMotors, VirtualProbe,
};

use crate::fans::FanTable;
use crate::heat::{HeaterModel, PidGains};
use crate::power_loss::SupplySignal;
use crate::skew::Skew;
use crate::tools::{FurtherTool, ToolHeater, Tools};
use crate::z_motors::{Kept, ZAlignment, ZMotors};

/// Default for the step events a second that the processor can make if it does nothing else for motion: an STM32F407 at
/// 168 MHz.
///
/// An event takes 34 instructions in the step interrupt and 90 to work out, at 1.4 cycles an instruction, and 22 cycles to
/// enter and leave the interrupt: 196 cycles. Motion is granted 70 % of the processor, so 600,000 events a second. A
/// third of that is kept in reserve.
pub const DEFAULT_EVENTS_PER_S: u32 = 400_000;

/// Default for the moves a second that the processor can read and plan if it does nothing else for motion: an STM32F407 at
/// 168 MHz.
///
/// A move takes 7,000 instructions from its line to the first of its events, at 1.4 cycles: 12,000 moves a second in 70 %
/// of the processor, of which a third is kept in reserve.
pub const DEFAULT_MOVES_PER_S: u32 = 8_000;

/// Default for the seconds without use after which heaters go off: Prusa's (`SafetyTimer`, 30 minutes).
pub const DEFAULT_HEATER_TIMEOUT_S: u16 = 1800;

/// The end of its travel to which an axis homes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HomeEnd {
    /// Towards smaller coordinates.
    Min,
    /// Towards larger coordinates.
    Max,
}

/// The sensor with which an axis finds its home.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HomeSensor {
    /// A switch.
    EndStop,
    /// A probe that finds the bed (only Z).
    Probe,
    /// The frame: the motor's driver signals that it stalls (only X and Y).
    Stall,
}

/// How an axis homes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisHoming {
    /// The end to which it homes.
    pub end: HomeEnd,
    /// The sensor at that end.
    pub sensor: HomeSensor,
    /// Whether the sensor's signal is low when it triggers; a driver's stall signal is high then.
    pub triggers_low: bool,
    /// Machine coordinate at which the sensor triggers, in units of 10 nm. With a probe it is that of the bed: the probe triggers
    /// at this less the Z of [`SafeHoming::probe_offset_10nm`].
    pub position_10nm: i64,
    /// Speed of the first approach, mm/s.
    pub fast_mm_per_s: f64,
    /// Speed of the second approach, mm/s.
    pub slow_mm_per_s: f64,
    /// Path back between the two, in units of 10 nm.
    pub back_off_10nm: i64,
    /// How much longer than the travel the frame may be, in units of 10 nm: an approach from an unknown place goes no farther than
    /// the sum of both.
    pub overrun_10nm: i64,
    /// Greatest distance between the places where the two approaches trigger, in units of 10 nm.
    pub agree_10nm: i64,
}

/// Keeps the nozzle off the bed while a machine homes. Lengths in units of 10 nm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SafeHoming {
    /// Least height over the bed while X and Y move; a Z that is unknown is raised by this.
    pub raise_10nm: i64,
    /// Where the nozzle stands (X, Y) while Z homes; `None`: at any place.
    pub home_at_10nm: Option<[i64; 2]>,
    /// From the nozzle's tip to where the probe triggers (X, Y, Z), as M851 has it: a Z of -1 mm says that the nozzle is 1 mm
    /// above the bed when the probe triggers.
    pub probe_offset_10nm: [i64; 3],
    /// Where the probe finds the bed: lower and upper end along X and along Y, machine coordinates.
    pub bed_10nm: [[i64; 2]; 2],
    /// The bed is the circle between these ends, which are as far from each other along Y as along X.
    pub is_round: bool,
}

impl SafeHoming {
    /// Smallest and largest Z of a probe's offset, units of 10 nm: none triggers when the nozzle is higher than 10 mm; above 0 the
    /// nozzle touches before the probe triggers.
    pub const PROBE_Z_10NM: [i64; 2] = [-1_000_000, 500_000];

    /// Raises nothing; Z homes at any place.
    pub const NONE: Self =
        Self { raise_10nm: 0, home_at_10nm: None, probe_offset_10nm: [0; 3], bed_10nm: [[0; 2]; 2], is_round: false };

    /// Whether a place of the probe within the ends of the bed is above it.
    pub fn is_above_bed(&self, place_10nm: [i64; 2]) -> bool {
        let [[left, right], [front, back]] = self.bed_10nm;
        let [x, y] = place_10nm;
        // Twice each length, so that the middle is whole. All are within 5 m.
        let [across, along] = [2 * x - left - right, 2 * y - front - back];
        // Points of a grid are rounded: 10 um beside the rim count as on it.
        let diameter = right - left + 2_000;
        !self.is_round || across * across + along * along <= diameter * diameter
    }
}

/// A probe whose pin a servo's signal puts out and draws in (BLTouch).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlTouch {
    /// How long the pin may take, and the signal lasts, ms.
    pub move_ms: u16,
    /// The pin goes in and out between the two approaches to a place.
    pub stows_each_touch: bool,
    /// Before each deployment the pin, which is up, must read as triggered in touch mode.
    pub tests_signal: bool,
}

/// How the bed is measured, and how far up Z follows it. Lengths in units of 10 nm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MeshSettings {
    /// Points along X and along Y, 2 to [`ferrostep_planner::surface::MAX_MESH_POINTS`].
    pub points: [u8; 2],
    /// What the surface is between them.
    pub interpolation: MeshInterpolation,
    /// Where they are: lower and upper end along X and along Y, machine coordinates of the probe.
    pub area_10nm: [[i64; 2]; 2],
    /// At which height of the nozzle Z follows no more; 0: it follows to the top.
    pub fade_10nm: i64,
    /// Height of the nozzle on the way from point to point.
    pub lift_10nm: i64,
    /// How far below its height at home the bed may be.
    pub depth_10nm: i64,
    /// How often a point is probed.
    pub samples: u8,
    /// The shape of the virtual board's sheet; nothing else uses it.
    pub sheet: SheetShape,
}

impl AxisHoming {
    /// How far an approach to the bed may go below the place where its sensor must trigger, units of 10 nm: 0.5 mm.
    pub const MAX_PRESS_10NM: i64 = 50_000;
}

/// When a heater that should heat counts as failed ([`crate::heat::safety`]). The defaults are Marlin's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeaterWatch {
    /// While it heats up, the temperature must rise within this time, milliseconds ...
    pub watch_ms: u32,
    /// ... by this much, degrees.
    pub watch_celsius: f32,
    /// Once it has reached its target, for no longer than this, milliseconds ...
    pub runaway_ms: u32,
    /// ... may the temperature be farther below the target than this, degrees. Near the room's temperature less is allowed
    /// ([`crate::heat::safety`]).
    pub runaway_celsius: f32,
}

impl HeaterWatch {
    /// The nozzle's defaults.
    pub const NOZZLE: Self = Self { watch_ms: 20_000, watch_celsius: 2.0, runaway_ms: 40_000, runaway_celsius: 4.0 };
    /// The bed's defaults.
    pub const BED: Self = Self { watch_ms: 60_000, watch_celsius: 2.0, runaway_ms: 20_000, runaway_celsius: 2.0 };
    /// The chamber's defaults: it warms slowly, and a door may be opened for a moment.
    pub const CHAMBER: Self =
        Self { watch_ms: 300_000, watch_celsius: 2.0, runaway_ms: 300_000, runaway_celsius: 10.0 };
}

/// Range and control of a heater; temperatures in degrees Celsius, powers from 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeaterSettings {
    /// Its thermistor.
    pub thermistor: Thermistor,
    /// Below this all heaters are switched off.
    pub min_celsius: f32,
    /// At or above this all heaters are switched off.
    pub max_celsius: f32,
    /// Higher targets are refused, and so is [`Self::max_celsius`].
    pub max_target_celsius: f32,
    /// When it counts as failed.
    pub watch: HeaterWatch,
    /// Gains of its control loop.
    pub gains: PidGains,
    /// M109 and M190 wait until the temperature stays this near the target, degrees.
    pub residency_window_celsius: f32,
    /// ... for this long, milliseconds.
    pub residency_ms: u32,
    /// The model of it on the virtual board; control and checks do not use it.
    pub mass: HeatedMass,
    /// There is a heater, and not only a thermometer.
    pub is_heated: bool,
    /// Others heat it, too: without power of its own it may become hotter, and stay hot.
    pub is_warmed_by_others: bool,
}

/// The chamber around the printer: its thermometer, and its heater if it has one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChamberSettings {
    /// The board's input for the thermometer.
    pub thermistor: SpareConnector,
    /// The board's output for the heater.
    pub heater: Option<SpareConnector>,
    /// Range and control.
    pub settings: HeaterSettings,
}

/// A screw that the bed stands on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BedScrew {
    /// What people call it.
    pub name: &'static str,
    /// Where it is: X and Y in machine coordinates, units of 10 nm, within reach of the probe.
    pub place_10nm: [i64; 2],
}

/// The screws that the bed stands on (G35).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BedScrews {
    /// By how much a turn moves the bed, units of 10 nm, above 0.
    pub pitch_10nm: i64,
    /// A turn clockwise lifts the bed.
    pub clockwise_lifts: bool,
    /// The screws; the others are turned to the height of the first.
    pub screws: [Option<BedScrew>; BedScrews::MAX],
}

impl BedScrews {
    /// The most screws.
    pub const MAX: usize = 8;
}

/// Firmware retraction, G10 and G11, before M207 and M208.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FirmwareRetraction {
    /// Filament drawn back, units of 10 nm.
    pub length_10nm: i64,
    /// Speed of retraction, units of 10 nm a second.
    pub retract_10nm_per_s: i64,
    /// Filament pushed beyond the length on recovery, units of 10 nm.
    pub extra_recover_10nm: i64,
    /// Speed of recovery, units of 10 nm a second.
    pub recover_10nm_per_s: i64,
    /// Lift of Z while retracted, units of 10 nm.
    pub lift_10nm: i64,
}

/// What a pause does (M125, M226, M600, M601, M25).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PauseSettings {
    /// Where the nozzle waits: X and Y in machine coordinates, units of 10 nm, within the travel.
    pub place_10nm: [i64; 2],
    /// By how much it rises before, units of 10 nm.
    pub rise_10nm: i64,
    /// M600: filament that is drawn out before the motor lets it go, units of 10 nm; 0: a person pulls.
    pub unload_10nm: i64,
    /// M600: filament that is pushed in before the nozzle goes back, units of 10 nm; 0: a person pushes.
    pub load_10nm: i64,
    /// M600: filament that the second button of its prompt pushes, units of 10 nm; 0: there is no such button.
    pub more_10nm: i64,
    /// Speed of all three, units of 10 nm a second.
    pub filament_10nm_per_s: i64,
}

impl PauseSettings {
    /// The longest rise, units of 10 nm: 1 m.
    pub const MAX_RISE_10NM: i64 = 100_000_000;

    /// The most filament that is drawn out or pushed in, units of 10 nm: 2 m.
    pub const MAX_FILAMENT_10NM: i64 = 200_000_000;

    /// What a filament change draws out and pushes in, units of 10 nm.
    pub const fn filament_10nm(&self) -> [i64; 2] {
        [self.unload_10nm, self.load_10nm]
    }
}

/// A sensor in the filament's path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FilamentSensor {
    /// What its signal tells.
    pub kind: FilamentSensorKind,
    /// How long a level must last to count, ms.
    pub debounce_ms: u16,
}

/// What a filament sensor's signal tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FilamentSensorKind {
    /// Whether there is filament.
    Switch {
        /// The signal is low while filament is missing.
        missing_is_low: bool,
    },
    /// That filament moves: the signal changes its level every few millimetres.
    Encoder {
        /// How much filament is pushed without a change before it counts as standing still, units of 10 nm.
        detection_10nm: u32,
    },
}

impl FilamentSensor {
    /// The least that an encoder's `detection_10nm` may be: 1 mm.
    pub const MIN_DETECTION_10NM: i64 = 100_000;

    /// The most that it may be: 100 mm.
    pub const MAX_DETECTION_10NM: i64 = 10_000_000;

    /// An encoder's `detection_10nm`; `None` for a switch.
    pub const fn detection_10nm(&self) -> Option<i64> {
        match self.kind {
            FilamentSensorKind::Switch { .. } => None,
            FilamentSensorKind::Encoder { detection_10nm } => Some(detection_10nm as i64),
        }
    }
}

/// A power supply of heaters, motors and fans that the board can switch (M80, M81).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PowerSupply {
    /// The board's output is low while the supply is on.
    pub on_is_low: bool,
    /// It is on when the firmware starts.
    pub on_at_start: bool,
}

/// Step and direction signals that the motor drivers need, in nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DriverTiming {
    /// Shortest high and shortest low time of a step pulse.
    pub pulse_width_ns: u32,
    /// From a direction change to the step after it.
    pub direction_setup_ns: u32,
    /// Whether both edges of the step signal step.
    pub both_edges: bool,
    /// Motors that turn in the opposite direction: bit i is motor i.
    pub inverted: u8,
}

impl DriverTiming {
    /// The same in ticks of a step timer that counts at `timer_hz`, rounded up.
    pub const fn signals(&self, timer_hz: u32) -> Signals {
        Signals {
            pulse_ticks: ticks(self.pulse_width_ns, timer_hz),
            direction_setup_ticks: ticks(self.direction_setup_ns, timer_hz),
        }
    }
}

/// Ticks at `timer_hz` in `ns`, rounded up.
const fn ticks(ns: u32, timer_hz: u32) -> u32 {
    (ns as u64 * timer_hz as u64).div_ceil(1_000_000_000) as u32
}

/// Filament for moves without E words (Wu 2024, eqs. 10 and 11).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ExtrusionSettings {
    /// Whether G1 to G3 in the plane without E extrude by their length.
    pub adaptive: bool,
    /// h, units of 10 nm.
    pub layer_height_10nm: i64,
    /// b, units of 10 nm.
    pub line_width_10nm: i64,
    /// D: of the filament, or of the barrel that is pushed, units of 10 nm.
    pub filament_diameter_10nm: i64,
}

impl ExtrusionSettings {
    /// Smallest and largest layer height, line width and filament diameter, units of 10 nm.
    pub const RANGES_10NM: [(i64, i64); 3] = [(1_000, 500_000), (5_000, 2_000_000), (50_000, 10_000_000)];

    /// Filament by E words alone; 0.2 mm by 0.45 mm with 1.75 mm filament if `adaptive` is switched on.
    pub const DEFAULT: Self =
        Self { adaptive: false, layer_height_10nm: 20_000, line_width_10nm: 45_000, filament_diameter_10nm: 175_000 };
}

/// A machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Profile {
    /// Name, for M115 and reports.
    pub name: &'static str,
    /// The names that M862.3 accepts, separated by commas; empty: it is not checked.
    pub model_names: &'static str,
    /// The nozzle diameter that M862.1 accepts, mm; `None`: it is not checked.
    pub nozzle_diameter_mm: Option<f32>,
    /// Filament that the nozzle melts, mm^3/s: a rehearsal reports moves that ask for more.
    pub max_volumetric_flow_mm3_per_s: Option<f32>,
    /// Hash of the profile's keys on which a plan depends, or which it must not exceed. Machines with the same hash may execute
    /// each other's prepared jobs.
    pub plan_hash: u64,
    /// Names that stand for lines of G-code, in the form that the module `macros` reads.
    pub macros: &'static str,
    /// How the motors drive the axes.
    pub kinematics: Kinematics,
    /// Upper end of X, Y and Z in machine coordinates, units of 10 nm.
    pub size_10nm: [i64; 3],
    /// Lower end of X, Y and Z in machine coordinates, units of 10 nm; at most 0.
    pub lower_end_10nm: [i64; 3],
    /// Steps/mm of X, Y, Z and the extruder (CoreXY: of the motors A and B for X and Y).
    pub steps_per_mm: [StepsPerMm; 4],
    /// Speeds, accelerations and junctions at start-up.
    pub limits: Limits,
    /// The methods that make the steps at start-up.
    pub motion: MotionChoice,
    /// Step events nearer to each other than this are joined, ticks of the nominal time base.
    pub minimum_event_interval_ticks: u32,
    /// Processor time of a step event as [`Geometry::event_cost_ticks`] has it, ticks of the nominal time base.
    pub event_cost_ticks: u32,
    /// Processor time of a move as [`Geometry::move_cost_ticks`] has it, ticks of the nominal time base.
    pub move_cost_ticks: u32,
    /// Axes that are not at right angles, at start-up.
    pub skew: Skew,
    /// The play of the drives at start-up, if it is to be taken up.
    pub backlash: Option<Backlash>,
    /// Homing of X, Y and Z.
    pub homing: [AxisHoming; 3],
    /// Keeps the nozzle off the bed meanwhile.
    pub safe_homing: SafeHoming,
    /// The probe's pin, if it has one that is put out.
    pub bltouch: Option<BlTouch>,
    /// How the bed is measured; `None`: it cannot be.
    pub mesh: Option<MeshSettings>,
    /// The bed's screws, with a mesh.
    pub bed_screws: Option<BedScrews>,
    /// The motors of Z, if there are several.
    pub z_motors: Option<Kept<ZMotors>>,
    /// The tools beside the first, if there are several.
    pub tools: Option<Kept<Tools>>,
    // ANCHOR: min_extrusion
    /// Extrusion is refused below this nozzle temperature, degrees Celsius.
    pub min_extrusion_celsius: f32,
    // ANCHOR_END: min_extrusion
    /// Heaters go off after this many seconds without a line from a host and without motion; 0: never (M86).
    pub heater_timeout_s: u16,
    /// The nozzle's heater.
    pub nozzle: HeaterSettings,
    /// The bed's heater.
    pub bed: HeaterSettings,
    /// The models that control the nozzle's and the bed's heater, where no PID loop does.
    pub control_models: [Option<HeaterModel>; 2],
    /// The chamber, if its temperature is known.
    pub chamber: Option<ChamberSettings>,
    /// What a pause does.
    pub pause: PauseSettings,
    /// The fans.
    pub fans: FanTable,
    /// The filament sensor, if there is one.
    pub filament_sensor: Option<FilamentSensor>,
    /// The switch beside a filament sensor that sees filament move, if there is one.
    pub filament_switch: Option<FilamentSensor>,
    /// The signal that says that the supply fails, if there is one.
    pub supply_signal: Option<SupplySignal>,
    /// The power supply, if it can be switched.
    pub power_supply: Option<PowerSupply>,
    /// Firmware retraction at start-up.
    pub retraction: FirmwareRetraction,
    /// Step and direction signals.
    pub driver: DriverTiming,
    /// Filament for moves without E words, at start-up.
    pub extrusion: ExtrusionSettings,
    /// Settings of the drivers of the X, Y, Z and extruder motors; `None` for a driver that cannot be set.
    pub drivers: [Option<DriverSettings>; 4],
}

impl Profile {
    /// The machine's properties for the planner.
    pub const fn geometry(&self) -> Geometry {
        Geometry {
            kinematics: self.kinematics,
            steps_per_mm: self.steps_per_mm,
            minimum_event_interval_ticks: self.minimum_event_interval_ticks,
            event_cost_ticks: self.event_cost_ticks,
            move_cost_ticks: self.move_cost_ticks,
        }
    }

    /// How the motors of Z are aligned; `None` for one motor, or for several that are aligned by hand.
    pub const fn z_alignment(&self) -> Option<&ZAlignment> {
        match &self.z_motors {
            Some(Kept(ZMotors { alignment: Some(alignment), .. })) => Some(alignment),
            _ => None,
        }
    }

    /// Whether the motors of Z are aligned by G34.
    pub const fn aligns_z(&self) -> bool {
        self.z_alignment().is_some()
    }

    /// Whether there are several tools.
    pub const fn has_tools(&self) -> bool {
        self.tools.is_some()
    }

    /// The heater of the second tool, if it has one of its own.
    pub const fn tool_heater(&self) -> Option<&ToolHeater> {
        match &self.tools {
            Some(Kept(tools)) => tools.own_heater(),
            None => None,
        }
    }

    /// The model that controls a heater; `None` if a PID loop does.
    pub const fn control_model(&self, heater: Heater) -> Option<HeaterModel> {
        let [nozzle, bed] = self.control_models;
        match heater {
            Heater::Nozzle => nozzle,
            Heater::Bed => bed,
            Heater::Chamber => None,
            Heater::Nozzle1 => match self.tool_heater() {
                Some(tool) => tool.control_model,
                None => None,
            },
        }
    }

    /// The fan that blows at what the second tool prints.
    pub fn tool_fan(&self) -> FanOutput {
        let tool = self.tools.and_then(|Kept(tools)| tools.get(1));
        tool.map_or(FanOutput::Part, FurtherTool::part_fan)
    }

    /// This machine's heaters on the virtual board, cold.
    pub fn virtual_heaters(&self) -> VirtualHeaters {
        let heated = |settings: &HeaterSettings| (settings.mass, settings.thermistor);
        let chamber = self.chamber.as_ref().map(|chamber| heated(&chamber.settings));
        let nozzle1 = self.tool_heater().map(|tool| heated(&tool.settings));
        VirtualHeaters::new(heated(&self.nozzle), heated(&self.bed), chamber, nozzle1)
    }

    /// The settings of all heaters, by their index.
    pub fn heaters(&self) -> [Option<HeaterSettings>; Heater::COUNT] {
        Heater::ALL.map(|heater| self.heater(heater).copied())
    }

    /// The settings of a heater, or of a chamber's thermometer; `None` for one that the machine does not have.
    pub const fn heater(&self, heater: Heater) -> Option<&HeaterSettings> {
        match heater {
            Heater::Nozzle => Some(&self.nozzle),
            Heater::Bed => Some(&self.bed),
            Heater::Chamber => match &self.chamber {
                Some(chamber) => Some(&chamber.settings),
                None => None,
            },
            Heater::Nozzle1 => match self.tool_heater() {
                Some(tool) => Some(&tool.settings),
                None => None,
            },
        }
    }

    /// Mask of the axes that home by a stall.
    pub fn framed_axes(&self) -> u8 {
        let stalls = |homing: &AxisHoming| u8::from(homing.sensor == HomeSensor::Stall);
        self.homing.iter().rev().fold(0, |axes, homing| axes << 1 | stalls(homing))
    }

    /// Counting motors with this machine's end stops, as they stand when it is switched on. An axis that homes by a stall has an
    /// end stop, too; a model of the drivers takes it away ([`Self::framed_axes`]).
    pub fn virtual_motors(&self) -> VirtualMotors {
        let [offset_x, offset_y, offset_z] = self.safe_homing.probe_offset_10nm;
        let end_stops = self.homing.map(|homing| {
            let height_10nm = if homing.sensor == HomeSensor::Probe { -offset_z } else { 0 };
            let position_10nm = homing.position_10nm + height_10nm;
            VirtualEndStop { position_10nm, at_max: homing.end == HomeEnd::Max }
        });
        let mut motors = VirtualMotors::new(self.geometry(), end_stops, START_10NM);
        if self.homing.iter().any(|homing| homing.sensor == HomeSensor::Probe) {
            let sheet_10nm = self.safe_homing.bed_10nm;
            let shape = self.mesh.map_or(SheetShape::FLAT, |mesh| mesh.sheet);
            motors.set_probe(VirtualProbe { offset_10nm: [offset_x, offset_y], sheet_10nm, shape });
            if self.bltouch.is_some() {
                motors.set_pin();
            }
        }
        motors
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signals_are_rounded_up_to_whole_ticks() {
        let timing = DriverTiming { pulse_width_ns: 1000, direction_setup_ns: 1001, both_edges: false, inverted: 0 };
        assert_eq!(timing.signals(84_000_000), Signals { pulse_ticks: 84, direction_setup_ticks: 85 });
        assert_eq!(timing.signals(16_000_000), Signals { pulse_ticks: 16, direction_setup_ticks: 17 });
    }
}
