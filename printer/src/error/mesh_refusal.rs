//! Text of the reason why Z follows no mesh.

use core::fmt;

use ferrostep_gcode::Real;
use ferrostep_planner::surface::MeshError;

use crate::motion::length::mm;

/// The text of a mesh's error.
pub(crate) struct MeshRefusal<'a>(pub &'a MeshError);

impl fmt::Display for MeshRefusal<'_> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self.0 {
            MeshError::Incomplete => out.write_str("there is no mesh of the bed: G29 measures one"),
            MeshError::TooSteep { slope, maximum } => {
                let [slope, maximum] = [slope, maximum].map(|slope| Real::fixed(slope * 100.0, 1));
                write!(
                    out,
                    "the mesh rises by {slope} % between two points, expected at most {maximum} %: is the bed crooked, or was a point \
                     measured wrong (M420 V)?"
                )
            }
            MeshError::SharedMotor => out.write_str("Z has no motor of its own and follows no mesh"),
            MeshError::FadesTooSoon { least_10nm } => write!(
                out,
                "Z: the mesh is too uneven to fade away by then, expected 0 or at least {} mm",
                mm(least_10nm.into())
            ),
        }
    }
}
