//! Puts the linker's memory map and the machine's profile where the firmware's build finds them.
//!
//! The memories are those of the board that `FERROSTEP_BOARD` names, by name or path; the bench if nothing does.
//! `FERROSTEP_BOOT_OFFSET` has the image begin at another place of its flash. The
//! profile is the TOML that the desk reads too, checked by the same code and held against the board, written out as a
//! Rust constant: one source of numbers. `FERROSTEP_PROFILE` names another profile than the board's, by name or path.

use std::path::{Path, PathBuf};
use std::{env, fs};

use ferrostep_hal_shim::thermistor::{Thermistor, ThermistorType};
use ferrostep_planner::{DualRatePeriods, Kinematics, Limits, MotionChoice, SCurveTableSettings, StepsPerMm};
use ferrostep_printer::{
    AxisHoming, DriverTiming, ExtrusionSettings, FirmwareRetraction, HeaterSettings, HeaterWatch, HomeEnd, Profile,
};
use ferrostep_version::Version;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let out = PathBuf::from(env::var("OUT_DIR")?);
    let root = Path::new(&env::var("CARGO_MANIFEST_DIR")?).join("..");
    let memory = root.join("memory.x");
    fs::copy(&memory, out.join("memory.x"))?;
    println!("cargo:rustc-link-search={}", out.display());
    println!("cargo:rerun-if-changed={}", memory.display());
    // The tests' names and places, for the one who runs them over a debug probe.
    println!("cargo:rustc-link-arg-bin=on-target=-Tembedded-test.x");

    let board_name = env::var("FERROSTEP_BOARD").unwrap_or_else(|_| ferrostep_boards::DEFAULT.to_owned());
    let board = ferrostep_boards::load(&board_name).map_err(|error| error.to_string())?;
    let board = match env::var("FERROSTEP_BOOT_OFFSET") {
        Ok(text) => {
            board.at_boot_offset(text.parse().map_err(|_| format!("FERROSTEP_BOOT_OFFSET={text}: expected bytes"))?)?
        }
        Err(_) => board,
    };
    println!("cargo:rerun-if-env-changed=FERROSTEP_BOOT_OFFSET");
    fs::write(out.join("memories.x"), ferrostep_boards::constants::memories(&board))?;
    println!("cargo:rerun-if-env-changed=FERROSTEP_BOARD");

    let name = env::var("FERROSTEP_PROFILE").unwrap_or_else(|_| board.profile.clone());
    let profile = ferrostep_profiles::load(&name).map_err(|error| error.to_string())?;
    ferrostep_boards::fit::check(&board, &profile, &name).map_err(|error| error.to_string())?;
    fs::write(out.join("profile.rs"), constant(&profile))?;
    fs::write(out.join("identity.rs"), identity(&root, &board.name, profile.name))?;
    // What looks after drivers is not compiled where there are none.
    println!("cargo:rustc-check-cfg=cfg(drivers)");
    if ferrostep_boards::fit::wiring(&board, &profile).iter().any(Option::is_some) {
        println!("cargo:rustc-cfg=drivers");
    }
    fs::write(out.join("drivers.rs"), ferrostep_boards::constants::drivers(&board, &profile))?;
    fs::write(out.join("sensors.rs"), ferrostep_boards::constants::sensors(&board, &profile))?;
    fs::write(out.join("step_signals.rs"), step_signals(&profile.driver))?;
    println!("cargo:rerun-if-env-changed=FERROSTEP_PROFILE");
    for file in [board_name, name] {
        if Path::new(&file).exists() {
            println!("cargo:rerun-if-changed={file}");
        }
    }
    Ok(())
}

/// What goes into an image.
const SOURCES: [&str; 15] = [
    "Cargo.lock",
    "Cargo.toml",
    "memory.x",
    "app",
    "boards",
    "checked-toml",
    "gcode",
    "gpre",
    "hal-shim",
    "planner",
    "printer",
    "profiles",
    "square-root",
    "usb",
    "version",
];

/// What an image says it is, `ferrostep 0.1.0 (commit abcdef0) prusa-buddy prusa-mini`, and where in that the version is.
fn identity(root: &Path, board: &str, profile: &str) -> String {
    let version = Version::of(env!("CARGO_PKG_VERSION"), root, &SOURCES);
    version.watch();
    let name = "ferrostep ";
    let (from, to) = (name.len(), name.len() + version.text.len());
    // A line of its own among the image's texts.
    let text = format!("{name}{} {board} {profile}\n", version.text);
    format!("Identity {{ text: {text:?}, version: {from}..{to} }}")
}

/// The profile as an expression. Every field is taken apart by name, so that a new one cannot be forgotten here.
/// `{:?}` of a float is the shortest text that reads back as the same number.
fn constant(profile: &Profile) -> String {
    let Profile {
        name,
        kinematics,
        size_10nm,
        lower_end_10nm,
        steps_per_mm,
        limits,
        motion,
        minimum_event_interval_ticks,
        event_cost_ticks,
        move_cost_ticks,
        homing: [home_x, home_y, home_z],
        safe_homing,
        min_extrusion_celsius,
        heater_timeout_s,
        nozzle,
        bed,
        retraction,
        driver,
        extrusion,
        drivers,
    } = profile;
    let kinematics = match kinematics {
        Kinematics::Cartesian => "Cartesian",
        Kinematics::CoreXy => "CoreXy",
    };
    let steps_per_mm: Vec<String> = steps_per_mm.iter().map(steps).collect();
    let FirmwareRetraction { length_10nm, retract_10nm_per_s, extra_recover_10nm, recover_10nm_per_s, lift_10nm } =
        retraction;
    let ExtrusionSettings { adaptive, layer_height_10nm, line_width_10nm, filament_diameter_10nm } = extrusion;
    let DriverTiming { pulse_width_ns, direction_setup_ns, both_edges, inverted } = driver;
    format!(
        "Profile {{ name: {name:?}, kinematics: Kinematics::{kinematics}, size_10nm: {size_10nm:?}, \
         lower_end_10nm: {lower_end_10nm:?}, safe_homing: {safe_homing:?}, \
         steps_per_mm: [{}], limits: {}, motion: {}, \
         minimum_event_interval_ticks: {minimum_event_interval_ticks}, event_cost_ticks: {event_cost_ticks}, \
         move_cost_ticks: {move_cost_ticks}, homing: [{}, {}, {}], \
         min_extrusion_celsius: {min_extrusion_celsius:?}, heater_timeout_s: {heater_timeout_s}, nozzle: {}, bed: {}, \
         retraction: FirmwareRetraction {{ length_10nm: {length_10nm}, retract_10nm_per_s: {retract_10nm_per_s}, \
         extra_recover_10nm: {extra_recover_10nm}, recover_10nm_per_s: {recover_10nm_per_s}, lift_10nm: {lift_10nm} }}, \
         driver: DriverTiming {{ pulse_width_ns: {pulse_width_ns}, direction_setup_ns: {direction_setup_ns}, \
         both_edges: {both_edges}, inverted: {inverted} }}, \
         extrusion: ExtrusionSettings {{ adaptive: {adaptive}, layer_height_10nm: {layer_height_10nm}, \
         line_width_10nm: {line_width_10nm}, filament_diameter_10nm: {filament_diameter_10nm} }}, drivers: {} }}",
        steps_per_mm.join(", "),
        limits_constant(limits),
        motion_constant(motion),
        homing(home_x),
        homing(home_y),
        homing(home_z),
        heater(nozzle),
        heater(bed),
        driver_settings(drivers),
    )
}

/// Settings of the drivers: all fields are plain numbers and flags, as `Debug` shows them.
fn driver_settings(drivers: &impl std::fmt::Debug) -> String {
    format!("{drivers:?}").replace("DriverSettings", "ferrostep_hal_shim::tmc2209::DriverSettings")
}

/// How the step interrupt makes a step, as a type: it is compiled for that one way.
fn step_signals(driver: &DriverTiming) -> String {
    let name = if driver.both_edges { "BothEdges" } else { "Pulses" };
    format!("/// What the drivers take for a step.\npub type StepSignals = ferrostep_hal_shim::stepping::{name};\n")
}

fn steps(steps: &StepsPerMm) -> String {
    format!("steps_per_mm({})", steps.hundred_thousandths())
}

fn limits_constant(limits: &Limits) -> String {
    let Limits {
        max_feed_mm_per_s,
        max_acceleration_mm_per_s2,
        print_acceleration_mm_per_s2,
        travel_acceleration_mm_per_s2,
        retract_acceleration_mm_per_s2,
        junction_deviation_mm,
        instantaneous_corner_velocity_mm_per_s,
    } = limits;
    format!(
        "Limits {{ max_feed_mm_per_s: {max_feed_mm_per_s:?}, max_acceleration_mm_per_s2: {max_acceleration_mm_per_s2:?}, \
         print_acceleration_mm_per_s2: {print_acceleration_mm_per_s2:?}, \
         travel_acceleration_mm_per_s2: {travel_acceleration_mm_per_s2:?}, \
         retract_acceleration_mm_per_s2: {retract_acceleration_mm_per_s2:?}, \
         junction_deviation_mm: {junction_deviation_mm:?}, instantaneous_corner_velocity_mm_per_s: {} }}",
        corner_velocities(instantaneous_corner_velocity_mm_per_s)
    )
}

/// `Debug` shows an infinite number as no literal.
fn corner_velocities(limits: &[f64; 4]) -> String {
    let [x, y, z, e] =
        limits.map(|limit| if limit.is_finite() { format!("{limit:?}") } else { "f64::INFINITY".to_owned() });
    format!("[{x}, {y}, {z}, {e}]")
}

fn motion_constant(motion: &MotionChoice) -> String {
    let MotionChoice { interpolation, acceleration, jerk_mm_per_s3, dual_rate, s_curve_table } = motion;
    let DualRatePeriods { shortest_ns, longest_ns } = dual_rate;
    let SCurveTableSettings { start_hz, top_hz, jerk_hz_per_s2 } = s_curve_table;
    // The names of the choices are those that `Debug` shows.
    format!(
        "MotionChoice {{ interpolation: Interpolation::{interpolation:?}, \
         acceleration: AccelerationProfile::{acceleration:?}, jerk_mm_per_s3: {jerk_mm_per_s3:?}, \
         dual_rate: DualRatePeriods {{ shortest_ns: {shortest_ns}, longest_ns: {longest_ns} }}, \
         s_curve_table: SCurveTableSettings {{ start_hz: {start_hz}, top_hz: {top_hz}, \
         jerk_hz_per_s2: {jerk_hz_per_s2} }} }}"
    )
}

fn homing(homing: &AxisHoming) -> String {
    let AxisHoming {
        end,
        sensor,
        triggers_low,
        position_10nm,
        fast_mm_per_s,
        slow_mm_per_s,
        back_off_10nm,
        overrun_10nm,
        agree_10nm,
    } = homing;
    let end = match end {
        HomeEnd::Min => "Min",
        HomeEnd::Max => "Max",
    };
    format!(
        "AxisHoming {{ end: HomeEnd::{end}, sensor: HomeSensor::{sensor:?}, triggers_low: {triggers_low}, \
         position_10nm: {position_10nm}, \
         fast_mm_per_s: {fast_mm_per_s:?}, slow_mm_per_s: {slow_mm_per_s:?}, back_off_10nm: {back_off_10nm}, \
         overrun_10nm: {overrun_10nm}, agree_10nm: {agree_10nm} }}"
    )
}

fn heater(heater: &HeaterSettings) -> String {
    let HeaterSettings {
        thermistor: Thermistor { kind, pull_up_ohm },
        min_celsius,
        max_celsius,
        max_target_celsius,
        watch: HeaterWatch { watch_ms, watch_celsius, runaway_ms, runaway_celsius },
        proportional,
        integral,
        derivative,
        residency_window_celsius,
        residency_ms,
        mass,
    } = heater;
    let kind = match kind {
        ThermistorType::Semitec104Gt2 => "Semitec104Gt2".to_owned(),
        ThermistorType::Epcos100k => "Epcos100k".to_owned(),
        ThermistorType::Beta { r25_ohm, beta_k } => format!("Beta {{ r25_ohm: {r25_ohm:?}, beta_k: {beta_k:?} }}"),
    };
    format!(
        "HeaterSettings {{ thermistor: Thermistor {{ kind: ThermistorType::{kind}, pull_up_ohm: {pull_up_ohm:?} }}, \
         min_celsius: {min_celsius:?}, max_celsius: {max_celsius:?}, \
         max_target_celsius: {max_target_celsius:?}, \
         watch: HeaterWatch {{ watch_ms: {watch_ms}, watch_celsius: {watch_celsius:?}, runaway_ms: {runaway_ms}, \
         runaway_celsius: {runaway_celsius:?} }}, proportional: {proportional:?}, integral: {integral:?}, derivative: {derivative:?}, residency_window_celsius: {residency_window_celsius:?}, \
         residency_ms: {residency_ms}, mass: ferrostep_hal_shim::virtual_board::{mass:?} }}"
    )
}
