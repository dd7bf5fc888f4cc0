//! G28 from many places, with working and broken sensors: the motors' push against the frame, and
//! the host's lines.
//!
//! The machine is a frame, a sheet and sensors without steps (`Mechanics`), so that a homing takes
//! microseconds. Some of the same on the desk, with every step, is at the end.

use std::cell::{Cell, RefCell};
use std::pin::pin;
use std::task::{Context, Poll, Waker};

use ferrostep_gcode::{MotionFigures, Reply};
use ferrostep_hal_shim::{Clock, FanOutput, Heater};
use ferrostep_planner::{ChoiceError, Limits, MotionChoice, Move, Moved, PressureAdvance, Request, StepsPerMm};
use ferrostep_printer::heat::HeatFault;
use ferrostep_printer::{
    CommandError, Failure, HeaterStatus, Heating, HomeEnd, HomeSensor, HomingOutcome, Motion, MotionError, Printer,
    Profile, Replies, Signals,
};
use ferrostep_random_cases::share_of;
use ferrostep_virtual_board::{
    BOUNCE_10NM, Mechanics, STALL_LAG_10NM, SensorFault, SensorPlace, SheetShape, VirtualProbe, VirtualSensor,
};

use crate::end_to_end::desk::profile;

const MM: i64 = 100_000;

/// Number of places for each scenario and machine; a run tries its share.
const PLACES: u64 = 10_000;

/// Maximum press of the nozzle into the bed that is promised, units of 10 nm.
const MAX_PRESS_10NM: i64 = MM / 2;

/// Pseudo-random numbers (SplitMix64, Steele 2014).
struct Chance(u64);

impl Chance {
    fn new(seed: u64) -> Self {
        Self(seed)
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ mixed >> 31
    }
}

/// Start of a trial.
struct Start {
    mechanics: Mechanics,
    true_10nm: [i64; 3],
}

/// A machine of this profile somewhere within its frame, which reaches beyond the travel by up
/// to what the profile admits; its probe triggers 0.3 to 2.5 mm above the bed, which the
/// profile does not know.
fn start(profile: &Profile, faults: [SensorFault; 3], seed: u64) -> Start {
    let mut cases = Chance::new(seed);
    let mut below = |limit: i64| (cases.next() % limit.unsigned_abs().max(1)) as i64;
    let probe_10nm = 30_000 + below(220_000);
    let mut frame_10nm = [[0; 2]; 3];
    let mut sensors = [VirtualSensor { place: SensorPlace::Frame, at_max: false, fault: SensorFault::Healthy }; 3];
    for axis in 0..3 {
        let homing = &profile.homing[axis];
        let at_max = homing.end == HomeEnd::Max;
        let slack = [0, 1].map(|_| below(homing.overrun_10nm + 1));
        frame_10nm[axis] = [profile.lower_end_10nm[axis] - slack[0], profile.size_10nm[axis] + slack[1]];
        let (place, end) = match homing.sensor {
            HomeSensor::Stall => (SensorPlace::Frame, homing.position_10nm),
            HomeSensor::EndStop if axis == 2 => (SensorPlace::At(0), 0),
            HomeSensor::Probe => (SensorPlace::At(probe_10nm), 0),
            // The switch is a little before the end of the frame.
            HomeSensor::EndStop => {
                let beyond = if at_max { MM } else { -MM };
                (SensorPlace::At(homing.position_10nm), homing.position_10nm + beyond)
            }
        };
        frame_10nm[axis][usize::from(at_max)] = end;
        sensors[axis] = VirtualSensor { place, at_max, fault: faults[axis] };
    }
    let true_10nm = frame_10nm.map(|[lower, upper]| lower + below(upper - lower + 1));
    let [x, y, _] = profile.safe_homing.probe_offset_10nm;
    let probe = (profile.homing[2].sensor == HomeSensor::Probe).then_some(VirtualProbe {
        offset_10nm: [x, y],
        sheet_10nm: profile.safe_homing.bed_10nm,
        shape: SheetShape::FLAT,
    });
    Start { mechanics: Mechanics::new(frame_10nm, sensors, probe, true_10nm, cases.next()), true_10nm }
}

/// Motors without steps, on this machine.
struct Places {
    mechanics: RefCell<Mechanics>,
    believed_10nm: Cell<[i64; 3]>,
    said: RefCell<String>,
    signals: Signals,
}

impl Places {
    fn new(mechanics: Mechanics) -> Self {
        Self {
            mechanics: RefCell::new(mechanics),
            believed_10nm: Cell::new([0; 3]),
            said: RefCell::default(),
            signals: Signals::new(),
        }
    }

    /// Lengths by which the motors pushed against the lower and upper end of each axis.
    fn pushed_10nm(&self) -> [[i64; 2]; 3] {
        self.mechanics.borrow().pushed_10nm()
    }

    fn way_to(&self, target_10nm: [i64; 3]) -> [i64; 3] {
        let from = self.believed_10nm.get();
        std::array::from_fn(|axis| target_10nm[axis] - from[axis])
    }
}

type PlacesPrinter<'a> = Printer<'a, (PlacesMotion<'a>, Cold, NoTime, Places)>;

fn printer<'a>(profile: &'a Profile, places: &'a Places) -> PlacesPrinter<'a> {
    Printer::new(profile, PlacesMotion(places), Cold, NoTime, places, &places.signals)
}

fn execute(printer: &mut PlacesPrinter<'_>, line: &str) -> Result<(), CommandError> {
    let Poll::Ready(outcome) = pin!(printer.execute(1, line)).poll(&mut Context::from_waker(Waker::noop())) else {
        panic!("`{line}` waits");
    };
    outcome.map_err(|failure| match failure {
        Failure::Command(error) => error,
        Failure::Parse(error) => panic!("{error}"),
    })
}

struct PlacesMotion<'a>(&'a Places);

impl Motion for PlacesMotion<'_> {
    type Bed = ferrostep_planner::surface::NoBed;
    type Servo = ferrostep_printer::Absent;
    type ZMotors = ferrostep_printer::Absent;
    type Tools = ferrostep_printer::Absent;
    type Backlash = ferrostep_printer::Absent;
    type SupplySignal = ferrostep_printer::Absent;

    async fn add(&mut self, request: impl Request) -> Result<Moved, MotionError> {
        let Some(request) = request.as_move() else { unreachable!("no prepared jobs here") };
        let way = self.0.way_to(request.target_10nm);
        self.0.mechanics.borrow_mut().go(way);
        self.0.believed_10nm.set(request.target_10nm);
        Ok(Moved::Queued)
    }

    async fn seek(&mut self, request: Move, axis: usize) -> Result<HomingOutcome, MotionError> {
        let way = self.0.way_to(request.target_10nm)[axis];
        let (moved, triggered) = self.0.mechanics.borrow_mut().seek(axis, way);
        let mut believed = self.0.believed_10nm.get();
        believed[axis] += moved;
        self.0.believed_10nm.set(believed);
        Ok(if triggered { HomingOutcome::Triggered } else { HomingOutcome::Missed })
    }

    async fn set_pressure_advance(&mut self, _: &PressureAdvance) -> Result<bool, MotionError> {
        Ok(false)
    }

    async fn set_fan_power(&mut self, _: FanOutput, _: u8) -> Result<(), MotionError> {
        Ok(())
    }

    async fn finish(&mut self) -> Result<(), MotionError> {
        Ok(())
    }

    fn position_10nm(&self) -> [i64; 3] {
        self.0.believed_10nm.get()
    }

    fn set_position(&mut self, position_10nm: [i64; 3]) {
        self.0.believed_10nm.set(position_10nm);
    }

    fn motor_steps(&self) -> [i64; 4] {
        [0; 4]
    }

    fn figures(&self) -> MotionFigures {
        MotionFigures::default()
    }

    fn limits(&self) -> Limits {
        Limits {
            max_feed_mm_per_s: [100.0; 4],
            max_acceleration_mm_per_s2: [1000.0; 4],
            print_acceleration_mm_per_s2: 1000.0,
            travel_acceleration_mm_per_s2: 1000.0,
            retract_acceleration_mm_per_s2: 1000.0,
            junction_deviation_mm: 0.05,
            instantaneous_corner_velocity_mm_per_s: [f64::INFINITY; 4],
        }
    }

    fn set_limits(&mut self, _: Limits) {}

    fn extruder_steps_per_mm(&self) -> StepsPerMm {
        StepsPerMm::nearest(100.0)
    }

    fn set_extruder_steps_per_mm(&mut self, _: StepsPerMm) -> Result<(), ChoiceError> {
        Ok(())
    }

    fn motion_choice(&self) -> MotionChoice {
        MotionChoice::DEFAULT
    }

    fn set_motion_choice(&mut self, _: &MotionChoice) -> Result<(), ChoiceError> {
        Ok(())
    }

    fn set_motors_enabled(&mut self, _: u8, _: bool) {}

    fn is_end_stop_triggered(&self, axis: usize) -> bool {
        self.0.mechanics.borrow().is_triggered(axis)
    }

    fn stop(&mut self) -> i64 {
        0
    }
}

impl Replies for Places {
    fn send(&self, reply: Reply<'_>) {
        if let Reply::Text(text) = reply {
            self.said.replace(text.to_owned());
        }
    }
}

struct Cold;

impl Heating for Cold {
    type Supply = ferrostep_printer::Present;
    type Models = ferrostep_printer::Present;

    fn set_target(&mut self, _: Heater, _: f32) {}
    fn status(&self, _: Heater) -> HeaterStatus {
        HeaterStatus { celsius: 22.0, ..HeaterStatus::default() }
    }
    fn all_off(&mut self) {}
    fn restart(&mut self) -> Result<(), HeatFault> {
        Ok(())
    }
}

#[derive(Clone)]
struct NoTime;

impl Clock for NoTime {
    fn now_ms(&self) -> u64 {
        0
    }
}

impl embedded_hal_async::delay::DelayNs for NoTime {
    async fn delay_ns(&mut self, _: u32) {
        unreachable!("nothing waits here")
    }
}

const HEALTHY: [SensorFault; 3] = [SensorFault::Healthy; 3];

fn with_fault(axis: usize, fault: SensorFault) -> [SensorFault; 3] {
    let mut faults = HEALTHY;
    faults[axis] = fault;
    faults
}

/// Homes once from each of the places on each machine, and passes the result on.
fn from_everywhere(
    faults: [SensorFault; 3],
    judge: impl Fn(&Profile, &Places, [i64; 3], Result<(), CommandError>) + Sync,
) {
    let judge = &judge;
    std::thread::scope(|scope| {
        for name in ["cartesian", "corexy", "prusa-mini"] {
            let seeds = share_of(PLACES);
            scope.spawn(move || {
                let profile = profile(name);
                for seed in seeds {
                    let Start { mechanics, true_10nm } = start(&profile, faults, seed);
                    let places = Places::new(mechanics);
                    let outcome = execute(&mut printer(&profile, &places), "G28");
                    let pushed = places.pushed_10nm();
                    // The nozzle is not pressed into the bed in any scenario if Z's
                    // sensor can trigger.
                    if faults[2] != SensorFault::AlwaysOff {
                        assert!(pushed[2][0] <= MAX_PRESS_10NM, "{name} {seed}: {pushed:?}");
                    }
                    // A raise and a way back may meet the upper end of the frame.
                    let up = profile.safe_homing.raise_10nm + profile.homing[2].back_off_10nm;
                    assert!(pushed[2][1] <= up, "{name} {seed}: {pushed:?}");
                    for axis in 0..2 {
                        let homing = &profile.homing[axis];
                        let longest = profile.size_10nm[axis] - profile.lower_end_10nm[axis] + homing.overrun_10nm;
                        let home = usize::from(homing.end == HomeEnd::Max);
                        // The way back may meet the other end, and an approach goes no
                        // farther than the bound.
                        assert!(pushed[axis][1 - home] <= 2 * homing.back_off_10nm, "{name} {seed}: {pushed:?}");
                        assert!(pushed[axis][home] <= longest, "{name} {seed}: {pushed:?}");
                    }
                    judge(&profile, &places, true_10nm, outcome);
                }
            });
        }
    });
}

/// Checks that the machine's position is right, as far as its sensors can tell.
fn is_home(profile: &Profile, places: &Places) {
    let (true_10nm, believed_10nm) = (places.mechanics.borrow().true_position_10nm(), places.believed_10nm.get());
    for axis in 0..2 {
        let apart = (true_10nm[axis] - believed_10nm[axis]).abs();
        assert!(apart <= STALL_LAG_10NM.max(BOUNCE_10NM), "{} axis {axis}: {apart}", profile.name);
    }
    // The profile has 0 mm for a probe, which is too low: the nozzle is higher than the
    // machine believes.
    let higher = true_10nm[2] - believed_10nm[2];
    let most = if profile.homing[2].sensor == HomeSensor::Probe { 250_000 } else { 0 };
    assert!((0..=most + BOUNCE_10NM).contains(&higher), "{}: {higher}", profile.name);
}

/// Checks the ends of X and Y: an end that stalls is pushed by at most the stall's lag, a
/// switch not at all.
fn only_stalls_push(profile: &Profile, places: &Places) {
    for axis in 0..2 {
        let homing = &profile.homing[axis];
        let home = usize::from(homing.end == HomeEnd::Max);
        let most = if homing.sensor == HomeSensor::Stall { STALL_LAG_10NM } else { 0 };
        let pushed = places.pushed_10nm()[axis][home];
        assert!(pushed <= most, "{} axis {axis}: {pushed}", profile.name);
    }
}

#[test]
fn working_sensors_home_from_anywhere_without_pushing() {
    from_everywhere(HEALTHY, |profile, places, _, outcome| {
        assert_eq!(outcome, Ok(()));
        is_home(profile, places);
        only_stalls_push(profile, places);
        assert_eq!(places.pushed_10nm()[2][0], 0);
    });
}

#[test]
fn bouncing_sensors_home_from_anywhere() {
    from_everywhere([SensorFault::Bouncing; 3], |profile, places, _, outcome| {
        assert_eq!(outcome, Ok(()));
        is_home(profile, places);
        only_stalls_push(profile, places);
        assert_eq!(places.pushed_10nm()[2][0], 0);
    });
}

/// A missing sensor is always triggered as well: inputs have pull-ups, and those of these
/// machines trigger high.
#[test]
fn an_absent_or_stuck_sensor_is_named_and_z_stays_up() {
    for axis in 0..3 {
        from_everywhere(with_fault(axis, SensorFault::AlwaysOn), |profile, places, _, outcome| {
            assert_eq!(outcome, Err(CommandError::SensorStuck { axis }), "{}", profile.name);
            assert!(places.said.borrow().contains("is it connected"), "{}", places.said.borrow());
            assert_eq!(places.pushed_10nm()[2][0], 0);
        });
    }
}

/// X and Y push against the frame up to the bound, and Z has not moved.
#[test]
fn a_dead_sensor_of_x_or_y_is_named() {
    for axis in 0..2 {
        from_everywhere(with_fault(axis, SensorFault::AlwaysOff), |profile, places, _, outcome| {
            let searched_10nm =
                profile.size_10nm[axis] - profile.lower_end_10nm[axis] + profile.homing[axis].overrun_10nm;
            let swapped = None;
            let failed = CommandError::HomingFailed { axis, searched_10nm, swapped };
            assert_eq!(outcome, Err(failed), "{}", profile.name);
            assert_eq!(places.pushed_10nm()[2][0], 0);
        });
    }
}

#[test]
fn swapped_sensors_of_x_and_y_are_named() {
    let swapped = [SensorFault::WiredTo(1), SensorFault::WiredTo(0), SensorFault::Healthy];
    from_everywhere(swapped, |profile, places, true_10nm, outcome| {
        let stalls = profile.homing[1].sensor == HomeSensor::Stall;
        let [at_x, at_y] = [0, 1].map(|axis| {
            let homing = &profile.homing[axis];
            (true_10nm[axis] - homing.position_10nm) * if homing.end == HomeEnd::Max { 1 } else { -1 } >= 0
        });
        match outcome {
            // Y is at its switch: X seems to be stuck.
            Err(CommandError::SensorStuck { axis: 0 }) if at_y => {}
            Err(CommandError::HomingFailed { axis: 0, swapped, .. }) => {
                // A stall signal is gone once the motor is at rest; a switch can be read, unless it
                // was triggered before.
                assert_eq!(swapped, (!stalls && !at_x).then_some(1), "{}", profile.name);
            }
            other => panic!("{}: {other:?}", profile.name),
        }
        assert!(places.said.borrow().contains("swapped"), "{}", places.said.borrow());
        assert_eq!(places.pushed_10nm()[2][0], 0);
    });
}

/// Spikes on Z: it homes, or homing fails by name; it never ends too low.
#[test]
fn spikes_on_z_leave_the_nozzle_above_the_bed() {
    from_everywhere(with_fault(2, SensorFault::Spiking), |profile, places, _, outcome| {
        match outcome {
            Ok(()) => {}
            Err(CommandError::HomingDisagrees { axis: 2, .. }) => {}
            other => panic!("{}: {other:?}", profile.name),
        }
        assert_eq!(places.pushed_10nm()[2][0], 0);
    });
}

/// A probe that dies after it has homed once: the known height bounds the next approach, from any
/// place of the nozzle.
#[test]
fn a_z_sensor_that_dies_after_homing_presses_half_a_millimetre_at_most() {
    for name in ["cartesian", "corexy", "prusa-mini"] {
        let profile = profile(name);
        for seed in share_of(PLACES) {
            let places = Places::new(start(&profile, HEALTHY, seed).mechanics);
            let mut printer = printer(&profile, &places);
            execute(&mut printer, "G28").unwrap();
            let mut cases = Chance::new(seed ^ 0x5eed);
            let mut mm = |size_10nm: i64| cases.next() % (size_10nm / MM).unsigned_abs().max(1);
            let [x, y, z] = profile.size_10nm.map(&mut mm);
            execute(&mut printer, &format!("G1 X{x} Y{y} Z{z} F6000")).unwrap();
            places.mechanics.borrow_mut().sensors[2].fault = SensorFault::AlwaysOff;
            for _ in 0..3 {
                let outcome = execute(&mut printer, "G28");
                assert!(
                    matches!(outcome, Err(CommandError::HomingFailed { axis: 2, .. })),
                    "{name} {seed}: {outcome:?}"
                );
                let pressed = places.pushed_10nm()[2][0];
                assert!(pressed <= MAX_PRESS_10NM, "{name} {seed}: {pressed}");
            }
        }
    }
}

/// A limit: if Z has not been homed since power-on, an approach cannot distinguish a high nozzle
/// from a sensor that never triggers. Z goes down by the travel at most, and only once.
#[test]
fn a_dead_z_sensor_presses_once_as_documented() {
    from_everywhere(with_fault(2, SensorFault::AlwaysOff), |profile, places, true_10nm, outcome| {
        assert!(matches!(outcome, Err(CommandError::HomingFailed { axis: 2, .. })), "{}: {outcome:?}", profile.name);
        assert!(places.said.borrow().contains("is the sheet on it"), "{}", places.said.borrow());
        let highest = profile.size_10nm[2] + profile.homing[2].overrun_10nm;
        let pressed = places.pushed_10nm()[2][0];
        assert!(pressed <= highest - true_10nm[2] + MAX_PRESS_10NM, "{}: {pressed}", profile.name);
    });
    for name in ["cartesian", "corexy", "prusa-mini"] {
        let profile = profile(name);
        for seed in share_of(1000) {
            let Start { mechanics, .. } = start(&profile, with_fault(2, SensorFault::AlwaysOff), seed);
            let places = Places::new(mechanics);
            let mut printer = printer(&profile, &places);
            execute(&mut printer, "G28").unwrap_err();
            let once = places.pushed_10nm()[2][0];
            for _ in 0..3 {
                execute(&mut printer, "G28").unwrap_err();
                assert!(places.pushed_10nm()[2][0] <= once + MAX_PRESS_10NM, "{name} {seed}");
            }
        }
    }
}
