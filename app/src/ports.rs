//! The printer's ports, as views of the resources shared with other tasks.
//!
//! A lock lasts for one call into a library. Each view is used by one task only and no borrow
//! outlives a call, so the cells are never found borrowed.

use core::cell::{Cell, RefCell};
use core::fmt;
use core::mem::MaybeUninit;

use ferrostep_gcode::{MotionFigures, Reply};
use ferrostep_hal_shim::{FanOutput, Heater};
use ferrostep_planner::look_ahead::Slot;
use ferrostep_printer::heat::{HeatFault, HeaterModel, PidGains, RelayProgress, StepProgress};
use ferrostep_printer::machine::Machine;
use ferrostep_printer::{FanStatus, HeaterRest, HeaterStatus, Heating, Replies, SharedMachine, Signals};
use ferrostep_step_interrupt::{STEP_QUEUE_SLOTS, STEPS};
use ferrostep_step_player::StepFeeder;
use ferrostep_stm32f4::clock_tree::{Clock, ClockSource};
use ferrostep_stm32f4_board::board::{BoardPins, MOTOR_PORTS, PIN_MAP};
use ferrostep_stm32f4_board::motion_clock::MotionClock;
use ferrostep_stm32f4_board::step_timer::MotorQueue;
use rtic::Mutex;
use rtic_monotonics::systick::prelude::*;
use rtic_sync::signal::Signal;

use crate::clock::Mono;
use crate::heat::{CHAMBER_IS_HEATED, HAS_NOZZLES, HAS_OUTPUTS, Heat, ModelsPart, SupplyPart};
use crate::host_line::{LineTroubles, Port, To, Writers, take_packing};
use crate::part::{BacklashIf, PartIf};
use crate::profile::{PROFILE, StepSignals};

/// Number of blocks in the look-ahead ring, the same as in the desktop tool.
pub const LOOK_AHEAD_BLOCKS: usize = 128;

/// Step queue for this board's motors, with the sensors that stop it.
pub type BoardStepQueue = MotorQueue<BoardPins, StepSignals, MOTOR_PORTS, STEP_QUEUE_SLOTS>;

/// Stage that makes Z follow the bed, on machines with a probe.
#[cfg(probe)]
type BoardBed = ferrostep_planner::surface::BedStage;
/// No-op stage of machines without a probe.
#[cfg(not(probe))]
type BoardBed = ferrostep_planner::surface::NoBed;

/// True if the profile gives the drives' play.
const HAS_BACKLASH: bool = ferrostep_profile_constant::PROFILE.backlash.is_some();

/// Motion methods that this image contains.
#[cfg(not(feature = "papers"))]
pub type Methods = ferrostep_planner::Standard<BoardBed, BacklashIf<HAS_BACKLASH>>;
/// Motion methods that this image contains.
#[cfg(feature = "papers")]
pub type Methods = ferrostep_papers::Papers<BoardBed, BacklashIf<HAS_BACKLASH>>;

/// The machine that this board drives.
pub type BoardMachine = Machine<&'static mut [Slot], BoardStepQueue, Methods>;

/// Creates the queue for these motors.
pub fn motor_queue(pins: BoardPins, clock: &Clock, motion_clock: MotionClock) -> BoardStepQueue {
    let pin_map = const { PIN_MAP.with_inverted(ferrostep_profile_constant::PROFILE.driver.inverted) };
    let feeder = StepFeeder::new(&STEPS, pin_map, PROFILE.driver.signals(clock.slow_timers.raw())).keeping_past();
    // On the bare internal oscillator the plan must not depend on time; the host line follows the
    // same rule.
    let planning_clock = (clock.source != ClockSource::Internal).then_some(motion_clock);
    MotorQueue::new(pins, feeder, planning_clock)
}

/// Builds the machine in its final place.
// Not inlined: its stack is free again before a task begins; the stack of `init` is not.
#[inline(never)]
pub fn build_machine(
    place: &'static mut MaybeUninit<BoardMachine>,
    slots: &'static mut heapless::Vec<Slot, LOOK_AHEAD_BLOCKS>,
    queue: BoardStepQueue,
) -> &'static mut BoardMachine {
    while slots.push(Slot::EMPTY).is_ok() {}
    place.write(BoardMachine::new(&PROFILE, slots.as_mut_slice(), queue))
}

#[cfg(servo)]
const _: () = assert!(ferrostep_stm32f4_board::servo::PIN_IN_US == ferrostep_gcode::PinCommand::IN_US);

/// Starts the signal of the probe's servo, and retracts the pin in case the end of the last program
/// left it out.
#[cfg(servo)]
pub fn start_servo(timer: ferrostep_stm32f4_board::pac::TIM6, clock: &Clock) {
    ferrostep_stm32f4_board::servo::start(timer, clock);
    pin_in();
}

/// Requests that the probe's pin be retracted, from any task and without waiting.
#[cfg(servo)]
pub fn pin_in() {
    if let Some(pin) = &PROFILE.bltouch {
        ferrostep_stm32f4_board::servo::send(pin.pulses_in());
    }
}

/// Signal that wakes the planner task when it has work.
pub static PLANNER_WORK: Signal<()> = Signal::new();

/// Polling interval of a command that waits for the end of motion, ms.
const LOOK_MS: u32 = 1;

/// The machine, as shared with the task that executes commands.
pub struct BoardMachineLock<'a, M> {
    machine: RefCell<M>,
    signals: &'a Signals,
}

impl<'a, M: Mutex<T = &'static mut BoardMachine>> BoardMachineLock<'a, M> {
    /// Creates the view of a machine. M112 ends every wait.
    pub fn new(machine: M, signals: &'a Signals) -> Self {
        Self { machine: RefCell::new(machine), signals }
    }
}

impl<M: Mutex<T = &'static mut BoardMachine>> SharedMachine for BoardMachineLock<'_, M> {
    type Ring = &'static mut [Slot];
    type Queue = BoardStepQueue;
    type Methods = Methods;
    type Servo = PartIf<{ ferrostep_profile_constant::PROFILE.bltouch.is_some() }>;
    type ZMotors = PartIf<{ ferrostep_profile_constant::PROFILE.aligns_z() }>;
    type Tools = PartIf<{ ferrostep_profile_constant::PROFILE.has_tools() }>;
    type Backlash = PartIf<HAS_BACKLASH>;
    type SupplySignal = PartIf<{ ferrostep_profile_constant::PROFILE.supply_signal.is_some() }>;

    fn with<T>(&self, act: impl FnOnce(&mut BoardMachine) -> T) -> T {
        self.machine.borrow_mut().lock(|machine| act(machine))
    }

    fn wake_planner(&self) {
        PLANNER_WORK.writer().write(());
    }

    fn is_halted(&self) -> bool {
        self.signals.is_halted()
    }

    async fn pause(&self) {
        Mono::delay(LOOK_MS.millis()).await;
    }
}

/// Heater control.
pub struct BoardHeating<H>(pub RefCell<H>);

impl<H: Mutex<T = Heat>> BoardHeating<H> {
    /// Returns the fault that keeps the heaters off, if any.
    pub fn fault(&self) -> Option<HeatFault> {
        self.0.borrow_mut().lock(|heat| heat.fault())
    }

    /// Switches unused heaters off when their time is up, unless a line has arrived since. Both
    /// happen under one lock, so that no command sets a target in between. Tells the hosts.
    pub fn follow<W: Mutex<T = Writers>>(&self, rest: &HeaterRest, signals: &Signals, replies: &BoardReplies<W>) {
        let goes_on = matches!(rest, HeaterRest::Over { .. })
            && self.0.borrow_mut().lock(|heat| {
                let host_spoke = signals.has_host_spoken();
                if !host_spoke {
                    heat.all_off();
                }
                host_spoke
            });
        if !goes_on {
            replies.line(format_args!("{rest}"));
        }
    }
}

impl<H: Mutex<T = Heat>> Heating for BoardHeating<H> {
    fn set_target(&mut self, heater: Heater, celsius: f32) {
        self.0.get_mut().lock(|heat| heat.set_target(heater, celsius));
    }

    fn status(&self, heater: Heater) -> HeaterStatus {
        self.0.borrow_mut().lock(|heat| heat.status(heater))
    }

    fn all_off(&mut self) {
        self.0.get_mut().lock(|heat| heat.all_off());
    }

    type Supply = SupplyPart;
    type Models = ModelsPart;

    const HAS_OUTPUTS: bool = HAS_OUTPUTS;

    fn chamber_is_heated(&self) -> Option<bool> {
        CHAMBER_IS_HEATED
    }

    fn nozzle(&self) -> Heater {
        if HAS_NOZZLES { self.0.borrow_mut().lock(|heat| heat.nozzle()) } else { Heater::Nozzle }
    }

    fn select_nozzle(&mut self, heater: Heater) {
        if HAS_NOZZLES {
            self.0.get_mut().lock(|heat| heat.select_nozzle(heater));
        }
    }

    fn has_nozzles(&self) -> bool {
        HAS_NOZZLES
    }

    fn set_supply(&mut self, on: bool) {
        self.0.get_mut().lock(|heat| heat.set_supply(on));
    }

    fn is_supply_on(&self) -> bool {
        self.0.borrow_mut().lock(|heat| heat.is_supply_on())
    }

    fn halt(&mut self) {
        self.0.get_mut().lock(|heat| heat.halt());
    }

    fn gains(&self, heater: Heater) -> PidGains {
        self.0.borrow_mut().lock(|heat| heat.gains(heater))
    }

    fn set_gains(&mut self, heater: Heater, gains: PidGains) {
        self.0.get_mut().lock(|heat| heat.set_gains(heater, gains));
    }

    fn begin_relay(&mut self, heater: Heater, celsius: f32, cycles: u8, has_fan: bool) {
        self.0.get_mut().lock(|heat| heat.begin_relay(heater, celsius, cycles, has_fan));
    }

    fn relay(&self, heater: Heater) -> Option<RelayProgress> {
        self.0.borrow_mut().lock(|heat| heat.relay(heater))
    }

    fn model(&self, heater: Heater) -> Option<HeaterModel> {
        self.0.borrow_mut().lock(|heat| heat.model(heater))
    }

    fn set_model(&mut self, heater: Heater, model: HeaterModel) {
        self.0.get_mut().lock(|heat| heat.set_model(heater, model));
    }

    fn begin_step(&mut self, heater: Heater, celsius: f32, has_fan: bool) {
        self.0.get_mut().lock(|heat| heat.begin_step(heater, celsius, has_fan));
    }

    fn step(&self, heater: Heater) -> Option<StepProgress> {
        self.0.borrow_mut().lock(|heat| heat.step(heater))
    }

    fn fan(&self, output: FanOutput) -> FanStatus {
        self.0.borrow_mut().lock(|heat| heat.fan(output))
    }

    fn stalled_fan(&self) -> Option<FanOutput> {
        self.0.borrow_mut().lock(|heat| heat.stalled_fan())
    }

    fn restart(&mut self) -> Result<(), HeatFault> {
        self.0.get_mut().lock(|heat| heat.restart())
    }
}

/// Sending ends of the hosts' lines. A reply is never interleaved: the lock keeps others out until
/// its last byte.
pub struct BoardReplies<W> {
    writers: RefCell<W>,
    to: Cell<To>,
}

impl<W: Mutex<T = Writers>> BoardReplies<W> {
    /// Creates the view; replies go to all hosts.
    pub const fn new(writers: W) -> Self {
        Self { writers: RefCell::new(writers), to: Cell::new(To::All) }
    }

    /// Directs replies to this host from now on.
    pub fn answer(&self, port: Port) {
        self.to.set(To::Host(port));
    }

    /// Returns the current receiver of replies.
    #[cfg(accelerometer)]
    pub fn to(&self) -> To {
        self.to.get()
    }

    /// Returns true if a record's line fits without a wait.
    pub fn have_room(&self) -> bool {
        self.writers.borrow_mut().lock(|writers| writers.have_room(self.to.get()))
    }

    /// Sends a line.
    pub fn text(&self, text: &str) {
        self.line(format_args!("{text}"));
    }

    /// Directs replies to all hosts from now on.
    #[cfg(card)]
    pub fn answer_all(&self) {
        self.to.set(To::All);
    }

    /// Reports that the machine is halted, and the heater fault that caused it: on adjacent lines,
    /// as hosts expect.
    pub fn halted(&self, fault: Option<HeatFault>) {
        self.writers.borrow_mut().lock(|writers| {
            // As replies, so that a host that reads late still sees them.
            for to in [To::Host(Port::Serial), To::Host(Port::Usb)] {
                if let Some(fault) = fault {
                    writers.line(to, fault);
                }
                writers.line(to, Reply::Killed);
            }
        });
    }

    /// Reports to each host how it packs its bytes, if the host is waiting for that.
    pub fn packing(&self) {
        for port in [Port::Serial, Port::Usb] {
            if let Some(settings) = take_packing(port) {
                self.writers.borrow_mut().lock(|writers| writers.line(To::Host(port), settings));
            }
        }
    }

    /// Reports the bytes that came too fast, and a lost USB port.
    pub fn line_troubles(&self, LineTroubles { lost_bytes, usb_has_failed }: LineTroubles) {
        if lost_bytes > 0 {
            self.line(format_args!("echo:serial: {lost_bytes} bytes lost"));
        }
        if usb_has_failed {
            self.line(format_args!("echo:usb: off, the controller reports another speed than full speed"));
        }
    }
}

/// Counts of losses since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Overload {
    /// Number of blocks that left the look-ahead ring early because steps ran out.
    starvation_flushes: u64,
    planning_slowdowns: u64,
    underruns: u64,
    missed_updates: u64,
    refused_entries: u64,
    miscounts: u64,
}

impl Overload {
    /// Extracts the loss counts from the motion figures.
    pub fn of(figures: &MotionFigures) -> Self {
        let MotionFigures {
            starvation_flushes,
            planning_slowdowns,
            underruns,
            missed_updates,
            refused_entries,
            miscounts,
            ..
        } = *figures;
        Self { starvation_flushes, planning_slowdowns, underruns, missed_updates, refused_entries, miscounts }
    }
}

impl<W: Mutex<T = Writers>> BoardReplies<W> {
    /// Reports how often something could not keep up.
    pub fn overload(&self, overload: Overload) {
        let Overload { starvation_flushes, planning_slowdowns, underruns, missed_updates, refused_entries, miscounts } =
            overload;
        self.line(format_args!(
            "echo:overload starvation_flushes:{starvation_flushes} planning_slowdowns:{planning_slowdowns} \
             underruns:{underruns} missed_updates:{missed_updates} refused_entries:{refused_entries} miscounts:{miscounts}"
        ));
    }

    /// Reports that the beginning of a line was dropped, because its connection ended or the line
    /// did not fit.
    pub fn half_a_line(&self) {
        self.line(format_args!("echo:usb: half a line dropped"));
    }

    fn line(&self, text: fmt::Arguments<'_>) {
        self.writers.borrow_mut().lock(|writers| writers.line(self.to.get(), text));
    }
}

impl<W: Mutex<T = Writers>> Replies for BoardReplies<W> {
    fn send(&self, reply: Reply<'_>) {
        self.line(format_args!("{reply}"));
    }

    // Formatted while it is sent: a separate text would take 500 bytes on the stacks of two tasks.
    fn say(&self, line: fmt::Arguments<'_>) {
        self.line(line);
    }
}
