//! Heaters and fans: a timer channel where the pin has one, else [`SoftwarePwm`].

use ferrostep_register_address::register;

use super::SoftwarePwm;
use crate::gpio::{AFRL, ALTERNATE, BSRR, MODER, port};
use crate::rcc::{RCC_APB1ENR, RCC_APB2ENR};
use crate::registers::Registers;

/// Frequency of heaters, Hz: slow enough for a bed's solid-state relay, which switches at the
/// mains' zero crossings, and ten periods in the time in which the fastest nozzle gains a degree.
pub const HEATER_HZ: u32 = 10;

/// Frequency of fans on a timer, Hz: two-wire fans run smoothly, and their transistors, made for
/// slow switching, stay cool.
pub const FAN_HZ: u32 = 100;

/// Steps of a timer's duty. The clock divided by this and by a frequency above must fit in 16 bits.
const STEPS: u32 = 1000;

// RM0090, 17.4 and 18.4: timers.
const CR1: u32 = register!(TIM1.cr1) - register!(TIM1);
const DIER: u32 = register!(TIM1.dier) - register!(TIM1);
const EGR: u32 = register!(TIM1.egr) - register!(TIM1);
const CCMR1: u32 = register!(TIM1.ccmr1_output) - register!(TIM1);
const CCER: u32 = register!(TIM1.ccer) - register!(TIM1);
const PSC: u32 = register!(TIM1.psc) - register!(TIM1);
const ARR: u32 = register!(TIM1.arr) - register!(TIM1);
const CCR1: u32 = register!(TIM1.ccr[0]) - register!(TIM1);
const BDTR: u32 = register!(TIM1.bdtr) - register!(TIM1);
/// PWM mode 1: high while the counter is below the compare value. No preload: off must act at once.
const PWM_MODE: u32 = 0b110 << 4;
/// BDTR: the outputs of TIM1 and TIM8 are their channels'.
const MOE: u32 = 1 << 15;

/// A timer's output channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimerChannel {
    /// Address of the timer's registers.
    pub timer: u32,
    /// 1 to 4.
    pub channel: u8,
    /// The pin's alternate function.
    pub function: u8,
    /// Bit of the timer's clock in its bus's switches.
    pub clock_bit: u8,
    /// True on the fast bus (APB2).
    pub is_fast: bool,
    /// True if the timer has a switch for all its outputs (TIM1 and TIM8).
    pub has_main_switch: bool,
}

/// Timers that have outputs: name, address, alternate function, clock bit, bus. RM0090, 2.3 (memory
/// map), 7.3.13 and 7.3.14 (clocks); DS8626, table 9 (alternate functions). TIM2, TIM5 and TIM9 are
/// left out: they make the steps.
const TIMERS: [(&str, u32, u8, u8, bool); 9] = [
    ("TIM1", register!(TIM1), 1, 0, true),
    ("TIM3", register!(TIM3), 2, 1, false),
    ("TIM4", register!(TIM4), 2, 2, false),
    ("TIM8", register!(TIM8), 3, 1, true),
    ("TIM10", register!(TIM10), 3, 17, true),
    ("TIM11", register!(TIM11), 3, 18, true),
    ("TIM12", register!(TIM12), 9, 6, false),
    ("TIM13", register!(TIM13), 9, 7, false),
    ("TIM14", register!(TIM14), 9, 8, false),
];

impl TimerChannel {
    /// The channel of a name such as `TIM3_CH4`; its pins are not known here.
    pub fn named(name: &str) -> Option<Self> {
        let (timer, channel) = name.split_once("_CH")?;
        let channel = channel.parse().ok().filter(|channel| (1..=4).contains(channel))?;
        let &(_, address, function, clock_bit, is_fast) = TIMERS.iter().find(|(name, ..)| *name == timer)?;
        let has_main_switch = matches!(timer, "TIM1" | "TIM8");
        Some(Self { timer: address, channel, function, clock_bit, is_fast, has_main_switch })
    }

    /// Place among the four channels.
    const fn index(self) -> u32 {
        (self.channel as u32).saturating_sub(1) & 0b11
    }

    const fn compare(self) -> u32 {
        self.timer + CCR1 + 4 * self.index()
    }
}

/// A pin that switches a heater or a fan; high = on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutputPin {
    /// Index of its port: 0 for A.
    pub port: u8,
    /// Number within the port, 0 to 15.
    pub number: u8,
    /// The timer channel that drives it.
    pub channel: Option<TimerChannel>,
}

impl OutputPin {
    const fn port(self) -> u32 {
        port(self.port)
    }

    fn set(self, high: bool, registers: &mut impl Registers) {
        let bit = 1 << (self.number & 15);
        registers.write(self.port() + BSRR, if high { bit } else { bit << 16 });
    }
}

/// Frequencies of the timers, Hz.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PwmClocks {
    /// Clock of those on the slow bus, Hz.
    pub slow_hz: u32,
    /// Clock of those on the fast bus, Hz.
    pub fast_hz: u32,
}

/// A heater or fan that has some power.
#[derive(Debug)]
pub struct PwmOutput {
    pin: OutputPin,
    software: SoftwarePwm,
    /// Level that the software has last set.
    is_high: bool,
}

impl PwmOutput {
    /// Power 0. The pin is low and an output already, and stays low: it becomes the timer's
    /// when the timer drives it low. `frequency_hz` is that of a timer; all channels of one
    /// timer have the same.
    pub fn start(pin: OutputPin, frequency_hz: u32, clocks: PwmClocks, registers: &mut impl Registers) -> Self {
        if let Some(channel) = pin.channel {
            start_channel(channel, frequency_hz, clocks, registers);
            let number = u32::from(pin.number & 15);
            let (function, place) = (AFRL + number / 8 * 4, number % 8 * 4);
            registers.modify(pin.port() + function, 0xf << place, u32::from(channel.function) << place);
            registers.modify(pin.port() + MODER, 0b11 << (2 * number), ALTERNATE << (2 * number));
        }
        Self { pin, software: SoftwarePwm::new(), is_high: false }
    }

    /// Sets the power, 0 to 1; 0 is low at once, and only 0 is always low.
    pub fn set(&mut self, power: f32, registers: &mut impl Registers) {
        // NaN counts as 0.
        let power = if power > 0.0 { power.min(1.0) } else { 0.0 };
        match self.pin.channel {
            // The cast keeps to the type's range; at 1000 of 1000 it is high all the time.
            Some(channel) => registers.write(channel.compare(), (power * STEPS as f32 + 0.5) as u32),
            None => {
                self.software.set(power);
                if power <= 0.0 {
                    self.is_high = false;
                    self.pin.set(false, registers);
                }
            }
        }
    }

    /// A tick of 10 ms has passed: for pins without a timer.
    pub fn tick(&mut self, registers: &mut impl Registers) {
        if self.pin.channel.is_none() {
            let high = self.software.tick();
            if core::mem::replace(&mut self.is_high, high) != high {
                self.pin.set(high, registers);
            }
        }
    }
}

/// A channel that is low, on a timer that runs.
fn start_channel(channel: TimerChannel, frequency_hz: u32, clocks: PwmClocks, registers: &mut impl Registers) {
    let TimerChannel { timer, clock_bit, is_fast, has_main_switch, .. } = channel;
    let (bus, clock_hz) = if is_fast { (RCC_APB2ENR, clocks.fast_hz) } else { (RCC_APB1ENR, clocks.slow_hz) };
    registers.switch_clocks_on(bus, 1 << clock_bit);
    registers.write(channel.compare(), 0);
    let divider = (clock_hz / (frequency_hz * STEPS).max(1)).clamp(1, 1 << 16);
    registers.write(timer + PSC, divider - 1);
    registers.write(timer + ARR, STEPS - 1);
    registers.write(timer + DIER, 0);
    // Two channels a register, a byte each; four bits of switches a channel.
    let (mode, place) = (timer + CCMR1 + channel.index() / 2 * 4, channel.index() % 2 * 8);
    registers.modify(mode, 0xff << place, PWM_MODE << place);
    registers.modify(timer + CCER, 0xf << (4 * channel.index()), 1 << (4 * channel.index()));
    // Divider and mode take effect now.
    registers.write(timer + EGR, 1);
    if has_main_switch {
        registers.modify(timer + BDTR, 0, MOE);
    }
    registers.modify(timer + CR1, 0, 1);
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::registers::recorder::Recorder;

    const CLOCKS: PwmClocks = PwmClocks { slow_hz: 84_000_000, fast_hz: 168_000_000 };

    fn pin(port: u8, number: u8, channel: &str) -> OutputPin {
        OutputPin { port, number, channel: TimerChannel::named(channel) }
    }

    /// Output of a timer: pulses a second, and the part of each that is high.
    fn pulses(registers: &Recorder, timer: u32, compare: u32, clock_hz: u32) -> (f64, f64) {
        let ticks = f64::from(registers.value(timer + ARR) + 1);
        let hz = f64::from(clock_hz) / f64::from(registers.value(timer + PSC) + 1) / ticks;
        (hz, f64::from(registers.value(compare)).min(ticks) / ticks)
    }

    #[test]
    fn the_buddys_heaters_are_pulsed_ten_times_a_second_by_tim3() {
        let mut registers = Recorder::default();
        let mut nozzle = PwmOutput::start(pin(1, 1, "TIM3_CH4"), HEATER_HZ, CLOCKS, &mut registers);
        let mut bed = PwmOutput::start(pin(1, 0, "TIM3_CH3"), HEATER_HZ, CLOCKS, &mut registers);
        assert_eq!(registers.value(0x4002_3840), 1 << 1, "TIM3's clock");
        let of = |registers: &Recorder| {
            [0x4000_0440, 0x4000_043c].map(|compare| pulses(registers, 0x4000_0400, compare, 84_000_000))
        };
        assert_eq!(of(&registers), [(10.0, 0.0); 2]);
        nozzle.set(0.25, &mut registers);
        bed.set(1.0, &mut registers);
        assert_eq!(of(&registers), [(10.0, 0.25), (10.0, 1.0)]);
        for off in [0.0, -1.0, f32::NAN] {
            bed.set(1.0, &mut registers);
            bed.set(off, &mut registers);
            assert_eq!(of(&registers), [(10.0, 0.25), (10.0, 0.0)], "{off}");
        }
        bed.set(7.0, &mut registers);
        assert_eq!(of(&registers)[1], (10.0, 1.0));
        // PWM mode 1 without preload on channels 3 and 4, both switched on, none the
        // other way round.
        assert_eq!(registers.value(0x4000_041c), 0x6060);
        assert_eq!(registers.value(0x4000_0420), 0x1100);
        assert_eq!(registers.value(0x4000_040c), 0, "no interrupts");
        // Alternate function 2 on PB0 and PB1.
        assert_eq!((registers.value(0x4002_0420), registers.value(0x4002_0400)), (0x22, 0b1010));
    }

    #[test]
    fn fans_on_tim1_have_their_main_switch_on() {
        for (clocks, clock_hz) in
            [(CLOCKS, 168_000_000), (PwmClocks { slow_hz: 16_000_000, fast_hz: 16_000_000 }, 16_000_000)]
        {
            let mut registers = Recorder::default();
            let mut fan = PwmOutput::start(pin(4, 11, "TIM1_CH2"), FAN_HZ, clocks, &mut registers);
            fan.set(0.5, &mut registers);
            assert_eq!(pulses(&registers, 0x4001_0000, 0x4001_0038, clock_hz), (100.0, 0.5));
            assert_eq!(registers.value(0x4002_3844), 1, "TIM1's clock");
            assert_eq!(registers.value(0x4001_0044), 1 << 15);
            // PE11: alternate function 1.
            assert_eq!((registers.value(0x4002_1024), registers.value(0x4002_1000)), (1 << 12, 0b10 << 22));
        }
    }

    /// The pin is low from the first store to the last of each set-up: the timer's compare value is
    /// 0 before its output is switched on, and the pin is the timer's after all of that.
    #[test]
    fn nothing_is_high_while_a_timer_is_set_up() {
        for (name, _, _, _, _) in TIMERS {
            let channel = TimerChannel::named(&format!("{name}_CH1")).unwrap();
            // As something else has left it: high all the time.
            let mut registers = Recorder::default().with(channel.compare(), u32::MAX);
            PwmOutput::start(pin(3, 12, &format!("{name}_CH1")), FAN_HZ, CLOCKS, &mut registers);
            let stores = &registers.stores;
            let clock = if channel.is_fast { RCC_APB2ENR } else { RCC_APB1ENR };
            assert_eq!(
                stores.first(),
                Some(&(clock, 1 << channel.clock_bit)),
                "{name}: its registers take nothing before"
            );
            assert_eq!(stores.get(1), Some(&(channel.compare(), 0)), "{name}");
            assert_eq!(stores.last(), Some(&(0x4002_0c00, ALTERNATE << 24)), "{name}");
            assert_eq!(registers.stored(0x4002_0c00 + BSRR), [], "{name}");
            assert_eq!(registers.stored(channel.compare()), [0], "{name}");
            assert_eq!(registers.stored(channel.timer + CR1), [1], "{name}");
        }
    }

    #[test]
    fn other_channels_and_pins_stay_as_they_are() {
        let channel = TimerChannel::named("TIM4_CH2").unwrap();
        let mut registers = Recorder::default()
            .with(channel.timer + CCMR1, 0xffff)
            .with(channel.timer + CCER, 0xffff)
            .with(0x4002_0c00, u32::MAX)
            .with(0x4002_0c24, u32::MAX);
        PwmOutput::start(pin(3, 13, "TIM4_CH2"), FAN_HZ, CLOCKS, &mut registers);
        assert_eq!(registers.value(channel.timer + CCMR1), 0x60ff);
        assert_eq!(registers.value(channel.timer + CCER), 0xff1f);
        assert_eq!(registers.value(0x4002_0c00), !(0b01 << 26));
        assert_eq!(registers.value(0x4002_0c24), 0xff2f_ffff);
    }

    #[test]
    fn without_a_timer_the_pin_is_switched_by_ticks() {
        let mut registers = Recorder::default();
        let pin = OutputPin { port: 0, number: 2, channel: None };
        let mut heater = PwmOutput::start(pin, HEATER_HZ, CLOCKS, &mut registers);
        assert_eq!(registers.stores, [], "it is low already");
        heater.set(0.3, &mut registers);
        let bsrr = 0x4002_0018;
        let levels: Vec<u32> = (0..10)
            .map(|_| {
                heater.tick(&mut registers);
                registers.value(bsrr)
            })
            .collect();
        let (high, low) = (1 << 2, 1 << 18);
        assert_eq!(levels, [high, high, high, low, low, low, low, low, low, low]);
        assert_eq!(registers.stores, [(bsrr, high), (bsrr, low)], "only what changes is stored");
        heater.set(1.0, &mut registers);
        heater.tick(&mut registers);
        assert_eq!(registers.value(bsrr), 1 << 2);
        // Off is at once, and does not wait for a tick.
        heater.set(0.0, &mut registers);
        assert_eq!(registers.value(bsrr), 1 << 18);
        (0..100).for_each(|_| heater.tick(&mut registers));
        assert_eq!(registers.value(bsrr), 1 << 18);
    }

    #[test]
    fn names_are_those_of_timers_with_outputs() {
        for no_name in ["", "TIM3", "TIM3_CH0", "TIM3_CH5", "TIM2_CH1", "TIM5_CH1", "TIM9_CH1", "TIM6_CH1", "tim3_CH1"]
        {
            assert_eq!(TimerChannel::named(no_name), None, "{no_name}");
        }
    }
}
