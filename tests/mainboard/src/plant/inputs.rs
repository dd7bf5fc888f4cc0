//! The levels of the chip's input pins.

use serde::{Deserialize, Serialize};

use super::Plant;
use super::eeprom::WiredEeprom;
use crate::parts::bltouch::BlTouch;
use crate::parts::encoder::FilamentEncoder;
use crate::parts::tmc2209::Tmc2209;
use crate::parts::wire::Wire;
use crate::pins::Pin;

/// The part connected to an input pin of the chip.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum Source {
    EndStop(usize),
    Probe,
    BlTouch,
    Diag(usize),
    Tacho(usize),
    Wire(usize),
    Accelerometer,
    Eeprom,
    FilamentEncoder,
    FilamentSwitch,
    /// A module's signal, high while the supply fails.
    SupplyFails,
    /// A button that connects its pin to ground; the pin has a pull-up.
    Button,
    /// The switch in a card's slot, which closes to ground; the pin has a pull-up.
    CardDetect,
    /// Held at a constant level.
    Held(bool),
}

impl Plant {
    /// Takes the changed levels of the chip's inputs; `None` for a floating pin.
    pub fn take_inputs(&mut self) -> Vec<(Pin, Option<bool>)> {
        if !std::mem::take(&mut self.lines_changed) {
            return Vec::new();
        }
        let mut changes = Vec::new();
        for (index, (pin, source)) in self.inputs.iter().enumerate() {
            let level = self.level(*source);
            if self.driven[index] != Some(level) {
                self.driven[index] = Some(level);
                changes.push((*pin, level));
            }
        }
        changes
    }

    /// The level that a part drives; `None` for a floating pin.
    fn level(&self, source: Source) -> Option<bool> {
        match source {
            Source::EndStop(stop) => self.motion.end_stop(stop).map(|stop| stop.level()),
            Source::Probe => self.motion.probe().map(|probe| probe.level()),
            Source::BlTouch => self.bltouch.as_ref().and_then(BlTouch::level),
            Source::Diag(motor) => self.drivers.get(motor).and_then(Tmc2209::diag),
            Source::Tacho(fan) => self.fans.get(fan).map(|fan| fan.fan.tacho()),
            Source::Wire(wire) => self.wires.get(wire).map(Wire::level),
            Source::Accelerometer => self.accelerometer.as_ref().and_then(|part| part.chip.output()),
            Source::Eeprom => self.eeprom.as_ref().and_then(WiredEeprom::sda),
            Source::FilamentEncoder => self.filament_encoder.as_ref().map(FilamentEncoder::level),
            // It connects the pin to the supply while there is filament.
            Source::FilamentSwitch => Some(self.is_filament_at_switch),
            Source::SupplyFails => Some(self.supply_fails),
            Source::Button => Some(!self.is_button_pressed),
            Source::CardDetect => self.is_card_inserted.then_some(false),
            Source::Held(level) => Some(level),
        }
    }

    /// Takes the level of an input that changed with the output just followed.
    pub fn take_answer(&mut self) -> Option<(Pin, Option<bool>)> {
        let source = self.answered.take()?;
        let place = self.inputs.iter().position(|(_, of)| *of == source)?;
        let level = self.level(source);
        self.driven[place] = Some(level);
        Some((self.inputs[place].0, level))
    }

    /// Drives all inputs again: after a reset of the chip's ports, or after a part was
    /// broken or mended.
    pub fn refresh_inputs(&mut self) {
        self.lines_changed = true;
    }

    /// The input pins of the chip that a part drives: switches, probe, stall signals,
    /// tachometers, driver lines.
    pub fn input_pins(&self) -> impl Iterator<Item = Pin> + '_ {
        self.inputs.iter().map(|(pin, _)| *pin)
    }
}
