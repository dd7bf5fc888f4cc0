//! The board's heaters, thermistors and fans.

use core::sync::atomic::AtomicU16;

use ferrostep_hal_shim::FanOutput;
use ferrostep_stm32f4::clock_tree::Clock;
use ferrostep_stm32f4::tachometers::{PulseCounts, Tachometers};
use ferrostep_stm32f4::{BoardHeaters, CONVERSIONS, PwmClocks};

use crate::board::{THERMAL, THERMISTORS};
use crate::pac::{ADC_COMMON, ADC1, ADC3, DMA2};
use crate::volatile::Volatile;

/// The board's heaters.
pub type Heaters = BoardHeaters<Volatile>;

/// Buffer for the conversions that DMA stores, in RAM that DMA can reach.
static MEMORY: [AtomicU16; THERMISTORS * CONVERSIONS] = [const { AtomicU16::new(0) }; THERMISTORS * CONVERSIONS];

/// Pulse counts of the fans' tachometers.
static PULSES: PulseCounts = [const { AtomicU16::new(0) }; FanOutput::COUNT];

/// Peripherals used for the temperature measurement.
pub type Converters = (ADC1, ADC3, ADC_COMMON, DMA2);

/// Starts converter and timers with all heaters and fans off; `None` on a board without heaters.
/// Fans that the machine does not use stay plain outputs, and low. Call after
/// [`BoardPins::new`](crate::board::BoardPins::new).
pub fn start(used_fans: [bool; FanOutput::COUNT], _converters: Converters, clock: &Clock) -> Option<Heaters> {
    let mut pins = THERMAL?;
    for (fan, is_used) in pins.fans.iter_mut().zip(used_fans) {
        *fan = fan.filter(|_| is_used);
    }
    let clocks = PwmClocks { slow_hz: clock.slow_timers.raw(), fast_hz: clock.fast_timers.raw() };
    // SAFETY: the converters and the stream were given up to this. The timers are those that
    // the board's file gives to heaters and fans, and the firmware uses none of them
    // otherwise (`config/boards/src/signals.rs`); their pins are theirs alone. Clocks are
    // switched on before any task runs. The panic and fault handlers take the pins away when
    // no other code runs any more.
    let registers = unsafe { Volatile::new() };
    // Addresses have 32 bits here.
    let address = MEMORY.as_ptr() as u32;
    Some(BoardHeaters::start(&pins, &MEMORY, address, &PULSES, clocks, registers))
}

/// Tachometers of the fans; `None` on a board without any.
pub struct FanSpeeds(Tachometers);

impl FanSpeeds {
    /// Configures the tachometer pins as inputs. Call in `init`, after
    /// [`BoardPins::new`](crate::board::BoardPins::new).
    pub fn start() -> Option<Self> {
        let fans = THERMAL?.fans;
        if !fans.iter().flatten().any(|fan| fan.tachometer.is_some()) {
            return None;
        }
        // SAFETY: pins that the board's file gives to tachometers alone. Nothing else runs yet that
        // changes their ports' registers.
        let mut registers = unsafe { Volatile::new() };
        Some(Self(Tachometers::start(&fans, &mut registers)))
    }

    /// Counts pulses. Call every millisecond.
    pub fn look(&mut self) {
        // SAFETY: it reads the ports' inputs.
        let mut registers = unsafe { Volatile::new() };
        self.0.look(&PULSES, &mut registers);
    }
}
