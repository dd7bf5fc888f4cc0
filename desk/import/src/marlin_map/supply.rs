//! Marlin's settings of the power supply: what switches it, and what says that it fails.

use super::Reading;

impl Reading<'_> {
    /// The supply that a board switches. It is on at the start unless a definition says otherwise,
    /// and low is on: Marlin's own values.
    pub(super) fn power_supply(&mut self) {
        if self.get("PSU_CONTROL").is_none() {
            return;
        }
        let on_is_low = self.is_low("PSU_ACTIVE_STATE", "power_supply.on_is_low").unwrap_or(true);
        for name in ["PSU_CONTROL", "PSU_ACTIVE_STATE"] {
            self.keep(name, "power_supply.on_is_low", on_is_low, "its pin is the board's");
        }
        self.keep("PSU_DEFAULT_OFF", "power_supply.on_at_start", false, "");
    }

    /// The signal of a module that reports a failing supply. Marlin's boards have a pin for one
    /// with or without a module, so that only a configuration with a setting for it has one.
    pub(super) fn supply_signal(&mut self) {
        let has_pin = self.get("POWER_LOSS_PIN").is_some_and(|definition| definition.value != "-1");
        if self.get("POWER_LOSS_RECOVERY").is_none() || !has_pin && self.get("POWER_LOSS_STATE").is_none() {
            return;
        }
        let failing_is_low = self.is_low("POWER_LOSS_STATE", "power_loss.failing_is_low").unwrap_or(false);
        for name in ["POWER_LOSS_PIN", "POWER_LOSS_STATE"] {
            self.keep(name, "power_loss.failing_is_low", failing_is_low, "its pin is the board's");
        }
        if self.get("BACKUP_POWER_SUPPLY").is_some() {
            self.keep_number("POWER_LOSS_ZRAISE", "power_loss.rise_mm", |rise| rise);
        }
    }
}
