//! The power supply: its switch, and the signal of its failure.

use ferrostep_checked_toml::{Range, Section, range};
use ferrostep_printer::{PowerSupply, SupplySignal};

use crate::axes::units_10nm;

/// A module feeds the board for seconds, so that a tenth of one may pass.
const DEBOUNCE: Range = range(0.0, 0.1, "s");
const RISE: Range = range(0.0, 100.0, "mm");

/// The power supply, if the board can switch it.
pub(crate) fn power_supply(keys: &Section<'_>) -> Option<PowerSupply> {
    let table = keys.optional_section(
        "power_supply",
        "it cannot be switched",
        "[M80 and M81](gcode.md#a-supply-that-is-switched) switch it, and a [halt](safety.md#a-supply-that-is-switched-off) switches it off; \
         its pin is the board's `power_supply`",
    )?;
    Some(PowerSupply {
        on_is_low: table
            .flag("on_is_low")
            .required("whether the pin is low while the supply is on, as ATX supplies want it"),
        on_at_start: table.flag("on_at_start").or(true, "whether it is on when the firmware starts"),
    })
}

/// The signal of a failing supply, if the machine has a module for it.
pub(crate) fn supply_signal(keys: &Section<'_>) -> Option<SupplySignal> {
    let table = keys.optional_section(
        "power_loss",
        "no signal",
        "a module that feeds the board for some seconds more, and says so: [the place of a print is kept](power-loss.md#a-module-that-says-it) \
         at once; its pin is the board's `power_loss`",
    )?;
    Some(SupplySignal {
        failing_is_low: table.flag("failing_is_low").required("whether the pin is low while the supply fails"),
        rise_10nm: units_10nm(
            table.number("rise_mm", RISE).or(
                0.0,
                "by how much the nozzle rises from the print then, if the module feeds the motors for so long",
            ),
        ),
        debounce_ms: (table.number("debounce_s", DEBOUNCE).or(0.006, "how long it must say so") * 1e3).round() as u16,
    })
}
