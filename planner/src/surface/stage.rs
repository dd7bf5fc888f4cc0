//! Z's correction joins the events on their way to the step queue.

use super::Bed;
use super::bounds::SurfaceBounds;
use super::mesh::{MAX_SLOPE, Mesh, MeshError, UM_10NM, cell};
use crate::kinematics::{Geometry, UNITS_PER_MM};
use crate::passing::{PassedEntries, Stage, Waiting};
use crate::step_queue::{Notice, StepEntry, StepKind};

/// Z's bit in an axis mask.
const Z: u8 = 1 << 2;

/// Z steps when the surface is farther away than this, steps. Beyond a half, so that a path along a
/// contour line, of whose steps each goes a little up or down, does not turn Z with every step:
/// after a step of Z the surface is within a quarter.
pub(super) const MAX_AWAY: f32 = 0.75;

/// Part of the way to the next step of Z that is left to the rounding of its sum.
const ROUNDING: f32 = 0.999;

/// The most steps of Z that one event may ask for: each event can have one.
const MAX_PER_EVENT: f32 = 1.0;

/// Bed stage between the planner and the step queue, with the mesh.
#[derive(Debug)]
pub struct BedStage {
    mesh: Mesh,
    geometry: Geometry,
    is_on: bool,
    /// Steps of Z's motor for each um.
    steps_per_um: f32,
    /// Steps by which the surface can be farther away after an event.
    per_event: f32,
    /// Offset of the nozzle from the motors' position, 10 nm.
    nozzle_offset_10nm: [i32; 2],
    /// Position of the motors with the nozzle above the mesh's first point, 10 nm.
    from_10nm: [f32; 2],
    /// Cells for each 10 nm along X and along Y.
    cells_per_10nm: [f32; 2],
    /// Length of a step, 10 nm.
    steps_10nm: [f32; 3],
    /// Height to which the correction fades, for each 10 nm; 0: it does not.
    per_fade: f32,
    /// Planned positions of the motors of X, Y and Z (A, B, Z).
    motors: [i32; 3],
    /// Steps by which Z is above its planned position.
    correction: i32,
    /// Number of coming events without a correction.
    sure: u32,
    /// The direction signals by the plan, and as they are.
    planned: u8,
    actual: u8,
    waiting: Waiting,
}

impl Bed for BedStage {
    const PRESENT: bool = true;

    type Only<F: Future> = F;

    fn only<F: Future>(begin: impl FnOnce() -> F) -> F {
        begin()
    }

    fn new(geometry: &Geometry) -> Self {
        Self {
            mesh: Mesh::NONE,
            geometry: *geometry,
            is_on: false,
            steps_per_um: 0.0,
            per_event: 0.0,
            nozzle_offset_10nm: [0; 2],
            from_10nm: [0.0; 2],
            cells_per_10nm: [0.0; 2],
            steps_10nm: [0.0; 3],
            per_fade: 0.0,
            motors: [0; 3],
            correction: 0,
            sure: 0,
            planned: 0,
            actual: 0,
            waiting: Waiting::NONE,
        }
    }

    fn mesh(&mut self) -> Option<&mut Mesh> {
        Some(&mut self.mesh)
    }

    fn is_on(&self) -> bool {
        self.is_on
    }

    fn switch(&mut self, on: bool) -> Result<SurfaceBounds, MeshError> {
        self.is_on = false;
        if !on {
            return Ok(SurfaceBounds::NONE);
        }
        let bounds = self.prepare()?;
        self.is_on = true;
        Ok(bounds)
    }

    fn set_nozzle_offset(&mut self, offset_10nm: [i32; 2]) {
        self.nozzle_offset_10nm = offset_10nm;
    }

    fn stand(&mut self, motor_steps: [i64; 3], directions: u8) -> i64 {
        self.waiting = Waiting::NONE;
        (self.planned, self.actual, self.sure) = (directions, directions, 0);
        self.motors = motor_steps.map(|steps| steps as i32);
        self.correction = 0;
        if self.is_on {
            let correction = self.correction_at(motor_steps);
            let [.., z] = &mut self.motors;
            *z = z.wrapping_sub(correction);
            self.correction = correction;
        }
        self.correction.into()
    }

    fn take(&mut self, entries: &[StepEntry]) -> bool {
        if self.is_on {
            self.waiting.take(entries);
        }
        self.is_on
    }

    fn take_notice(&mut self, notice: &Notice) -> bool {
        if self.is_on {
            self.waiting.take_notice(notice);
        }
        self.is_on
    }

    fn is_waiting(&self) -> bool {
        self.waiting.is_any()
    }

    // Once in the image, for the planner's task alone.
    #[inline(never)]
    fn work(&mut self, out: &mut PassedEntries) -> Option<Notice> {
        self.pass_on(out)
    }
}

impl Stage for BedStage {
    fn waiting(&mut self) -> &mut Waiting {
        &mut self.waiting
    }

    fn added_steps(&self) -> [i32; 3] {
        [0, 0, self.correction]
    }

    fn pass(&mut self, entry: StepEntry, out: &mut PassedEntries) {
        match entry.kind() {
            StepKind::Directions { directions } => {
                self.planned = directions;
                // Z's alone waits for a step of it: the correction may have turned it already.
                if (directions ^ self.actual) & !Z != 0 {
                    self.turn(directions, out);
                }
                self.waiting.pass_entry();
            }
            StepKind::Wait { .. } => {
                out.push(entry);
                self.waiting.pass_entry();
            }
            StepKind::Stair { .. } => {
                let left = self.waiting.events_left();
                let sure = u32::from(left).min(self.sure) as u16;
                if sure > 0 {
                    self.sure -= u32::from(sure);
                    self.pass_sure(entry, sure, sure == left, out);
                } else {
                    self.pass_one(entry, left == 1, out);
                }
            }
        }
    }
}

impl BedStage {
    /// Works out what the surface asks for.
    #[inline(never)]
    fn prepare(&mut self) -> Result<SurfaceBounds, MeshError> {
        let Geometry { kinematics, steps_per_mm: [x, y, z, _], .. } = self.geometry;
        if kinematics.shares_motors(2) {
            return Err(MeshError::SharedMotor);
        }
        self.mesh.refine();
        self.steps_10nm = [x, y, z].map(|steps| UNITS_PER_MM as f32 / steps.to_f64() as f32);
        self.steps_per_um = z.to_f64() as f32 / 1000.0;
        let (from_10nm, [offset_x, offset_y]) = (self.mesh.grid().from_10nm, self.nozzle_offset_10nm);
        let [from_x, from_y] = from_10nm;
        self.from_10nm = [from_x.wrapping_sub(offset_x) as f32, from_y.wrapping_sub(offset_y) as f32];
        self.cells_per_10nm = self.mesh.spacing_10nm().map(|spacing| 1.0 / spacing);
        let fade_10nm = self.mesh.fade_10nm();
        self.per_fade = if fade_10nm > 0 { 1.0 / fade_10nm as f32 } else { 0.0 };
        // Travel of X and Y in one event in which all motors step.
        let [a, b, c] = self.steps_10nm;
        let mut reach_10nm = [0.0; 3];
        for one in [[a, 0.0, 0.0], [0.0, b, 0.0], [0.0, 0.0, c]] {
            for (reach, part) in reach_10nm.iter_mut().zip(kinematics.position(one)) {
                *reach += part.abs();
            }
        }
        let [reach_x, reach_y, reach_z] = reach_10nm;
        let per_step = self.steps_per_um / UM_10NM;
        // A bed may be as steep as one step of Z for an event.
        let max_slope = MAX_PER_EVENT / (per_step * (reach_x + reach_y));
        let bounds = self.mesh.bounds(if max_slope < MAX_SLOPE { max_slope } else { MAX_SLOPE })?;
        let SurfaceBounds { slope: [slope_x, slope_y], fade, .. } = bounds;
        self.per_event = per_step * (slope_x * reach_x + slope_y * reach_y + fade * reach_z);
        Ok(bounds)
    }

    /// The surface above the plan's zero at a place of the tool, 10 nm, where nothing has
    /// faded, in steps of Z.
    fn surface(&self, [x, y]: [f32; 2]) -> f32 {
        let [from_x, from_y] = self.from_10nm;
        let ([columns, rows], [beyond_x, beyond_y]) = (self.mesh.points(), self.mesh.beyond());
        let [per_x, per_y] = self.cells_per_10nm;
        let (column, right) = cell((x - from_x) * per_x, columns, beyond_x);
        let (row, back) = cell((y - from_y) * per_y, rows, beyond_y);
        let [a, b, c, d] = self.mesh.corners_um([column, row]);
        let (front, behind) = (a + (b - a) * right, c + (d - c) * right);
        (front + (behind - front) * back) * self.steps_per_um
    }

    /// Share of the correction left at a height of the plan, 10 nm.
    fn left_at(&self, z_10nm: f32) -> f32 {
        (1.0 - z_10nm * self.per_fade).clamp(0.0, 1.0)
    }

    /// Planned position of the tool, 10 nm.
    fn place_10nm(&self) -> [f32; 3] {
        let ([a, b, c], [step_a, step_b, step_c]) = (self.motors.map(|steps| steps as f32), self.steps_10nm);
        self.geometry.kinematics.position([a * step_a, b * step_b, c * step_c])
    }

    /// The surface at the plan's place, steps of Z.
    fn wanted(&self) -> f32 {
        let [x, y, z] = self.place_10nm();
        self.surface([x, y]) * self.left_at(z)
    }

    /// Correction at these motor steps, which include it: `z = plan + h (1 - plan / fade)`,
    /// solved for the plan.
    fn correction_at(&self, [a, b, z]: [i64; 3]) -> i32 {
        let [step_a, step_b, step_z] = self.steps_10nm;
        let [x, y, _] = self.geometry.kinematics.position([a as f32 * step_a, b as f32 * step_b, 0.0]);
        let (surface, z) = (self.surface([x, y]), z as f32);
        let per_step = self.per_fade * step_z;
        let faded = (z - surface) / (1.0 - surface * per_step);
        let plan = if faded <= 0.0 {
            z - surface
        } else if faded * per_step >= 1.0 {
            z
        } else {
            faded
        };
        round(z - plan)
    }

    /// Adds events that need no correction.
    fn pass_sure(&mut self, entry: StepEntry, count: u16, is_end: bool, out: &mut PassedEntries) {
        let (axes, added) = (entry.axes(), if is_end { entry.added() } else { 0 });
        let last = axes ^ added;
        self.follow(axes, count.wrapping_sub(1).into());
        self.follow(last, 1);
        if (axes | last) & Z != 0 {
            self.turn_z(self.planned, out);
        }
        let part = if count == 1 {
            StepEntry::stair(entry.interval_ticks(), 1, last, 0)
        } else {
            StepEntry::stair(entry.interval_ticks(), count, axes, added)
        };
        if let Some(part) = part {
            out.push(part);
        }
        self.waiting.pass_events(count);
    }

    /// Adds an event, after which the surface is looked at.
    fn pass_one(&mut self, entry: StepEntry, is_end: bool, out: &mut PassedEntries) {
        let mut axes = if is_end { entry.axes() ^ entry.added() } else { entry.axes() };
        let mut interval = entry.interval_ticks();
        self.follow(axes, 1);
        let mut away = self.wanted() - self.correction as f32;
        if away.abs() > MAX_AWAY {
            let is_down = away < 0.0;
            let directions = if is_down { self.planned | Z } else { self.planned & !Z };
            let by = if is_down { -1 } else { 1 };
            let half = interval / 2;
            let mut is_made = true;
            if axes & Z == 0 {
                self.turn_z(directions, out);
                axes |= Z;
            } else if (self.planned ^ directions) & Z != 0 {
                // The plan's step and the correction's make none.
                axes &= !Z;
            } else if half >= self.geometry.minimum_event_interval_ticks.max(1) {
                // Two steps one way: the second in the middle of the time before.
                self.turn_z(directions, out);
                out.push(StepEntry::event(half, Z));
                interval = interval.wrapping_sub(half);
            } else {
                // Z's step is left to the next event.
                self.turn_z(directions, out);
                is_made = false;
            }
            if is_made {
                self.correction = self.correction.wrapping_add(by);
                away -= by as f32;
            }
        } else if axes & Z != 0 {
            self.turn_z(self.planned, out);
        }
        out.push(if axes == 0 { StepEntry::wait(interval) } else { StepEntry::event(interval, axes) });
        // This number of events cannot take the surface out of reach. The cast saturates, also if
        // nothing changes.
        self.sure = ((MAX_AWAY - away.abs()) * ROUNDING / self.per_event) as u32;
        self.waiting.pass_events(1);
    }

    /// Follows the plan by this number of steps of these motors.
    fn follow(&mut self, axes: u8, steps: i32) {
        for (motor, bit) in self.motors.iter_mut().zip(0..) {
            if axes >> bit & 1 == 1 {
                let is_back = self.planned >> bit & 1 == 1;
                *motor = motor.wrapping_add(if is_back { steps.wrapping_neg() } else { steps });
            }
        }
    }

    /// Sets the direction signals.
    fn turn(&mut self, directions: u8, out: &mut PassedEntries) {
        self.actual = directions;
        out.push(StepEntry::directions(directions));
    }

    /// Sets Z's direction signal to that in `directions`, if they differ.
    fn turn_z(&mut self, directions: u8, out: &mut PassedEntries) {
        let turned = self.actual & !Z | directions & Z;
        if turned != self.actual {
            self.turn(turned, out);
        }
    }
}

fn round(x: f32) -> i32 {
    (if x < 0.0 { x - 0.5 } else { x + 0.5 }) as i32
}
