//! The firmware: RTIC tasks of a few lines, their priorities, and nothing else.
//!
//! | priority | task | trigger | resources | worst-case job |
//! |---|---|---|---|---|
//! | 16 | `TIM2` in `step-interrupt/`, not a task of RTIC's | TIM2 update | its own: timer, ports, a ring of words | the event that ends a stair: 31 instructions |
//! | 16 | `TIM1_BRK_TIM9`, there as well | `TIM2`, `planner` | the same | the start of a motion: 80 instructions |
//! | 15 | `servo` | TIM6, twice in 20 ms while a probe's pin gets a command | `local` only | an edge of the pulse |
//! | 15 | `sensor_*` | an edge at the sensor that an axis seeks (EXTI) | `sensors`: pins | 8 looks at a pin, the stop of the step timer |
//! | 14 | `driver_line`, `driver_pins` | USART2, or TIM7 four times a bit | `driver_line`: the line to the motors' drivers | a byte, or a quarter of a bit |
//! | 13 | `serial` | USART1 | `local` only: port, two byte rings, the emergency scanner | 16 bytes to send, the received one; M112 |
//! | 10 | `usb` | OTG_FS, or something to send | `local` only: the device, two byte rings | four packets in, what fits out; M112 |
//! | 9 | SysTick (rtic-monotonics) | every ms | the queue of waits | wakes the tasks whose waits end |
//! | 8 | `temperature` | every 10 ms | `heat`, watchdog | 160 conversions, two medians, two PID loops and their checks |
//! | 8 | `emergency` | M112 | `heat` | heaters off |
//! | 8 | `tachometers` | every ms, on a board that has any | | looks at each fan's line |
//! | 4 | `planner` | a move, or 2 ms | `machine`, `heat` | fills the step queue: 256 portions a lock; looks at the filament's encoder, the supply's signal and the button |
//! | 2 | `printer` | received bytes | `machine`, `heat`, `writers`, `drivers`, `records`, `mailbox` | one line, one item of a job; a wait is an await |
//! | 1 | `drivers` | every ms while a datagram is under way | `drivers`, `driver_line`, `machine`, `writers`, `records` | a datagram's end, and the next |
//! | 1 | `accelerometer` | every 2 ms, on a board with a plug for one | `recorder`, `machine`, `writers` | a sample and its line: 40 us on the bus; at most 34 in a row |
//! | 1 | `reports` | a halt, or 100 ms | `machine`, `heat`, `writers`, `records` | M155's line |
//! | 0 | `idle` | whenever nothing else runs | `mailbox` | a block of the memory card, up to 1.1 s; any task may interrupt it |
//!
//! 16 is above what BASEPRI can mask, and critical sections mask no more than that
//! (`hal-shim/critical-section/`): nothing delays a step. So the two step handlers must never share
//! anything with a task below, nor use a signal or the log. `machine` has ceiling 4, `heat` 8,
//! `writers` and `records` 2: the planner cannot delay heater control, and no task can delay the
//! receiving of bytes.
#![no_std]
#![no_main]
#![deny(unsafe_code)]

mod accelerometer;
mod black_box;
mod button;
mod card;
mod clock;
mod commands;
mod drivers;
mod fans;
mod fault;
mod filament;
mod greeting;
mod heat;
mod host_line;
mod host_start;
mod identity;
mod job_line;
mod part;
mod ports;
mod profile;
mod reports;
#[cfg(settings_memory)]
mod settings_memory;
mod supply;
mod timing;
mod wiring;

use defmt_rtt as _;

/// Sleeps until an interrupt. A separate function in every image, because tests replace its code.
#[inline(never)]
fn sleep() {
    cortex_m::asm::wfi();
}

#[rtic::app(device = ferrostep_stm32f4_board::pac, peripherals = true, dispatchers = [SPI1, SPI2, SPI3, I2C1_EV])]
mod app {
    use core::cell::RefCell;
    use core::mem::MaybeUninit;
    use core::sync::atomic::{AtomicBool, Ordering};

    use ferrostep_gcode::Emergency;
    use ferrostep_planner::look_ahead::Slot;
    use ferrostep_printer::Signals;
    use ferrostep_printer::heat::SAMPLE_MS;
    use ferrostep_step_interrupt::{self as step_interrupt, STEPS};
    use ferrostep_stm32f4::life_signs::{LifeSigns, Task, Vigil};
    use ferrostep_stm32f4_board::board::BoardPins;
    use ferrostep_stm32f4_board::clock;
    use ferrostep_stm32f4_board::driver_line::DriverLine;
    use ferrostep_stm32f4_board::measured::Switch;
    use ferrostep_stm32f4_board::motion_clock::MotionClock;
    use ferrostep_stm32f4_board::serial::{Serial, Transmit};
    use ferrostep_stm32f4_board::servo::Servo;
    use ferrostep_stm32f4_board::settings_memory;
    use ferrostep_stm32f4_board::step_timer::{self, StepTimer};
    use ferrostep_stm32f4_board::supervision::{self, Watchdog};
    use ferrostep_stm32f4_board::thermal::FanSpeeds;
    use ferrostep_stm32f4_board::vector_table::VectorTable;
    use ferrostep_stm32f4_usb::{Memory, Usb};
    use heapless::spsc::Consumer;
    use rtic_monotonics::systick::prelude::*;
    use rtic_sync::signal::{Signal, SignalReader};

    use crate::accelerometer::{self as board_accelerometer, BoardRecorder};
    use crate::black_box::{self, Records};
    use crate::button::Button;
    use crate::card::{self, BoardCard, BoardMailbox};
    use crate::clock::Mono;
    #[cfg(any(drivers, tachometers, accelerometer))]
    use crate::clock::Period;
    use crate::commands;
    use crate::drivers as board_drivers;
    use crate::fans::SharedDemand;
    use crate::filament::Encoder;
    use crate::greeting::Start;
    use crate::heat::{self, Heat};
    use crate::host_line::{self, Patience, Reader, SerialInput, Writers};
    use crate::host_start::{Actions, HostLines, LineRings};
    use crate::job_line::JOB_BYTES;
    use crate::ports::{self, BoardHeating, BoardMachine, BoardReplies, LOOK_AHEAD_BLOCKS, PLANNER_WORK};
    use crate::profile::PROFILE;
    use crate::reports::Reports;
    use crate::supply::Supply;
    use crate::wiring::{BoardDriverLine, DRIVER_PINS, SENSOR_STORES, SENSORS};

    /// Priority of SysTick, which ends the waits of the tasks: above all tasks that wait, below the
    /// host's line.
    const WAITS_PRIORITY: u8 = 9;

    /// Interval at which the planner checks the step queue, ms: at 100,000 events per second an
    /// eighth of the queue.
    const PLANNER_INTERVAL_MS: u32 = 2;

    #[cfg(drivers)]
    /// Interval at which the drivers' task checks its line, ms: a datagram takes one to ten.
    const DRIVERS_INTERVAL_MS: u32 = 1;

    #[cfg(tachometers)]
    /// Interval at which the tachometers' task polls their lines, ms.
    const TACHOMETERS_INTERVAL_MS: u32 = 1;

    #[cfg(accelerometer)]
    /// Interval at which the accelerometer's task checks its samples, ms: at the fastest rate the
    /// chip's memory holds 10 ms of them.
    const ACCELEROMETER_INTERVAL_MS: u32 = 2;

    /// Interval of the reports task, ms.
    const REPORTS_INTERVAL_MS: u32 = 100;

    static SIGNALS: Signals = Signals::new();
    /// The planner task's latest fan demand.
    static FANS: SharedDemand = SharedDemand::new();
    /// Signs of life of the tasks.
    static LIFE: LifeSigns = LifeSigns::new();
    /// True if the board has a slot for a memory card, and a clock for it.
    static HAS_CARD: AtomicBool = AtomicBool::new(false);
    /// Signal that the machine has been halted; the reports task informs the hosts.
    static HALTED: Signal<()> = Signal::new();

    #[shared]
    struct Shared {
        /// Pins for the sensor tasks only.
        #[lock_free]
        sensors: BoardPins,
        /// Line for the drivers' task, and for the one of the two line interrupts that the board
        /// has.
        driver_line: BoardDriverLine,
        drivers: board_drivers::BoardDriverBank,
        recorder: BoardRecorder,
        machine: &'static mut BoardMachine,
        heat: Heat,
        writers: Writers,
        records: Records,
        mailbox: BoardMailbox,
    }

    #[local]
    struct Local {
        port: Serial,
        input: SerialInput,
        to_send: Consumer<'static, u8>,
        usb: Option<&'static mut Usb>,
        reader: Reader,
        planner_work: SignalReader<'static, ()>,
        halted: SignalReader<'static, ()>,
        motion_clock: MotionClock,
        drivers_clock: MotionClock,
        accelerometer_clock: MotionClock,
        fan_speeds: Option<FanSpeeds>,
        patience: Patience,
        measured: Switch,
        watchdog: Watchdog,
        vigil: Vigil,
        card: Option<BoardCard>,
    }

    #[init(local = [
        // Filled here and not by the compiler, which would keep a copy in flash.
        slots: heapless::Vec<Slot, LOOK_AHEAD_BLOCKS> = heapless::Vec::new(),
        machine: MaybeUninit<BoardMachine> = MaybeUninit::uninit(),
        rings: LineRings = LineRings::new(),
        usb_memory: Memory = Memory::new(),
    ])]
    fn init(cx: init::Context) -> (Shared, Local) {
        let device = cx.device;
        let mut core = cx.core;
        let reset_cause = supervision::reset_cause(&device.RCC);
        let brown_out = supervision::set_brown_out_level(&device.RCC, &device.FLASH);
        let (clock, rcc) = clock::start(device.RCC, &device.FLASH);
        clock::set_systick_priority(&mut core.SCB, WAITS_PRIORITY);
        Mono::start(core.SYST, clock.core.raw());
        let records = Records::start(reset_cause, &rcc);
        let motion_clock = MotionClock::start(device.TIM5, &rcc);
        let measured = Switch::new(VectorTable::new(core.SCB), core.DCB, core.DWT, motion_clock);
        let ports = (device.GPIOA, device.GPIOB, device.GPIOC, device.GPIOD, device.GPIOE, device.GPIOF, device.GPIOG);
        let pins = BoardPins::new(ports, SENSORS, &SENSOR_STORES);

        step_interrupt::start(StepTimer::start(device.TIM2, device.TIM9, &rcc, &pins, &STEPS), &mut core.NVIC);
        let queue = ports::motor_queue(pins, &clock, motion_clock);
        let machine = ports::build_machine(cx.local.machine, cx.local.slots, queue);
        // The build refuses a profile with methods that the image does not contain.
        if machine.set_motion_choice(&PROFILE.motion).is_err() {
            unreachable!("the build looks at the profile's methods")
        }
        if let Some(backlash) = &PROFILE.backlash {
            machine.set_backlash(backlash);
        }

        let ports = (device.USART1, (device.OTG_FS_GLOBAL, device.OTG_FS_DEVICE, device.OTG_FS_PWRCLK));
        let actions = Actions { act, note_line: || SIGNALS.note_host() };
        let HostLines { port, input, to_send, usb, mut writers, to_read } =
            HostLines::start(cx.local.rings, cx.local.usb_memory, ports, &rcc, &clock, actions);
        Start { clock: &clock, reset_cause, brown_out, no_usb: usb.as_ref().err() }.tell(&mut writers, &records);

        let converters = (device.ADC1, device.ADC3, device.ADC_COMMON, device.DMA2);
        let heat = Heat::new(&PROFILE, converters, &clock);
        let fan_speeds = FanSpeeds::start();
        #[cfg(servo)]
        ports::start_servo(device.TIM6, &clock);
        let driver_line = <BoardDriverLine as DriverLine>::start((device.USART2, device.TIM7), &clock, &DRIVER_PINS);
        let drivers = board_drivers::bank(&clock, motion_clock.now_ticks());
        let card = card::start(device.SDIO, &clock, motion_clock);
        settings_memory::start(device.FLASH);
        HAS_CARD.store(card.is_some(), Ordering::Relaxed);

        // Each of these is taken only here.
        let (Some(reader), Some(planner_work), Some(halted)) =
            (Reader::new(to_read, motion_clock), PLANNER_WORK.try_take_reader(), HALTED.try_take_reader())
        else {
            unreachable!("init runs once")
        };
        let spawned = (printer::spawn(), planner::spawn(), temperature::spawn(), reports::spawn());
        defmt::debug!("started: {}", matches!(spawned, (Ok(()), Ok(()), Ok(()), Ok(()))));
        #[cfg(drivers)]
        if drivers::spawn().is_err() {
            unreachable!("init runs once")
        }
        #[cfg(tachometers)]
        if tachometers::spawn().is_err() {
            unreachable!("init runs once")
        }
        #[cfg(accelerometer)]
        if accelerometer::spawn().is_err() {
            unreachable!("init runs once")
        }
        let recorder = board_accelerometer::recorder();
        (
            Shared {
                sensors: pins,
                driver_line,
                drivers,
                recorder,
                machine,
                heat,
                writers,
                records,
                mailbox: BoardMailbox::new(),
            },
            Local {
                port,
                input,
                to_send,
                usb: usb.ok(),
                reader,
                planner_work,
                halted,
                motion_clock,
                drivers_clock: motion_clock,
                accelerometer_clock: motion_clock,
                fan_speeds,
                patience: Patience::new(clock.source),
                measured,
                watchdog: Watchdog::start(device.IWDG),
                vigil: Vigil::default(),
                card,
            },
        )
    }

    /// Handles the trigger of a homing axis's sensor: the motors stop with the next instruction.
    /// There is one task for each interrupt that a sensor's pin may have.
    #[task(binds = EXTI0, priority = 15, shared = [sensors])]
    fn sensor_0(cx: sensor_0::Context) {
        cx.shared.sensors.sensed(STEPS.link());
    }

    #[task(binds = EXTI1, priority = 15, shared = [sensors])]
    fn sensor_1(cx: sensor_1::Context) {
        cx.shared.sensors.sensed(STEPS.link());
    }

    #[task(binds = EXTI2, priority = 15, shared = [sensors])]
    fn sensor_2(cx: sensor_2::Context) {
        cx.shared.sensors.sensed(STEPS.link());
    }

    #[task(binds = EXTI3, priority = 15, shared = [sensors])]
    fn sensor_3(cx: sensor_3::Context) {
        cx.shared.sensors.sensed(STEPS.link());
    }

    #[task(binds = EXTI4, priority = 15, shared = [sensors])]
    fn sensor_4(cx: sensor_4::Context) {
        cx.shared.sensors.sensed(STEPS.link());
    }

    #[task(binds = EXTI9_5, priority = 15, shared = [sensors])]
    fn sensor_5_to_9(cx: sensor_5_to_9::Context) {
        cx.shared.sensors.sensed(STEPS.link());
    }

    #[task(binds = EXTI15_10, priority = 15, shared = [sensors])]
    fn sensor_10_to_15(cx: sensor_10_to_15::Context) {
        cx.shared.sensors.sensed(STEPS.link());
    }

    #[cfg(servo)]
    /// Makes an edge of a pulse for the probe's servo; if this runs late, the pulse is too long or
    /// too short by as much.
    #[task(binds = TIM6_DAC, priority = 15, local = [servo: Servo = Servo::REST])]
    fn servo(cx: servo::Context) {
        cx.local.servo.interrupt();
    }

    /// Serves the drivers' shared line. Must take a byte before the second one after it: 174 us.
    #[task(binds = USART2, priority = 14, shared = [driver_line])]
    fn driver_line(mut cx: driver_line::Context) {
        cx.shared.driver_line.lock(DriverLine::interrupt);
    }

    /// Serves the drivers' separate lines. Must run within a tenth of a quarter bit, 1.3 us; so its
    /// priority is above all tasks that receive.
    #[task(binds = TIM7, priority = 14, shared = [driver_line])]
    fn driver_pins(mut cx: driver_pins::Context) {
        cx.shared.driver_line.lock(DriverLine::interrupt);
    }

    /// Moves serial bytes in and out. Must take a byte before the second one after it: 87 us at
    /// 115,200 baud.
    #[task(binds = USART1, priority = 13, local = [port, input, to_send])]
    fn serial(cx: serial::Context) {
        while let Some(byte) = cx.local.port.receive() {
            cx.local.input.receive(byte);
        }
        if cx.local.port.transmit(|| cx.local.to_send.dequeue()) == Transmit::Again {
            rtic::pend(ferrostep_stm32f4_board::pac::Interrupt::USART1);
        }
    }

    /// Moves packets of the USB port in and out. Must run within the 10 ms that a host allows a
    /// request.
    #[task(binds = OTG_FS, priority = 10, local = [usb])]
    fn usb(cx: usb::Context) {
        if let Some(usb) = cx.local.usb {
            host_line::usb_served(usb.serve());
        }
    }

    /// Executes a command that does not wait its turn, whichever host has sent it.
    fn act(emergency: Emergency) {
        match emergency {
            Emergency::Stop => {
                SIGNALS.halt();
                step_timer::stop(STEPS.link());
                // If the task is spawned already, that is enough.
                let _ = emergency::spawn();
            }
            // The line belongs to a file being written.
            Emergency::QuickStop | Emergency::EndWait if SIGNALS.is_writing() => {}
            Emergency::QuickStop => step_timer::stop(STEPS.link()),
            Emergency::EndWait => SIGNALS.end_wait(),
            Emergency::PromptAnswer(button) => SIGNALS.answer_prompt(button),
        }
    }

    /// Controls the heaters; a fault halts the machine. Must run every 10 ms, whatever the tasks
    /// below do; it catches up on late samples. Feeds the watchdog while the tasks below are alive.
    #[task(priority = 8, shared = [heat], local = [watchdog, vigil])]
    async fn temperature(mut cx: temperature::Context) {
        let mut next = Mono::now();
        loop {
            next += SAMPLE_MS.millis();
            Mono::delay_until(next).await;
            if cx.local.vigil.all_alive(&LIFE, SAMPLE_MS) {
                cx.local.watchdog.feed();
            }
            let outcome = cx.shared.heat.lock(|heat| heat.update(FANS.load()));
            if outcome.is_err() {
                SIGNALS.halt();
                step_timer::stop(STEPS.link());
                HALTED.writer().write(());
            }
        }
    }

    #[cfg(tachometers)]
    /// Counts the pulses of the fans' tachometers. Must run every few milliseconds: a pulse of a
    /// fast fan lasts two.
    #[task(priority = 8, local = [fan_speeds])]
    async fn tachometers(cx: tachometers::Context) {
        let Some(speeds) = cx.local.fan_speeds else { return };
        let mut period = Period::new(TACHOMETERS_INTERVAL_MS);
        loop {
            period.pass().await;
            speeds.look();
        }
    }

    /// Handles M112, after the motors have been stopped: switches off the heaters as soon as the
    /// line's interrupt returns, and the power supply.
    #[task(priority = 8, shared = [heat])]
    async fn emergency(mut cx: emergency::Context) {
        cx.shared.heat.lock(|heat| heat.halt());
        HALTED.writer().write(());
    }

    /// Keeps the step queue full. Must run before the queue's entries run out.
    #[task(priority = 4, shared = [machine, heat], local = [planner_work, motion_clock, patience])]
    async fn planner(mut cx: planner::Context) {
        let mut encoder = Encoder::new();
        let mut supply = Supply::new();
        let mut button = Button::new();
        loop {
            let silence = cx.local.patience.silence(cx.local.motion_clock.now_ticks());
            while cx.shared.machine.lock(|machine| {
                LIFE.show(Task::Planner);
                let more = machine.work(silence);
                FANS.store(&machine.fan_demand());
                heat::note_filament(machine);
                black_box::note_position(machine);
                encoder.look(machine, Mono::now().ticks(), &SIGNALS);
                more
            }) {}
            button.look(Mono::now().ticks(), &SIGNALS);
            if supply.has_failed(Mono::now().ticks(), &SIGNALS) {
                if SIGNALS.card_progress().is_some() {
                    // The printer's task saves the state of the print, and then halts.
                    step_timer::stop(STEPS.link());
                    cx.shared.heat.lock(|heat| heat.all_off());
                } else {
                    act(Emergency::Stop);
                }
            }
            // The planner looks in either case, woken or after the interval.
            let _ = Mono::timeout_at(Mono::now() + PLANNER_INTERVAL_MS.millis(), cx.local.planner_work.wait()).await;
        }
    }

    /// Turns lines into commands, and commands into moves and replies.
    #[task(priority = 2, shared = [machine, heat, writers, drivers, recorder, records, mailbox], local = [
        reader, measured, job: [u8; JOB_BYTES] = [0; JOB_BYTES],
    ])]
    async fn printer(cx: printer::Context) {
        let printer::SharedResources { machine, heat, writers, drivers, recorder, records, mailbox, .. } = cx.shared;
        let printer::LocalResources { reader, measured, job, .. } = cx.local;
        let mailbox = HAS_CARD.load(Ordering::Relaxed).then_some(mailbox);
        let shared = commands::Shared { machine, heat, writers, drivers, recorder, records, mailbox };
        let own = commands::Own { reader, measured, job };
        commands::execute(shared, own, &SIGNALS).await;
    }

    #[cfg(drivers)]
    /// Sets up the motor drivers and supervises them; a motor that has lost its position halts the
    /// machine.
    #[task(priority = 1, shared = [machine, writers, drivers, driver_line, records], local = [drivers_clock])]
    async fn drivers(cx: drivers::Context) {
        let drivers::SharedResources { mut machine, writers, mut drivers, mut driver_line, mut records, .. } =
            cx.shared;
        let replies = BoardReplies::new(writers);
        let mut line = board_drivers::Line(&mut driver_line);
        let mut period = Period::new(DRIVERS_INTERVAL_MS);
        loop {
            let now = cx.local.drivers_clock.now_ticks();
            if let Some(event) = drivers.lock(|bank| bank.poll(&mut line, now)) {
                let motors_on = machine.lock(|machine| machine.enabled_motors());
                records.lock(|records| records.driver(&event));
                if ferrostep_printer::tell_driver_event(&event, motors_on, &replies) && !SIGNALS.is_halted() {
                    act(Emergency::Stop);
                }
                continue;
            }
            period.pass().await;
        }
    }

    #[cfg(accelerometer)]
    /// Takes an accelerometer's samples and sends them as lines, as far as the host's line has
    /// room.
    #[task(priority = 1, shared = [machine, writers, recorder], local = [accelerometer_clock])]
    async fn accelerometer(cx: accelerometer::Context) {
        let accelerometer::SharedResources { mut machine, mut writers, mut recorder, .. } = cx.shared;
        let clock = *cx.local.accelerometer_clock;
        let mut period = Period::new(ACCELEROMETER_INTERVAL_MS);
        loop {
            let motor_steps = machine.lock(|machine| machine.motor_steps());
            recorder.lock(|recorder| recorder.follow(motor_steps, clock.now_ticks()));
            for _ in 0..board_accelerometer::MAX_LINES {
                if !board_accelerometer::send_line(&mut recorder, &mut writers, clock.now_ticks()) {
                    break;
                }
            }
            period.pass().await;
        }
    }

    /// Sends unsolicited reports: temperatures (M155), a halt, lost bytes, overload, rest, how
    /// hosts pack their bytes (MeatPack); and times (M798), to the log.
    #[task(priority = 1, shared = [machine, heat, writers, records], local = [halted])]
    async fn reports(cx: reports::Context) {
        let reports::SharedResources { machine, heat, writers, records, .. } = cx.shared;
        let heating = BoardHeating(RefCell::new(heat));
        let mut reports = Reports::new(machine, heating, BoardReplies::new(writers), records, &SIGNALS);
        loop {
            LIFE.show(Task::Reports);
            if let Ok(()) = Mono::timeout_after(REPORTS_INTERVAL_MS.millis(), cx.local.halted.wait()).await {
                reports.halted();
            }
            reports.look(Mono::now().ticks());
        }
    }

    /// Runs the card's task, below all others because it waits for the card. Otherwise sleeps until
    /// an interrupt; SysTick comes every millisecond.
    #[idle(shared = [mailbox], local = [card])]
    fn idle(mut cx: idle::Context) -> ! {
        loop {
            if !card::serve(cx.local.card, &mut cx.shared.mailbox) {
                crate::sleep();
            }
        }
    }
}
