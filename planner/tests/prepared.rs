//! Moves that bring their speeds: followed exactly where nothing has changed, and within all
//! limits whatever has.
#![allow(clippy::unwrap_used)]

use ferrostep_planner::look_ahead::{EntrySpeed, PlanFault, Slot};
use ferrostep_planner::{
    AxisShaper, Coordinate, Geometry, Kinematics, Limits, MotionChoice, Move, MoveError, Moved, PlannedBlock, Planner,
    Prepared, PreparedMove, Recorded, Recorder, Retuned, ShaperKind, SquaredSpeed, StepsPerMm,
};
use proptest::prelude::*;

/// A planner with this much room, whose path keeps this tolerance after its filters, mm.
fn tolerant(ring: usize, path_tolerance_mm: Option<f64>) -> Planner<Vec<Slot>> {
    let mut planner = planner(ring);
    if path_tolerance_mm.is_some() {
        let shapers = [50.0, 40.0].map(|frequency_hz| AxisShaper { kind: ShaperKind::Mzv, frequency_hz, damping: 0.1 });
        let choice = MotionChoice { shapers, smooth_time_s: Some(0.004), path_tolerance_mm, ..MotionChoice::DEFAULT };
        planner.set_motion_choice(&choice).unwrap();
    }
    planner
}

/// No tolerance, and tolerances that lower few accelerations or nearly all.
fn tolerance() -> impl Strategy<Value = Option<f64>> {
    prop_oneof![Just(None), Just(Some(0.1)), Just(Some(0.01))]
}

fn planner(ring: usize) -> Planner<Vec<Slot>> {
    let steps = |value| StepsPerMm::from_f64(value).unwrap();
    let geometry = Geometry {
        kinematics: Kinematics::Cartesian,
        steps_per_mm: [steps(80.0), steps(80.0), steps(400.0), steps(95.0)],
        minimum_event_interval_ticks: 168,
        event_cost_ticks: 210,
        move_cost_ticks: 10_500,
    };
    let limits = Limits {
        max_feed_mm_per_s: [200.0, 200.0, 10.0, 60.0],
        max_acceleration_mm_per_s2: [1500.0, 1500.0, 100.0, 5000.0],
        print_acceleration_mm_per_s2: 1000.0,
        travel_acceleration_mm_per_s2: 1000.0,
        retract_acceleration_mm_per_s2: 1500.0,
        junction_deviation_mm: 0.1,
        instantaneous_corner_velocity_mm_per_s: [f64::INFINITY; 4],
    };
    Planner::new(geometry, limits, vec![Slot::EMPTY; ring])
}

/// A wandering path of short and long moves, some straight on, a few up or down, with
/// filament or without.
fn path() -> impl Strategy<Value = Vec<Move>> {
    let height = prop_oneof![8 => Just(0i64), 1 => -30_000i64..30_000];
    let filament = prop_oneof![3 => Just(0i64), 3 => 0i64..100_000, 1 => -20_000_000i64..20_000_000];
    let step = (-3_000i64..3_000, -3_000i64..3_000, 1i64..60, any::<bool>(), 5f32..250.0, height, filament);
    proptest::collection::vec(step, 2..120).prop_map(|steps| {
        let mut target_10nm = [10_000_000; 3];
        let mut before = (1_000, 0, 80.0);
        (1..)
            .zip(steps)
            .map(|(line, (x, y, times, on, feed, z, filament_100pm))| {
                let (x, y, feed_mm_per_s) = if on { before } else { (x * times, y * times, feed) };
                before = (x, y, feed_mm_per_s);
                target_10nm[0] = (target_10nm[0] + x).clamp(0, 20_000_000);
                target_10nm[1] = (target_10nm[1] + y).clamp(0, 20_000_000);
                target_10nm[2] += z;
                Move { target_10nm, filament_100pm, feed_mm_per_s, line, ends_move: true }
            })
            .collect()
    })
}

/// A prepared move.
fn prepared_move(request: &Move, entry: EntrySpeed) -> PreparedMove {
    let Move { target_10nm, filament_100pm, feed_mm_per_s, line, ends_move } = *request;
    let target = target_10nm.map(|units| Coordinate::new(units.try_into().unwrap()).unwrap());
    PreparedMove { target, filament_100pm, feed_mm_per_s, line, ends_move, counts: true, entry }
}

/// The plan of a path with all look-ahead: its moves with their entries, and its blocks.
fn plan(path: &[Move], keeps: Option<f64>) -> (Vec<(PreparedMove, Option<Retuned>)>, Vec<PlannedBlock>) {
    let mut planner = tolerant(1_000, keeps);
    planner.set_position([10_000_000; 3]);
    let mut prepared = Vec::new();
    for request in path {
        let merged = planner.merged_moves();
        if planner.add(request) == Ok(Moved::Queued) {
            let entry = if planner.merged_moves() == merged { EntrySpeed::Bound } else { EntrySpeed::Continues };
            prepared.push((prepared_move(request, entry), None));
        }
    }
    planner.flush();
    let mut firsts = prepared.iter_mut().map(|(next, _)| next).filter(|next| next.entry != EntrySpeed::Continues);
    let (mut blocks, mut recorder) = (Vec::new(), Recorder::default());
    while let Some(Recorded::Block { planned, entry, .. }) = recorder.next(&mut planner) {
        firsts.next().unwrap().entry = EntrySpeed::Given(entry);
        blocks.push(planned);
    }
    assert!(firsts.next().is_none());
    (prepared, blocks)
}

/// Executes prepared moves with a ring of this size; the blocks, and why it ended early.
fn execute(
    prepared: &[(PreparedMove, Option<Retuned>)],
    ring: usize,
    keeps: Option<f64>,
) -> (Vec<PlannedBlock>, Option<MoveError>) {
    let mut planner = tolerant(ring, keeps);
    planner.set_position([10_000_000; 3]);
    let (mut blocks, mut refused) = (Vec::new(), None);
    'moves: for (next, now) in prepared {
        loop {
            match planner.add(&Prepared { planned: next, now: now.as_ref() }) {
                Ok(_) => break,
                Err(MoveError::NoRoom) => blocks.extend(planner.next_planned()),
                Err(error) => {
                    refused = Some(error);
                    break 'moves;
                }
            }
        }
    }
    planner.flush();
    while let Some(planned) = planner.next_planned() {
        blocks.push(planned);
    }
    (blocks, refused)
}

/// Checks that each block's speeds are within its acceleration and its feed, from
/// standstill to standstill.
fn keeps_limits(blocks: &[PlannedBlock]) -> Result<(), TestCaseError> {
    let mut speed = 0.0;
    for PlannedBlock { block, entry, exit } in blocks {
        prop_assert_eq!(entry.mm_per_s(), speed);
        let change = (exit.squared() - entry.squared()).abs();
        let most = 2.0 * block.acceleration.mm_per_s2() * block.length_mm();
        // Speeds are cut to 2^-16 mm/s.
        prop_assert!(
            change <= most + 1e-4 * (1.0 + entry.mm_per_s()),
            "{:?} {} {}",
            block,
            entry.mm_per_s(),
            exit.mm_per_s()
        );
        prop_assert!(*entry <= block.nominal && *exit <= block.nominal);
        prop_assert!(block.nominal.mm_per_s() <= 200.0 * 2f64.sqrt() * 1.001);
        speed = exit.mm_per_s();
    }
    prop_assert_eq!(speed, 0.0);
    Ok(())
}

proptest! {
    #[test]
    fn a_plan_is_followed(path in path(), keeps in tolerance()) {
        let (prepared, planned) = plan(&path, keeps);
        let (executed, refused) = execute(&prepared, 1_000, keeps);
        prop_assert_eq!(refused, None);
        prop_assert_eq!(executed, planned);
    }

    /// However small the ring: slower perhaps, but never beyond a limit, and always able to stop.
    #[test]
    fn a_small_ring_can_always_stop(path in path(), ring in 2usize..12, cut in any::<prop::sample::Index>(), keeps in tolerance()) {
        let (prepared, _) = plan(&path, keeps);
        let (executed, refused) = execute(&prepared[..cut.index(prepared.len() + 1)], ring, keeps);
        prop_assert_eq!(refused, None);
        keeps_limits(&executed)?;
    }

    /// M220 on the way, up or down.
    #[test]
    fn the_feed_may_change(path in path(), ring in 2usize..40, factors in [0.1f32..4.0, 0.1f32..4.0], at in any::<prop::sample::Index>(), keeps in tolerance()) {
        let (mut prepared, _) = plan(&path, keeps);
        let at = at.index(prepared.len());
        for (index, (next, now)) in prepared.iter_mut().enumerate() {
            let feed_mm_per_s = Some(next.feed_mm_per_s * factors[usize::from(index >= at)]);
            *now = Some(Retuned { filament_100pm: next.filament_100pm, feed_mm_per_s });
        }
        let (executed, refused) = execute(&prepared, ring, keeps);
        prop_assert_eq!(refused, None);
        keeps_limits(&executed)?;
    }

    /// Any plan at all: refused, or within all limits up to where it is.
    #[test]
    fn a_hostile_plan_breaks_no_limit(
        path in path(), entries in proptest::collection::vec(
            prop_oneof![
                4 => Just(None), 2 => Just(Some(EntrySpeed::Bound)), 1 => Just(Some(EntrySpeed::Continues)), 1 => Just(Some(EntrySpeed::Falling)),
                1 => (0u64..1 << 40).prop_map(|units| Some(EntrySpeed::Given(SquaredSpeed::from_units(units)))),
            ], 1..120),
        ring in 2usize..40,
        keeps in tolerance(),
    ) {
        let (mut prepared, _) = plan(&path, keeps);
        for ((next, _), entry) in prepared.iter_mut().zip(entries) {
            next.entry = entry.unwrap_or(next.entry);
        }
        let (executed, refused) = execute(&prepared, ring, keeps);
        if let Some(refused) = refused {
            prop_assert!(matches!(refused, MoveError::Plan(_)), "{:?}", refused);
        }
        keeps_limits(&executed)?;
    }
}

#[test]
fn after_a_violation_nothing_is_taken_until_the_place_is_known() {
    let mut planner = planner(16);
    let at = |x: i64, entry| {
        let target_10nm = [x, 0, 0];
        prepared_move(&Move { target_10nm, filament_100pm: 0, feed_mm_per_s: 50.0, line: 1, ends_move: true }, entry)
    };
    planner.add(&Prepared { planned: &at(1_000_000, EntrySpeed::Bound), now: None }).unwrap();
    planner
        .add(&Prepared { planned: &at(2_000_000, EntrySpeed::Given(SquaredSpeed::from_units(u64::MAX))), now: None })
        .unwrap();
    let refused = planner.add(&Prepared { planned: &at(3_000_000, EntrySpeed::Bound), now: None });
    assert!(matches!(refused, Err(MoveError::Plan(PlanFault::TooFast { .. }))), "{refused:?}");
    assert_eq!(planner.add(&Prepared { planned: &at(3_000_000, EntrySpeed::Bound), now: None }), refused);
    let mut blocks = 0;
    while planner.next_planned().is_some() {
        blocks += 1;
    }
    assert_eq!(blocks, 1);
    planner.reset_to([800, 0, 0, 0], 1_000, 0);
    assert_eq!(planner.add(&Prepared { planned: &at(2_000_000, EntrySpeed::Bound), now: None }), Ok(Moved::Queued));
}
