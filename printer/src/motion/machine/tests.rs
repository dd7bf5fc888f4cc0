//! The machine against the planner alone, with the step interrupt's own player at the other
//! end of the queue.

mod backlash;
mod stops;

use core::cell::{Cell, RefCell};

use ferrostep_hal_shim::{HomingSensors, MotionWatch, MotorEnable, PlanningClock, StepQueue};
use ferrostep_planner::Progress;
use ferrostep_planner::{
    Kinematics, MotionChoice, Move, Notice, StepDigests, StepEntry, StepLedger, StepObserver, StepSink, StepsPerMm,
};
use ferrostep_step_player::{
    DroppedSteps, FeedError, NextWords, OutputPorts, Pulses, Signals, StepFeeder, StepLink, StepPlayer, UpdateTimer,
};
use ferrostep_thermistor::{Thermistor, ThermistorType};
use ferrostep_virtual_board::{HeatedMass, ModelledSensors, VirtualPort, VirtualUpdateTimer};
use proptest::prelude::*;

use super::work::MAX_MISSED_UPDATES;
use super::*;
use crate::heat::fans::FanSettings;
use crate::heat::gains::PidGains;
use crate::settings::profile::DriverTiming;
use crate::settings::profile::filament::{ExtrusionSettings, FirmwareRetraction};
use crate::settings::profile::heaters::{HeaterSettings, HeaterWatch};
use crate::settings::profile::homing::{AxisHoming, HomeEnd, HomeSensor};

const NO_SILENCE: Silence = Silence { may_release: false, may_flush: false };

pub(crate) fn profile() -> Profile {
    let steps = |value| StepsPerMm::from_f64(value).unwrap();
    let heater = HeaterSettings {
        thermistor: Thermistor { kind: ThermistorType::Semitec104Gt2, pull_up_ohm: 4700.0 },
        watch: HeaterWatch::NOZZLE,
        min_celsius: 5.0,
        max_celsius: 275.0,
        max_target_celsius: 275.0,
        gains: PidGains { proportional: 0.1, ..PidGains::default() },
        residency_window_celsius: 1.0,
        residency_ms: 0,
        mass: HeatedMass::NOZZLE,
        is_heated: true,
        is_warmed_by_others: false,
    };
    let homing = AxisHoming {
        end: HomeEnd::Min,
        sensor: HomeSensor::EndStop,
        triggers_low: false,
        position_10nm: 0,
        fast_mm_per_s: 50.0,
        slow_mm_per_s: 25.0,
        back_off_10nm: 500_000,
        overrun_10nm: 500_000,
        agree_10nm: 50_000,
    };
    Profile {
        name: "test",
        model_names: "",
        macros: "",
        nozzle_diameter_mm: None,
        max_volumetric_flow_mm3_per_s: None,
        plan_hash: 0,
        kinematics: Kinematics::Cartesian,
        size_10nm: [20_000_000; 3],
        lower_end_10nm: [0; 3],
        steps_per_mm: [steps(80.0), steps(80.0), steps(400.0), steps(95.0)],
        limits: Limits {
            max_feed_mm_per_s: [200.0, 200.0, 10.0, 60.0],
            max_acceleration_mm_per_s2: [1500.0, 1500.0, 100.0, 5000.0],
            print_acceleration_mm_per_s2: 1000.0,
            travel_acceleration_mm_per_s2: 1000.0,
            retract_acceleration_mm_per_s2: 1500.0,
            junction_deviation_mm: 0.1,
            instantaneous_corner_velocity_mm_per_s: [f64::INFINITY; 4],
        },
        motion: MotionChoice::DEFAULT,
        minimum_event_interval_ticks: 168,
        event_cost_ticks: 210,
        move_cost_ticks: 10_500,
        skew: crate::motion::skew::Skew::NONE,
        backlash: None,
        homing: [homing; 3],
        safe_homing: crate::settings::profile::homing::SafeHoming::NONE,
        bltouch: None,
        mesh: None,
        bed_screws: None,
        z_motors: None,
        tools: None,
        holds_corner_speed: false,
        min_extrusion_celsius: 170.0,
        heater_timeout_s: crate::settings::profile::heaters::DEFAULT_HEATER_TIMEOUT_S,
        nozzle: heater,
        bed: heater,
        chamber: None,
        control_models: [None; 2],
        fans: FanSettings::USUAL,
        filament_sensor: None,
        filament_switch: None,
        power_supply: None,
        supply_signal: None,
        pause: crate::settings::profile::filament::PauseSettings {
            place_10nm: [1_000_000, 19_000_000],
            rise_10nm: 2_000_000,
            unload_10nm: 0,
            load_10nm: 0,
            more_10nm: 5_000_000,
            filament_10nm_per_s: 500_000,
        },
        retraction: FirmwareRetraction {
            length_10nm: 0,
            retract_10nm_per_s: 1,
            extra_recover_10nm: 0,
            recover_10nm_per_s: 1,
            lift_10nm: 0,
        },
        driver: DriverTiming { pulse_width_ns: 1000, direction_setup_ns: 200, both_edges: false, inverted: 0 },
        extrusion: ExtrusionSettings::DEFAULT,
        drivers: [None; 4],
    }
}

/// The step queue of a board whose pins are on one port.
type Player = StepPlayer<Pulses, 1, 2048>;

/// End stops that trigger at and below a motor's step, and the axis whose interrupt is open.
#[derive(Default)]
struct Sensors {
    trigger_at: Cell<i64>,
    watched: Cell<Option<usize>>,
}

/// A queue with sensors.
struct Queue<'a> {
    sensors: &'a Sensors,
    feeder: StepFeeder<'a, Pulses, 1, 2048>,
    player: &'a Player,
    timer: &'a VirtualUpdateTimer,
    port: &'a VirtualPort<'a>,
    next: &'a RefCell<NextWords<1>>,
    enabled: u8,
    /// Updates that the interrupt reports as missed.
    missed: u32,
    digests: StepDigests,
}

impl HomingSensors for Queue<'_> {
    fn is_sensor_triggered(&self, axis: usize) -> bool {
        self.port.motor_steps()[axis] <= self.sensors.trigger_at.get()
    }
    fn watch_sensor(&mut self, axis: Option<usize>) {
        self.sensors.watched.set(axis);
    }
}

impl PlanningClock for Queue<'_> {}

impl StepObserver for Queue<'_> {
    fn stepped(&mut self, tick: u64, axes: u8, directions: u8) {
        self.digests.stepped(tick, axes, directions);
    }
}

impl MotionWatch for Queue<'_> {
    fn digests(&self) -> StepDigests {
        self.digests
    }
}

impl StepQueue for Queue<'_> {
    fn queued(&self) -> u32 {
        self.feeder.queued()
    }
    fn played(&self) -> u32 {
        self.feeder.played()
    }

    fn waiting(&self) -> usize {
        self.feeder.waiting()
    }
    fn room(&self) -> usize {
        self.feeder.room()
    }
    fn push(&mut self, entry: StepEntry) -> Result<(), FeedError> {
        self.feeder.push(entry)
    }
    fn seal(&mut self) {
        self.feeder.seal();
    }
    fn start(&mut self) {
        if self.feeder.start() {
            self.player.start_or_end(&mut self.next.borrow_mut(), self.timer);
        }
    }
    fn link(&self) -> &StepLink {
        self.player.link()
    }
    fn unplayed_steps(&self) -> [i32; 4] {
        self.feeder.unplayed_steps()
    }
    fn request_stop(&mut self) {
        self.timer.mask();
        self.link().request_stop();
    }
    fn drop_all(&mut self) -> DroppedSteps {
        let dropped = self.feeder.drop_all();
        for word in self.feeder.rest_words() {
            self.port.write(0, word);
        }
        dropped
    }
    fn take_missed_updates(&mut self) -> u32 {
        std::mem::take(&mut self.missed)
    }
}

impl MotorEnable for Queue<'_> {
    fn set_motors_enabled(&mut self, axes: u8, enabled: bool) {
        self.enabled = if enabled { self.enabled | axes } else { self.enabled & !axes };
    }
}

/// The far end of the queue: the step interrupt, and motors that count the pins' edges.
struct Interrupt<'a> {
    sensors: &'a Sensors,
    player: &'a Player,
    timer: &'a VirtualUpdateTimer,
    port: &'a VirtualPort<'a>,
    next: &'a RefCell<NextWords<1>>,
}

impl Interrupt<'_> {
    /// An update of the timer, if one is waited for.
    fn update(&mut self) {
        self.timer.next_update();
        if self.timer.is_called() {
            self.timer.interrupt(self.player, &mut self.next.borrow_mut(), self.port);
        }
        if let Some(axis) = self.sensors.watched.get()
            && self.motor_steps()[axis] <= self.sensors.trigger_at.get()
        {
            // The edge: it comes once.
            self.sensors.watched.set(None);
            self.timer.mask();
            self.player.link().request_sensor_stop();
        }
    }

    fn motor_steps(&self) -> [i64; 4] {
        self.port.motor_steps()
    }

    fn events(&self) -> u64 {
        self.port.events()
    }
}

type TestMachine<'a> = Machine<Vec<Slot>, Queue<'a>>;

/// Runs `test` with a machine and the interrupt that plays its steps.
fn with_machine<T>(look_ahead: usize, test: impl FnOnce(TestMachine<'_>, Interrupt<'_>) -> T) -> T {
    with_queue(|queue, interrupt| test(Machine::new(&profile(), vec![Slot::EMPTY; look_ahead], queue), interrupt))
}

/// Runs `test` with a step queue and the interrupt that plays it.
fn with_queue<T>(test: impl FnOnce(Queue<'_>, Interrupt<'_>) -> T) -> T {
    let sensors = Sensors::default();
    let (player, timer) = (Box::new(Player::new()), VirtualUpdateTimer::default());
    let port = VirtualPort::new(&timer, false);
    let signals = Signals { pulse_ticks: 84, direction_setup_ticks: 17 };
    let next = RefCell::new(NextWords::NONE);
    let feeder = StepFeeder::new(&player, VirtualPort::pins(), signals);
    let queue = Queue {
        sensors: &sensors,
        feeder,
        player: &player,
        timer: &timer,
        port: &port,
        next: &next,
        enabled: 0,
        missed: 0,
        digests: StepDigests::default(),
    };
    test(queue, Interrupt { sensors: &sensors, player: &player, timer: &timer, port: &port, next: &next })
}

fn travel(x_mm: i64, y_mm: i64) -> Move {
    Move {
        target_10nm: [x_mm * 100_000, y_mm * 100_000, 0],
        filament_100pm: 0,
        feed_mm_per_s: 100.0,
        line: 1,
        ends_move: true,
    }
}

fn run_until_idle(machine: &mut Machine<Vec<Slot>, impl StepOutput>, interrupt: &mut Interrupt<'_>) {
    for _ in 0..1_000_000 {
        if machine.is_idle() {
            return;
        }
        machine.work(NO_SILENCE);
        interrupt.update();
    }
    panic!("never idle");
}

proptest! {
    #![proptest_config(ferrostep_random_cases::cases(64))]
    #[test]
    fn steps_are_the_planner_s_whenever_the_interrupt_comes(
        corners in proptest::collection::vec((0i64..30, 0i64..30), 1..60),
        updates in proptest::collection::vec(0usize..200, 8),
        look_ahead in 2usize..20,
    ) {
        let mut planner = Planner::<_>::new(profile().geometry(), profile().limits, vec![Slot::EMPTY; look_ahead]);
        #[derive(Default)]
        struct Plain(StepLedger, StepDigests);
        impl StepSink for Plain {
            fn entry(&mut self, entry: StepEntry) {
                self.0.play(entry, &mut self.1);
            }
            fn notice(&mut self, _notice: Notice) {}
        }
        let mut plain = Plain::default();
        for &(x, y) in &corners {
            while planner.add(&travel(x, y)) == Err(MoveError::NoRoom) {
                planner.advance(&mut plain);
            }
        }
        planner.flush();
        while planner.advance(&mut plain) == Progress::Worked {}

        with_machine(look_ahead, |mut machine, mut interrupt| {
            for (index, &(x, y)) in corners.iter().enumerate() {
                for _ in 0..updates[index % updates.len()] {
                    interrupt.update();
                }
                while machine.add(&travel(x, y)) == Err(MoveError::NoRoom) {
                    machine.work(NO_SILENCE);
                    interrupt.update();
                }
            }
            machine.flush();
            run_until_idle(&mut machine, &mut interrupt);
            let figures = machine.figures();
            prop_assert_eq!(figures.order_digest, plain.1.order);
            prop_assert_eq!(figures.step_digest, plain.1.step);
            prop_assert_eq!(figures.issued_steps, plain.0.issued());
            prop_assert_eq!(interrupt.motor_steps(), plain.0.motor_steps());
            Ok(())
        })?;
    }

    #[test]
    fn after_a_stop_the_position_is_where_the_motors_stand(
        corners in proptest::collection::vec((0i64..30, 0i64..30), 1..20), updates in 0usize..6000,
    ) {
        with_machine(32, |mut machine, mut interrupt| {
            for &(x, y) in &corners {
                let _ = machine.add(&travel(x, y)).unwrap();
            }
            machine.flush();
            for _ in 0..updates {
                machine.work(NO_SILENCE);
                interrupt.update();
            }
            machine.request_stop();
            prop_assert_eq!(machine.add(&travel(5, 5)), Err(MoveError::NoRoom));
            let events = interrupt.events();
            while machine.stops() == 0 {
                machine.work(NO_SILENCE);
                interrupt.update();
            }
            prop_assert_eq!(interrupt.events(), events);
            prop_assert!(machine.is_idle());
            prop_assert_eq!(machine.motor_steps(), interrupt.motor_steps());
            let [x, y, ..] = interrupt.motor_steps();
            prop_assert_eq!(machine.position_10nm(), [x * 1250, y * 1250, 0]);
            // It continues from there.
            let _ = machine.add(&travel(40, 40)).unwrap();
            machine.flush();
            run_until_idle(&mut machine, &mut interrupt);
            prop_assert_eq!(interrupt.motor_steps(), [3200, 3200, 0, 0]);
            Ok(())
        })?;
    }
}

/// A few missed updates are counted, and motion continues. More stop it: whatever has held the
/// interrupt up, or whatever is wrong with the count, moves no motor.
#[test]
fn missed_updates_beyond_the_bound_stop_motion_and_move_no_motor() {
    for (missed, stops) in [(MAX_MISSED_UPDATES, false), (MAX_MISSED_UPDATES + 1, true), (16_383, true)] {
        with_machine(8, |mut machine, mut interrupt| {
            let _ = machine.add(&travel(10, 5)).unwrap();
            machine.flush();
            for _ in 0..500 {
                machine.work(NO_SILENCE);
                interrupt.update();
            }
            let events = interrupt.events();
            assert!(events > 100 && !machine.is_idle());
            machine.feeder.queue.missed = missed;
            machine.work(NO_SILENCE);
            assert_eq!(interrupt.events(), events, "a motor moved");
            assert_eq!(machine.figures().missed_updates, u64::from(missed));
            run_until_idle(&mut machine, &mut interrupt);
            let fault = stops.then_some(MotionFault::MissedUpdates(missed));
            assert_eq!((machine.take_fault(), machine.stops()), (fault, u32::from(stops)));
            assert_eq!(machine.motor_steps(), interrupt.motor_steps());
            assert_eq!(interrupt.motor_steps() == [800, 400, 0, 0], !stops);
        });
    }
}

#[test]
fn a_lone_move_waits_for_more_until_the_host_has_been_silent() {
    with_machine(8, |mut machine, mut interrupt| {
        assert_eq!(machine.add(&travel(1, 0)), Ok(Moved::Queued));
        assert_eq!(machine.feeder.queue.enabled, ALL_MOTORS);
        for _ in 0..100 {
            machine.work(Silence { may_release: true, may_flush: false });
            interrupt.update();
        }
        assert_eq!((interrupt.events(), machine.figures().idle_flushes), (0, 0));
        machine.work(Silence { may_release: true, may_flush: true });
        run_until_idle(&mut machine, &mut interrupt);
        assert_eq!(interrupt.motor_steps(), [80, 0, 0, 0]);
        let figures = machine.figures();
        assert_eq!((figures.idle_flushes, figures.starvation_flushes, figures.underruns), (1, 0, 0));
    });
}

#[test]
fn blocks_leave_early_only_when_steps_run_out_in_motion() {
    with_machine(8, |mut machine, mut interrupt| {
        // Straight on, so that no block ends at standstill.
        // One more than the ring holds: the newest may still grow, and stays outside.
        for x in 1..=9 {
            assert_eq!(machine.add(&travel(x, 0)), Ok(Moved::Queued));
        }
        machine.work(Silence { may_release: true, may_flush: false });
        assert!(machine.figures().starvation_flushes == 0 && !interrupt.player.link().is_running());
        machine.feeder.queue.start();
        // The first of them takes 45 ms, most of which is left.
        for _ in 0..40 {
            interrupt.update();
        }
        machine.work(Silence { may_release: true, may_flush: false });
        assert_eq!(machine.figures().starvation_flushes, 0);
        for _ in 0..110 {
            interrupt.update();
        }
        machine.work(NO_SILENCE);
        assert_eq!(machine.figures().starvation_flushes, 0);
        machine.work(Silence { may_release: true, may_flush: false });
        assert_eq!(machine.figures().starvation_flushes, 1);
        for _ in 0..1000 {
            interrupt.update();
        }
        // Nothing was released any more: the queue ran dry at full speed.
        machine.work(NO_SILENCE);
        assert_eq!(machine.figures().underruns, 1);
    });
}

#[test]
fn the_fan_changes_between_the_moves_around_it() {
    with_machine(8, |mut machine, mut interrupt| {
        assert!(machine.add_fan_power(FanOutput::Part, 10));
        assert_eq!(machine.fan_demand().powers, [10, 0, 0, 0, 0, 0]);
        assert!(machine.add_fan_power(FanOutput::Fan3, 77));
        let _ = machine.add(&travel(1, 0)).unwrap();
        assert!(machine.add_fan_power(FanOutput::Part, 200));
        let _ = machine.add(&travel(2, 0)).unwrap();
        machine.flush();
        machine.work(NO_SILENCE);
        let mut before = 0;
        while machine.fan_demand().powers[0] == 10 {
            interrupt.update();
            machine.work(NO_SILENCE);
            before = interrupt.motor_steps()[0];
        }
        assert_eq!(machine.fan_demand(), FanDemand { powers: [200, 0, 0, 77, 0, 0], motors_on: true });
        assert!((1..=80).contains(&before), "{before}");
        run_until_idle(&mut machine, &mut interrupt);
        assert_eq!(interrupt.motor_steps()[0], 160);
    });
}

#[test]
fn motors_that_rest_are_switched_off() {
    with_machine(8, |mut machine, mut interrupt| {
        let timeout = Some(1000);
        // Nothing is on.
        assert!(!machine.rest(0, timeout) && !machine.rest(5000, timeout));
        let _ = machine.add(&travel(1, 0)).unwrap();
        machine.flush();
        machine.work(NO_SILENCE);
        // In motion, whatever the time.
        assert!(!machine.rest(6000, timeout) && !machine.rest(60_000, timeout));
        run_until_idle(&mut machine, &mut interrupt);
        // A clock that wraps; a reason to stay begins the rest anew.
        let start = u32::MAX - 500;
        assert!(!machine.rest(start, timeout) && !machine.rest(start.wrapping_add(999), timeout));
        assert!(!machine.rest(start.wrapping_add(1500), None) && !machine.rest(2000, timeout));
        assert!(!machine.rest(2999, timeout));
        assert_eq!((machine.feeder.queue.enabled, machine.take_switched_off()), (ALL_MOTORS, false));
        assert!(machine.rest(3000, timeout));
        assert_eq!(
            (machine.feeder.queue.enabled, machine.take_switched_off(), machine.take_switched_off()),
            (0, true, false)
        );
        assert!(!machine.rest(9000, timeout));
        // The next move switches them on again.
        let _ = machine.add(&travel(2, 0)).unwrap();
        assert_eq!(machine.feeder.queue.enabled, ALL_MOTORS);
    });
}
