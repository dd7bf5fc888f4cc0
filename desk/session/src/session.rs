//! A printer on the desk, and the loop that polls it and lets time pass.

use std::cell::{Cell, Ref, RefCell};
use std::future::Future;
use std::marker::PhantomData;
use std::pin::pin;
use std::rc::Rc;
use std::task::{Context, Poll, Waker};

use ferrostep_gcode::Reply;
use ferrostep_hal_shim::{Clock, FanOutput, Heater};
use ferrostep_printer::SharedMotion;
use ferrostep_printer::heat::HeatFault;
use ferrostep_printer::{
    EncoderWatch, FilamentWatch, HeaterRest, HeaterTimeout, Heating, Motion, Ports, Printer, Profile, Replies,
    SUPPLY_FAILS, Signals, SupplyWatch, tell_driver_event, tell_stalled_fan, temperatures,
};
use ferrostep_simulator::frame::Mode;
use ferrostep_virtual_board::{EndStopFailure, HeaterFailure, IDENTIFIER, VirtualClock, VirtualDelay, VirtualHeaters};

use crate::desk::{
    Desk, DeskAccelerometer, DeskDrivers, DeskHeat, DeskHeating, DeskMachine, Encoder, ExtruderNow, Figures,
    LimitFactors, LiveDesk, MotionState, PlanReader, QueueMachine, Rehearsal,
};
use crate::record::Observer;
use crate::rules::{ByRules, RulesReader};
use crate::version::VERSION;

/// Parts of a printer on the desk that moves `M`. The types of the replies and of the steps'
/// observer are left out: the printer's code is large, and compiled again for each type.
pub struct DeskPorts<'a, M>(PhantomData<(&'a (), M)>);

impl<'a, M: Motion> Ports for DeskPorts<'a, M> {
    type Motion = M;
    type Heating = DeskHeating<'a>;
    type Clock = VirtualDelay<'a>;
    type Replies = dyn Replies + 'a;
}

/// A printer that makes every step.
pub type DeskPrinter<'a> = Printer<'a, DeskPorts<'a, SharedMotion<DeskMachine<'a>>>>;

/// A session that makes every step, seen by `O`.
pub type PrintSession<O, R> = Session<Rehearsal<O>, R>;

/// A session whose time passes as it is granted, for hosts.
pub type LiveSession<R> = Session<LiveDesk, R>;

/// A session that only plans.
pub type PlanSession<R> = Session<PlanReader, R>;

/// The machine, with the state that its parts share.
pub struct Session<D, R> {
    profile: Profile,
    clock: VirtualClock,
    desk: D,
    heat: RefCell<DeskHeat>,
    drivers: Rc<DeskDrivers>,
    signals: Signals,
    heater_timeout: Cell<HeaterTimeout>,
    filament: Cell<FilamentWatch>,
    encoder: Cell<Encoder>,
    encoder_watch: Cell<EncoderWatch>,
    /// Stalled fan, as last reported.
    stalled_fan: Cell<Option<FanOutput>>,
    /// True while the filament sensor reports no filament.
    is_filament_out: Cell<bool>,
    is_supply_failing: Cell<bool>,
    supply: Cell<SupplyWatch>,
    replies: R,
    last_step_ns: Cell<u64>,
    /// The motion clock when time passed last.
    last_tick: Cell<u64>,
    /// True if motors have moved since the last look at the heaters' timeout.
    has_moved: Cell<bool>,
    accelerometer: Option<Rc<DeskAccelerometer>>,
}

impl<O: Observer, R: Replies> PrintSession<O, R> {
    /// A machine that has just been switched on and makes every step, its replies
    /// going to `replies`.
    pub fn print(profile: Profile, look_ahead: usize, observer: O, replies: R) -> Self {
        Self::new(profile, replies, |drivers| Rehearsal::new(&profile, look_ahead, drivers, observer))
    }

    /// The observer of the motors.
    pub fn into_observer(self) -> O {
        self.desk.into_observer()
    }
}

impl<R: Replies> LiveSession<R> {
    /// A machine that has just been switched on.
    pub fn live(profile: Profile, look_ahead: usize, replies: R) -> Self {
        Self::live_with(profile, look_ahead, None, replies)
    }

    /// A machine that has just been switched on, on a frame whose modes along X and Y an
    /// accelerometer feels.
    pub fn live_with(profile: Profile, look_ahead: usize, frame: Option<[Mode; 2]>, replies: R) -> Self {
        let accelerometer = frame.map(|frame| Rc::new(DeskAccelerometer::new(profile.geometry(), frame)));
        let desk = |drivers| LiveDesk::new(&profile, look_ahead, drivers, accelerometer.clone());
        let session = Self::new(profile, replies, desk);
        Self { accelerometer, ..session }
    }
}

impl<R: Replies> PlanSession<R> {
    /// A machine that only plans.
    pub fn estimate(profile: Profile, look_ahead: usize, replies: R) -> Self {
        Self::new(profile, replies, |drivers| PlanReader::new(&profile, look_ahead, drivers, false))
    }

    /// A machine that only plans, with its limits times factors.
    pub fn estimate_with(profile: Profile, look_ahead: usize, factors: LimitFactors, replies: R) -> Self {
        Self::new(profile, replies, |drivers| {
            PlanReader::new(&profile, look_ahead, drivers, false).with_factors(factors)
        })
    }

    /// A machine that only plans, and records its plan.
    pub fn prepare(profile: Profile, look_ahead: usize, replies: R) -> Self {
        Self::new(profile, replies, |drivers| PlanReader::new(&profile, look_ahead, drivers, true))
    }
}

impl<R: Replies> Session<RulesReader, R> {
    /// A machine whose moves are planned by another firmware's rules.
    pub fn by_rules(profile: Profile, by: ByRules, replies: R) -> Self {
        Self::new(profile, replies, |drivers| RulesReader::new(&profile, by, drivers))
    }
}

impl<D: Desk<State = RefCell<QueueMachine>>, R> Session<D, R> {
    /// Makes the sensor with which X (0), Y (1) or Z (2) homes fail, or mends it.
    pub fn set_end_stop_failure(&self, axis: usize, failure: Option<EndStopFailure>) {
        self.desk.state().borrow_mut().queue_mut().motors_mut().set_end_stop_failure(axis, failure);
    }
}

impl<D: Desk, R: Replies> Session<D, R> {
    fn new(profile: Profile, replies: R, desk: impl FnOnce(Rc<DeskDrivers>) -> D) -> Self {
        let drivers = Rc::new(DeskDrivers::new(&profile.drivers, D::MAKES_STEPS));
        Self {
            clock: VirtualClock::default(),
            desk: desk(Rc::clone(&drivers)),
            heat: RefCell::new(DeskHeat::new(&profile, D::MAKES_STEPS)),
            drivers,
            signals: Signals::new(),
            heater_timeout: Cell::default(),
            filament: Cell::default(),
            encoder: Cell::default(),
            encoder_watch: Cell::default(),
            stalled_fan: Cell::default(),
            is_filament_out: Cell::new(false),
            is_supply_failing: Cell::new(false),
            supply: Cell::new(SupplyWatch::new()),
            replies,
            profile,
            last_step_ns: Cell::new(0),
            last_tick: Cell::new(0),
            has_moved: Cell::new(false),
            accelerometer: None,
        }
    }

    /// The printer; one at a time makes sense.
    pub fn printer(&self) -> Printer<'_, DeskPorts<'_, D::Motion<'_>>> {
        let replies: &dyn Replies = &self.replies;
        let mut printer = Printer::new(
            &self.profile,
            self.desk.motion(&self.signals),
            self.heating(),
            VirtualDelay(&self.clock),
            replies,
            &self.signals,
        );
        printer.set_version(VERSION);
        printer.set_identifier(IDENTIFIER);
        if self.drivers.exist() {
            printer.set_drivers(&*self.drivers);
        }
        if let Some(accelerometer) = &self.accelerometer {
            printer.set_accelerometer(&**accelerometer);
        }
        printer
    }

    /// The machine.
    pub fn profile(&self) -> &Profile {
        &self.profile
    }

    /// The motors' drivers.
    pub fn drivers(&self) -> &DeskDrivers {
        &self.drivers
    }

    /// The motion.
    pub fn desk(&self) -> &D {
        &self.desk
    }

    /// The heaters, as commands see them.
    pub fn heating(&self) -> DeskHeating<'_> {
        DeskHeating(&self.heat)
    }

    /// The heaters' models.
    pub fn heaters(&self) -> Ref<'_, VirtualHeaters> {
        Ref::map(self.heat.borrow(), DeskHeat::heaters)
    }

    /// Makes a heater fail, or mends it.
    pub fn set_heater_failure(&self, heater: Heater, failure: Option<HeaterFailure>) {
        self.heat.borrow_mut().set_failure(heater, failure);
    }

    /// Stops a fan whatever its power, or lets it turn again.
    pub fn set_fan_stuck(&self, fan: FanOutput, is_stuck: bool) {
        self.heat.borrow_mut().set_fan_stuck(fan, is_stuck);
    }

    /// The filament runs out, or new one is there.
    pub fn set_filament_out(&self, is_out: bool) {
        self.is_filament_out.set(is_out);
        self.set_filament_stuck(is_out);
    }

    /// The supply's signal says that it fails, or that it is right again. Power stays.
    pub fn set_supply_failing(&self, is_failing: bool) {
        self.is_supply_failing.set(is_failing);
    }

    /// The filament is jammed, so that the extruder's gear grinds on it, or free again.
    pub fn set_filament_stuck(&self, is_stuck: bool) {
        self.encoder.update(|mut encoder| {
            encoder.set_stuck(is_stuck);
            encoder
        });
    }

    /// Samples of the heaters' models so far.
    pub fn heat_samples(&self) -> u64 {
        self.heat.borrow().samples()
    }

    /// The counts so far.
    pub fn figures(&self) -> Figures {
        Figures { print_time_s: self.last_step_ns.get() as f64 * 1e-9, ..self.desk.state().figures() }
    }

    /// Flags for the code that acts on bytes as they arrive.
    pub fn signals(&self) -> &Signals {
        &self.signals
    }

    /// Returns the receiver of the replies.
    pub fn replies(&self) -> &R {
        &self.replies
    }

    /// Virtual time.
    pub fn clock(&self) -> &VirtualClock {
        &self.clock
    }

    /// Switches everything off, as M112 does when its bytes arrive.
    pub fn halt(&self) {
        self.heat.borrow_mut().halt();
        self.desk.state().stop();
        self.signals.halt();
    }

    /// Polls a future to its end; whenever it waits, virtual time passes. `between` is called
    /// after each time.
    pub fn run_with<F: Future>(&self, future: F, mut between: impl FnMut(&Self)) -> F::Output {
        let mut future = pin!(future);
        let mut context = Context::from_waker(Waker::noop());
        let (mut next_report_ms, mut next_card_report_ms) = (0, 0);
        loop {
            if let Poll::Ready(output) = future.as_mut().poll(&mut context) {
                return output;
            }
            if let Err(fault) = self.pass_time() {
                self.desk.state().stop();
                // Two adjacent lines, as hosts expect of a thermal error.
                self.replies.send(Reply::Text(&fault.to_string()));
                self.replies.send(Reply::Killed);
                self.signals.halt();
            }
            self.drivers.work_until(self.clock.now_ns());
            self.tell_driver_events();
            self.rest_heaters();
            self.watch_filament();
            self.watch_supply();
            self.watch_fans();
            self.report_temperatures(&mut next_report_ms);
            self.report_card(&mut next_card_report_ms);
            self.tell_samples();
            between(self);
        }
    }

    /// Polls a future to its end; whenever it waits, virtual time passes.
    pub fn run<F: Future>(&self, future: F) -> F::Output {
        self.run_with(future, |_| {})
    }

    /// Advances time until the last command's wait is over, for motion or for a moment.
    /// Motion does not continue while a command waits for a moment, so that the plan does not
    /// depend on such waits.
    ///
    /// # Errors
    /// A heater or thermometer has failed; heaters are off.
    fn pass_time(&self) -> Result<(), HeatFault> {
        self.desk.pass_motion();
        let tick = self.desk.state().tick();
        if self.last_tick.replace(tick) != tick {
            self.last_step_ns.set(self.desk.now_ns());
            self.has_moved.set(true);
        }
        if let Some(wake_ns) = self.clock.take_wake_ns() {
            self.desk.wait_until(wake_ns);
        }
        let now_ns = self.desk.now_ns();
        self.clock.advance_to(now_ns);
        self.heat.borrow_mut().pass_to(now_ns, self.desk.state().fan_demand())
    }

    /// Reports the events of the motors' drivers. A driver that fails while its motor has current
    /// halts the machine.
    fn tell_driver_events(&self) {
        while let Some(event) = self.drivers.take_event() {
            let halts = tell_driver_event(&event, self.desk.state().enabled_motors(), &self.replies);
            if halts && !self.signals.is_halted() {
                self.halt();
                self.replies.send(Reply::Killed);
            }
        }
    }

    /// Switches unused heaters off, as a board does (M86).
    fn rest_heaters(&self) {
        // A clock of milliseconds that wraps.
        let now_ms = (&self.clock).now_ms() as u32;
        let is_used = self.signals.take_host_spoken() | self.has_moved.take();
        let mut heating = self.heating();
        let has_target = Heater::ALL.into_iter().any(|heater| heating.status(heater).target_celsius > 0.0);
        let mut timeout = self.heater_timeout.get();
        let rest = timeout.look(now_ms, is_used, has_target, self.signals.heater_timeout_s());
        self.heater_timeout.set(timeout);
        let Some(rest) = rest else { return };
        if let HeaterRest::Over { .. } = rest {
            heating.all_off();
        }
        self.replies.send(Reply::Text(&rest.to_string()));
    }

    /// Looks at the filament sensor, as a board does.
    fn watch_filament(&self) {
        let Some(sensor) = &self.profile.filament_sensor else { return };
        if let Some(switch) = &self.profile.filament_switch {
            let mut watch = self.filament.get();
            let now_ms = (&self.clock).now_ms() as u32;
            watch.look_beside_encoder(now_ms, self.is_filament_out.get(), switch, &self.signals);
            self.filament.set(watch);
        }
        if let Some(detection_10nm) = sensor.detection_10nm() {
            return self.watch_encoder(detection_10nm as f64 / 1e5, sensor.debounce_ms);
        }
        let mut watch = self.filament.get();
        watch.look((&self.clock).now_ms() as u32, self.is_filament_out.get(), sensor, &self.signals);
        self.filament.set(watch);
    }

    /// Reads the supply's signal, as a board does.
    fn watch_supply(&self) {
        let Some(signal) = &self.profile.supply_signal else { return };
        let mut watch = self.supply.get();
        let now_ms = (&self.clock).now_ms() as u32;
        let has_failed = watch.look(now_ms, self.is_supply_failing.get(), signal, &self.signals);
        self.supply.set(watch);
        if !has_failed {
            return;
        }
        if self.signals.card_progress().is_some() {
            self.desk.state().stop();
            self.heating().all_off();
        } else if self.signals.take_supply_failure() {
            self.replies.send(Reply::Text(SUPPLY_FAILS));
            self.halt();
            self.replies.send(Reply::Killed);
        }
    }

    fn watch_encoder(&self, detection_mm: f64, debounce_ms: u16) {
        let Some(ExtruderNow { steps, pushed, steps_per_mm }) = self.desk.extruder_now() else { return };
        let (mut encoder, mut watch) = (self.encoder.get(), self.encoder_watch.get());
        encoder.follow(steps);
        let level = encoder.level(steps_per_mm, detection_mm);
        let now_ms = (&self.clock).now_ms() as u32;
        watch.look(now_ms, level, pushed, steps_per_mm as f32, debounce_ms, &self.signals);
        self.encoder.set(encoder);
        self.encoder_watch.set(watch);
    }

    /// Reports a fan that does not turn, as a board does.
    fn watch_fans(&self) {
        let mut told = self.stalled_fan.get();
        tell_stalled_fan(&mut told, &self.profile.fans, &self.heating(), &self.signals, &self.replies);
        self.stalled_fan.set(told);
    }

    /// M956.
    fn tell_samples(&self) {
        let Some(accelerometer) = &self.accelerometer else { return };
        while let Some(event) = accelerometer.take_event() {
            self.replies.say(format_args!("{event}"));
        }
    }

    /// M27 S.
    fn report_card(&self, next_report_ms: &mut u64) {
        let interval_ms = u64::from(self.signals.card_report_interval_s()) * 1000;
        let now_ms = (&self.clock).now_ms();
        if let Some((position, size)) =
            self.signals.card_progress().filter(|_| interval_ms > 0 && now_ms >= *next_report_ms)
        {
            *next_report_ms = now_ms + interval_ms;
            self.replies.say(format_args!("SD printing byte {position}/{size}"));
        }
    }

    /// M155.
    fn report_temperatures(&self, next_report_ms: &mut u64) {
        let interval_ms = u64::from(self.signals.report_interval_s()) * 1000;
        let now_ms = (&self.clock).now_ms();
        if interval_ms == 0 {
            *next_report_ms = 0;
        } else if now_ms >= *next_report_ms {
            *next_report_ms = now_ms + interval_ms;
            self.replies.send(Reply::Temperatures(temperatures(&self.heating())));
        }
    }
}
