//! Corner speeds by Marlin's rules. Speeds are in mm/s, results in (mm/s)^2.

use super::settings::{Corner, JerkRule, MarlinSettings};
use crate::motion::{Axis, Limit};

/// Move whose corner has not been computed yet.
#[derive(Clone, Copy, Debug)]
pub(super) struct Segment {
    pub length_mm: f64,
    /// Displacement of each axis (on CoreXY, of each motor) per unit of length.
    pub shares: [f64; 4],
    /// True if the direction is normalised with the filament included.
    pub is_printing_or_core: bool,
    pub nominal: f64,
    pub acceleration: f64,
    /// Squared speed below which the move is not planned.
    pub slowest: f64,
    /// Radius of the arc on which the corner lies, mm; 0 if on none.
    pub arc_radius_mm: f64,
    pub speed_limit: Limit,
    pub acceleration_limit: Limit,
}

impl Segment {
    /// Returns the direction that junction deviation compares.
    fn direction(&self) -> [f64; 4] {
        if self.is_printing_or_core { unit(self.shares) } else { self.shares }
    }

    /// Returns the speed of each axis at the move's nominal speed.
    fn speeds(&self) -> [f64; 4] {
        self.shares.map(|share| share * self.nominal)
    }
}

/// Data of a move that the corner after it needs.
#[derive(Clone, Copy, Debug)]
struct Before {
    direction: [f64; 4],
    speeds: [f64; 4],
    nominal: f64,
    safe: f64,
}

/// State of the corners in a stream of moves.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Corners {
    before: Option<Before>,
}

fn unit(vector: [f64; 4]) -> [f64; 4] {
    let length = vector.iter().map(|part| part * part).sum::<f64>().sqrt();
    vector.map(|part| part / length)
}

impl Corners {
    /// Forgets the previous move: motion comes to rest.
    pub fn rest(&mut self) {
        self.before = None;
    }

    /// Returns the maximum squared speed at which a move may begin after the previous one, and its
    /// limit.
    pub fn enter(&mut self, segment: &Segment, settings: &MarlinSettings) -> (f64, Limit) {
        let jerk = match settings.corner {
            Corner::ClassicJerk { jerk_mm_per_s, .. } => Some(jerk_mm_per_s),
            Corner::JunctionDeviation { .. } => None,
        };
        let safe = jerk.map_or(0.0, |jerk| safe_speed(segment, &jerk));
        let entry = self.before.map_or((segment.slowest, Limit::Rest), |before| match settings.corner {
            Corner::JunctionDeviation { deviation_mm, handles_small_segments } => {
                by_deviation(segment, &before, settings, deviation_mm, handles_small_segments)
            }
            Corner::ClassicJerk { jerk_mm_per_s, rule: JerkRule::SafeSpeed } => {
                by_safe_speed(segment, &before, &jerk_mm_per_s, safe)
            }
            Corner::ClassicJerk { jerk_mm_per_s, rule: JerkRule::Difference } => {
                by_difference(segment, &before, &jerk_mm_per_s)
            }
        });
        self.before =
            Some(Before { direction: segment.direction(), speeds: segment.speeds(), nominal: segment.nominal, safe });
        (entry.0.max(segment.slowest), entry.1)
    }
}

/// Limits the corner's squared speed to that of the slower of its moves.
fn at_most_nominal(corner: (f64, Limit), segment: &Segment, before: &Before) -> (f64, Limit) {
    let nominal = segment.nominal.min(before.nominal);
    if corner.0 < nominal * nominal { corner } else { (nominal * nominal, segment.speed_limit) }
}

/// Cosine of the corner's angle above which the motion reverses.
const REVERSAL: f64 = 0.999_999;
/// Maximum length of chords that may stand for an arc, mm.
const SMALL_MM: f64 = 1.0;
/// Cosine of 135 degrees, the corner of an octagon.
const OCTAGON: f64 = -std::f64::consts::FRAC_1_SQRT_2;

/// Returns the corner's squared speed by junction deviation, from the circle that touches both
/// moves.
fn by_deviation(
    segment: &Segment,
    before: &Before,
    settings: &MarlinSettings,
    deviation_mm: f64,
    handles_small_segments: bool,
) -> (f64, Limit) {
    let direction = segment.direction();
    let cosine = -direction.iter().zip(before.direction).map(|(one, other)| one * other).sum::<f64>();
    if cosine > REVERSAL {
        return at_most_nominal((segment.slowest, Limit::Corner), segment, before);
    }
    let mut turn = direction;
    turn.iter_mut().zip(before.direction).for_each(|(part, before)| *part -= before);
    let acceleration = along(segment.acceleration, unit(turn), settings);
    if segment.arc_radius_mm > 0.0 {
        return at_most_nominal((acceleration * segment.arc_radius_mm, Limit::Corner), segment, before);
    }
    let cosine = cosine.max(-REVERSAL);
    let half_sine = (0.5 * (1.0 - cosine)).sqrt();
    let mut speed = acceleration * deviation_mm * half_sine / (1.0 - half_sine);
    if handles_small_segments && segment.length_mm < SMALL_MM && cosine < OCTAGON {
        speed = speed.min(segment.length_mm * acceleration / turn_angle(-cosine));
    }
    at_most_nominal((speed, Limit::Corner), segment, before)
}

/// Returns the acceleration along a direction at which no axis exceeds its own maximum.
fn along(acceleration: f64, direction: [f64; 4], settings: &MarlinSettings) -> f64 {
    // When going straight on, the turn has no direction.
    if direction.iter().any(|part| !part.is_finite()) {
        return acceleration;
    }
    let axes = direction.into_iter().zip(settings.max_acceleration_mm_per_s2);
    axes.fold(acceleration, |least, (part, max)| if least * part.abs() > max { max / part.abs() } else { least })
}

/// Returns the angle between two chords from its cosine (0.707 to 1), with the error of Marlin's
/// formula: it is never below 0.033, which bounds the speed on fine arcs.
///
/// Marlin uses W. Randolph Franklin's polynomial for the arcsine (wrfranklin.org, *Elementary
/// functions*); these are its coefficients.
fn turn_angle(cosine: f64) -> f64 {
    const ARCSINE: [f64; 7] =
        [0.032_843_707, -1.451_838_349, 29.661_539_56, -131.112_347_7, 262.813_056_2, -242.719_962_7, 84.314_662_02];
    std::f64::consts::FRAC_PI_2 - ARCSINE.iter().rev().fold(0.0, |sum, factor| sum * cosine + factor)
}

/// Returns the speed from which each axis may stop at once.
fn safe_speed(segment: &Segment, jerk: &[f64; 4]) -> f64 {
    let axes = segment.shares.iter().zip(jerk);
    axes.fold(
        segment.nominal,
        |speed, (share, jerk)| if share.abs() * speed > *jerk { jerk / share.abs() } else { speed },
    )
}

/// Returns the limit that a jump of an axis's speed reports.
fn jump_of(axis: Axis) -> Limit {
    if axis == Axis::E { Limit::FilamentCorner } else { Limit::Corner }
}

/// Returns the corner's squared speed by the classic jerk of Marlin 1.1 to 2.1.2.
fn by_safe_speed(segment: &Segment, before: &Before, jerk: &[f64; 4], safe: f64) -> (f64, Limit) {
    let nominal = segment.nominal.min(before.nominal);
    let exit_scale = nominal / before.nominal;
    let (mut factor, mut limit) = (1.0, None);
    // The speed is lowered axis by axis: a reduction for one axis counts for the next. The entry
    // speed is the move's own, which may be above the corner's.
    for (axis, jerk) in Axis::ALL.into_iter().zip(jerk) {
        let exit = before.speeds[axis as usize] * exit_scale * factor;
        let entry = segment.shares[axis as usize] * segment.nominal * factor;
        let (high, low) = if exit > entry { (exit, entry) } else { (entry, exit) };
        let jump = if low > 0.0 || high < 0.0 { high - low } else { high.max(-low) };
        if jump > *jerk {
            factor *= jerk / jump;
            limit = Some(jump_of(axis));
        }
    }
    let speed = nominal * factor;
    let nearly = 0.99 * speed;
    if before.safe > nearly && safe > nearly {
        let limit = if safe < segment.nominal { Limit::Corner } else { segment.speed_limit };
        return (safe.min(nominal).powi(2), limit);
    }
    (speed * speed, limit.unwrap_or(segment.speed_limit))
}

/// Returns the corner's squared speed by the classic jerk of Marlin's bugfix branch of 2026: the
/// speeds of an axis before and after the corner differ by at most its jerk.
fn by_difference(segment: &Segment, before: &Before, jerk: &[f64; 4]) -> (f64, Limit) {
    let nominal = segment.nominal.min(before.nominal);
    let (mut factor, mut limit) = (1.0, segment.speed_limit);
    for (axis, jerk) in Axis::ALL.into_iter().zip(jerk) {
        let before_share = before.speeds[axis as usize] / before.nominal;
        let jump = (segment.shares[axis as usize] - before_share).abs() * nominal;
        if jump * factor > *jerk {
            factor = jerk / jump;
            limit = jump_of(axis);
        }
    }
    ((nominal * factor).powi(2), limit)
}
