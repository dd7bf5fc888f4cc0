//! Interpretation of the words of a G-code line as the move that they ask for.

use ferrostep_gcode::{ArcForm, AxisWords, Command, Decimal};
use ferrostep_planner::extruder::Extruder;
use ferrostep_planner::kinematics::MAX_COORDINATE_10NM;
use ferrostep_planner::{Move, filament_100pm};

use crate::error::CommandError;
use crate::motion::arc::{Arc, InnerPoints};
use crate::motion::extrusion::AdaptiveExtrusion;
use crate::motion::modal::{Modal, NewestRetraction, Tally};
use crate::motion::skew::Skew;
use crate::settings::profile::Profile;
use crate::settings::profile::homing::HomeSensor;

/// Logical extruder positions stay within 10,000 km.
pub(crate) const MAX_EXTRUDER_10NM: i64 = 1_000_000_000_000_000;

/// Turns G-code into moves. Holds the state that lasts from line to line; touches neither
/// motors nor heaters.
///
/// A line is first turned into a move ([`Self::linear`], [`Self::arc`]). It becomes part of the
/// state only when the planner has taken the move ([`Self::take`]): a move that waits or is
/// refused has no effect.
#[derive(Debug)]
pub(crate) struct MoveInterpreter<'a> {
    pub profile: &'a Profile,
    /// Skew between the machine position and the axes.
    pub skew: Skew,
    pub modal: Modal,
    pub tally: Tally,
    pub newest_retraction: Option<NewestRetraction>,
}

/// The places of a move as its line asks for them, before soft limits draw it in: units of 10 nm of
/// the machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AskedPlaces {
    /// Place before the move.
    pub from_10nm: [i64; 3],
    /// Target.
    pub to_10nm: [i64; 3],
    /// Range of an arc in X and in Y.
    pub reach_10nm: Option<[[i64; 2]; 2]>,
    /// True if filament is pushed along a path.
    pub extrudes: bool,
}

/// A move whose words have been checked, and the state after it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AskedMove {
    /// The move for the planner.
    pub request: Move,
    /// True if it displaces anything; the planner gets no others.
    pub displaces: bool,
    /// The axes whose target a soft limit has changed.
    pub clamped: [bool; 3],
    /// Range of an arc in X and in Y of the machine; `None` for a straight move.
    pub reach_10nm: Option<[[i64; 2]; 2]>,
    target: Target,
    extrusion: AdaptiveExtrusion,
}

impl AskedMove {
    /// The same for a nozzle too cold to push any: E counts, the motors stay.
    pub fn without_filament(self) -> Self {
        Self { request: Move { filament_100pm: 0, ..self.request }, displaces: false, ..self }
    }
}

/// The target of a line.
#[derive(Clone, Copy, Debug)]
struct Target {
    machine_10nm: [i64; 3],
    extruder_10nm: i64,
    feed_10nm_per_min: i64,
}

/// An arc whose words have been checked: its moves, one after the other.
#[derive(Debug)]
pub(crate) struct ArcMoves {
    /// True if any of them pushes filament.
    pub extrudes: bool,
    /// The centre seen from the start, mm.
    pub centre_mm: [f64; 2],
    points: InnerPoints,
    reach_10nm: [[i64; 2]; 2],
    target: Target,
    /// Z and E before the arc.
    start: [i64; 2],
    filament_100pm: i64,
    pushed_100pm: i64,
    by_length: bool,
    clamped: [bool; 3],
    chords: u32,
    taken: u32,
    line: u32,
}

impl ArcMoves {
    /// Divides a whole into shares that add up to it exactly.
    fn share(&self, whole: i64) -> i64 {
        (i128::from(whole) * i128::from(self.taken) / i128::from(self.chords)) as i64
    }

    /// The next move; to be called when the one before has been taken.
    pub fn next(&mut self, interpreter: &MoveInterpreter<'_>) -> Option<AskedMove> {
        if self.taken == self.chords {
            return None;
        }
        self.taken += 1;
        let modal = &interpreter.modal;
        let [z_before, extruder_before] = self.start;
        let mut target = self.target;
        if let Some([x, y]) = self.points.next() {
            target.machine_10nm = [x, y, z_before + self.share(self.target.machine_10nm[2] - z_before)];
            target.extruder_10nm = extruder_before + self.share(self.target.extruder_10nm - extruder_before);
            // The F word counts from the end of the line on.
            target.feed_10nm_per_min = modal.feed_10nm_per_min;
        }
        interpreter.clamp_into(&mut target.machine_10nm, modal.lift_10nm, &mut self.clamped);
        let mut extrusion = modal.extrusion;
        let mut push_100pm = self.share(self.filament_100pm) - self.pushed_100pm;
        if self.by_length {
            (push_100pm, extrusion) = interpreter.along(extrusion, modal.machine_10nm, target.machine_10nm);
        }
        self.pushed_100pm += push_100pm;
        let request = Move {
            target_10nm: interpreter.raised(target.machine_10nm),
            filament_100pm: push_100pm,
            feed_mm_per_s: modal.feed_mm_per_s(self.target.feed_10nm_per_min),
            line: self.line,
            ends_move: self.taken == self.chords,
        };
        let reach_10nm = Some(self.reach_10nm);
        Some(AskedMove { request, displaces: true, clamped: self.clamped, reach_10nm, target, extrusion })
    }
}

impl<'a> MoveInterpreter<'a> {
    /// The state of a printer that has just been switched on.
    pub fn new(profile: &'a Profile) -> Self {
        Self {
            profile,
            skew: profile.skew,
            modal: Modal::new(profile),
            tally: Tally::default(),
            newest_retraction: None,
        }
    }

    /// G0, G1.
    pub fn linear(
        &self,
        rapid: bool,
        axes: &AxisWords,
        feed: Option<Decimal>,
        line: u32,
    ) -> Result<AskedMove, CommandError> {
        let mut target = self.target(axes, feed)?;
        let mut clamped = [false; 3];
        self.clamp_into(&mut target.machine_10nm, self.modal.lift_10nm, &mut clamped);
        let (mut filament_100pm, mut extrusion) = (self.filament(&target), self.modal.extrusion);
        if !rapid && self.extrudes_by_length(axes, &target) {
            (filament_100pm, extrusion) = self.along(extrusion, self.modal.machine_10nm, target.machine_10nm);
            self.check_filament(filament_100pm)?;
        }
        let request = Move {
            target_10nm: self.raised(target.machine_10nm),
            filament_100pm,
            feed_mm_per_s: self.modal.feed_mm_per_s(target.feed_10nm_per_min),
            line,
            ends_move: true,
        };
        let displaces = target.machine_10nm != self.modal.machine_10nm || filament_100pm != 0;
        Ok(AskedMove { request, displaces, clamped, reach_10nm: None, target, extrusion })
    }

    /// G2, G3: chords at most 0.01 mm off; Z and E follow evenly.
    pub fn arc(
        &self,
        clockwise: bool,
        axes: &AxisWords,
        form: ArcForm,
        feed: Option<Decimal>,
        line: u32,
    ) -> Result<ArcMoves, CommandError> {
        let target = self.target(axes, feed)?;
        let from = self.modal.machine_10nm;
        let [start, end] = [from, target.machine_10nm].map(|[x, y, _]| [x, y]);
        // A centre may be farther away than any point: that of a nearly straight wall.
        let length = |word: Decimal| self.modal.length_10nm(word).ok_or(CommandError::TooFar);
        let arc = match form {
            ArcForm::Centre { i, j } => {
                let (i, j) = (length(i)?, length(j)?);
                Arc::around(start, end, [start[0] + i, start[1] + j], clockwise)?
            }
            ArcForm::Radius(radius) => Arc::with_radius(start, end, length(radius)?, clockwise)?,
        };
        let filament_100pm = self.filament(&target);
        let by_length = self.extrudes_by_length(axes, &target);
        let mut extrudes = filament_100pm != 0;
        if by_length {
            let longest = [from[0] + arc.longest_chord(), from[1], from[2]];
            let (longest_100pm, _) = self.along(self.modal.extrusion, from, longest);
            self.check_filament(longest_100pm)?;
            extrudes = longest_100pm != 0;
        }
        Ok(ArcMoves {
            extrudes,
            centre_mm: arc.centre_from(start),
            points: arc.inner_points(),
            reach_10nm: arc.reach(),
            target,
            start: [from[2], self.modal.extruder_10nm],
            filament_100pm,
            pushed_100pm: 0,
            by_length,
            clamped: [false; 3],
            chords: arc.chords(),
            taken: 0,
            line,
        })
    }

    /// Follows a move that the planner has taken, in state and tallies. A stop takes back the part
    /// that was not made, here and in the planner.
    pub fn take(&mut self, asked: &AskedMove) {
        let AskedMove { request, displaces, clamped, target, extrusion, .. } = asked;
        let from = self.modal.machine_10nm;
        self.modal.machine_10nm = target.machine_10nm;
        self.modal.extruder_10nm = target.extruder_10nm;
        self.modal.feed_10nm_per_min = target.feed_10nm_per_min;
        self.modal.extrusion = *extrusion;
        self.tally.filament_100pm += request.filament_100pm;
        if request.ends_move {
            if request.filament_100pm != 0 {
                self.newest_retraction = None;
            }
            self.tally.moves += u64::from(*displaces);
            self.tally.clamped_moves += u64::from(clamped.contains(&true));
            let is_unhomed = (0..3).any(|axis| !self.modal.homed[axis] && from[axis] != target.machine_10nm[axis]);
            self.tally.unhomed_moves += u64::from(is_unhomed);
        }
    }

    /// The target of a move, or why it is refused.
    fn target(&self, axes: &AxisWords, feed: Option<Decimal>) -> Result<Target, CommandError> {
        let (machine_10nm, extruder_10nm) = self.modal.target(axes).ok_or(CommandError::TooFar)?;
        if machine_10nm.iter().any(|coordinate| coordinate.unsigned_abs() > MAX_COORDINATE_10NM as u64) {
            return Err(CommandError::TooFar);
        }
        if extruder_10nm.unsigned_abs() > MAX_EXTRUDER_10NM as u64 {
            return Err(CommandError::TooMuchFilament);
        }
        let feed_10nm_per_min = self.modal.feed(feed).ok_or(CommandError::TooFar)?;
        if !self.modal.is_feed_fast_enough(feed_10nm_per_min) {
            let percent = f64::from(self.modal.feed_percent);
            let feed_mm_per_s = feed_10nm_per_min as f64 * percent / (60.0 * 100.0 * 100_000.0);
            return Err(CommandError::FeedTooSlow { feed_mm_per_s });
        }
        let target = Target { machine_10nm, extruder_10nm, feed_10nm_per_min };
        // Checked here and not only by the planner, because an arc reaches the
        // planner in many moves.
        self.check_filament(self.filament(&target))?;
        Ok(target)
    }

    /// The places of a G0 to G3 as its line asks for them; `None` for another command, and for a
    /// move that is refused.
    pub fn asked_places(&self, command: &Command<'_>) -> Option<AskedPlaces> {
        let from_10nm = self.modal.machine_10nm;
        let (target, pushes, reach_10nm) = match *command {
            Command::Linear { rapid, ref axes, feed } => {
                let target = self.target(axes, feed).ok()?;
                let by_length = !rapid && self.extrudes_by_length(axes, &target);
                (target, by_length || self.filament(&target) > 0, None)
            }
            Command::Arc { clockwise, ref axes, form, feed } => {
                let moves = self.arc(clockwise, axes, form, feed, 0).ok()?;
                (moves.target, moves.extrudes && moves.filament_100pm >= 0, Some(moves.reach_10nm))
            }
            _ => return None,
        };
        let to_10nm = target.machine_10nm;
        let is_path = reach_10nm.is_some() || to_10nm != from_10nm;
        Some(AskedPlaces { from_10nm, to_10nm, reach_10nm, extrudes: pushes && is_path })
    }

    fn filament(&self, target: &Target) -> i64 {
        filament_100pm(target.extruder_10nm - self.modal.extruder_10nm, i64::from(self.modal.flow_percent))
    }

    /// Checks that a move may push this much filament.
    pub fn check_filament(&self, filament_100pm: i64) -> Result<(), CommandError> {
        if Extruder::can_push(self.profile.steps_per_mm[3], filament_100pm) {
            Ok(())
        } else {
            Err(CommandError::TooMuchFilament)
        }
    }

    /// Returns true if a move gets filament by its length (M795): one in the plane, without an E
    /// word, and with the filament not drawn back.
    fn extrudes_by_length(&self, axes: &AxisWords, target: &Target) -> bool {
        let [from, to] = [self.modal.machine_10nm[2], target.machine_10nm[2]];
        self.modal.extrusion.settings().adaptive && axes.e.is_none() && from == to && !self.modal.retracted
    }

    /// Filament along a path in the plane, and the remainder owed after it.
    fn along(&self, extrusion: AdaptiveExtrusion, from: [i64; 3], to: [i64; 3]) -> (i64, AdaptiveExtrusion) {
        let [from, to] = [from, to].map(|[x, y, _]| [x, y]);
        extrusion.along(from, to, self.modal.flow_percent)
    }

    /// Lower and upper end of an axis's travel.
    pub fn travel_10nm(&self, axis: usize) -> [i64; 2] {
        let rise_10nm = if axis == 2 { self.modal.mesh_rise_10nm } else { 0 };
        let upper = self.profile.size_10nm[axis] - rise_10nm;
        [self.profile.lower_end_10nm[axis].min(upper), upper]
    }

    /// Soft limits: draws a target, above which Z is lifted, into the travel of the homed axes, and
    /// marks the axes that this changed.
    pub fn clamp_into(&self, target_10nm: &mut [i64; 3], lift_10nm: i64, clamped: &mut [bool; 3]) {
        if !self.modal.soft_limits {
            return;
        }
        // Where a skew axis goes depends on those after it.
        for axis in [2, 1, 0] {
            let [lower, upper] = self.asked_travel_10nm(axis, *target_10nm, lift_10nm);
            let inside = target_10nm[axis].clamp(lower, upper);
            if self.modal.homed[axis] && inside != target_10nm[axis] {
                target_10nm[axis] = inside;
                clamped[axis] = true;
            }
        }
    }

    /// Range that may be asked of an axis at a machine position, above which Z is lifted: its
    /// travel, shifted by its skew there.
    pub fn asked_travel_10nm(&self, axis: usize, [x, y, z]: [i64; 3], lift_10nm: i64) -> [i64; 2] {
        // All are within 5 m.
        let motors_z_10nm = z.wrapping_add(lift_10nm).wrapping_add(self.modal.z.shift_10nm);
        let ahead_10nm = self.skew.ahead_10nm(axis, [x, y, motors_z_10nm]);
        let [lower_10nm, upper_10nm] = self.travel_10nm(axis).map(|end_10nm| end_10nm.wrapping_add(ahead_10nm));
        // Until an offset has been followed, the nozzle is at an end of its travel and the
        // G-code sees it beyond.
        let unfollowed_10nm = if axis == 2 { self.modal.z.offset_10nm.max(0) } else { 0 };
        [lower_10nm.wrapping_sub(unfollowed_10nm), upper_10nm]
    }

    /// Position of the axes for a machine position with Z lifted, as far as the soft limits let it,
    /// and shifted by M290.
    pub fn lifted(&self, machine_10nm: [i64; 3], lift_10nm: i64) -> [i64; 3] {
        let [x, y, z] = machine_10nm;
        let mut lifted = [x, y, z + lift_10nm];
        if lift_10nm != 0 {
            self.clamp_into(&mut lifted, 0, &mut [false; 3]);
        }
        let shift_10nm = self.modal.z.shift_10nm;
        lifted[2] += shift_10nm;
        if shift_10nm > 0 && self.modal.soft_limits && self.modal.homed[2] {
            lifted[2] = lifted[2].min(self.profile.size_10nm[2] - self.modal.mesh_rise_10nm);
        }
        self.skew.axes(lifted)
    }

    /// The machine position becomes that of the axes, without the lift and the shift of Z.
    pub fn follow(&mut self, axes_10nm: [i64; 3]) {
        self.follow_plane(axes_10nm);
        let [.., z_10nm] = axes_10nm;
        self.modal.machine_10nm[2] = self.modal.machine_z_10nm(z_10nm);
    }

    /// X and Y of the machine position become those of the axes.
    pub fn follow_plane(&mut self, axes_10nm: [i64; 3]) {
        let [x, y, _] = self.skew.asked(axes_10nm);
        let [machine_x, machine_y, _] = &mut self.modal.machine_10nm;
        (*machine_x, *machine_y) = (x, y);
    }

    /// Position of the axes for a machine position of the G-code.
    pub fn raised(&self, machine_10nm: [i64; 3]) -> [i64; 3] {
        self.lifted(machine_10nm, self.modal.lift_10nm)
    }

    /// Notes that the planner has taken the filament of a firmware retraction, which is moved at
    /// the machine's present position.
    pub fn take_retraction(&mut self, filament_100pm: i64, stands_10nm: [i64; 3]) {
        self.tally.filament_100pm += filament_100pm;
        let motor_steps = self.profile.geometry().motor_steps(stands_10nm);
        self.newest_retraction = Some(NewestRetraction { motor_steps, filament_100pm });
    }

    /// Motion was stopped, with this much filament unpushed and the motors of X, Y and
    /// Z at these steps.
    pub fn take_back(&mut self, dropped_100pm: i64, motor_steps: [i64; 3]) {
        self.tally.filament_100pm -= dropped_100pm;
        // Filament that moves extrude by their length does not belong to the G-code's position, nor
        // does a firmware retraction.
        if !self.modal.extrusion.settings().adaptive {
            let of_retraction = self.newest_retraction.map_or(0, |newest| newest.dropped(dropped_100pm, motor_steps));
            let counted_100pm = dropped_100pm - of_retraction;
            self.modal.extruder_10nm -= counted_100pm / i64::from(self.modal.flow_percent.max(1));
        }
        self.newest_retraction = None;
    }

    /// The motors in the mask may not be where their steps say: no axis that they move
    /// is homed any more.
    pub fn forget_home(&mut self, motors: u8) {
        self.modal.forget_home(self.profile.kinematics.axes_of_motors(motors));
    }

    /// Machine coordinate at which the sensor of an axis triggers; for a probe M851 moves it.
    pub fn trigger_10nm(&self, axis: usize) -> i64 {
        let homing = &self.profile.homing[axis];
        let offset_10nm = if homing.sensor == HomeSensor::Probe { self.modal.probe_offset_10nm[2] } else { 0 };
        homing.position_10nm - offset_10nm
    }

    /// G92: the coordinates change, the machine does not move.
    pub fn set_position(&mut self, words: &AxisWords) -> Result<(), CommandError> {
        let mut offset = self.modal.offset_10nm;
        for (axis, word) in [words.x, words.y, words.z].into_iter().enumerate() {
            if let Some(value) = word {
                let logical = self.modal.length_10nm(value).filter(|length| length.abs() <= MAX_COORDINATE_10NM);
                offset[axis] = logical.ok_or(CommandError::TooFar)? - self.modal.machine_10nm[axis];
            }
        }
        let extruder = match words.e {
            Some(value) => self.modal.length_10nm(value).filter(|length| length.abs() <= MAX_EXTRUDER_10NM),
            None => Some(self.modal.extruder_10nm),
        };
        self.modal.extruder_10nm = extruder.ok_or(CommandError::TooMuchFilament)?;
        self.modal.offset_10nm = offset;
        Ok(())
    }
}
