//! The keys of a profile outside all tables; each table has its own file.

use ferrostep_checked_toml::{Range, Section, range};
use ferrostep_planner::{Kinematics, Limits, StepsPerMm, TICKS_PER_SECOND};
use ferrostep_printer::{
    DEFAULT_EVENTS_PER_S, DEFAULT_HEATER_TIMEOUT_S, DEFAULT_MOVES_PER_S, HomeSensor, Profile, SQUARE_CORNER_SHARE,
};

use crate::axes::{AXES, FEED, MOTORS, Travel, units_10nm};
use crate::drivers::{self, MIN_GAP_US};
use crate::error_budget::{self, ErrorBudget};
use crate::filament_sensor::{filament_sensor, filament_switch};
use crate::rules::{self, RuleKeys};
use crate::{
    backlash, bed_screws, bltouch, extrusion, fans, heaters, homing, macros, mesh, motion, pause, skew, supply, tools,
    z_motors,
};

/// Ticks of the nominal time base in a microsecond.
const TICKS_PER_US: f64 = TICKS_PER_SECOND as f64 / 1e6;

const SIZE: Range = range(10.0, 2_000.0, "mm");
const LOWER_END: Range = range(-1_000.0, 0.0, "mm");
const STEPS_PER_MM: Range = range(1.0, 10_000.0, "steps/mm");
const ACCELERATION: Range = range(0.1, 100_000.0, "mm/s^2");
const JUNCTION_DEVIATION: Range = range(0.000_1, 1.0, "mm");
/// Maximum difference between the two settings of the speed in a corner, as a share of it.
const CORNER_TOLERANCE: f64 = 0.05;
const CORNER_VELOCITY: Range = range(0.001, 1_000.0, "mm/s");
// A step has two levels or, at its closest, a direction change before it: each takes a gap of
// the step interrupt.
const EVENT_INTERVAL: Range = range(2.0 * MIN_GAP_US, 100.0, "us");
const MIN_EXTRUSION: Range = range(0.0, 400.0, "degrees Celsius");
const HEATER_TIMEOUT: Range = range(0.0, 65_535.0, "s");
const EVENTS_PER_S: Range = range(1_000.0, 10_000_000.0, "events/s");
const MOVES_PER_S: Range = range(10.0, 1_000_000.0, "moves/s");

const NOZZLE_DIAMETER: Range = range(0.05, 5.0, "mm");
const VOLUMETRIC_FLOW: Range = range(0.1, 1_000.0, "mm^3/s");

/// Longest name, bytes.
const MAX_NAME: usize = 32;
/// Longest list of names, bytes.
const MAX_MODEL_NAMES: usize = 64;

/// A machine's keys, checked.
pub(crate) struct Machine {
    /// The machine without its texts.
    pub profile: Profile,
    /// The machine's name, its models' names and its macros, which a [`Profile`] needs `'static`.
    pub texts: [String; 3],
    /// The error budget and the frame, which only the desk needs.
    pub budget: ErrorBudget,
    /// The rules of other firmwares, which only the desk needs.
    pub rules: RuleKeys,
}

/// Reads the machine.
///
/// A prepared job is bound to every key but those that are read `apart`: these change neither the
/// plan nor the demands of the plan on the machine.
pub(crate) fn profile(keys: &Section<'_>) -> Machine {
    let apart = keys.apart();
    let name = name(&apart);
    let model_names = model_names(&apart);
    let nozzle_diameter_mm = apart
        .number("nozzle_diameter_mm", NOZZLE_DIAMETER)
        .optional("not checked", "nozzle diameter: jobs for another are refused (M862.1)");
    let kinematics = keys
        .word("kinematics", Kinematics::ALL.map(|kinematics| (kinematics.name(), kinematics)))
        .required("one motor per axis; or motors A = X + Y, B = X − Y; or motors A = X + Z, C = X − Z");
    let travel = Travel {
        upper_mm: keys.numbers("size_mm", AXES, [SIZE; 3]).required("upper end of the travel in machine coordinates"),
        lower_mm: keys
            .numbers("lower_end_mm", AXES, [LOWER_END; 3])
            .or([0.0; 3], "lower end of the travel in machine coordinates"),
    };
    let steps_per_mm = keys.numbers("steps_per_mm", MOTORS, [STEPS_PER_MM; 4]).required(
        "microsteps per mm, to five decimals; on CoreXY, x and y are motors A and B; on CoreXZ, x and z are \
         motors A and C",
    );
    let mut limits = limits(keys);
    let corner_speed = corner_speed(keys, &limits);
    let motion = motion::motion(keys);
    let budget_of_error = error_budget::read(keys);
    budget_of_error.apply(keys, &motion, &steps_per_mm, &mut limits);
    let interval_us = keys
        .number("minimum_event_interval_us", EVENT_INTERVAL)
        .required("step events closer together than this are output as one");
    motor_rates(keys, kinematics, steps_per_mm, &limits, interval_us);
    if motion::is_shaped(&motion) {
        motors_are_alike(keys, kinematics, steps_per_mm);
    }
    // ANCHOR: min_extrusion
    let min_extrusion = keys
        .number("min_extrusion_celsius", MIN_EXTRUSION)
        .required("nozzle temperature below which extrusion is refused (M302); below `nozzle.max_celsius`");
    // ANCHOR_END: min_extrusion
    let max_flow = apart
        .number("max_volumetric_flow_mm3_per_s", VOLUMETRIC_FLOW)
        .optional("not checked", "maximum flow that the nozzle melts: `print` and `estimate` report moves above it");
    let heater_timeout_s = apart.number("heater_timeout_s", HEATER_TIMEOUT).or(
        DEFAULT_HEATER_TIMEOUT_S.into(),
        "heaters switch off after this time [without a line from a host and without \
         motion](safety.md#a-host-that-has-gone); 0 = never (M86)",
    );
    let timing = drivers::timing(&apart, interval_us);
    let drivers = drivers::drivers(&apart, steps_per_mm, timing.both_edges);
    let (homing, safe_homing) = homing::homing(keys, &travel, steps_per_mm, &limits, &drivers);
    let is_probe = homing[2].sensor == HomeSensor::Probe;
    let mesh = mesh::mesh(keys, &travel, &safe_homing, is_probe, kinematics);
    let bltouch = bltouch::bltouch(keys, is_probe, &homing[2], &safe_homing, mesh.as_ref());
    let bed_screws =
        bed_screws::bed_screws(&apart, &mesh::reach_mm(&travel, &safe_homing), &safe_homing, mesh.is_some());
    let [(nozzle, nozzle_model), (bed, bed_model)] = heaters::heaters(keys);
    let reach_mm = mesh::reach_mm(&travel, &safe_homing);
    let z_motors = z_motors::z_motors(&apart, &reach_mm, &safe_homing, mesh.is_some(), !kinematics.shares_motors(2));
    let (fans, chamber) = (fans::fans(&apart), heaters::chamber(&apart));
    let [.., e_steps_per_mm] = steps_per_mm;
    let first = tools::First {
        steps_per_mm: e_steps_per_mm,
        most_steps_per_mm: 1e6 / interval_us / limits.max_feed_mm_per_s[3],
        advance: motion.pressure_advance,
        nozzle: &nozzle,
        fans: &fans,
        z_motors,
        both_edges: timing.both_edges,
        chamber: [chamber.map(|chamber| chamber.thermistor), chamber.and_then(|chamber| chamber.heater)],
    };
    let tools = tools::tools(&apart, &first);
    if min_extrusion as f32 >= nozzle.max_celsius {
        let expected = format!("less than nozzle.max_celsius = {}", nozzle.max_celsius);
        keys.refuse("min_extrusion_celsius", expected);
    }
    let budget = keys.section_of_defaults(
        "budget",
        "what the board's processor can keep up with; moves beyond it are [slowed down](planning.md#the-budget)",
    );
    let events_per_s = budget
        .number("events_per_s", EVENTS_PER_S)
        .or(DEFAULT_EVENTS_PER_S.into(), "maximum rate of step events, with no other motion work");
    let moves_per_s = budget
        .number("moves_per_s", MOVES_PER_S)
        .or(DEFAULT_MOVES_PER_S.into(), "maximum rate of moves, with no other motion work");
    let filament = filament_sensor(&apart);
    let rules = rules::read(keys, corner_speed);
    let profile = Profile {
        name: "",
        model_names: "",
        macros: "",
        nozzle_diameter_mm: nozzle_diameter_mm.map(|diameter_mm| diameter_mm as f32),
        max_volumetric_flow_mm3_per_s: max_flow.map(|flow| flow as f32),
        plan_hash: 0,
        kinematics,
        size_10nm: travel.upper_mm.map(units_10nm),
        lower_end_10nm: travel.lower_mm.map(units_10nm),
        steps_per_mm: steps_per_mm.map(StepsPerMm::nearest),
        limits,
        motion,
        minimum_event_interval_ticks: (interval_us * TICKS_PER_US).round() as u32,
        event_cost_ticks: cost_ticks(events_per_s),
        move_cost_ticks: cost_ticks(moves_per_s),
        skew: skew::skew(&apart),
        backlash: backlash::backlash(&apart, kinematics),
        homing,
        safe_homing,
        bltouch,
        mesh,
        bed_screws,
        z_motors,
        tools,
        holds_corner_speed: corner_speed.is_some(),
        min_extrusion_celsius: min_extrusion as f32,
        heater_timeout_s: heater_timeout_s.round() as u16,
        nozzle,
        bed,
        control_models: [nozzle_model, bed_model],
        chamber,
        pause: pause::pause(&apart, &travel),
        fans,
        filament_sensor: filament,
        filament_switch: filament_switch(&apart, filament),
        power_supply: supply::power_supply(&apart),
        supply_signal: supply::supply_signal(&apart),
        retraction: extrusion::retraction(&apart),
        driver: timing,
        extrusion: extrusion::extrusion(&apart),
        drivers,
    };
    let at_change = tools.map_or([None; 2], |tools| [tools.0.change.before, tools.0.change.after]);
    let texts = [name, model_names, macros::macros(&apart, at_change)];
    Machine { profile, texts, budget: budget_of_error, rules }
}

/// Names that slicers give the machine.
fn model_names(keys: &Section<'_>) -> String {
    let expected =
        format!("1 to {MAX_MODEL_NAMES} printable ASCII characters, names separated by commas, none of them blank");
    let is_right = |names: &str| {
        let is_printable = names.bytes().all(|byte| byte == b' ' || byte.is_ascii_graphic());
        is_printable && names.len() <= MAX_MODEL_NAMES && names.split(',').all(|name| !name.trim().is_empty())
    };
    let names = keys.text("model_names", &expected, is_right);
    names.optional("not checked", "models of this printer: jobs for others are refused (M862.3)").unwrap_or_default()
}

/// A name that M115 can put into its line.
fn name(keys: &Section<'_>) -> String {
    let expected = format!("1 to {MAX_NAME} printable ASCII characters, not all blank");
    let is_right = |name: &str| {
        let is_printable = name.bytes().all(|byte| byte == b' ' || byte.is_ascii_graphic());
        is_printable && !name.trim().is_empty() && name.len() <= MAX_NAME
    };
    keys.text("name", &expected, is_right).required("machine name in M115 and reports")
}

/// Speeds, accelerations and corners.
fn limits(keys: &Section<'_>) -> Limits {
    let max_feed_mm_per_s =
        keys.numbers("max_feed_mm_per_s", MOTORS, [FEED; 4]).required("maximum speed of each axis (M203)");
    let max_acceleration_mm_per_s2 = keys
        .numbers("max_acceleration_mm_per_s2", MOTORS, [ACCELERATION; 4])
        .required("maximum acceleration of each axis (M201)");
    let [print, travel, retract] = keys
        .numbers("acceleration_mm_per_s2", ["print", "travel", "retract"], [ACCELERATION; 3])
        .required("acceleration of printing, travel and extruder-only moves (M204 P, T, R)");
    let junction_deviation_mm = keys
        .number("junction_deviation_mm", JUNCTION_DEVIATION)
        .required("distance from a corner to the virtual arc that sets its speed (M205 J)");
    let corner = keys.section_of_defaults(
        "instantaneous_corner_velocity_mm_per_s",
        "maximum instantaneous speed change of an axis [at a corner](planning.md#each-axis-at-a-corner), whatever the \
         arc allows (M205 X Y Z E, \"jerk\")",
    );
    let unlimited = |axis| {
        let limit = corner
            .number(axis, CORNER_VELOCITY)
            .optional("no limit but the arc's", "without this key M205 sets no limit either");
        limit.unwrap_or(f64::INFINITY)
    };
    let limited = |axis, default| corner.number(axis, CORNER_VELOCITY).or(default, "");
    Limits {
        max_feed_mm_per_s,
        max_acceleration_mm_per_s2,
        print_acceleration_mm_per_s2: print,
        travel_acceleration_mm_per_s2: travel,
        retract_acceleration_mm_per_s2: retract,
        junction_deviation_mm,
        // Z has half of the extruder's value, as makers of printers with such a limit choose it.
        instantaneous_corner_velocity_mm_per_s: [unlimited("x"), unlimited("y"), limited("z", 5.0), limited("e", 10.0)],
    }
}

/// The speed of a square corner, mm/s, if corners keep it at every acceleration. The profile then
/// has it besides the deviation, and the two are checked against each other.
fn corner_speed(keys: &Section<'_>, limits: &Limits) -> Option<f64> {
    let about = "speed in a 90° corner at every acceleration, as in Klipper: M204 then changes the junction deviation \
                 instead; must match `junction_deviation_mm` at `acceleration_mm_per_s2.print`";
    // Bound only if it is there: jobs that were prepared before this key existed remain valid.
    let speed = keys
        .apart()
        .number("square_corner_velocity_mm_per_s", CORNER_VELOCITY)
        .optional("junction deviation stays fixed, and M204 changes the cornering speed", about);
    let speed = speed?;
    keys.bind("square_corner_velocity_mm_per_s", &speed);
    let made = (limits.junction_deviation_mm * limits.print_acceleration_mm_per_s2 / SQUARE_CORNER_SHARE).sqrt();
    if (speed - made).abs() > CORNER_TOLERANCE * made {
        let [low, high] =
            [1.0 - CORNER_TOLERANCE, 1.0 + CORNER_TOLERANCE].map(|share| (made * share * 1e3).round() / 1e3);
        let expected = format!(
            "{low} to {high} mm/s, which junction_deviation_mm = {} makes at acceleration_mm_per_s2.print = {}",
            limits.junction_deviation_mm, limits.print_acceleration_mm_per_s2
        );
        keys.refuse("square_corner_velocity_mm_per_s", expected);
    }
    Some(speed)
}

/// No motor may have to step more often than events may follow each other.
fn motor_rates(keys: &Section<'_>, kinematics: Kinematics, steps_per_mm: [f64; 4], limits: &Limits, interval_us: f64) {
    let [x, y, z, e] = limits.max_feed_mm_per_s;
    // Both motors of a CoreXY machine turn fastest on a diagonal, by the sum of the speeds.
    let [first, second, third] = kinematics.largest_motor_feeds([x, y, z]);
    let motor_feeds_mm_per_s = [first, second, third, e];
    let highest_per_s = 1e6 / interval_us;
    for ((axis, feed), steps_per_mm) in MOTORS.into_iter().zip(motor_feeds_mm_per_s).zip(steps_per_mm) {
        let steps_per_s = feed * steps_per_mm;
        if steps_per_s > highest_per_s {
            keys.refuse(
                &format!("max_feed_mm_per_s.{axis}"),
                format!(
                    "a motor rate of at most {highest_per_s:.0} steps/s (minimum_event_interval_us = {interval_us}), \
                     not {steps_per_s:.0}: lower it, or steps_per_mm.{axis} with fewer microsteps"
                ),
            );
        }
    }
}

/// Motors that move X or Y together take the sum of two filtered axes, in one unit.
fn motors_are_alike(keys: &Section<'_>, kinematics: Kinematics, steps_per_mm: [f64; 4]) {
    for axis in 0..2 {
        let motors = kinematics.motors_of_axis(axis);
        let mut moved = MOTORS.into_iter().zip(steps_per_mm).zip(0..3).filter(|(_, motor)| motors >> motor & 1 == 1);
        let Some(((first, expected), _)) = moved.next() else { continue };
        for ((name, steps), _) in moved {
            if StepsPerMm::nearest(steps) != StepsPerMm::nearest(expected) {
                let same = format!(
                    "{expected} as that of {first}: with input_shaper or pressure_advance both are the same on {}",
                    kinematics.name()
                );
                keys.refuse(&format!("steps_per_mm.{name}"), same);
            }
        }
    }
}

/// Ticks that each of this many things a second costs, rounded up.
fn cost_ticks(per_s: f64) -> u32 {
    (f64::from(TICKS_PER_SECOND) / per_s).ceil() as u32
}
