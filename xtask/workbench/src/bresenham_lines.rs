//! Compares step Bresenham with classic Bresenham on random lines, for any number of points.
//!
//! `cargo xtask bresenham-lines [POINTS [SEED]]`, 10^9 points by default. Lines have two or three
//! axes, any direction, and lengths spread evenly over the powers of two up to 2^24 steps.

use ferrostep_papers::bresenham::{
    Classic, FromDivision, FromFirstStair, FromQuotient, Line, LineStair, Slope, Stairs, Uncounted, Widths,
};
use indicatif::{ProgressBar, ProgressStyle};

use crate::steps::Failure;

/// Length of the longest lines, as a power of two.
const LONGEST_BITS: f64 = 24.0;

/// Arguments of `bresenham-lines`.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct Options {
    /// Number of points
    #[arg(default_value_t = 1_000_000_000)]
    points: u64,
    /// Seed of the random lines
    #[arg(default_value_t = 2024)]
    seed: u64,
}

/// Compares all points.
///
/// # Errors
/// A line is refused.
///
/// # Panics
/// A point differs.
pub fn run(options: &Options) -> Result<(), Failure> {
    let Options { points, seed } = *options;
    let mut random = Random(seed);
    let bar = ProgressBar::new(points);
    let style = ProgressStyle::with_template("{bar:40} {human_pos}/{human_len} points {elapsed} of {duration}")
        .map_err(|error| error.to_string())?;
    bar.set_style(style);
    let (mut lines, mut done) = (0u64, 0);
    while done < points {
        let longest = random.number(LONGEST_BITS).exp2();
        // Some lines are flat or steep, whatever their length.
        let mut displacement = [longest as i64, 0, 0];
        for axis in &mut displacement[1..] {
            let share = random.number(1.0);
            let share = if random.number(1.0) < 0.5 { share } else { share.powi(8) };
            *axis = (longest * if random.number(1.0) < 0.5 { share } else { 1.0 - share }) as i64;
        }
        let rotate = random.number(3.0) as usize % 3;
        displacement.rotate_right(rotate);
        let signs = random.number(8.0) as u32;
        for (axis, displacement) in displacement.iter_mut().enumerate() {
            *displacement *= if signs >> axis & 1 == 0 { 1 } else { -1 };
        }
        check_line(displacement)?;
        let [major, minor] =
            [displacement[rotate], displacement[(rotate + 1) % 3]].map(|steps| steps.unsigned_abs() as u32);
        check_slope(Slope::new(major, minor).map_err(|error| format!("{major}, {minor}: {error:?}"))?);
        done += u64::from(major);
        lines += 1;
        bar.set_position(done.min(points));
    }
    bar.finish_and_clear();
    println!("{done} points of {lines} lines: three rules, two and three axes, all points classic Bresenham's");
    Ok(())
}

/// Two axes: each rule's stairs against decisions step by step.
fn check_slope(slope: Slope) {
    fn check<W: Widths>(slope: Slope) {
        let mut classic = Classic::<Uncounted>::new(slope);
        let usual = slope.is_steep();
        let mut steps = 0;
        for stair in Stairs::<W>::new(slope) {
            for step in 1..=stair.width {
                let expected = usual ^ (stair.is_whole && step == stair.width);
                assert_eq!(classic.pass(1), expected, "{slope:?} {}", std::any::type_name::<W>());
            }
            steps += stair.width;
        }
        assert_eq!(steps, slope.major(), "{slope:?}");
    }
    check::<FromFirstStair>(slope);
    check::<FromQuotient>(slope);
    check::<FromDivision>(slope);
}

/// Three axes: stairs against points.
fn check_line(displacement: [i64; 3]) -> Result<(), Failure> {
    let line = Line::new(displacement).map_err(|error| format!("{displacement:?}: {error:?}"))?;
    let mut points = line.points::<Uncounted>();
    for LineStair { count, axes, differing } in line.stairs::<FromQuotient>() {
        for event in 1..=count {
            let expected = if event == count { axes ^ differing } else { axes };
            assert_eq!(points.next_axes(), Some(expected), "{displacement:?}");
        }
    }
    assert_eq!(points.next_axes(), None, "{displacement:?}");
    assert!(line.stairs::<FromFirstStair>().eq(line.stairs::<FromQuotient>()), "{displacement:?}");
    assert!(line.stairs::<FromDivision>().eq(line.stairs::<FromQuotient>()), "{displacement:?}");
    Ok(())
}

/// Random numbers (SplitMix64), the same for a seed everywhere.
struct Random(u64);

impl Random {
    /// Evenly from 0 to below the limit.
    fn number(&mut self, limit: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((mixed ^ mixed >> 31) >> 11) as f64 / (1u64 << 53) as f64 * limit
    }
}
