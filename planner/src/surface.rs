//! Z follows the measured surface of the bed.
//!
//! Z's correction joins the other motors' step events on their way to the step queue
//! ([`BedStage`]): no block is split, look-ahead plans as ever, and X, Y and the extruder step when
//! they would without it. What Z can do is kept beforehand: blocks keep to [`SurfaceBounds`].

mod bounds;
mod mesh;
mod stage;

use core::fmt::Debug;
use core::future::{Pending, pending};

pub use bounds::SurfaceBounds;
pub use mesh::{MAX_MESH_POINTS, Mesh, MeshError, MeshGrid, MeshInterpolation};
pub use stage::BedStage;

use crate::kinematics::Geometry;
use crate::passing::PassedEntries;
use crate::step_queue::{Notice, StepEntry};

/// Stage between the planner and the step queue that lets Z follow the bed: [`BedStage`], or
/// [`NoBed`] in an image without a probe.
pub trait Bed: Debug {
    /// True if the image contains it.
    const PRESENT: bool;

    /// A command's future in a build with a bed, and in another one that never ends, and contains
    /// no code of it: what a future may be waiting for is compiled even where nothing begins it.
    type Only<F: Future>: Future<Output = F::Output>;

    /// The future that `begin` makes, in a build with a bed.
    fn only<F: Future>(begin: impl FnOnce() -> F) -> Self::Only<F>;

    /// No mesh: Z stays at the plan's height.
    fn new(geometry: &Geometry) -> Self;

    /// The measured mesh.
    fn mesh(&mut self) -> Option<&mut Mesh>;

    /// True if Z follows the mesh.
    fn is_on(&self) -> bool;

    /// Makes Z follow the mesh, or stops it, at standstill; [`Self::stand`] comes next. Returns the
    /// limits of blocks.
    ///
    /// # Errors
    /// [`MeshError`]; Z then follows nothing.
    fn switch(&mut self, on: bool) -> Result<SurfaceBounds, MeshError>;

    /// Sets the motors of X, Y and Z (A, B, Z) to these steps while nothing waits. Returns how many
    /// of Z's steps are the correction there.
    fn stand(&mut self, motor_steps: [i64; 3], directions: u8) -> i64;

    /// Sets the offset of the nozzle from the motors' position, X and Y in units of 10 nm; it takes
    /// effect at the next [`Self::switch`].
    fn set_nozzle_offset(&mut self, _offset_10nm: [i32; 2]) {}

    /// Takes entries; `false`: they may pass as they are.
    fn take(&mut self, entries: &[StepEntry]) -> bool;

    /// Takes a notice that follows the entries; returns `false` if the notice may pass.
    fn take_notice(&mut self, notice: &Notice) -> bool;

    /// True while something waits for [`Self::work`].
    fn is_waiting(&self) -> bool;

    /// Passes on the next waiting item: writes entries to `out`, which must be empty, or returns
    /// the notice that follows them.
    fn work(&mut self, out: &mut PassedEntries) -> Option<Notice>;
}

/// No mesh, and no memory for one.
#[derive(Clone, Copy, Debug)]
pub struct NoBed;

impl Bed for NoBed {
    const PRESENT: bool = false;

    type Only<F: Future> = Pending<F::Output>;

    fn only<F: Future>(_: impl FnOnce() -> F) -> Pending<F::Output> {
        pending()
    }

    fn new(_: &Geometry) -> Self {
        Self
    }

    fn mesh(&mut self) -> Option<&mut Mesh> {
        None
    }

    fn is_on(&self) -> bool {
        false
    }

    fn switch(&mut self, _: bool) -> Result<SurfaceBounds, MeshError> {
        Err(MeshError::Incomplete)
    }

    fn stand(&mut self, _: [i64; 3], _: u8) -> i64 {
        0
    }

    fn take(&mut self, _: &[StepEntry]) -> bool {
        false
    }

    fn take_notice(&mut self, _: &Notice) -> bool {
        false
    }

    fn is_waiting(&self) -> bool {
        false
    }

    fn work(&mut self, _: &mut PassedEntries) -> Option<Notice> {
        None
    }
}
