#![allow(clippy::unwrap_used)]

use super::end_stop::Side;
use super::*;
use proptest::prelude::*;

fn config(kinematics: Kinematics) -> Config {
    let axis =
        AxisConfig { minimum_mm: 0.0, maximum_mm: 100.0, frame_below_mm: 2.0, frame_above_mm: 1.0, start_mm: 50.0 };
    let motor = |full_steps_per_mm, inverted| MotorConfig { full_steps_per_mm, inverted };
    Config {
        kinematics,
        axes: [axis.clone(), axis.clone(), axis],
        motors: vec![motor(5.0, false), motor(5.0, true), motor(25.0, false), motor(20.0, true)],
        lift: None,
        end_stops: vec![EndStopConfig {
            axis: 0,
            side: Side::Low,
            at_mm: 0.0,
            hysteresis_mm: 0.1,
            bounce_ns: 1_000_000,
            high_when_triggered: true,
            seed: 1,
        }],
        sheet: SheetConfig {
            x_mm: (0.0, 100.0),
            y_mm: (0.0, 100.0),
            height_mm: 0.0,
            tilt: (0.0, 0.0),
            allowed_press_mm: 0.1,
        },
        probe: Some(ProbeConfig {
            offset_mm: (-10.0, 0.0),
            trigger_mm: 1.0,
            hysteresis_mm: 0.05,
            noise_mm: 0.0,
            high_when_triggered: false,
            seed: 2,
        }),
    }
}

fn powered(kinematics: Kinematics) -> Motion {
    let mut motion = Motion::new(config(kinematics)).unwrap();
    for motor in 0..4 {
        motion.set_energized(0, motor, true, 0);
    }
    motion
}

fn steps(motion: &mut Motion, now_ns: u64, motor: usize, delta_256: i32, count: u32) {
    for _ in 0..count {
        motion.step(now_ns, motor, delta_256);
    }
}

#[test]
fn cartesian_axes_move_by_their_own_motors() {
    let mut motion = powered(Kinematics::Cartesian);
    // A millimetre of X is 5 full steps of 256.
    steps(&mut motion, 0, 0, 16, 80);
    steps(&mut motion, 0, 1, 16, 80);
    steps(&mut motion, 0, 2, 256, 50);
    steps(&mut motion, 0, 3, -256, 200);
    let places = [0, 1, 2].map(|axis| motion.position_mm(axis));
    assert_eq!((places, motion.motor_mm(3)), ([51.0, 49.0, 52.0], 10.0));
}

#[test]
fn core_xy_moves_by_sum_and_difference() {
    let mut motion = powered(Kinematics::CoreXy);
    // A + 10 mm (and B, inverted, left alone): 5 mm in X and in Y.
    steps(&mut motion, 0, 0, 16, 800);
    assert_eq!([0, 1].map(|axis| motion.position_mm(axis)), [55.0, 55.0]);
    steps(&mut motion, 0, 1, -16, 800);
    assert_eq!([0, 1].map(|axis| motion.position_mm(axis)), [60.0, 50.0]);
}

#[test]
fn a_motor_at_the_frame_slips_by_whole_periods() {
    let mut motion = powered(Kinematics::Cartesian);
    let to_frame = 52 * 5 * 16;
    (0..to_frame).for_each(|_| assert!(!motion.step(0, 0, -16).loads));
    assert_eq!((motion.position_mm(0), motion.load(0)), (-2.0, 0.0));
    assert!(motion.step(0, 0, -16).loads);
    assert_eq!((motion.position_mm(0), motion.load(0)), (-2.0, 1.0));
    let mut furthest_mm: f64 = -2.0;
    for _ in 1..64 * 10 {
        motion.step(0, 0, -16);
        furthest_mm = furthest_mm.max(motion.position_mm(0));
        assert_eq!(motion.load(0), 1.0);
    }
    // Within two full steps of the frame; ten whole periods lost.
    assert!(furthest_mm <= -2.0 + 0.4, "{furthest_mm}");
    assert_eq!((motion.record(0).slipped_periods, motion.record(0).lost_256), (10, -10 * 1024));
    assert_eq!(motion.position_mm(0), -2.0);
    // The return begins at the field's position, not at the frame's.
    assert_eq!((0..40).filter(|_| motion.step(0, 0, 16).loads).count(), 1);
    assert_eq!((motion.load(0), motion.position_mm(0)), (0.0, -1.5));
}

#[test]
fn core_xy_a_stall_slips_both_motors_and_leaves_the_other_axis() {
    let mut motion = powered(Kinematics::CoreXy);
    let mut leant = false;
    for _ in 0..(60 * 5 * 16) {
        motion.step(0, 0, 16);
        motion.step(0, 1, -16);
        leant |= motion.load(0) == 1.0;
        assert_eq!(motion.load(0) == 1.0, leant);
    }
    assert!(motion.record(0).slipped_periods > 5);
    assert_eq!(motion.record(0), motion.record(1));
    assert_eq!((motion.position_mm(1), motion.load(0), motion.load(1)), (50.0, 1.0, 1.0));
    assert!(motion.position_mm(0) > 100.5 && motion.position_mm(0) <= 101.0);
}

#[test]
fn core_xy_a_stall_along_y_slips_a_and_b_apart() {
    let mut motion = powered(Kinematics::CoreXy);
    let mut leant = false;
    for _ in 0..(60 * 5 * 16) {
        motion.step(0, 0, 16);
        motion.step(0, 1, 16);
        leant |= motion.load(0) == 1.0;
        assert_eq!(motion.load(1) == 1.0, leant);
    }
    let (a, b) = (motion.record(0), motion.record(1));
    assert!(leant && a.slipped_periods > 5 && a.lost_256 == -b.lost_256 && a.lost_256 > 0);
    assert_eq!((motion.position_mm(0), b.slipped_periods), (50.0, a.slipped_periods));
}

#[test]
fn a_rotor_rests_where_it_is_when_the_current_ends() {
    for kinematics in [Kinematics::Cartesian, Kinematics::CoreXy] {
        let mut motion = powered(kinematics);
        // To the frame at 101 mm in Y and 10 steps into it, without a slip.
        for _ in 0..51 * 80 + 10 {
            if kinematics == Kinematics::CoreXy {
                motion.step(0, 0, 16);
                motion.step(0, 1, 16);
            } else {
                motion.step(0, 1, -16);
            }
        }
        assert_eq!((motion.position_mm(1), motion.record(1).slipped_periods), (101.0, 0));
        let field_256 = motion.field_256(1);
        motion.set_energized(0, 0, false, 0);
        motion.set_energized(0, 1, false, 0);
        assert_eq!((motion.position_mm(1), motion.axes[1].lead, motion.axes[0].lead), (101.0, 0, 0));
        if kinematics == Kinematics::Cartesian {
            assert_eq!(motion.field_256(1), field_256 - 160);
        }
        assert!((motion.position_mm(0) - 50.0).abs() < 0.05);
    }
}

#[test]
fn without_current_steps_move_nothing() {
    let mut motion = Motion::new(config(Kinematics::Cartesian)).unwrap();
    steps(&mut motion, 0, 0, 16, 7);
    assert_eq!((motion.record(0).unpowered_steps, motion.position_mm(0)), (7, 50.0));
    assert_eq!(motion.step(0, 9, 16), Effect::default());
}

#[test]
fn the_rotor_snaps_to_the_nearest_position_of_the_field() {
    let mut motion = powered(Kinematics::Cartesian);
    motion.set_energized(0, 0, false, 0);
    motion.set_energized(0, 0, true, 256);
    assert_eq!((motion.position_mm(0), motion.record(0).snapped_256), (50.2, 256));
    motion.set_energized(0, 0, false, 0);
    motion.set_energized(0, 0, true, 1000);
    assert_eq!(motion.record(0).snapped_256, -24);
    // Inverted: the axis runs against the counter.
    motion.set_energized(0, 1, false, 0);
    motion.set_energized(0, 1, true, 256);
    assert_eq!(motion.record(1).snapped_256, -256);
}

#[test]
fn an_end_stop_closes_and_bounces() {
    let mut motion = powered(Kinematics::Cartesian);
    let closing = (0..).find(|_| motion.step(1_000, 0, -16).lines).unwrap();
    assert_eq!((closing, motion.position_mm(0)), (50 * 80 - 1, 0.0));
    let mut edges = 0;
    while let Some(at_ns) = motion.next_event_ns() {
        edges += u32::from(motion.advance(at_ns));
    }
    assert!(edges >= 4 && motion.end_stop(0).unwrap().level());
}

#[test]
fn the_probe_triggers_over_the_sheet_and_a_nozzle_crash_is_recorded() {
    let mut motion = powered(Kinematics::Cartesian);
    assert!(motion.probe().unwrap().level());
    let triggered = (0..).find(|_| motion.step(0, 2, -16).lines).unwrap();
    assert_eq!((triggered, motion.position_mm(2)), (49 * 25 * 16 - 1, 1.0));
    steps(&mut motion, 0, 2, -16, 400 + 40);
    assert_eq!(motion.sheet().crash(), None);
    steps(&mut motion, 99, 2, -16, 160);
    let crash = motion.sheet().crash().unwrap();
    assert!((crash.deepest_mm - 0.5).abs() < 1e-9 && crash.first_ns == 99, "{crash:?}");
    // A jump up, as when the rotor snaps: the probe still releases.
    assert!((0..15).filter(|_| motion.step(99, 2, 256 * 5).lines).count() == 1 && motion.probe().unwrap().level());
}

#[test]
fn an_obstacle_stops_the_carriage() {
    let mut motion = powered(Kinematics::Cartesian);
    motion.set_frame(0, 0.0, 55.0);
    steps(&mut motion, 0, 0, 16, 1000);
    assert!(motion.position_mm(0) <= 55.0 && motion.load(0) == 1.0);
}

#[test]
fn errors_name_the_wrong_key() {
    let mut few = config(Kinematics::Cartesian);
    few.motors.truncate(2);
    assert!(Motion::new(few).unwrap_err().contains("motors"));
    let mut swapped = config(Kinematics::Cartesian);
    swapped.axes[1].maximum_mm = -5.0;
    assert!(Motion::new(swapped).unwrap_err().contains("axes[1]"));
    let mut still = config(Kinematics::Cartesian);
    still.motors[3].full_steps_per_mm = 0.0;
    assert!(Motion::new(still).unwrap_err().contains("motors[3]"));
}

proptest! {
    #[test]
    fn unblocked_positions_are_exact(
        core in any::<bool>(),
        steps in proptest::collection::vec((0_usize..2, -256_i32..=256), 0..100),
    ) {
        let kinematics = if core { Kinematics::CoreXy } else { Kinematics::Cartesian };
        let mut motion = powered(kinematics);
        let start = [0, 1].map(|motor| motion.field_256(motor));
        let mut sums = [0_i64; 2];
        for (motor, delta) in steps {
            motion.step(0, motor, delta);
            sums[motor] += i64::from(delta) * [1, -1][motor];
        }
        let fields = [0, 1].map(|motor| motion.field_256(motor) - start[motor]);
        prop_assert_eq!(fields, sums);
        let moved = if core { [sums[0] + sums[1], sums[0] - sums[1]] } else { sums.map(|sum| 2 * sum) };
        for (axis, moved) in moved.into_iter().enumerate() {
            prop_assert_eq!(motion.position_mm(axis), 50.0 + moved as f64 / 2560.0);
        }
    }

    #[test]
    fn the_carriage_never_leaves_the_frame_and_loses_whole_periods(
        core in any::<bool>(),
        moves in proptest::collection::vec((0_usize..2, any::<bool>(), 1_u32..3000), 1..20),
    ) {
        let kinematics = if core { Kinematics::CoreXy } else { Kinematics::Cartesian };
        let mut motion = powered(kinematics);
        let start = [0, 1].map(|motor| motion.field_256(motor));
        let mut sums = [0_i64; 2];
        for (motor, back, count) in moves {
            let delta = if back { -64 } else { 64 };
            for _ in 0..count {
                motion.step(0, motor, delta);
                sums[motor] += i64::from(delta) * [1, -1][motor];
                for axis in 0..2 {
                    prop_assert!((-2.0..=101.0).contains(&motion.position_mm(axis)));
                }
            }
        }
        for motor in 0..2 {
            let lost = motion.record(motor).lost_256;
            prop_assert_eq!(lost % PERIOD, 0);
            prop_assert_eq!(motion.field_256(motor) - start[motor] + lost, sums[motor]);
        }
    }
}

#[test]
fn a_further_motor_of_z_lifts_its_side() {
    let mut config = config(Kinematics::Cartesian);
    config.motors.push(config.motors[2].clone());
    config.lift = Some(lift::Lift::new(vec![(2, [0.0, 50.0]), (4, [100.0, 50.0])]).unwrap());
    let mut motion = Motion::new(config).unwrap();
    let gap = |motion: &Motion| motion.probe_gap_mm().unwrap();
    // The probe is 10 mm to the left of the middle, where 40 % of what the second
    // motor makes arrives.
    let start = gap(&motion);
    motion.turn_by_hand(4, 1.0);
    assert!((gap(&motion) - start - 0.4).abs() < 1e-6, "{}", gap(&motion));
    motion.set_energized(0, 4, true, 0);
    let held = motion.motor_mm(4);
    motion.turn_by_hand(4, 1.0);
    assert_eq!(motion.motor_mm(4), held, "a motor with current holds");
    // Two millimetres down, and Z's own motor stays.
    for step in 0..50 {
        motion.step(step, 4, -256);
    }
    assert!((motion.motor_mm(4) - held + 2.0).abs() < 1e-9);
    assert!((gap(&motion) - start - 0.4 * (motion.motor_mm(4) - motion.position_mm(2))).abs() < 1e-6);
    assert_eq!(motion.record(4).unpowered_steps, 0);
}
