//! Unsolicited reports of the firmware.

use ferrostep_gcode::Reply;
use ferrostep_hal_shim::{FanOutput, Heater};
use ferrostep_printer::{
    FilamentWatch, HeaterTimeout, Heating, Replies, SUPPLY_FAILS, Signals, tell_stalled_fan, temperatures,
};
use ferrostep_stm32f4_board::board::is_triggered;
use rtic::Mutex;

use crate::black_box::Records;
use crate::heat::{self, Heat};
use crate::host_line::{self, Writers};
use crate::ports::{BoardHeating, BoardMachine, BoardReplies, Overload};
use crate::profile::PROFILE;
use crate::timing;
use crate::wiring::{FILAMENT, FILAMENT_SWITCH};

/// Interval of the black box's temperature records, s.
const RECORD_INTERVAL_S: u32 = 1;

/// Periodic check of the machine, with reports to all hosts.
pub struct Reports<'a, M, H, W, R> {
    machine: M,
    heating: BoardHeating<H>,
    replies: BoardReplies<W>,
    records: R,
    signals: &'a Signals,
    heater_timeout: HeaterTimeout,
    filament: FilamentWatch,
    /// Stalled fan, as last reported.
    stalled_fan: Option<FanOutput>,
    /// Loss counts, as last reported.
    overload: Overload,
    /// Time of the last temperature report, ms; those of the card's progress, the black box's
    /// temperatures and the time measurements follow.
    temperatures_ms: u32,
    card_ms: u32,
    record_ms: u32,
    log_ms: u32,
}

impl<'a, M, H, W, R> Reports<'a, M, H, W, R>
where
    M: Mutex<T = &'static mut BoardMachine>,
    H: Mutex<T = Heat>,
    W: Mutex<T = Writers>,
    R: Mutex<T = Records>,
{
    /// Creates the state before the first report.
    pub fn new(
        machine: M,
        heating: BoardHeating<H>,
        replies: BoardReplies<W>,
        records: R,
        signals: &'a Signals,
    ) -> Self {
        Self {
            machine,
            heating,
            replies,
            records,
            signals,
            heater_timeout: HeaterTimeout::new(),
            filament: FilamentWatch::new(),
            stalled_fan: None,
            overload: Overload::default(),
            temperatures_ms: 0,
            card_ms: 0,
            record_ms: 0,
            log_ms: 0,
        }
    }

    /// Handles a halt of the machine: switches the motors off and informs the hosts.
    pub fn halted(&mut self) {
        // A command in progress has switched them off already; without one it is done here. The
        // lock keeps M999 from ending the halt in between: after M999 the motors are needed.
        self.machine.lock(|machine| {
            if self.signals.is_halted() {
                machine.switch_motors_off();
            }
        });
        #[cfg(servo)]
        crate::ports::pin_in();
        let fault = self.heating.fault();
        if PROFILE.supply_signal.is_some() && self.signals.take_supply_failure() {
            self.replies.send(Reply::Text(SUPPLY_FAILS));
        }
        self.records.lock(|records| records.halted(fault));
        self.replies.halted(fault);
    }

    /// Sends the reports that are due: lost bytes, how hosts pack their bytes (MeatPack), rest, the
    /// card's progress (M27 S), temperatures (M155), overload; to the log, times (M798).
    pub fn look(&mut self, now_ms: u32) {
        self.replies.line_troubles(host_line::take_troubles());
        self.replies.packing();
        self.rest(now_ms);
        if let (Some(pin), Some(sensor)) = (FILAMENT, &PROFILE.filament_sensor)
            && sensor.detection_10nm().is_none()
        {
            self.filament.look(now_ms, is_triggered(pin), sensor, self.signals);
        }
        if let (Some(pin), Some(switch)) = (FILAMENT_SWITCH, &PROFILE.filament_switch) {
            self.filament.look_beside_encoder(now_ms, is_triggered(pin), switch, self.signals);
        }
        tell_stalled_fan(&mut self.stalled_fan, &PROFILE.fans, &self.heating, self.signals, &self.replies);
        if is_due(&mut self.card_ms, self.signals.card_report_interval_s(), now_ms)
            && let Some((position, size)) = self.signals.card_progress()
        {
            self.replies.say(format_args!("SD printing byte {position}/{size}"));
        }
        if heat::EQUIPMENT.heaters && is_due(&mut self.temperatures_ms, self.signals.report_interval_s(), now_ms) {
            self.replies.send(Reply::Temperatures(temperatures(&self.heating)));
        }
        if heat::EQUIPMENT.heaters && is_due(&mut self.record_ms, RECORD_INTERVAL_S, now_ms) {
            let heating = &self.heating;
            self.records.lock(|records| records.temperatures(heating));
        }
        if now_ms.wrapping_sub(self.log_ms) >= timing::LOG_INTERVAL_MS {
            self.log_ms = now_ms;
            timing::log();
            let overload = self.machine.lock(|machine| Overload::of(&machine.figures()));
            if overload != core::mem::replace(&mut self.overload, overload) {
                self.replies.overload(overload);
            }
        }
    }

    /// Switches off parts that have been unused for long: motors (M84 S), heaters (M86).
    fn rest(&mut self, now_ms: u32) {
        let keeps_heat = Heater::ALL.into_iter().any(|heater| self.heating.status(heater).target_celsius > 0.0);
        let signals = self.signals;
        let (is_off, is_idle) = self.machine.lock(|machine| {
            // Under one lock, so that no command begins in between.
            let timeout_s = Some(signals.idle_timeout_s()).filter(|s| *s > 0 && !keeps_heat && !signals.is_at_work());
            let is_off = machine.rest(now_ms, timeout_s.map(|seconds| seconds.saturating_mul(1000)));
            (is_off, machine.is_idle())
        });
        let is_used = signals.take_host_spoken() || !is_idle;
        let rest = self.heater_timeout.look(now_ms, is_used, keeps_heat, signals.heater_timeout_s());
        if let Some(rest) = &rest {
            self.heating.follow(rest, signals, &self.replies);
        }
        if is_off {
            self.replies.send(Reply::Text("echo:motors switched off after a rest (M84 S), home before the next move"));
        }
    }
}

/// Returns true if a report repeated every `interval_s` is due, and notes the time; an interval of
/// 0 is never due.
fn is_due(last_ms: &mut u32, interval_s: impl Into<u32>, now_ms: u32) -> bool {
    let interval_ms = interval_s.into() * 1000;
    let is_due = interval_ms > 0 && now_ms.wrapping_sub(*last_ms) >= interval_ms;
    if is_due {
        *last_ms = now_ms;
    }
    is_due
}
