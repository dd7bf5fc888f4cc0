//! The machine as numbers, from a profile file or a board's constants.

pub(crate) mod filament;
pub(crate) mod heaters;
pub(crate) mod homing;
pub(crate) mod supply;
pub(crate) mod tools;
pub(crate) mod z_motors;

use ferrostep_hal_shim::{FanOutput, Heater};
use ferrostep_planner::backlash::Backlash;
use ferrostep_planner::{Geometry, Kinematics, Limits, MotionChoice, StepsPerMm};
use ferrostep_step_player::Signals;
use ferrostep_tmc2209::DriverSettings;
use ferrostep_virtual_board::{START_10NM, SheetShape, VirtualEndStop, VirtualHeaters, VirtualMotors, VirtualProbe};
use filament::{ExtrusionSettings, FilamentSensor, FirmwareRetraction, PauseSettings};
use heaters::{ChamberSettings, HeaterSettings};
use homing::{AxisHoming, BedScrews, BlTouch, HomeEnd, HomeSensor, MeshSettings, SafeHoming};

use crate::heat::fans::FanTable;
use crate::heat::model::HeaterModel;
use crate::motion::skew::Skew;
use crate::settings::profile::supply::SupplySignal;
use crate::settings::profile::tools::{FurtherTool, ToolHeater, Tools};
use crate::settings::profile::z_motors::{Kept, ZAlignment, ZMotors};

/// Default for the step events a second that the processor can make if motion is its only work: an
/// STM32F407 at 168 MHz.
///
/// An event takes 34 instructions in the step interrupt and 90 to work out, at 1.4 cycles an
/// instruction, and 22 cycles to enter and leave the interrupt: 196 cycles. Motion is granted 70 %
/// of the processor, so 600,000 events a second. A third of that is kept in reserve.
pub const DEFAULT_EVENTS_PER_S: u32 = 400_000;

/// Deviation of a corner of 90 degrees, as a share of its speed's square over the acceleration: the
/// square root of 2, less 1.
pub const SQUARE_CORNER_SHARE: f64 = core::f64::consts::SQRT_2 - 1.0;

/// Default for the moves a second that the processor can read and plan if motion is its only work:
/// an STM32F407 at 168 MHz.
///
/// A move takes 7,000 instructions from its line to the first of its events, at 1.4 cycles: 12,000
/// moves a second in 70 % of the processor. A third of these is kept in reserve.
pub const DEFAULT_MOVES_PER_S: u32 = 8_000;

/// A power supply of heaters, motors and fans that the board can switch (M80, M81).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PowerSupply {
    /// The board's output is low while the supply is on.
    pub on_is_low: bool,
    /// True if it is on when the firmware starts.
    pub on_at_start: bool,
}

/// Step and direction signals that the motor drivers need, in nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DriverTiming {
    /// Shortest high and shortest low time of a step pulse.
    pub pulse_width_ns: u32,
    /// Time from a direction change to the step after it.
    pub direction_setup_ns: u32,
    /// True if both edges of the step signal step.
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
    /// Hash of the profile's keys on which a plan depends, or which it must not exceed. Machines
    /// with the same hash may execute each other's prepared jobs.
    pub plan_hash: u64,
    /// Macros, names for lines of G-code, in the form that the module `macros` reads.
    pub macros: &'static str,
    /// Drive of the axes by the motors.
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
    /// Processor time of a step event for [`Geometry::event_cost_ticks`], ticks of the
    /// nominal time base.
    pub event_cost_ticks: u32,
    /// Processor time of a move for [`Geometry::move_cost_ticks`], ticks of the nominal time base.
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
    /// Measuring of the bed; `None`: it cannot be measured.
    pub mesh: Option<MeshSettings>,
    /// The bed's screws, with a mesh.
    pub bed_screws: Option<BedScrews>,
    /// The motors of Z, if there are several.
    pub z_motors: Option<Kept<ZMotors>>,
    /// The tools beside the first, if there are several.
    pub tools: Option<Kept<Tools>>,
    /// Corners keep their speed when M204 or SET_VELOCITY_LIMIT changes the acceleration, and not
    /// their deviation.
    pub holds_corner_speed: bool,
    // ANCHOR: min_extrusion
    /// Extrusion is refused below this nozzle temperature, degrees Celsius.
    pub min_extrusion_celsius: f32,
    // ANCHOR_END: min_extrusion
    /// Heaters go off after this many seconds without a line from a host and without
    /// motion; 0: never (M86).
    pub heater_timeout_s: u16,
    /// The nozzle's heater.
    pub nozzle: HeaterSettings,
    /// The bed's heater.
    pub bed: HeaterSettings,
    /// The models that control the nozzle's and the bed's heater, where no PID loop does.
    pub control_models: [Option<HeaterModel>; 2],
    /// The chamber, if its temperature is known.
    pub chamber: Option<ChamberSettings>,
    /// Settings of a pause.
    pub pause: PauseSettings,
    /// The fans.
    pub fans: FanTable,
    /// The filament sensor, if there is one.
    pub filament_sensor: Option<FilamentSensor>,
    /// The switch beside a filament sensor that sees filament move, if there is one.
    pub filament_switch: Option<FilamentSensor>,
    /// The signal of a failing supply, if the machine has one.
    pub supply_signal: Option<SupplySignal>,
    /// The power supply, if it can be switched.
    pub power_supply: Option<PowerSupply>,
    /// Firmware retraction at start-up.
    pub retraction: FirmwareRetraction,
    /// Step and direction signals.
    pub driver: DriverTiming,
    /// Filament for moves without E words, at start-up.
    pub extrusion: ExtrusionSettings,
    /// Settings of the drivers of the X, Y, Z and extruder motors; `None` for a driver
    /// that cannot be set.
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

    /// Alignment of the motors of Z; `None` for one motor, or for several that are aligned by hand.
    pub const fn z_alignment(&self) -> Option<&ZAlignment> {
        match &self.z_motors {
            Some(Kept(ZMotors { alignment: Some(alignment), .. })) => Some(alignment),
            _ => None,
        }
    }

    /// Returns true if the motors of Z are aligned by G34.
    pub const fn aligns_z(&self) -> bool {
        self.z_alignment().is_some()
    }

    /// Returns true if there are several tools.
    pub const fn has_tools(&self) -> bool {
        self.tools.is_some()
    }

    /// The second tool's own heater, if it has one.
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

    /// The fan that blows at the second tool's part.
    pub fn tool_fan(&self) -> FanOutput {
        let tool = self.tools.and_then(|Kept(tools)| tools.get(1));
        tool.map_or(FanOutput::Part, FurtherTool::part_fan)
    }

    /// Returns this machine's heaters on the virtual board, cold.
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

    /// The settings of a heater, or of a chamber's thermometer; `None` for one that the
    /// machine does not have.
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

    /// Counting motors with this machine's end stops, as placed when it is switched on. An axis
    /// that homes by a stall has an end stop as well; a model of the drivers takes it away
    /// ([`Self::framed_axes`]).
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
