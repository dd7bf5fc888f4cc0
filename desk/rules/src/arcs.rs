//! Cuts arcs in X and Y into chords as each firmware does.
//!
//! Sources: Klipper's *G-Codes* and `klippy/extras/gcode_arcs.py`; Marlin's *Configuration*
//! (`ARC_SUPPORT`) and `Marlin/src/gcode/motion/G2_G3.cpp`; RepRapFirmware's `DoArcMove` in
//! `src/GCodes/GCodes.cpp` and `Configuration.h`.

use crate::motion::ArcHint;
use std::f64::consts::TAU;

/// G2 or G3 arc in X and Y, with Z and the filament along it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arc {
    /// Displacement of X, Y, Z and the filament from the start to the end, mm.
    pub displacement_mm: [f64; 4],
    /// Vector from the start to the centre: I and J, mm.
    pub centre_mm: [f64; 2],
    /// True for a G2.
    pub is_clockwise: bool,
}

/// Marlin's settings for arcs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MarlinArcs {
    /// `MIN_ARC_SEGMENT_MM`.
    pub min_segment_mm: f64,
    /// `MAX_ARC_SEGMENT_MM`.
    pub max_segment_mm: f64,
    /// `MIN_CIRCLE_SEGMENTS`.
    pub min_circle_segments: u32,
    /// `ARC_SEGMENTS_PER_SEC`, if set.
    pub segments_per_s: Option<f64>,
    /// Limits for [`ArcHint`]; `None` in versions without hints.
    pub hints: Option<ArcLimits>,
}

/// Limits that Marlin's hints use.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArcLimits {
    /// Smaller of the maximum accelerations of X and Y, mm/s^2.
    pub acceleration_mm_per_s2: f64,
    /// Smaller of the maximum speeds of X and Y, mm/s.
    pub speed_mm_per_s: f64,
}

impl Default for MarlinArcs {
    fn default() -> Self {
        Self { min_segment_mm: 0.1, max_segment_mm: 1.0, min_circle_segments: 72, segments_per_s: None, hints: None }
    }
}

/// Method by which a firmware cuts arcs into chords.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ArcCut {
    /// Klipper: as many chords as the arc's length holds whole `resolution`s of `[gcode_arcs]`.
    Klipper {
        /// `resolution`, mm; the default is 1.
        resolution_mm: f64,
    },
    /// Marlin, by its settings.
    Marlin(MarlinArcs),
    /// RepRapFirmware: at most 5 um from the arc, at most 200 chords per second, 0.02 to 1 mm long.
    Rrf,
}

/// Maximum number of chords of one arc; more would keep a firmware busy for hours.
const MAX_CHORDS: f64 = 1e7;

impl Arc {
    /// Returns the radius at the arc's start, mm.
    pub fn radius_mm(&self) -> f64 {
        let [i, j] = self.centre_mm;
        i.hypot(j)
    }

    /// Returns the swept angle, rad, positive counter-clockwise; a full turn if the arc ends where
    /// it begins.
    pub fn sweep(&self) -> f64 {
        let [i, j] = self.centre_mm;
        let [x, y, ..] = self.displacement_mm;
        if x == 0.0 && y == 0.0 {
            return if self.is_clockwise { -TAU } else { TAU };
        }
        let [from_x, from_y] = [-i, -j];
        let [to_x, to_y] = [x - i, y - j];
        let mut sweep = (from_x * to_y - from_y * to_x).atan2(from_x * to_x + from_y * to_y);
        if sweep < 0.0 {
            sweep += TAU;
        }
        if self.is_clockwise { sweep - TAU } else { sweep }
    }

    /// Cuts the arc into chords, in order.
    ///
    /// `feed_mm_per_s` is the requested speed, on which the chords of Marlin (with segments per
    /// second) and of RepRapFirmware depend.
    pub fn chords(&self, cut: &ArcCut, feed_mm_per_s: f64) -> Chords {
        let sweep = self.sweep();
        let flat_mm = self.radius_mm() * sweep.abs();
        let count = match cut {
            ArcCut::Klipper { resolution_mm } => (flat_mm.hypot(self.displacement_mm[2]) / resolution_mm).floor(),
            ArcCut::Marlin(arcs) => arcs.count(flat_mm, sweep, feed_mm_per_s),
            ArcCut::Rrf => {
                let by_deviation_mm = (8.0 * self.radius_mm() * 0.005).sqrt();
                let chord_mm = by_deviation_mm.min(feed_mm_per_s / 200.0).clamp(0.02, 1.0);
                (flat_mm / chord_mm + 0.8).floor()
            }
        };
        let count = if count.is_finite() { count.clamp(1.0, MAX_CHORDS) } else { 1.0 } as u32;
        let hints = match cut {
            ArcCut::Marlin(arcs) => arcs.hints.filter(|_| count > 1).map(|limits| {
                let speed2 = limits.speed_mm_per_s.min(feed_mm_per_s).powi(2);
                let by_radius = limits.acceleration_mm_per_s2 * self.radius_mm();
                (limits.acceleration_mm_per_s2, speed2.min(by_radius))
            }),
            _ => None,
        };
        Chords { arc: *self, sweep, count, done: 0, place_mm: [0.0; 2], hints, flat_mm }
    }
}

impl MarlinArcs {
    fn count(&self, flat_mm: f64, sweep: f64, feed_mm_per_s: f64) -> f64 {
        let ideal_mm = self.segments_per_s.map_or(self.max_segment_mm, |per_s| {
            (feed_mm_per_s / per_s).max(self.min_segment_mm).min(self.max_segment_mm)
        });
        let least = (f64::from(self.min_circle_segments) * sweep.abs() / TAU).ceil();
        let count = (flat_mm / ideal_mm).floor().max(least);
        let chord_mm = flat_mm / count;
        if chord_mm > self.max_segment_mm {
            (flat_mm / self.max_segment_mm).ceil()
        } else if chord_mm < self.min_segment_mm {
            (flat_mm / self.min_segment_mm).floor()
        } else {
            count
        }
    }
}

/// Chord of an arc.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chord {
    /// Displacement of X, Y, Z and the filament, mm.
    pub displacement_mm: [f64; 4],
    /// Marlin's hint for the chord.
    pub hint: Option<ArcHint>,
}

/// Iterator over the chords of an arc, in order.
#[derive(Clone, Debug)]
pub struct Chords {
    arc: Arc,
    sweep: f64,
    count: u32,
    done: u32,
    /// End of the last chord, relative to the arc's start, mm.
    place_mm: [f64; 2],
    /// Acceleration, mm/s^2, and squared speed, (mm/s)^2, for the hints.
    hints: Option<(f64, f64)>,
    flat_mm: f64,
}

impl Iterator for Chords {
    type Item = Chord;

    fn next(&mut self) -> Option<Chord> {
        if self.done == self.count {
            return None;
        }
        self.done += 1;
        let [x, y, z, e] = self.arc.displacement_mm;
        let share = 1.0 / f64::from(self.count);
        let end_mm = if self.done == self.count {
            [x, y]
        } else {
            let [i, j] = self.arc.centre_mm;
            let (sine, cosine) = (self.sweep * share * f64::from(self.done)).sin_cos();
            [i - i * cosine + j * sine, j - i * sine - j * cosine]
        };
        let [from_x, from_y] = self.place_mm;
        self.place_mm = end_mm;
        let left_mm = self.flat_mm * (1.0 - share * f64::from(self.done));
        let hint = self.hints.map(|(acceleration, speed2)| ArcHint {
            radius_mm: if self.done == 1 { 0.0 } else { self.arc.radius_mm() },
            safe_exit_mm_per_s: if self.done == self.count {
                0.0
            } else {
                speed2.min(2.0 * acceleration * left_mm).max(0.0).sqrt()
            },
        });
        Some(Chord { displacement_mm: [end_mm[0] - from_x, end_mm[1] - from_y, z * share, e * share], hint })
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        let left = (self.count - self.done) as usize;
        (left, Some(left))
    }
}

impl ExactSizeIterator for Chords {}
