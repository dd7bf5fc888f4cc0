//! Text of the reason why Z cannot follow a mesh.

use core::fmt;

use ferrostep_gcode::Real;
use ferrostep_planner::surface::MeshError;

use crate::motion::length::mm;

/// Text of a mesh's error.
pub(crate) struct MeshRefusal<'a>(pub &'a MeshError);

impl fmt::Display for MeshRefusal<'_> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self.0 {
            MeshError::Incomplete => out.write_str("the bed has no mesh: measure one with G29"),
            MeshError::TooSteep { slope, maximum } => {
                let [slope, maximum] = [slope, maximum].map(|slope| Real::fixed(slope * 100.0, 1));
                write!(
                    out,
                    "the mesh rises by {slope} % between two points, expected at most {maximum} %: is the bed crooked, or was a point \
                     measured wrong (M420 V)?"
                )
            }
            MeshError::SharedMotor => out.write_str("Z shares a motor and cannot follow a mesh"),
            MeshError::FadesTooSoon { least_10nm } => write!(
                out,
                "Z: the mesh is too uneven to fade out by then, expected 0 or at least {} mm",
                mm(least_10nm.into())
            ),
        }
    }
}
