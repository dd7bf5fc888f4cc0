//! The timers that rigless's part lacks, and the connections between timers.
//!
//! rigless's timer model (`soc::st::tim`) covers the timers of two manuals; this module gives it
//! the layouts of TIM6, TIM7 and TIM9 to TIM14, from RM0090 rev 22 chapters 19 and 20.
//!
//! | Section | Behaviour | Test |
//! |---|---|---|
//! | 20.3.1, 20.3.2 | TIM6, TIM7: a 16-bit counter that counts up, with prescaler, preloaded reload, one pulse, update interrupt | `a_basic_timer_counts_and_interrupts` |
//! | 19.3.2 | TIM9, TIM12: two channels, TIM10, 11, 13, 14: one; they count up |
//! `timers_with_one_and_two_channels_output_their_waves` |
//! | 19.3.4, 19.4.2, table 101 | TIM9, TIM12 clocked by another timer's trigger output: external clock mode 1 on ITR0 to ITR1 | `tim9_counts_the_updates_of_tim2` |
//! | tables 93, 94 | trigger outputs between TIM1 to TIM5 and TIM8 | `tim9_counts_the_updates_of_tim2` |
//!
//! **Left out**
//!
//! | Section | What | Why |
//! |---|---|---|
//! | table 101, ITR2 and ITR3 | OC outputs of TIM10, 11, 13, 14 as triggers | the model reports no edges of a wave; no
//! board here uses it |
//! | 19.5.11 | TIM11's option register (HSE as an input) | no board here captures it |
//! | 6.3.13, 6.3.14 | a cleared clock enable stops the counter | it closes the registers; the counters of these eight
//! continue. The firmware never switches one off |
//! | 18.3.15 | a master that the firmware has not accessed for 1 ms, without interrupts, stops reporting updates to its
//! slave | a million unused events a second: [`Linked::rest`] |
//! | table 62 | lines that two timers share (24 to 26, 43 to 46) | each timer drives the line alone: every board here
//! uses at most one of a pair |

use rigless::device::{Device, DeviceContext, Level, RegisterFile, RequestChange};
use rigless::soc::st::tim::{Counter, Family, Flags, Kind, Part, Tim, Wakeups};
use rigless::soc::stm32f427::generated::{tim1, tim2, tim6, tim9, tim10};
use rigless::soc::stm32f427::peripherals::tim as stm32f427;
use rigless::soc::{Layout, RegisterSpec};
use rigless::time::{EventId, VirtualNanos};

/// The request output that reports a timer's trigger output, after those for DMA (0 to 6).
pub const TRIGGER_OUTPUT: usize = 7;

/// The timers whose trigger outputs each timer receives on ITR0 to ITR3: RM0090
/// tables 93, 94 and 101.
pub const MASTERS: [(&str, [&str; 4]); 8] = [
    ("TIM1", ["TIM5", "TIM2", "TIM3", "TIM4"]),
    ("TIM8", ["TIM1", "TIM2", "TIM4", "TIM5"]),
    ("TIM2", ["TIM1", "TIM8", "TIM3", "TIM4"]),
    ("TIM3", ["TIM1", "TIM2", "TIM5", "TIM4"]),
    ("TIM4", ["TIM1", "TIM2", "TIM3", "TIM8"]),
    ("TIM5", ["TIM2", "TIM3", "TIM4", "TIM8"]),
    ("TIM9", ["TIM2", "TIM3", "", ""]),
    ("TIM12", ["TIM4", "TIM5", "", ""]),
];

/// Facts from the manual and the errata sheet that all timers share. A timer wakes the run only
/// while its events have a receiver, which changes the speed only.
static PART: Part = Part { wakeups: Wakeups::WhenSeen, ..stm32f427::PART };

macro_rules! family {
    ($(#[$what:meta])* $name:ident, $registers:ident, $kind:expr $(, $more:item)*) => {
        $(#[$what])*
        #[derive(Debug, Clone, Copy)]
        pub struct $name;

        impl Family for $name {
            type Register = $registers::Register;
            type Instance = Counter;
            // The registers of all timers have the same offsets (tables 99 to 103);
            // some have fewer.
            const PART: &'static Part = &PART;
            const KINDS: &'static [Kind] = &[$kind];
            $($more)*
        }
    };
}

family!(
    /// TIM2 to TIM5, chapter 18.
    General,
    tim2,
    Kind::General,
    fn layout(counter: Counter) -> &'static [RegisterSpec] {
        counter.layout()
    }
);
family!(
    /// TIM1 and TIM8, chapter 17, with their four interrupts in the order of table 62.
    Advanced,
    tim1,
    Kind::FourChannelBreak,
    const LINES: usize = 4;,
    fn line(flags: Flags) -> usize {
        match flags {
            Flags::Break => 0,
            Flags::Update => 1,
            Flags::TriggerAndCommutation => 2,
            Flags::CaptureCompare => 3,
        }
    }
);
family!(
    /// TIM6 and TIM7, chapter 20.
    Basic,
    tim6,
    Kind::Basic
);
family!(
    /// TIM9 and TIM12, section 19.4.
    TwoChannels,
    tim9,
    Kind::TwoChannelSlave
);
family!(
    /// TIM10, TIM11, TIM13 and TIM14, section 19.5.
    OneChannel,
    tim10,
    Kind::OneChannel
);

/// A timer with its connections to the trigger outputs of other timers.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
#[serde(bound(serialize = "", deserialize = "'de: 'static"))]
pub struct Linked<F: Family> {
    /// The timer.
    pub tim: Tim<F>,
    masters: [Option<&'static str>; 4],
    level: Level,
    pulses: u64,
    /// The last access of the firmware.
    touched: VirtualNanos,
    clock_hz: u64,
    /// Places in the layout of the registers of [`Rows`], which is asked for at each event.
    places: Option<[usize; 7]>,
    /// See [`Linked::rest`].
    resting: Option<Rest>,
}

/// The state of a timer when it began to rest.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
struct Rest {
    since: VirtualNanos,
    count: u64,
    /// Ticks from one update to the next. It is the reload register's value, as a rest begins right
    /// after an update.
    period: u64,
    cr1: u64,
}

/// Registers of a layout by their function.
struct Rows<R> {
    cr1: R,
    cr2: R,
    dier: R,
    sr: R,
    cnt: R,
    psc: R,
    arr: R,
}

/// Time without an access after which a timer without interrupts may rest, ns.
const RESTS_AFTER_NS: u64 = 1_000_000;

impl<F: Family<Instance = Counter>> Linked<F> {
    /// The timer called `instance`, on a clock of `clock_hz` until the clock tree changes it.
    #[must_use]
    pub fn new(instance: &'static str, clock_hz: u64, counter: Counter) -> Self {
        Self::wrap(instance, clock_hz, Tim::with_clock(clock_hz, counter))
    }
}

impl<F: Family> Linked<F> {
    /// Connects the timer called `instance`.
    #[must_use]
    pub fn wrap(instance: &'static str, clock_hz: u64, tim: Tim<F>) -> Self {
        let masters = MASTERS
            .iter()
            .find(|(name, _)| *name == instance)
            .map_or([None; 4], |(_, masters)| masters.map(|master| (!master.is_empty()).then_some(master)));
        let layout = Device::layout(&tim);
        let place = |name: &str| layout.iter().position(|register| register.name == name);
        let places = ["CR1", "CR2", "DIER", "SR", "CNT", "PSC", "ARR"].map(place);
        let places = places.iter().all(Option::is_some).then(|| places.map(Option::unwrap_or_default));
        let touched = VirtualNanos(0);
        Self { tim, masters, level: Level::Low, pulses: 0, touched, clock_hz, places, resting: None }
    }

    /// Stops a timer whose events have no receiver. A timer that reports updates to a slave wakes
    /// the run at each of them, even without an interrupt and while the firmware accesses neither
    /// timer: a million times a second for a step timer between two motions. So after a millisecond
    /// without an access such a timer stops, and the next access sets the count that it would have
    /// reached, and its update flag. Only the slave misses the updates in between.
    fn rest(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let Some(rows) = self.rows() else { return };
        let cr1 = registers.get(rows.cr1);
        let master = registers.get(rows.cr2) & MASTER_MODE == ON_UPDATE;
        let plain = master && cr1 & (COUNTS | ONE_PULSE | DOWN_OR_CENTRED) == COUNTS && registers.get(rows.psc) == 0;
        let silent = registers.get(rows.dier) == 0 && context.now().0.saturating_sub(self.touched.0) >= RESTS_AFTER_NS;
        if plain && silent && self.resting.is_none() {
            let count =
                Device::read(&mut self.tim, rows.cnt, registers, context).unwrap_or_else(|| registers.get(rows.cnt));
            self.resting = Some(Rest { since: context.now(), count, period: registers.get(rows.arr) + 1, cr1 });
            self.put(rows.cr1, cr1 & !COUNTS, registers, context);
        }
    }

    /// Sets a resting timer to the count that it would have reached, before an access
    /// of the firmware.
    fn wake(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.touched = context.now();
        let (Some(rest), Some(rows)) = (self.resting.take(), self.rows()) else { return };
        let passed = u128::from(context.now().0 - rest.since.0) * u128::from(self.clock_hz) / 1_000_000_000;
        let counted = u128::from(rest.count) + passed;
        if counted >= u128::from(rest.period) {
            let flags = registers.get(rows.sr);
            registers.set(rows.sr, flags | 1);
        }
        self.put(rows.cnt, (counted % u128::from(rest.period)) as u64, registers, context);
        self.put(rows.cr1, rest.cr1, registers, context);
    }

    fn put(&mut self, row: F::Register, value: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        registers.set(row, value);
        Device::write(&mut self.tim, row, value, registers, context);
    }

    fn rows(&self) -> Option<Rows<F::Register>> {
        let [cr1, cr2, dier, sr, cnt, psc, arr] = self.places?.map(F::Register::from_index);
        Some(Rows { cr1: cr1?, cr2: cr2?, dier: dier?, sr: sr?, cnt: cnt?, psc: psc?, arr: arr? })
    }

    /// Reports the changes of the trigger output since the last call.
    fn relay(&mut self, context: &mut DeviceContext<'_>) {
        let (level, pulses) = self.tim.trigger_output();
        for _ in self.pulses..pulses {
            context.request(TRIGGER_OUTPUT, Level::High);
            context.request(TRIGGER_OUTPUT, Level::Low);
        }
        self.pulses = pulses;
        if level != self.level {
            self.level = level;
            context.request(TRIGGER_OUTPUT, level);
        }
    }
}

/// CR1, RM0090 18.4.1: CEN, OPM, DIR and CMS.
const COUNTS: u64 = 1;
const ONE_PULSE: u64 = 1 << 3;
const DOWN_OR_CENTRED: u64 = 0b111 << 4;
/// MMS in CR2, 18.4.2, and the update as trigger output.
const MASTER_MODE: u64 = 0b111 << 4;
const ON_UPDATE: u64 = 0b010 << 4;

impl<F: Family> Device for Linked<F> {
    type Register = F::Register;

    fn layout(&self) -> &'static [RegisterSpec] {
        Device::layout(&self.tim)
    }

    fn read(
        &mut self,
        register: F::Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        self.wake(registers, context);
        let answer = Device::read(&mut self.tim, register, registers, context);
        self.relay(context);
        answer
    }

    fn peek(&self, register: F::Register, registers: &RegisterFile, now: VirtualNanos) -> Option<u64> {
        Device::peek(&self.tim, register, registers, now)
    }

    fn write(
        &mut self,
        register: F::Register,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.wake(registers, context);
        Device::write(&mut self.tim, register, value, registers, context);
        self.relay(context);
    }

    fn on_event(&mut self, event: EventId, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        Device::on_event(&mut self.tim, event, registers, context);
        self.relay(context);
        self.rest(registers, context);
    }

    fn on_request(&mut self, request: RequestChange, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if request.request == TRIGGER_OUTPUT {
            let input = self.masters.iter().position(|master| *master == Some(request.instance));
            if let Some(input) = input.and_then(|input| u8::try_from(input).ok()) {
                self.tim.drive_internal_trigger(input, request.level, registers, context);
                self.relay(context);
            }
        } else if request.instance == "RCC" {
            // The only other input of a timer reports a failed clock.
            Device::on_request(&mut self.tim, request, registers, context);
            self.relay(context);
        }
    }

    fn on_clock(&mut self, hz: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.wake(registers, context);
        self.clock_hz = hz;
        Device::on_clock(&mut self.tim, hz, registers, context);
        self.relay(context);
    }

    fn reset(&mut self) {
        Device::reset(&mut self.tim);
        let (level, pulses) = self.tim.trigger_output();
        self.level = level;
        self.pulses = pulses;
        self.resting = None;
    }

    fn reset_line(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.resting = None;
        Device::reset_line(&mut self.tim, registers, context);
        self.relay(context);
    }
}
