//! A probe whose pin a servo's signal moves.

use ferrostep_checked_toml::{Range, Section, range};
use ferrostep_printer::{AxisHoming, BlTouch, MeshSettings, SafeHoming};

const MOVE: Range = range(100.0, 5_000.0, "ms");

/// Klipper's `pin_move_time`.
const DEFAULT_MOVE_MS: f64 = 680.0;

/// Maximum distance of a deployed pin below the place where it triggers, mm: it goes in a
/// little before that.
const PIN_MM: f64 = 2.0;

/// Maximum time on the bed after the signal for a pin that is not called in, s; after that it
/// raises its alarm.
const ALARM_S: f64 = 0.65;

/// The probe's pin; `None`: it is fixed.
pub(crate) fn bltouch(
    keys: &Section<'_>,
    is_probe: bool,
    z: &AxisHoming,
    safe: &SafeHoming,
    mesh: Option<&MeshSettings>,
) -> Option<BlTouch> {
    let apart = keys.apart();
    let table = apart.optional_section(
        "bltouch",
        "the probe is fixed",
        "[probe with a pin](homing.md#a-probe-with-a-pin) that is deployed for each touch (BLTouch, 3DTouch, \
         CR-Touch), on the board's `servo` output",
    )?;
    let move_ms = table.number("move_ms", MOVE).or(DEFAULT_MOVE_MS, "time allowed for the pin to deploy or stow");
    let stows_each_touch = table
        .flag("stow_each_touch")
        .or(true, "the pin is also stowed and deployed between the fast and the slow approach");
    let tests_signal = table.flag("test_signal").or(
        true,
        "before deploying, the pin must read as triggered in touch mode, which detects a loose wire; some clones have \
         no such mode",
    );
    if !is_probe {
        keys.refuse("bltouch", "homing.z.sensor = \"probe\" with it: only a probe has a pin");
    }
    let mm = |length_10nm: i64| length_10nm as f64 / 100_000.0;
    let [.., offset_10nm] = safe.probe_offset_10nm;
    let least_mm = mm(-offset_10nm).max(0.0) + PIN_MM;
    let why = |what: &str| {
        format!(
            "at least {least_mm} mm with the table [bltouch]: the pin may be deployed {what}, and then reaches below \
             the nozzle"
        )
    };
    if mm(safe.raise_10nm) < least_mm {
        keys.refuse("homing.raise_mm", why("while X and Y move"));
    } else if mesh.is_some_and(|mesh| mm(mesh.lift_10nm) < least_mm) {
        keys.refuse("mesh.lift_mm", why("where a point is probed"));
    }
    if mm(z.back_off_10nm) < PIN_MM {
        keys.refuse(
            "homing.z.back_off_mm",
            format!("at least {PIN_MM} mm with the table [bltouch], for the pin to deploy again"),
        );
    }
    if !stows_each_touch && mm(z.back_off_10nm) > ALARM_S * z.fast_mm_per_s {
        let expected = format!(
            "true, or homing.z.back_off_mm at most {ALARM_S} s of homing.z.fast_mm_per_s: a pin that stays on the bed for longer raises its alarm"
        );
        table.refuse("stow_each_touch", expected);
    }
    Some(BlTouch { move_ms: move_ms.round() as u16, stows_each_touch, tests_signal })
}
