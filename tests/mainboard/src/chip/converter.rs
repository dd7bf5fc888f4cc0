//! Converters that scan without end, in lots.
//!
//! rigless's converter (`soc::stm32f427::peripherals::adc`) reports the end of each conversion:
//! 21,000 times a second for the thermistors of a printer, each with a request to DMA that every
//! instance hears. That was most of the work of a board at rest. Once such a scan is under way,
//! this model finishes its conversions by the lot: some whole sequences at the instant at which
//! the last of them ends, at most [`LOT_NS`] after the first. DMA then moves the words of a lot
//! one after the other. The plant changes the voltages as rarely, so no word is older than it
//! could have been.
//!
//! | Section | Behaviour | Test |
//! |---|---|---|
//! | RM0090 13.3.5, 13.3.8, 13.8.1 | an endless scan by DMA stores each channel's word at its place, at the rate of the
//! conversions | `lots_are_as_many_words_as_single_conversions` |
//! | 13.8.2 | a word that has not been taken is an overrun, which ends the scan | `a_lot_that_nobody_takes_is_an_overrun` |
//! | 13.13.3 | without ADON it ends at once | `a_converter_switched_off_stores_nothing_more` |
//! | all other modes, and each sequence until the first has ended | rigless's | |
//!
//! **Left out**
//!
//! | Section | What | Why |
//! |---|---|---|
//! | 13.3.5 | a change of the set-up within a scan without end, which the conversion under way does not see | the scan
//! begins anew: the firmware switches the converter off before |
//! | 13.13.1 | EOC between two words of a lot | a scan that reports it is left to rigless's model |

use std::collections::VecDeque;

use rigless::device::{Device, DeviceContext, Level, RegisterFile, RequestChange};
use rigless::soc::stm32f427::generated::adc1::{Register, cr1, cr2, sqr1, sr};
use rigless::soc::stm32f427::peripherals::adc::{Adc, Channel, DMA_REQUEST};
use rigless::soc::{FieldSpec, RegisterSpec};
use rigless::time::{EventId, Run, VirtualNanos};

/// The longest lot, ns: the interval at which the plant changes voltages.
const LOT_NS: u64 = 500_000;
/// Channels on pins; the others are inside the chip.
const PINS: usize = 16;
/// Cycles of sampling by SMPx, RM0090 13.13.4.
const SAMPLING_CYCLES: [u64; 8] = [3, 15, 28, 56, 84, 112, 144, 480];
/// Bits of a word by RES, which are also the cycles after sampling, 13.7 and 13.13.2.
const BITS: [u32; 4] = [12, 10, 8, 6];
/// Fields of CR1 and CR2 with which a scan without end needs only DMA, and those with
/// which it needs more.
const ENDLESS: [&FieldSpec; 4] = [cr2::ADON, cr2::CONT, cr2::DMA, cr2::DDS];
const NOT_IN_LOTS_1: [&FieldSpec; 8] =
    [cr1::EOCIE, cr1::AWDIE, cr1::JEOCIE, cr1::OVRIE, cr1::JAUTO, cr1::DISCEN, cr1::AWDEN, cr1::JAWDEN];
const NOT_IN_LOTS_2: [&FieldSpec; 2] = [cr2::EOCS, cr2::ALIGN];

/// A converter with its pins.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
pub struct Converter {
    adc: Adc,
    clock_hz: u64,
    inputs: [u32; PINS],
    reference_mv: u32,
    scan: Option<Scan>,
    /// The last conversion of rigless's model was the last of a sequence.
    ended_sequence: bool,
}

/// A scan without end.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
struct Scan {
    /// The channels of a lot, in their order.
    channels: Vec<usize>,
    /// Cycles of a lot.
    cycles: u64,
    /// The end of the lot under way.
    run: Run,
    event: EventId,
    /// The event by which rigless's model knows the conversion that was under way when the
    /// first lot began.
    held: EventId,
    /// Words that DMA has not taken.
    words: VecDeque<u64>,
}

impl Converter {
    /// A converter clocked at `clock_hz`, with all pins at 0.
    #[must_use]
    pub fn with_clock(clock_hz: u64) -> Self {
        Self {
            adc: Adc::with_clock(clock_hz),
            clock_hz,
            inputs: [0; PINS],
            reference_mv: 3300,
            scan: None,
            ended_sequence: false,
        }
    }

    /// Takes over what is on the pins of another.
    pub fn inherit(&mut self, from: &Self) {
        self.adc.inherit(&from.adc);
        (self.inputs, self.reference_mv) = (from.inputs, from.reference_mv);
    }

    /// Sets the voltage at a channel's pin, mV.
    pub fn set_input(&mut self, channel: u8, millivolts: u32) {
        if let (Some(pin), Some(input)) = (Channel::new(channel), self.inputs.get_mut(usize::from(channel))) {
            *input = millivolts;
            self.adc.set_input(pin, millivolts);
        }
    }

    /// Sets VREF+, mV.
    pub fn set_reference(&mut self, millivolts: u32) {
        self.reference_mv = millivolts;
        self.adc.set_reference(millivolts);
    }

    /// Sets the voltage at VBAT, mV.
    pub fn set_backup_battery(&mut self, millivolts: u32) {
        self.adc.set_backup_battery(millivolts);
    }

    fn bits(registers: &RegisterFile) -> u32 {
        BITS[(cr1::RES.get(registers.get(Register::Cr1)) & 0b11) as usize]
    }

    fn word(&self, channel: usize, registers: &RegisterFile) -> u64 {
        let full = (1 << Self::bits(registers)) - 1;
        (u64::from(self.inputs[channel]) * full)
            .checked_div(u64::from(self.reference_mv))
            .map_or(full, |word| word.min(full))
    }

    /// Each channel of a sequence that may be finished by the lot, with the cycles
    /// of its conversion.
    fn sequence(registers: &RegisterFile) -> Option<Vec<(usize, u64)>> {
        let [control_1, control_2] = [Register::Cr1, Register::Cr2].map(|register| registers.get(register));
        let is_endless = cr1::SCAN.is_set(control_1) && ENDLESS.iter().all(|field| field.is_set(control_2));
        let is_watched = NOT_IN_LOTS_1.iter().any(|field| field.is_set(control_1))
            || NOT_IN_LOTS_2.iter().any(|field| field.is_set(control_2));
        if !is_endless || is_watched {
            return None;
        }
        // SQ1 to SQ6 are in SQR3, SQ7 to SQ12 in SQR2, the rest in SQR1: 13.13.9 to 13.13.11.
        let field = |nth: usize| {
            let register = [Register::Sqr3, Register::Sqr2, Register::Sqr1][nth / 6];
            (registers.get(register) >> (5 * (nth % 6)) & 0b1_1111) as usize
        };
        let length = sqr1::L.get(registers.get(Register::Sqr1)) as usize + 1;
        let channels: Vec<usize> = (0..length).map(field).collect();
        if channels.iter().any(|channel| *channel >= PINS) {
            return None;
        }
        let cycles = |channel: usize| {
            let (register, place) =
                if channel < 10 { (Register::Smpr2, channel) } else { (Register::Smpr1, channel - 10) };
            let sampling = SAMPLING_CYCLES[(registers.get(register) >> (3 * place) & 0b111) as usize];
            sampling + u64::from(Self::bits(registers))
        };
        Some(channels.into_iter().map(|channel| (channel, cycles(channel))).collect())
    }

    /// Begins with lots where rigless's model has ended a sequence's first conversion, now.
    fn begin(&mut self, held: EventId, registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        let Some(sequence) = Self::sequence(registers).filter(|_| self.clock_hz > 0) else { return };
        let cycles: u64 = sequence.iter().map(|(_, cycles)| cycles).sum();
        let lot_cycles = u128::from(LOT_NS) * u128::from(self.clock_hz) / 1_000_000_000;
        let sequences = ((lot_cycles / u128::from(cycles)) as usize).max(1);
        let channels: Vec<usize> = sequence.iter().map(|(channel, _)| *channel).collect();
        let cycles = cycles * sequences as u64;
        // One conversion of the first lot has ended.
        let mut run = Run::at(context.now());
        run.extend(u128::from(cycles - sequence[0].1), self.clock_hz);
        let event = context.schedule(run.ends);
        let channels = channels.repeat(sequences);
        self.scan = Some(Scan { channels, cycles, run, event, held, words: VecDeque::new() });
    }

    /// Ends a lot, and begins the next; an overrun is left to rigless's model.
    fn end_lot(&mut self, mut scan: Scan, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if !scan.words.is_empty() || self.clock_hz == 0 {
            context.request(DMA_REQUEST, Level::Low);
            return Device::on_event(&mut self.adc, scan.held, registers, context);
        }
        scan.words.extend(scan.channels.iter().map(|channel| self.word(*channel, registers)));
        context.request(DMA_REQUEST, Level::High);
        scan.run.extend(u128::from(scan.cycles), self.clock_hz);
        scan.event = context.schedule(scan.run.ends);
        self.scan = Some(scan);
    }

    /// Gives the scan back to rigless's model, before a write.
    fn give_back(&mut self, scan: &Scan, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if !scan.words.is_empty() {
            context.request(DMA_REQUEST, Level::Low);
        }
        // What is being written is in the register already.
        let control = registers.get(Register::Cr2);
        registers.set(Register::Cr2, cr2::ADON.set(control, 0));
        Device::write(&mut self.adc, Register::Cr2, 0, registers, context);
        let starts = if cr2::ADON.is_set(control) { cr2::SWSTART.set(control, 1) } else { control };
        registers.set(Register::Cr2, starts);
        Device::write(&mut self.adc, Register::Cr2, starts, registers, context);
    }
}

impl Device for Converter {
    type Register = Register;

    fn layout(&self) -> &'static [RegisterSpec] {
        Device::layout(&self.adc)
    }

    fn read(
        &mut self,
        register: Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        let Some(scan) = self.scan.as_mut().filter(|_| register == Register::Dr) else {
            return Device::read(&mut self.adc, register, registers, context);
        };
        if let Some(word) = scan.words.pop_front() {
            registers.set(Register::Dr, word);
            if scan.words.is_empty() {
                context.request(DMA_REQUEST, Level::Low);
            }
        }
        Some(registers.get(Register::Dr))
    }

    fn peek(&self, register: Register, registers: &RegisterFile, now: VirtualNanos) -> Option<u64> {
        Device::peek(&self.adc, register, registers, now)
    }

    fn write(&mut self, register: Register, value: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if let Some(scan) = self.scan.take() {
            self.give_back(&scan, registers, context);
        }
        Device::write(&mut self.adc, register, value, registers, context);
    }

    fn on_event(&mut self, event: EventId, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if let Some(scan) = self.scan.take() {
            if scan.event == event {
                self.end_lot(scan, registers, context);
            } else {
                self.scan = Some(scan);
            }
            return;
        }
        // A sequence has ended, and DMA has taken its words: this is the end of the next one's
        // first conversion.
        let status = registers.get(Register::Sr);
        let is_first = self.ended_sequence && !sr::OVR.is_set(status) && !sr::EOC.is_set(status);
        self.ended_sequence = false;
        if is_first {
            self.begin(event, registers, context);
        }
        if self.scan.is_none() {
            Device::on_event(&mut self.adc, event, registers, context);
            self.ended_sequence = sr::EOC.is_set(registers.get(Register::Sr));
        }
    }

    fn on_request(&mut self, request: RequestChange, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        Device::on_request(&mut self.adc, request, registers, context);
    }

    fn on_clock(&mut self, hz: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if hz != self.clock_hz {
            self.clock_hz = hz;
            if let Some(scan) = &mut self.scan {
                scan.run.drop_carry();
            }
        }
        Device::on_clock(&mut self.adc, hz, registers, context);
    }

    fn reset(&mut self) {
        Device::reset(&mut self.adc);
        self.scan = None;
        self.ended_sequence = false;
    }

    fn reset_line(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if self.scan.take().is_some_and(|scan| !scan.words.is_empty()) {
            context.request(DMA_REQUEST, Level::Low);
        }
        self.ended_sequence = false;
        Device::reset_line(&mut self.adc, registers, context);
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use rigless::emulator::{Error, Memory};
    use rigless::mcu::Operate;
    use rigless::soc::Width;

    use super::super::Stm32f4;
    use super::*;
    use crate::wiring::Chip as Model;

    const RCC: u64 = 0x4002_3800;
    const ADC1: u64 = 0x4001_2000;
    const STREAM: u64 = 0x4002_6410;
    const RAM: u64 = 0x2000_0000;
    /// ADON, CONT, DMA, DDS; with EOCS each conversion is rigless's.
    const ON: u64 = 0b11_0000_0011;
    const EOCS: u64 = 1 << 10;
    const SWSTART: u64 = 1 << 30;
    /// Channels 3, 12 and 5 in their order, and their voltages, mV.
    const SEQUENCE: u64 = 3 | 12 << 5 | 5 << 10;
    const MILLIVOLTS: [(u8, u32); 3] = [(3, 1000), (12, 2000), (5, 3300)];
    const PLACES: usize = 12;

    /// The words that DMA stored, with their instants.
    #[derive(Default)]
    struct Ram {
        now_ns: u64,
        stored: Vec<(u64, u64, u64)>,
    }

    impl Memory for Ram {
        fn read(&mut self, address: u64, width: Width) -> Result<u64, Error> {
            Err(Error::Memory { address, width })
        }

        fn write(&mut self, address: u64, _: Width, value: u64) -> Result<(), Error> {
            self.stored.push((self.now_ns, address, value));
            Ok(())
        }
    }

    struct Bench {
        chip: Stm32f4,
        ram: Ram,
    }

    impl Bench {
        /// A chip on 16 MHz whose converter, on 8, scans three channels of 492 cycles without end.
        fn scanning(more: u64) -> Self {
            let mut bench = Self { chip: Stm32f4::new(Model::F407).unwrap(), ram: Ram::default() };
            for (channel, millivolts) in MILLIVOLTS {
                bench.chip.converter(1).unwrap().set_input(channel, millivolts);
            }
            for (address, value) in [
                (RCC + 0x30, 1 << 22),
                (RCC + 0x44, 1 << 8),
                (STREAM + 4, PLACES as u64),
                (STREAM + 8, ADC1 + 0x4c),
                (STREAM + 12, RAM),
                // Half-words, MINC, CIRC, EN.
                (STREAM, 1 << 13 | 1 << 11 | 1 << 10 | 1 << 8 | 1),
                (ADC1 + 0x0c, 0x07ff_ffff),
                (ADC1 + 0x10, 0x3fff_ffff),
                (ADC1 + 0x2c, 2 << 20),
                (ADC1 + 0x34, SEQUENCE),
                (ADC1 + 4, 1 << 8),
                (ADC1 + 8, ON | more),
                (ADC1 + 8, ON | more | SWSTART),
            ] {
                bench.write(address, value);
            }
            bench
        }

        fn write(&mut self, address: u64, value: u64) {
            self.chip.write(VirtualNanos(self.ram.now_ns), address, Width::W32, value).unwrap();
            self.chip.settle(&mut self.ram).unwrap();
        }

        fn read(&mut self, address: u64) -> u64 {
            let value = self.chip.read(VirtualNanos(self.ram.now_ns), address, Width::W32).unwrap();
            self.chip.settle(&mut self.ram).unwrap();
            value
        }

        /// Advances time; the number of events.
        fn pass(&mut self, ns: u64) -> usize {
            let (end_ns, mut events) = (self.ram.now_ns + ns, 0);
            while let Some(next) = self.chip.next_event().filter(|next| next.0 <= end_ns) {
                self.ram.now_ns = next.0;
                self.chip.advance_to(next);
                self.chip.settle(&mut self.ram).unwrap();
                events += 1;
            }
            self.ram.now_ns = end_ns;
            events
        }
    }

    #[test]
    fn lots_are_as_many_words_as_single_conversions() {
        let (mut lots, mut single) = (Bench::scanning(0), Bench::scanning(EOCS));
        let [few, many] = [&mut lots, &mut single].map(|bench| bench.pass(20_000_000));
        assert!(few < many / 2, "{few} and {many} events");
        let ([lots, single], lot) = ([lots.ram.stored, single.ram.stored], 6);
        assert!(single.len() > 300 && lots.len().abs_diff(single.len()) < lot, "{} {}", lots.len(), single.len());
        for (nth, (lot, single)) in lots.iter().zip(&single).enumerate() {
            assert_eq!((lot.1, lot.2), (single.1, single.2), "word {nth}");
            assert_eq!(lot.1, RAM + 2 * (nth % PLACES) as u64);
            assert!((0..LOT_NS).contains(&(lot.0 - single.0)), "word {nth}: {} and {} ns", lot.0, single.0);
        }
        assert_eq!([0, 1, 2].map(|nth| lots[nth].2), [1240, 2481, 4095]);
    }

    #[test]
    fn a_converter_switched_off_stores_nothing_more() {
        let mut bench = Bench::scanning(0);
        bench.pass(5_000_000);
        bench.write(ADC1 + 8, 0);
        let stored = bench.ram.stored.len();
        bench.pass(5_000_000);
        assert_eq!(bench.ram.stored.len(), stored);
        // It begins anew with the first channel, at the place after.
        bench.write(ADC1 + 8, ON);
        bench.write(ADC1 + 8, ON | SWSTART);
        bench.pass(5_000_000);
        let (_, address, word) = bench.ram.stored[stored];
        assert_eq!((address, word), (RAM + 2 * (stored % PLACES) as u64, 1240));
    }

    #[test]
    fn a_lot_that_nobody_takes_is_an_overrun() {
        const OVR: u64 = 1 << 5;
        let mut bench = Bench::scanning(0);
        bench.pass(5_000_000);
        assert_eq!(bench.read(ADC1) & OVR, 0);
        bench.write(STREAM, 0);
        bench.pass(5_000_000);
        assert_eq!(bench.read(ADC1) & OVR, OVR);
        let stored = bench.ram.stored.len();
        bench.pass(5_000_000);
        assert_eq!(bench.ram.stored.len(), stored);
    }
}
