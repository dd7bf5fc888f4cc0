//! The summary that `preprocess` prints.

use std::fmt;
use std::path::Path;

use ferrostep_host::printable::one_line;
use ferrostep_planner::extruder::FILAMENT_UNITS_PER_MM;
use serde::Serialize;

use super::Prepared;
use crate::duration::hms;
use crate::remarks::{self, Remark};

/// The summary of `preprocess`, and its `--json`.
#[derive(Clone, Debug, Serialize)]
pub struct PreparedSummary {
    /// The G-code, as given.
    pub file: String,
    /// The prepared job, as given.
    pub out: String,
    /// Name of the machine.
    pub profile: String,
    /// Lines that were read.
    pub lines: u32,
    /// G0 to G3 that displaced something.
    pub moves: u64,
    /// Layers, by the slicer's comments.
    pub layers: u32,
    /// Frames.
    pub frames: u32,
    /// Length of the G-code, unpacked.
    pub source_bytes: u64,
    /// Length of the prepared job.
    pub bytes: u64,
    /// Bytes a move, everything but the thumbnail included.
    pub bytes_per_move: f64,
    /// Length of the prepared job over that of the G-code.
    pub ratio: f64,
    /// Sum of the blocks' durations, homing left out.
    pub motion_time_s: f64,
    /// Net filament.
    pub filament_mm: f64,
    /// Real time, s.
    pub wall_s: f64,
    /// Remarks for a person.
    pub remarks: Vec<Remark>,
}

impl PreparedSummary {
    /// The summary of a job that was prepared in this many seconds.
    pub fn new(file: &Path, out: &Path, profile: &str, prepared: &Prepared, wall_s: f64) -> Self {
        let header = &prepared.header;
        let picture = header.thumbnail.map_or(0, |picture| u64::from(picture.length));
        Self {
            file: file.display().to_string(),
            out: out.display().to_string(),
            profile: profile.to_owned(),
            lines: prepared.progress.lines,
            moves: header.moves,
            layers: header.layers,
            frames: header.frames,
            source_bytes: prepared.source_bytes,
            bytes: prepared.bytes,
            bytes_per_move: (prepared.bytes - picture) as f64 / header.moves.max(1) as f64,
            ratio: prepared.bytes as f64 / prepared.source_bytes.max(1) as f64,
            motion_time_s: header.motion_ms as f64 / 1000.0,
            filament_mm: header.filament_100pm as f64 / FILAMENT_UNITS_PER_MM as f64,
            wall_s,
            remarks: prepared.remarks.clone(),
        }
    }
}

impl fmt::Display for PreparedSummary {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let wall_s = self.wall_s.max(1e-6);
        writeln!(out, "{} for {}: {}", one_line(&self.file), self.profile, one_line(&self.out))?;
        writeln!(out, "  time         {} in motion", hms(self.motion_time_s))?;
        writeln!(out, "  filament     {:.3} m", self.filament_mm / 1000.0)?;
        writeln!(out, "  moves        {} in {} lines, {} layers", self.moves, self.lines, self.layers)?;
        writeln!(
            out,
            "  size         {} bytes in {} frames, {:.2} bytes a move, 1/{:.1} of the G-code",
            self.bytes,
            self.frames,
            self.bytes_per_move,
            1.0 / self.ratio.max(1e-9)
        )?;
        remarks::write_all(out, &self.remarks)?;
        write!(
            out,
            "  real time    {:.2} s, {:.0} lines/s, {:.1} MB/s",
            self.wall_s,
            f64::from(self.lines) / wall_s,
            self.source_bytes as f64 / wall_s / 1e6
        )
    }
}
