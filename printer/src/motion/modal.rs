//! The state that lasts from line to line.

use ferrostep_gcode::{AxisWords, Decimal, Units};
use ferrostep_planner::MIN_FEED_MM_PER_S;

use crate::motion::extrusion::AdaptiveExtrusion;
use crate::settings::profile::Profile;
use crate::settings::profile::filament::FirmwareRetraction;

/// Counts of a job's actions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// G0 to G3 that displaced something.
    pub moves: u64,
    /// Moves whose target a soft limit changed.
    pub clamped_moves: u64,
    /// Moves of an axis that was not homed.
    pub unhomed_moves: u64,
    /// Net filament of all moves and retractions, units of 0.1 nm, flow included.
    pub filament_100pm: i64,
}

/// Knowledge of Z beyond the motors' position. The places are those of the motors, units of 10 nm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct KnownZ {
    /// Place where the sensor of Z triggers, or the lowest place where it can trigger; `None`:
    /// unknown. Approaches to the bed end a little below it.
    pub trigger_10nm: Option<i64>,
    /// Height to which homing has raised a Z that is not homed: it does so once.
    pub raised_to_10nm: Option<i64>,
    /// Height of the motors above the position that the G-code sees (M290, SET_GCODE_OFFSET).
    pub shift_10nm: i64,
    /// The part of it that homing leaves (SET_GCODE_OFFSET).
    pub offset_10nm: i64,
    /// The probe's pin was seen to go in, and has not been called out since.
    pub pin_is_in: bool,
}

/// A firmware retraction or recovery after which no move with filament was taken. The machine is at
/// rest during it; after a stop that shows how far it has come.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NewestRetraction {
    /// Position of the motors of X, Y and Z.
    pub motor_steps: [i32; 3],
    /// Filament of the retraction, units of 0.1 nm.
    pub filament_100pm: i64,
}

impl NewestRetraction {
    /// Filament of it among the filament that a stop has left unpushed, units of 0.1 nm, if the
    /// motors are at these steps.
    pub fn dropped(&self, dropped_100pm: i64, motor_steps: [i64; 3]) -> i64 {
        if motor_steps == self.motor_steps.map(i64::from) {
            // It is being made, has ended or is about to begin: all filament still to
            // come was its own.
            dropped_100pm.clamp(self.filament_100pm.min(0), self.filament_100pm.max(0))
        } else if dropped_100pm == 0 {
            // It has ended.
            0
        } else {
            // It has not begun.
            self.filament_100pm
        }
    }
}

/// Modal state.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Modal {
    pub units: Units,
    pub relative: bool,
    pub relative_extruder: bool,
    /// M83 was the last of M82, M83 and G90.
    pub said_m83: bool,
    /// G90 has ended M83, and no filament was pushed since: the next line with E has a remark.
    pub has_ended_m83: bool,
    /// Feed at 100 %, units of 10 nm a minute.
    pub feed_10nm_per_min: i64,
    pub feed_percent: u16,
    pub flow_percent: u16,
    /// Percentage kept by M220 B.
    pub kept_feed_percent: u16,
    /// Machine position after all commands so far, as the G-code asks for it (not the axes', which
    /// may be skew), without the lift of a firmware retraction.
    pub machine_10nm: [i64; 3],
    /// Logical minus machine coordinates (G92, and M206).
    pub offset_10nm: [i64; 3],
    /// M206: the offset after homing.
    pub home_offset_10nm: [i64; 3],
    /// Logical extruder position.
    pub extruder_10nm: i64,
    /// Filament that moves of a prepared job have pushed and that [`Self::extruder_10nm`] does not
    /// contain yet, units of 0.1 nm times percent.
    pub extruder_rest_100pm: i64,
    pub homed: [bool; 3],
    /// Axes that are no longer homed, until the host has been informed.
    pub lost: [bool; 3],
    /// Axes that have failed to home, and have not been homed since: no print lays lines with them.
    pub failed_home: [bool; 3],
    pub z: KnownZ,
    /// True while a prepared job is being received; the host's lines are executed
    /// between its moves.
    pub in_prepared_job: bool,
    /// Offset from the nozzle to the probe (M851).
    pub probe_offset_10nm: [i64; 3],
    /// True if Z follows the bed (M420).
    pub follows_bed: bool,
    /// Part of Z's travel at its upper end that the bed's surface takes.
    pub mesh_rise_10nm: i64,
    /// Height at which the correction has faded away (M420 Z); 0: it does not fade.
    pub mesh_fade_10nm: i64,
    pub soft_limits: bool,
    pub retraction: FirmwareRetraction,
    pub extrusion: AdaptiveExtrusion,
    pub retracted: bool,
    /// Lift of Z while retracted. The G-code's coordinates do not include it.
    pub lift_10nm: i64,
    pub min_extrusion_celsius: f32,
    pub cold_extrusion_allowed: bool,
}

/// Feed before the first F word: 25 mm/s.
const DEFAULT_FEED_10NM_PER_MIN: i64 = 1_500 * 100_000;

impl Modal {
    pub fn new(profile: &Profile) -> Self {
        Self {
            units: Units::Millimetres,
            relative: false,
            relative_extruder: false,
            said_m83: false,
            has_ended_m83: false,
            feed_10nm_per_min: DEFAULT_FEED_10NM_PER_MIN,
            feed_percent: 100,
            flow_percent: 100,
            kept_feed_percent: 100,
            machine_10nm: [0; 3],
            offset_10nm: [0; 3],
            home_offset_10nm: [0; 3],
            extruder_10nm: 0,
            extruder_rest_100pm: 0,
            homed: [false; 3],
            lost: [false; 3],
            failed_home: [false; 3],
            z: KnownZ::default(),
            in_prepared_job: false,
            probe_offset_10nm: profile.safe_homing.probe_offset_10nm,
            follows_bed: false,
            mesh_rise_10nm: 0,
            mesh_fade_10nm: profile.mesh.map_or(0, |mesh| mesh.fade_10nm),
            soft_limits: true,
            retraction: profile.retraction,
            extrusion: AdaptiveExtrusion::new(profile.extrusion),
            retracted: false,
            lift_10nm: 0,
            min_extrusion_celsius: profile.min_extrusion_celsius,
            cold_extrusion_allowed: false,
        }
    }

    /// G90, G91: as in Marlin they rule the extruder too, until M82 or M83 says otherwise.
    pub fn set_relative(&mut self, relative: bool) {
        self.relative = relative;
        self.relative_extruder = relative;
        if !relative {
            self.has_ended_m83 |= core::mem::take(&mut self.said_m83);
        }
    }

    /// M82, M83.
    pub fn set_relative_extruder(&mut self, relative: bool) {
        self.relative_extruder = relative;
        (self.said_m83, self.has_ended_m83) = (relative, false);
    }

    /// The G-code's coordinates become larger by this.
    pub fn add_offset(&mut self, more_10nm: [i64; 3]) {
        for (offset_10nm, more) in self.offset_10nm.iter_mut().zip(more_10nm) {
            // Both are within a few metres.
            *offset_10nm = offset_10nm.wrapping_add(more);
        }
    }

    /// M206: another offset of home takes the place of the one before.
    pub fn set_home_offset(&mut self, home_offset_10nm: [i64; 3]) {
        let parts = self.home_offset_10nm.into_iter().zip(home_offset_10nm);
        for (offset_10nm, (before_10nm, after_10nm)) in self.offset_10nm.iter_mut().zip(parts) {
            // All are within a few metres.
            *offset_10nm = offset_10nm.wrapping_add(after_10nm).wrapping_sub(before_10nm);
        }
        self.home_offset_10nm = home_offset_10nm;
    }

    /// Takes over the position and the way of reading words of a paused print that resumes; changes
    /// to the machine stay.
    pub fn go_on_as(&mut self, print: &Self) {
        self.units = print.units;
        self.relative = print.relative;
        self.relative_extruder = print.relative_extruder;
        self.feed_10nm_per_min = print.feed_10nm_per_min;
        self.machine_10nm = print.machine_10nm;
        self.offset_10nm = print.offset_10nm;
        self.extruder_10nm = print.extruder_10nm;
        self.extruder_rest_100pm = print.extruder_rest_100pm;
        self.retracted = print.retracted;
        self.lift_10nm = print.lift_10nm;
    }

    /// Takes over the machine's settings made by commands in a print that an interruption has
    /// ended; the rest is [`Self::go_on_as`]'s.
    pub fn set_machine_as(&mut self, print: &Self) {
        self.feed_percent = print.feed_percent;
        self.flow_percent = print.flow_percent;
        self.kept_feed_percent = print.kept_feed_percent;
        self.home_offset_10nm = print.home_offset_10nm;
        self.soft_limits = print.soft_limits;
        self.min_extrusion_celsius = print.min_extrusion_celsius;
        self.cold_extrusion_allowed = print.cold_extrusion_allowed;
        self.retraction = print.retraction;
        self.z.shift_10nm = print.z.shift_10nm;
        self.z.offset_10nm = print.z.offset_10nm;
    }

    /// Notes whether the named axes have failed to home.
    pub fn note_failed_home(&mut self, named: [bool; 3], failed: bool) {
        for (axis, named) in self.failed_home.iter_mut().zip(named) {
            *axis = failed && named || *axis && !named;
        }
    }

    /// Forgets the home of the axes in the mask: their motors may have been turned.
    pub fn forget_home(&mut self, axes: u8) {
        for (axis, (homed, lost)) in self.homed.iter_mut().zip(&mut self.lost).enumerate() {
            let is_lost = *homed && axes >> axis & 1 == 1;
            *homed &= !is_lost;
            *lost |= is_lost;
        }
        if axes >> 2 & 1 == 1 {
            // Shift and offset are of coordinates and stay.
            let KnownZ { shift_10nm, offset_10nm, .. } = self.z;
            self.z = KnownZ { shift_10nm, offset_10nm, ..KnownZ::default() };
        }
    }

    /// Machine coordinate Z for a height of the motors: without the parts that the
    /// G-code does not see.
    pub fn machine_z_10nm(&self, motors_10nm: i64) -> i64 {
        // All three are within 5 m.
        motors_10nm.wrapping_sub(self.lift_10nm).wrapping_sub(self.z.shift_10nm)
    }

    /// A move of a prepared job has pushed this filament; an arc's share of a whole number
    /// need not be whole.
    pub fn push_prepared(&mut self, filament_100pm: i64) {
        let pushed_100pm = self.extruder_rest_100pm.wrapping_add(filament_100pm);
        let flow = self.flow_percent.max(1);
        // Up to 21 cm it fits in 32 bits, for which the processor has a division.
        let (whole, rest) = match i32::try_from(pushed_100pm) {
            Ok(pushed) => (i64::from(pushed / i32::from(flow)), i64::from(pushed % i32::from(flow))),
            Err(_) => (pushed_100pm / i64::from(flow), pushed_100pm % i64::from(flow)),
        };
        self.extruder_10nm = self.extruder_10nm.wrapping_add(whole);
        self.extruder_rest_100pm = rest;
    }

    /// The unit of lengths as written, mm.
    pub fn unit_mm(&self) -> f64 {
        match self.units {
            Units::Millimetres => 1.0,
            Units::Inches => 25.4,
        }
    }

    /// A length as written, in units of 10 nm; `None` beyond any machine.
    pub fn length_10nm(&self, value: Decimal) -> Option<i64> {
        match self.units {
            Units::Millimetres => Some(value.to_10nm_from_mm()),
            Units::Inches => value.to_10nm_from_inches(),
        }
    }

    /// X, Y, Z and E as the G-code sees them.
    pub fn logical_10nm(&self) -> [i64; 4] {
        let [x, y, z] = self.machine_10nm;
        let [dx, dy, dz] = self.offset_10nm;
        [x + dx, y + dy, z + dz, self.extruder_10nm]
    }

    /// Machine target of the X, Y and Z words, and the logical E target; `None` where a number is
    /// beyond any machine.
    pub fn target(&self, words: &AxisWords) -> Option<([i64; 3], i64)> {
        let mut machine = self.machine_10nm;
        for (axis, word) in [words.x, words.y, words.z].into_iter().enumerate() {
            if let Some(value) = word {
                let base = if self.relative { machine[axis] } else { -self.offset_10nm[axis] };
                machine[axis] = base.checked_add(self.length_10nm(value)?)?;
            }
        }
        let extruder = match words.e {
            None => self.extruder_10nm,
            Some(value) if self.relative_extruder => self.extruder_10nm.checked_add(self.length_10nm(value)?)?,
            Some(value) => self.length_10nm(value)?,
        };
        Some((machine, extruder))
    }

    /// The feed with an F word applied, units of 10 nm a minute.
    pub fn feed(&self, word: Option<Decimal>) -> Option<i64> {
        match word {
            None => Some(self.feed_10nm_per_min),
            Some(value) => self.length_10nm(value),
        }
    }

    /// Returns true if a feed at the present percentage is at least [`MIN_FEED_MM_PER_S`].
    pub fn is_feed_fast_enough(&self, feed_10nm_per_min: i64) -> bool {
        const MIN_FEED_10NM_PER_MIN: i64 = (MIN_FEED_MM_PER_S * 60.0 * 100_000.0) as i64;
        const _: () = assert!(MIN_FEED_10NM_PER_MIN == 60_000);
        // At 1 %, the least, 100 times the slowest feed is enough; so the product need not
        // hold faster ones.
        feed_10nm_per_min.min(100 * MIN_FEED_10NM_PER_MIN) * i64::from(self.feed_percent) >= 100 * MIN_FEED_10NM_PER_MIN
    }

    /// mm/s of a feed at the present percentage (M220).
    pub fn feed_mm_per_s(&self, feed_10nm_per_min: i64) -> f32 {
        feed_10nm_per_min as f32 * f32::from(self.feed_percent) / (60.0 * 100.0 * 100_000.0)
    }
}
