#![allow(clippy::unwrap_used)]
use super::*;
use proptest::prelude::*;

/// Wu 2024 eq. 3, literally and in 64 bits: yields for each step of the major axis whether the
/// minor one steps, and counts the decisions.
fn classic(dx: i64, dy: i64) -> impl Iterator<Item = bool> {
    let mut decision = 2 * dy - dx;
    (0..dx).map(move |_| {
        let steps = decision > 0;
        decision += if steps { 2 * (dy - dx) } else { 2 * dy };
        steps
    })
}

/// Steps of the minor axis, computed stair by stair.
fn by_stairs<W: Widths>(slope: Slope) -> impl Iterator<Item = bool> {
    let usual = slope.is_steep();
    Stairs::<W>::new(slope).flat_map(move |stair| {
        let Stair { width, is_whole } = stair;
        assert!(width > 0);
        (1..=width).map(move |step| usual ^ (is_whole && step == width))
    })
}

fn assert_classic_points<W: Widths>(dx: u32, dy: u32) {
    let stairs = by_stairs::<W>(Slope::new(dx, dy).unwrap());
    assert!(stairs.eq(classic(dx.into(), dy.into())), "{dx} {dy} {}", core::any::type_name::<W>());
}

/// Checks every rule, and this crate's classic Bresenham, against the formula.
fn assert_all_agree(dx: u32, dy: u32) {
    assert_classic_points::<FromFirstStair>(dx, dy);
    assert_classic_points::<FromQuotient>(dx, dy);
    assert_classic_points::<FromDivision>(dx, dy);
    let mut line = StepBresenham::new(dx, dy).unwrap();
    assert!((0..dx).map(|_| line.pass(1)).eq(classic(dx.into(), dy.into())), "{dx} {dy}");
    let mut state = Classic::<Uncounted>::new(Slope::new(dx, dy).unwrap());
    assert!((0..dx).map(|_| state.pass(1)).eq(classic(dx.into(), dy.into())), "{dx} {dy}");
}

#[test]
fn every_small_slope_has_classic_bresenhams_points() {
    for dx in 0..=300 {
        for dy in 0..=dx {
            assert_all_agree(dx, dy);
        }
    }
}

/// Points of a line, computed from its stairs.
fn points_by_stairs<W: Widths, const AXES: usize>(line: &Line<AXES>) -> Vec<[i32; AXES]> {
    let mut at = [0; AXES];
    let mut points = Vec::new();
    for LineStair { count, axes, differing } in line.stairs::<W>() {
        for event in 1..=count {
            let axes = if event == count { axes ^ differing } else { axes };
            for (axis, at) in at.iter_mut().enumerate() {
                *at += i32::from(axes >> axis & 1) * if line.directions() >> axis & 1 == 0 { 1 } else { -1 };
            }
            points.push(at);
        }
    }
    points
}

/// Computes the point nearest to the ideal line at each step of the longest axis, with ties going
/// to the start's side: the result of classic Bresenham, without any decision value.
fn nearest_points<const AXES: usize>(displacement: [i64; AXES]) -> Vec<[i32; AXES]> {
    let longest = displacement.iter().map(|d| d.abs()).max().unwrap();
    (1..=longest)
        .map(|step| displacement.map(|d| ((2 * step * d.abs() + longest - 1) / (2 * longest) * d.signum()) as i32))
        .collect()
}

#[test]
fn every_small_line_in_every_octant_has_the_nearest_points() {
    for dx in -300i64..=300 {
        for dy in -300i64..=300 {
            let line = Line::new([dx, dy]).unwrap();
            // Iterators, not lists: these are 10^8 points.
            let mut points = line.points::<Uncounted>();
            let (mut at, mut step) = ([0; 2], 0);
            let longest = dx.abs().max(dy.abs());
            for LineStair { count, axes, differing } in line.stairs::<FromQuotient>() {
                for event in 1..=count {
                    let axes = if event == count { axes ^ differing } else { axes };
                    step += 1;
                    for (axis, d) in [dx, dy].into_iter().enumerate() {
                        at[axis] += i64::from(axes >> axis & 1) * if d < 0 { -1 } else { 1 };
                        // |2 longest at - 2 step d| <= longest; at a tie nearer to the start.
                        let beyond = 2 * (longest * at[axis] - step * d) * d.signum();
                        assert!(-longest <= beyond && beyond < longest.max(1), "{dx} {dy}");
                    }
                    assert_eq!(points.next().map(|point| point.map(i64::from)), Some(at), "{dx} {dy}");
                }
            }
            assert!(step == longest && at == [dx, dy] && points.next().is_none(), "{dx} {dy}");
            assert!(line.stairs::<FromFirstStair>().eq(line.stairs::<FromQuotient>()), "{dx} {dy}");
            assert!(line.stairs::<FromDivision>().eq(line.stairs::<FromQuotient>()), "{dx} {dy}");
        }
    }
}

#[test]
fn the_first_stair_tells_the_others_widths() {
    for dx in 1..=300u32 {
        for dy in 1..=dx {
            let slope = Slope::new(dx, dy).unwrap();
            let mut whole = Stairs::<FromQuotient>::new(slope).filter(|stair| stair.is_whole).map(|stair| stair.width);
            let Some(n) = whole.next() else { continue };
            let quotient = dx / dy.min(dx - dy);
            for width in whole {
                assert!((2 * n - 2..=2 * n).contains(&width), "corollary 2: {dx} {dy}");
                assert!((quotient..=quotient + 1).contains(&width), "corollary 1: {dx} {dy}");
            }
        }
    }
}

/// Number of decisions when a line is walked by stairs with rule `W`.
fn decisions<W: Widths>(slope: Slope) -> u64 {
    let mut stairs = Stairs::<W>::new(slope);
    stairs.by_ref().for_each(drop);
    stairs.decisions()
}

#[test]
fn decisions_are_what_the_corollaries_promise() {
    for dx in 0..=200u32 {
        for dy in 0..=dx {
            let slope = Slope::new(dx, dy).unwrap();
            let (whole, mut stairs) = (u64::from(dy.min(dx - dy)), Stairs::<FromQuotient>::new(slope));
            assert_eq!(decisions::<FromQuotient<Counted>>(slope), whole, "one a stair: {dx} {dy}");
            let first = stairs.next().map_or(0, |stair| u64::from(stair.width));
            let counted = decisions::<FromFirstStair<Counted>>(slope);
            if whole > 0 {
                let others = counted - first;
                assert!((whole - 1..=2 * (whole - 1)).contains(&others), "one or two a stair: {dx} {dy}");
            } else {
                assert_eq!(counted, 0);
            }
            let mut classic = Classic::<Counted>::new(slope);
            classic.pass(dx);
            assert_eq!(classic.decisions(), u64::from(dx));
            let entries = Stairs::<FromQuotient>::new(slope).count() as u64;
            assert!((whole..=whole + 1).contains(&entries), "{dx} {dy}");
        }
    }
}

#[test]
fn wus_lines_cost_what_the_book_says() {
    let counts = |dx, dy| {
        let slope = Slope::new(dx, dy).unwrap();
        [u64::from(dx), decisions::<FromFirstStair<Counted>>(slope), decisions::<FromQuotient<Counted>>(slope)]
    };
    assert_eq!(counts(30, 10), [30, 20, 10]);
    assert_eq!(counts(100, 10), [100, 15, 10]);
    assert_eq!(counts(500, 10), [500, 35, 10]);
    assert_eq!(counts(1000, 10), [1000, 60, 10]);
    assert_eq!(counts(30, 30), [30, 0, 0]);
}

#[test]
fn lines_out_of_range_are_refused() {
    assert_eq!(Slope::new(3, 4), Err(LineError::TooSteep));
    assert_eq!(Slope::new(MAX_STEPS + 1, 1), Err(LineError::TooLong));
    assert_eq!(Slope::new(u32::MAX, u32::MAX), Err(LineError::TooLong));
    assert_eq!(Slope::new(0, u32::MAX), Err(LineError::TooLong));
    assert!(StepBresenham::new(3, 4).is_none());
    let longest = i64::from(MAX_STEPS);
    for far in [longest + 1, -longest - 1, 1 << 31, -(1 << 31), (1 << 32) + 1, i64::MAX, i64::MIN] {
        assert_eq!(Line::new([far, 0]), Err(LineError::TooLong));
        assert_eq!(Line::new([0, 1, far]), Err(LineError::TooLong));
    }
    assert_eq!(Line::between([i64::MIN], [i64::MAX]), Err(LineError::TooLong));
    assert_eq!(Line::between([i64::MAX - 3, 0], [i64::MAX, 2]), Line::new([3, 2]));
}

#[test]
fn lines_without_steps_have_no_points() {
    let line = Line::new([0, 0, 0]).unwrap();
    assert_eq!(line.stairs::<FromQuotient>().next(), None);
    assert_eq!(line.stairs::<FromFirstStair>().next(), None);
    assert_eq!(line.points::<Uncounted>().next(), None);
    assert_eq!(Stairs::<FromFirstStair>::new(Slope::new(0, 0).unwrap()).next(), None);
    assert!(!Classic::<Uncounted>::new(Slope::new(0, 0).unwrap()).pass(1));
}

#[test]
fn the_longest_lines_end_where_they_should() {
    for dy in [0, 1, 2, MAX_STEPS / 2, MAX_STEPS / 2 + 1, MAX_STEPS - 1, MAX_STEPS] {
        let slope = Slope::new(MAX_STEPS, dy).unwrap();
        fn steps<W: Widths>(slope: Slope) -> (u64, u32) {
            // Counts only the first million stairs: some lines have 2^27.
            let stairs = Stairs::<W>::new(slope).take(1_000_000);
            stairs.fold((0, 0), |(steps, whole), stair| {
                (steps + u64::from(stair.width), whole + u32::from(stair.is_whole))
            })
        }
        let counts = steps::<FromQuotient>(slope);
        assert_eq!(steps::<FromFirstStair>(slope), counts);
        assert_eq!(steps::<FromDivision>(slope), counts);
        let rarer = dy.min(MAX_STEPS - dy);
        if rarer < 1_000_000 {
            assert_eq!(counts, (MAX_STEPS.into(), rarer));
        }
    }
}

/// Lines of log-uniform length up to 2^`bits` steps.
fn slopes(bits: u32) -> impl Strategy<Value = (u32, u32)> {
    (0.0..f64::from(bits), prop_oneof![0.0f64..=1.0, (0.0f64..20.0).prop_map(|bits| (-bits).exp2())]).prop_map(
        |(bits, share)| {
            let dx = bits.exp2() as u32;
            (dx, (f64::from(dx) * share) as u32)
        },
    )
}

proptest! {
    #![proptest_config(ferrostep_random_cases::cases(16))]

    #[test]
    fn the_longest_random_lines_have_classic_bresenhams_points((dx, dy) in slopes(24)) {
        assert_all_agree(dx, dy);
    }
}

proptest! {
    #[test]
    fn long_lines_have_classic_bresenhams_points((dx, dy) in slopes(16)) {
        assert_all_agree(dx, dy);
    }

    #[test]
    fn the_same_for_lines_of_three_axes(x in -3000i64..3000, y in -3000i64..3000, z in -300i64..300) {
        let line = Line::new([x, y, z]).unwrap();
        let nearest = nearest_points([x, y, z]);
        prop_assert_eq!(&line.points::<Uncounted>().collect::<Vec<_>>(), &nearest);
        prop_assert_eq!(&points_by_stairs::<FromQuotient, 3>(&line), &nearest);
        prop_assert_eq!(&points_by_stairs::<FromFirstStair, 3>(&line), &nearest);
        let displacement = [x, y, z].map(i64::unsigned_abs);
        let longest = displacement.into_iter().max().unwrap();
        let most: u64 = displacement.into_iter().map(|steps| steps.min(longest - steps)).sum();
        prop_assert!(line.stairs::<FromQuotient>().count() as u64 <= most + 1);
    }

    #[test]
    fn any_way_to_pass_gives_the_same_points(
        dx in 1u32..5_000, share in 0.0f64..=1.0, parts in proptest::collection::vec(1u32..50, 1..200),
    ) {
        let dy = (f64::from(dx) * share) as u32;
        let mut at_once = StepBresenham::new(dx, dy).unwrap();
        let mut singly = at_once;
        let mut left = dx;
        for part in parts {
            let count = part.min(at_once.width()).min(left);
            let steps = (0..count).filter(|_| singly.pass(1)).count();
            prop_assert_eq!(usize::from(at_once.pass(count)), steps);
            left -= count;
        }
    }

    #[test]
    fn diagonals_are_the_same_points(dx in 1u32..5_000, share in 0.0f64..=1.0) {
        let dy = (f64::from(dx) * share) as u32;
        let mut line = StepBresenham::new(dx, dy).unwrap();
        let mut singly = line;
        let mut left = dx;
        while left > 0 {
            let diagonal = line.diagonal().min(left);
            line.pass_diagonal(diagonal);
            prop_assert!((0..diagonal).all(|_| singly.pass(1)));
            left -= diagonal;
            if left > 0 {
                prop_assert!(!singly.pass(1) && !line.pass(1));
                left -= 1;
            }
        }
    }
}
