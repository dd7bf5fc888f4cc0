//! Fans: what each is to do, how it starts, and whether it turns.
//!
//! Commands and rules ask for powers; [`FanControl`] makes of them what each output gets, with
//! every sample of the heaters' control.

mod watch;

use ferrostep_hal_shim::{FanOutput, Fans};

use crate::heat::sample_time::SAMPLE_MS;
use watch::TurnWatch;

/// Nozzle temperature at which the hot end's own fan is switched on, degrees Celsius.
const HOT_END_ON_CELSIUS: f32 = 50.0;
/// Nozzle temperature below which it is switched off, degrees Celsius.
const HOT_END_OFF_CELSIUS: f32 = 45.0;

/// Condition under which a fan turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FanRule {
    /// Turned by SET_FAN_SPEED, and by M106 and M107.
    Commanded {
        /// P of M106 and M107; 0 is the part-cooling fan, which they set without a P. `None`:
        /// by its name only.
        number: Option<u8>,
    },
    /// Turns at full power above a hot nozzle, which would otherwise melt the filament on its way.
    HotEnd,
    /// While motors have current or the bed heats, and for a while after.
    Controller {
        /// Power, 1 to 255.
        power: u8,
        /// Length of that while, seconds.
        idle_s: u16,
    },
    /// No fan: a light, a relay, by SET_PIN and M42.
    Output {
        /// P of M42; `None`: by its name only.
        number: Option<u8>,
        /// True if it may be anything between off and full; otherwise anything above 0 is full.
        is_pwm: bool,
        /// Power at the start, 0 to 255.
        at_start: u8,
        /// Power while the machine is halted, 0 to 255.
        at_halt: u8,
        /// The colour that it is of a light, for M150.
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
    /// All, in the order of their powers in [`ferrostep_gcode::Command::SetLight`].
    pub const ALL: [Self; 4] = [Self::Red, Self::Green, Self::Blue, Self::White];
}

impl FanRule {
    /// Returns true if commands set the power by the name.
    pub(crate) const fn is_named(&self) -> bool {
        matches!(self, Self::Commanded { .. } | Self::Output { .. })
    }
}

/// A fan of the machine, at the output of its place in [`FanTable`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FanSettings {
    /// The fan's name in the profile, for SET_FAN_SPEED and reports.
    pub name: &'static str,
    /// Condition under which it turns.
    pub rule: FanRule,
    /// Time of full power when it starts, ms: a fan at rest needs more than one that turns.
    pub kick_start_ms: u16,
    /// The least power that turns it, 0 to 255: a lower demand above 0 is raised to this.
    pub least_power: u8,
    /// Slower than this at full power it counts as failed, turns a minute; 0: its tachometer
    /// is not looked at.
    pub least_rpm: u16,
}

/// The fans of a machine by their outputs.
pub type FanTable = [Option<FanSettings>; FanOutput::COUNT];

impl FanSettings {
    /// The default of the part-cooling fan.
    pub const PART: Self = Self {
        name: "part",
        rule: FanRule::Commanded { number: Some(0) },
        kick_start_ms: 0,
        least_power: 0,
        least_rpm: 0,
    };

    /// The default of the hot end's own fan.
    pub const HOT_END: Self =
        Self { name: "hotend", rule: FanRule::HotEnd, kick_start_ms: 0, least_power: 0, least_rpm: 0 };

    /// Only these two.
    pub const USUAL: FanTable = [Some(Self::PART), Some(Self::HOT_END), None, None, None, None];
}

/// The output of the fan that a predicate finds.
pub(crate) fn find(table: &FanTable, is_it: impl Fn(&FanSettings) -> bool) -> Option<FanOutput> {
    let mut fans = FanOutput::ALL.into_iter().zip(table);
    fans.find(|(_, fan)| fan.as_ref().is_some_and(&is_it)).map(|(output, _)| output)
}

/// The powers at the start, by output.
pub(crate) fn start_powers(table: &FanTable) -> [u8; FanOutput::COUNT] {
    table.map(|fan| match fan {
        Some(FanSettings { rule: FanRule::Output { at_start, .. }, .. }) => at_start,
        _ => 0,
    })
}

/// Powers that the machine asks of its fans.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FanDemand {
    /// The powers that commands have set, 0 to 255, by output.
    pub powers: [u8; FanOutput::COUNT],
    /// True if any motor has current.
    pub motors_on: bool,
}

impl FanDemand {
    /// The part-cooling fan alone, at this power.
    pub const fn part(power: u8) -> Self {
        Self { powers: [power, 0, 0, 0, 0, 0], motors_on: false }
    }
}

/// State of the heaters' control that the fans follow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Heated {
    /// The nozzle's temperature, degrees Celsius; `None`: unknown.
    pub nozzle_celsius: Option<f32>,
    /// True if the bed has a target.
    pub bed_is_on: bool,
    /// Every fan is to blow with all its power: a heater that cannot be switched off
    /// needs moving air.
    pub has_fault: bool,
    /// The machine was halted: outputs are as the profile says for that.
    pub is_halted: bool,
    /// True if the fans have a supply: without it their speed has no meaning.
    pub has_supply: bool,
}

/// A fan at work.
#[derive(Clone, Copy, Debug)]
struct Fan {
    /// The hot end's fan turns: between its two temperatures it keeps its state.
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
    /// The hot end's fan turns: after a reset the nozzle may be hot.
    pub const fn new() -> Self {
        let fan = Fan { is_on: true, kick_samples: 0, idle_samples: 0, power: 0, watch: TurnWatch::new() };
        Self { fans: [fan; FanOutput::COUNT] }
    }

    /// Works out every fan's power and sets it; to be called every [`SAMPLE_MS`]. Returns the power
    /// of the part-cooling fan's output.
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

    /// The power that a fan has, 0 to 255.
    pub fn power(&self, output: FanOutput) -> u8 {
        self.fans.get(output.index()).map_or(0, |fan| fan.power)
    }

    /// Turns a minute, over the last seconds; `None` without a tachometer.
    pub fn rpm(&self, output: FanOutput) -> Option<u16> {
        self.fans.get(output.index()).and_then(|fan| fan.watch.rpm())
    }

    /// The first fan that has full power and does not turn as fast as it must.
    pub fn stalled(&self) -> Option<FanOutput> {
        FanOutput::ALL.into_iter().zip(&self.fans).find(|(_, fan)| fan.watch.is_stalled()).map(|(output, _)| output)
    }
}

impl Fan {
    /// Power that its rule asks for.
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

    /// The power that makes it turn as asked: enough to start, and enough to keep turning.
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
