//! Axes that their motors move with play, driven by the step interrupt's own player.

use ferrostep_planner::Standard;
use ferrostep_planner::backlash::BacklashStage;
use ferrostep_planner::surface::NoBed;

use super::*;

const BACKLASH: Backlash = Backlash { play_mm: [0.15, 0.1, 0.0], correction: 1.0, smoothing_mm: 3.0 };

/// The play in steps of X and Y.
const PLAY: [i64; 2] = [12, 8];

type PlayMachine<'a> = Machine<Vec<Slot>, Queue<'a>, Standard<NoBed, BacklashStage>>;

/// X and Y: each stays until its motor has gone through the play, and goes with it from there.
struct Axes([i64; 2]);

impl Axes {
    fn follow(&mut self, interrupt: &Interrupt<'_>) {
        for ((axis, motor), play) in self.0.iter_mut().zip(interrupt.motor_steps()).zip(PLAY) {
            *axis = (*axis).clamp(motor - play, motor);
        }
    }
}

fn with_play<T>(test: impl FnOnce(PlayMachine<'_>, Interrupt<'_>) -> T) -> T {
    with_queue(|queue, interrupt| {
        let mut machine = PlayMachine::new(&profile(), vec![Slot::EMPTY; 32], queue);
        machine.set_backlash(&BACKLASH);
        test(machine, interrupt)
    })
}

fn run(machine: &mut PlayMachine<'_>, interrupt: &mut Interrupt<'_>, axes: &mut Axes) {
    for _ in 0..1_000_000 {
        if machine.is_idle() {
            return;
        }
        machine.work(NO_SILENCE);
        interrupt.update();
        axes.follow(interrupt);
    }
    panic!("never idle");
}

fn go(machine: &mut PlayMachine<'_>, interrupt: &mut Interrupt<'_>, axes: &mut Axes, [x_mm, y_mm]: [i64; 2]) {
    let _ = machine.add(&travel(x_mm, y_mm)).unwrap();
    machine.flush();
    run(machine, interrupt, axes);
}

proptest! {
    #![proptest_config(ferrostep_random_cases::cases(64))]

    /// Wherever the motors are stopped, the axes come to the next place.
    #[test]
    fn a_stop_loses_no_play(
        corners in proptest::collection::vec((0i64..30, 0i64..30), 1..20), updates in 0usize..12_000,
    ) {
        with_play(|mut machine, mut interrupt| {
            // The first motion is upwards: the axes are at that side of their play.
            let mut axes = Axes(PLAY.map(|play| -play));
            go(&mut machine, &mut interrupt, &mut axes, [1, 1]);
            for &(x, y) in &corners {
                let _ = machine.add(&travel(x, y)).unwrap();
            }
            machine.flush();
            for _ in 0..updates {
                machine.work(NO_SILENCE);
                interrupt.update();
                axes.follow(&interrupt);
            }
            machine.request_stop();
            while machine.stops() == 0 {
                machine.work(NO_SILENCE);
                interrupt.update();
            }
            prop_assert_eq!(machine.motor_steps(), interrupt.motor_steps());
            go(&mut machine, &mut interrupt, &mut axes, [40, 40]);
            prop_assert_eq!(axes.0, [3200 - PLAY[0], 3200 - PLAY[1]]);
            prop_assert_eq!(machine.figures().miscounts, 0);
            Ok(())
        })?;
    }
}

/// A sensor is met with the play on one side, and from the place that is set there all
/// others are exact.
#[test]
fn a_sensor_s_place_is_the_axis_own() {
    with_play(|mut machine, mut interrupt| {
        let mut axes = Axes(PLAY.map(|play| -play));
        go(&mut machine, &mut interrupt, &mut axes, [20, 10]);
        interrupt.sensors.trigger_at.set(-40);
        machine.begin_seek(0);
        go(&mut machine, &mut interrupt, &mut axes, [-10, 10]);
        assert_eq!(machine.take_homing_result(), Some(Ok(HomingOutcome::Triggered)));
        let [met, _] = axes.0;
        assert_eq!(met, interrupt.motor_steps()[0], "its motor pulls it down");
        machine.set_position([0, 1_000_000, 0]);
        for (x_mm, steps) in [(10, 800), (4, 320), (15, 1200), (1, 80)] {
            go(&mut machine, &mut interrupt, &mut axes, [x_mm, 10]);
            assert_eq!(axes.0[0] - met, steps, "X{x_mm}");
        }
        assert_eq!(machine.figures().miscounts, 0);
    });
}

/// Changed play moves no motor, and play that was taken up stays so.
#[test]
fn play_may_change_between_moves() {
    with_play(|mut machine, mut interrupt| {
        let mut axes = Axes(PLAY.map(|play| -play));
        go(&mut machine, &mut interrupt, &mut axes, [20, 10]);
        go(&mut machine, &mut interrupt, &mut axes, [10, 10]);
        let (motors, position) = (interrupt.motor_steps(), machine.position_10nm());
        machine.set_backlash(&Backlash { play_mm: [0.15, 0.1, 0.02], smoothing_mm: 1.0, ..BACKLASH });
        assert_eq!((interrupt.motor_steps(), machine.position_10nm()), (motors, position));
        go(&mut machine, &mut interrupt, &mut axes, [20, 10]);
        assert_eq!(axes.0[0], 1600 - PLAY[0]);
        // Without correction the play is felt.
        machine.set_backlash(&Backlash { correction: 0.0, ..BACKLASH });
        go(&mut machine, &mut interrupt, &mut axes, [10, 10]);
        assert_eq!(axes.0[0], 800);
        assert_eq!(machine.figures().miscounts, 0);
    });
}
