//! Faults on purpose: `serve --fault`.

use std::str::FromStr;
use std::time::Duration;

use ferrostep_hal_shim::{FanOutput, Heater};
use ferrostep_host_line::damage::{LineFault, share};
use ferrostep_virtual_board::{EndStopFailure, HeaterFailure};

/// The kinds of faults, for help and errors.
pub const KINDS: &str = "nozzle-HOW, bed-HOW, chamber-HOW or nozzle1-HOW with HOW open, shorted, fell-out, frozen, dead or stuck-on; drop:RATE, flip:RATE, \
                         drop-line:RATE or flip-line:RATE with RATE such as 1%; card-pull, card-back, filament-out, \
                         filament-back, filament-jam, filament-free, power-loss, power-back, hotend-fan-stuck or hotend-fan-turns; x-HOW, \
                         y-HOW or z-HOW with HOW never, always or works; pin-stays-in, pin-stays-out or pin-works";

/// A fault and its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fault {
    /// The fault.
    pub kind: FaultKind,
    /// The fault's time, in virtual time since the printer was switched on.
    pub at: Duration,
}

/// A fault.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FaultKind {
    /// A heater, or its thermistor.
    Heater(Heater, HeaterFailure),
    /// Bytes on their way to the printer.
    Line(LineFault, f64),
    /// The memory card is pulled out of its slot.
    CardPulled,
    /// The memory card is put back.
    CardPutBack,
    /// The filament runs out.
    FilamentOut,
    /// New filament is there.
    FilamentBack,
    /// The filament does not follow the extruder any more (`true`), or does again.
    FilamentStuck(bool),
    /// The supply's signal says that it fails (`true`), or that it is right again. Power stays,
    /// as with a module.
    SupplySignal(bool),
    /// A fan stops whatever its power (`true`), or turns again.
    Fan(FanOutput, bool),
    /// The sensor with which an axis homes fails, or works again.
    EndStop(usize, Option<EndStopFailure>),
    /// The pin of the probe fails, or works again.
    Pin(Option<EndStopFailure>),
}

impl FaultKind {
    /// Returns true if it needs a card in the slot.
    #[must_use]
    pub const fn is_of_card(self) -> bool {
        matches!(self, Self::CardPulled | Self::CardPutBack)
    }

    /// Returns true if it needs a filament sensor.
    #[must_use]
    pub const fn is_of_filament(self) -> bool {
        matches!(self, Self::FilamentOut | Self::FilamentBack)
    }

    /// Returns true if it needs a signal of the supply.
    #[must_use]
    pub const fn is_of_supply(self) -> bool {
        matches!(self, Self::SupplySignal(_))
    }

    /// Returns true if it needs a sensor that sees filament move.
    #[must_use]
    pub const fn is_of_moving_filament(self) -> bool {
        matches!(self, Self::FilamentStuck(_))
    }

    /// Returns true if it needs a probe with a pin.
    #[must_use]
    pub const fn is_of_pin(self) -> bool {
        matches!(self, Self::Pin(_))
    }
}

impl FromStr for Fault {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (kind, seconds) = text.split_once('@').unwrap_or((text, "0"));
        let seconds = seconds.parse().ok().and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
        let at = seconds.ok_or("write the time after the @ in seconds, for example nozzle-open@90")?;
        Ok(Self { kind: kind.parse()?, at })
    }
}

impl FromStr for FaultKind {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Some((fault, rate)) = text.split_once(':') {
            let fault = LineFault::named(fault).ok_or_else(|| format!("unknown fault, expected {KINDS}"))?;
            return Ok(Self::Line(fault, share(rate)?));
        }
        match text {
            "card-pull" => return Ok(Self::CardPulled),
            "card-back" => return Ok(Self::CardPutBack),
            "filament-out" => return Ok(Self::FilamentOut),
            "filament-back" => return Ok(Self::FilamentBack),
            "filament-jam" => return Ok(Self::FilamentStuck(true)),
            "filament-free" => return Ok(Self::FilamentStuck(false)),
            "power-loss" => return Ok(Self::SupplySignal(true)),
            "power-back" => return Ok(Self::SupplySignal(false)),
            "hotend-fan-stuck" => return Ok(Self::Fan(FanOutput::HotEnd, true)),
            "hotend-fan-turns" => return Ok(Self::Fan(FanOutput::HotEnd, false)),
            "pin-stays-in" => return Ok(Self::Pin(Some(EndStopFailure::PinStaysIn))),
            "pin-stays-out" => return Ok(Self::Pin(Some(EndStopFailure::PinStaysOut))),
            "pin-works" => return Ok(Self::Pin(None)),
            _ => {}
        }
        let axis = text
            .split_once('-')
            .and_then(|(axis, how)| Some((["x", "y", "z"].iter().position(|name| *name == axis)?, how)));
        if let Some((axis, how)) = axis {
            let failure = match how {
                "never" => Some(EndStopFailure::NeverTriggers),
                "always" => Some(EndStopFailure::AlwaysTriggered),
                "works" => None,
                _ => return Err(format!("unknown fault, expected {KINDS}")),
            };
            return Ok(Self::EndStop(axis, failure));
        }
        let (heater, how) = text.split_once('-').unwrap_or((text, ""));
        let heater = match heater {
            "nozzle" => Heater::Nozzle,
            "bed" => Heater::Bed,
            "chamber" => Heater::Chamber,
            "nozzle1" => Heater::Nozzle1,
            _ => return Err(format!("unknown fault, expected {KINDS}")),
        };
        let failure = match how {
            "open" => HeaterFailure::ThermistorOpen,
            "shorted" => HeaterFailure::ThermistorShorted,
            "fell-out" => HeaterFailure::ThermistorFellOut,
            "frozen" => HeaterFailure::ThermistorFrozen,
            "dead" => HeaterFailure::Dead,
            "stuck-on" => HeaterFailure::StuckOn,
            _ => return Err(format!("unknown fault, expected {KINDS}")),
        };
        Ok(Self::Heater(heater, failure))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_read() {
        let fault = |text: &str| text.parse::<Fault>();
        let open = FaultKind::Heater(Heater::Nozzle, HeaterFailure::ThermistorOpen);
        assert_eq!(fault("nozzle-open"), Ok(Fault { kind: open, at: Duration::ZERO }));
        assert_eq!(fault("nozzle-open@1.5"), Ok(Fault { kind: open, at: Duration::from_millis(1500) }));
        let flips = FaultKind::Line(LineFault::FlipBits, 0.01);
        assert_eq!(fault("flip:1%@9"), Ok(Fault { kind: flips, at: Duration::from_secs(9) }));
        let pulled = Fault { kind: FaultKind::CardPulled, at: Duration::from_secs(60) };
        assert_eq!(fault("card-pull@60"), Ok(pulled));
        let out = Fault { kind: FaultKind::FilamentOut, at: Duration::from_secs(90) };
        assert_eq!(fault("filament-out@90"), Ok(out));
        let jam = Fault { kind: FaultKind::FilamentStuck(true), at: Duration::from_secs(30) };
        assert_eq!(fault("filament-jam@30"), Ok(jam));
        for (text, kind) in [
            ("y-never", FaultKind::EndStop(1, Some(EndStopFailure::NeverTriggers))),
            ("z-always", FaultKind::EndStop(2, Some(EndStopFailure::AlwaysTriggered))),
            ("x-works", FaultKind::EndStop(0, None)),
            ("pin-stays-out", FaultKind::Pin(Some(EndStopFailure::PinStaysOut))),
            ("pin-works", FaultKind::Pin(None)),
        ] {
            assert_eq!(fault(text), Ok(Fault { kind, at: Duration::ZERO }), "{text}");
        }
        let power = Fault { kind: FaultKind::SupplySignal(true), at: Duration::from_secs(20) };
        assert_eq!(fault("power-loss@20"), Ok(power));
        for text in [
            "card",
            "card-pull:1%",
            "nozzle",
            "nozzle-open@",
            "nozzle-open@-1",
            "door-open",
            "flip:1",
            "flip:101%",
            "drop:x%",
            "lose:1%",
            "x",
            "x-sometimes",
            "e-never",
            "pin-out",
        ] {
            assert!(fault(text).is_err(), "{text}");
        }
    }
}
