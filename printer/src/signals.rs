//! Flags between the command side and the interrupts that act on bytes as they arrive.

use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU16, AtomicU32, Ordering};

use crate::job::paused::PauseAnswer;
use crate::settings::profile::heaters::DEFAULT_HEATER_TIMEOUT_S;

/// Flags between the command side and the interrupts and tasks that act on bytes as they
/// arrive, or on time.
#[derive(Debug, Default)]
pub struct Signals {
    end_wait: AtomicBool,
    halted: AtomicBool,
    waiting_for_heat: AtomicBool,
    paused_for_user: AtomicBool,
    /// The number of the button that was pressed, or [`NO_BUTTON`].
    prompt_answer: AtomicU8,
    report_interval_s: AtomicU8,
    keep_alive_s: AtomicU8,
    is_at_work: AtomicBool,
    idle_timeout_s: AtomicU32,
    heater_timeout_s: AtomicU16,
    host_spoke: AtomicBool,
    is_writing: AtomicBool,
    /// State of the supply's signal.
    supply_failing: AtomicBool,
    /// The supply has failed, and the failure has not been handled yet.
    supply_failed: AtomicBool,
    filament_missing: AtomicBool,
    switch_missing: AtomicBool,
    /// Value of [`Self::filament_detection_10nm`].
    filament_detection_10nm: AtomicU32,
    filament_counts_anew: AtomicBool,
    fan_stalled: AtomicBool,
    card_report_interval_s: AtomicU8,
    /// Progress of the print from the card, and the file's length, bytes; 0 without a print.
    card_position: AtomicU32,
    card_size: AtomicU32,
}

/// No button has been pressed: M876 S255 has no button either.
const NO_BUTTON: u8 = u8::MAX;

/// Seconds at rest after which motors are switched off, unless M84 S says otherwise: Marlin's.
pub const IDLE_TIMEOUT_S: u32 = 120;

impl Signals {
    /// No flag set; `busy` messages every two seconds.
    pub const fn new() -> Self {
        Self {
            end_wait: AtomicBool::new(false),
            halted: AtomicBool::new(false),
            waiting_for_heat: AtomicBool::new(false),
            paused_for_user: AtomicBool::new(false),
            prompt_answer: AtomicU8::new(NO_BUTTON),
            report_interval_s: AtomicU8::new(0),
            keep_alive_s: AtomicU8::new(2),
            is_at_work: AtomicBool::new(false),
            idle_timeout_s: AtomicU32::new(IDLE_TIMEOUT_S),
            heater_timeout_s: AtomicU16::new(DEFAULT_HEATER_TIMEOUT_S),
            host_spoke: AtomicBool::new(false),
            is_writing: AtomicBool::new(false),
            supply_failing: AtomicBool::new(false),
            supply_failed: AtomicBool::new(false),
            filament_missing: AtomicBool::new(false),
            switch_missing: AtomicBool::new(false),
            filament_detection_10nm: AtomicU32::new(0),
            filament_counts_anew: AtomicBool::new(false),
            fan_stalled: AtomicBool::new(false),
            card_report_interval_s: AtomicU8::new(0),
            card_position: AtomicU32::new(0),
            card_size: AtomicU32::new(0),
        }
    }

    /// M108: the present wait ends.
    pub fn end_wait(&self) {
        self.end_wait.store(true, Ordering::Release);
    }

    /// Takes the request to end a wait.
    pub(crate) fn take_end_wait(&self) -> bool {
        self.end_wait.swap(false, Ordering::AcqRel)
    }

    /// M876 S: the number of the button that was pressed; 0 is *Continue*.
    pub fn answer_prompt(&self, button: u8) {
        self.prompt_answer.store(button, Ordering::Release);
    }

    /// Takes a person's answer since the last call, by M108 or a button; buttons that no prompt
    /// has are ignored.
    pub(crate) fn take_answer(&self) -> Option<PauseAnswer> {
        let (button, ends) = (self.prompt_answer.swap(NO_BUTTON, Ordering::AcqRel), self.take_end_wait());
        match button {
            _ if ends => Some(PauseAnswer::Continue),
            0 => Some(PauseAnswer::Continue),
            1 => Some(PauseAnswer::PushMore),
            _ => None,
        }
    }

    /// Returns true if the command at hand waits for a person (M0, M600 and the like).
    pub fn is_paused_for_user(&self) -> bool {
        self.paused_for_user.load(Ordering::Relaxed)
    }

    pub(crate) fn set_paused_for_user(&self, paused: bool) {
        self.paused_for_user.store(paused, Ordering::Relaxed);
    }

    /// Returns true if a command is being executed; a wait counts.
    pub fn is_at_work(&self) -> bool {
        self.is_at_work.load(Ordering::Acquire)
    }

    pub(crate) fn set_at_work(&self, is_at_work: bool) {
        self.is_at_work.store(is_at_work, Ordering::Release);
    }

    /// Seconds at rest after which motors are switched off (M84 S); 0 = never.
    pub fn idle_timeout_s(&self) -> u32 {
        self.idle_timeout_s.load(Ordering::Relaxed)
    }

    pub(crate) fn set_idle_timeout_s(&self, seconds: u64) {
        self.idle_timeout_s.store(u32::try_from(seconds).unwrap_or(u32::MAX), Ordering::Relaxed);
    }

    /// Seconds without use after which heaters go off (M86); 0 = never.
    pub fn heater_timeout_s(&self) -> u16 {
        self.heater_timeout_s.load(Ordering::Relaxed)
    }

    pub(crate) fn set_heater_timeout_s(&self, seconds: u16) {
        self.heater_timeout_s.store(seconds, Ordering::Relaxed);
    }

    /// A host has sent a line, or a frame of a prepared job. To be called from any priority: the
    /// receiving interrupt calls it, because a line may have to wait its turn.
    pub fn note_host(&self) {
        self.host_spoke.store(true, Ordering::Release);
    }

    /// Notes that the command at hand continues by itself: heaters count as used, as if a
    /// host had spoken.
    pub(crate) fn note_use(&self) {
        self.note_host();
    }

    /// Returns true if a host has sent anything since the last [`Self::take_host_spoken`].
    pub fn has_host_spoken(&self) -> bool {
        self.host_spoke.load(Ordering::Acquire)
    }

    /// Takes whether a host has sent anything since the last call.
    pub fn take_host_spoken(&self) -> bool {
        self.host_spoke.swap(false, Ordering::AcqRel)
    }

    /// Returns true if lines of a host go into a file (M28); then only M112 acts before its turn.
    pub fn is_writing(&self) -> bool {
        self.is_writing.load(Ordering::Acquire)
    }

    pub(crate) fn set_writing(&self, is_writing: bool) {
        self.is_writing.store(is_writing, Ordering::Release);
    }

    /// Returns true if the supply fails, by its signal.
    pub fn is_supply_failing(&self) -> bool {
        self.supply_failing.load(Ordering::Relaxed)
    }

    pub(crate) fn set_supply_failing(&self, is_failing: bool) {
        self.supply_failing.store(is_failing, Ordering::Relaxed);
    }

    /// The supply has failed. A wait for heat ends: it would never come.
    pub(crate) fn note_supply_failure(&self) {
        self.supply_failed.store(true, Ordering::Release);
        self.end_wait();
    }

    pub(crate) fn has_supply_failed(&self) -> bool {
        self.supply_failed.load(Ordering::Acquire)
    }

    /// Takes whether the supply has failed, so that one acts on it.
    pub fn take_supply_failure(&self) -> bool {
        let has_failed = self.supply_failed.swap(false, Ordering::AcqRel);
        if has_failed {
            self.take_end_wait();
        }
        has_failed
    }

    /// Returns true if the filament sensor sees no filament, or none that moves; `false`
    /// without a sensor.
    pub fn is_filament_missing(&self) -> bool {
        self.filament_missing.load(Ordering::Relaxed)
    }

    /// Returns true if the switch beside a sensor that sees filament move reports missing filament;
    /// `false` without such a switch.
    pub fn is_filament_out(&self) -> bool {
        self.switch_missing.load(Ordering::Relaxed)
    }

    pub(crate) fn set_filament_out(&self, is_out: bool) {
        self.switch_missing.store(is_out, Ordering::Relaxed);
    }

    /// A fan does not turn as it must: the print is to pause.
    pub(crate) fn note_stalled_fan(&self) {
        self.fan_stalled.store(true, Ordering::Release);
    }

    /// Takes that note, so that the print pauses once.
    pub(crate) fn take_stalled_fan(&self) -> bool {
        self.fan_stalled.swap(false, Ordering::AcqRel)
    }

    pub(crate) fn set_filament_missing(&self, is_missing: bool) {
        self.filament_missing.store(is_missing, Ordering::Relaxed);
    }

    /// Length of new filament that may be pushed without a sign of the encoder before it counts as
    /// missing, units of 10 nm (M412 D).
    pub(crate) fn filament_detection_10nm(&self) -> u32 {
        self.filament_detection_10nm.load(Ordering::Relaxed)
    }

    pub(crate) fn set_filament_detection_10nm(&self, length_10nm: u32) {
        self.filament_detection_10nm.store(length_10nm, Ordering::Relaxed);
    }

    /// Restarts the count of filament pushed without a sign of the encoder.
    pub(crate) fn count_filament_anew(&self) {
        // In this order: whatever the encoder's watch does in between, filament is not
        // missing afterwards.
        self.filament_counts_anew.store(true, Ordering::Release);
        self.set_filament_missing(false);
    }

    /// Takes that request.
    pub(crate) fn take_filament_counts_anew(&self) -> bool {
        self.filament_counts_anew.swap(false, Ordering::AcqRel)
    }

    /// Seconds between reports of a print from the card (M27 S); 0 = off.
    pub fn card_report_interval_s(&self) -> u8 {
        self.card_report_interval_s.load(Ordering::Relaxed)
    }

    pub(crate) fn set_card_report_interval_s(&self, seconds: u8) {
        self.card_report_interval_s.store(seconds, Ordering::Relaxed);
    }

    /// The next byte of the file that is printed from the card, and how many it has.
    pub fn card_progress(&self) -> Option<(u32, u32)> {
        let size = self.card_size.load(Ordering::Relaxed);
        (size > 0).then(|| (self.card_position.load(Ordering::Relaxed), size))
    }

    pub(crate) fn set_card_progress(&self, progress: Option<(u32, u32)>) {
        let (position, size) = progress.unwrap_or_default();
        self.card_position.store(position, Ordering::Relaxed);
        self.card_size.store(size, Ordering::Relaxed);
    }

    /// M112, or a heater fault: every wait ends and every command is refused until M999. The caller
    /// must switch heaters off and stop the motors.
    pub fn halt(&self) {
        self.halted.store(true, Ordering::Release);
    }

    /// Returns true if the machine is halted.
    pub fn is_halted(&self) -> bool {
        self.halted.load(Ordering::Acquire)
    }

    /// M999.
    pub(crate) fn restart(&self) {
        self.halted.store(false, Ordering::Release);
    }

    /// Seconds between temperature reports (M155); 0 = off, and while a wait for
    /// heat prints its own.
    pub fn report_interval_s(&self) -> u8 {
        if self.is_waiting_for_heat() { 0 } else { self.report_interval_s.load(Ordering::Relaxed) }
    }

    pub(crate) fn is_waiting_for_heat(&self) -> bool {
        self.waiting_for_heat.load(Ordering::Relaxed)
    }

    pub(crate) fn set_waiting_for_heat(&self, waiting: bool) {
        self.waiting_for_heat.store(waiting, Ordering::Relaxed);
    }

    pub(crate) fn set_report_interval_s(&self, seconds: u8) {
        self.report_interval_s.store(seconds, Ordering::Relaxed);
    }

    /// Seconds between `busy` messages (M113); 0 = off.
    pub fn keep_alive_s(&self) -> u8 {
        self.keep_alive_s.load(Ordering::Relaxed)
    }

    pub(crate) fn set_keep_alive_s(&self, seconds: u8) {
        self.keep_alive_s.store(seconds, Ordering::Relaxed);
    }
}
