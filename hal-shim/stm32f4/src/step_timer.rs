//! TIM2, the timer that makes the steps.

use ferrostep_hal_shim::MotorEnable;
use ferrostep_hal_shim::StepOutput;
use ferrostep_hal_shim::step_player::{IDLE_TICKS, StepLink, StepPlayer};
use ferrostep_hal_shim::step_ring::StepRing;
use ferrostep_planner::StepEntry;

use crate::pac::{RCC, TIM2};

/// Step, direction and enable signals of a board. Bit i of a mask is motor i; no method may wait.
pub trait MotorPins {
    /// Raises the step signals in the mask.
    fn step(&self, axes: u8);
    /// Lowers them.
    fn unstep(&self, axes: u8);
    /// Sets all direction signals; 1 = backwards.
    fn set_directions(&self, directions: u8);
    /// Switches all drivers on or off.
    fn enable(&self, enabled: bool);
}

/// Most looks at the counter while a step signal is high: twice what the longest pulse of a profile, 50 us, takes.
const MOST_LOOKS: u32 = 4_000;

/// The step interrupt: timer, pins, player and the queue's far end.
pub struct StepTimer<P: 'static, const N: usize> {
    timer: TIM2,
    pins: &'static P,
    ring: &'static StepRing<N>,
    link: &'static StepLink,
    player: StepPlayer,
    pulse_ticks: u32,
}

impl<P: MotorPins, const N: usize> StepTimer<P, N> {
    /// Starts the timer, which never stops: between motions it looks for a new one. `pulse_ticks` is how long a step
    /// signal stays high at least, in ticks of the timer's true frequency.
    ///
    /// The counter is used as reset has left it. QEMU adds the time of the last write to the counter to every
    /// interval, so it is never written.
    pub fn start(
        timer: TIM2,
        rcc: &RCC,
        pins: &'static P,
        ring: &'static StepRing<N>,
        link: &'static StepLink,
        pulse_ticks: u32,
    ) -> Self {
        rcc.apb1enr().modify(|_, w| w.tim2en().set_bit());
        // Without preload this takes effect at once; the interrupt writes all others with preload.
        set_interval(&timer, IDLE_TICKS);
        timer.dier().write(|w| w.uie().set_bit());
        timer.cr1().write(|w| w.arpe().set_bit().cen().set_bit());
        Self { timer, pins, ring, link, player: StepPlayer::new(), pulse_ticks }
    }

    /// The interrupt: puts out the event that is due and prepares the one after the next. No lock, no float, no
    /// division, no panic.
    ///
    /// Steps that share an event rise with one store a port. They fall when the work is done and the pulse long enough:
    /// waiting for it here costs less than an interrupt of its own would. A direction changes right after the step
    /// before it, so that its set-up time is the whole interval.
    #[inline]
    pub fn update(&mut self) {
        self.timer.sr().write(|w| w.uif().clear_bit());
        let axes = self.player.due_axes(self.link);
        let risen = self.timer.cnt().read().bits();
        if axes != 0 {
            self.pins.step(axes);
        }
        let next = self.player.advance(self.link, || self.ring.pop());
        set_interval(&self.timer, next.interval_ticks);
        if axes != 0 {
            self.hold(risen);
            self.pins.unstep(axes);
        }
        if let Some(directions) = next.directions {
            self.pins.set_directions(directions);
        }
    }

    #[inline]
    fn hold(&self, risen: u32) {
        for _ in 0..MOST_LOOKS {
            // A counter that has begun anew since makes the difference huge: then the next event is due already.
            if self.timer.cnt().read().bits().wrapping_sub(risen) >= self.pulse_ticks {
                break;
            }
        }
    }
}

#[inline]
fn set_interval(timer: &TIM2, interval_ticks: u32) {
    // SAFETY: any reload value is valid; the counter passes it once in `interval_ticks`.
    timer.arr().write(|w| unsafe { w.bits(interval_ticks.wrapping_sub(1)) });
}

/// The queue's near end, for the planner task.
pub struct StepQueue<P: 'static, const N: usize> {
    pins: &'static P,
    ring: &'static StepRing<N>,
    link: &'static StepLink,
    enabled: u8,
}

impl<P: MotorPins, const N: usize> StepQueue<P, N> {
    /// The producer's side of `ring`; there must be no other.
    pub fn new(pins: &'static P, ring: &'static StepRing<N>, link: &'static StepLink) -> Self {
        Self { pins, ring, link, enabled: 0 }
    }
}

impl<P: MotorPins, const N: usize> StepOutput for StepQueue<P, N> {
    fn waiting(&self) -> usize {
        self.ring.len()
    }

    fn room(&self) -> usize {
        self.ring.room()
    }

    #[inline]
    fn push(&mut self, entry: StepEntry) {
        self.ring.push(entry);
    }

    fn link(&self) -> &StepLink {
        self.link
    }
}

impl<P: MotorPins, const N: usize> MotorEnable for StepQueue<P, N> {
    /// The drivers share one signal: it is on while any motor is.
    fn set_motors_enabled(&mut self, axes: u8, enabled: bool) {
        let before = self.enabled;
        self.enabled = if enabled { before | axes } else { before & !axes };
        if (self.enabled != 0) != (before != 0) {
            self.pins.enable(self.enabled != 0);
        }
    }
}
