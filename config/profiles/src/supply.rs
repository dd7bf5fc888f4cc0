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
        "not switchable",
        "supply that [M80 and M81](gcode.md#a-supply-that-is-switched) switch, and a \
         [halt](safety.md#a-supply-that-is-switched-off) switches off; its pin is the board's `power_supply`",
    )?;
    Some(PowerSupply {
        on_is_low: table
            .flag("on_is_low")
            .required("whether the pin is low while the supply is on, as for ATX supplies"),
        on_at_start: table.flag("on_at_start").or(true, "whether the supply is on at start-up"),
    })
}

/// The signal of a failing supply, if the machine has a module for it.
pub(crate) fn supply_signal(keys: &Section<'_>) -> Option<SupplySignal> {
    let table = keys.optional_section(
        "power_loss",
        "no signal",
        "module that signals a power loss and feeds the board for some more seconds: [the print's position is \
         saved](power-loss.md#a-module-that-says-it) at once; its pin is the board's `power_loss`",
    )?;
    Some(SupplySignal {
        failing_is_low: table.flag("failing_is_low").required("whether the pin is low while the supply fails"),
        rise_10nm: units_10nm(table.number("rise_mm", RISE).or(
            0.0,
            "height the nozzle is raised from the print on power loss, if the module feeds the motors long enough",
        )),
        debounce_ms: (table.number("debounce_s", DEBOUNCE).or(0.006, "time the signal must be stable") * 1e3).round()
            as u16,
    })
}
