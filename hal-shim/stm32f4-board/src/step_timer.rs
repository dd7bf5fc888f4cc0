//! TIM2, the step timer, and TIM9, which counts its updates.

use cortex_m::peripheral::NVIC;
use ferrostep_hal_shim::{HomingSensors, MotionWatch, MotorEnable, PlanningClock, ServoPulses, StepQueue};
use ferrostep_planner::{StepDigests, StepEntry, StepObserver};
use ferrostep_step_player::{
    DroppedSteps, FeedError, IDLE_TICKS, MAX_EVENTS, NextWords, OutputPorts, StepFeeder, StepLink, StepPlayer,
    Stepping, UpdateTimer,
};

use crate::board::SERVO;
use crate::measured::PlanningMeter;
use crate::motion_clock::MotionClock;
pub use crate::motor_ports::{MotorPort, MotorPorts, Motors};
pub use crate::motor_stop::stop;
use crate::pac::{Interrupt, RCC, TIM2, TIM9, tim2};
use crate::servo;

/// State of the step interrupt, next to the addresses that it needs.
pub struct StepTimer<M: 'static, const PORTS: usize, const N: usize> {
    ports: MotorPorts<PORTS>,
    player: &'static StepPlayer<M, PORTS, N>,
    timer: Timer,
    next: NextWords<PORTS>,
}

/// TIM2's registers.
#[derive(Clone, Copy)]
struct Timer(&'static tim2::RegisterBlock);

// SAFETY: only the interrupt has it, and it stores whole registers.
unsafe impl Send for Timer {}

impl<M: Stepping, const PORTS: usize, const N: usize> StepTimer<M, PORTS, N> {
    /// Starts the timer, which never stops. Its interrupt is masked until a motion starts.
    ///
    /// The counter is used as reset left it. QEMU adds the time of the last write to the counter to
    /// every interval, so the code never writes to it.
    pub fn start(
        timer: TIM2,
        counter: TIM9,
        rcc: &RCC,
        motors: &impl Motors<PORTS>,
        player: &'static StepPlayer<M, PORTS, N>,
    ) -> Self {
        rcc.apb1enr().modify(|_, w| w.tim2en().set_bit());
        // Read back: `Registers::switch_clocks_on` says why.
        let _switched_on = rcc.apb1enr().read();
        start_count(counter, rcc);
        // TRGO = update (RM0090 18.4.2, MMS 010): what TIM9 counts.
        // SAFETY: a value that the field has.
        timer.cr2().write(|w| unsafe { w.bits(0b010 << 4) });
        // SAFETY: any reload value is valid. Without preload this takes effect at once; the
        // interrupt writes all others with preload.
        timer.arr().write(|w| unsafe { w.bits(IDLE_TICKS - 1) });
        timer.cr1().write(|w| w.arpe().set_bit().cen().set_bit());
        Self { timer: Timer::new(), player, ports: motors.ports(), next: NextWords::NONE }
    }

    /// Handles TIM2's interrupt.
    #[inline(always)]
    pub fn update(&mut self) {
        // Copied, so that the compiler does not load it again.
        let timer = self.timer;
        self.player.update(&mut self.next, &timer, &self.ports);
    }

    /// Handles TIM9's vector, which the step interrupt pends: it has the same priority and precedes
    /// TIM2 in the table, so it runs first if both are pending. TIM9 itself never raises it.
    #[inline(always)]
    pub fn start_or_end(&mut self) {
        let timer = self.timer;
        self.player.start_or_end(&mut self.next, &timer);
    }
}

impl Timer {
    /// TIM2 was given up to [`StepTimer::start`]. Besides this only the planner task writes to it,
    /// while the interrupt is masked.
    fn new() -> Self {
        // SAFETY: as said above.
        Self(unsafe { &*TIM2::ptr() })
    }
}

/// Makes TIM9 count the updates of TIM2, modulo 2^15. Without a TIM9 (in an emulator) there is no
/// count.
///
/// Slave of TIM2: external clock mode 1 on ITR0 (RM0090 19.4.3, SMS 111, TS 000; table 99: TIM9's
/// ITR0 is TIM2).
fn start_count(counter: TIM9, rcc: &RCC) {
    rcc.apb2enr().modify(|_, w| w.tim9en().set_bit());
    let _switched_on = rcc.apb2enr().read();
    // SAFETY: any reload value is valid.
    counter.arr().write(|w| unsafe { w.bits(u32::from(MAX_EVENTS)) });
    // SAFETY: values that the fields have.
    counter.smcr().write(|w| unsafe { w.bits(0b111) });
    counter.cr1().write(|w| w.cen().set_bit());
}

impl UpdateTimer for Timer {
    #[inline(always)]
    fn clear_update(&self) {
        // Zeros clear flags, ones have no effect, and all flags but the update's, bit 0, are
        // unused. So any word with that bit clear will do: an address that is in a register anyway
        // saves an instruction.
        let word = core::ptr::from_ref(self.0) as u32;
        // SAFETY: as said.
        self.0.sr().write(|w| unsafe { w.bits(word) });
    }

    #[inline(always)]
    fn is_update_due(&self) -> bool {
        self.0.sr().read().bits() & 1 != 0
    }

    #[inline(always)]
    fn set_reload(&self, reload: u32) {
        // SAFETY: any reload value is valid.
        self.0.arr().write(|w| unsafe { w.bits(reload) });
    }

    #[inline(always)]
    fn set_update_count(&self, count: u16) {
        // SAFETY: the interrupt is the only one to write TIM9's counter; any value is valid.
        unsafe { &*TIM9::ptr() }.cnt().write(|w| unsafe { w.bits(u32::from(count)) });
    }

    #[inline(always)]
    fn call_start_or_end(&self) {
        NVIC::pend(Interrupt::TIM1_BRK_TIM9);
    }

    #[inline(always)]
    fn forget_served(&self) {
        // The interrupt line follows the flag's level: an unserved update calls again.
        NVIC::unpend(Interrupt::TIM2);
    }

    #[inline(always)]
    fn mask(&self) {
        // SAFETY: zeros enable nothing.
        self.0.dier().write(|w| unsafe { w.bits(0) });
    }

    #[inline(always)]
    fn unmask(&self) {
        self.0.dier().write(|w| w.uie().set_bit());
    }
}

/// Calls [`StepTimer::start_or_end`], and returns after it has returned.
fn call_start_or_end() {
    NVIC::pend(Interrupt::TIM1_BRK_TIM9);
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}

/// Producer side of the queue, for the planner task.
pub struct MotorQueue<B, M: 'static, const PORTS: usize, const N: usize> {
    motors: B,
    feeder: StepFeeder<'static, M, PORTS, N>,
    meter: PlanningMeter,
    clock: Option<MotionClock>,
    enabled: u8,
    /// Tool whose extruder steps.
    tool: u8,
    /// Missed updates of this motion that have been reported.
    counted_missed: u16,
    digests: StepDigests,
}

impl<B: Motors<PORTS>, M: Stepping, const PORTS: usize, const N: usize> MotorQueue<B, M, PORTS, N> {
    /// Creates the producer side. The clock measures how long planning takes; without one, planning
    /// is assumed to keep up. Sets the direction signals to the levels that the feeder assumes.
    pub fn new(motors: B, feeder: StepFeeder<'static, M, PORTS, N>, clock: Option<MotionClock>) -> Self {
        let ports = motors.ports();
        for (port, word) in feeder.direction_words().into_iter().enumerate() {
            ports.write(port, word);
        }
        let mut queue = Self {
            motors,
            feeder,
            meter: PlanningMeter::default(),
            clock,
            enabled: 0,
            tool: 0,
            counted_missed: 0,
            digests: StepDigests::default(),
        };
        queue.step_extruder(0);
        queue
    }
}

impl<B: Motors<PORTS>, M: Stepping, const PORTS: usize, const N: usize> MotorQueue<B, M, PORTS, N> {
    /// Excludes from stepping the Z motors outside the mask, and the extruders of all tools but the
    /// selected one.
    fn rest(&mut self, z_motors: u8) {
        let of_z = (0..B::Z_MOTORS).filter(|motor| z_motors >> motor & 1 == 0).filter_map(B::z_step_pin);
        let extruders = if B::EXTRUDERS > 1 { B::EXTRUDERS } else { 0 };
        let others = (0..extruders).filter(|tool| *tool != usize::from(self.tool)).filter_map(B::extruder_step_pin);
        self.feeder.step_without(of_z.chain(others));
    }

    /// Returns true if the chip has TIM9, which counts the updates; an emulator has none.
    pub fn has_update_count(&self) -> bool {
        has_count()
    }

    /// Number of updates that the interrupt has missed in this motion; `None` if updates come
    /// faster than both sides can be read.
    fn missed(&self) -> Option<u16> {
        if !has_count() {
            return Some(0);
        }
        // SAFETY: TIM9's counter is only read.
        let count = || unsafe { &*TIM9::ptr() }.cnt().read().bits() as u16;
        (0..4).find_map(|_| {
            let before = count();
            let missed = self.feeder.missed_updates(before);
            // Without an update in between both sides were read at the same moment.
            (count() == before).then_some(missed)
        })
    }
}

impl<B, M: Stepping, const PORTS: usize, const N: usize> MotorQueue<B, M, PORTS, N> {
    /// Adds entries as an iterator produces them.
    ///
    /// # Errors
    /// As [`StepFeeder::extend`].
    #[inline(always)]
    pub fn extend(&mut self, entries: impl Iterator<Item = StepEntry>) -> Result<(), FeedError> {
        self.feeder.extend(entries)
    }
}

/// Returns true if there is a TIM9.
fn has_count() -> bool {
    // SAFETY: a register is read that is written at the start only.
    unsafe { &*TIM9::ptr() }.arr().read().bits() == u32::from(MAX_EVENTS)
}

impl<B: Motors<PORTS>, M: Stepping, const PORTS: usize, const N: usize> StepQueue for MotorQueue<B, M, PORTS, N> {
    fn queued(&self) -> u32 {
        self.feeder.queued()
    }

    fn played(&self) -> u32 {
        self.feeder.played()
    }

    fn waiting(&self) -> usize {
        self.feeder.waiting()
    }

    fn room(&self) -> usize {
        self.feeder.room()
    }

    #[inline]
    fn push(&mut self, entry: StepEntry) -> Result<(), FeedError> {
        self.feeder.push(entry)
    }

    #[inline]
    fn push_all(&mut self, entries: &[StepEntry]) -> Result<(), FeedError> {
        self.feeder.push_all(entries)
    }

    fn seal(&mut self) {
        self.feeder.seal();
    }

    fn start(&mut self) {
        if self.feeder.start() {
            call_start_or_end();
        }
    }

    fn link(&self) -> &StepLink {
        self.feeder.link()
    }

    fn unplayed_steps(&self) -> [i32; 4] {
        self.feeder.unplayed_steps()
    }

    fn request_stop(&mut self) {
        stop(self.feeder.link());
    }

    fn drop_all(&mut self) -> DroppedSteps {
        let dropped = self.feeder.drop_all();
        for (port, word) in self.feeder.rest_words().into_iter().enumerate() {
            self.motors.ports().write(port, word);
        }
        self.step_z_motors(u8::MAX);
        dropped
    }

    fn take_missed_updates(&mut self) -> u32 {
        let Some(missed) = self.missed() else { return 0 };
        // Fewer than before: a new motion.
        let new = missed.saturating_sub(self.counted_missed);
        self.counted_missed = missed;
        new.into()
    }
}

impl<B: Motors<PORTS>, M: Stepping, const PORTS: usize, const N: usize> HomingSensors for MotorQueue<B, M, PORTS, N> {
    fn is_sensor_triggered(&self, axis: usize) -> bool {
        self.motors.is_sensor_triggered(axis)
    }

    fn watch_sensor(&mut self, axis: Option<usize>) {
        self.motors.watch_sensor(axis);
    }

    fn send_servo_pulses(&mut self, pulses: ServoPulses) {
        if SERVO.is_some() {
            servo::send(pulses);
        }
    }

    fn are_servo_pulses_sent(&self) -> bool {
        SERVO.is_none() || servo::are_sent()
    }
}

impl<B, M, const PORTS: usize, const N: usize> StepObserver for MotorQueue<B, M, PORTS, N> {
    #[inline]
    fn stepped(&mut self, tick: u64, axes: u8, directions: u8) {
        self.digests.stepped(tick, axes, directions);
    }
}

impl<B: Motors<PORTS>, M: Stepping, const PORTS: usize, const N: usize> MotionWatch for MotorQueue<B, M, PORTS, N> {
    const FOLLOWS_FILAMENT: bool = B::FOLLOWS_FILAMENT;
    const HAS_FILAMENT_SWITCH: bool = B::HAS_FILAMENT_SWITCH;

    fn digests(&self) -> StepDigests {
        self.digests
    }

    fn move_ended(&mut self, _tick: u64, _line: u32) {
        self.meter.move_planned();
    }
}

impl<B: Motors<PORTS>, M: Stepping, const PORTS: usize, const N: usize> PlanningClock for MotorQueue<B, M, PORTS, N> {
    #[inline]
    fn now_ticks(&self) -> Option<u32> {
        self.clock.map(MotionClock::now_ticks)
    }

    #[inline]
    fn planning_begins(&mut self) {
        self.meter.begin();
    }

    #[inline]
    fn planning_ends(&mut self) {
        self.meter.end();
    }
}

impl<B: Motors<PORTS>, M: Stepping, const PORTS: usize, const N: usize> MotorEnable for MotorQueue<B, M, PORTS, N> {
    fn set_motors_enabled(&mut self, axes: u8, enabled: bool) {
        let before = self.enabled;
        self.enabled = if enabled { before | axes } else { before & !axes };
        if self.enabled != before {
            self.motors.enable(self.enabled);
        }
    }

    fn step_z_motors(&mut self, motors: u8) {
        if B::Z_MOTORS > 1 {
            self.rest(motors);
        }
    }

    fn step_extruder(&mut self, tool: u8) {
        if B::EXTRUDERS > 1 {
            self.tool = tool;
            self.rest(u8::MAX);
        }
    }
}
