//! Waits for time and for heat.

use embedded_hal_async::delay::DelayNs;
use ferrostep_hal_shim::{Clock, Heater};

use crate::error::CommandError;
use crate::heat::relay::RelayProgress;
use crate::heat::report::HeaterStatus;
use crate::heat::step_response::StepProgress;
use crate::heat::timeout::Approach;
use crate::job::paused::PauseAnswer;
use crate::part::Part;
use crate::ports::Heating;
use crate::settings::profile::heaters::HeaterSettings;
use crate::signals::Signals;

/// Polling interval of a wait, ms. A cancelled wait ends within this time.
const LOOK_MS: u64 = 100;

/// Interval of the lines that M109 and M190 print, ms.
const REPORT_MS: u64 = 1000;

/// A wait for cooling ends when the temperature falls by less than this within this time: no heater
/// gets colder than the room. The slope is well above the noise of a thermistor, and well below
/// that of a heater 10 degrees above the room.
const MIN_COOLING_CELSIUS: f32 = 0.5;
const MIN_COOLING_MS: u64 = 120_000;

/// Parts of an autotune.
struct Parts {
    ended: u8,
    of: u8,
    /// Lowest and highest temperature of the last part, for a relay's cycle.
    ends_celsius: Option<[f32; 2]>,
}

/// Progress of a heater's autotune; `None` once it has a result.
fn parts<H: Heating>(heater: Heater, heating: &H) -> Result<Option<Parts>, CommandError> {
    if H::Models::PRESENT
        && let Some(step) = heating.step(heater)
    {
        return match step {
            StepProgress::Found(_) => Ok(None),
            StepProgress::Parts { ended, of } => Ok(Some(Parts { ended, of, ends_celsius: None })),
            StepProgress::Failed => Err(CommandError::HeaterControl(
                "MPC Autotune failed! The temperature does not follow the power: is P (power_w) what the heater has? The model stays",
            )),
        };
    }
    match heating.relay(heater) {
        // Only a fault or a timeout ends the autotune.
        None => Err(CommandError::HeatersTimedOut),
        Some(RelayProgress::Failed) => Err(CommandError::HeaterControl(
            "PID Autotune failed! timeout: the temperature does not swing around S, is the heater strong enough for it?",
        )),
        Some(RelayProgress::Found(_)) => Ok(None),
        Some(RelayProgress::Cycles { ended, of, lowest_celsius, highest_celsius }) => {
            Ok(Some(Parts { ended, of, ends_celsius: Some([lowest_celsius, highest_celsius]) }))
        }
    }
}

/// Watches a heater cool.
#[derive(Clone, Copy, Debug, Default)]
struct Cooling {
    /// Time of the last check, ms, and the temperature then.
    before: Option<(u64, f32)>,
}

impl Cooling {
    /// Returns true if the temperature has stopped falling.
    fn is_over(&mut self, now_ms: u64, celsius: f32) -> bool {
        match self.before {
            Some((since_ms, _)) if now_ms.saturating_sub(since_ms) < MIN_COOLING_MS => false,
            Some((_, before)) if before - celsius < MIN_COOLING_CELSIUS => true,
            _ => {
                self.before = Some((now_ms, celsius));
                false
            }
        }
    }
}

/// Waits for time and for heat: a halt ends all of them, M108 those for heat.
#[derive(Debug)]
pub(crate) struct Waits<'a, C> {
    pub clock: C,
    pub signals: &'a Signals,
}

impl<C: Clock + DelayNs> Waits<'_, C> {
    /// Waits for a while.
    pub async fn for_ms(&mut self, milliseconds: u64) -> Result<(), CommandError> {
        let end = self.clock.now_ms().saturating_add(milliseconds);
        loop {
            if self.signals.is_halted() {
                return Err(CommandError::Halted);
            }
            let now = self.clock.now_ms();
            if now >= end {
                return Ok(());
            }
            self.signals.note_use();
            self.clock.delay_ms((end - now).min(LOOK_MS) as u32).await;
        }
    }

    /// Waits for a person: M108 or a button of the prompt (M876 S), or until this time, ms.
    pub async fn for_person(&mut self, until_ms: Option<u64>) -> Result<PauseAnswer, CommandError> {
        // An earlier answer is not meant for this wait.
        self.signals.take_answer();
        loop {
            if self.signals.is_halted() {
                return Err(CommandError::Halted);
            }
            if let Some(answer) = self.signals.take_answer() {
                return Ok(answer);
            }
            if until_ms.is_some_and(|until_ms| self.clock.now_ms() >= until_ms) {
                return Ok(PauseAnswer::Continue);
            }
            self.clock.delay_ms(LOOK_MS as u32).await;
        }
    }

    /// Waits until a heater's autotune has a result, or M108 ends the wait. `is_stopped` returns
    /// true if motion was stopped.
    pub async fn for_autotune(
        &mut self,
        heater: Heater,
        heating: &impl Heating,
        is_stopped: impl Fn() -> bool,
        tell: impl Fn(u8, u8, Option<[f32; 2]>),
    ) -> Result<(), CommandError> {
        let mut told = 0;
        loop {
            if self.signals.is_halted() {
                return Err(CommandError::Halted);
            }
            if is_stopped() {
                return Err(CommandError::Stopped);
            }
            if self.signals.take_end_wait() {
                return Ok(());
            }
            let Some(Parts { ended, of, ends_celsius }) = parts(heater, heating)? else { return Ok(()) };
            if core::mem::replace(&mut told, ended) != ended {
                tell(ended, of, ends_celsius);
            }
            self.signals.note_use();
            self.clock.delay_ms(LOOK_MS as u32).await;
        }
    }

    /// Waits until a heater that is off is colder than this, degrees Celsius, or cools no further.
    /// M108 ends the wait.
    pub async fn for_cooling(
        &mut self,
        heater: Heater,
        below_celsius: f32,
        heating: &impl Heating,
    ) -> Result<(), CommandError> {
        let mut cooling = Cooling::default();
        loop {
            if self.signals.is_halted() {
                return Err(CommandError::Halted);
            }
            let celsius = heating.status(heater).celsius;
            if celsius < below_celsius || self.signals.take_end_wait() || cooling.is_over(self.clock.now_ms(), celsius)
            {
                return Ok(());
            }
            self.signals.note_use();
            self.clock.delay_ms(LOOK_MS as u32).await;
        }
    }

    /// Waits for a temperature. M108 ends the wait.
    pub async fn for_heat(
        &mut self,
        heater: Heater,
        settings: &HeaterSettings,
        until: Until,
        heating: &impl Heating,
        tell: impl Fn(WaitReport<'_>),
    ) -> Result<(), CommandError> {
        let had_target = heating.status(heater).target_celsius > 0.0;
        let mut near_since: Option<u64> = None;
        let mut cooling = Cooling::default();
        let mut approach = Approach::new();
        // A heater that overshoots while heating up is waited for; one that was hotter from the
        // start is not.
        let mut has_heated = false;
        let mut next_report = self.clock.now_ms() + REPORT_MS;
        loop {
            if self.signals.is_halted() {
                return Err(CommandError::Halted);
            }
            if self.signals.take_end_wait() {
                return Ok(());
            }
            let (status, now) = (heating.status(heater), self.clock.now_ms());
            if had_target && status.target_celsius <= 0.0 {
                // During a wait, only a fault or a timeout removes a target.
                return Err(CommandError::HeatersTimedOut);
            }
            let left_ms = match until {
                Until::AtLeast(celsius) => (status.celsius >= celsius).then_some(0),
                Until::Near { cooling_counts } => {
                    let above = status.celsius - status.target_celsius;
                    let is_above = above > settings.residency_window_celsius;
                    has_heated |= above < 0.0;
                    if status.target_celsius <= 0.0 || !cooling_counts && !has_heated && is_above {
                        return Ok(());
                    }
                    if is_above && cooling.is_over(now, status.celsius) {
                        tell(WaitReport::CoolsNoFurther(&status));
                        return Ok(());
                    }
                    let is_near = above.abs() <= settings.residency_window_celsius;
                    near_since = is_near.then(|| near_since.unwrap_or(now));
                    near_since.map(|since| u64::from(settings.residency_ms).saturating_sub(now - since))
                }
            };
            if left_ms == Some(0) {
                return Ok(());
            }
            let distance = match until {
                Until::AtLeast(celsius) => celsius - status.celsius,
                Until::Near { .. } => (status.celsius - status.target_celsius).abs(),
            };
            if approach.goes_on(distance, left_ms.is_some()) {
                self.signals.note_use();
            }
            if now >= next_report {
                next_report = now + REPORT_MS;
                tell(WaitReport::Remaining(left_ms.map(|left| left.div_ceil(1000) as u32)));
            }
            self.clock.delay_ms(LOOK_MS as u32).await;
        }
    }
}

/// Condition that ends a wait for heat.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Until {
    /// The temperature has stayed near its target for the profile's residency time.
    Near {
        /// True to wait also for a heater that is hotter from the start; an overshoot is waited for
        /// in any case.
        cooling_counts: bool,
    },
    /// The heater is this warm, degrees Celsius.
    AtLeast(f32),
}

/// Reports of a wait for heat.
#[derive(Clone, Copy, Debug)]
pub(crate) enum WaitReport<'a> {
    /// Report once a second: the seconds left if the temperature does not change.
    Remaining(Option<u32>),
    /// The heater gets no colder than this: the wait has ended.
    CoolsNoFurther(&'a HeaterStatus),
}
