//! TIM2, the timer that makes the steps, and TIM9, which counts its updates.

use cortex_m::peripheral::NVIC;
use ferrostep_hal_shim::stepping::{
    DroppedSteps, FeedError, IDLE_TICKS, MOST_EVENTS, OutputPort, StepFeeder, StepLink, StepPlayer, Stepping,
    UpdateTimer,
};
use ferrostep_hal_shim::{MotorEnable, StepOutput};
use ferrostep_planner::StepEntry;

use crate::pac::{Interrupt, RCC, TIM2, TIM9, tim2};

/// A board's motors.
pub trait Motors<const PORTS: usize> {
    /// The ports that carry their step and direction signals.
    fn ports(&self) -> [MotorPort; PORTS];
    /// Switches all drivers on or off.
    fn enable(&self, enabled: bool);
}

/// A port that carries step and direction signals.
#[derive(Clone, Copy, Debug)]
pub struct MotorPort {
    /// Where its BSRR is: one store sets and resets pins, and nobody has to read.
    bsrr: *mut u32,
}

// SAFETY: a store to BSRR is atomic, and what it does is told by the word alone.
unsafe impl Send for MotorPort {}
// SAFETY: the same.
unsafe impl Sync for MotorPort {}

impl MotorPort {
    /// The port of a register block.
    pub fn new(port: &crate::pac::gpioc::RegisterBlock) -> Self {
        Self { bsrr: port.bsrr().as_ptr() }
    }
}

impl OutputPort for MotorPort {
    #[inline(always)]
    fn write(&self, word: u32) {
        // SAFETY: the address is a port's BSRR, always writable; the words name motor pins only.
        unsafe { self.bsrr.write_volatile(word) }
    }
}

/// The step interrupt: timer, ports, and the player with its queue.
pub struct StepTimer<M: 'static, const PORTS: usize, const N: usize> {
    timer: Timer,
    ports: [MotorPort; PORTS],
    player: &'static StepPlayer<M, PORTS, N>,
}

/// The registers that the interrupt uses.
struct Timer {
    registers: &'static tim2::RegisterBlock,
    /// TIM9's counter, or a zero where there is no TIM9 (an emulator).
    updates: *mut u32,
}

// SAFETY: only the interrupt's owner has one, and its stores are of whole registers.
unsafe impl Send for Timer {}

/// Stands for the counter of updates where there is none.
static NO_COUNT: core::sync::atomic::AtomicU32 = core::sync::atomic::AtomicU32::new(0);

impl<M: Stepping, const PORTS: usize, const N: usize> StepTimer<M, PORTS, N> {
    /// Starts the timer, which never stops: between motions it looks for a new one.
    ///
    /// The counter is used as reset has left it. QEMU adds the time of the last write to the counter to every
    /// interval, so it is never written.
    pub fn start(
        timer: TIM2,
        counter: TIM9,
        rcc: &RCC,
        motors: &impl Motors<PORTS>,
        player: &'static StepPlayer<M, PORTS, N>,
    ) -> Self {
        rcc.apb1enr().modify(|_, w| w.tim2en().set_bit());
        let updates = start_count(counter, rcc);
        // TRGO = update (RM0090 18.4.2, MMS 010): what TIM9 counts.
        // SAFETY: a value that the field has.
        timer.cr2().write(|w| unsafe { w.bits(0b010 << 4) });
        // SAFETY: any reload value is valid. Without preload this takes effect at once; the interrupt writes all others
        // with preload.
        timer.arr().write(|w| unsafe { w.bits(IDLE_TICKS - 1) });
        timer.dier().write(|w| w.uie().set_bit());
        timer.cr1().write(|w| w.arpe().set_bit().cen().set_bit());
        // SAFETY: TIM2 was given up for this; but for `halt` and `resume`, which touch DIER only, nobody else uses it.
        let registers = unsafe { &*TIM2::ptr() };
        Self { timer: Timer { registers, updates }, ports: motors.ports(), player }
    }

    /// The interrupt.
    #[inline(always)]
    pub fn update(&mut self) {
        self.player.update(&self.timer, &self.ports);
    }
}

/// Lets TIM9 count the updates of TIM2, modulo 2^15; where its count is.
///
/// Slave of TIM2: external clock mode 1 on ITR0 (RM0090 19.4.3, SMS 111, TS 000; table 99: TIM9's ITR0 is TIM2).
fn start_count(counter: TIM9, rcc: &RCC) -> *mut u32 {
    rcc.apb2enr().modify(|_, w| w.tim9en().set_bit());
    // SAFETY: any reload value is valid.
    counter.arr().write(|w| unsafe { w.bits(u32::from(MOST_EVENTS)) });
    if counter.arr().read().bits() != u32::from(MOST_EVENTS) {
        return NO_COUNT.as_ptr();
    }
    // SAFETY: values that the fields have.
    counter.smcr().write(|w| unsafe { w.bits(0b111) });
    counter.cr1().write(|w| w.cen().set_bit());
    counter.cnt().as_ptr().cast()
}

impl UpdateTimer for Timer {
    #[inline(always)]
    fn clear_update(&self) {
        // All flags but the update's are unused.
        // SAFETY: zeros clear flags.
        self.registers.sr().write(|w| unsafe { w.bits(0) });
    }

    #[inline(always)]
    fn is_update_due(&self) -> bool {
        self.registers.sr().read().bits() & 1 != 0
    }

    #[inline(always)]
    fn set_reload(&self, reload: u32) {
        // SAFETY: any reload value is valid.
        self.registers.arr().write(|w| unsafe { w.bits(reload) });
    }

    #[inline(always)]
    fn counter(&self) -> u32 {
        self.registers.cnt().read().bits()
    }

    #[inline(always)]
    fn update_count(&self) -> u16 {
        // SAFETY: TIM9's counter, which may be read at any time, or a word that nobody writes.
        unsafe { self.updates.read_volatile() as u16 }
    }

    #[inline(always)]
    fn set_update_count(&self, count: u16) {
        if self.updates != NO_COUNT.as_ptr() {
            // SAFETY: TIM9's counter is this side's.
            unsafe { self.updates.write_volatile(u32::from(count)) }
        }
    }

    #[inline(always)]
    fn forget_served(&self) {
        NVIC::unpend(Interrupt::TIM2);
    }
}

/// From the next instruction on no motor steps; the planner task sees to the rest. From any task but the step interrupt.
pub fn stop(link: &StepLink) {
    halt();
    link.request_stop();
}

fn halt() {
    // SAFETY: a store to a register whose only other writer, `resume`, is the planner task's.
    unsafe { &*TIM2::ptr() }.dier().write(|w| w.uie().clear_bit());
    // An update that came before the store is played before the next instruction.
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}

fn resume() {
    // SAFETY: as in `halt`.
    unsafe { &*TIM2::ptr() }.dier().write(|w| w.uie().set_bit());
}

/// The queue's near end, for the planner task.
pub struct StepQueue<B: 'static, M: 'static, const PORTS: usize, const N: usize> {
    motors: &'static B,
    feeder: StepFeeder<'static, M, PORTS, N>,
    enabled: u8,
}

impl<B: Motors<PORTS>, M: Stepping, const PORTS: usize, const N: usize> StepQueue<B, M, PORTS, N> {
    /// The producer's side.
    pub fn new(motors: &'static B, feeder: StepFeeder<'static, M, PORTS, N>) -> Self {
        Self { motors, feeder, enabled: 0 }
    }
}

impl<B: Motors<PORTS>, M: Stepping, const PORTS: usize, const N: usize> StepOutput for StepQueue<B, M, PORTS, N> {
    fn queued(&self) -> u32 {
        self.feeder.queued()
    }

    fn played(&self) -> u32 {
        self.feeder.played()
    }

    fn room(&self) -> usize {
        self.feeder.room()
    }

    #[inline]
    fn push(&mut self, entry: StepEntry) -> Result<(), FeedError> {
        self.feeder.push(entry)
    }

    fn seal(&mut self) {
        self.feeder.seal();
    }

    fn link(&self) -> &StepLink {
        self.feeder.link()
    }

    fn request_stop(&mut self) {
        stop(self.feeder.link());
    }

    fn drop_all(&mut self) -> DroppedSteps {
        let dropped = self.feeder.drop_all();
        for (port, word) in self.motors.ports().iter().zip(self.feeder.rest_words()) {
            port.write(word);
        }
        resume();
        dropped
    }

    fn made_up_updates(&self) -> u32 {
        self.feeder.made_up_updates()
    }
}

impl<B: Motors<PORTS>, M: Stepping, const PORTS: usize, const N: usize> MotorEnable for StepQueue<B, M, PORTS, N> {
    /// The drivers share one signal: it is on while any motor is.
    fn set_motors_enabled(&mut self, axes: u8, enabled: bool) {
        let before = self.enabled;
        self.enabled = if enabled { before | axes } else { before & !axes };
        if (self.enabled != 0) != (before != 0) {
            self.motors.enable(self.enabled != 0);
        }
    }
}
