//! Counts the processor's instructions for the parts of a print, for `cargo xtask bench`.
//!
//! In the emulator the timer that is read here advances once an instruction, so the numbers are
//! exact: the same on every run and every machine. What an instruction costs on silicon (flash wait
//! states, interrupt entry) is not in them. It is an RTIC application so that the step interrupt is
//! the firmware's, dispatch included.
#![no_std]
#![no_main]

mod counter;

use cortex_m_semihosting::{debug, hprintln};
use defmt_rtt as _;
use ferrostep_bench::figures::StepEvents;
use ferrostep_bench::queue::{BenchQueue, LineQueues, PrintQueue, SHORT_QUEUE_SLOTS};
use ferrostep_bench::report::{Lines, Print, Report, Workload};
use ferrostep_bench::span::Counter;
use ferrostep_bench::step_events::{FOUR_AXES, STAIR_EVENTS};
use ferrostep_bench::{PROFILE, pieces, prepared, shaped, step_events, whole_print, wu_lines};
use ferrostep_planner::look_ahead::Slot;
use ferrostep_step_player::BothEdges;
use ferrostep_stm32f4_board::motion_clock::MotionClock;
use panic_probe as _;

/// Blocks in the look-ahead ring, as in the firmware.
const LOOK_AHEAD_BLOCKS: usize = 128;

/// X and Y of a trapezoid 30 mm long whose second motor steps with three of the first
/// one's four steps.
const TWO_AXES_MM: [i64; 2] = [24, 18];

/// X and Y of the same length along X alone.
const ONE_AXIS_MM: [i64; 2] = [30, 0];

#[rtic::app(device = ferrostep_stm32f4_board::pac, peripherals = true)]
mod app {
    use ferrostep_planner::look_ahead::Slot;
    use ferrostep_step_player::{BothEdges, Pulses, StepPlayer};
    use ferrostep_stm32f4_board::board::BoardPins;
    use ferrostep_stm32f4_board::motion_clock::MotionClock;
    use ferrostep_stm32f4_board::pac::Interrupt;
    use ferrostep_stm32f4_board::step_timer::StepTimer;

    use crate::{LOOK_AHEAD_BLOCKS, Queues};
    use ferrostep_bench::queue::{self, LINE_QUEUE_SLOTS, LineQueues, Ports, SHORT_QUEUE_SLOTS, STEP_QUEUE_SLOTS};
    use ferrostep_bench::report::Lines;
    use ferrostep_profile_constant::StepSignals;

    static STEPS: StepPlayer<StepSignals, 1, STEP_QUEUE_SLOTS> = StepPlayer::new();
    static EDGES: StepPlayer<BothEdges, 1, SHORT_QUEUE_SLOTS> = StepPlayer::new();
    static EDGES_ON_TWO_PORTS: StepPlayer<BothEdges, 2, SHORT_QUEUE_SLOTS> = StepPlayer::new();
    static EDGES_ON_THREE_PORTS: StepPlayer<BothEdges, 3, SHORT_QUEUE_SLOTS> = StepPlayer::new();

    static LINE_EDGES: StepPlayer<BothEdges, 1, LINE_QUEUE_SLOTS> = StepPlayer::new();
    static LINE_PULSES: StepPlayer<Pulses, 1, LINE_QUEUE_SLOTS> = StepPlayer::new();

    #[shared]
    struct Shared {
        #[lock_free]
        print: StepTimer<StepSignals, 1, STEP_QUEUE_SLOTS>,
        #[lock_free]
        one_port: StepTimer<BothEdges, 1, SHORT_QUEUE_SLOTS>,
        #[lock_free]
        two_ports: StepTimer<BothEdges, 2, SHORT_QUEUE_SLOTS>,
        #[lock_free]
        three_ports: StepTimer<BothEdges, 3, SHORT_QUEUE_SLOTS>,
    }

    #[local]
    struct Local {
        queues: Queues,
        clock: MotionClock,
        ring: &'static mut [Slot],
        lines: &'static mut Lines,
    }

    #[init(local = [
        slots: [Slot; LOOK_AHEAD_BLOCKS] = [Slot::EMPTY; LOOK_AHEAD_BLOCKS],
        of_lines: Lines = Lines::NONE,
    ])]
    fn init(cx: init::Context) -> (Shared, Local) {
        let device = cx.device;
        let ports = (device.GPIOA, device.GPIOB, device.GPIOC, device.GPIOD, device.GPIOE, device.GPIOF, device.GPIOG);
        let ports = Ports::new(&BoardPins::new(ports, [None; 3], &[]));
        let clock = MotionClock::start(device.TIM5, &device.RCC);
        let (Some(print), Some(of_one), Some(of_two), Some(of_three), Some(edges), Some(pulses)) = (
            queue::start(&device.RCC, ports, &STEPS, Interrupt::SPI3),
            queue::start(&device.RCC, ports, &EDGES, Interrupt::SPI2),
            queue::start(&device.RCC, ports, &EDGES_ON_TWO_PORTS, Interrupt::TIM3),
            queue::start(&device.RCC, ports, &EDGES_ON_THREE_PORTS, Interrupt::SPI1),
            queue::start(&device.RCC, ports, &LINE_EDGES, Interrupt::SPI2),
            queue::start(&device.RCC, ports, &LINE_PULSES, Interrupt::SPI3),
        ) else {
            panic!("a port has 16 pins")
        };
        let lines = LineQueues { edges: edges.1, pulses: pulses.1 };
        let queues = Queues { print: print.1, of_one: of_one.1, of_two: of_two.1, of_three: of_three.1, lines };
        let shared = Shared { print: print.0, one_port: of_one.0, two_ports: of_two.0, three_ports: of_three.0 };
        (shared, Local { queues, clock, ring: cx.local.slots, lines: cx.local.of_lines })
    }

    /// The firmware's step interrupt. Here it is not at TIM2, where the timer would call it.
    #[task(binds = SPI3, priority = 16, shared = [print])]
    fn print(cx: print::Context) {
        cx.shared.print.update();
    }

    /// The same for drivers that step at both edges.
    #[task(binds = SPI2, priority = 16, shared = [one_port])]
    fn one_port(cx: one_port::Context) {
        cx.shared.one_port.update();
    }

    /// The same with motors on two ports.
    #[task(binds = TIM3, priority = 16, shared = [two_ports])]
    fn two_ports(cx: two_ports::Context) {
        cx.shared.two_ports.update();
    }

    /// The same with motors on three ports.
    #[task(binds = SPI1, priority = 16, shared = [three_ports])]
    fn three_ports(cx: three_ports::Context) {
        cx.shared.three_ports.update();
    }

    /// Handler that the others call for unusual events: it acts for the one of them that
    /// is being played.
    #[task(binds = TIM1_BRK_TIM9, priority = 16, shared = [print, one_port, two_ports, three_ports])]
    fn start_or_end(cx: start_or_end::Context) {
        if queue::is_playing(Interrupt::SPI2) {
            cx.shared.one_port.start_or_end();
        } else if queue::is_playing(Interrupt::TIM3) {
            cx.shared.two_ports.start_or_end();
        } else if queue::is_playing(Interrupt::SPI1) {
            cx.shared.three_ports.start_or_end();
        } else {
            cx.shared.print.start_or_end();
        }
    }

    #[idle(local = [queues, clock, ring, lines])]
    fn idle(cx: idle::Context) -> ! {
        crate::run(*cx.local.clock, cx.local.queues, cx.local.ring, cx.local.lines)
    }
}

/// Queues: the firmware's; those of drivers that step at both edges, with motors on one port, two,
/// and three; and the lines'.
pub struct Queues {
    print: PrintQueue,
    of_one: BenchQueue<BothEdges, 1, SHORT_QUEUE_SLOTS>,
    of_two: BenchQueue<BothEdges, 2, SHORT_QUEUE_SLOTS>,
    of_three: BenchQueue<BothEdges, 3, SHORT_QUEUE_SLOTS>,
    lines: LineQueues,
}

/// Measures, prints the result, and ends the emulator.
fn run(clock: MotionClock, queues: &mut Queues, ring: &mut [Slot], lines: &mut Lines) -> ! {
    let outcome = counter::start(clock).and_then(|counter| {
        if cfg!(feature = "tally") {
            tally(&counter, queues, ring, lines).map(|workload| hprintln!("{}", workload))
        } else {
            measure(&counter, queues, ring, lines).map(|report| hprintln!("{}", report))
        }
    });
    match outcome {
        Ok(()) => debug::exit(debug::EXIT_SUCCESS),
        Err(reason) => hprintln!("{}", reason),
    }
    debug::exit(debug::EXIT_FAILURE);
    halt()
}

/// Measures every piece, then all of them together.
fn measure<'a>(
    counter: &Counter,
    queues: &mut Queues,
    ring: &mut [Slot],
    lines: &'a mut Lines,
) -> Result<Report<'a>, &'static str> {
    let Queues { print: queue, of_one, of_two, of_three, lines: line_queues } = queues;
    let step_event = StepEvents {
        profile: step_events::stairs(counter, queue, FOUR_AXES, STAIR_EVENTS)?,
        two_ports: step_events::stairs(counter, of_two, FOUR_AXES, STAIR_EVENTS)?,
        three_ports: step_events::stairs(counter, of_three, FOUR_AXES, STAIR_EVENTS)?,
        ..step_events::synthetic(counter, of_one)?
    };
    wu_lines::measure(counter, line_queues, lines)?;
    let mut report = Report {
        step_event,
        parse_line: pieces::parse_lines(counter)?,
        line_to_block: pieces::lines_to_blocks(counter, &PROFILE, ring, queue)?,
        block_full_look_ahead: pieces::moves_to_blocks(counter, &PROFILE, ring, queue)?,
        trapezoid: pieces::trapezoid(counter, &PROFILE, ring, queue, TWO_AXES_MM)?,
        trapezoid_one_axis: pieces::trapezoid(counter, &PROFILE, ring, queue, ONE_AXIS_MM)?,
        shaped: shaped::measure(counter, &PROFILE, ring, queue)?,
        lines,
        prepared: prepared::measure(counter, &PROFILE, ring, queue)?,
        print: Print::default(),
    };
    report.print = whole_print::measure(counter, &PROFILE, ring, queue, &mut report.step_event)?;
    Ok(report)
}

/// Counts the workload of each measurement.
fn tally<'a>(
    counter: &Counter,
    queues: &mut Queues,
    ring: &mut [Slot],
    lines: &'a mut Lines,
) -> Result<Workload<'a>, &'static str> {
    let Queues { print: queue, lines: line_queues, .. } = queues;
    wu_lines::measure(counter, line_queues, lines)?;
    pieces::trapezoid(counter, &PROFILE, ring, queue, TWO_AXES_MM)?;
    let trapezoid = queue.take_tally();
    pieces::trapezoid(counter, &PROFILE, ring, queue, ONE_AXIS_MM)?;
    let trapezoid_one_axis = queue.take_tally();
    whole_print::measure(counter, &PROFILE, ring, queue, &mut StepEvents::default())?;
    Ok(Workload { trapezoid, trapezoid_one_axis, print: queue.take_tally(), lines })
}

fn halt() -> ! {
    loop {
        cortex_m::asm::wfi();
    }
}
