//! An Octopus with all that a profile may add, in one image: a supply and a light that are
//! switched, a module that says that the supply fails, a probe with a pin, a chamber, and a sensor
//! that sees filament move with a switch beside it. It fits the flash, or it is not built.

use std::sync::OnceLock;

use ferrostep_testkit::boards::{BOARDS, BoardFacts};

use crate::firmware::bench::Bench;
use crate::firmware::images::{Variant, changed};

/// Detection length of the sensor by its maker, mm.
pub const DETECTION_MM: f64 = 3.0;

/// A supply that is on while its input is low, as ATX supplies are, a module at
/// PWR-DET, and a light.
const SUPPLY_AND_LIGHT: &str = r#"
[power_supply]
on_is_low = true

[power_loss]
failing_is_low = false
rise_mm = 5

[outputs.light]
output = "fan2"
number = 0
pwm = true
at_start = 0.5
at_halt = 1
"#;

/// A box so small that a test need not wait.
const CHAMBER: &str = r#"
[chamber]
thermistor = "nozzle2"
heater = "nozzle1"
sensor = "epcos-100k"
min_celsius = 5
max_celsius = 80
proportional = 0.5
integral = 0.001
derivative = 0
residency_window_celsius = 2
residency_s = 1
model = { power_w = 100, capacity_j_per_k = 50, loss_w_per_k = 0.5 }
"#;

/// Profile of the probe: offset from the nozzle to the pin; the model triggers 2 mm above the bed.
const PROBE: &str = r#"
[homing]
raise_mm = 10
home_at_mm = { x = 150, y = 150 }
probe_offset_mm = { x = -40, y = -10, z = -2 }

[mesh]
points = { x = 3, y = 3 }
lift_mm = 6

[homing.z]
end = "min"
sensor = "probe"
position_mm = 0
fast_mm_per_s = 10
slow_mm_per_s = 2
back_off_mm = 3

[bltouch]
"#;

/// The switch beside the sensor that sees filament move, which connects its pin to the supply while
/// there is filament.
const SWITCH: &str = "[filament_switch]\nmissing_is_low = true\n";

/// The board.
pub fn octopus() -> &'static BoardFacts {
    BOARDS.iter().find(|board| board.name == "btt-octopus-1.1").unwrap()
}

/// Image of the equipped board, which is built once.
pub fn equipped() -> &'static Variant {
    static BUILT: OnceLock<Variant> = OnceLock::new();
    BUILT.get_or_init(|| {
        let sensor = format!("\n[filament_sensor]\nkind = \"motion\"\ndetection_mm = {DETECTION_MM}\n{SWITCH}");
        let equip =
            |profile: String| [&without_homing_of_z(&profile), SUPPLY_AND_LIGHT, CHAMBER, &sensor, PROBE].concat();
        changed("btt-octopus-1.1", "corexy", "octopus-equipped", |board| board, equip)
    })
}

/// A profile without its switch of Z.
pub fn without_homing_of_z(profile: &str) -> String {
    const HEADER: &str = "[homing.z]\n";
    let (before, rest) = profile.split_once(HEADER).unwrap();
    let (_, after) = rest.split_once("\n\n").unwrap_or((rest, ""));
    [before, after].concat()
}

/// Switches it on.
pub fn boot() -> Bench {
    let Variant { board, profile, image } = equipped();
    Bench::boot_variant(octopus(), board, profile, image)
}
