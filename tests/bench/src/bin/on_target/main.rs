//! Tests on the board itself, over a debug probe: `cargo xtask on-target --board NAME`.
//!
//! They count cycles where `cargo xtask bench` counts instructions, and compare them with limits on
//! which the rest relies: duration of a step, its lateness, and moves a second that the planner
//! keeps up with. The board is reset before each. No motor has current and no heater power: the
//! pins of both stay as reset has left them.
#![no_std]
#![no_main]

mod counter;
mod handlers;

use cortex_m::peripheral::NVIC;
use cortex_m_semihosting::hprintln;
use defmt_rtt as _;
use ferrostep_bench::queue::{self, BenchQueue, Ports, SHORT_QUEUE_SLOTS, STEP_QUEUE_SLOTS};
use ferrostep_bench::{PROFILE, cube_lines, pieces, step_events};
use ferrostep_gcode::Emergency;
use ferrostep_hal_shim::StepQueue;
use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::{StepEntry, TICKS_PER_SECOND};
use ferrostep_profile_constant::StepSignals;
use ferrostep_step_player::{BothEdges, MIN_GAP_TICKS, Pulses, StepFeeder, StepPlayer, Stepping};
use ferrostep_stm32f4::clock_tree::Clock;
use ferrostep_stm32f4_board::board::{BoardPins, MOTOR_PORTS, PIN_MAP};
use ferrostep_stm32f4_board::clock;
use ferrostep_stm32f4_board::measured::{self, Measured, Switch};
use ferrostep_stm32f4_board::motion_clock::MotionClock;
use ferrostep_stm32f4_board::pac::{Interrupt, Peripherals};
use ferrostep_stm32f4_board::step_timer::{MotorQueue, StepTimer};
use ferrostep_stm32f4_board::vector_table::VectorTable;
use ferrostep_stm32f4_usb::{Memory, Rings, Usb};
use heapless::spsc::Queue;
use panic_probe as _;

use counter::Cycles;
use handlers::TIMED_QUEUE_SLOTS;

/// Cycles of a step event inside a stair, the way into the interrupt and back included. 19
/// instructions are 49 cycles by the model of `cargo xtask bench`; a look into flash past its
/// cache adds up to 7.
const MAX_CYCLES_WITHIN: u32 = 80;

/// The same of an event that ends a stair, 33 instructions.
const MAX_CYCLES_NEW: u32 = 120;

/// Cycles of a step event as M798 measures it: with one look at the time after it, and a call.
const MAX_CYCLES_MEASURED: u32 = MAX_CYCLES_NEW + 30;

/// Ticks of the step timer, two cycles each, from the moment at which a step is due to the first
/// look at the time in its interrupt: 12 cycles to enter it, up to 17 more with the state of the
/// floating-point unit, the way to the look, and what flash adds.
const MAX_TICKS_LATE: u32 = 40;

/// Cycles from a move to its block in the full look-ahead ring. 1500 instructions, 2100 cycles by
/// that model, of the 21,000 that a move has at 8000 moves a second.
const MAX_CYCLES_BLOCK: u32 = 4_000;

/// Ticks between step events while the USB port is served: 100,000 a second, which is what the
/// firmware is specified for. On a slower clock they are as many cycles apart.
const INTERVAL_TICKS: u32 = TICKS_PER_SECOND / 100_000;

/// Time for which steps are timed, s. A computer at the other end of the cable has the port
/// set up within that.
const TIMED_S: u32 = 5;

/// Slots that stay free, since an entry takes some.
const LEFT_SLOTS: usize = 8;

/// Bytes of the port's rings.
const RING_BYTES: usize = 512;

/// Blocks in the look-ahead ring, as in the firmware.
const LOOK_AHEAD_BLOCKS: usize = 128;

static EDGES: StepPlayer<BothEdges, 1, SHORT_QUEUE_SLOTS> = StepPlayer::new();
static PRINT: StepPlayer<StepSignals, 1, STEP_QUEUE_SLOTS> = StepPlayer::new();
static STEPS: StepPlayer<StepSignals, MOTOR_PORTS, TIMED_QUEUE_SLOTS> = StepPlayer::new();
static PULSES: StepPlayer<Pulses, MOTOR_PORTS, TIMED_QUEUE_SLOTS> = StepPlayer::new();

/// Reason for which a test has failed.
type Failure = &'static str;

/// A board that runs at its clock.
struct Board {
    device: Peripherals,
    core: cortex_m::Peripherals,
    clock: Clock,
    motion_clock: MotionClock,
}

impl Board {
    fn start() -> Result<Self, Failure> {
        // SAFETY: once a reset, before anything else has them.
        let device = unsafe { Peripherals::steal() };
        let core = cortex_m::Peripherals::take().ok_or("started twice")?;
        // SAFETY: TIM5 has no other owner, and the clock is started before the rest of what
        // was stolen is used.
        let Peripherals { TIM5: timer, RCC: rcc, .. } = unsafe { Peripherals::steal() };
        let (clock, rcc) = clock::start(rcc, &device.FLASH);
        let motion_clock = MotionClock::start(timer, &rcc);
        Ok(Self { device, core, clock, motion_clock })
    }
}

/// Logs a figure, and fails if it is above its bound.
fn hold(what: &str, figure: u32, unit: &str, most: u32) -> Result<(), Failure> {
    hprintln!("{}: {} {}, at most {}", what, figure, unit, most);
    if figure <= most { Ok(()) } else { Err("more than its bound") }
}

/// The pins of motors, which have no current.
fn pins() -> BoardPins {
    // SAFETY: reset has made them inputs, and nothing but the step timer uses them.
    let device = unsafe { Peripherals::steal() };
    let ports = (device.GPIOA, device.GPIOB, device.GPIOC, device.GPIOD, device.GPIOE, device.GPIOF, device.GPIOG);
    BoardPins::new(ports, [None; 3], &[])
}

/// The clock is what the board's file says: the core's own counter against a timer's.
fn the_core_runs_at_its_clock(board: Board) -> Result<(), Failure> {
    let Board { core, clock, motion_clock, .. } = board;
    let core_cycles = Cycles::start(core.DCB, core.DWT, motion_clock);
    let counter = counter::start(core_cycles);
    let before = motion_clock.now_ticks();
    let (cycles, ()) = counter.count(|| cortex_m::asm::delay(1_000_000));
    let ticks = motion_clock.now_ticks().wrapping_sub(before);
    let expected = if core_cycles.are_of_core() { clock.core.raw() / clock.slow_timers.raw() } else { 1 };
    hprintln!("{} Hz by its clock tree; {} cycles in {} ticks", clock.core.raw(), cycles, ticks);
    // A reading of the two counters apart.
    let off = (ticks * expected).abs_diff(cycles);
    hold("cycles that the timer does not see", off, "cycles", 200)
}

/// The step interrupt, event by event.
fn a_step_event_takes_its_cycles(board: Board) -> Result<(), Failure> {
    let Board { device, core, motion_clock, .. } = board;
    let mut controller = core.NVIC;
    let counter = counter::start(Cycles::start(core.DCB, core.DWT, motion_clock));
    let (timer, mut queue): (_, BenchQueue<BothEdges, 1, SHORT_QUEUE_SLOTS>) =
        queue::start(&device.RCC, Ports::new(&pins()), &EDGES, Interrupt::SPI2).ok_or("a port has 16 pins")?;
    handlers::play_when_called(timer, &mut controller);
    let events = step_events::stairs(&counter, &mut queue, step_events::FOUR_AXES, step_events::STAIR_EVENTS)?;
    let within = events.most_within.ok_or("no event was counted")?;
    let new = events.new.ok_or("no stair was counted")?;
    hold("an event inside a stair", within, "cycles", MAX_CYCLES_WITHIN)?;
    hold("an event that ends a stair", new, "cycles", MAX_CYCLES_NEW)
}

/// Moves to blocks in the full look-ahead ring.
fn a_block_is_planned_in_its_time(board: Board) -> Result<(), Failure> {
    let Board { device, core, motion_clock, .. } = board;
    let counter = counter::start(Cycles::start(core.DCB, core.DWT, motion_clock));
    let slots = cortex_m::singleton!(: [Slot; LOOK_AHEAD_BLOCKS] = [Slot::EMPTY; LOOK_AHEAD_BLOCKS]);
    let ring = slots.ok_or("started twice")?;
    // The steps are dropped: the queue never plays.
    let (_timer, mut queue) =
        queue::start(&device.RCC, Ports::new(&pins()), &PRINT, Interrupt::SPI3).ok_or("a port has 16 pins")?;
    let blocks = pieces::moves_to_blocks(&counter, &PROFILE, ring, &mut queue)?;
    let each = (blocks.total() / cube_lines::LINES.len() as u64) as u32;
    hold("a block into the full ring", each, "cycles", MAX_CYCLES_BLOCK)
}

/// Intervals of the steps whose time is taken, ticks: the shortest there is among longer ones, so
/// that a reload value that is late shows.
const CHANGING_TICKS: [u32; 3] = [2 * MIN_GAP_TICKS, 1_680, 4_200];

/// Time for which they are played, s.
const PLAYED_S: u32 = 10;

/// Maximum error of their time, ticks: a look at either end falls somewhere into a step, and one
/// interrupt may be late.
const MAX_TICKS_OFF: u32 = 2 * 4_200 + MAX_TICKS_LATE;

/// Duration of this many steps at those intervals, ticks modulo 2^32.
fn ticks_of(steps: u32) -> u32 {
    let all: u32 = CHANGING_TICKS.iter().sum();
    let (rounds, rest) = (steps / CHANGING_TICKS.len() as u32, steps as usize % CHANGING_TICKS.len());
    rounds.wrapping_mul(all).wrapping_add(CHANGING_TICKS.iter().take(rest).sum())
}

/// Steps at changing intervals take as long as they say, and the second timer counts the
/// updates of the first.
fn steps_take_the_time_that_they_say<M: Stepping>(
    board: Board,
    player: &'static StepPlayer<M, MOTOR_PORTS, TIMED_QUEUE_SLOTS>,
    play: fn(StepTimer<M, MOTOR_PORTS, TIMED_QUEUE_SLOTS>, &mut NVIC),
) -> Result<(), Failure> {
    let Board { device, core, clock, motion_clock } = board;
    let mut controller = core.NVIC;
    let on_silicon = Cycles::start(core.DCB, core.DWT, motion_clock).are_of_core();
    let timer = StepTimer::start(device.TIM2, device.TIM9, &device.RCC, &pins(), player);
    let mut queue = MotorQueue::new(
        pins(),
        StepFeeder::new(player, PIN_MAP, PROFILE.driver.signals(clock.slow_timers.raw())),
        None,
    );
    play(timer, &mut controller);
    let mut queued = 0usize;
    let (mut began, mut missed) = (None, 0);
    loop {
        while queue.room() > LEFT_SLOTS {
            let interval = CHANGING_TICKS[queued % CHANGING_TICKS.len()];
            let step = StepEntry::stair(interval, 1, step_events::FOUR_AXES, 0).ok_or("a stair without events")?;
            queue.push(step).map_err(|_| "an entry was refused")?;
            queued += 1;
        }
        if !queue.link().is_running() {
            queue.start();
        }
        missed += queue.take_missed_updates();
        // Each step is a slot. Both looks together, or a step would come in between.
        let (played, now) = critical_section::with(|_| (queue.played(), motion_clock.now_ticks()));
        if played == 0 {
            // The idle timer's gap before the first step does not belong to a step.
            continue;
        }
        let (first, from) = *began.get_or_insert((played, now));
        let elapsed = now.wrapping_sub(from);
        if elapsed < PLAYED_S * clock.slow_timers.raw() {
            continue;
        }
        let planned = ticks_of(played).wrapping_sub(ticks_of(first));
        let steps = played.wrapping_sub(first);
        hprintln!("{} steps: {} ticks planned, {} measured, {} updates missed", steps, planned, elapsed, missed);
        if steps < PLAYED_S * clock.slow_timers.raw() / 4_200 {
            return Err("the steps did not come");
        }
        if !on_silicon {
            hprintln!("whether that is right is for a board to say, or for an emulator whose core counts its cycles");
            return Ok(());
        }
        if !queue.has_update_count() {
            return Err("TIM9 does not answer");
        }
        hold("updates missed", missed, "updates", 0)?;
        return hold("the steps' time off their plan", elapsed.abs_diff(planned), "ticks", MAX_TICKS_OFF);
    }
}

/// Keeps the queue full of single steps of all motors.
fn steps(queue: &mut impl StepQueue) -> Result<(), Failure> {
    while queue.room() > LEFT_SLOTS {
        let entry = StepEntry::stair(INTERVAL_TICKS, step_events::STAIR_EVENTS, step_events::FOUR_AXES, 0);
        queue.push(entry.ok_or("a stair without events")?).map_err(|_| "an entry was refused")?;
    }
    if !queue.link().is_running() {
        queue.start();
    }
    Ok(())
}

fn ignore(_emergency: Emergency) {}

/// Steps by the timer while the USB port is served as fast as it can be, and critical sections come
/// and go: how late the step interrupt begins.
fn a_step_is_on_time_under_usb_load(board: Board) -> Result<(), Failure> {
    let Board { device, core, clock, motion_clock } = board;
    let mut controller = core.NVIC;
    let timer = StepTimer::start(device.TIM2, device.TIM9, &device.RCC, &pins(), &STEPS);
    let mut queue = MotorQueue::new(
        pins(),
        StepFeeder::new(&STEPS, PIN_MAP, PROFILE.driver.signals(clock.slow_timers.raw())),
        None,
    );
    handlers::play(timer, &mut controller);

    let memory = cortex_m::singleton!(: Memory = Memory::new()).ok_or("started twice")?;
    let receive = cortex_m::singleton!(: Queue<u8, RING_BYTES> = Queue::new()).ok_or("started twice")?;
    let send = cortex_m::singleton!(: Queue<u8, RING_BYTES> = Queue::new()).ok_or("started twice")?;
    let (received, mut to_read) = receive.split();
    let (mut to_write, to_send) = send.split();
    let registers = (device.OTG_FS_GLOBAL, device.OTG_FS_DEVICE, device.OTG_FS_PWRCLK);
    let rings = Rings { received, to_send, act: ignore, note_line: || {}, report_packing: |_| {} };
    match Usb::start(memory, registers, &device.RCC, &clock, rings) {
        Ok(usb) => handlers::serve(usb, &mut controller),
        Err(why) => hprintln!("no USB here: {}", why),
    }

    let mut switch = Switch::new(VectorTable::new(core.SCB), core.DCB, core.DWT, motion_clock);
    switch.set(true);
    let began = motion_clock.now_ticks();
    let mut bytes = 0u32;
    while motion_clock.now_ticks().wrapping_sub(began) < TIMED_S * clock.slow_timers.raw() {
        steps(&mut queue)?;
        cortex_m::peripheral::NVIC::pend(Interrupt::OTG_FS);
        // Echo: packets both ways, as many as the computer sends.
        while let Some(byte) = to_read.dequeue() {
            bytes += 1;
            let _ = to_write.enqueue(byte);
        }
        // A critical section like a signal's or the log's, and longer.
        critical_section::with(|_| cortex_m::asm::delay(1_000));
    }
    switch.set(false);
    let [latency, duration, _] = measured::all();
    for Measured { name, unit, summary } in [latency, duration] {
        hprintln!(
            "{}: {} steps, half of them within {} {}, 99.9 % within {}, at most {}",
            name,
            summary.count,
            summary.p50,
            unit,
            summary.p99_9,
            summary.max
        );
    }
    hprintln!("{} bytes by USB", bytes);
    // The number is at least half of the expected one: the interrupt ran at all.
    if latency.summary.count < TIMED_S * clock.slow_timers.raw() / INTERVAL_TICKS / 2 {
        return Err("the steps did not come");
    }
    hold("a step, with what measuring it takes", duration.summary.max, duration.unit, MAX_CYCLES_MEASURED)?;
    if duration.unit != "cycles" {
        hprintln!("how late steps are is not told: an emulator's step timer counts on from update to update");
        return Ok(());
    }
    hold("a step later than due", latency.summary.max, latency.unit, MAX_TICKS_LATE)
}

#[embedded_test::tests]
mod tests {
    use super::{Board, Failure};

    #[init]
    fn init() -> Result<Board, Failure> {
        Board::start()
    }

    #[test]
    fn the_core_runs_at_its_clock(board: Result<Board, Failure>) -> Result<(), Failure> {
        super::the_core_runs_at_its_clock(board?)
    }

    #[test]
    fn a_step_event_takes_its_cycles(board: Result<Board, Failure>) -> Result<(), Failure> {
        super::a_step_event_takes_its_cycles(board?)
    }

    #[test]
    fn a_block_is_planned_in_its_time(board: Result<Board, Failure>) -> Result<(), Failure> {
        super::a_block_is_planned_in_its_time(board?)
    }

    #[test]
    #[timeout(60)]
    fn steps_take_the_time_that_they_say(board: Result<Board, Failure>) -> Result<(), Failure> {
        super::steps_take_the_time_that_they_say(board?, &super::STEPS, super::handlers::play)
    }

    #[test]
    #[timeout(60)]
    fn pulses_take_the_time_that_they_say(board: Result<Board, Failure>) -> Result<(), Failure> {
        super::steps_take_the_time_that_they_say(board?, &super::PULSES, super::handlers::play_pulses)
    }

    #[test]
    #[timeout(30)]
    fn a_step_is_on_time_under_usb_load(board: Result<Board, Failure>) -> Result<(), Failure> {
        super::a_step_is_on_time_under_usb_load(board?)
    }

    /// A panic is in the log with its place, and stops the core.
    #[test]
    #[should_panic]
    fn a_panic_is_noticed(_board: Result<Board, Failure>) {
        panic!("on purpose")
    }
}
