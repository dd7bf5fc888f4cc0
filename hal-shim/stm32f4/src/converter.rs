//! Thermistors: an ADC that converts without end, and a DMA stream that stores its conversions.

use core::sync::atomic::{AtomicU16, Ordering};
use ferrostep_hal_shim::Heater;
use ferrostep_register_address::register;

use crate::rcc::{RCC_AHB1ENR, RCC_APB2ENR, is_on_pll};
use crate::registers::Registers;
use ferrostep_thermistor::CONVERSIONS_A_READING;

/// Conversions of each sensor that the memory holds: those of one reading.
pub const CONVERSIONS: usize = CONVERSIONS_A_READING as usize;

/// Marks a conversion that has been taken: the converter has 12 bits.
const TAKEN: u16 = u16::MAX;

/// Number of readings in a row with old conversions after which the converter counts as stopped: 80
/// ms at the control's pace. A working one makes a reading in 4 ms ([`Converter`]); the start may
/// take several readings at once.
const MAX_OLD: u8 = 8;

/// Number of looks at a register while the converter wakes up (DS8626, ADC characteristics,
/// tSTAB): a pair of looks takes two cycles of the fast bus or more, so these take 3 us or
/// longer up to 84 MHz.
const WAKE_UP_LOOKS: u32 = 256;

/// Looks at the memory for the first reading: 20 ms or longer.
const FIRST_READING_LOOKS: u32 = 200_000;

/// Looks at a DMA stream that ends its last transfer, some cycles.
const STREAM_OFF_LOOKS: u32 = 1_000;

// RM0090, 13.13: ADC registers.
const ADC1: u32 = register!(ADC1);
const ADC3: u32 = register!(ADC3);
const ADC_CCR: u32 = register!(ADC_COMMON.ccr);
const SR: u32 = register!(ADC1.sr) - ADC1;
const CR1: u32 = register!(ADC1.cr1) - ADC1;
const CR2: u32 = register!(ADC1.cr2) - ADC1;
const SMPR1: u32 = register!(ADC1.smpr1) - ADC1;
const SMPR2: u32 = register!(ADC1.smpr2) - ADC1;
const SQR1: u32 = register!(ADC1.sqr1) - ADC1;
const SQR2: u32 = register!(ADC1.sqr2) - ADC1;
const SQR3: u32 = register!(ADC1.sqr3) - ADC1;
const DR: u32 = register!(ADC1.dr) - ADC1;
/// SR: a conversion was lost, and none has been handed over since.
const OVR: u32 = 1 << 5;
/// CR1: the whole sequence, 12 bits.
const SCAN: u32 = 1 << 8;
/// CR2: on; continuous; by DMA, without end.
const ADON: u32 = 1 << 0;
const CONT: u32 = 1 << 1;
const DMA: u32 = 1 << 8;
const DDS: u32 = 1 << 9;
const SWSTART: u32 = 1 << 30;
/// CCR: the converter's clock as a part of the bus's frequency, at most 36 MHz and below 2.4 V 18
/// MHz (DS8626, fADC). An eighth is the least, 10.5 MHz of 84; a quarter of the bare internal
/// oscillator's 16 MHz gives each sample its reading.
const ADCPRE: u32 = 0b11 << 16;
const EIGHTH: u32 = 0b11 << 16;
const QUARTER: u32 = 0b01 << 16;
/// 480 cycles of sampling for every channel, 46 us: a thermistor is a source of up to 4.7 kilohms.
/// The conversion takes 12 more.
const MAX_SAMPLING: u32 = 0x3fff_ffff;
/// Sampling times of channels 10 to 18.
const MAX_SAMPLING_HIGH: u32 = 0x07ff_ffff;

// RM0090, 10.5: DMA2, stream 0, which serves ADC1 (channel 0) and ADC3 (channel 2): table 43.
const LISR: u32 = register!(DMA2.lisr);
const LIFCR: u32 = register!(DMA2.lifcr);
const S0CR: u32 = register!(DMA2.st[0].cr);
const S0NDTR: u32 = register!(DMA2.st[0].ndtr);
const S0PAR: u32 = register!(DMA2.st[0].par);
const S0M0AR: u32 = register!(DMA2.st[0].m0ar);
const S0FCR: u32 = register!(DMA2.st[0].fcr);
const STREAM_ENABLE: u32 = 1 << 0;
/// Circular, memory increments, halves of a word on both sides, medium priority,
/// from the peripheral.
const STREAM_SETTINGS: u32 = 1 << 8 | 1 << 10 | 0b01 << 11 | 0b01 << 13 | 0b01 << 16;
/// All flags of stream 0, and those of them that say an error: transfer, direct mode.
const STREAM_FLAGS: u32 = 0x3d;
const STREAM_ERRORS: u32 = 1 << 3 | 1 << 2;

/// A converter for thermistors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConverterNumber {
    /// ADC1.
    One,
    /// ADC3, alone at the pins of port F.
    Three,
}

impl ConverterNumber {
    const fn base(self) -> u32 {
        match self {
            Self::One => ADC1,
            Self::Three => ADC3,
        }
    }

    /// The switch of the converter's clock in RCC_APB2ENR.
    const fn clock(self) -> u32 {
        match self {
            Self::One => 1 << 8,
            Self::Three => 1 << 10,
        }
    }

    /// The converter's channel of DMA2's stream 0.
    const fn stream_channel(self) -> u32 {
        match self {
            Self::One => 0,
            Self::Three => 2 << 25,
        }
    }
}

/// A converter that goes round its channels without end.
///
/// A conversion is 492 cycles of 10.5 MHz, 46.9 us: with five sensors a reading of each is new
/// every 3.7 ms. On the bare internal oscillator, 16 MHz, it is every 9.8 ms.
///
/// **A reading that no longer changes is noticed.** A conversion that has been taken is marked in
/// memory, so that the next reading knows which are new. When they are not for 80 ms, or the chip
/// says that a transfer failed, the reading becomes that of an open circuit, which is a fault of
/// the heater, and the converter is started again, in case that helps.
#[derive(Debug)]
pub struct Converter {
    number: ConverterNumber,
    /// The converter's channels in their turn, at most 16.
    channels: &'static [u8],
    /// Memory to which DMA stores conversions: one of each channel in turn, [`CONVERSIONS`] times.
    memory: &'static [AtomicU16],
    /// The converter's address, as DMA knows it.
    memory_address: u32,
    /// The last readings that were whole, of the nozzle's and the bed's sensor.
    last: [u16; Heater::COUNT],
    /// Readings since then.
    old: [u8; Heater::COUNT],
}

impl Converter {
    /// Starts the converter, and waits for the first readings; if they do not come, they will be
    /// those of open circuits. Its pins are analogue already. `memory` has [`CONVERSIONS`] places
    /// for each channel.
    pub fn start(
        number: ConverterNumber,
        channels: &'static [u8],
        memory: &'static [AtomicU16],
        memory_address: u32,
        registers: &mut impl Registers,
    ) -> Self {
        registers.switch_clocks_on(RCC_AHB1ENR, 1 << 22);
        registers.switch_clocks_on(RCC_APB2ENR, number.clock());
        let converter = Self {
            number,
            channels,
            memory,
            memory_address,
            last: [u16::MAX; Heater::COUNT],
            old: [MAX_OLD; Heater::COUNT],
        };
        converter.begin(registers);
        let is_new = |conversion: &AtomicU16| conversion.load(Ordering::Relaxed) != TAKEN;
        let _comes = (0..FIRST_READING_LOOKS).any(|_| converter.memory.last().is_some_and(is_new));
        converter
    }

    /// Starts it anew, from any state.
    #[inline(never)]
    fn begin(&self, registers: &mut impl Registers) {
        let base = self.number.base();
        // Off: an overrun's flag is cleared, and DMA gets no requests.
        registers.write(base + CR2, 0);
        registers.write(base + SR, 0);
        registers.modify(S0CR, STREAM_ENABLE, 0);
        let _off = registers.comes_to(S0CR, STREAM_ENABLE, false, STREAM_OFF_LOOKS);
        for conversion in self.memory {
            conversion.store(TAKEN, Ordering::Relaxed);
        }
        registers.write(LIFCR, STREAM_FLAGS);
        registers.write(S0PAR, base + DR);
        registers.write(S0M0AR, self.memory_address);
        registers.write(S0NDTR, self.memory.len() as u32);
        // Without a buffer in between.
        registers.write(S0FCR, 0);
        let stream = self.number.stream_channel() | STREAM_SETTINGS;
        registers.write(S0CR, stream);
        registers.write(S0CR, stream | STREAM_ENABLE);

        let prescaler = if is_on_pll(registers) { EIGHTH } else { QUARTER };
        registers.modify(ADC_CCR, ADCPRE, prescaler);
        registers.write(base + CR1, SCAN);
        registers.write(base + SMPR1, MAX_SAMPLING_HIGH);
        registers.write(base + SMPR2, MAX_SAMPLING);
        // Six channels of five bits a register, the first lowest; their number less
        // one above the last.
        let number = (self.channels.len() as u32).saturating_sub(1) << 20;
        for (turn, register) in [SQR3, SQR2, SQR1].into_iter().enumerate() {
            let channels = self.channels.iter().skip(6 * turn).take(6);
            let sequence = channels.rev().fold(0, |sequence, channel| sequence << 5 | u32::from(channel & 0x1f));
            registers.write(base + register, if register == SQR1 { sequence | number } else { sequence });
        }
        let on = ADON | CONT | DMA | DDS;
        registers.write(base + CR2, on);
        // This only waits: not all of these bits exist.
        let _never = registers.comes_to(base + SR, u32::MAX, true, WAKE_UP_LOOKS);
        registers.write(base + CR2, on | SWSTART);
    }

    /// The sum of a sensor's newest conversions; `place` is 0 or 1 (whose it is), `turn` its place
    /// among the channels. While not all of them are new, it is the reading before, and after 80 ms
    /// that of an open circuit.
    ///
    /// Not inlined: in an emulator without such a converter a test replaces this function.
    #[inline(never)]
    pub fn reading_of_sensor(&mut self, place: usize, turn: u8, registers: &mut impl Registers) -> u16 {
        let mut sum = 0_u16;
        let mut all_new = true;
        for round in self.memory.chunks_exact(self.channels.len().max(1)) {
            let Some(conversion) = round.get(usize::from(turn)) else {
                all_new = false;
                break;
            };
            // Between the two a newer one may come, and is lost.
            let value = conversion.load(Ordering::Relaxed);
            conversion.store(TAKEN, Ordering::Relaxed);
            all_new &= value != TAKEN;
            // 16 times 12 bits fit, except for the marks that are sorted out here.
            sum = sum.wrapping_add(value);
        }
        let failed = registers.read(self.number.base() + SR) & OVR != 0 || registers.read(LISR) & STREAM_ERRORS != 0;
        let (Some(last), Some(old)) = (self.last.get_mut(place), self.old.get_mut(place)) else { return u16::MAX };
        if all_new && !failed {
            (*last, *old) = (sum, 0);
            return sum;
        }
        *old += 1;
        let stopped = *old >= MAX_OLD;
        if stopped {
            *last = u16::MAX;
        }
        let reading = *last;
        // No further start before this one has had its time.
        let is_due = *old == MAX_OLD || *old >= 2 * MAX_OLD;
        if *old >= 2 * MAX_OLD {
            *old = MAX_OLD;
        }
        if failed || is_due {
            self.begin(registers);
        }
        reading
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::registers::recorder::Recorder;

    /// The bed's, the nozzle's and another channel of ADC3, as on the Octopus.
    const CHANNELS: [u8; 3] = [9, 14, 4];
    const MEMORY_ADDRESS: u32 = 0x2000_7700;

    struct Bench {
        converter: Converter,
        registers: Recorder,
        memory: &'static [AtomicU16],
    }

    impl Bench {
        /// A converter started on the PLL.
        fn start(number: ConverterNumber, channels: &'static [u8]) -> Self {
            Self::start_with(Recorder::default().with(0x4002_3808, 0b10 << 2), number, channels)
        }

        fn start_with(registers: Recorder, number: ConverterNumber, channels: &'static [u8]) -> Self {
            let memory: Vec<AtomicU16> = (0..channels.len() * CONVERSIONS).map(|_| AtomicU16::new(0)).collect();
            let memory: &'static [AtomicU16] = memory.leak();
            let mut registers = registers.with(S0CR, 0xffff_fffe);
            let converter = Converter::start(number, channels, memory, MEMORY_ADDRESS, &mut registers);
            Self { converter, registers, memory }
        }

        /// Does the hardware's work: a conversion of each channel, 16 times.
        fn convert(&self, value: impl Fn(usize, usize) -> u16) {
            let channels = self.converter.channels.len();
            for (place, conversion) in self.memory.iter().enumerate() {
                conversion.store(value(place % channels, place / channels), Ordering::Relaxed);
            }
        }

        fn reading(&mut self, place: usize, turn: u8) -> u16 {
            self.converter.reading_of_sensor(place, turn, &mut self.registers)
        }
    }

    #[test]
    fn the_sequence_and_its_sampling_are_those_of_the_channels() {
        let bench = Bench::start(ConverterNumber::Three, &CHANNELS);
        let registers = &bench.registers;
        assert_eq!(registers.value(0x4002_3844) & 1 << 10, 1 << 10, "ADC3's clock");
        assert_eq!(registers.value(0x4002_3830) & 1 << 22, 1 << 22, "DMA2's clock");
        // Three conversions: 9, 14, 4.
        assert_eq!(registers.value(0x4001_222c), 2 << 20);
        assert_eq!(registers.value(0x4001_2230), 0);
        assert_eq!(registers.value(0x4001_2234), 9 | 14 << 5 | 4 << 10);
        // 480 cycles each: 0b111.
        assert_eq!((registers.value(0x4001_220c) >> 12 & 7, registers.value(0x4001_2210) >> 12 & 7), (7, 7));
        assert_eq!(registers.value(0x4001_2304), 0b11 << 16, "an eighth of 84 MHz");
        assert_eq!(registers.value(0x4001_2204), 1 << 8, "scan, 12 bits, no interrupts");
        // Switched on and set up first, started last.
        assert_eq!(registers.stored(0x4001_2208), [0, 0x303, 0x4000_0303]);
        assert_eq!(registers.stores.last(), Some(&(0x4001_2208, 0x4000_0303)));
    }

    /// The stores keep the converter's clock within its limit, and give a reading of each sensor in
    /// every sample of 10 ms, on the bare internal oscillator as well.
    #[test]
    fn every_sensor_is_read_a_hundred_times_a_second() {
        for (clock_source, bus_hz, readings) in [(0b10, 84_000_000, 266), (0b00, 16_000_000, 101)] {
            let registers = Recorder::default().with(0x4002_3808, clock_source << 2);
            let registers = Bench::start_with(registers, ConverterNumber::Three, &[9, 14, 15, 4, 5]).registers;
            let divider = 2 * ((registers.value(0x4001_2304) >> 16 & 3) + 1);
            let cycles = [3, 15, 28, 56, 84, 112, 144, 480][(registers.value(0x4001_2210) >> 12 & 7) as usize] + 12;
            let conversions = registers.value(0x4002_6414);
            let clock_hz = bus_hz / divider;
            assert!(clock_hz <= 18_000_000);
            assert_eq!(clock_hz / cycles / conversions, readings);
        }
    }

    #[test]
    fn a_long_sequence_goes_on_in_the_next_register() {
        let bench = Bench::start(ConverterNumber::One, &[10, 4, 3, 6, 0, 1, 2]);
        let registers = &bench.registers;
        assert_eq!(registers.value(0x4001_2034), 10 | 4 << 5 | 3 << 10 | 6 << 15 | 1 << 25);
        assert_eq!((registers.value(0x4001_2030), registers.value(0x4001_202c)), (2, 6 << 20));
        assert_eq!(registers.value(0x4002_3844) & 1 << 8, 1 << 8, "ADC1's clock");
        assert_eq!(registers.value(0x4002_6410) >> 25, 0, "DMA channel of ADC1");
    }

    #[test]
    fn dma_goes_round_the_memory_by_halves_of_words() {
        let registers = Bench::start(ConverterNumber::Three, &CHANNELS).registers;
        assert_eq!(registers.value(0x4002_6418), 0x4001_224c, "from the data register");
        assert_eq!(registers.value(0x4002_641c), MEMORY_ADDRESS);
        assert_eq!(registers.value(0x4002_6414), 3 * 16);
        assert_eq!(registers.value(0x4002_6424), 0, "direct");
        let settings = registers.value(0x4002_6410);
        assert_eq!(settings >> 25 & 7, 2, "channel of ADC3");
        assert_eq!((settings >> 13 & 3, settings >> 11 & 3), (1, 1), "16 bits on both sides");
        assert_eq!((settings >> 10 & 1, settings >> 9 & 1), (1, 0), "only the memory's address moves");
        assert_eq!(
            (settings >> 8 & 1, settings >> 6 & 3, settings & 0x1f),
            (1, 0, 1),
            "circular, inwards, no interrupts"
        );
        // Switched off before it is changed, its flags cleared before it is switched on, and that
        // before the converter.
        let stores = &registers.stores;
        let off = stores.iter().position(|(to, value)| *to == S0CR && value & 1 == 0).unwrap();
        let on = registers.position(S0CR, 1).unwrap();
        assert!(off < registers.position(S0M0AR, 0).unwrap() && registers.position(LIFCR, 0x3d).unwrap() < on);
        assert!(on < registers.position(0x4001_2208, ADON).unwrap());
    }

    #[test]
    fn a_reading_is_the_sum_of_a_sensors_own_conversions() {
        let mut bench = Bench::start(ConverterNumber::One, &CHANNELS);
        bench.convert(|turn, round| 1000 * turn as u16 + round as u16);
        assert_eq!(bench.reading(0, 1), 16 * 1000 + 120);
        assert_eq!(bench.reading(1, 0), 120);
        bench.convert(|_, _| 4095);
        assert_eq!(bench.reading(0, 1), 16 * 4095);
        assert_eq!(bench.reading(0, 3), 16 * 4095, "there is no such channel: nothing is new");
    }

    #[test]
    fn a_reading_is_taken_once() {
        let mut bench = Bench::start(ConverterNumber::One, &CHANNELS);
        bench.convert(|_, _| 2000);
        assert_eq!(bench.reading(0, 1), 32_000);
        // One conversion short of a new reading: still the one before.
        bench.convert(|turn, round| if (turn, round) == (1, 7) { TAKEN } else { 3000 });
        assert_eq!(bench.reading(0, 1), 32_000);
        bench.convert(|_, _| 3000);
        assert_eq!(bench.reading(0, 1), 48_000);
    }

    #[test]
    fn a_converter_that_stands_still_reads_as_an_open_circuit_and_is_started_again() {
        let mut bench = Bench::start(ConverterNumber::Three, &CHANNELS);
        bench.convert(|_, _| 2000);
        assert_eq!(bench.reading(0, 1), 32_000);
        let starts = |bench: &Bench| bench.registers.stored(0x4001_2208).len();
        let first = starts(&bench);
        for _ in 0..7 {
            assert_eq!(bench.reading(0, 1), 32_000);
        }
        assert_eq!(starts(&bench), first);
        // 80 ms, and then for good.
        for _ in 0..100 {
            assert_eq!(bench.reading(0, 1), u16::MAX);
        }
        let starts = (starts(&bench) - first) / 3;
        assert!((10..=13).contains(&starts), "{starts} starts in a second");
        bench.convert(|_, _| 1000);
        assert_eq!(bench.reading(0, 1), 16_000);
    }

    #[test]
    fn what_the_chip_calls_an_error_is_not_waited_for() {
        for (address, flag) in [(0x4001_2000, 1 << 5), (0x4002_6400, 1 << 3), (0x4002_6400, 1 << 2)] {
            let mut bench = Bench::start(ConverterNumber::One, &CHANNELS);
            bench.convert(|_, _| 2000);
            assert_eq!(bench.reading(1, 0), 32_000);
            bench.registers.stores.clear();
            bench.registers.fix(address, flag);
            bench.convert(|_, _| 900);
            assert_eq!(bench.reading(1, 0), 32_000, "conversions of a transfer that failed are not believed");
            assert_eq!(bench.registers.stored(S0NDTR), [48], "it is started again");
            for _ in 0..10 {
                bench.convert(|_, _| 900);
                bench.reading(1, 0);
            }
            assert_eq!(bench.reading(1, 0), u16::MAX);
        }
    }

    #[test]
    fn without_a_first_reading_the_circuit_is_open() {
        let mut bench = Bench::start(ConverterNumber::One, &CHANNELS);
        assert_eq!(bench.reading(0, 0), u16::MAX);
    }
}
