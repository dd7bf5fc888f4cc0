//! The SDIO from the firmware's side, with a card in its slot.

#![allow(clippy::unwrap_used)]

use rigless::emulator::{Error, Memory};
use rigless::mcu::Operate;
use rigless::soc::Width;
use rigless::time::VirtualNanos;

use super::super::Stm32f4;
use crate::parts::sd_card::{BLOCK_BYTES, Config, SdCard};
use crate::pins::Pin;
use crate::wiring::{CardSlot, Chip};

const RCC: u64 = 0x4002_3800;
const GPIOC: u64 = 0x4002_0800;
const GPIOD: u64 = 0x4002_0C00;
const SDIO: u64 = 0x4001_2C00;
const DMA2: u64 = 0x4002_6400;
const RAM: u64 = 0x2000_0000;

const POWER: u64 = 0x00;
const CLKCR: u64 = 0x04;
const ARG: u64 = 0x08;
const CMD: u64 = 0x0C;
const RESPCMD: u64 = 0x10;
const RESP1: u64 = 0x14;
const DTIMER: u64 = 0x24;
const DLEN: u64 = 0x28;
const DCTRL: u64 = 0x2C;
const DCOUNT: u64 = 0x30;
const STA: u64 = 0x34;
const ICR: u64 = 0x38;
const MASK: u64 = 0x3C;
const FIFOCNT: u64 = 0x48;
const FIFO: u64 = 0x80;

// STA, 31.9.11.
const CCRCFAIL: u64 = 1 << 0;
const DCRCFAIL: u64 = 1 << 1;
const CTIMEOUT: u64 = 1 << 2;
const DTIMEOUT: u64 = 1 << 3;
const TXUNDERR: u64 = 1 << 4;
const RXOVERR: u64 = 1 << 5;
const CMDREND: u64 = 1 << 6;
const CMDSENT: u64 = 1 << 7;
const DATAEND: u64 = 1 << 8;
const DBCKEND: u64 = 1 << 10;
const CMDACT: u64 = 1 << 11;
const RXACT: u64 = 1 << 13;
const RXDAVL: u64 = 1 << 21;
const OUTCOMES: u64 = 0x5FF;

const SHORT: u64 = 0b01 << 6;
const LONG: u64 = 0b11 << 6;
const SEND: u64 = 1 << 10;
/// DCTRL: blocks of 512 bytes, from or to the card, by DMA.
const READ: u64 = 9 << 4 | 0b11;
const WRITE: u64 = 9 << 4 | 0b01;
const BY_DMA: u64 = 1 << 3;
/// CLKCR: 400 kHz, 24 MHz, on; four lines.
const SLOW: u64 = 118 | 1 << 8;
const FAST: u64 = 1 << 8;
const FOUR_LINES: u64 = 0b01 << 11;
const US: u64 = 1000;
const MS: u64 = 1_000_000;

/// Some RAM for the streams.
struct Ram(Vec<u8>);

impl Memory for Ram {
    fn read(&mut self, address: u64, width: Width) -> Result<u64, Error> {
        let place = (address - RAM) as usize;
        let bytes = self.0.get(place..place + 4).ok_or(Error::Memory { address, width })?;
        Ok(u64::from(u32::from_le_bytes(bytes.try_into().unwrap())) & width.mask())
    }

    fn write(&mut self, address: u64, width: Width, value: u64) -> Result<(), Error> {
        let place = (address - RAM) as usize;
        let bytes = self.0.get_mut(place..place + 4).ok_or(Error::Memory { address, width })?;
        bytes.copy_from_slice(&(value as u32).to_le_bytes());
        Ok(())
    }
}

struct Bench {
    chip: Stm32f4,
    ram: Ram,
    now_ns: u64,
    line: bool,
    address: u64,
}

fn pin(name: &str) -> Pin {
    name.parse().unwrap()
}

fn pattern(index: u32) -> Vec<u8> {
    (0..BLOCK_BYTES).map(|place| (place as u32 * 7 + index * 13) as u8).collect()
}

impl Bench {
    /// An F446 at 48 MHz, its pins connected, without a card.
    fn empty() -> Self {
        let mut chip = Stm32f4::new(Chip::F446).unwrap();
        chip.set_interrupt_entry(0);
        chip.connect_card(CardSlot {
            clock: pin("PC12"),
            command: pin("PD2"),
            data: ["PC8", "PC9", "PC10", "PC11"].map(pin),
            detect: None,
        });
        let mut bench = Self { chip, ram: Ram(vec![0; 2048]), now_ns: 0, line: false, address: 0 };
        // PLL: 16 MHz / 8 * 168 / 7 (6.3.1, 6.3.2); DMA2, ports C and D, SDIO.
        bench.write(RCC + 0x04, 7 << 24 | 168 << 6 | 8);
        bench.write(RCC, 1 << 24 | 1);
        bench.write(RCC + 0x30, 1 << 22 | 0b1100);
        bench.write(RCC + 0x44, 1 << 11);
        bench.pass(MS);
        bench.write(GPIOC, 0b10_1010_1010 << 16);
        bench.write(GPIOC + 0x24, 0xC_CCCC);
        bench.write(GPIOD, 0b10 << 4);
        bench.write(GPIOD + 0x20, 0xC << 8);
        bench.set(POWER, 0b11);
        bench.set(CLKCR, SLOW);
        bench.pass(MS);
        bench
    }

    fn with_card() -> Self {
        let mut bench = Self::empty();
        let image: Vec<u8> = (0..8).flat_map(pattern).collect();
        let now_ns = bench.now_ns;
        bench.chip.card_slot().exchange(now_ns, Some(SdCard::new(Config::high(2048), &image)), true);
        bench
    }

    /// Bench with a card that is selected, at 24 MHz on one line; or on four.
    fn selected(lines: u8) -> Self {
        let mut bench = Self::with_card();
        bench.command(0, 0, 0);
        bench.command(8, 0x1AA, SHORT);
        assert_eq!(bench.get(RESP1), 0x1AA);
        while bench.get(RESP1) >> 31 == 0 {
            bench.command(55, 0, SHORT);
            bench.command(41, 0x4010_0000, SHORT);
        }
        bench.command(2, 0, LONG);
        bench.command(3, 0, SHORT);
        bench.address = bench.get(RESP1) & 0xFFFF_0000;
        let address = bench.address;
        bench.command(7, address, SHORT);
        bench.set(CLKCR, FAST | if lines == 4 { FOUR_LINES } else { 0 });
        if lines == 4 {
            bench.command(55, address, SHORT);
            assert_eq!(bench.command(6, 0b10, SHORT), CMDREND);
        }
        bench.set(DTIMER, 24_000_000 / 10);
        bench.set(DLEN, 512);
        bench
    }

    fn settle(&mut self) {
        self.chip.settle(&mut self.ram).unwrap();
        for change in self.chip.drain_lines() {
            if change.line.index() == 49 {
                self.line = change.level == rigless::device::Level::High;
            }
        }
    }

    fn write(&mut self, address: u64, value: u64) {
        self.chip.write(VirtualNanos(self.now_ns), address, Width::W32, value).unwrap();
        self.settle();
    }

    fn read(&mut self, address: u64) -> u64 {
        let value = self.chip.read(VirtualNanos(self.now_ns), address, Width::W32).unwrap();
        self.settle();
        value
    }

    fn set(&mut self, register: u64, value: u64) {
        self.write(SDIO + register, value);
    }

    fn get(&mut self, register: u64) -> u64 {
        self.read(SDIO + register)
    }

    fn pass(&mut self, ns: u64) {
        let end_ns = self.now_ns + ns;
        while let Some(next) = self.chip.next_event().filter(|next| next.0 <= end_ns) {
            self.now_ns = next.0;
            self.chip.advance_to(next);
            self.settle();
        }
        self.now_ns = end_ns;
    }

    /// Waits for any of these flags, 1 s at most; returns the time it took.
    fn wait(&mut self, flags: u64) -> u64 {
        let before_ns = self.now_ns;
        while self.get(STA) & flags == 0 {
            assert!(self.now_ns - before_ns < 1000 * MS, "{:#x}", self.get(STA));
            let passed_ns = self.now_ns - before_ns;
            self.pass(100 + passed_ns / 500);
        }
        self.now_ns - before_ns
    }

    fn begin(&mut self, index: u64, argument: u64, wait: u64) {
        self.set(ICR, OUTCOMES);
        self.set(ARG, argument);
        self.set(CMD, index | wait | SEND);
    }

    /// A command to its end; its flags.
    fn command(&mut self, index: u64, argument: u64, wait: u64) -> u64 {
        self.begin(index, argument, wait);
        self.wait(CCRCFAIL | CTIMEOUT | CMDREND | CMDSENT);
        self.get(STA) & OUTCOMES
    }

    fn card(&mut self) -> &mut SdCard {
        self.chip.card_slot().card_mut().unwrap()
    }

    /// Reads a block by the processor; the flags at its end.
    fn read_block(&mut self, index: u64) -> (u64, Vec<u8>) {
        self.set(DCTRL, READ);
        self.command(17, index, SHORT);
        self.drain()
    }

    /// Takes what comes by the processor, to the end of the transfer.
    fn drain(&mut self) -> (u64, Vec<u8>) {
        let mut bytes = Vec::new();
        while self.get(STA) & (RXACT | RXDAVL) != 0 {
            if self.get(STA) & RXDAVL != 0 {
                bytes.extend((self.get(FIFO) as u32).to_le_bytes());
            } else {
                self.pass(100);
            }
        }
        (self.get(STA) & OUTCOMES & !CMDREND, bytes)
    }

    /// Writes a block by the processor; the flags at its end.
    fn write_block(&mut self, index: u64, bytes: &[u8]) -> u64 {
        self.command(24, index, SHORT);
        self.set(DCTRL, WRITE);
        for word in bytes.as_chunks::<4>().0 {
            while self.get(STA) & 1 << 16 != 0 {
                self.pass(100);
            }
            self.set(FIFO, u64::from(u32::from_le_bytes(*word)));
        }
        self.wait(DATAEND | DTIMEOUT | DCRCFAIL | TXUNDERR);
        self.get(STA) & OUTCOMES & !CMDREND
    }

    /// A stream of DMA2 as firmware would set it up: stream 3, channel 4, words, the SDIO ends it.
    fn stream(&mut self, to_card: bool) {
        self.write(DMA2 + 0x08, 0x3D << 22);
        self.write(DMA2 + 0x60, SDIO + FIFO);
        self.write(DMA2 + 0x64, RAM);
        self.write(DMA2 + 0x6C, 0b111);
        let bursts = 0b01 << 23 | 0b01 << 21;
        let direction = if to_card { 0b01 << 6 } else { 0 };
        self.write(DMA2 + 0x58, 4 << 25 | bursts | 0b10 << 13 | 0b10 << 11 | 1 << 10 | direction | 1 << 5 | 1);
    }
}

#[test]
fn a_command_takes_the_time_of_its_bits() {
    let mut bench = Bench::with_card();
    bench.set(MASK, CMDREND);
    bench.begin(0, 0, 0);
    assert_eq!(bench.get(STA) & (CMDACT | OUTCOMES), CMDACT);
    // 48 bits at 400 kHz.
    let took_ns = bench.wait(CMDSENT);
    assert!((119 * US..=121 * US).contains(&took_ns), "{took_ns}");
    assert!(!bench.line);
    bench.begin(8, 0x1AA, SHORT);
    let took_ns = bench.wait(CMDREND);
    assert!((259 * US..=261 * US).contains(&took_ns), "{took_ns}");
    assert_eq!((bench.get(RESP1), bench.get(RESPCMD), bench.get(STA) & CMDACT), (0x1AA, 8, 0));
    assert!(bench.line);
    bench.set(ICR, CMDREND);
    assert!(!bench.line && bench.get(STA) & CMDREND == 0);
    let mut bench = Bench::selected(4);
    // Nothing moves without its clock.
    bench.set(CLKCR, 0);
    let address = bench.address;
    bench.begin(13, address, SHORT);
    bench.pass(10 * MS);
    assert_eq!(bench.get(STA) & OUTCOMES, 0);
}

#[test]
fn an_empty_slot_times_out() {
    let mut bench = Bench::empty();
    assert_eq!(bench.command(0, 0, 0), CMDSENT);
    bench.begin(8, 0x1AA, SHORT);
    // 48 bits, and 64 clocks without an answer.
    let took_ns = bench.wait(CTIMEOUT);
    assert!((279 * US..=281 * US).contains(&took_ns), "{took_ns}");
}

#[test]
fn an_answer_without_crc_fails_its_check() {
    let mut bench = Bench::with_card();
    bench.command(0, 0, 0);
    bench.command(8, 0x1AA, SHORT);
    assert_eq!(bench.command(55, 0, SHORT), CMDREND);
    assert_eq!(bench.command(41, 0x4010_0000, SHORT), CCRCFAIL);
    assert_eq!(bench.get(RESP1), 0x00FF_8000);
    // A short answer where a long one was expected.
    let mut bench = Bench::selected(1);
    let address = bench.address;
    assert_eq!(bench.command(13, address, LONG), CCRCFAIL);
}

#[test]
fn a_block_comes_when_the_card_has_it() {
    for (lines, block_us) in [(1, 171), (4, 43)] {
        let mut bench = Bench::selected(lines);
        bench.set(DCTRL, READ);
        assert_eq!((bench.get(DCOUNT), bench.get(FIFOCNT)), (512, 128));
        bench.begin(17, 3, SHORT);
        // The card takes 200 us, after a command of 48 clocks.
        bench.pass(201 * US);
        assert_eq!((bench.get(DCOUNT), bench.get(STA) & RXACT), (512, RXACT));
        bench.pass(10 * US);
        let left = bench.get(DCOUNT);
        assert!(left < 512 && left.is_multiple_of(4), "{left}");
        let mut bytes = Vec::new();
        let begun_ns = bench.now_ns;
        while bytes.len() < 512 {
            bench.wait(RXDAVL);
            bytes.extend((bench.get(FIFO) as u32).to_le_bytes());
        }
        let took_us = (bench.now_ns - begun_ns) / US + 9;
        assert!((block_us - 2..block_us + 3).contains(&took_us), "{took_us}");
        assert_eq!(bytes, pattern(3));
        bench.wait(DATAEND);
        assert_eq!(bench.get(STA) & (OUTCOMES | RXACT), DATAEND | DBCKEND | CMDREND);
    }
}

#[test]
fn a_data_path_that_is_late_misses_the_block() {
    let mut bench = Bench::selected(4);
    bench.command(17, 3, SHORT);
    bench.pass(MS);
    bench.set(DCTRL, READ);
    // 100 ms at 24 MHz.
    let took_ns = bench.wait(DTIMEOUT);
    assert!((99 * MS..=101 * MS).contains(&took_ns), "{took_ns}");
    assert_eq!(bench.get(STA) & (OUTCOMES | RXACT), DTIMEOUT | CMDREND);
}

#[test]
fn faults_of_blocks_are_flagged() {
    let mut bench = Bench::selected(4);
    bench.card().faults.garbled_reads = 1;
    assert_eq!(bench.read_block(3).0, DCRCFAIL);
    assert_eq!(bench.read_block(3), (DATAEND | DBCKEND, pattern(3)));
    bench.card().faults.refused_writes = 1;
    assert_eq!(bench.write_block(3, &pattern(60)), DCRCFAIL);
    assert_eq!(bench.card().block(3), pattern(3));
    // The host moves blocks over one line, the card over four.
    bench.set(CLKCR, FAST);
    assert_eq!(bench.read_block(3).0, DCRCFAIL);
    // A card that is pulled out in a block, and before it.
    let mut bench = Bench::selected(4);
    bench.set(DCTRL, READ);
    bench.begin(17, 3, SHORT);
    bench.pass(210 * US);
    let now_ns = bench.now_ns;
    bench.chip.card_slot().exchange(now_ns, None, true).unwrap();
    assert_eq!(bench.drain().0, DCRCFAIL);
    bench.set(DCTRL, READ);
    assert_eq!(bench.command(17, 3, SHORT), CTIMEOUT);
    bench.wait(DTIMEOUT);
}

#[test]
fn a_busy_card_holds_the_end_of_a_block() {
    for ends_before_busy in [false, true] {
        let mut bench = Bench::selected(4);
        bench.chip.card_slot().ends_before_busy = ends_before_busy;
        bench.card().set_program_ns(50 * MS);
        let (before_ns, address) = (bench.now_ns, bench.address);
        assert_eq!(bench.write_block(5, &pattern(60)), DATAEND | DBCKEND);
        let took_ms = (bench.now_ns - before_ns) / MS;
        assert_eq!(took_ms, if ends_before_busy { 0 } else { 50 });
        bench.command(13, address, SHORT);
        assert_eq!(bench.get(RESP1) >> 9 & 0xF, if ends_before_busy { 7 } else { 4 });
        assert_eq!(bench.card().block(5), pattern(60));
    }
}

#[test]
fn a_card_that_is_busy_for_longer_than_the_timer() {
    let mut bench = Bench::selected(4);
    bench.card().set_program_ns(150 * MS);
    let before_ns = bench.now_ns;
    assert_eq!(bench.write_block(5, &pattern(60)), DTIMEOUT);
    assert_eq!((bench.now_ns - before_ns) / MS, 100);
    assert_eq!(bench.card().block(5), pattern(60), "the card has it all the same");
}

#[test]
fn a_fifo_that_nobody_serves() {
    let mut bench = Bench::selected(4);
    bench.set(DCTRL, READ);
    bench.begin(17, 3, SHORT);
    bench.wait(RXOVERR);
    bench.pass(MS);
    assert_eq!(bench.get(STA) & (OUTCOMES | RXACT), RXOVERR | CMDREND);
    let address = bench.address;
    bench.command(13, address, SHORT);
    assert_eq!(bench.get(RESP1) >> 9 & 0xF, 4, "the card has sent it");
    bench.command(24, 3, SHORT);
    bench.set(DCTRL, WRITE);
    bench.set(FIFO, 1);
    bench.wait(TXUNDERR);
    assert_eq!(bench.card().block(3), pattern(3));
}

#[test]
fn a_stream_moves_a_block_each_way() {
    let mut bench = Bench::selected(4);
    bench.stream(false);
    bench.set(DCTRL, READ | BY_DMA);
    bench.command(17, 3, SHORT);
    bench.wait(DATAEND | DCRCFAIL | RXOVERR);
    assert_eq!(bench.get(STA) & (OUTCOMES | RXDAVL), DATAEND | DBCKEND | CMDREND);
    assert_eq!(bench.ram.0[..512], pattern(3));
    assert_eq!(bench.read(DMA2) >> 27 & 1, 1, "TCIF3");
    bench.ram.0[..512].copy_from_slice(&pattern(200));
    bench.command(24, 6, SHORT);
    bench.stream(true);
    bench.set(DCTRL, WRITE | BY_DMA);
    bench.wait(DATAEND | DCRCFAIL | TXUNDERR);
    assert_eq!(bench.get(STA) & OUTCOMES, DATAEND | DBCKEND | CMDREND);
    assert_eq!(bench.card().block(6), pattern(200));
}

#[test]
fn a_card_needs_its_pins() {
    // The command line, the clock, D0: nothing is heard. D3: four lines are not there.
    for (port, number) in [(GPIOD, 2), (GPIOC, 12), (GPIOC, 8), (GPIOC, 11)] {
        let mut bench = Bench::selected(4);
        let address = bench.address;
        let modes = bench.read(port);
        bench.write(port, modes & !(0b11 << (2 * number)));
        if number == 11 {
            assert_eq!(bench.read_block(3).0, DCRCFAIL);
        } else {
            assert_eq!(bench.command(13, address, SHORT), CTIMEOUT);
        }
        bench.write(port, modes);
        assert_eq!(bench.command(13, address, SHORT), CMDREND);
    }
}
