//! Fans: the rule, start and supervision of each.
//!
//! Commands and rules request powers; [`FanControl`] turns them into each output's power, with
//! every sample of the heater control.

mod watch;

use ferrostep_hal_shim::{FanOutput, Fans};

use crate::heat::sample_time::SAMPLE_MS;
use watch::TurnWatch;

/// Nozzle temperature at which the hot end's own fan is switched on, degrees Celsius.
const HOT_END_ON_CELSIUS: f32 = 50.0;
/// Nozzle temperature below which the hot end's fan is switched off, degrees Celsius.
const HOT_END_OFF_CELSIUS: f32 = 45.0;

/// Condition under which a fan turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FanRule {
    /// Turned by SET_FAN_SPEED, and by M106 and M107.
    Commanded {
        /// P of M106 and M107; 0 is the part-cooling fan, which they set without a P. `None` if it
        /// is set by name only.
        number: Option<u8>,
    },
    /// Turns at full power while the nozzle is hot, to keep filament from melting above it.
    HotEnd,
    /// Turns while motors have current or the bed heats, and for a while after.
    Controller {
        /// Power, 1 to 255.
        power: u8,
        /// Duration of that while, seconds.
        idle_s: u16,
    },
    /// Not a fan but a light or a relay, set by SET_PIN and M42.
    Output {
        /// P of M42; `None` if it is set by name only.
        number: Option<u8>,
        /// True if the output may have any power; otherwise any value above 0 is full power.
        is_pwm: bool,
        /// Power at the start, 0 to 255.
        at_start: u8,
        /// Power while the machine is halted, 0 to 255.
        at_halt: u8,
        /// Colour of the light that the output is, for M150.
        color: Option<LightColor>,
    },
}

/// A colour of a light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightColor {
    /// M150 R.
    Red,
    /// M150 U.
    Green,
    /// M150 B.
    Blue,
    /// M150 W.
    White,
}

impl LightColor {
    /// All colours, in the order of their powers in [`ferrostep_gcode::Command::SetLight`].
    pub const ALL: [Self; 4] = [Self::Red, Self::Green, Self::Blue, Self::White];
}

impl FanRule {
    /// Returns true if commands set the power by name.
    pub(crate) const fn is_named(&self) -> bool {
        matches!(self, Self::Commanded { .. } | Self::Output { .. })
    }
}

/// A fan of the machine, at the output of its place in [`FanTable`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FanSettings {
    /// The fan's name in the profile, for SET_FAN_SPEED and reports.
    pub name: &'static str,
    /// Condition under which the fan turns.
    pub rule: FanRule,
    /// Duration of full power when the fan starts, ms: a fan at rest needs more power than a
    /// turning one.
    pub kick_start_ms: u16,
    /// Minimum power that turns the fan, 0 to 255: a lower demand above 0 is raised to it.
    pub least_power: u8,
    /// Speed below which a fan at full power counts as failed, turns a minute; 0: the tachometer is
    /// ignored.
    pub least_rpm: u16,
}

/// The fans of a machine by their outputs.
pub type FanTable = [Option<FanSettings>; FanOutput::COUNT];

impl FanSettings {
    /// Default part-cooling fan.
    pub const PART: Self = Self {
        name: "part",
        rule: FanRule::Commanded { number: Some(0) },
        kick_start_ms: 0,
        least_power: 0,
        least_rpm: 0,
    };

    /// Default fan of the hot end.
    pub const HOT_END: Self =
        Self { name: "hotend", rule: FanRule::HotEnd, kick_start_ms: 0, least_power: 0, least_rpm: 0 };

    /// The two default fans only.
    pub const USUAL: FanTable = [Some(Self::PART), Some(Self::HOT_END), None, None, None, None];
}

/// The output of the fan that a predicate finds.
pub(crate) fn find(table: &FanTable, is_it: impl Fn(&FanSettings) -> bool) -> Option<FanOutput> {
    let mut fans = FanOutput::ALL.into_iter().zip(table);
    fans.find(|(_, fan)| fan.as_ref().is_some_and(&is_it)).map(|(output, _)| output)
}

/// Powers at the start, by output.
pub(crate) fn start_powers(table: &FanTable) -> [u8; FanOutput::COUNT] {
    table.map(|fan| match fan {
        Some(FanSettings { rule: FanRule::Output { at_start, .. }, .. }) => at_start,
        _ => 0,
    })
}

/// Powers that the machine requests from its fans.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FanDemand {
    /// Powers that commands have set, 0 to 255, by output.
    pub powers: [u8; FanOutput::COUNT],
    /// True if any motor has current.
    pub motors_on: bool,
}

impl FanDemand {
    /// Demand for the part-cooling fan alone, at this power.
    pub const fn part(power: u8) -> Self {
        Self { powers: [power, 0, 0, 0, 0, 0], motors_on: false }
    }
}

/// State of the heater control that the fans follow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Heated {
    /// Temperature of the nozzle, degrees Celsius; `None`: unknown.
    pub nozzle_celsius: Option<f32>,
    /// True if the bed has a target.
    pub bed_is_on: bool,
    /// True if every fan must blow at full power: a heater that cannot be switched off needs moving
    /// air.
    pub has_fault: bool,
    /// True if the machine was halted: outputs then have the profile's power for a halt.
    pub is_halted: bool,
    /// True if the fans have supply power: without it their speed is meaningless.
    pub has_supply: bool,
}

/// State of a fan.
#[derive(Clone, Copy, Debug)]
struct Fan {
    /// True if the hot end's fan turns: between its two temperatures it keeps its state.
    is_on: bool,
    /// Remaining samples of the kick start.
    kick_samples: u16,
    /// Remaining samples of a controller's `idle_s`.
    idle_samples: u32,
    power: u8,
    watch: TurnWatch,
}

/// All fans of a machine.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FanControl {
    fans: [Fan; FanOutput::COUNT],
}

impl FanControl {
    /// Fan control in which the hot end's fan turns: after a reset the nozzle may be hot.
    pub const fn new() -> Self {
        let fan = Fan { is_on: true, kick_samples: 0, idle_samples: 0, power: 0, watch: TurnWatch::new() };
        Self { fans: [fan; FanOutput::COUNT] }
    }

    /// Computes and sets every fan's power; call it every [`SAMPLE_MS`]. Returns the power of the
    /// part-cooling fan's output.
    pub fn update(&mut self, table: &FanTable, demand: &FanDemand, heated: &Heated, board: &mut impl Fans) -> u8 {
        for (output, settings) in FanOutput::ALL.into_iter().zip(table) {
            let (Some(fan), Some(settings)) = (self.fans.get_mut(output.index()), settings) else { continue };
            let commanded = demand.powers.get(output.index()).copied().unwrap_or(0);
            let asked = match settings.rule {
                FanRule::Output { at_halt, .. } if heated.is_halted => at_halt,
                FanRule::Output { .. } => fan.asked(settings, commanded, demand, heated),
                _ if heated.has_fault => u8::MAX,
                _ => fan.asked(settings, commanded, demand, heated),
            };
            let power = fan.started(settings, asked);
            board.set_fan_power(output, power);
            fan.watch.look(settings.least_rpm, power == u8::MAX && heated.has_supply, board.tachometer(output));
        }
        self.power(FanOutput::Part)
    }

    /// Present power of a fan, 0 to 255.
    pub fn power(&self, output: FanOutput) -> u8 {
        self.fans.get(output.index()).map_or(0, |fan| fan.power)
    }

    /// Speed of a fan over the last seconds, turns a minute; `None` without a tachometer.
    pub fn rpm(&self, output: FanOutput) -> Option<u16> {
        self.fans.get(output.index()).and_then(|fan| fan.watch.rpm())
    }

    /// The first fan at full power that turns slower than required.
    pub fn stalled(&self) -> Option<FanOutput> {
        FanOutput::ALL.into_iter().zip(&self.fans).find(|(_, fan)| fan.watch.is_stalled()).map(|(output, _)| output)
    }
}

impl Fan {
    /// Power that the fan's rule requests.
    fn asked(&mut self, settings: &FanSettings, commanded: u8, demand: &FanDemand, heated: &Heated) -> u8 {
        match settings.rule {
            FanRule::Output { is_pwm: false, .. } if commanded > 0 => u8::MAX,
            FanRule::Commanded { .. } | FanRule::Output { .. } => commanded,
            FanRule::HotEnd => {
                match heated.nozzle_celsius {
                    Some(celsius) if celsius < HOT_END_OFF_CELSIUS => self.is_on = false,
                    Some(celsius) if celsius < HOT_END_ON_CELSIUS => {}
                    // Unknown, or not a number.
                    Some(_) | None => self.is_on = true,
                }
                if self.is_on { u8::MAX } else { 0 }
            }
            FanRule::Controller { power, idle_s } => {
                if demand.motors_on || heated.bed_is_on {
                    self.idle_samples = u32::from(idle_s) * (1000 / SAMPLE_MS);
                    return power;
                }
                self.idle_samples = self.idle_samples.saturating_sub(1);
                if self.idle_samples > 0 { power } else { 0 }
            }
        }
    }

    /// Power that makes the fan turn as requested: enough to start, and enough to keep turning.
    fn started(&mut self, settings: &FanSettings, asked: u8) -> u8 {
        if asked == 0 {
            self.kick_samples = 0;
            self.power = 0;
            return 0;
        }
        self.kick_samples = if self.power == 0 {
            settings.kick_start_ms.div_ceil(SAMPLE_MS as u16)
        } else {
            self.kick_samples.saturating_sub(1)
        };
        self.power = if self.kick_samples > 0 { u8::MAX } else { asked.max(settings.least_power) };
        self.power
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
